"""Public names of `pom.archive`."""

from .archive import Archive as Archive
from .archive import Custody as Custody
from .archive import read_archive as read_archive
from .origins import provenance as provenance
from .verification import VerificationResult as VerificationResult
from .verification import verify as verify
