"""Public names of `pom.judging` and where they are defined; ``__init__.py`` loads them from this list."""

from .applicability import settled as settled
from .modal import fit_mode as fit_mode
from .modal import mode_table as mode_table
