"""Output error in time for linear models.

    x' = A x + B u + b,  x(0) = x_0,  y = C x + D u + z_0

is solved exactly for inputs that are linear between samples; the sampled response is compared with the measured outputs, whose noise
variances are those that make the residuals most likely.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from .likelihood_search import Likelihood, search
from .models.kalman_filter import Predictor, innovation_slopes, innovations, predictor, steady_filter
from .models.state_space import LinearModel, demand_known, picked, signals
from .models.turbulence_test import warned
from .parameters import Wanted, lay_out
from .residual_covariance import coloured_covariance, effect_on_motion
from .result import OutputError, noise_of, tabulated
from .time_domain import noise_groups, uniform_step

_FEWEST = 9  # readings of an output
_BEYOND = 1e100  # an unstable model has no response from there on


def linear_output_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    noise: str = "common",
    iterations: int = 50,
) -> OutputError:
    """Estimate parameters of a linear model by maximum likelihood, from whole responses in time.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``; NaN in an output is no reading. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``init.alpha``, a state at the first sample, zero unless given; ``drift.alpha``, a constant in its
        rate; ``sensor.alpha``, a constant added to an output. [SI]
    noise : {"common", "own"}
        One noise variance per output, or one per output and manoeuvre.
    iterations : int
        At most so many.

    Returns
    -------
    OutputError
        ``residuals`` are NaN where there is no reading.

    Raises
    ------
    UnknownName
        A parameter the model does not have, a signal the record does not hold.
    SchemaError
        Inputs that are not finite, time that is not uniform, unknowns outside their bounds.
    IdentificationError
        Fewer than nine readings of an output, a start whose response grows beyond all numbers, no output responds to a parameter, or
        the records cannot distinguish a combination.

    Warns
    -----
    AeromatchWarning
        The residuals carry a disturbance far above the noise of the instruments, as turbulence leaves it: see `filter_error`.

    Notes
    -----
    Cost, search and standard errors are those of `output_error`.  The variance of the noise follows from the residuals and needs neither a
    start nor a search of its own, as it does in `filter_error`.

    References
    ----------
    .. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA RP-1138, 1985.
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 4.
    """
    records = [manoeuvres] if isinstance(manoeuvres, xr.Dataset) else list(manoeuvres)
    extra = {"init": model.states, "drift": model.states, "sensor": model.outputs}
    demand_known(model, list(parameters), [f"{kind}.{name}" for kind, names in extra.items() for name in names])
    groups = noise_groups(noise, len(records))
    layout = lay_out(parameters, [{} for _ in records])
    pieces = [_Response(model, record, names) for record, names in zip(records, layout.bases)]
    found = search(Likelihood(pieces, layout, groups), iterations)
    covariance, colours = coloured_covariance(found, layout.columns, [piece.step for piece in pieces])
    estimates = tabulated(found, layout, covariance, {"method": "output error in time, linear model"})
    measured = [piece.measured for piece in pieces]
    scatter = noise_of(found, list(model.outputs), colours, measured, effect_on_motion(found, layout.columns, covariance, measured))
    rest = tuple(piece.residual(v) for piece, v in zip(pieces, found.residuals))
    return OutputError(estimates, rest, scatter, warned(scatter))


class _Response:
    """One record and its response."""

    def __init__(self, model: LinearModel, record: xr.Dataset, names: Sequence[str]):
        self.model, self.names = model, tuple(names)
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.measured = signals(model, record, gaps=True)
        idle = [name for name, z in zip(model.outputs, self.measured.T) if np.isfinite(z).sum() < _FEWEST]
        if idle:
            raise IdentificationError(f"{', '.join(idle)} has fewer than {_FEWEST} readings; leave it out of the outputs of the model")

    def _run(self, values: np.ndarray) -> Predictor:
        at = dict(zip(self.names, values))
        states, outputs = self.model.states, self.model.outputs
        calm = np.zeros(len(states)), np.zeros(len(outputs))
        made = steady_filter(self.model.at(at), picked(at, "drift", states), *calm, self.step)
        return predictor(made, picked(at, "init", states), picked(at, "sensor", outputs))

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs as the instruments show them."""
        with np.errstate(over="ignore", invalid="ignore"):
            y = -innovations(self._run(values), self.u, np.zeros_like(self.measured))  # innovations are 0 - y
        return np.where(np.abs(y) < _BEYOND, y, np.nan)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return slopes by central differences of the matrices, which cost little here."""
        up, down = ([self._run(values + side * step) for step in np.diag(steps)] for side in (1.0, -1.0))
        with np.errstate(over="ignore", invalid="ignore"):
            S = innovation_slopes(self._run(values), up, down, 2.0 * steps, self.u, np.zeros_like(self.measured))
        return np.moveaxis(-S, 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as a Dataset; NaN where there is no reading."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        return xr.Dataset({name: ("time", v[:, k]) for k, name in enumerate(self.model.outputs)}, {"time": self.time})
