"""Governor and spools from power changes: transport delay, steady schedule, time constants over speed, fan behind core.

The model is the kernel's (docs/engine.md): n2 follows its schedule over the delayed lever with a time constant that is a
table over n2; n1 follows a table over n2 with a lag of its own.  The tables are monotone cubics through a few knots,
sampled so finely that straight lines between the nodes do as well.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 20.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from flightmech.aircraft.systems.engine_deck import Deck
from flightmech.terms import make

from ..maximum_likelihood.parameters import Unknown
from ..maximum_likelihood.result import OutputError
from . import bench
from .schedule import first_schedule, first_times, nodes, quiet, reading_error, speeds
from .tables import Curve, fine

QUICKEST, SLOWEST = 0.02, 30.0  # time constants that are searched [s]
LONGEST = 2.0  # transport delay that is searched [s]
SIGNIFICANT = 2.6  # standard errors beyond which the ratio of the time constants depends on speed, 1 %
ROUGH = 0.1  # internal step of the first search [s]
_VAGUE = 2.0  # a-priori standard error of ln tau: keeps what no record shows


@dataclass(frozen=True)
class SpoolFit:
    """Identified governor and spools.

    Attributes
    ----------
    tables : dict of str to Curve
        ``n2_command`` over throttle, ``n2_up_time``, ``n2_down_time`` and ``n1_command`` over n2.
    constants : dict of str to (value, standard error)
        ``lever_delay``, ``n1_up_time`` [s]; ``ratio`` of the time constants for deceleration over those for acceleration, at
        the middle of the speeds, and ``ratio_slope``, the change of its logarithm per unit of n2, as first estimated.
    core, fan : OutputError
        The searches; `fan` is None without n1.
    """

    tables: dict[str, Curve]
    constants: dict[str, tuple[float, float]]
    core: OutputError
    fan: OutputError | None

    def leaves(self) -> dict[str, xr.Dataset]:
        """Return the tables of the deck."""
        found = {name: curve.leaf for name, curve in self.tables.items()}
        if "n1_up_time" in self.constants:
            value, stderr = self.constants["n1_up_time"]
            found["n1_up_time"] = make(value, stderr=stderr, source="flight")
        return found

    def report(self) -> str:
        """Return constants, tables and noise as text."""
        value = self.constants
        slope, ratio = value["ratio_slope"], value["ratio"]
        word = "no change with n2 beyond its error" if abs(slope[0]) <= SIGNIFICANT * slope[1] else "changes with n2"
        lines = [f"transport delay {value['lever_delay'][0]:.4f} s ({value['lever_delay'][1]:.2g})"]
        lines.append(
            f"deceleration over acceleration {ratio[0]:.4f} ({ratio[1]:.2g}); slope of its log {slope[0]:.3g} ({slope[1]:.2g}): {word}"
        )
        if "n1_up_time" in value:
            lines.append(f"lag of n1 behind n2 {value['n1_up_time'][0]:.4f} s ({value['n1_up_time'][1]:.2g})")
        for name, curve in self.tables.items():
            lines += ["", *curve.lines(name)]
        for search in (self.core, self.fan):
            if search is not None:
                noise = search.noise["stderr"].isel(manoeuvre=0)
                lines += ["", *(f"{name}: residual rms {float(v):.3g}" for name, v in zip(noise["output"].values, noise.values))]
                lines += [f"! {remark}" for remark in search.remarks if remark.kind == "convergence"]
        return "\n".join(lines)


def identify_spools(records: Sequence[xr.Dataset], throttle: Sequence[float] | None = None, n2: Sequence[float] | None = None) -> SpoolFit:
    """Identify governor and spools by output error on the engine model of the kernel.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        Power changes that begin at rest, each at one flight condition, on a uniform clock: ``throttle``, ``n2`` and where
        there is one ``n1`` [1]; ``mach``, ``h`` [m], ``temperature`` [K] give the condition.
    throttle, n2 : sequence of float, optional
        Knots of the schedule and of the tables over n2; by default where the lever rested, and every 7 % of speed.

    Returns
    -------
    SpoolFit

    Raises
    ------
    IdentificationError
        The lever never rests, or the speed does not move both ways.

    Notes
    -----
    ``ln tau_down = ln tau_up + ln f + g (n2 - middle)``: where g is within 2.6 standard errors of zero it is set to zero, and the
    other unknowns are moved by their correlation with it.  The noise of the lever readings at rest is added to the
    covariance of the schedule.
    """
    noisy = reading_error(records, lever := np.array(throttle if throttle is not None else nodes(records), float))
    records = [quiet(record) for record in records]
    core = _Core(lever, np.array(n2 if n2 is not None else speeds(records), float))
    rough = core.fit(records, core.start(records), ROUGH)
    found = core.fit(records, rough.estimates["estimate"].values)
    tables, constants = core.result(found, noisy)
    if not all("n1" in record for record in records):
        return SpoolFit(tables, constants, found, None)
    curve, lag, fan = _fan(tables, constants["lever_delay"][0], records, core.speed)
    return SpoolFit(tables | {"n1_command": curve}, constants | {"n1_up_time": lag}, found, fan)


class _Core:
    """Unknowns of the core: delay, schedule at knots, ln tau at knots, ln f, and its slope."""

    def __init__(self, lever: np.ndarray, speed: np.ndarray):
        self.lever, self.speed = lever, speed
        self.at_lever, self.at_speed = fine(lever), fine(speed)
        self.middle = 0.5 * (speed[0] + speed[-1])
        count = 1 + len(lever)
        self.schedule, self.times = slice(1, count), slice(count, count + len(speed))

    def tables(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Nodes of the tables from the unknowns."""
        up = PchipInterpolator(self.speed, theta[self.times])(self.at_speed)
        ratio = theta[-2] + theta[-1] * (self.at_speed - self.middle)
        schedule = PchipInterpolator(self.lever, theta[self.schedule])(self.at_lever)
        return {"n2_command": schedule, "n2_up_time": np.exp(up), "n2_down_time": np.exp(up + ratio)}

    def _table(self, name: str, theta: np.ndarray) -> np.ndarray:
        return self.tables(theta)[name]

    def _parameters(self, theta: np.ndarray) -> dict[str, float]:
        nodes_ = [bench.as_nodes(name, np.clip(v, QUICKEST, None)) for name, v in self.tables(theta).items()]
        return {"engine1.lever_delay": float(theta[0])} | {key: value for part in nodes_ for key, value in part.items()}

    def start(self, records: Sequence[xr.Dataset]) -> np.ndarray:
        """First values."""
        schedule = first_schedule(records, "n2", self.lever)
        up, down = (
            np.log(np.clip(times, 2.0 * QUICKEST, SLOWEST / 2.0)) for times in first_times(records, self.lever, schedule, self.speed)
        )
        return np.array([0.1, *schedule, *up, float(np.mean(down - up)), 0.0])

    def fit(self, records: Sequence[xr.Dataset], start: np.ndarray, step: float = bench.STEP) -> OutputError:
        """The search."""
        axes = {"n2_command": ("throttle", self.at_lever), "n2_up_time": ("n2", self.at_speed), "n2_down_time": ("n2", self.at_speed)}
        tables = {name: make(v, {axes[name][0]: axes[name][1]}, outside="linear") for name, v in self.tables(start).items()}
        tables["n2_up_time"].attrs["outside"] = tables["n2_down_time"].attrs["outside"] = "hold"
        names = [
            "lever_delay",
            *(f"n2_command at throttle {x:.4g}" for x in self.lever),
            *(f"ln n2_up_time at n2 {x:.4g}" for x in self.speed),
        ]
        low, high = np.log(QUICKEST), np.log(SLOWEST)
        unknowns = dict(zip(names, [Unknown(start[0], low=0.0, high=LONGEST), *(Unknown(v, 0.3) for v in start[self.schedule])]))
        unknowns |= {name: Unknown(v, _VAGUE, low, high) for name, v in zip(names[self.times], start[self.times])}
        unknowns["ln ratio"] = Unknown(float(start[-2]), 1.0)
        unknowns["slope of ln ratio"] = Unknown(float(start[-1]), 10.0)
        return bench.fitted(Deck(tables | {"thrust": make(0.0)}), records, unknowns, self._parameters, ["n2"], step)

    def result(self, found: OutputError, noisy: np.ndarray) -> tuple[dict[str, Curve], dict[str, tuple[float, float]]]:
        """Tables and constants of a search; `noisy` (knot,) is the standard error of the lever positions."""
        theta, C = found.estimates["estimate"].values.copy(), np.nan_to_num(found.estimates["covariance"].values)
        slope = float(theta[-1]), float(np.sqrt(C[-1, -1]))
        if abs(slope[0]) <= SIGNIFICANT * slope[1]:
            theta -= C[:, -1] / C[-1, -1] * slope[0]
            C = C - np.outer(C[:, -1], C[-1]) / C[-1, -1]
        steep = PchipInterpolator(self.lever, theta[self.schedule]).derivative()(self.lever)
        places = np.arange(self.schedule.start, self.schedule.stop)
        C[places, places] += (steep * noisy) ** 2
        axes = {"n2_command": ("throttle", self.at_lever), "n2_up_time": ("n2", self.at_speed), "n2_down_time": ("n2", self.at_speed)}
        tables = {name: Curve.of(*axes[name], partial(self._table, name), theta, C) for name in axes}
        ratio, sigma = float(np.exp(theta[-2])), np.sqrt(np.maximum(np.diag(C), 0.0))
        constants = {"lever_delay": (float(theta[0]), float(sigma[0])), "ratio": (ratio, ratio * float(sigma[-2])), "ratio_slope": slope}
        return tables, constants


