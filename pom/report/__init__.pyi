"""Public names of `pom.report` and where they are defined; ``__init__.py`` loads them from this list."""

from . import pdf as pdf
from .chapters import drawn_chapters as drawn_chapters
from .page import html_files as html_files
from .writer import write_report as write_report
