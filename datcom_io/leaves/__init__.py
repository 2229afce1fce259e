"""The leaves of a case's tree, by subject: each function stacks one family of tables, or returns None where the case has none."""

from __future__ import annotations

from collections.abc import Callable

import xarray as xr

from ..stacking import Stacker
from . import clean, devices

_SUBJECTS = (clean, devices)

LEAVES: dict[str, Callable[[Stacker], xr.Dataset | None]] = {name: make for subject in _SUBJECTS for name, make in subject.LEAVES.items()}
