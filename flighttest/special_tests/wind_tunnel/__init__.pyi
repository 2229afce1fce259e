"""Public names of `flighttest.special_tests.wind_tunnel`."""

from .balance import BalanceSetup as BalanceSetup
from .balance import read_setup as read_setup
from .reduction import balance_coefficients as balance_coefficients
from .reduction import without_nuisance as without_nuisance
from .surfaces import draw_surfaces as draw_surfaces
from .tables import write_balance_table as write_balance_table
