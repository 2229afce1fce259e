"""Public names of `flighttest.flight_programme.evaluation`."""

from .flight_evaluation import evaluate as evaluate
from .result import Evaluation as Evaluation
