"""Output error in time over the compiled simulation."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.simulation.batch import fly_batch
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.run import read_inputs
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import Likelihood, maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Wanted, lay_out

Fly = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Runs:
    """The runs that a search requires of one manoeuvre.

    The last response is remembered, so that it is not flown again for its slopes.  Slopes that are
    expected are flown in the batch of the response itself: the lanes of the processor are then
    full, and no run flies alone.

    Parameters
    ----------
    fly : callable
        Takes unknowns (run, unknown), returns outputs (run, time, output) and which runs went
        through (run,).
    """

    def __init__(self, fly: Fly):
        self.fly = fly
        self.at = np.empty(0)  # unknowns of the last response
        self.response = np.empty((0, 0))
        self.ahead: tuple[np.ndarray, bool] | None = None  # steps of the slopes that are expected
        self.flown: tuple[np.ndarray, bool, np.ndarray, np.ndarray] | None = (
            None  # steps, sides and runs that were flown with it
        )

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Fly slopes together with the next response; they are required unless that response is
        discarded.
        """
        self.ahead = steps, central

    def outputs(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output), NaN behind the end of a run that failed."""
        ahead, self.ahead = self.ahead, None
        if not np.array_equal(values, self.at):
            rows = np.concatenate([values[None], _moved(values, *ahead)]) if ahead else values[None]
            y, ok = self.fly(rows)
            self.at, self.response = values.copy(), y[0].copy()
            self.flown = (*ahead, y[1:], ok[1:]) if ahead else None
        return self.response

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (unknown, time, output), of both sides when asked or where one side
        cannot be flown.
        """
        base = self.outputs(values)
        flown, self.flown = self.flown, None
        if flown and np.array_equal(flown[0], steps) and flown[1] >= central:
            _, central, y, ok = flown
        else:
            y, ok = self.fly(_moved(values, steps, central))
        if not central and not ok.all():
            return self.slopes(values, steps, central=True)
        return output_slopes(base, y[: len(steps)], y[len(steps) :] if central else None, steps, ok)


