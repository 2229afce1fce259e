"""Public names of `pom.fmu.worker`."""

from .model import UnpackedFmu as UnpackedFmu
from .run import replay_job as replay_job
