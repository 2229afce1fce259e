"""Public names of `flighttest.flight_programme.manoeuvre_finding`."""

from .finding import draw_manoeuvres as draw_manoeuvres
from .finding import find_manoeuvres as find_manoeuvres
from .finding import named_by_response as named_by_response
from .marks import marked_or_found as marked_or_found
