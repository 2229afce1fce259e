"""Public names of `pom.tolerances` and where they are defined; ``__init__.py`` loads them from this list."""

from . import rows as rows
