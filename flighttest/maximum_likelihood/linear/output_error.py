"""Output error in time for linear models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.constrained_unknowns import constrain_unknowns
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.linear.state_space import (
    LinearModel,
    Predictor,
    demand_known,
    filter_innovations,
    innovation_slopes,
    input_output_arrays,
    make_predictor,
    pick_rows,
    stack_models,
    steady_filters,
)
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.time_domain import noise_groups, uniform_step
from flighttest.maximum_likelihood.unknowns import Wanted, lay_out
from flighttest.regression.equation_error.samples import list_manoeuvres

_FEWEST = 9  # readings of an output
_BEYOND = 1e100  # output of an unstable model from which on it has no response


def linear_output_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    noise: str = "common",
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a linear model by maximum likelihood, from full responses in time.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``; NaN in an output is a
        missing reading. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``init.alpha``, a state at the first sample, default zero;
        ``drift.alpha``, a constant in its rate; ``sensor.alpha``, a constant added to an output.
        [SI]
    noise : {"common", "own"}
        One noise variance per output, or one per output and manoeuvre.
    iterations : int
        Largest number of iterations.
    constraints : sequence of str
        Linear constraints among the parameters, as ``M_q = 0.5*M_alpha`` or ``M_q < 0``; see
        `parse_constraints`. [SI]

    Returns
    -------
    OutputError
        ``residuals`` are NaN for a missing reading.

    Raises
    ------
    UnknownName
        A parameter that the model does not have, or a signal that the record does not hold.
    SchemaError
        Inputs that are not finite, time that is not uniform, unknowns outside their bounds.
    IdentificationError
        Fewer than nine readings of an output, a start whose response overflows, a parameter to
        which no output responds, or a combination that the records cannot distinguish.

    Warns
    -----
    AeromatchWarning
        The residuals contain a disturbance far above the noise of the instruments, as turbulence
        causes it: see `filter_error`.

    Notes
    -----
    Cost, search and standard errors are those of `output_error`, [Maine1985]_ and [Jategaonkar]_.
    The variance of the noise follows from the residuals. It needs neither a start nor a separate
    search, which `filter_error` does need.

    References
    ----------
    .. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA
       RP-1138, 1985.
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 4.
    """
    records = list_manoeuvres(manoeuvres)
    extra = {"init": model.states, "drift": model.states, "sensor": model.outputs}
    demand_known(model, list(parameters), extra)
    groups = noise_groups(noise, len(records))
    layout = lay_out(parameters, [{} for _ in records])
    pieces = [_RecordResponse(model, record, names) for record, names in zip(records, layout.bases)]
    # Standard errors are those of coloured residuals, as in `output_error`.
    constrained = constrain_unknowns(layout, constraints)
    free = constrained.layout
    likelihood = Likelihood(constrained.wrap(pieces), free, groups)
    maximum = maximise_likelihood(likelihood, iterations)
    steps = [piece.step for piece in pieces]
    covariance, colours = coloured_likelihood_covariance(maximum, free.columns, steps)
    measured = [piece.measured for piece in pieces]
    effect = effect_on_motion(maximum, free.columns, covariance=covariance, measured=measured)
    scatter = noise_dataset(
        maximum, list(model.outputs), colours=colours, measured=measured, effect=effect
    )
    estimates = estimates_dataset(
        maximum,
        free,
        covariance=covariance,
        about={"method": "output error in time, linear model"},
    )
    estimates = constrained.rate(
        constrained.expand(estimates),
        Likelihood(pieces, constrained.full, groups),
        maximum.theta,
        lambda end, full: coloured_likelihood_covariance(end, full.columns, steps)[0],
    )
    return OutputError(
        estimates=estimates,
        residuals=tuple(piece.residual(v) for piece, v in zip(pieces, maximum.residuals)),
        noise=scatter,
        warnings=warn_of_turbulence(scatter),
    )


class _RecordResponse:
    """One record and the response of the model to its inputs."""

    def __init__(self, model: LinearModel, record: xr.Dataset, names: Sequence[str]):
        self.model, self.names = model, tuple(names)
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.measured = input_output_arrays(model, record, gaps=True)
        readings = np.isfinite(self.measured).sum(axis=0)
        idle = [name for name, count in zip(model.outputs, readings) if count < _FEWEST]
        if idle:
            raise IdentificationError(
                f"{', '.join(idle)} has fewer than {_FEWEST} readings; leave it out of the "
                f"outputs of the model"
            )

    def _make_runs(self, rows: np.ndarray) -> Predictor:
        """Return the model as filters without process noise, which are simulations.

        Parameters
        ----------
        rows : array (run, unknown)
        """
        named = [dict(zip(self.names, values)) for values in rows]
        states, outputs = self.model.states, self.model.outputs
        simulations = steady_filters(
            stack_models(self.model, named),
            drift=pick_rows(named, "drift", states),
            intensity=np.zeros((len(rows), len(states))),
            noise=np.zeros((len(rows), len(outputs))),
            step=self.step,
        )
        offset = pick_rows(named, "sensor", outputs)
        return make_predictor(simulations, pick_rows(named, "init", states), offset)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs with the offsets of the instruments."""
        # For readings of zero, the innovations are 0 - y.
        no_readings = np.zeros_like(self.measured)
        run = Predictor(*(part[0] for part in self._make_runs(values[None])))
        with np.errstate(over="ignore", invalid="ignore"):
            y = -filter_innovations(run, self.u, no_readings)
        return np.where(np.abs(y) < _BEYOND, y, np.nan)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return slopes by central differences of the matrices, which are fast here."""
        count, shifts = len(values), np.diag(steps)
        runs = self._make_runs(values + np.vstack([shifts, -shifts, np.zeros(count)]))
        with np.errstate(over="ignore", invalid="ignore"):
            S = innovation_slopes(
                Predictor(*(part[-1] for part in runs)),
                Predictor(*(part[:count] for part in runs)),
                down=Predictor(*(part[count:-1] for part in runs)),
                width=2.0 * steps,
                u=self.u,
                z=np.zeros_like(self.measured),
            )
        # The innovations of readings of zero are 0 - y, so the slopes of y have the other sign.
        return np.moveaxis(-S, 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as a Dataset; NaN for a missing reading."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        columns = {name: ("time", v[:, k]) for k, name in enumerate(self.model.outputs)}
        return xr.Dataset(columns, {"time": self.time})
