"""Identification of start and shut-down of an engine.

The model is the one of the kernel (docs/explanation/simulation/engine.md).  The starter turns the
core towards its speed.  The engine lights when fuel comes on and accelerates with time constants
over n2 to its schedule.  It runs down towards windmilling when the fuel is off.  Fuel flow and
turbine temperature are tables over n2; the temperature has a lag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.tables import FINE, EngineCurve, refine_knots

# Distance of the knots over n2 between light-off and idle.
SPACING = 0.08
# Mach number above which windmilling is estimated.
WINDY = 0.05
# First values of the time constant over n2 [s] and of the windmilling speed, and the longest time
# constant [s].
_FIRST_TIME, _FIRST_WINDMILL, _SLOWEST = 4.0, 0.05, 60.0
# Margin of the speed of light-off in the search, and its smallest value. Light-off must be possible
# at the lowest recorded speed.
_LIGHT_MARGIN, _LEAST_LIGHT = 0.02, 0.01
_TIMES = ("starter_time", "n2_rundown", "flame_time")


@dataclass(frozen=True)
class StartFit(ShortText):
    """Identified start and shut-down.

    Attributes
    ----------
    tables : dict of str to Curve
        ``n2_up_time`` below idle, and, if recorded, ``fuel_flow`` and ``itt``, over n2.
    constants : dict of str to (value, standard error)
        ``starter_speed``, ``starter_time``, ``n2_rundown``, ``flame_time``, ``idle``, ``itt_time``;
        ``corrected_n2_windmill`` if the records are in flight.
    light_speed : float
        Lowest n2 at which the engine lit. The least speed for light-off lies below it. [1]
    speeds, flows : OutputError
        The fits of n2, and of fuel flow and temperature (None without them).
    """

    tables: dict[str, EngineCurve]
    constants: dict[str, tuple[float, float]]
    light_speed: float
    speeds: OutputError
    flows: OutputError | None

    def joined(self, tables: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Return tables of a deck extended by those below idle.

        A table that only one of them has is not changed.
        """
        joined = dict(tables)
        for name, curve in self.tables.items():
            above = joined.get(name)
            if above is None or above["value"].dims != ("n2",):
                joined[name] = curve.leaf
            else:
                joined[name] = _join_tables(curve.leaf, above)
        if "corrected_n2_windmill" in self.constants:
            value, stderr = self.constants["corrected_n2_windmill"]
            joined["corrected_n2_windmill"] = make_term(value, stderr=stderr, source="flight")
        idle, stderr = self.constants["idle"]
        joined.setdefault("n2_command", make_term(idle, stderr=stderr, source="flight"))
        return joined

    def report(self) -> str:
        """Return constants, tables and residuals as text."""
        lines = [f"lights at n2 {self.light_speed:.3f}: the least speed for it is at most that"]
        for name, (value, stderr) in self.constants.items():
            lines.append(f"{name:<22}{value:>10.4g} ({stderr:.2g})")
        for name, curve in self.tables.items():
            lines += ["", *curve.lines(name, 6)]
        for search in (self.speeds, self.flows):
            if search is not None:
                lines += bench.search_lines(search)
        return "\n".join(lines)


