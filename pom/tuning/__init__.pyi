"""Public names of `pom.tuning` and where they are defined; ``__init__.py`` loads them from this list."""

from .search import Tuning as Tuning
from .search import tune as tune
