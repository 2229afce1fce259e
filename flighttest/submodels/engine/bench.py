"""The engine model of the kernel on its own, and output error on it.

One engine in an aeroplane too heavy to move: the spools, the delay and the flame are those of every
simulation, so what is identified is what flies.  A second engine carries the weight, the aeroplane
climbs at a constant rate, and a wind along its path makes the recorded Mach number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft.engine_deck import CONSTANTS, EngineDeck
from flightmech.errors import IdentificationError
from flightmech.simulation.batch import fly_batch
from flightmech.simulation.kernel import STATE
from flightmech.simulation.run import constant_inputs, initialise_run, read_inputs
from flightmech.terms import make_term
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import Likelihood, maximise_likelihood
from flighttest.maximum_likelihood.time_domain import Runs, uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out

HEAVY = 1e9  # [kg]: thrust changes the speed by less than 0.01 m/s in a minute
INPUTS = ("throttle", "cutoff", "starter", "ignition", "flameout")
ITERATIONS = 60  # of a search
STEP = 0.02  # internal step, that of the shortest time constant [s]
_G = 9.80665
_SLOWEST = 1.0  # airspeed of an aeroplane at rest [m s-1]

Expand = Callable[[np.ndarray], Mapping[str, float]]


def compile_engine(deck: EngineDeck) -> flightmech.SimModel:
    """Return the kernel's model of one engine."""
    at = (0.0, 0.0, 0.0)
    carrier = EngineDeck(
        {
            "n2_command": make_term(1.0),
            "n2_up_time": make_term(1.0),
            "thrust": make_term(HEAVY * _G),
        }
    )
    engines = (
        flightmech.aircraft.Engine(at, deck=deck),
        flightmech.aircraft.Engine(at, (0.0, 0.0, -1.0), deck=carrier),
    )
    craft = flightmech.Aircraft(
        "engine", 1.0, 1.0, 1.0, HEAVY, HEAVY, HEAVY, HEAVY, engines=engines
    )
    return flightmech.compile(craft, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


class EngineCondition(NamedTuple):
    """Flight condition of a record: parameters, and the wind that makes its Mach number.

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
    """Return the condition of a record: its Mach number, the straight line through its height, the
    mean offset of its temperature.

    Parameters
    ----------
    record : Dataset (time,)
        ``mach`` and ``h`` [m] where it has them, else standing at sea level; ``temperature`` [K] of
        the ambient air.
    """
    time = record["time"].values.astype(float)
    mach, height = (
        record[name].values.astype(float) if name in record else np.zeros(len(time))
        for name in ("mach", "h")
    )
    climb, start = (
        np.polyfit(time - time[0], height, 1) if np.ptp(height) > 0.0 else (0.0, height[0])
    )
    h = start + climb * (time - time[0])
    offset = (
        float(np.mean(record["temperature"].values - np.asarray(atmosphere(h).temperature)))
        if "temperature" in record
        else 0.0
    )
    V = np.maximum(
        mach * np.asarray(atmosphere(h, delta_T=offset).a_sound), max(_SLOWEST, 1.01 * abs(climb))
    )
    along = np.sqrt(V**2 - climb**2)
    fixed = {"mode.earth": 0.0, "mode.engine": 0.0, "env.delta_T": offset}
    return EngineCondition(
        fixed | {"init.V": V[0], "init.h": start, "init.alpha": -float(np.arcsin(climb / V[0]))},
        along[0] - along,
    )


def simulation_inputs(record: xr.Dataset, wind: np.ndarray) -> xr.Dataset:
    """Return lever, switches and wind of a record as inputs of the simulation."""
    found = xr.Dataset({f"engine1.{name}": record[name] for name in INPUTS if name in record})
    return found.assign(wind_n=("time", wind))


def fit_engine(
    deck: EngineDeck,
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
    deck : Deck
        Holds what is not estimated, and the breakpoints of what is.
    records : sequence of Dataset (time,)
        As for `record_condition`, with the ``throttle``, any switches and the measured outputs.
    unknowns : mapping of str to Unknown
    expand : callable
        Parameters of the engine, by the names of `kernel_parameter`, from the unknowns (unknown,).
    outputs : sequence of str
        ``n1``, ``n2``, ``itt`` ...
    step : float
        Largest internal step of the simulation. [s]
    iterations : int
        Of the search, at most.
    coarse : sequence of str
        Unknowns whose differences are taken over an internal step at least: a delay before a rate
        limit moves the response by whole stages of the integration.
    """
    sim = compile_engine(deck)
    remembered = _Remembered(expand)
    least = np.array([step if name in coarse else 0.0 for name in unknowns])
    runs = [
        _SimulatedEngine(sim, record, remembered, list(outputs), step, least) for record in records
    ]
    layout = lay_out(unknowns, [{} for _ in runs])
    found = maximise_likelihood(Likelihood(runs, layout, np.zeros(len(runs), int)), iterations)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [run.interval for run in runs]
    )
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "output error on the engine of the kernel"}
    )
    names = [f"engine1.{name}" for name in outputs]
    rest = tuple(run.residual(v) for run, v in zip(runs, found.residuals))
    return OutputError(
        estimates, rest, noise_dataset(found, names, colours, [run.measured for run in runs])
    )


