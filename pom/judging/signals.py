"""The signals of a flight or of a model by canonical name, and the quantities that are formed of them.

Flight and model are formed alike: distances and deviations begin at the first sample of the replay in both.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..tolerances.derived_channels import SOURCES, output_of

if TYPE_CHECKING:
    from ..cases.case import PomCase


Raw = Mapping[str, np.ndarray]

_FLOW = re.compile(r"^engine\d+\.fuel_flow$")


class Signals(Mapping[str, np.ndarray]):
    """Samples of one run by canonical name; what is not recorded but can be formed is formed. [SI]

    Parameters
    ----------
    raw : mapping of str to array (time,)
    time : array (time,)
        [s]
    wheel_radius : float, optional
        Turns the torque on the control wheel into the force at its rim. [m]
    """

    def __init__(self, raw: Raw, time: np.ndarray, wheel_radius: float | None = None):
        self.raw: Raw = raw.raw if isinstance(raw, Signals) else raw
        self.time: np.ndarray = time
        self.wheel_radius: float | None = wheel_radius
        self._formed: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        source = output_of(name, self.raw)
        if source in self.raw:
            return self.raw[source]
        if name not in self._formed:
            if name not in self:
                raise KeyError(name)
            self._formed[name] = _RECIPES[name](self)
        return self._formed[name]

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        if output_of(name, self.raw) in self.raw:
            return True
        if name == "F_rim" and self.wheel_radius is None:
            return False
        return name in _RECIPES and all(source in self for source in SOURCES[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.raw)

    def __len__(self) -> int:
        return len(self.raw)

    @cached_property
    def fuel_flow(self) -> dict[str, np.ndarray]:
        """Fuel flow by engine. [kg s-1]"""
        return {name: values for name, values in self.raw.items() if _FLOW.match(name)}


def signals_of(case: PomCase, raw: Raw, time: np.ndarray) -> Signals:
    """Return the signals of one run of a case; those of the same samples as they are, with what was formed of them."""
    if isinstance(raw, Signals) and raw.time is time and raw.wheel_radius == case.conditions.get("wheel_radius"):
        return raw
    return Signals(raw, time, case.conditions.get("wheel_radius"))


def traces_of(signals: xr.Dataset, run: str) -> dict[str, np.ndarray]:
    """Return the channels of one run of a result that hold a number anywhere. [SI]"""
    place = signals.variables["run"].values.tolist().index(run)
    traces = {str(name): signals.variables[name].values[place] for name in signals.data_vars}
    return {name: values for name, values in traces.items() if np.isfinite(values).any()}


def trace_of(signals: xr.Dataset, run: str, name: str) -> np.ndarray:
    """Return a channel of one run of a result (time,); ``sel`` takes longer than most measures. [SI]"""
    return signals.variables[name].values[signals.variables["run"].values.tolist().index(run)]


def _integral(rate: np.ndarray, time: np.ndarray) -> np.ndarray:
    from scipy.integrate import cumulative_trapezoid  # takes as long to load as all else that judges

    return cumulative_trapezoid(rate, time, initial=0.0)


def _deviation(s: Signals) -> np.ndarray:
    """Return the distance to the right of the line along which the run started. [m]"""
    vn, ve = s["vn"], s["ve"]
    early = s.time <= s.time[0] + 1.0
    along_n, along_e = float(vn[early].mean()), float(ve[early].mean())
    size = np.hypot(along_n, along_e) or 1.0
    return _integral((ve * along_n - vn * along_e) / size, s.time)


_RECIPES: dict[str, Callable[[Signals], np.ndarray]] = {
    "time": lambda s: s.time,
    "V_ground": lambda s: np.hypot(s["vn"], s["ve"]),
    "distance": lambda s: _integral(s["V_ground"], s.time),
    "y_runway": _deviation,
    "psi_dot": lambda s: (s["q"] * np.sin(s["phi"]) + s["r"] * np.cos(s["phi"])) / np.cos(s["theta"]),
    "fuel_used": lambda s: _integral(np.sum(list(s.fuel_flow.values()), axis=0), s.time),
    "F_rim": lambda s: s["F_wheel"] / s.wheel_radius,
}
