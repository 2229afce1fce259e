"""Checks of the conditions of the stall rows: entry, order of events, recovery, reach of the model.

Deceleration: 14 CFR 25.201(c) has at most 1 kt/s with wings level and 3 kt/s in a turn.  Reach: 14
CFR Part 60, Appendix A, Attachment 7, A.4.b (2019 edition, page 182) requires a model that is valid
to 10 deg beyond the angle of attack of stall identification.  Numbers for "wings level", "1 g" and
"near idle" are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from flightmech.envelope.maps import HELD
from flightmech.envelope.regions import A_PRIORI, EXTRAPOLATED
from flightmech.errors import AeromatchError, UnknownName
from flightmech.names import SEPARATION
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS
from flightmech.units import DEGREE, KNOT
from pom.cases.case import PomCase
from pom.judging.beyond_the_bands import flown_model
from pom.judging.conditions.flown_case import FlownCase, NotChecked
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of, plain_id
from pom.tolerances.conditions import WARNING_EVENTS
from pom.tolerances.stated_conditions import CONDITIONS, STATED

LEVEL_BANK = 5.0 * DEGREE
ONE_G = 0.15  # of the load factor, in the mean before the warning
NEAR_IDLE = 0.1  # of the travel of the lever
TURN_BANK = 15.0 * DEGREE  # from here on the limit of turning stalls applies
SLOWING, SLOWING_IN_TURN = 1.0 * KNOT, 3.0 * KNOT  # per second, 14 CFR 25.201(c)(1) and (2)
RATE_ALLOWANCE = 0.2 * KNOT  # per second; a pilot holds a rate no better
ENTRY = 10.0  # [s] before the warning
LAST_SECONDS = 3.0  # [s] of the entry, whose rate counts too
BEYOND_STALL = 10.0 * DEGREE
# Variables of the separation in fully separated flow; X_lift is ((1 + sqrt X) / 2)^2.
SEPARATED_FLOW = {**dict.fromkeys(SEPARATION, 0.0), "X_lift": 0.25}
REACH = "valid_beyond_stall"
"""Condition on the model."""


def _warning_time(flown: FlownCase) -> float:
    """Return the time of the first of stall warning and initial buffet. [s]"""
    times = [flown.case.events[name] for name in WARNING_EVENTS if name in flown.case.events]
    if not times:
        raise NotChecked(f"give the event {' or '.join(WARNING_EVENTS)}")
    return min(times)


def _stall_time(flown: FlownCase) -> float:
    if "stall" not in flown.case.events:
        raise NotChecked("the event stall is not given")
    return flown.case.events["stall"]


def _entry(flown: FlownCase) -> np.ndarray:
    """Return the samples of the entry (time,): the last seconds before the warning."""
    warning = _warning_time(flown)
    inside = flown.inside(max(warning - ENTRY, flown.flight.time[0]), warning)
    if inside.sum() < 3:
        raise NotChecked("the window has no entry before the warning")
    return inside


def _check_level_entry(flown: FlownCase) -> str:
    inside = _entry(flown)
    bank = float(np.nanmax(np.abs(flown.channel("phi")[inside])))
    load = float(np.nanmean(flown.channel("nz")[inside]))
    texts = []
    if bank > LEVEL_BANK:
        texts.append(f"{bank / DEGREE:.3g} deg of bank")
    if abs(load - 1.0) > ONE_G:
        texts.append(f"a mean load factor of {load:.2f}")
    if not texts:
        return ""
    return f"{' and '.join(texts)} before the warning; the row is entered wings level at 1 g"


def _check_idle_entry(flown: FlownCase) -> str:
    inside = _entry(flown)
    names = [name for name in flown.flight if name.endswith(".throttle")]
    levers = [flown.flight[name] for name in names] or [flown.channel("throttle")]
    most = max(float(np.nanmean(lever[inside])) for lever in levers)
    if most <= NEAR_IDLE:
        return ""
    return f"levers at {100.0 * most:.0f} % of their travel before the warning; the row has idle"


def _deceleration(time: np.ndarray, speed: np.ndarray) -> float:
    """Return how fast the airspeed falls, by a line. [m/s2]"""
    return -float(np.polyfit(time - time[0], speed, 1)[0])


def _check_entry_rate(flown: FlownCase) -> str:
    inside = _entry(flown)
    time, speed = flown.flight.time[inside], flown.channel("V_cas")[inside]
    rate = _deceleration(time, speed)
    is_last = time >= time[-1] - LAST_SECONDS
    if is_last.sum() > 2:
        # the mean over the entry hides a pull at its end
        rate = max(rate, _deceleration(time[is_last], speed[is_last]))
    if rate <= 0.0:
        return "the airspeed does not fall before the warning; the row approaches the stall"
    # rolled into the turn: the bank at the warning counts
    bank = abs(float(flown.channel("phi")[inside][-1]))
    limit = SLOWING_IN_TURN if bank > TURN_BANK else SLOWING
    if rate <= limit + RATE_ALLOWANCE:
        return ""
    return (
        f"entered with {rate / KNOT:.2g} kt/s at {bank / DEGREE:.2g} deg of bank; "
        f"14 CFR 25.201(c) has {limit / KNOT:g} kt/s at most"
    )


def _check_order(flown: FlownCase) -> str:
    warning, stall = _warning_time(flown), _stall_time(flown)
    alpha = np.interp([warning, stall], flown.flight.time, flown.channel("alpha"))
    if warning <= stall and alpha[0] < alpha[1]:
        return ""
    return (
        f"first warning at {warning:.1f} s and {alpha[0] / DEGREE:.3g} deg of angle of attack, "
        f"stall at {stall:.1f} s and {alpha[1] / DEGREE:.3g} deg; the warning comes first"
    )


def _check_recovery(flown: FlownCase) -> str:
    warning, stall = _warning_time(flown), _stall_time(flown)
    time, alpha = flown.flight.time, flown.channel("alpha")
    after = alpha[time > stall]
    if after.size and float(np.nanmin(after)) < float(np.interp(warning, time, alpha)):
        return ""
    return (
        "the window ends before the angle of attack is back below that of the warning; the row "
        "goes on through the recovery"
    )


def _check_upset(flown: FlownCase) -> str:
    pitch, bank = flown.channel("theta") / DEGREE, np.abs(flown.channel("phi")) / DEGREE
    high, low, most = float(np.nanmax(pitch)), float(np.nanmin(pitch)), float(np.nanmax(bank))
    if high > 25.0 or low < -10.0 or most > 45.0:
        return ""
    return (
        f"pitch {low:.3g} ... {high:.3g} deg, bank up to {most:.3g} deg: no upset by attitude "
        "(Attachment 7, B.1); an upset by airspeed alone is not checked"
    )


STALL_CHECKS: dict[str, Callable[[FlownCase], str]] = {
    "level_entry": _check_level_entry,
    "idle_entry": _check_idle_entry,
    "entry_rate": _check_entry_rate,
    "warning_first": _check_order,
    "recovery_recorded": _check_recovery,
    "upset": _check_upset,
}
"""By condition: returns a text if it does not hold, and raises `NotChecked` if it is unknown."""


def reach_remarks(
    case: PomCase,
    time: np.ndarray,
    alpha: np.ndarray | None,
    outputs: Mapping[str, np.ndarray],
    fmu: str | Path,
) -> tuple[RowRemark, ...]:
    """Return the remark on a model whose tables end less than 10 deg beyond the stall.

    Parameters
    ----------
    case : PomCase
        With the event ``stall``, which is the stall identification.
    time : array (time,)
        [s]
    alpha : array (time,) or None
        Angle of attack of the flight. [rad]
    outputs : mapping of str to array (time,)
        Of the run.  All variables of the envelope but alpha have their values at the stall. [SI]
    fmu : str or Path
        File of the model.

    Returns
    -------
    tuple of RowRemark
        ``departure`` if the model extrapolates there, ``low_confidence`` if no flight supports it,
        ``not_checked`` without tables of this program, ``departure`` without the event or an angle
        of attack.  Empty for a test without the condition.
    """
    if REACH not in STATED.get(plain_id(case.id), ()):
        return ()
    condition = CONDITIONS[REACH]
    try:
        if "stall" not in case.events or alpha is None:
            raise NotChecked("the event stall or the recorded angle of attack is missing")
        reached = float(np.interp(case.events["stall"], time, alpha))
        model = flown_model(fmu)
        if model is None:
            raise NotChecked("the FMU holds no tables of this program", is_ours=True)
        return _reach_of(model, reached, _at(case.events["stall"], time, outputs))
    except NotChecked as reason:
        return (reason.remark(condition.text, REACH),)
    except AeromatchError as error:
        return (NotChecked(str(error), is_ours=True).remark(condition.text, REACH),)


def _at(instant: float, time: np.ndarray, outputs: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the outputs at an instant; those that are not finite are left out."""
    values = {name: float(np.interp(instant, time, item)) for name, item in outputs.items()}
    return {name: value for name, value in values.items() if np.isfinite(value)}