def identify_start(records: Sequence[xr.Dataset]) -> StartFit:
    """Identify start and shut-down by output error on the engine model of the kernel.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        From the engine at rest or windmilling, over start and idle, to the end of the run-down,
        with the lever at idle: ``n2``, ``starter``, ``cutoff`` [1], and ``fuel_flow`` [kg/s],
        ``itt`` [K] if recorded; ``mach``, ``h`` [m], ``temperature`` [K].

    Returns
    -------
    StartFit

    Raises
    ------
    IdentificationError
        No light-off in the records.
    """
    records = [_with_lever(record) for record in records]
    light_offs = [_light_off(record) for record in records]
    light_speeds = [speed for speed in light_offs if speed is not None]
    if not light_speeds:
        raise IdentificationError("no light-off: cutoff never opens with the starter on")
    lowest = min(light_speeds)
    idle = float(np.median(np.concatenate([_idle_samples(record) for record in records])))
    knots = np.linspace(lowest, idle, max(round((idle - lowest) / SPACING), 1) + 1)
    nodes = refine_knots(knots)
    flying = any(_is_flying(record) for record in records)

    unknowns = _speed_unknowns(lowest, idle, knots=knots, flying=flying)
    single = [name for name in unknowns if not name.startswith("ln")]

    def times(theta: np.ndarray) -> np.ndarray:
        # The unknowns behind the single constants are logarithms at the knots.
        return np.exp(scipy.interpolate.PchipInterpolator(knots, theta[len(single) :])(nodes))

    def parameters(theta: np.ndarray) -> dict[str, float]:
        constants = {}
        for name, value in zip(single, theta):
            constants[bench.kernel_parameter(name)] = float(value)
        return constants | bench.as_nodes("n2_up_time", times(theta))

    tables = _first_tables(idle, nodes, flying=flying)
    light = max(lowest - _LIGHT_MARGIN, _LEAST_LIGHT)
    lights: dict[str, Any] = {"light_speed": light, "sustain_speed": 0.5 * light}
    speeds = bench.fit_engine(
        EngineDeck(tables, **lights),
        records,
        unknowns=unknowns,
        expand=parameters,
        outputs=["n2"],
    )
    theta, C = bench.theta_and_covariance(speeds)
    sigma = np.sqrt(np.diag(C))
    constants = {name: (float(theta[k]), float(sigma[k])) for k, name in enumerate(single)}
    curve = EngineCurve.of({"n2": nodes}, times, theta=theta, C=C)

    # Fuel flow and temperature are fitted with the speeds of the first fit.
    tables["n2_up_time"] = curve.leaf
    tables["n2_command"] = make_term(constants["n2_command"][0])
    if flying:
        tables["corrected_n2_windmill"] = make_term(constants["corrected_n2_windmill"][0])
    constants["idle"] = constants.pop("n2_command")
    lights |= {name: constants[name][0] for name in ("starter_speed", *_TIMES)}
    flows, flow_curves, lag = _fit_flows(EngineDeck(tables, **lights), records, knots)
    return StartFit(
        {"n2_up_time": curve} | flow_curves,
        constants | lag,
        light_speed=lowest,
        speeds=speeds,
        flows=flows,
    )


def _first_tables(idle: float, nodes: np.ndarray, flying: bool) -> dict[str, xr.Dataset]:
    """Return the tables of a deck from which the search of the speeds starts."""
    tables = {
        "n2_command": make_term(idle),
        "n2_up_time": make_term(np.full(len(nodes), _FIRST_TIME), {"n2": nodes}),
        "thrust": make_term(0.0),
    }
    if flying:
        tables["corrected_n2_windmill"] = make_term(_FIRST_WINDMILL)
    return tables


def _with_lever(record: xr.Dataset) -> xr.Dataset:
    """Return the record with the lever at idle if it has no lever."""
    if "throttle" in record:
        return record
    return record.assign(throttle=0.0 * record["n2"])


def _is_flying(record: xr.Dataset) -> bool:
    return "mach" in record and float(record["mach"].max()) > WINDY


def _speed_unknowns(
    lowest: float, idle: float, knots: np.ndarray, flying: bool
) -> dict[str, Unknown]:
    """Return the unknowns of the speed: single constants, then ln of the time constant at knots."""
    unknowns = {"starter_speed": Unknown(lowest, 0.2, 0.0, 1.0)}
    for name, first in zip(_TIMES, (3.0, 6.0, 0.3)):
        unknowns[name] = Unknown(first, 10.0 * first, bench.STEP, _SLOWEST)
    unknowns["n2_command"] = Unknown(idle, 0.1, 0.0, 1.2)
    if flying:
        unknowns["corrected_n2_windmill"] = Unknown(_FIRST_WINDMILL, 0.3, 0.0, 1.0)
    for x in knots:
        unknowns[f"ln n2_up_time at n2 {x:.4g}"] = Unknown(
            np.log(_FIRST_TIME), 2.0, np.log(bench.STEP), np.log(_SLOWEST)
        )
    return unknowns


def _join_tables(low: xr.Dataset, high: xr.Dataset) -> xr.Dataset:
    """Return two tables over n2 as one.

    Where they overlap, the upper table is used. It comes from the power changes.
    """
    part = low.sel(n2=low["n2"] < float(high["n2"][0]) - 0.5 * FINE)
    names = [name for name in ("value", "stderr") if name in low and name in high]
    joined = xr.concat([part[names], high[names]], "n2")
    stderr = joined["stderr"].values if "stderr" in joined else None
    return make_term(
        joined["value"].values, {"n2": joined["n2"].values}, stderr=stderr, source="flight"
    )


