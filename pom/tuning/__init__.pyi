"""Public names of `pom.tuning` and where they are defined; ``__init__.py`` loads them from this list."""

from .search import tune as tune
from .tuning_log import Tuning as Tuning
from .tuning_log import read_log as read_log
