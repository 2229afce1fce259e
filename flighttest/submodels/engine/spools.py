"""Governor and spools from power changes: transport delay, schedule, time constants, rate limits,
fan behind core.

The model is the kernel's (docs/explanation/simulation/engine.md): n2 follows its schedule over the delayed lever with a
time constant that is a table over n2, no faster than its rate limits where there are any; n1
follows a table over n2 with a lag of its own, or the lever as n2 does.  The tables are monotone
cubics through a few knots, sampled so finely that straight lines between the nodes do as well;
schedule, time constants and limits may change with the flight condition.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 20.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.engine_deck import EngineDeck
from flightmech.errors import IdentificationError
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.schedule import (
    cover_settled_range,
    first_rates,
    first_schedule,
    reading_error,
    reading_noise,
    remove_lever_noise,
    schedule_nodes,
    settled_speeds,
    speed_knots,
)
from flighttest.submodels.engine.tables import FINE, EngineCurve, EngineTable2D

QUICKEST, SLOWEST = 0.02, 30.0  # time constants that are searched [s]
LEAST_RATE, MOST_RATE = 1e-3, 10.0  # limits that are searched [1/s]
LONGEST = 2.0  # transport delay that is searched [s]
SIGNIFICANT = (
    2.6  # standard errors beyond which the ratio of the time constants depends on speed, 1 %
)
ROUGH, FEW = 0.1, 8  # internal step [s] and iterations of the first search
NOISY = 3.0  # residual over the noise of the readings from which on something is missing
QUICK = 0.1  # first time constant where limits govern [s]
SEEN = 0.9  # part of the a-priori standard error that is left of what no record shows
MOST_NODES = 250  # that the kernel changes in one simulation, less a few
# a-priori standard error of ln tau and of the logarithm of a limit: keeps what no record shows
_VAGUE = 2.0
_CHANGE = {
    "command": 0.1,
    "time": 1.0,
    "limit": 1.0,
}  # a-priori standard error of a change with the flight condition

Fan = Literal["n2", "lever"]


@dataclass(frozen=True)
class SpoolFit:
    """Identified governor and spools.

    Attributes
    ----------
    tables : dict of str to Curve
        ``n2_command`` over throttle; ``n2_up_time`` and ``n2_down_time`` or ``n2_up_limit`` and
        ``n2_down_limit`` over n2; ``n1_command`` over n2, or over throttle with tables of its own;
        each over the flight condition too where requested.
    constants : dict of str to (value, standard error)
        ``lever_delay`` [s]; ``n1_up_time`` [s] of a fan behind the core; without limits ``ratio``
        of the time constants for deceleration over those for acceleration, at the middle of the
        speeds, and ``ratio_slope``, the change of its logarithm per unit of n2, as first estimated.
    core, fan : OutputError
        The searches; `fan` is None without n1.
    changes : dict of str to (value, standard error)
        Of a schedule, and of the logarithm of a time constant or limit, from the first breakpoint
        of a flight condition to another.
    remarks : tuple of str
        What a reader of the numbers must know.
    responses : tuple of Dataset (time,)
        The power changes: ``throttle`` and the speeds, ``n2`` and ``n1``, with what the model makes
        of them, ``n2_model``, ``n1_model``.
    """

    tables: dict[str, EngineCurve]
    constants: dict[str, tuple[float, float]]
    core: OutputError
    fan: OutputError | None
    changes: dict[str, tuple[float, float]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    responses: tuple[xr.Dataset, ...] = ()

    def leaves(self) -> dict[str, xr.Dataset]:
        """Return the tables of the deck."""
        found = {name: curve.leaf for name, curve in self.tables.items()}
        if "n1_up_time" in self.constants:
            value, stderr = self.constants["n1_up_time"]
            found["n1_up_time"] = make_term(value, stderr=stderr, source="flight")
        return found

    def report(self) -> str:
        """Return constants, tables and noise as text."""
        value = self.constants
        lines = [f"transport delay {value['lever_delay'][0]:.4f} s ({value['lever_delay'][1]:.2g})"]
        if "ratio" in value:
            slope, ratio = value["ratio_slope"], value["ratio"]
            word = (
                "no change with n2 beyond its error"
                if abs(slope[0]) <= SIGNIFICANT * slope[1]
                else "changes with n2"
            )
            lines.append(
                f"deceleration over acceleration {ratio[0]:.4f} ({ratio[1]:.2g}); slope of "
                f"its log {slope[0]:.3g} ({slope[1]:.2g}): {word}"
            )
        if "n1_up_time" in value:
            lines.append(
                f"lag of n1 behind n2 {value['n1_up_time'][0]:.4f} s ({value['n1_up_time'][1]:.2g})"
            )
        for name, (change, stderr) in self.changes.items():
            lines.append(
                f"{name}: {change:.4g} "
                f"({stderr:.2g}){'' if abs(change) > 2.0 * stderr else ', no change beyond its error'}"
            )
        for name, curve in self.tables.items():
            lines += ["", *curve.lines(name)]
        for search in (self.core, self.fan):
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
        return "\n".join([*lines, *(f"! {text}" for text in self.remarks)])


def identify_spools(
    records: Sequence[xr.Dataset],
    throttle: Sequence[float] | None = None,
    n2: Sequence[float] | None = None,
    *,
    over: Mapping[str, Sequence[float]] | None = None,
    limits: bool = False,
    fan: Fan = "n2",
) -> SpoolFit:
    """Identify governor and spools by output error on the engine model of the kernel.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        Power changes that begin at rest, on a uniform clock: ``throttle``, ``n2`` and where there
        is one ``n1`` [1]; ``mach``, ``h`` [m], ``temperature`` [K] give the condition.
        `power_changes` cuts them out of a flight.
    throttle, n2 : sequence of float, optional
        Knots of the schedule and of the tables over n2; by default where the lever rested, and
        every 3.5 % of speed.  The outer ones over n2 are moved where they do not hold the speeds at
        rest with a margin of 0.5 %.
    over : mapping of str to sequence of float, optional
        Flight condition with which schedule and dynamics change, and its breakpoints: ``mach``,
        ``h`` [m], ``temperature_ratio`` ...
    limits : bool
        Rate limits over n2 for acceleration and deceleration; the time constant close to the
        schedule is then the same both ways, its logarithm linear in n2.
    fan : {"n2", "lever"}
        What n1 follows.

    Returns
    -------
    SpoolFit

    Raises
    ------
    IdentificationError
        The lever never rests, or the speed does not move both ways.

    Notes
    -----
    Without limits ``ln tau_down = ln tau_up + ln f + g (n2 - middle)``: where g is within 2.6 standard errors of zero it is set to
    zero, and the other unknowns are moved by their correlation with it.  The noise of the lever readings at rest is added to the
    covariance of the schedule.
    """
    if fan not in ("n2", "lever"):
        raise IdentificationError(f"fan is {fan!r}; one of n2, lever is needed")
    noisy = reading_error(
        records,
        lever := np.array(throttle if throttle is not None else schedule_nodes(records), float),
    )
    records = [remove_lever_noise(record) for record in records]
    given = np.array(n2 if n2 is not None else speed_knots(records), float)
    speed = cover_settled_range(given, settled_speeds(records, "n2"))
    core = _Spool("n2", lever, speed, over or {}, limits)
    found = core.search(records)
    tables, constants, changes = core.result(found, noisy)
    moved = [
        f"{old:.4g} to {new:.4g}"
        for old, new in zip(given[[0, -1]], speed[[0, -1]])
        if n2 is not None and old != new
    ]
    remarks = (
        [f"n2: outer knots moved to hold the speeds at rest: {', '.join(moved)}"] if moved else []
    )
    remarks += core.remarks(found, records)
    if not all("n1" in record for record in records):
        return SpoolFit(
            tables, constants, found, None, changes, tuple(remarks), _responses(records, n2=found)
        )
    if fan == "n2":
        curve, lag, behind = _fan(tables, constants["lever_delay"][0], records, speed)
        found_n1 = {"n1_command": curve}
        constants |= {"n1_up_time": lag}
    else:
        leaves = {name: one.leaf for name, one in tables.items()}
        shaft = _Spool("n1", lever, speed, over or {}, limits, constants["lever_delay"][0], leaves)
        behind = shaft.search(records)
        found_n1, more, own = shaft.result(behind, noisy)
        constants |= {f"n1_{name}": pair for name, pair in more.items()}
        changes |= own
        remarks += shaft.remarks(behind, records)
    responses = _responses(records, n2=found, n1=behind)
    return SpoolFit(tables | found_n1, constants, found, behind, changes, tuple(remarks), responses)


def _responses(records: Sequence[xr.Dataset], **searches: OutputError) -> tuple[xr.Dataset, ...]:
    """The speeds of the records and of the model."""
    found = []
    for k, record in enumerate(records):
        model = {
            f"{name}_model": record[name] - search.residuals[k][f"engine1.{name}"].values
            for name, search in searches.items()
        }
        found.append(record[["throttle", *searches]].assign(model))
    return tuple(found)


class _Spool:
    """Unknowns of a spool that the lever governs: delay (unless it is known), schedule, ln tau,
    then ln f and its slope or the limits.
    """

    def __init__(
        self,
        name: str,
        lever: np.ndarray,
        speed: np.ndarray,
        over: Mapping[str, Sequence[float]],
        limits: bool,
        delay: float | None = None,
        given: Mapping[str, xr.Dataset] | None = None,
    ):
        self.name, self.limits, self.delay, self.given = name, limits, delay, dict(given or {})
        self.middle = 0.5 * (speed[0] + speed[-1])
        self.surfaces = dict(self._surfaces(lever, speed, over, np.inf if limits or over else FINE))
        size = sum(surface.size for surface in self.surfaces.values())
        if size > MOST_NODES:
            raise IdentificationError(
                f"the tables of {name} have {size} nodes, more than {MOST_NODES}; give fewer "
                f"knots (throttle, n2) or breakpoints (over)"
            )
        self.lever, self.speed = lever, speed
        edges = np.cumsum(
            [0 if delay is not None else 1, *(surface.count for surface in self.surfaces.values())]
        )
        self.places = {table: slice(a, b) for table, a, b in zip(self.surfaces, edges, edges[1:])}

    def _surfaces(
        self,
        lever: np.ndarray,
        speed: np.ndarray,
        over: Mapping[str, Sequence[float]],
        spacing: float,
    ) -> Iterator[tuple[str, EngineTable2D]]:
        yield f"{self.name}_command", EngineTable2D("throttle", lever, over, spacing)
        if not self.limits:
            yield f"{self.name}_up_time", EngineTable2D("n2", speed, over, spacing)
            return
        yield f"{self.name}_up_time", EngineTable2D("n2", speed[[0, -1]], spacing=spacing)
        for way in ("up", "down"):
            yield f"{self.name}_{way}_limit", EngineTable2D("n2", speed, over, spacing)

    def tables(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Nodes of the tables from the unknowns."""
        found = {
            table: surface.nodes(theta[self.places[table]])
            for table, surface in self.surfaces.items()
        }
        time = found[f"{self.name}_up_time"]
        if not self.limits:
            ratio = theta[-2] + theta[-1] * (
                self.surfaces[f"{self.name}_up_time"].axes["n2"] - self.middle
            )
            found[f"{self.name}_down_time"] = time + ratio.reshape(-1, *[1] * (time.ndim - 1))
        return {
            table: value if table.endswith("_command") else np.exp(value)
            for table, value in found.items()
        }

    def axes(self, table: str) -> dict[str, np.ndarray]:
        """Breakpoints of a table."""
        return self.surfaces[table.replace("_down_time", "_up_time")].axes

    def _parameters(self, theta: np.ndarray) -> dict[str, float]:
        found = (
            {}
            if self.delay is not None
            else {bench.kernel_parameter("lever_delay"): float(theta[0])}
        )
        for table, values in self.tables(theta).items():
            found |= bench.as_nodes(
                table, np.clip(values, QUICKEST, None) if table.endswith("_time") else values
            )
        return found

    def search(self, records: Sequence[xr.Dataset]) -> OutputError:
        """The search, roughly first."""
        rough = self._fit(records, self._start(records), ROUGH, FEW)
        return self._fit(records, rough.estimates["estimate"].values)

    def _start(self, records: Sequence[xr.Dataset]) -> np.ndarray:
        """First values."""
        schedule = first_schedule(records, self.name, self.lever)
        times, rates = first_rates(records, self.name, self.lever, schedule, self.speed)
        up, down = (np.log(np.clip(v, ROUGH, SLOWEST / 2.0)) for v in times)
        first = {"command": schedule, "time": np.full(2, np.log(QUICK)) if self.limits else up}
        first |= {
            way: np.log(np.clip(v, 2.0 * LEAST_RATE, MOST_RATE / 2.0))
            for way, v in zip(("up_limit", "down_limit"), rates)
        }
        parts = [
            next(v for key, v in first.items() if table.endswith(key)) for table in self.surfaces
        ]
        whole = [surface.start(v) for surface, v in zip(self.surfaces.values(), parts)]
        last = [] if self.limits else [float(np.mean(down - up)), 0.0]
        return np.concatenate([[] if self.delay is not None else [0.1], *whole, last])

    def _unknowns(self, start: np.ndarray, step: float) -> dict[str, Unknown]:
        found = (
            {}
            if self.delay is not None
            else {"lever_delay": Unknown(start[0], low=0.0, high=LONGEST)}
        )
        for table, surface in self.surfaces.items():
            kind = table.rpartition("_")[2]
            spread = 0.3 if kind == "command" else _VAGUE
            bounds = {
                "command": (-np.inf, np.inf),
                "time": (np.log(max(QUICKEST, 0.5 * step)), np.log(SLOWEST)),
                "limit": (np.log(LEAST_RATE), np.log(MOST_RATE)),
            }[kind]
            label = table if kind == "command" else f"ln {table}"
            for k, (name, value) in enumerate(zip(surface.names(label), start[self.places[table]])):
                at_knot = k < len(surface.knots)
                found[name] = (
                    Unknown(float(value), spread, *bounds)
                    if at_knot
                    else Unknown(float(value), _CHANGE[kind])
                )
        if not self.limits:
            found |= {
                "ln ratio": Unknown(float(start[-2]), 1.0),
                "slope of ln ratio": Unknown(float(start[-1]), 10.0),
            }
        return found

    def _fit(
        self,
        records: Sequence[xr.Dataset],
        start: np.ndarray,
        step: float = bench.STEP,
        iterations: int = bench.ITERATIONS,
    ) -> OutputError:
        leaves = {
            table: make_term(v, self.axes(table), outside="hold")
            for table, v in self.tables(start).items()
        }
        if list(self.axes(f"{self.name}_command")) == ["throttle"]:
            leaves[f"{self.name}_command"].attrs["outside"] = "linear"
        deck = EngineDeck(
            {**self.given, **leaves, "thrust": make_term(0.0)}, lever_delay=self.delay or 0.0
        )
        coarse = ["lever_delay"] if self.limits else []
        return bench.fit_engine(
            deck,
            records,
            self._unknowns(start, step),
            self._parameters,
            [self.name],
            step,
            iterations,
            coarse,
        )

    def result(self, found: OutputError, noisy: np.ndarray):
        """Tables, constants and changes of a search; `noisy` (knot,) is the standard error of the
        lever positions.
        """
        theta, C = (
            found.estimates["estimate"].values.copy(),
            np.nan_to_num(found.estimates["covariance"].values),
        )
        constants: dict[str, tuple[float, float]] = {}
        if not self.limits:
            slope = float(theta[-1]), float(np.sqrt(C[-1, -1]))
            if abs(slope[0]) <= SIGNIFICANT * slope[1]:
                theta -= C[:, -1] / C[-1, -1] * slope[0]
                C = C - np.outer(C[:, -1], C[-1]) / C[-1, -1]
            ratio = float(np.exp(theta[-2]))
            constants = {"ratio": (ratio, ratio * float(np.sqrt(C[-2, -2]))), "ratio_slope": slope}
        if self.delay is None:
            constants = {"lever_delay": (float(theta[0]), float(np.sqrt(C[0, 0])))} | constants
        first = self.places[f"{self.name}_command"].start
        places = np.arange(first, first + len(self.lever))
        steep = scipy.interpolate.PchipInterpolator(self.lever, theta[places]).derivative()(
            self.lever
        )
        C[places, places] += (steep * noisy) ** 2
        tables = {
            table: EngineCurve.of(self.axes(table), partial(self._table, table), theta, C)
            for table in self.tables(theta)
        }
        return tables, constants, self._changes(found)

    def _table(self, table: str, theta: np.ndarray) -> np.ndarray:
        return self.tables(theta)[table]

    def _changes(self, found: OutputError) -> dict[str, tuple[float, float]]:
        rows = found.estimates
        names = [str(name) for name in rows["parameter"].values]
        pairs = zip(names, rows["estimate"].values, rows["stderr"].values)
        return {
            name: (float(value), float(stderr)) for name, value, stderr in pairs if " from " in name
        }

    def remarks(self, found: OutputError, records: Sequence[xr.Dataset]) -> Iterator[str]:
        """What a reader of a search must know."""
        rows = found.estimates
        left = rows["stderr"].values > SEEN * rows["prior_stderr"].values
        if unseen := [str(name) for name, part in zip(rows["parameter"].values, left) if part]:
            yield f"not seen in the records, kept as it was put in: {', '.join(unseen)}"
        residual, noise = (
            float(found.noise["stderr"].values.flat[0]),
            reading_noise(records, self.name),
        )
        if residual > NOISY * noise:
            what = (
                "changes with the flight condition (over)"
                if self.limits
                else "rate limits (limits) or changes with the flight condition (over)"
            )
            much = f"{residual:.2g} rms, is {residual / noise:.1f} times the noise of the readings"
            yield f"{self.name}: the residual, {much}; look for {what}"


