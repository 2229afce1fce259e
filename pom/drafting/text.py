"""The text of a new case file, with comments on what may be changed and what the rows demand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..tolerances.criteria import Criterion

if TYPE_CHECKING:
    from .case_draft import Draft

_COMMENTS = {
    "name": "for files and links",
    "window": "[s] on the clock of the record; start in a steady state",
    "engine_parameter": "critical engine parameter of Ti and Tt",
    "surfaces": "recorded: surface positions; cockpit: column, wheel, pedals; force: pilot forces; pilot: loops of [[drive.pilot]]",
    "engine": "thrust: recorded thrust; n1: recorded fan speed; throttle: recorded lever",
    "trim": 'true: trimmed to the flight condition; false; "ground": on its wheels',
}
_OPTIONAL = """
# Of the optional tables, with invented values; docs/pom-cases.md has them all.
# [conditions]                 # against the record: inputs held constant, initial state, mass, air
# delta_f = "40 deg"
# [tolerance]                  # replaces the band of a row, or adds one
# theta = "1.5 deg"
# [rationale]                  # by criterion or channel, printed in the report
# theta = "why it leaves the band"
# [source]
# document = "flight-test report, page"
"""


def case_text(draft: Draft, criteria: Sequence[Criterion]) -> str:
    """Return a draft as the text of a case file.

    Parameters
    ----------
    draft : Draft
    criteria : sequence of Criterion
        Of the very case, for the comments.
    """
    lines = [
        "#:schema case.schema.json",
        "# `aeromatch pom schema` writes this schema; an editor that knows it completes and checks the keys.",
        "",
    ]
    lines += ["[case]", *(_line(key, draft.case[key]) for key in _ORDER if key in draft.case)]
    if criteria:
        words = sorted({word for c in criteria if not c.applies for word in c.reason.removeprefix("applies only with ").split(", ")})
        lines += [f"# features = [...]   rows that wait for a condition: {', '.join(words)}"] if words else []
    lines += ["", "[drive]", *(_line(key, value) for key, value in draft.drive.items())]
    if draft.conditions:
        lines += ["", "[conditions]", *(_line(key, value) for key, value in draft.conditions.items())]
    if draft.events:
        lines += ["", "[events]  # [s]"]
        lines += [
            f"{_key(key)} = {time:g}{'' if found else '   # NOT FOUND in the record: set it'}"
            for key, (time, found) in draft.events.items()
        ]
    return "\n".join(lines) + "\n" + _rows(criteria) + _OPTIONAL


_ORDER = (
    *("id", "standard", "edition", "name", "title", "description", "record", "names", "aircraft", "window", "shortened"),
    "engine_parameter",
)


def _line(key: str, value: object) -> str:
    comment = f"   # {_COMMENTS[key]}" if key in _COMMENTS else ""
    return f"{key} = {json.dumps(value, ensure_ascii=False)}{comment}"


def _key(name: str) -> str:
    return name if name.replace("_", "").isalpha() else json.dumps(name)


def _rows(criteria: Sequence[Criterion]) -> str:
    """Return the rows that will be judged, as comments."""
    if not criteria:
        return ""
    lines = ["", "# What is judged (rows of one group are alternatives, different groups must all pass):"]
    for c in criteria:
        window = f"{c.window[0]:g} ... {c.window[1]:g} s"
        lines.append(f"#   {c.name}: {c.band.text or 'no number'}, {c.measure} of {c.channel or 'no channel'}, {window}, group {c.group}")
        lines.append(f"#       {c.provenance}: {c.source}{'; ' + c.note if c.note else ''}{'; ' + c.reason if c.reason else ''}")
    return "\n".join(lines) + "\n"
