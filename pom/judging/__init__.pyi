"""Public names of `pom.judging`."""

from .applicability import settle_case as settle_case
from .applicability import settle_case as settled
from .measures.damped_sine import fit_mode as fit_mode
from .measures.modal import mode_table as mode_table
