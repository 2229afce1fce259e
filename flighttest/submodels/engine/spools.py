"""Governor and spools from power changes.

The unknowns are transport delay, schedule, time constants, rate limits and the fan.
The model is the one of the kernel (docs/explanation/simulation/engine.md).  n2 follows its schedule
over the delayed lever with a time constant that is a table over n2.  Rate limits bound its rate, if
there are any.  n1 follows a table over n2 with a lag, or follows the lever as n2 does.  The tables
are monotone cubics through a few knots, sampled so finely that straight lines between the nodes
suffice.  Schedule, time constants and limits may change with the flight condition.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 20.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.schedule import (
    cover_settled_range,
    first_schedule,
    reading_error,
    remove_lever_noise,
    schedule_nodes,
    settled_speeds,
    speed_knots,
)
from flighttest.submodels.engine.spool_search import QUICKEST, SIGNIFICANT, SLOWEST, GovernedSpool
from flighttest.submodels.engine.tables import EngineCurve, EngineTable2D

Fan = Literal["n2", "lever"]
# First value of the lag of n1 behind n2. [s]
_FIRST_LAG = 0.2


@dataclass(frozen=True)
class SpoolFit(ShortText):
    """Identified governor and spools.

    Attributes
    ----------
    tables : dict of str to Curve
        ``n2_command`` over throttle; ``n2_up_time`` and ``n2_down_time`` or ``n2_up_limit`` and
        ``n2_down_limit`` over n2; ``n1_command`` over n2, or over throttle with tables of its own;
        each also over the flight condition if requested.
    constants : dict of str to (value, standard error)
        ``lever_delay`` [s]; ``n1_up_time`` [s] of a fan behind the core; without limits ``ratio``
        of the time constants for deceleration over those for acceleration, at the middle of the
        speeds, and ``ratio_slope``, the first estimate of the slope of its logarithm over n2.
    core, fan : OutputError
        The fits of n2 and n1; `fan` is None without n1.
    changes : dict of str to (value, standard error)
        Of a schedule, and of the logarithm of a time constant or limit, from the first breakpoint
        of a flight condition to another.
    remarks : tuple of str
        Remarks on the estimates.
    responses : tuple of Dataset (time,)
        The power changes: ``throttle`` and the speeds, ``n2`` and ``n1``, with the response of the
        model, ``n2_model``, ``n1_model``.
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
        leaves = {name: curve.leaf for name, curve in self.tables.items()}
        if "n1_up_time" in self.constants:
            value, stderr = self.constants["n1_up_time"]
            leaves["n1_up_time"] = make_term(value, stderr=stderr, source="flight")
        return leaves

    def report(self) -> str:
        """Return constants, tables and noise as text."""
        # Every number is followed by its standard error in brackets.
        value = self.constants
        lines = [f"transport delay {value['lever_delay'][0]:.4f} s ({value['lever_delay'][1]:.2g})"]
        if "ratio" in value:
            slope, ratio = value["ratio_slope"], value["ratio"]
            verdict = "changes with n2"
            if abs(slope[0]) <= SIGNIFICANT * slope[1]:
                verdict = "no change with n2 beyond its error"
            lines.append(
                f"deceleration over acceleration {ratio[0]:.4f} ({ratio[1]:.2g}); slope of "
                f"its log {slope[0]:.3g} ({slope[1]:.2g}): {verdict}"
            )
        if "n1_up_time" in value:
            lines.append(
                f"lag of n1 behind n2 {value['n1_up_time'][0]:.4f} s ({value['n1_up_time'][1]:.2g})"
            )
        for name, (change, stderr) in self.changes.items():
            verdict = "" if abs(change) > 2.0 * stderr else ", no change beyond its error"
            lines.append(f"{name}: {change:.4g} ({stderr:.2g}){verdict}")
        for name, curve in self.tables.items():
            lines += ["", *curve.lines(name)]
        for search in (self.core, self.fan):
            if search is not None:
                lines += bench.search_lines(search)
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
        Knots of the schedule and of the tables over n2. Defaults: where the lever was at rest, and
        every 3.5 % of speed.  The outer knots over n2 are moved if they do not contain the speeds
        at rest with a margin of 0.5 %.
    over : mapping of str to sequence of float, optional
        Flight condition with which schedule and dynamics change, and its breakpoints: ``mach``,
        ``h`` [m], ``temperature_ratio`` ...
    limits : bool
        Rate limits over n2 for acceleration and deceleration. The time constant close to the
        schedule is then the same both ways, with a logarithm linear in n2.
    fan : {"n2", "lever"}
        Quantity that n1 follows.

    Returns
    -------
    SpoolFit

    Raises
    ------
    IdentificationError
        The lever is never at rest, or the speed does not move both ways.

    Notes
    -----
    Without limits ``ln tau_down = ln tau_up + ln f + g (n2 - middle)``.  If g is within 2.6
    standard errors of zero it is set to zero. The other unknowns are moved by their correlation
    with g.
    The noise of the lever readings at rest is added to the covariance of the schedule.
    """
    if fan not in ("n2", "lever"):
        raise IdentificationError(f"fan is {fan!r}; one of n2, lever is needed")
    # The noise of the lever at rest would bias its slope, so that it is removed and accounted for.
    lever = np.array(schedule_nodes(records) if throttle is None else throttle, float)
    lever_error = reading_error(records, lever)
    records = [remove_lever_noise(record) for record in records]
    requested = np.array(speed_knots(records) if n2 is None else n2, float)
    speed = cover_settled_range(requested, settled_speeds(records, "n2"))
    spool = GovernedSpool("n2", lever, speed=speed, over=over or {}, limits=limits)
    fit = spool.search(records)
    tables, constants, changes = spool.result(fit, lever_error)
    remarks = [] if n2 is None else _knot_remarks(requested, speed)
    remarks += spool.remarks(fit, records)
    core = SpoolFit(
        tables,
        constants,
        core=fit,
        fan=None,
        changes=changes,
        remarks=tuple(remarks),
        responses=_responses(records, n2=fit),
    )
    if not all("n1" in record for record in records):
        return core
    if fan == "n2":
        return _with_following_fan(core, records, speed)
    # The fan has the delay of the core and its tables, which are fixed.
    shaft = GovernedSpool(
        "n1",
        lever,
        speed=speed,
        over=over or {},
        limits=limits,
        delay=constants["lever_delay"][0],
        fixed={name: curve.leaf for name, curve in tables.items()},
    )
    return _with_governed_fan(core, shaft, records=records, lever_error=lever_error)


def _with_following_fan(
    core: SpoolFit, records: Sequence[xr.Dataset], knots: np.ndarray
) -> SpoolFit:
    """Return the fit with a fan that follows n2 with a lag."""
    delay = core.constants["lever_delay"][0]
    curve, lag, fan_fit = _fit_fan(core.tables, delay, records=records, knots=knots)
    return replace(
        core,
        tables=core.tables | {"n1_command": curve},
        constants=core.constants | {"n1_up_time": lag},
        fan=fan_fit,
        responses=_responses(records, n2=core.core, n1=fan_fit),
    )


def _with_governed_fan(
    core: SpoolFit, shaft: GovernedSpool, records: Sequence[xr.Dataset], lever_error: np.ndarray
) -> SpoolFit:
    """Return the fit with a fan that follows the lever, with tables of its own."""
    fan_fit = shaft.search(records)
    tables, constants, changes = shaft.result(fan_fit, lever_error)
    named = {f"n1_{name}": pair for name, pair in constants.items()}
    return replace(
        core,
        tables=core.tables | tables,
        constants=core.constants | named,
        fan=fan_fit,
        changes=core.changes | changes,
        remarks=(*core.remarks, *shaft.remarks(fan_fit, records)),
        responses=_responses(records, n2=core.core, n1=fan_fit),
    )


def _knot_remarks(requested: np.ndarray, used: np.ndarray) -> list[str]:
    """Return a remark on outer knots that differ from the requested ones."""
    changes = []
    for before, after in zip(requested[[0, -1]], used[[0, -1]]):
        if before != after:
            changes.append(f"{before:.4g} to {after:.4g}")
    if not changes:
        return []
    return [f"n2: outer knots moved to hold the speeds at rest: {', '.join(changes)}"]


def _responses(records: Sequence[xr.Dataset], **searches: OutputError) -> tuple[xr.Dataset, ...]:
    """Return the speeds of the records and of the model."""
    responses = []
    for k, record in enumerate(records):
        model = {}
        for name, search in searches.items():
            residual = search.residuals[k][f"engine1.{name}"].values
            model[f"{name}_model"] = record[name] - residual
        responses.append(record[["throttle", *searches]].assign(model))
    return tuple(responses)


def _fit_fan(
    tables: dict[str, EngineCurve], delay: float, records: Sequence[xr.Dataset], knots: np.ndarray
):
    """Return n1 over n2, its lag, and the fit, with the core fixed."""
    # The last unknown is the lag.
    start = np.append(first_schedule(records, "n1", knots, over="n2"), _FIRST_LAG)
    surface = EngineTable2D("n2", knots)

    def curve(theta: np.ndarray) -> np.ndarray:
        return surface.nodes(theta[:-1])

    def parameters(theta: np.ndarray) -> dict[str, float]:
        lag = {bench.kernel_parameter("n1_up_time"): float(theta[-1])}
        return bench.as_nodes("n1_command", curve(theta)) | lag

    leaves = {name: table.leaf for name, table in tables.items()}
    leaves |= {
        "n1_command": make_term(curve(start), surface.axes, outside="linear"),
        "n1_up_time": make_term(_FIRST_LAG),
        "thrust": make_term(0.0),
    }
    unknowns = {f"n1_command at n2 {x:.4g}": Unknown(v, 0.3) for x, v in zip(knots, start)}
    unknowns["n1_up_time"] = Unknown(_FIRST_LAG, low=QUICKEST, high=SLOWEST)
    fit = bench.fit_engine(
        EngineDeck(leaves, lever_delay=delay),
        records,
        unknowns=unknowns,
        expand=parameters,
        outputs=["n1"],
    )
    theta, C = bench.theta_and_covariance(fit)
    lag = float(theta[-1]), float(np.sqrt(C[-1, -1]))
    return EngineCurve.of(surface.axes, curve, theta=theta, C=C), lag, fit
