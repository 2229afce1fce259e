"""Public names of `pom.judging`."""

from .measures.modal import fit_mode as fit_mode
from .measures.modal import mode_table as mode_table
from .verdict import settle_case as settle_case
from .verdict import settle_case as settled
