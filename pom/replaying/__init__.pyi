"""Public names of `pom.replaying` and where they are defined; ``__init__.py`` loads them from this list."""

from .batch import replay_all as replay_all
from .offsets import calibration as calibration
from .offsets import drift as drift
from .piloting import pilot_activity as pilot_activity
from .replay_case import plan_of as plan_of
from .replay_case import replay as replay