def _fit_flows(deck: EngineDeck, records: Sequence[xr.Dataset], knots: np.ndarray):
    """Return fit, tables over n2 and lag of fuel flow and turbine temperature.

    The speeds are those of the deck.
    """
    in_all = set.intersection(*(set(map(str, record.variables)) for record in records))
    outputs = [name for name in ("fuel_flow", "itt") if name in in_all]
    if not outputs:
        return None, {}, {}
    at_nodes, count = refine_knots(knots), len(knots)
    unknowns: dict[str, Unknown] = {}
    tables: dict[str, xr.Dataset] = {}
    for name in outputs:
        first = _levels(records, name, knots)
        size = float(np.max(np.abs(first)))
        for x, v in zip(knots, first):
            unknowns[f"{name} at n2 {x:.4g}"] = Unknown(v, size)
        tables[name] = make_term(np.interp(at_nodes, knots, first), {"n2": at_nodes})
    lagged = "itt" in outputs
    if lagged:
        unknowns["itt_time"] = Unknown(0.5, 5.0, bench.STEP, 30.0)

    def curve(k: int) -> Callable[[np.ndarray], np.ndarray]:
        # The unknowns of output k, its values at the knots, as values at the nodes.
        unknowns_of_output = slice(k * count, (k + 1) * count)
        return lambda theta: scipy.interpolate.PchipInterpolator(knots, theta[unknowns_of_output])(
            at_nodes
        )

    def parameters(theta: np.ndarray) -> dict[str, float]:
        nodes: dict[str, float] = {}
        for k, name in enumerate(outputs):
            nodes |= bench.as_nodes(name, curve(k)(theta))
        if lagged:
            nodes[bench.kernel_parameter("itt_time")] = float(theta[-1])
        return nodes

    constants: dict[str, Any] = {
        name: getattr(deck, name)
        for name in ("starter_speed", *_TIMES, "light_speed", "sustain_speed")
    }
    fit = bench.fit_engine(
        EngineDeck({**deck.tables, **tables}, **constants),
        records,
        unknowns=unknowns,
        expand=parameters,
        outputs=outputs,
    )
    theta, C = bench.theta_and_covariance(fit)
    curves = {}
    for k, name in enumerate(outputs):
        curves[name] = EngineCurve.of({"n2": at_nodes}, curve(k), theta=theta, C=C)
    lag = {}
    if lagged:
        lag["itt_time"] = float(theta[-1]), float(np.sqrt(C[-1, -1]))
    return fit, curves, lag


def _light_off(record: xr.Dataset) -> float | None:
    """Return n2 where the fuel comes on with the starter, as mean over half a second before."""
    fuel, time = record["cutoff"].values < 0.5, record["time"].values
    # Samples at which the fuel comes on while the starter turns the engine.
    on = np.flatnonzero(fuel[1:] & ~fuel[:-1] & (record["starter"].values[1:] > 0.5))
    if not len(on):
        return None
    near = (time > time[on[0]] - 0.5) & (time <= time[on[0]])
    return float(record["n2"].values[near].mean())


def _idle_samples(record: xr.Dataset) -> np.ndarray:
    """Return n2 in the last second before the fuel goes off, or of the record."""
    fuel, time = record["cutoff"].values < 0.5, record["time"].values
    last = time[np.flatnonzero(fuel)[-1]]
    return record["n2"].values[fuel & (time > last - 1.0)]


def _levels(records: Sequence[xr.Dataset], name: str, knots: np.ndarray) -> np.ndarray:
    """Return medians of an output about each knot with the fuel on, as first values."""
    burning = [record.isel(time=record["cutoff"].values < 0.5) for record in records]
    n2 = np.concatenate([record["n2"].values for record in burning])
    y = np.concatenate([record[name].values for record in burning])
    levels = []
    for x in knots:
        near = np.abs(n2 - x) < 0.5 * SPACING
        levels.append(float(np.median(y[near] if near.any() else y)))
    return np.array(levels)
