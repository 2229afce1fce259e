"""Public names of `pom.sampling` and where they are defined; ``__init__.py`` loads them from this list."""

from .drawn_models import DrawnModels as DrawnModels
from .instruments import Instruments as Instruments
from .sampled_batch import replay_sampled as replay_sampled
from .sampled_case import sampled as sampled
