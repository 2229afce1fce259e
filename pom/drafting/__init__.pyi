"""Public names of `pom.drafting` and where they are defined; ``__init__.py`` loads them from this list."""

from .draft import init_case as init_case
