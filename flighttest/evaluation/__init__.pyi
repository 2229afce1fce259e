"""Public names of `flighttest.evaluation` and where they are defined; ``__init__.py`` loads them from this list."""

from .flight_evaluation import evaluate as evaluate
from .result import Evaluation as Evaluation