def _moved(values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
    moves = np.diag(steps)
    return values + (np.concatenate([moves, -moves]) if central else moves)


def output_slopes(
    base: np.ndarray, up: np.ndarray, down: np.ndarray | None, steps: np.ndarray, flown: np.ndarray
) -> np.ndarray:
    """Return the slopes of outputs (unknown, time, output); one-sided where one side could not be
    flown, zero where neither could.

    Parameters
    ----------
    base : array (time, output)
        Outputs without a step.
    up, down : array (unknown, time, output)
        Outputs after a step of each unknown up and down; `up` is overwritten.  None for one-sided
        differences.
    steps : array (unknown,)
    flown : array of bool (unknown,) or (2 unknowns,)
        Whether the runs up, then those down, went through.
    """
    if down is not None and flown.all():
        up -= down
        up /= 2.0 * steps[:, None, None]
        return up
    good = flown.reshape(-1, len(steps))
    up[~good[0]] = base
    up -= base if down is None else np.where(good[1][:, None, None], down, base)
    width = steps * good.sum(axis=0)
    up /= np.where(width > 0.0, width, np.inf)[:, None, None]
    return up


_STARTS = ("V", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "h", "lat", "lon")
_THRUST = re.compile(r"engine\d+\.thrust")


def output_error(
    sim: SimModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    outputs: Sequence[str],
    conditions: Mapping[str, float] | Sequence[Mapping[str, float]] = (),
    noise: str = "common",
    step: float | None = None,
    iterations: int = 50,
) -> OutputError:
    """Estimate parameters of a compiled model by maximum likelihood, from the responses of whole
    manoeuvres.

    The model is flown under the recorded inputs, and the parameters are solved for under which it
    is most probable that the outputs were recorded.  All differences of a manoeuvre are flown as
    one batch, on all processors.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs at the c.g. on a uniform ``time``; NaN in an output is no
        reading. [SI]
    parameters : mapping of str to Unknown, tuple or float
        What is estimated: start, standard error of the prior, bounds, and whether every manoeuvre
        has its own value.  Any parameter of the model by name, ``term.CL.basic``,
        ``node.Cm.basic[3]``, ``table.*``, ``offset.*``, ``mass.*``, ``bias.*``, ``init.*`` and
        constants of submodels; besides them ``sensor.alpha``, a constant added to the output, and
        ``factor.alpha``, by which it is multiplied. [SI]
    outputs : sequence of str
        Measured outputs of the model, weighted by the noise that is estimated with the parameters.
    conditions : mapping of str to float or sequence of mappings
        What is held: for all manoeuvres, or one mapping for each.  What is not named starts as the
        first sample of a manoeuvre gives (``V alpha beta phi theta psi p q r h lat lon``), with its
        ``mass``, ``x_cg_b`` ... ; recorded thrust drives engines whose lever is not in the record.
        [SI]
    noise : {"common", "own"}
        One noise variance per output, or one per output and manoeuvre.
    step : float, optional
        Largest internal step of the simulation, the sampling interval of the manoeuvre without it.
        [s]
    iterations : int
        At most so many.

    Returns
    -------
    OutputError

    Raises
    ------
    SchemaError
        Unknowns without a start or outside their bounds, a record whose time is not uniform, a
        wrong number of conditions.
    UnknownName
        A parameter or output that the model or the record does not have.
    IdentificationError
        The start cannot be flown, no output responds to a parameter, or the records cannot
        distinguish a combination.

    Warns
    -----
    AeromatchWarning
        The residuals carry a disturbance far above the noise of the instruments, as turbulence
        leaves it: see `filter_error`.

    Notes
    -----
    J = sum_j N_j/2 ln mean(v_j^2) + 1/2 (theta - theta_0)' P^-1 (theta - theta_0), [Jategaonkar] ch. 4, by Levenberg and Marquardt
    inside the bounds.  Standard errors are those of coloured residuals; the Cramer-Rao bound stands next to them.

    References
    ----------
    .. [Maine1985] Maine, Iliff, NASA RP-1138, 1985; RP-1168, 1986.
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015.
    """
    records = [manoeuvres] if isinstance(manoeuvres, xr.Dataset) else list(manoeuvres)
    held = _conditions(conditions, len(records))
    groups = noise_groups(noise, len(records))
    flown = [
        _Flight(sim, record, values, list(outputs), step) for record, values in zip(records, held)
    ]
    layout = lay_out(parameters, [piece.starts for piece in flown])
    for piece, names in zip(flown, layout.bases):
        piece.take(names)
    found = maximise_likelihood(Likelihood(flown, layout, groups), iterations)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [piece.interval for piece in flown]
    )
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "output error in time", "title": sim.title}
    )
    measured = [piece.measured for piece in flown]
    scatter = noise_dataset(
        found,
        list(outputs),
        colours,
        measured,
        effect_on_motion(found, layout.columns, covariance, measured),
    )
    rest = tuple(piece.residual(v) for piece, v in zip(flown, found.residuals))
    return OutputError(estimates, rest, scatter, warn_of_turbulence(scatter))


def noise_groups(noise: str, count: int) -> np.ndarray:
    """Return the noise group of each manoeuvre."""
    if noise not in ("common", "own"):
        raise ValueError(f"noise is {noise!r}; allowed: common, own")
    return np.zeros(count, int) if noise == "common" else np.arange(count)


def uniform_step(time: np.ndarray, what: str) -> float:
    """Return the sampling interval of a uniform clock. [s]"""
    steps = np.diff(time)
    if len(steps) < 8 or not (steps > 0.0).all() or np.ptp(steps) > 1e-3 * steps.mean():
        raise SchemaError(
            what,
            ["its time is not uniform, or it has fewer than 9 samples; cut it with flighttest.cut"],
        )
    return float(steps.mean())


def _conditions(conditions, count: int) -> list[dict[str, float]]:
    if isinstance(conditions, Mapping) or not len(conditions):
        return [dict(conditions)] * count
    if len(conditions) != count:
        raise SchemaError(
            "conditions",
            [
                f"{len(conditions)} mappings for {count} manoeuvres; give one for each, or "
                f"one for all"
            ],
        )
    return [dict(item) for item in conditions]


