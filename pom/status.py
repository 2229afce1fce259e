"""Status of a case and one model: verdicts of its groups, kinds of remarks, one word of all."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import Any

from pom.cases.case import PomCase
from pom.tolerances.bands import RowRemark

BEYOND = "recurrent_beyond"
"""Kind of the remark on a run beyond its criterion about the master."""
UNCHECKED = "not_checked"
"""Kind of the remark on a condition of the row that the program does not check."""
UNPROBED = "not_probed"
"""Kind of the remark on a probe of a pass that was not made, with its reason."""
NOT_CHECKED = "not checked: "
"""Start of the text of the remarks `UNCHECKED` and `UNPROBED`."""
CASE_WINDOW = "case.window"
"""Quantity of the remarks on a window that starts or ends wrongly."""
RECORDING_FAULT = "device.recording"
"""Quantity of the remarks on a recording of a device that is not of this flight."""
OTHER_AIRCRAFT = "aircraft"
"""Quantity of the remarks on a model of another aeroplane than that of the case."""
DEPARTURES = (
    "departure",
    "trim_allowed",
    "waived",
    "tables_left",
    "envelope_left",
    "below_runway",
    BEYOND,
)
"""Kinds of remarks that make a pass a ``pass_with_departures``."""
NOTICES = (
    *DEPARTURES,
    "additional",
    "record",
    "record_warning",
    "leak",
    "not_driven",
    "recurrent",
    "watch",
    "low_confidence",
    "far_from_evidence",
    "edited_evidence",
    "no_evidence",
    UNCHECKED,
)
"""Kinds of remarks that index, page and terminal show next to the verdict.

``departure`` is a departure of the case from the printed row (`pom.judging.departures`),
``trim_allowed`` a trim beyond its limits that the case file allows, ``waived`` inputs that the
model does not have, ``tables_left`` tables that the flight left, ``envelope_left`` a run beyond
the validity envelope of its model (`pom.judging.envelope_remarks`), ``below_runway`` a model that
sank through the runway.  ``additional`` is a case in another configuration that states itself so,
``record`` an error and ``record_warning`` a warning of the flight record, ``leak`` samples of the
record that identified the model, ``not_driven`` an answer that the inputs do not drive
(`pom.probing`), ``watch`` a watched channel beyond its limit, ``recurrent`` and
``recurrent_beyond`` the comparison of a run with its master (`pom.replaying.recorded_runs`),
``low_confidence`` a run where no flight supports the model, ``far_from_evidence`` terms far from
their flight estimate, ``no_evidence`` a model without terms to compare with it, ``not_checked`` a
condition that the program does not check.
"""
VERDICTS = ("pass", "fail", "invalid", "not_tested", "advisory", "demonstration")
STATUSES = (
    "pass",
    "pass_with_departures",
    "limits_exceeded",
    "record_error",
    "leak",
    "not_driven",
    "demonstration",
    "fail",
    "invalid",
    "not_tested",
)
"""Statuses of a case and one model, from best to worst.

