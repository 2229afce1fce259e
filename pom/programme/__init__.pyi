"""Public names of `pom.programme`."""

from .row_cases import plan_row as plan_row
from .row_gradients import differentiate_row as differentiate_row
