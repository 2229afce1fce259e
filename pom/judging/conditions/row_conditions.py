"""Conditions that a row of the tolerance table states for the flight, on one case.

A condition that does not hold is a departure, and so is one that record and aircraft file do not
show.  A condition that the program does not check is a notice of the kind ``not_checked``.
`pom.tolerances.stated_conditions` lists the conditions.  `report_conditions` of this folder checks
those over several cases.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from flightmech.errors import UnknownName
from pom.cases.case import PomCase
from pom.cases.case_facts import REVERSIBLE
from pom.cases.case_file import FORCES
from pom.cases.drafting.event_detection import NOISE, POWER, input_channels, sample_noise
from pom.judging.conditions.condition_checks import CHECKS, FORCED, MOVED, SMOOTH
from pom.judging.conditions.configurations import CONFIGURATION_CHECKS, FLAPS_OUT
from pom.judging.conditions.flown_case import FlownCase, NotChecked
from pom.judging.conditions.stall_checks import STALL_CHECKS
from pom.judging.measures.control_release import measure_free_motion
from pom.judging.signals import RunSignals
from pom.tolerances.bands import Invalid, RowRemark
from pom.tolerances.channels import channel_value_text
from pom.tolerances.conditions import KINDS
from pom.tolerances.criteria import Criterion
from pom.tolerances.stated_conditions import (
    ANY,
    CONFIGURATIONS,
    StatedCondition,
    conditions_of,
)

_STEP = 0.1  # of the travel of gear and speed brake
_POWER_STEP = 0.05  # of the largest value in the window
_COLUMN = 0.01  # [m]
_SMALL = 0.25  # share of the limits below: smaller movements are a trim that the pilot holds
_HANDS = {
    **dict.fromkeys(("delta_e", "delta_a", "delta_r", "wheel"), MOVED),
    **dict.fromkeys(("column", "pedal"), _COLUMN),
    **{"F_wheel" if name == "F_rim" else name: limit for name, limit in FORCED.items()},
}
"""Change of a control in a window that is an input even if its channel is noisy. [SI]  Our numbers.

