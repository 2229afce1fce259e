"""Public names of `aerodb.comparison`."""

from .comparison import compare as compare
from .record_conditions import read_conditions as read_conditions
