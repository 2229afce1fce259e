"""Output error in time with the compiled simulation."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.simulation.batch import fly_batch
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.run import read_inputs
from flighttest.maximum_likelihood.constrained_unknowns import constrain_unknowns
from flighttest.maximum_likelihood.flown_runs import Runs
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Wanted, lay_out
from flighttest.regression.equation_error.samples import list_manoeuvres

_STARTS = ("V", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "h", "lat", "lon")
_THRUST = re.compile(r"engine\d+\.thrust")
_FEWEST = 9  # readings of an output, and samples of a record
_UNIFORM = 1e-3  # largest spread of the sampling intervals, of their mean
_INSTRUMENTS = ("sensor", "factor")  # kinds of parameters of the instruments
_THRUST_DRIVES = 2.0  # mode.engine in which recorded thrust drives the engines


def output_error(
    sim: SimModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    outputs: Sequence[str],
    conditions: Mapping[str, float] | Sequence[Mapping[str, float]] = (),
    noise: str = "common",
    step: float | None = None,
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a compiled model by maximum likelihood, from full responses.

    The model is simulated with the recorded inputs. The estimates are the parameters for which the
    recorded outputs are most probable. All differences of a manoeuvre are simulated as one batch,
    on all processors.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs at the c.g. on a uniform ``time``; NaN in an output is a missing
        reading. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Estimated parameters: start, standard error of the prior, bounds, and whether every
        manoeuvre has a separate value. Any parameter of the model by name, ``term.CL.basic``,
        ``node.Cm.basic[3]``, ``table.*``, ``offset.*``, ``mass.*``, ``bias.*``, ``init.*`` and
        constants of submodels. Also ``sensor.alpha``, a constant added to the output, and
        ``factor.alpha``, a factor of the output. [SI]
    outputs : sequence of str
        Measured outputs of the model, weighted by the noise that is estimated with the parameters.
    conditions : mapping of str to float or sequence of mappings
        Fixed values: for all manoeuvres, or one mapping for each. Other conditions start at the
        first sample of a manoeuvre (``V alpha beta phi theta psi p q r h lat lon``), with its
        ``mass``, ``x_cg_b`` ... Recorded thrust drives engines whose lever is not in the record.
        [SI]
    noise : {"common", "own"}
        One noise variance per output, or one per output and manoeuvre.
    step : float, optional
        Largest internal step of the simulation; default the sampling interval of the manoeuvre.
        [s]
    iterations : int
        Largest number of iterations.
    constraints : sequence of str
        Linear constraints among the parameters, as ``M_q = 0.5*M_alpha`` or ``M_q < 0``; see
        `parse_constraints`. [SI]

    Returns
    -------
    OutputError

    Raises
    ------
    SchemaError
        Unknowns without a start or outside their bounds, a record whose time is not uniform, or a
        wrong number of conditions.
    UnknownName
        A parameter or output that the model or the record does not have.
    IdentificationError
        The start cannot be simulated, no output responds to a parameter, or the records cannot
        distinguish a combination.

    Warns
    -----
    AeromatchWarning
        The residuals contain a disturbance far above the noise of the instruments, as turbulence
        causes it: see `filter_error`.

    Notes
    -----
    J = sum_j N_j/2 ln mean(v_j^2) + 1/2 (theta - theta_0)' P^-1 (theta - theta_0), [Jategaonkar]_
    ch. 4 and [Maine1985]_, by Levenberg-Marquardt steps inside the bounds. Standard errors are
    those of coloured residuals. The Cramer-Rao bound is ``stderr_white``.

    References
    ----------
    .. [Maine1985] Maine, Iliff, NASA RP-1138, 1985; RP-1168, 1986.
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015.
    """
    records = list_manoeuvres(manoeuvres)
    fixed = list_conditions(conditions, len(records))
    groups = noise_groups(noise, len(records))
    pieces = []
    for record, values in zip(records, fixed):
        pieces.append(SimulatedRecord(sim, record, fixed=values, outputs=list(outputs), step=step))
    layout = lay_out(parameters, [piece.starts for piece in pieces])
    # The starts of the records complete the unknowns, whose names then reach the records.
    for piece, names in zip(pieces, layout.bases):
        piece.set_unknowns(names)
    constrained = constrain_unknowns(layout, constraints)
    free = constrained.layout
    likelihood = Likelihood(constrained.wrap(pieces), free, groups)
    maximum = maximise_likelihood(likelihood, iterations)
    intervals = [piece.interval for piece in pieces]
    covariance, colours = coloured_likelihood_covariance(maximum, free.columns, intervals)
    measured = [piece.measured for piece in pieces]
    effect = effect_on_motion(maximum, free.columns, covariance=covariance, measured=measured)
    scatter = noise_dataset(
        maximum, list(outputs), colours=colours, measured=measured, effect=effect
    )
    estimates = estimates_dataset(
        maximum,
        free,
        covariance=covariance,
        about={"method": "output error in time", "title": sim.title},
    )
    estimates = constrained.rate(
        constrained.expand(estimates),
        Likelihood(pieces, constrained.full, groups),
        maximum.theta,
        lambda end, full: coloured_likelihood_covariance(end, full.columns, intervals)[0],
    )
    return OutputError(
        estimates=estimates,
        residuals=tuple(piece.residual(v) for piece, v in zip(pieces, maximum.residuals)),
        noise=scatter,
        warnings=warn_of_turbulence(scatter),
    )