A smaller change is an input beyond six standard deviations of the noise and a share `_SMALL`.
"""
_DEVICES = {
    **dict.fromkeys(("gear", "speedbrake"), _STEP),
    **dict.fromkeys(("delta_f", "delta_s"), FLAPS_OUT),
}
"""Change of a device in a window that is an input of the test. [SI]  Our numbers."""


def _check_input(flown: FlownCase) -> str:
    """Return which control of the test rests in the window; empty if one moves."""
    judged = flown.judged()
    if judged and all(item.measure == "steady" for item in judged):
        # a trimmed flight before and after the change needs no record of the change
        return ""
    largest: dict[str, float] = {}
    for control in input_channels(flown.case.id):
        names = [control]
        if control in POWER:
            names = [name for name in flown.flight if name.rpartition(".")[2] == control]
        for name in names:
            if name not in flown.flight:
                continue
            values = np.asarray(flown.flight[name], float)
            values = values[np.isfinite(values)]
            if values.size < 2:
                continue
            width = max(1, round(SMOOTH / float(np.median(np.diff(flown.flight.time)))))
            # the mean keeps the noise of a pick-up from being a movement
            smooth = scipy.ndimage.uniform_filter1d(values, width, mode="nearest")
            least = _DEVICES.get(control, _POWER_STEP * max(float(np.abs(smooth).max()), 1e-9))
            if control in _HANDS:
                most = _HANDS[control]
                least = float(np.clip(NOISE * sample_noise(values), _SMALL * most, most))
            largest[name] = float(np.ptp(smooth))
            if largest[name] > least:
                return ""
    if not largest:
        wanted = " or ".join(input_channels(flown.case.id))
        raise NotChecked(f"the record has no {wanted}: record it")
    texts = [channel_value_text(name, size) for name, size in largest.items()]
    return (
        f"the input of the test does not move in the window: {', '.join(texts)} at most; choose a "
        f"window with the input"
    )


CASE_CHECKS = {**CHECKS, **STALL_CHECKS, "input": _check_input}
"""By condition on one case: its check."""


def condition_remarks(case: PomCase, flight: RunSignals) -> tuple[RowRemark, ...]:
    """Return the remarks on the conditions of the rows of a case.

    Parameters
    ----------
    case : PomCase
        With its criteria fitted to the flight.
    flight : RunSignals
        Over the window of the case. [SI]

    Returns
    -------
    tuple of RowRemark
        ``departure`` for a condition that does not hold or that record, case and aircraft do not
        show, ``not_checked`` for one that the program does not check, ``additional`` for a stated
        other configuration.
    """
    if case.reference == "footprint" and not case.is_demonstration:
        return ()
    flown = FlownCase(case, flight)
    remarks = [
        *_claim_remarks(case),
        *_contradicted_claims(case, flight),
        *_unjudged_forces(case, flight),
    ]
    for condition in conditions_of(case.id):
        if condition.over != "case":
            continue
        try:
            failure = _failure_of(flown, condition)
        except NotChecked as reason:
            remarks.append(reason.remark(condition.text, condition.name))
            continue
        if failure and condition.name == "configuration" and case.additional:
            text = f"additional case, not the test {case.id}: {failure}; {case.additional}"
            remarks.append(RowRemark("additional", text, condition.name))
        elif failure:
            remarks.append(RowRemark("departure", f"departure: {failure}", condition.name))
    return tuple(remarks)


def _failure_of(flown: FlownCase, condition: StatedCondition) -> str:
    """Return why a condition does not hold; empty if it holds."""
    if condition.name == "configuration":
        return _check_configuration(flown)
    if condition.name not in CASE_CHECKS:
        raise NotChecked("the program has no check of it", is_ours=True)
    return CASE_CHECKS[condition.name](flown)


def _claim_remarks(case: PomCase) -> Iterator[RowRemark]:
    """Yield the remarks on conditions that a case claims, and on unknown kinds of controls."""
    forces = []
    claimed: dict[str, None] = {}
    for criterion in case.criteria:
        words = set(filter(None, criterion.condition.split(";")))
        if REVERSIBLE in words and REVERSIBLE not in case.facts:
            forces.append(criterion.name)
        if criterion.applies:
            claimed |= dict.fromkeys(sorted(words & set(case.features) - {REVERSIBLE}))
    if forces:
        text = (
            f"departure: {', '.join(forces)} is not judged, and neither the aircraft file nor the "
            f"case states whether the controls are reversible ([facts] {REVERSIBLE})"
        )
        yield RowRemark("departure", text, REVERSIBLE)
    for word in claimed:
        text = f"not checked: {word} (claimed in case.features)"
        yield RowRemark("not_checked", text, word)


def _unjudged_forces(case: PomCase, flight: RunSignals) -> Iterator[RowRemark]:
    """Yield the remark on pilot forces that the facts of the aircraft take out of the judgement."""
    if case.facts.get(REVERSIBLE) is not False:
        return
    rows = [c.name for c in case.criteria if REVERSIBLE in c.condition.split(";")]
    if not rows:
        return
    recorded = [name for name in FORCES if name in flight]
    text = f"{', '.join(rows)} is not judged: {REVERSIBLE} is false in the facts of the aircraft"
    if recorded:
        text = f"record: {text}, and the record has the pilot forces {', '.join(recorded)}"
        yield RowRemark("record_warning", text, REVERSIBLE)
    else:
        yield RowRemark("not_checked", f"not checked: {text}; the record has none", REVERSIBLE)


_NOT_REVERSIBLE = ("alternative_method", "computer_controlled_airplane")
"""Conditions of aeroplanes whose controls give the pilot no force of the surfaces."""


def _contradicted_claims(case: PomCase, flight: RunSignals) -> Iterator[RowRemark]:
    """Yield the departures of claims that aircraft or record contradict."""
    claimed: dict[str, Criterion] = {}
    for criterion in case.criteria:
        if criterion.applies:
            for word in set(criterion.condition.split(";")) & set(case.features):
                claimed.setdefault(word, criterion)
    for word in _NOT_REVERSIBLE:
        if word in claimed and case.facts.get(REVERSIBLE):
            text = f"departure: {word} is claimed, and the controls of the aircraft are reversible"
            yield RowRemark("departure", text, word)
    for word in KINDS:
        claim = claimed.get(word)
        if claim is None or claim.channel not in flight:
            continue
        try:
            motion = measure_free_motion(claim, flight.time, flight[claim.channel])
        except Invalid:
            # the row reports the error of the record
            continue
        found = KINDS[0] if motion.overshoots.size else KINDS[1]
        if found != word:
            text = f"departure: {word} is claimed, and the motion of the record is {found}"
            yield RowRemark("departure", text, word)


def _check_configuration(flown: FlownCase) -> str:
    """Return why the configuration at the start is none of those of the row; empty if it is."""
    case = flown.case
    try:
        words = case.printed_rows()[0]["flight_condition"]
    except UnknownName:
        raise NotChecked("the table has no such test", is_ours=True) from None
    if words == ANY:
        return ""
    allowed = CONFIGURATIONS.get(words, ())
    if not allowed:
        raise NotChecked(f"flight condition {words.replace('_', ' ')}", is_ours=True)
    found = []
    missing = []
    for name in allowed:
        try:
            failure = CONFIGURATION_CHECKS[name](flown)
        except NotChecked as reason:
            missing.append(str(reason))
            continue
        if not failure:
            return ""
        found.append(failure)
    if missing:
        raise NotChecked("; ".join(dict.fromkeys(missing)))
    return f"flown with {' and '.join(dict.fromkeys(found))}; the row has {words.replace('_', ' ')}"