def _fan(tables: dict[str, Curve], delay: float, records: Sequence[xr.Dataset], knots: np.ndarray):
    """n1 over n2, and its lag, with the core as it was found."""
    start = np.append(first_schedule(records, "n1", knots, over="n2"), 0.2)
    at = fine(knots)

    def curve(theta: np.ndarray) -> np.ndarray:
        return PchipInterpolator(knots, theta[:-1])(at)

    def parameters(theta: np.ndarray) -> dict[str, float]:
        return bench.as_nodes("n1_command", curve(theta)) | {bench.parameter("n1_up_time"): float(theta[-1])}

    leaves = {name: one.leaf for name, one in tables.items()}
    leaves |= {"n1_command": make(curve(start), {"n2": at}, outside="linear"), "n1_up_time": make(0.2), "thrust": make(0.0)}
    unknowns = {f"n1_command at n2 {x:.4g}": Unknown(v, 0.3) for x, v in zip(knots, start)}
    unknowns["n1_up_time"] = Unknown(0.2, low=QUICKEST, high=SLOWEST)
    found = bench.fitted(Deck(leaves, lever_delay=delay), records, unknowns, parameters, ["n1"])
    theta, C = found.estimates["estimate"].values, np.nan_to_num(found.estimates["covariance"].values)
    return Curve.of("n2", at, curve, theta, C), (float(theta[-1]), float(np.sqrt(C[-1, -1]))), found
