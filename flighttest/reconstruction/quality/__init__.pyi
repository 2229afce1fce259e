"""Public names of `flighttest.reconstruction.quality`."""

from .assessment import assess as assess
from .finding import Finding as Finding
from .finding import describe_name as describe_name
from .page import write_page as write_page
from .result import Quality as Quality
