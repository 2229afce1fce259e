"""Coefficients and regressors of the samples of a stream, as they arrive.

The quantities are those at the centre of gravity, as an air-data and inertial system gives them.
Angles of vanes are moved there (`flighttest.in_flight.vane_angles`).
Angular accelerations that the stream lacks are differences of five samples. They come two samples
late, and at 50 Hz their error at 2 Hz is 0.01 %.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import COEFFICIENTS, REDUCED_RATES
from flighttest.in_flight.vane_angles import VaneAngles
from flighttest.reconstruction.dynamics.force_coefficients import sample_coefficients
from flighttest.regression.equation_error.model import RegressionModel

_NEEDED = ("V", "qbar", "alpha", "p", "q", "r", "ax", "ay", "az")
_OPTIONAL = ("beta", "mass", "x_cg_b", "y_cg_b", "z_cg_b")
# what rates of incidence follow from when the stream does not give them
_INCIDENCE = ("alpha_dot", "beta_dot", "beta", "phi", "theta")
_MEASURED = (*COEFFICIENTS, "CX", "CZ")
_RATES = {"p_dot": "p", "q_dot": "q", "r_dot": "r"}
_ADVICE = "give a stream of quantities at the centre of gravity that has it, by its name map"
_REACH = 2  # samples on each side of a difference


class CoefficientSamples:
    """Converts samples of a stream to the target and the terms of a model.

    Parameters
    ----------
    model : RegressionModel
        With all terms that are needed.
    aircraft : Aircraft or None
        Without it the stream must give the target and all variables.
    """

    def __init__(self, model: RegressionModel, aircraft: Aircraft | None):
        self.model, self.aircraft = model, aircraft
        self.channels: list[str] = []
        self._vanes: VaneAngles | None = None
        self._times = np.zeros(0)
        self._rows = np.zeros((0, 0))

    def choose_channels(self, available: Sequence[str]) -> list[str]:
        """Return the channels that are read, of those that a stream has.

        Raises
        ------
        UnknownName
            A channel that the model needs and the stream does not have.
        """
        wanted = dict.fromkeys((self.model.coefficient, *self.model.variables))
        derived: set[str] = set()
        if self.aircraft is not None:
            derived = {"CT", "nz", "dnz", *REDUCED_RATES, *_MEASURED}
            engines = [f"engine{k}.thrust" for k in range(1, len(self.aircraft.engines) + 1)]
            wanted |= dict.fromkeys((*_NEEDED, *engines))
            wanted |= dict.fromkeys(name for name in (*_OPTIONAL, *_RATES) if name in available)
            wanted |= dict.fromkeys(name for name in available if name.startswith("wow_"))
            if any("dot" in name for name in self.model.variables):
                wanted |= dict.fromkeys(name for name in _INCIDENCE if name in available)
            # a vane stands for an angle that the stream does not give at the centre of gravity
            self._vanes = VaneAngles.of(self.aircraft, available)
            for angle in self._vanes.angles:
                wanted.pop(angle, None)
                wanted |= dict.fromkeys([f"{angle}_vane"])
                derived.add(angle)
        names = [name for name in wanted if name in available or name not in derived]
        for name in names:
            if name not in available:
                advice = _ADVICE
                if self.aircraft is None:
                    advice = f"give --aircraft, or {advice}"
                raise UnknownName(name, available, "channel of the stream", advice)
        self.channels = names
        return names

    @property
    def _is_differenced(self) -> bool:
        if self.aircraft is None:
            return False
        has_lag = self._vanes is not None and self._vanes.has_lag
        return has_lag or not all(name in self.channels for name in _RATES)

    @property
    def delay(self) -> int:
        """Samples that an output of `convert` is behind its input."""
        return _REACH if self._is_differenced else 0

    def begin(self) -> None:
        """Begin a new stretch: no difference reaches across its start."""
        self._times = np.zeros(0)

    def convert(self, times: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return times and target with terms (samples, 1 + terms) of the next samples.

        Parameters
        ----------
        times : array (samples,)
            [s]
        rows : array (samples, channels)
        """
        # The last samples wait for their neighbours, which a central difference needs.
        if self._is_differenced:
            if len(self._times):
                times = np.concatenate([self._times, times])
                rows = np.concatenate([self._rows, rows])
            self._times, self._rows = times[-2 * _REACH :], rows[-2 * _REACH :]
            if len(times) <= 2 * _REACH:
                return np.zeros(0), np.zeros((0, 1 + len(self.model.terms)))
        columns = dict(zip(self.channels, rows.T))
        inner = slice(None)
        if self._is_differenced:
            inner = slice(_REACH, len(times) - _REACH)
            step = (times[-1] - times[0]) / (len(times) - 1)
            # Angular accelerations that the stream does not have follow from the rates.
            for name, rate in _RATES.items():
                if name not in columns:
                    columns[name] = _difference(columns[rate], step)
            if self._vanes is not None:
                columns = self._vanes.without_lag(columns, _difference, step)
        if self._vanes is not None:
            columns = self._vanes.at_cg(columns)
        data = xr.Dataset(
            {name: ("time", values[inner]) for name, values in columns.items()},
            {"time": times[inner]},
        )
        if self.aircraft is not None:
            given = [name for name in columns if name in _MEASURED]
            data = sample_coefficients(data.drop_vars(given), self.aircraft).assign(data[given])
        X = self.model.design(data)
        z = data[self.model.coefficient].values
        return times[inner], np.column_stack([z, X])


def _difference(x: np.ndarray, step: float) -> np.ndarray:
    """Return the derivative by five samples; zero at the two samples of each end."""
    found = np.zeros_like(x)
    # (x_-2 - 8 x_-1 + 8 x_1 - x_2) / 12 h
    found[2:-2] = (x[:-4] - 8.0 * x[1:-3] + 8.0 * x[3:-1] - x[4:]) / (12.0 * step)
    return found