def kernel_parameter(table: str, node: Sequence[int] = ()) -> str:
    """Return the name of a constant or of a node of a table in the kernel."""
    if table in CONSTANTS:
        return f"engine1.{table}"
    return f"node.engine1.{table}[{','.join(map(str, node))}]" if node else f"node.engine1.{table}"


def as_nodes(table: str, values: np.ndarray) -> dict[str, float]:
    """Return the nodes of a table under their names in the kernel."""
    return {kernel_parameter(table, place): float(value) for place, value in np.ndenumerate(values)}


class _Remembered:
    """Parameters of the engine for rows of unknowns; every record requires the same ones in turn."""

    def __init__(self, expand: Expand):
        self.expand, self.rows = expand, np.empty(0)
        self.found: dict[str, np.ndarray] = {}

    def __call__(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        if not np.array_equal(rows, self.rows):
            settings = [self.expand(row) for row in rows]
            self.rows, self.found = (
                rows.copy(),
                {name: np.array([one[name] for one in settings]) for name in settings[0]},
            )
        return self.found


class _SimulatedEngine:
    """One record as the engine flies it."""

    def __init__(
        self,
        sim: flightmech.SimModel,
        record: xr.Dataset,
        expand: _Remembered,
        outputs: list[str],
        step: float,
        least: np.ndarray,
    ):
        self.sim, self.expand, self.least = sim, expand, least
        self.outputs = [f"engine1.{name}" for name in outputs]
        self.time = record["time"].values.astype(float)
        self.interval = uniform_step(self.time, f"record {record.attrs.get('record', '')}".strip())
        self.measured = np.column_stack([record[name].values.astype(float) for name in outputs])
        held, wind = record_condition(record)
        self.held = {"mode.step": step, **held}
        self.u = read_inputs(sim, simulation_inputs(record, wind), self.held, len(self.time))
        self.runs = Runs(self._fly)
        self.attrs = dict(record.attrs)

    def _fly(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (run, time, output), and which runs went through."""
        varied = self.expand(rows)
        table = np.column_stack(list(varied.values()))
        y, done, _ = fly_batch(
            self.sim, self.time, self.u, list(varied), table, self.held, self.outputs
        )
        return y, done == len(self.time)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self.runs.outputs(values)

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Fly slopes with the next prediction."""
        self.runs.expect(np.maximum(steps, self.least), central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return their slopes (time, output, unknown); beyond a bound of the kernel there is no
        run, and the other side stands alone.
        """
        return np.moveaxis(self.runs.slopes(values, np.maximum(steps, self.least), central), 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals over time."""
        return xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(self.outputs)},
            {"time": self.time},
            self.attrs,
        )


OUTPUTS = ("n1", "n2", "fuel_flow", "itt", "thrust")
_PLACED = ("vx", "vy", "vz", "q0", "q1", "q2", "q3", "p", "q", "r", "z")


def fly_deck(deck: EngineDeck, record: xr.Dataset) -> xr.Dataset:
    """Return what a deck makes of the lever of a record.

    Unlike in the search, Mach number and height are those of every sample.

    Parameters
    ----------
    deck : Deck
    record : Dataset (time,)
        ``throttle`` [1], ``mach``, ``h`` [m], and ``temperature`` [K] if not standard, as
        `engine_channels` returns them; it counts as begun with the engine settled.

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
    held, _ = record_condition(record)
    time = record["time"].values.astype(float)
    mach, h = (
        record[name].values.astype(float) if name in record else np.zeros(len(time))
        for name in ("mach", "h")
    )
    V = mach * np.asarray(atmosphere(h, delta_T=held["env.delta_T"]).a_sound)
    inputs = simulation_inputs(record, np.zeros(len(time)))
    levers = [
        constant_inputs(
            model, {str(name): float(inputs[name].values[k]) for name in inputs.data_vars}
        )
        for k in range(len(time))
    ]
    places = [row.name for row in model.entries(STATE)]
    fixed = [places.index(f"state.{name}") for name in _PLACED]
    columns = [model.outputs.index(f"engine1.{name}") for name in OUTPUTS]
    simulation = initialise_run(
        model,
        held | {"init.V": max(V[0], 1.0), "init.h": h[0], "init.alpha": 0.0},
        levers[0],
        time[0],
    )
    rows = []
    for k, lever in enumerate(levers):
        x = simulation.state
        x[fixed] = (V[k], 0.0, 0.0, 1.0, *[0.0] * 6, -h[k])
        simulation.state = x
        rows.append(simulation.outputs()[columns])
        if k + 1 < len(levers):
            simulation.step(time[k], time[k + 1] - time[k], lever, levers[k + 1])
    found = dict(zip(OUTPUTS, np.array(rows).T))
    return xr.Dataset(
        {name: ("time", values) for name, values in found.items()},
        {"time": time},
        dict(record.attrs),
    )
