"""Whether a row of a case applies to a flight, and why a row is not judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flightmech.units import DEGREE
from pom.cases.case import PomCase, driven_quantities
from pom.judging.measures.control_release import FreeMotion, measure_free_motion
from pom.judging.signals import Raw, RunSignals, signals_of_run
from pom.tolerances.bands import Invalid
from pom.tolerances.channels import OTHERS, channel_value_text, plain_id
from pom.tolerances.conditions import KINDS, satisfies_relation
from pom.tolerances.criteria import PARTS, Criterion

FOOTPRINT = "a footprint: a recording without a reference has no band and no verdict"
BANK_LIMITED = "1.b.8"
MOST_BANK = 30.0 * DEGREE
"""The window of 1.b.8 ends 5 s after the failure, or at this bank. [rad]"""
TRIMMED = ("delta_e", "delta_a", "delta_r", "thrust", "throttle")
"""Quantities that the trim at the start solves for. A snapshot judges them although the record
drives them afterwards."""

FITTED = ("channel", "abscissa", "window", "applies", "reason")
"""Fields of a criterion that `settle_criterion` fits to the flight."""
_STICK = ("F_column", "F_wheel", "F_rim", "F_pedal")  # forces on the controls that move surfaces


def settle_case(case: PomCase, time: np.ndarray, flight: Raw) -> PomCase:
    """Return a case with its criteria fitted to a flight: applicable, channel and window.

    Parameters
    ----------
    case : PomCase
    time : array (time,)
        Samples of the replay. [s]
    flight : mapping of str to array (time,)
        [SI]
    """
    signals = signals_of_run(case, flight, time)
    criteria = [settle_criterion(case, c, time=time, flight=signals) for c in case.criteria]
    return replace(case, criteria=tuple(criteria))


def settle_criterion(
    case: PomCase, criterion: Criterion, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Return one criterion as `settle_case`; a second call does not change it."""
    criterion = _select_channel(criterion, flight)
    largest = case.ranges.get(criterion.channel, criterion.largest)
    criterion = replace(criterion, fraction=case.fraction, largest=largest)
    if not criterion.applies:
        return criterion
    if plain_id(case.id) == BANK_LIMITED and criterion.measure == "trace":
        criterion = _end_at_bank(criterion, time, flight)
    for word in criterion.condition.split(";"):
        if word in PARTS:
            criterion = _restrict_window(case, criterion, word)
        elif word in KINDS:
            criterion = _check_kind(case, criterion, word, time=time, flight=flight)
        elif word.startswith("distance"):
            criterion = _check_distance(case, criterion, word, time=time, flight=flight)
    return criterion


def settling_signals(case: PomCase, criterion: Criterion) -> set[str]:
    """Return the signals of a flight on which `settle_criterion` depends."""
    names = {criterion.channel} if criterion.channel else set()
    if plain_id(case.id) == BANK_LIMITED:
        names.add("phi")
    if any(word.startswith("distance") for word in criterion.condition.split(";")):
        names.add("distance")
    return names


def _end_at_bank(criterion: Criterion, time: np.ndarray, flight: RunSignals) -> Criterion:
    """Return the criterion in a window that ends at 30 deg of recorded bank, if that is earlier."""
    if "phi" not in flight:
        return criterion
    start, stop = criterion.window
    beyond = (time > start) & (np.abs(flight["phi"]) >= MOST_BANK)
    if not beyond.any():
        return criterion
    # the last sample below the bank
    last = float(time[max(0, int(np.argmax(beyond)) - 1)])
    return replace(criterion, window=(start, min(stop, last)))


def _select_channel(criterion: Criterion, flight: RunSignals) -> Criterion:
    """Return the criterion on its channel, or on the first alternative that the flight has."""
    # The trim rate is judged over its abscissa, other parameters on their channel.
    is_rate = criterion.parameter == "trim_rate"
    current = criterion.channel
    if is_rate:
        current = criterion.abscissa
    if current in flight:
        return criterion
    for alternative in OTHERS.get(criterion.parameter, ()):
        if alternative not in flight:
            continue
        if is_rate:
            return replace(criterion, abscissa=alternative)
        return replace(criterion, channel=alternative)
    return criterion


