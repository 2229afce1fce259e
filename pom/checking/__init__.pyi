"""Public names of `pom.checking`."""

from .batch_check import check_batch as check_batch
from .case_check import RecordCheck as RecordCheck
from .case_check import case_problems as case_problems
from .case_check import check_records as check_records
from .case_check import with_record_checks as with_record_checks
