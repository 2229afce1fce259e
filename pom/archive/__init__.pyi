"""Public names of `pom.archive` and where they are defined; ``__init__.py`` loads them from this list."""

from .archive import Archive as Archive
from .archive import read_archive as read_archive
from .custody import Custody as Custody
from .origins import provenance as provenance
from .verification import VerificationResult as VerificationResult
from .verification import verify as verify
