"""Public names of `flighttest.manoeuvre_finding` and where they are defined; ``__init__.py`` loads them from this list."""

from .figure import draw_manoeuvres as draw_manoeuvres
from .finding import find_manoeuvres as find_manoeuvres
from .finding import named_by_response as named_by_response
