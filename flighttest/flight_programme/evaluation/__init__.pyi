"""Public names of `flighttest.flight_programme.evaluation`."""

from .flight_evaluation import evaluate_flight as evaluate
from .flight_evaluation import evaluate_flight as evaluate_flight
from .result import Evaluation as Evaluation
