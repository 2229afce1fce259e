"""Public names of `pom.cases`."""

from .case import PomCase as PomCase
from .case import read_case as read_case
from .case_file import case_schema as case_schema