def noise_groups(noise: str, count: int) -> np.ndarray:
    """Return the noise group of each manoeuvre, (count,)."""
    if noise not in ("common", "own"):
        raise ValueError(f"noise is {noise!r}; allowed: common, own")
    if noise == "common":
        return np.zeros(count, int)
    return np.arange(count)


def uniform_step(time: np.ndarray, what: str) -> float:
    """Return the sampling interval of a uniform clock. [s]

    Raises
    ------
    SchemaError
        Time that is not uniform, or fewer than nine samples; `what` is the name of the record.
    """
    steps = np.diff(time)
    is_short = len(steps) < _FEWEST - 1
    if is_short or not (steps > 0.0).all() or np.ptp(steps) > _UNIFORM * steps.mean():
        text = (
            f"its time is not uniform, or it has fewer than {_FEWEST} samples; cut it with "
            f"flighttest.cut"
        )
        raise SchemaError(what, [text])
    return float(steps.mean())


def list_conditions(
    conditions: Mapping[str, float] | Sequence[Mapping[str, float]], count: int
) -> list[dict[str, float]]:
    """Return the conditions of each manoeuvre."""
    if isinstance(conditions, Mapping):
        return [dict(conditions)] * count
    if not len(conditions):
        return [{}] * count
    if len(conditions) != count:
        text = (
            f"{len(conditions)} mappings for {count} manoeuvres; give one for each, or one for all"
        )
        raise SchemaError("conditions", [text])
    return [dict(item) for item in conditions]


