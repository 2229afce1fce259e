"""Public names of `flighttest.quality` and where they are defined; ``__init__.py`` loads them from this list."""

from .assessment import assess as assess
from .finding import Finding as Finding
from .page import write_page as write_page
from .result import Quality as Quality
