"""Public names of `pom.replaying`."""

from .batch import replay_all as replay_all
from .replay_case import plan_of as plan_of
from .replay_case import replay as replay
from .run_remarks import calibration as calibration
from .run_remarks import drift as drift
from .run_remarks import pilot_activity as pilot_activity
