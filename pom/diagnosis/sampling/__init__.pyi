"""Public names of `pom.diagnosis.sampling`."""

from .draws import DrawnModels as DrawnModels
from .draws import Instruments as Instruments
from .sampled_replay import replay_sampled as replay_sampled
from .sampled_replay import sampled as sampled
