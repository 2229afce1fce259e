"""Public names of `pom.diagnosis.tuning`."""

from .search import tune as tune
from .tuning_log import Tuning as Tuning
from .tuning_log import read_log as read_log
