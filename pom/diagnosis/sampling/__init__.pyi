"""Public names of `pom.diagnosis.sampling`."""

from .draws import DrawnModels as DrawnModels
from .draws import InstrumentErrors as InstrumentErrors
from .draws import InstrumentErrors as Instruments
from .sampled_replay import replay_draws as replay_draws
from .sampled_replay import replay_draws as sampled
from .sampled_replay import replay_sampled as replay_sampled