class _Flight:
    """One manoeuvre as the simulation flies it."""

    def __init__(
        self,
        sim: SimModel,
        record: xr.Dataset,
        held: dict[str, float],
        outputs: list[str],
        step: float | None,
    ):
        what = f"manoeuvre {record.attrs.get('record', '')}".strip()
        for name in outputs:
            if name not in sim.outputs:
                raise UnknownName(name, sim.outputs, "output")
            if name not in record:
                raise UnknownName(
                    name, map(str, record.data_vars), "measured output", f"{what} does not hold it"
                )
        self.sim, self.record, self.outputs = sim, record, outputs
        self.time = record["time"].values.astype(float)
        self.interval = uniform_step(self.time, what)
        self.step = self.interval if step is None else step
        self.measured = np.column_stack([record[name].values.astype(float) for name in outputs])
        idle = [
            name for name, column in zip(outputs, self.measured.T) if np.isfinite(column).sum() < 9
        ]
        if idle:
            raise IdentificationError(
                f"{what}: {', '.join(idle)} has fewer than 9 readings; leave it out of the outputs"
            )
        self.starts = _recorded(sim, record)
        self.inputs, drive = _inputs(sim, record)
        self.held = {**self.starts, **drive, **held}
        self.names: tuple[str, ...] = ()
        self.runs = Runs(self._fly)

    def take(self, names: Sequence[str]) -> None:
        """Learn what is estimated, and read what no run changes; refuse names that mean nothing."""
        self.names = tuple(names)
        self.errors = {
            k: name.split(".", 1)
            for k, name in enumerate(names)
            if name.split(".")[0] in ("sensor", "factor")
        }
        for kind, output in self.errors.values():
            if output not in self.outputs:
                raise UnknownName(
                    f"{kind}.{output}", [f"{kind}.{name}" for name in self.outputs], "parameter"
                )
        self.flown = [k for k in range(len(names)) if k not in self.errors]
        self.varied = [names[k] for k in self.flown]
        self.fixed = {"mode.step": self.step} | {
            name: value for name, value in self.held.items() if name not in self.varied
        }
        self.u = read_inputs(self.sim, self.inputs, self.fixed, len(self.time))

    def _fly(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the outputs (run, time, output) without the errors of the instruments, and which
        runs went through.
        """
        y, done, _ = fly_batch(
            self.sim, self.time, self.u, self.varied, rows, self.fixed, self.outputs
        )
        return y, done == len(self.time)

    def _factors(self, values: np.ndarray) -> np.ndarray:
        """Return by what the instruments multiply each output."""
        found = np.ones(len(self.outputs))
        for k, (kind, output) in self.errors.items():
            if kind == "factor":
                found[self.outputs.index(output)] *= values[k]
        return found

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs as the instruments show them."""
        z = self.runs.outputs(values[self.flown]) * self._factors(values)
        for k, (kind, output) in self.errors.items():
            if kind == "sensor":
                z[:, self.outputs.index(output)] += values[k]
        return z

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Fly slopes with the next prediction."""
        self.runs.expect(steps[self.flown], central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return differences; those of a step that cannot be flown are one-sided, the other way."""
        D = self.runs.slopes(values[self.flown], steps[self.flown], central)
        if not self.errors:
            return np.moveaxis(D, 0, 2)
        y = self.runs.outputs(values[self.flown])
        S = np.zeros((len(values), *y.shape))
        S[self.flown] = D * self._factors(values)
        for k, (kind, output) in self.errors.items():
            at = self.outputs.index(output)
            S[k, :, at] = 1.0 if kind == "sensor" else y[:, at]
        return np.moveaxis(S, 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as a Dataset; NaN where there is no reading."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        units = [{"units": str(self.record[name].attrs.get("units", ""))} for name in self.outputs]
        return xr.Dataset(
            {name: ("time", v[:, k], units[k]) for k, name in enumerate(self.outputs)},
            {"time": self.time},
            dict(self.record.attrs),
        )


def _recorded(sim: SimModel, record: xr.Dataset) -> dict[str, float]:
    """Return what the record gives of start and mass."""
    found = {}
    for prefix, names in (
        ("init", _STARTS),
        ("mass", [name[5:] for name in sim.parameters if name.startswith("mass.")]),
    ):
        for name in names:
            if name in record and f"{prefix}.{name}" in sim.parameters:
                first = float(np.ravel(record[name].values)[0])
                if np.isfinite(first):
                    found[f"{prefix}.{name}"] = first
    return found


def _inputs(sim: SimModel, record: xr.Dataset) -> tuple[xr.Dataset, dict[str, float]]:
    """Return the inputs of the model, and the mode of the engines where recorded thrust drives
    them.
    """
    inputs = record[[str(name) for name in record.data_vars if name in sim.inputs]]
    levers = any(str(name).startswith("engine") for name in inputs.data_vars)
    thrusts = {
        str(name): f"{name}_drive"
        for name in record.data_vars
        if _THRUST.fullmatch(str(name)) and f"{name}_drive" in sim.inputs
    }
    if levers or not thrusts:
        return inputs, {}
    return inputs.assign({drive: record[name] for name, drive in thrusts.items()}), {
        "mode.engine": 2.0
    }
