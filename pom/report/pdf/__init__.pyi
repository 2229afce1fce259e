"""Public names of `pom.report.pdf` and where they are defined; ``__init__.py`` loads them from this list."""

from .document import pdf_pages as pdf_pages
