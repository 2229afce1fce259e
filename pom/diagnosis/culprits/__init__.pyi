"""Public names of `pom.diagnosis.culprits`."""

from .ranking import order_corrections as order_corrections
from .ranking import rank_culprits as rank_culprits
from .sentences import describe_culprits as describe_culprits