def _fan(
    tables: dict[str, EngineCurve], delay: float, records: Sequence[xr.Dataset], knots: np.ndarray
):
    """n1 over n2, and its lag, with the core as it was found."""
    start = np.append(first_schedule(records, "n1", knots, over="n2"), 0.2)
    surface = EngineTable2D("n2", knots)

    def curve(theta: np.ndarray) -> np.ndarray:
        return surface.nodes(theta[:-1])

    def parameters(theta: np.ndarray) -> dict[str, float]:
        return bench.as_nodes("n1_command", curve(theta)) | {
            bench.kernel_parameter("n1_up_time"): float(theta[-1])
        }

    leaves = {name: one.leaf for name, one in tables.items()}
    leaves |= {
        "n1_command": make_term(curve(start), surface.axes, outside="linear"),
        "n1_up_time": make_term(0.2),
        "thrust": make_term(0.0),
    }
    unknowns = {f"n1_command at n2 {x:.4g}": Unknown(v, 0.3) for x, v in zip(knots, start)}
    unknowns["n1_up_time"] = Unknown(0.2, low=QUICKEST, high=SLOWEST)
    found = bench.fit_engine(
        EngineDeck(leaves, lever_delay=delay), records, unknowns, parameters, ["n1"]
    )
    theta, C = (
        found.estimates["estimate"].values,
        np.nan_to_num(found.estimates["covariance"].values),
    )
    return (
        EngineCurve.of(surface.axes, curve, theta, C),
        (float(theta[-1]), float(np.sqrt(C[-1, -1]))),
        found,
    )
