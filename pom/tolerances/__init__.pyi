"""Public names of `pom.tolerances`."""

from . import rows as rows
