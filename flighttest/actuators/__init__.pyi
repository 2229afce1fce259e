"""Public names of `flighttest.actuators` and where they are defined; ``__init__.py`` loads them from this list."""

from .bench_log import read_bench_log as read_bench_log
from .figure import draw_actuator as draw_actuator
from .identification import identify_actuator as identify_actuator
from .response import Structure as Structure
from .response import simulate_actuator as simulate_actuator
from .result import IdentifiedActuator as IdentifiedActuator
