"""Names of the replays and of the files of a match, which its plan prints before any work."""

from __future__ import annotations

from flightmech.support.console import count_text

REPORT = "report"
"""Folder of the report."""
COMPARED = "tables_compared.csv"
"""File of the comparison of the tables."""


def replay_step(cases: int, fmus: int, devices: int) -> str:
    """Return the name of the step that replays the cases.

    Examples
    --------
    >>> replay_step(4, 3, 0), replay_step(4, 3, 1)
    ('replay 4 cases by 3 FMUs', 'replay 4 cases by 3 FMUs and 1 device')
    """
    text = f"replay {cases} cases by {fmus} FMUs"
    return f"{text} and {count_text(devices, 'device')}" if devices else text
