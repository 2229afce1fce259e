"""Draft of a case, and its text as a commented case file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from flightmech.quantities import time_text
from pom.tolerances.criteria import Criterion


@dataclass(frozen=True)
class Draft:
    """Content of a new case file, and remarks for its author.

    Attributes
    ----------
    case : dict
        Table ``[case]``: key to value.
    drive : dict
        Table ``[drive]``.
    conditions : dict of str to str
        Values with units.
    events : dict of str to (float, bool)
        Time [s] of every event, and whether the record shows it.
    remarks : list of str
        Events and channels that the record does not show.
    """

    case: dict[str, object]
    drive: dict[str, object]
    conditions: dict[str, str] = field(default_factory=dict)
    events: dict[str, tuple[float, bool]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


# Comment behind a key of the case file
_COMMENTS = {
    "name": "for files and links",
    "window": "[s] on the clock of the record; start in a steady state",
    "engine_parameter": "critical engine parameter of Ti and Tt",
    "surfaces": "recorded: surface positions; cockpit: column, wheel, pedals; force: pilot "
    "forces; pilot: loops of [[drive.pilot]]",
    "engine": "thrust: recorded thrust; n1, torque, map, rpm: recorded fan speed, shaft torque, "
    "manifold pressure, propeller speed; throttle: recorded lever",
    "propeller": "lever: the governor holds the speed of its lever; rpm: the recorded speed",
    "trim": 'true: trimmed to the flight condition; false; "ground": on its wheels',
}
_OPTIONAL = """
# Examples of the optional tables, with invented values.
# docs/explanation/proof-of-match/cases.md has them all.
# [conditions]                 # against the record: inputs held constant, initial state, mass, air
# delta_f = "40 deg"
# [tolerance]                  # replaces the band of a row, or adds one
# theta = "1.5 deg"
# [rationale]                  # by criterion or channel, printed in the report
# theta = "why it leaves the band"
# [source]
# document = "flight-test report, page"
"""
# Order of the keys of [case]
_ORDER = (
    "id",
    "standard",
    "edition",
    "name",
    "title",
    "description",
    "record",
    "names",
    "aircraft",
    "window",
    "shortened",
    "engine_parameter",
)


def draft_text(draft: Draft, criteria: Sequence[Criterion]) -> str:
    """Return a draft as the text of a case file.

    Parameters
    ----------
    draft : Draft
    criteria : sequence of Criterion
        Criteria of the same case, for the comments.
    """
    lines = [
        "#:schema case.schema.json",
        "# `aeromatch pom schema` writes this schema; an editor that knows it completes and "
        "checks the keys.",
        "",
        "[case]",
    ]
    lines += _key_lines({key: draft.case[key] for key in _ORDER if key in draft.case})
    lines += _feature_lines(criteria)
    lines += ["", "[drive]", *_key_lines(draft.drive)]
    if draft.conditions:
        lines += ["", "[conditions]", *_key_lines(draft.conditions)]
    if draft.events:
        lines += ["", "[events]  # [s]"]
    for name, (time, is_shown) in draft.events.items():
        # The engineer has to see which times are only placeholders.
        comment = "" if is_shown else "   # NOT FOUND in the record: set it"
        lines.append(f"{_quote_key(name)} = {time_text(time)}{comment}")
    return "\n".join(lines) + "\n" + _criteria_comments(criteria) + _OPTIONAL


def _key_lines(table: Mapping[str, object]) -> list[str]:
    """Return the lines of a table, with the comment of each key."""
    lines = []
    for key, value in table.items():
        comment = f"   # {_COMMENTS[key]}" if key in _COMMENTS else ""
        lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}{comment}")
    return lines


def _quote_key(name: str) -> str:
    """Return a TOML key; in quotes if it is not a bare key of letters."""
    if name.replace("_", "").isalpha():
        return name
    return json.dumps(name)


def _feature_lines(criteria: Sequence[Criterion]) -> list[str]:
    """Return the comment on features that would make more rows apply; none without such rows."""
    features: set[str] = set()
    for criterion in criteria:
        if not criterion.applies:
            # the reason lists the missing features
            features.update(criterion.reason.removeprefix("applies only with ").split(", "))
    if not features:
        return []
    names = ", ".join(sorted(features))
    return [f"# features = [...]   rows that wait for a condition: {names}"]


def _criteria_comments(criteria: Sequence[Criterion]) -> str:
    """Return the judged rows as comments."""
    if not criteria:
        return ""
    lines = [
        "",
        "# What is judged (rows of one group are alternatives, different groups must all pass):",
    ]
    for criterion in criteria:
        window = f"{time_text(criterion.window[0])} ... {time_text(criterion.window[1])} s"
        lines.append(
            f"#   {criterion.name}: {criterion.band.text or 'no number'}, {criterion.measure} of "
            f"{criterion.channel or 'no channel'}, {window}, group {criterion.group}"
        )
        # note and reason may be empty, the source is always printed
        remarks = filter(None, (criterion.note, criterion.reason))
        origin = "; ".join((criterion.source, *remarks))
        lines.append(f"#       {criterion.provenance}: {origin}")
    return "\n".join(lines) + "\n"
