"""Public names of `pom.report` and where they are defined; ``__init__.py`` loads them from this list."""

from . import pdf as pdf
from .page import html_page as html_page
from .writer import write_report as write_report
