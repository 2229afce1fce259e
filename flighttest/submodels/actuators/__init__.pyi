"""Public names of `flighttest.submodels.actuators`."""

from .figure import draw_actuator as draw_actuator
from .identification import identify_actuator as identify_actuator
from .identification import read_bench_log as read_bench_log
from .response import Structure as Structure
from .response import simulate_actuator as simulate_actuator
from .result import IdentifiedActuator as IdentifiedActuator
