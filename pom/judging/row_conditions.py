"""Conditions that a row of the tolerance table states for the flight, on one case.

A condition that does not hold is a departure.  A condition that cannot be checked, because record
or aircraft file lack what it needs, is a remark of the kind ``not_checked``.
`pom.tolerances.stated_conditions` lists the conditions, `pom.judging.report_conditions` checks
those over several cases.
"""

from __future__ import annotations

from collections.abc import Iterator

from flightmech.errors import UnknownName
from pom.cases.case import PomCase
from pom.cases.case_facts import REVERSIBLE
from pom.cases.case_file import FORCES
from pom.judging.condition_checks import CHECKS, CONFIGURATION_CHECKS, FlownCase, NotChecked
from pom.judging.measures.control_release import measure_free_motion
from pom.judging.signals import RunSignals
from pom.judging.stall_checks import STALL_CHECKS
from pom.tolerances.bands import Invalid, RowRemark
from pom.tolerances.conditions import KINDS
from pom.tolerances.criteria import Criterion
from pom.tolerances.stated_conditions import (
    ANY,
    CONFIGURATIONS,
    StatedCondition,
    conditions_of,
)

CASE_CHECKS = {**CHECKS, **STALL_CHECKS}
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
        ``departure`` for a condition that does not hold, ``not_checked`` for one that is not
        checked, ``additional`` for a stated other configuration.
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
            text = f"not checked: {condition.text} ({reason})"
            remarks.append(RowRemark("not_checked", text, condition.name))
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
        raise NotChecked("the program has no check of it")
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
        raise NotChecked("the table has no such test") from None
    if words == ANY:
        return ""
    allowed = CONFIGURATIONS.get(words, ())
    if not allowed:
        raise NotChecked(f"flight condition {words.replace('_', ' ')}")
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