def _restrict_window(case: PomCase, criterion: Criterion, word: str) -> Criterion:
    """Return the criterion in the part of its window between two events."""
    missing = [event for event in PARTS[word] if event and event not in case.events]
    if missing:
        events = " and ".join(missing)
        reason = f"give the event {events} in [events]: the row counts only in {word}"
        return replace(criterion, reason=reason)
    start, stop = criterion.window
    # A part without a first or last event is open at that side.
    first, last = (case.events.get(event) for event in PARTS[word])
    if first is not None:
        start = max(start, first)
    if last is not None:
        stop = min(stop, last)
    if start >= stop:
        return replace(criterion, applies=False, reason=f"no part of the window is {word}")
    return replace(criterion, window=(start, stop))


def _check_kind(
    case: PomCase, criterion: Criterion, word: str, *, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Check that the free motion of a control is of the kind of a row, and has its features."""
    if criterion.channel not in flight:
        return criterion
    try:
        motion = measure_free_motion(criterion, time, flight[criterion.channel])
    except Invalid:
        # The measure reports the error of the record.
        return criterion
    # a motion with a significant overshoot is underdamped
    kind = KINDS[1]
    if motion.overshoots.size:
        kind = KINDS[0]
    if kind != word and word not in case.features:
        reason = f"applies only {word}; the flight is {kind}"
        return replace(criterion, applies=False, reason=reason)
    if _lacks_measured_feature(criterion, motion):
        plural = "s" if motion.overshoots.size != 1 else ""
        reason = (
            f"the flight has {motion.overshoots.size} overshoot{plural} "
            f"beyond 5 % of the first displacement and not what the row measures"
        )
        return replace(criterion, applies=False, reason=reason)
    return criterion


def _lacks_measured_feature(criterion: Criterion, motion: FreeMotion) -> bool:
    """Whether the flight lacks the full cycle or the second overshoot that a row measures."""
    if criterion.measure == "period_n":
        return motion.overshoots.size < 2 or motion.period(1) is None
    if criterion.measure == "overshoot_n":
        later_only = criterion.parameter == "an" and criterion.band.base != "first_overshoot"
        return later_only and motion.overshoots.size < 2
    return False


def _check_distance(
    case: PomCase, criterion: Criterion, word: str, *, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Check that the length of a run satisfies the condition of a row."""
    if "distance" not in flight:
        return criterion
    # An event of the case has priority over the bound of the window.
    ends = []
    for event, default in zip(criterion.bounds, criterion.window, strict=True):
        ends.append(case.events.get(event, default))
    run = float(np.diff(np.interp(ends, time, flight["distance"]))[0])
    if satisfies_relation(word, run):
        return criterion
    length = channel_value_text("distance", run)
    reason = f"applies only with {word}; the flight has {length}"
    return replace(criterion, applies=False, reason=reason)


def reason_not_judged(case: PomCase, criterion: Criterion) -> str:
    """Return why a criterion is not judged in this case; empty if it is."""
    if criterion.measure == "demonstration":
        return criterion.reason
    if case.reference == "footprint":
        return FOOTPRINT
    if criterion.reason:
        return criterion.reason
    judged = criterion.channel
    if criterion.parameter == "trim_rate":
        judged = criterion.abscissa
    if any(loop.channel == judged for loop in case.drive.pilot):
        return f"{judged} is held by the math pilot; what a controller holds cannot be judged"
    # A calibration judges the indicator, which the model computes from the driven quantity.
    is_calibration = criterion.abscissa == "trim_indicator"
    if (
        judged in driven_quantities(case)
        and not is_calibration
        and not _is_solved_by_trim(case, criterion)
    ):
        return f"{judged} is driven by the record; what drives a model cannot be judged"
    if judged in _STICK and case.drive.level == "recorded":
        return "the surfaces are driven, so pilot forces have no meaning"
    if judged == "F_rim" and case.drive.level == "force":
        return "F_rim is driven by the record; what drives a model cannot be judged"
    return ""


def reason_not_steered(case: PomCase, criterion: Criterion, flight: RunSignals) -> str:
    """Return why a nose-wheel angle is not judged: the record drives the steering command."""
    if criterion.channel != "gear.steering":
        return ""
    if "delta_nw" not in flight or "delta_nw" in case.conditions:
        return ""
    return (
        "gear.steering follows delta_nw, which the record drives; hold it by [conditions] "
        "delta_nw = 0, so that pedals or tiller steer"
    )


def _is_solved_by_trim(case: PomCase, criterion: Criterion) -> bool:
    """Whether a snapshot judges a quantity that the trim at the start solves for.

    The recorded value plus the bias of the trim is then computed by the model.
    """
    if criterion.measure not in ("steady", "change") or case.drive.trim is not True:
        return False
    solved = (*TRIMMED, *case.drive.trim_surfaces)
    return criterion.channel.rpartition(".")[2] in solved
