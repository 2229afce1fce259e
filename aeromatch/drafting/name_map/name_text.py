"""Text of a drafted name map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aeromatch.drafting.name_map.names import NamesDraft
from aeromatch.drafting.sources import quote
from aeromatch.project.schemas import schema_lines
from flightmech.names import lookup
from flighttest.records.readers.channel_correction import line_of
from flighttest.records.readers.name_map import Clock

_BENCH = (
    '# delta_e = { column = "actuator_servos/control[2]", unit = "deg", table = [[-1, 21.5], '
    "[0, 0.8], [1, -24.0]] }",
    '# A demand that the actuator follows late: lag = "-0.05 s" makes it the position.',
)
# Facts that the author may add, each with an example.
_EXAMPLES = {"latitude": '"45 deg"', "runway_elevation": '"120 m"'}
LEFT_OUT = "# Columns without a quantity:"
"""First line of the comment about columns without a channel, at the end of the text."""
# Begin of each line of this comment.
_LEFT_OUT_LINE = "#   "
# Files that the head of the text names.
_MOST_FILES = 3


def names_text(draft: NamesDraft, files: Sequence[Path]) -> str:
    """Return a draft as the text of a name map."""
    names = ", ".join(file.name for file in files[:_MOST_FILES])
    if len(files) > _MOST_FILES:
        names += " and others"
    lines = [
        *schema_lines("names"),
        f"# Name map of {names}.",
        "# Drafted by `aeromatch init` from the names and sizes of the columns: confirm "
        "units, signs, then run `aeromatch flight check`.",
        "# Keys of a channel: column, unit, sign, scale, offset, polynomial, table, delay, "
        "lag, optional (`aeromatch schema names`).",
    ]
    if draft.extends:
        lines += [f'extends = "{draft.extends}"', ""]
    lines += ["", "[record]"]
    for key, value in draft.facts.items():
        lines.append(f"{key} = {_fact(key, value)}")
    for key, example in _EXAMPLES.items():
        if key not in draft.facts:
            lines.append(f"# {key} = {example}")
    lines += _constant_lines(draft)
    if draft.extends:
        head = (
            "# [controls]                      # bench table of each surface: demand against angle"
        )
        lines += ["", head, *_BENCH]
    lines += [*_clock_lines(draft), *_channel_lines(draft)]
    if draft.left_out:
        lines += ["", LEFT_OUT]
        lines += [f"{_LEFT_OUT_LINE}{item.column}: {item.reason}" for item in draft.left_out]
    return "\n".join(lines) + "\n"


def without_left_out(text: str) -> str:
    """Return the text of a name map without the comment about columns without a channel.

    Keys between and below the lines of the comment stay.

    Examples
    --------
    >>> without_left_out('p = "P"\\n# Columns without a quantity:\\n#   E: not known\\nq = "Q"\\n')
    'p = "P"\\nq = "Q"\\n'
    """
    head, mark, tail = text.partition(LEFT_OUT)
    if not mark:
        return text
    lines = tail.removeprefix("\n").splitlines(keepends=True)
    return head + "".join(line for line in lines if not line.startswith(_LEFT_OUT_LINE))


def _constant_lines(draft: NamesDraft) -> list[str]:
    if not draft.constants:
        return []
    head = "[constants]   # channels that no column shows and that did not change; CONFIRM"
    lines = ["", head]
    for name, value in draft.constants.items():
        quantity = lookup(name)
        lines.append(f"{name} = {value:.6g}   # {quantity.long_name} [{quantity.units}]")
    return lines


def _clock_lines(draft: NamesDraft) -> list[str]:
    """Return the clock of the file, and the clocks of tables with different time stamps."""
    lines: list[str] = []
    if draft.clock != Clock():
        *first, last = _clock_keys(draft.clock)
        lines += ["", "[time]", *first, f"{last}   # {draft.clock_reason}"]
    for table, clock in draft.clocks.items():
        lines += ["", f"[time.{quote(table)}]", *_clock_keys(clock)]
    return lines


def _clock_keys(clock: Clock) -> list[str]:
    """Return the lines of a drafted clock."""
    lines = []
    if clock.column:
        lines += [f"column = {quote(clock.column)}", f"unit = {quote(str(clock.unit))}"]
    if clock.rate:
        lines.append(f'rate = "{clock.rate:.12g} Hz"')
    return lines


def _channel_lines(draft: NamesDraft) -> list[str]:
    lines: list[str] = []
    leaf = ""
    for row in draft.rows:
        # The rows are sorted by leaf.
        if row.leaf != leaf:
            leaf = row.leaf
            lines += ["", f"[{leaf}]"]
        comment = lookup(row.name).long_name
        if row.reason:
            comment += f"; {row.reason}"
        lines.append(f"{line_of(row.name, row.channel)}   # {comment}")
    return lines


def _fact(key: str, value: Any) -> str:
    """Return a fact in a unit that a reader can check."""
    if key == "latitude":
        return f'"{np.degrees(value):.6g} deg"'
    if key == "temperature":
        return f'"{value:.6g} K"'
    if isinstance(value, str):
        return quote(value)
    return f"{value:.8g}"
