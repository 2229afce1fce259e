"""Start and shut-down: starter, light-off, acceleration to idle, fuel flow and turbine temperature,
run-down.

The model is the kernel's (docs/explanation/simulation/engine.md): the starter turns the core towards its speed, the engine
lights where fuel comes on, accelerates with time constants over n2 to its schedule, and runs down
towards windmilling when the fuel is off.  Fuel flow and temperature are tables over n2, the
temperature behind a lag.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.engine_deck import EngineDeck
from flightmech.errors import IdentificationError
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.tables import FINE, EngineCurve, refine_knots

SPACING = 0.08  # of the knots over n2 between light-off and idle
WINDY = 0.05  # Mach number from which on windmilling is looked for
_TIMES = ("starter_time", "n2_rundown", "flame_time")


@dataclass(frozen=True)
class StartFit:
    """Identified start and shut-down.

    Attributes
    ----------
    tables : dict of str to Curve
        ``n2_up_time`` below idle, and where recorded ``fuel_flow`` and ``itt``, over n2.
    constants : dict of str to (value, standard error)
        ``starter_speed``, ``starter_time``, ``n2_rundown``, ``flame_time``, ``idle``, ``itt_time``;
        ``corrected_n2_windmill`` where the records fly.
    light_speed : float
        Lowest n2 at which the engine was seen to light: the least speed for it lies below. [1]
    speeds, flows : OutputError
        The searches over n2, and over fuel flow and temperature (None without them).
    """

    tables: dict[str, EngineCurve]
    constants: dict[str, tuple[float, float]]
    light_speed: float
    speeds: OutputError
    flows: OutputError | None

    def joined(self, tables: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Return tables of a deck with those below idle put before them; what only one of them has
        is taken as it is.
        """
        found = dict(tables)
        for name, curve in self.tables.items():
            above = found.get(name)
            found[name] = (
                curve.leaf
                if above is None or above["value"].dims != ("n2",)
                else _before(curve.leaf, above)
            )
        if "corrected_n2_windmill" in self.constants:
            value, stderr = self.constants["corrected_n2_windmill"]
            found["corrected_n2_windmill"] = make_term(value, stderr=stderr, source="flight")
        found.setdefault(
            "n2_command",
            make_term(self.constants["idle"][0], stderr=self.constants["idle"][1], source="flight"),
        )
        return found

    def report(self) -> str:
        """Return constants, tables and residuals as text."""
        lines = [f"lights at n2 {self.light_speed:.3f}: the least speed for it is at most that"]
        lines += [
            f"{name:<22}{value:>10.4g} ({stderr:.2g})"
            for name, (value, stderr) in self.constants.items()
        ]
        for name, curve in self.tables.items():
            lines += ["", *curve.lines(name, 6)]
        for search in (self.speeds, self.flows):
            if search is not None:
                noise = search.noise["stderr"].isel(manoeuvre=0)
                lines += [
                    "",
                    *(
                        f"{name}: residual rms {float(v):.3g}"
                        for name, v in zip(noise["output"].values, noise.values)
                    ),
                ]
                lines += [
                    f"! {remark}"
                    for remark in search.remarks
                    if remark.kind in ("convergence", "bound")
                ]
        return "\n".join(lines)


def identify_start(records: Sequence[xr.Dataset]) -> StartFit:
    """Identify start and shut-down by output error on the engine model of the kernel.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        From the engine at rest or windmilling, over start and idle, to the end of the run-down,
        with the lever at idle: ``n2``, ``starter``, ``cutoff`` [1], and ``fuel_flow`` [kg/s],
        ``itt`` [K] where recorded; ``mach``, ``h`` [m], ``temperature`` [K].

    Returns
    -------
    StartFit

    Raises
    ------
    IdentificationError
        No light-off in the records.
    """
    records = [
        one if "throttle" in one else one.assign(throttle=0.0 * one["n2"]) for one in records
    ]
    lit = [speed for one in records if (speed := _light_off(one)) is not None]
    if not lit:
        raise IdentificationError("no light-off: cutoff never opens with the starter on")
    idle = float(np.median(np.concatenate([_idling(one) for one in records])))
    knots = np.linspace(min(lit), idle, max(round((idle - min(lit)) / SPACING), 1) + 1)
    at = refine_knots(knots)
    flying = any("mach" in one and float(one["mach"].max()) > WINDY for one in records)
    unknowns = {
        "starter_speed": Unknown(min(lit), 0.2, 0.0, 1.0),
        **{
            name: Unknown(first, 10.0 * first, bench.STEP, 60.0)
            for name, first in zip(_TIMES, (3.0, 6.0, 0.3))
        },
        "n2_command": Unknown(idle, 0.1, 0.0, 1.2),
        **({"corrected_n2_windmill": Unknown(0.05, 0.3, 0.0, 1.0)} if flying else {}),
        **{
            f"ln n2_up_time at n2 {x:.4g}": Unknown(
                np.log(4.0), 2.0, np.log(bench.STEP), np.log(60.0)
            )
            for x in knots
        },
    }
    single = [name for name in unknowns if not name.startswith("ln")]

    def times(theta: np.ndarray) -> np.ndarray:
        return np.exp(scipy.interpolate.PchipInterpolator(knots, theta[len(single) :])(at))

    def parameters(theta: np.ndarray) -> dict[str, float]:
        return {
            bench.kernel_parameter(name): float(value) for name, value in zip(single, theta)
        } | bench.as_nodes("n2_up_time", times(theta))

    light = max(min(lit) - 0.02, 0.01)
    tables = {
        "n2_command": make_term(idle),
        "n2_up_time": make_term(np.full(len(at), 4.0), {"n2": at}),
        "thrust": make_term(0.0),
    }
    if flying:
        tables["corrected_n2_windmill"] = make_term(0.05)
    lights: dict[str, Any] = {"light_speed": light, "sustain_speed": 0.5 * light}
    found = bench.fit_engine(EngineDeck(tables, **lights), records, unknowns, parameters, ["n2"])
    theta, C = (
        found.estimates["estimate"].values,
        np.nan_to_num(found.estimates["covariance"].values),
    )
    sigma = np.sqrt(np.diag(C))
    constants = {name: (float(theta[k]), float(sigma[k])) for k, name in enumerate(single)}
    curves = {"n2_up_time": EngineCurve.of({"n2": at}, times, theta, C)}
    whole = {
        **tables,
        "n2_up_time": curves["n2_up_time"].leaf,
        "n2_command": make_term(constants["n2_command"][0]),
    }
    if flying:
        whole["corrected_n2_windmill"] = make_term(constants["corrected_n2_windmill"][0])
    constants["idle"] = constants.pop("n2_command")
    lights |= {name: constants[name][0] for name in ("starter_speed", *_TIMES)}
    deck = EngineDeck(whole, **lights)
    flows, more, lag = _flows(deck, records, knots)
    return StartFit(curves | more, constants | lag, min(lit), found, flows)


