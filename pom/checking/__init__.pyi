"""Public names of `pom.checking` and where they are defined; ``__init__.py`` loads them from this list."""

from .batch_check import check_batch as check_batch
from .case_check import case_problems as case_problems
from .record_check import RecordCheck as RecordCheck
from .record_check import check_records as check_records
from .record_check import with_record_checks as with_record_checks
