"""Public names of `pom.report.pdf`."""

from .document import pdf_pages as pdf_pages
