"""Public names of `pom.cases` and where they are defined; ``__init__.py`` loads them from this list."""

from .case import PomCase as PomCase
from .case import read_case as read_case
from .file_schema import case_schema as case_schema
