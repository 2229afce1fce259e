"""Simulation of one engine on the kernel, and output error on it.

One engine is in an aeroplane too heavy to move.  Spools, delay and flame are those of every
simulation, so the identified model is the simulated model.  A second engine carries the weight. The
aeroplane climbs at a constant rate, and a wind along its path produces the recorded Mach number.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft.propulsion.engine_deck import CONSTANTS, EngineDeck
from flightmech.errors import IdentificationError
from flightmech.simulation.batch import fly_batch
from flightmech.simulation.kernel import STATE
from flightmech.simulation.run import constant_inputs, initialise_run, read_inputs
from flightmech.terms import make_term
from flighttest.maximum_likelihood.flown_runs import Runs
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.time_domain import uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.remarks import remark_lines

# Mass [kg] with which thrust changes the speed by less than 0.01 m/s in a minute.
HEAVY = 1e9
INPUTS = (
    "throttle",
    "cutoff",
    "starter",
    "ignition",
    "flameout",
    "prop_command",
    "mixture",
    "feather",
)
# Largest number of iterations of a search.
ITERATIONS = 60
# Internal step of the simulation, equal to the shortest time constant. [s]
STEP = 0.02
_G = 9.80665
# Airspeed of an aeroplane at rest. [m s-1]
_SLOWEST = 1.0

Expand = Callable[[np.ndarray], Mapping[str, float]]


def compile_engine(deck: EngineDeck) -> flightmech.SimModel:
    """Return the kernel's model of one engine."""
    origin = (0.0, 0.0, 0.0)
    # The second engine thrusts upwards with the weight of the aeroplane.
    carrier = EngineDeck(
        {
            "n2_command": make_term(1.0),
            "n2_up_time": make_term(1.0),
            "thrust": make_term(HEAVY * _G),
        }
    )
    engines = (
        flightmech.aircraft.Engine(origin, deck=deck),
        flightmech.aircraft.Engine(origin, (0.0, 0.0, -1.0), deck=carrier),
    )
    craft = flightmech.Aircraft(
        name="engine",
        S=1.0,
        cbar=1.0,
        b=1.0,
        mass=HEAVY,
        Ixx=HEAVY,
        Iyy=HEAVY,
        Izz=HEAVY,
        engines=engines,
    )
    return flightmech.compile(craft, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


class EngineCondition(NamedTuple):
    """Flight condition of a record: parameters, and the wind that produces its Mach number.

    Attributes
    ----------
    held : dict of str to float
        Parameters of the simulation.
    wind : array (time,)
        From the south, along the path. [m/s]
    """

    held: dict[str, float]
    wind: np.ndarray


def record_condition(record: xr.Dataset) -> EngineCondition:
    """Return the flight condition of a record.

    It consists of the Mach number, the straight line through the height and the mean offset of the
    temperature.

    Parameters
    ----------
    record : Dataset (time,)
        ``mach`` and ``h`` [m], by default at rest at sea level; ``temperature`` [K] of the ambient
        air.
    """
    time = record["time"].values.astype(float)
    mach, height = recorded_or_zero(record, "mach"), recorded_or_zero(record, "h")
    climb, start = 0.0, height[0]
    if np.ptp(height) > 0.0:
        climb, start = np.polyfit(time - time[0], height, 1)
    h = start + climb * (time - time[0])
    offset = 0.0
    if "temperature" in record:
        standard = np.asarray(atmosphere(h).temperature)
        offset = float(np.mean(record["temperature"].values - standard))
    # The path angle, asin(climb / V), exists only if V exceeds the rate of climb.
    slowest = max(_SLOWEST, 1.01 * abs(climb))
    V = np.maximum(mach * np.asarray(atmosphere(h, delta_T=offset).a_sound), slowest)
    along = np.sqrt(V**2 - climb**2)
    parameters = {
        "mode.earth": 0.0,
        "mode.engine": 0.0,
        "env.delta_T": offset,
        "init.V": V[0],
        "init.h": start,
        "init.alpha": -float(np.arcsin(climb / V[0])),
    }
    return EngineCondition(parameters, along[0] - along)


def recorded_or_zero(record: xr.Dataset, name: str) -> np.ndarray:
    """Return a channel of a record, zero if the record does not have it."""
    if name in record:
        return record[name].values.astype(float)
    return np.zeros(record.sizes["time"])


def simulation_inputs(record: xr.Dataset, wind: np.ndarray) -> xr.Dataset:
    """Return lever, switches and wind of a record as inputs of the simulation."""
    inputs = xr.Dataset({f"engine1.{name}": record[name] for name in INPUTS if name in record})
    return inputs.assign(wind_n=("time", wind))


def fit_engine(
    deck: EngineDeck | flightmech.SimModel,
    records: Sequence[xr.Dataset],
    unknowns: Mapping[str, Unknown],
    expand: Expand,
    outputs: Sequence[str],
    step: float = STEP,
    iterations: int = ITERATIONS,
    coarse: Sequence[str] = (),
) -> OutputError:
    """Return unknowns of a deck by output error on the kernel.

    Parameters
    ----------
    deck : Deck or SimModel
        Values that are not estimated, and breakpoints of the tables that are estimated; or a
        compiled model whose first engine is that of the records.
    records : sequence of Dataset (time,)
        As for `record_condition`, with the ``throttle``, any switches and the measured outputs.
    unknowns : mapping of str to Unknown
        Unknowns with first value, a-priori standard error and bounds.
    expand : callable
        Parameters of the engine, by the names of `kernel_parameter`, from the unknowns (unknown,).
    outputs : sequence of str
        ``n1``, ``n2``, ``itt`` ...
    step : float
        Largest internal step of the simulation. [s]
    iterations : int
        Largest number of iterations of the search.
    coarse : sequence of str
        Unknowns whose differences are taken over at least one internal step. A delay before a rate
        limit moves the response by whole stages of the integration.
    """
    sim = compile_engine(deck) if isinstance(deck, EngineDeck) else deck
    parameters = _CachedParameters(expand)
    smallest_steps = np.array([step if name in coarse else 0.0 for name in unknowns])
    runs = [
        _SimulatedEngine(
            sim,
            record,
            expand=parameters,
            outputs=list(outputs),
            step=step,
            smallest_steps=smallest_steps,
        )
        for record in records
    ]
    layout = lay_out(unknowns, [{} for _ in runs])
    maximum = maximise_likelihood(Likelihood(runs, layout, np.zeros(len(runs), int)), iterations)
    covariance, colours = coloured_likelihood_covariance(
        maximum, layout.columns, [run.interval for run in runs]
    )
    estimates = estimates_dataset(
        maximum, layout, covariance, {"method": "output error on the engine of the kernel"}
    )
    names = [f"engine1.{name}" for name in outputs]
    residuals = [run.residual(v) for run, v in zip(runs, maximum.residuals)]
    noise = noise_dataset(maximum, names, colours, [run.measured for run in runs])
    return OutputError(estimates, tuple(residuals), noise)


def search_lines(search: OutputError) -> list[str]:
    """Return the residuals of a search and remarks on its convergence as lines of text."""
    noise = search.noise["stderr"].isel(manoeuvre=0)
    lines = [""]
    for name, value in zip(noise["output"].values, noise.values):
        lines.append(f"{name}: residual rms {float(value):.3g}")
    shown = [remark for remark in search.remarks if remark.kind in ("convergence", "bound")]
    return lines + remark_lines(shown)


def theta_and_covariance(search: OutputError) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates (unknown,) and covariance (unknown, unknown), zero at a bound."""
    estimates = search.estimates
    return estimates["estimate"].values, np.nan_to_num(estimates["covariance"].values)


def kernel_parameter(table: str, node: Sequence[int] = ()) -> str:
    """Return the name of a constant or of a node of a table in the kernel."""
    if table in CONSTANTS:
        return f"engine1.{table}"
    if not node:
        return f"node.engine1.{table}"
    return f"node.engine1.{table}[{','.join(map(str, node))}]"


def as_nodes(table: str, values: np.ndarray) -> dict[str, float]:
    """Return the nodes of a table under their names in the kernel."""
    return {kernel_parameter(table, node): float(value) for node, value in np.ndenumerate(values)}


class _CachedParameters:
    """Parameters of the engine for rows of unknowns.

    All records need the same rows one after the other, so the last result is stored. The records
    are simulated in threads: rows and parameters are replaced together, and under a lock, so that
    no thread reads a result that another one is still filling.
    """

    def __init__(self, expand: Expand):
        self.expand = expand
        self.lock = threading.Lock()
        self.last: tuple[np.ndarray, dict[str, np.ndarray]] = (np.empty(0), {})

    def __call__(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        with self.lock:
            last_rows, parameters = self.last
            if not np.array_equal(rows, last_rows):
                parameters = self._expand_rows(rows)
                self.last = rows.copy(), parameters
            return parameters

    def _expand_rows(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        settings = [self.expand(row) for row in rows]
        columns = {}
        for name in settings[0]:
            columns[name] = np.array([setting[name] for setting in settings])
        return columns


class _SimulatedEngine:
    """One record and its simulation on the kernel."""

    def __init__(
        self,
        sim: flightmech.SimModel,
        record: xr.Dataset,
        expand: _CachedParameters,
        outputs: list[str],
        step: float,
        smallest_steps: np.ndarray,
    ):
        self.sim, self.expand, self.smallest_steps = sim, expand, smallest_steps
        self.outputs = [f"engine1.{name}" for name in outputs]
        self.time = record["time"].values.astype(float)
        self.interval = uniform_step(self.time, f"record {record.attrs.get('record', '')}".strip())
        self.measured = np.column_stack([record[name].values.astype(float) for name in outputs])
        condition, wind = record_condition(record)
        self.fixed = {"mode.step": step, **condition}
        self.u = read_inputs(sim, simulation_inputs(record, wind), self.fixed, len(self.time))
        self.runs = Runs(self._fly)
        self.attrs = dict(record.attrs)

    def _fly(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (run, time, output), and whether each run reached the end."""
        varied = self.expand(rows)
        table = np.column_stack(list(varied.values()))
        y, done, _ = fly_batch(
            self.sim,
            self.time,
            self.u,
            varied=list(varied),
            values=table,
            constant=self.fixed,
            outputs=self.outputs,
        )
        return y, done == len(self.time)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self.runs.outputs(values)

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Simulate the slopes together with the next prediction."""
        self.runs.expect(np.maximum(steps, self.smallest_steps), central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes of the outputs (time, output, unknown).

        Beyond a bound of the kernel there is no run; the difference is then one-sided.
        """
        return np.moveaxis(
            self.runs.slopes(values, np.maximum(steps, self.smallest_steps), central), 0, 2
        )

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return the residuals over time."""
        return xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(self.outputs)},
            {"time": self.time},
            self.attrs,
        )


OUTPUTS = ("n1", "n2", "fuel_flow", "itt", "thrust")
_FIXED = ("vx", "vy", "vz", "q0", "q1", "q2", "q3", "p", "q", "r", "z")


def fly_deck(deck: EngineDeck, record: xr.Dataset) -> xr.Dataset:
    """Return the response of a deck to the lever of a record.

    Unlike in the search, Mach number and height are those of every sample.

    Parameters
    ----------
    deck : Deck
    record : Dataset (time,)
        ``throttle`` [1], ``mach``, ``h`` [m], and ``temperature`` [K] if not standard, as
        `engine_channels` returns them. The engine is in its steady state at the first sample.

    Returns
    -------
    Dataset (time,)
        ``n1``, ``n2`` [1], ``fuel_flow`` [kg/s], ``itt`` [K], ``thrust`` [N].

    Raises
    ------
    IdentificationError
        The record lacks the lever.
    """
    if "throttle" not in record:
        raise IdentificationError(
            f"the record has {' '.join(map(str, record.data_vars))}; the lever, throttle, is needed"
        )
    model = compile_engine(deck)
    condition, _ = record_condition(record)
    time = record["time"].values.astype(float)
    mach, h = recorded_or_zero(record, "mach"), recorded_or_zero(record, "h")
    V = mach * np.asarray(atmosphere(h, delta_T=condition["env.delta_T"]).a_sound)
    inputs = simulation_inputs(record, np.zeros(len(time)))
    levers = []
    for k in range(len(time)):
        values = {str(name): float(inputs[name].values[k]) for name in inputs.data_vars}
        levers.append(constant_inputs(model, values))
    # Indices of the fixed states and of the outputs.
    states = [row.name for row in model.entries(STATE)]
    fixed = [states.index(f"state.{name}") for name in _FIXED]
    columns = [model.outputs.index(f"engine1.{name}") for name in OUTPUTS]
    simulation = initialise_run(
        model,
        condition | {"init.V": max(V[0], 1.0), "init.h": h[0], "init.alpha": 0.0},
        levers[0],
        time[0],
    )
    rows = []
    for k, lever in enumerate(levers):
        # The motion of every sample replaces that of the simulation: V ahead, level, at height h.
        x = simulation.state
        x[fixed] = (V[k], 0.0, 0.0, 1.0, *[0.0] * 6, -h[k])
        simulation.state = x
        rows.append(simulation.outputs()[columns])
        if k + 1 < len(levers):
            simulation.step(time[k], time[k + 1] - time[k], lever, levers[k + 1])
    outputs = {name: ("time", x) for name, x in zip(OUTPUTS, np.array(rows).T)}
    return xr.Dataset(outputs, {"time": time}, dict(record.attrs))