class SimulatedRecord:
    """One manoeuvre and its simulation."""

    def __init__(
        self,
        sim: SimModel,
        record: xr.Dataset,
        fixed: dict[str, float],
        outputs: list[str],
        step: float | None,
    ):
        label = f"manoeuvre {record.attrs.get('record', '')}".strip()
        _demand_outputs(sim, record, outputs=outputs, label=label)
        self.sim, self.record, self.output_names = sim, record, outputs
        self.time = record["time"].values.astype(float)
        self.interval = uniform_step(self.time, label)
        self.step = self.interval if step is None else step
        self.measured = np.column_stack([record[name].values.astype(float) for name in outputs])
        # An output with few readings does not determine its noise.
        readings = np.isfinite(self.measured).sum(axis=0)
        idle = [name for name, count in zip(outputs, readings) if count < _FEWEST]
        if idle:
            raise IdentificationError(
                f"{label}: {', '.join(idle)} has fewer than {_FEWEST} readings; leave it out of "
                f"the outputs"
            )
        self.starts = _recorded_starts(sim, record)
        self.inputs, drive = _select_inputs(sim, record)
        # Given conditions have priority over recorded starts.
        self.conditions = {**self.starts, **drive, **fixed}
        self.runs = Runs(self._simulate)

    def set_unknowns(self, names: Sequence[str]) -> None:
        """Set the estimated parameters, and read the inputs that no run changes."""
        # Parameters of instruments need no simulation: position of the unknown, kind and output.
        self.instruments: dict[int, tuple[str, str]] = {}
        self.simulated: list[int] = []
        for k, name in enumerate(names):
            kind, _, output = name.partition(".")
            if kind not in _INSTRUMENTS:
                self.simulated.append(k)
                continue
            if output not in self.output_names:
                allowed = [f"{kind}.{allowed_output}" for allowed_output in self.output_names]
                raise UnknownName(name, allowed, "parameter")
            self.instruments[k] = kind, output
        self.varied = [names[k] for k in self.simulated]
        self.fixed = {"mode.step": self.step}
        for name, value in self.conditions.items():
            if name not in self.varied:
                self.fixed[name] = value
        self.u = read_inputs(self.sim, self.inputs, self.fixed, len(self.time))

    def _simulate(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the outputs (run, time, output) without instruments, and which runs succeeded."""
        y, done, _ = fly_batch(
            self.sim,
            self.time,
            self.u,
            varied=self.varied,
            values=rows,
            constant=self.fixed,
            outputs=self.output_names,
        )
        return y, done == len(self.time)

    def _output_factors(self, values: np.ndarray) -> np.ndarray:
        """Return the factors of the instruments, (output,)."""
        factors = np.ones(len(self.output_names))
        for k, (kind, output) in self.instruments.items():
            if kind == "factor":
                factors[self.output_names.index(output)] *= values[k]
        return factors

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs with the errors of the instruments."""
        # Instruments multiply the output first and add their constant then.
        z = self.runs.outputs(values[self.simulated]) * self._output_factors(values)
        for k, (kind, output) in self.instruments.items():
            if kind == "sensor":
                z[:, self.output_names.index(output)] += values[k]
        return z

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Simulate slopes with the next prediction."""
        self.runs.expect(steps[self.simulated], central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return differences, (time, output, unknown); one-sided for a step that fails."""
        D = self.runs.slopes(values[self.simulated], steps[self.simulated], central)
        if not self.instruments:
            return np.moveaxis(D, 0, 2)
        # The derivatives by parameters of the instruments are exact.
        y = self.runs.outputs(values[self.simulated])
        S = np.zeros((len(values), *y.shape))
        S[self.simulated] = D * self._output_factors(values)
        for k, (kind, output) in self.instruments.items():
            column = self.output_names.index(output)
            S[k, :, column] = 1.0 if kind == "sensor" else y[:, column]
        return np.moveaxis(S, 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as a Dataset; NaN for a missing reading."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        columns = {}
        for k, name in enumerate(self.output_names):
            attributes = {"units": str(self.record[name].attrs.get("units", ""))}
            columns[name] = "time", v[:, k], attributes
        return xr.Dataset(columns, {"time": self.time}, dict(self.record.attrs))


def _demand_outputs(sim: SimModel, record: xr.Dataset, outputs: Sequence[str], label: str) -> None:
    """Raise for an output that the model or the record does not have."""
    for name in outputs:
        if name not in sim.outputs:
            raise UnknownName(name, sim.outputs, "output")
        if name not in record:
            raise UnknownName(
                name, map(str, record.data_vars), "measured output", f"{label} does not hold it"
            )


def _recorded_starts(sim: SimModel, record: xr.Dataset) -> dict[str, float]:
    """Return the start values and masses of the record, from its first sample."""
    # The first sample has the state, and the mass if the record has it.
    starts = {}
    parameters = [f"init.{name}" for name in _STARTS]
    parameters += [name for name in sim.parameters if name.startswith("mass.")]
    for parameter in parameters:
        name = parameter.partition(".")[2]
        if name in record and parameter in sim.parameters:
            first = float(np.ravel(record[name].values)[0])
            if np.isfinite(first):
                starts[parameter] = first
    return starts


def _select_inputs(sim: SimModel, record: xr.Dataset) -> tuple[xr.Dataset, dict[str, float]]:
    """Return the inputs of the model, and the engine mode if recorded thrust drives them."""
    inputs = record[[str(name) for name in record.data_vars if name in sim.inputs]]
    # A recorded lever has priority over recorded thrust.
    has_levers = any(str(name).startswith("engine") for name in inputs.data_vars)
    drives = {}
    for name in map(str, record.data_vars):
        if _THRUST.fullmatch(name) and f"{name}_drive" in sim.inputs:
            drives[f"{name}_drive"] = record[name]
    if has_levers or not drives:
        return inputs, {}
    return inputs.assign(drives), {"mode.engine": _THRUST_DRIVES}
