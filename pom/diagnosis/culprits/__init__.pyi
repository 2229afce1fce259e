"""Public names of `pom.diagnosis.culprits`."""

from .ranking import culprit_sentences as culprit_sentences
from .ranking import order_corrections as order_corrections
from .ranking import rank_culprits as rank_culprits