def _reach_of(model: SimModel, stall: float, state: Mapping[str, float]) -> tuple[RowRemark, ...]:
    """Return the remark on the angles of attack from the stall to 10 deg beyond it."""
    wanted = f"the stall at {stall / DEGREE:.1f} deg and 10 deg beyond"
    envelope = model.envelope
    if envelope is None:
        # without sources of its nodes the ends of the tables over alpha are all that is known
        ends = [row.high for row in model.entries(AXIS) if row.name == "alpha"]
        if not ends or min(ends) >= stall + BEYOND_STALL:
            reason = "the model has no validity envelope, and no table ends before"
            raise NotChecked(reason, is_ours=True)
        text = f"departure: a table ends at {min(ends) / DEGREE:.1f} deg of alpha, before {wanted}"
        return (RowRemark("departure", text, REACH),)
    angles = np.linspace(stall, stall + BEYOND_STALL, 11)
    states: dict[str, np.ndarray | float] = dict(HELD)
    for name in envelope.axes:
        source = output_of(name, state)
        if source in state:
            states[name] = state[source]
    # beyond the stall the flow separates further: the table is looked up at both ends
    separated = {name: SEPARATED_FLOW[name] for name in envelope.axes if name in SEPARATED_FLOW}
    try:
        regions, _ = envelope.look_up({**states, "alpha": angles})
        if separated:
            beyond, _ = envelope.look_up({**states, **separated, "alpha": angles})
            regions = np.maximum(regions, beyond)
    except UnknownName as missing:
        raise NotChecked(str(missing), is_ours=True) from None
    worst = int(np.max(regions))
    first = float(angles[int(np.argmax(regions == worst))]) / DEGREE
    if worst == EXTRAPOLATED:
        text = (
            f"departure: the model extrapolates from {first:.1f} deg of alpha on, before {wanted}"
        )
        return (RowRemark("departure", text, REACH),)
    if worst == A_PRIORI:
        text = (
            f"low confidence: no flight supports the model from {first:.1f} deg on, within {wanted}"
        )
        return (RowRemark("low_confidence", text, REACH),)
    return ()
