"""Public names of `pom.report`."""

from . import pdf as pdf
from .chapters import drawn_chapters as drawn_chapters
from .page import html_files as html_files
from .writer import write_report as write_report
