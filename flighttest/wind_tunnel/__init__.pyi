"""Public names of `flighttest.wind_tunnel` and where they are defined; ``__init__.py`` loads them from this list."""

from .figure import draw_surfaces as draw_surfaces
from .reduction import balance_coefficients as balance_coefficients
from .reduction import without_nuisance as without_nuisance
from .setup import BalanceSetup as BalanceSetup
from .setup import read_setup as read_setup