def _before(low: xr.Dataset, high: xr.Dataset) -> xr.Dataset:
    """Two tables over n2 as one; where they overlap the upper one holds, which has the power
    changes.
    """
    part = low.sel(n2=low["n2"] < float(high["n2"][0]) - 0.5 * FINE)
    names = [name for name in ("value", "stderr") if name in low and name in high]
    joined = xr.concat([part[names], high[names]], "n2")
    stderr = joined["stderr"].values if "stderr" in joined else None
    return make_term(
        joined["value"].values, {"n2": joined["n2"].values}, stderr=stderr, source="flight"
    )


def _flows(deck: EngineDeck, records: Sequence[xr.Dataset], knots: np.ndarray):
    """Fuel flow and turbine temperature over n2, with the speeds as they were found."""
    outputs = [name for name in ("fuel_flow", "itt") if all(name in one for one in records)]
    if not outputs:
        return None, {}, {}
    at, count = refine_knots(knots), len(knots)
    first = {name: _levels(records, name, knots) for name in outputs}
    size = {name: float(np.max(np.abs(first[name]))) for name in outputs}
    unknowns = {
        f"{name} at n2 {x:.4g}": Unknown(v, size[name])
        for name in outputs
        for x, v in zip(knots, first[name])
    }
    lagged = "itt" in outputs
    if lagged:
        unknowns["itt_time"] = Unknown(0.5, 5.0, bench.STEP, 30.0)

    def curve(k: int):
        return lambda theta: scipy.interpolate.PchipInterpolator(
            knots, theta[k * count : (k + 1) * count]
        )(at)

    def parameters(theta: np.ndarray) -> dict[str, float]:
        nodes = [bench.as_nodes(name, curve(k)(theta)) for k, name in enumerate(outputs)]
        lag = {bench.kernel_parameter("itt_time"): float(theta[-1])} if lagged else {}
        return {key: value for part in nodes for key, value in part.items()} | lag

    own = {name: make_term(np.interp(at, knots, first[name]), {"n2": at}) for name in outputs}
    constants: dict[str, Any] = {
        name: getattr(deck, name)
        for name in ("starter_speed", *_TIMES, "light_speed", "sustain_speed")
    }
    found = bench.fit_engine(
        EngineDeck({**deck.tables, **own}, **constants), records, unknowns, parameters, outputs
    )
    theta, C = (
        found.estimates["estimate"].values,
        np.nan_to_num(found.estimates["covariance"].values),
    )
    curves = {
        name: EngineCurve.of({"n2": at}, curve(k), theta, C) for k, name in enumerate(outputs)
    }
    return (
        found,
        curves,
        {"itt_time": (float(theta[-1]), float(np.sqrt(C[-1, -1])))} if lagged else {},
    )


def _light_off(record: xr.Dataset) -> float | None:
    """n2 where the fuel comes on with the starter, the mean over half a second before."""
    fuel, time = record["cutoff"].values < 0.5, record["time"].values
    on = np.flatnonzero(fuel[1:] & ~fuel[:-1] & (record["starter"].values[1:] > 0.5))
    if not len(on):
        return None
    near = (time > time[on[0]] - 0.5) & (time <= time[on[0]])
    return float(record["n2"].values[near].mean())


def _idling(record: xr.Dataset) -> np.ndarray:
    """n2 in the last second before the fuel goes off, or of the record."""
    fuel, time = record["cutoff"].values < 0.5, record["time"].values
    last = time[np.flatnonzero(fuel)[-1]]
    return record["n2"].values[fuel & (time > last - 1.0)]


def _levels(records: Sequence[xr.Dataset], name: str, knots: np.ndarray) -> np.ndarray:
    """Medians about each knot with the fuel on, first values."""
    on = [one["cutoff"].values < 0.5 for one in records]
    n2, y = (
        np.concatenate([one[key].values[part] for one, part in zip(records, on)])
        for key in ("n2", name)
    )
    near = [np.abs(n2 - x) < 0.5 * SPACING for x in knots]
    return np.array([float(np.median(y[part] if part.any() else y)) for part in near])