``pass_with_departures`` is a pass of a case that departs from the printed row.
``limits_exceeded`` is a pass with a trim beyond its limits.  ``record_error`` is a pass against a
flight record in which a check found an error.  ``leak`` is a pass against a record whose samples
identified the model.  ``not_driven`` is a pass of a model whose answer the inputs do not drive.
``demonstration`` is a case whose curves are shown without a tolerance: neither a pass nor a fail.
"""

PASSED = STATUSES[:6]
"""Statuses of a case in which every criterion passes."""


_FROM_BEST = ("pass", "advisory", "demonstration", "fail", "not_tested", "invalid")
"""Order of verdicts within a group: the first one decides."""


def group_verdicts(case: PomCase, verdicts: Mapping[str, str]) -> dict[str, str]:
    """Return the verdict of every group of a case that applies, from verdicts by criterion.

    A precondition that holds proves nothing and does not count.  A precondition that does not hold
    makes the case invalid.
    """
    groups: dict[str, str] = {}
    for criterion in case.criteria:
        verdict = verdicts.get(criterion.name)
        if not criterion.applies or not verdict:
            continue
        if criterion.measure == "setup" and verdict == "pass":
            continue
        best = groups.get(criterion.group, verdict)
        groups[criterion.group] = min(best, verdict, key=_FROM_BEST.index)
    return groups


def judged_groups(groups: Mapping[str, str]) -> dict[str, str]:
    """Return the groups without those that are not tested, if another one is judged.

    What a case does not test shows nothing about the terms of a model: a diagnosis and a tuning go
    by the other groups.  The status of the case counts all groups.
    """
    unjudged = ("not_tested", "demonstration")
    judged = {name: verdict for name, verdict in groups.items() if verdict not in unjudged}
    if {"pass", "fail", "invalid"} & set(judged.values()):
        return judged
    return dict(groups)


def status_of(
    groups: Mapping[str, str],
    limits_exceeded: bool = False,
    record_error: bool = False,
    departures: bool = False,
    leak: bool = False,
    not_driven: bool = False,
) -> str:
    """Return the status of a case as `PomResult.status` defines it.

    Parameters
    ----------
    groups : mapping of str to str
        Verdict of every group that applies.
    limits_exceeded : bool
        The trim is beyond its limits.
    record_error : bool
        The flight record has an error.
    departures : bool
        The case departs from the printed row.
    leak : bool
        Samples of the record identified the model.
    not_driven : bool
        The inputs do not drive the answer of the model.
    """
    verdicts = set(groups.values())
    # the worst verdict of a group decides; what is shown without a tolerance proves nothing
    for verdict in ("invalid", "fail", "not_tested", "demonstration"):
        if verdict in verdicts:
            return verdict
    if "pass" not in verdicts:
        return "not_tested"
    if not_driven:
        return "not_driven"
    if leak:
        return "leak"
    if record_error:
        return "record_error"
    if limits_exceeded:
        return "limits_exceeded"
    if departures:
        return "pass_with_departures"
    return "pass"


def status_text(status: str) -> str:
    """Return a status as a terminal prints it: in capitals unless it is a kind of pass."""
    short_texts = {
        "pass": "pass",
        "pass_with_departures": "pass with departures",
        "limits_exceeded": "LIMITS",
        "record_error": "RECORD",
        "leak": "LEAK",
        "not_driven": "NOT DRIVEN",
    }
    return short_texts.get(status, status.upper())


def unprobed_remark(probe: str, reason: str, quantity: str = "") -> RowRemark:
    """Return the remark on a probe that was not made.

    Examples
    --------
    >>> unprobed_remark("late inputs", "no control moves").text
    'not checked: late inputs (no control moves)'
    """
    return RowRemark(UNPROBED, f"{NOT_CHECKED}{probe} ({reason})", quantity)


def has_trim_remark(row: Mapping[Hashable, Any]) -> bool:
    """Return whether a row of the verdict table has a remark on a trim beyond its limits."""
    return any(remark.kind == "trim" for remark in row["remarks"])


def has_departure(row: Mapping[Hashable, Any]) -> bool:
    """Return whether a row of the verdict table has a departure from the printed row."""
    return any(remark.kind in DEPARTURES for remark in row["remarks"])


def is_on_faulty_record(row: Mapping[Hashable, Any]) -> bool:
    """Return whether a row of the verdict table has an error of the flight record."""
    return has_remark(row, "record")


def has_remark(row: Mapping[Hashable, Any], kind: str) -> bool:
    """Return whether a row of the verdict table has a remark of a kind."""
    return any(remark.kind == kind for remark in row["remarks"])


def ratio_shows_verdict(row: Mapping[Hashable, Any]) -> bool:
    """Return whether the ratio of a verdict row shows its verdict.

    A failure within the tolerance has another reason, such as a mode that grows where that of the
    flight decays.
    """
    ratio = float(row["worst_ratio"])
    return math.isfinite(ratio) and not (row["verdict"] == "fail" and ratio <= 1.0)
