"""Values that a record repeats while its channel should move, before a match."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import xarray as xr

from aeromatch.planning.record_faults.gap_checks import Spans
from flightmech.quantities import time_text
from flighttest.reconstruction.quality.checks.held_values import held_values, stuck_findings
from pom.cases.case import PomCase

_EFFECT = "fits leave these samples out, and a case with them shows no flight"


def held_departures(
    name: str, record: xr.DataTree, cases: Sequence[PomCase], spans: Mapping[str, Spans]
) -> list[str]:
    """Return a line for every channel that repeats its value, for a time or throughout.

    Parameters
    ----------
    name : str
        Name of the record.
    record : DataTree
    cases : sequence of PomCase
        Cases that replay the record.
    spans : mapping of str to sequence of (float, float)
        Windows that identify something, by fit or position of a submodel. [s]
    """
    lines = []
    for flag in held_values(record):
        span = flag.start, flag.stop
        users = [f"case {case.name}" for case in cases if _overlaps(case.window, span)]
        for user, windows in spans.items():
            if any(_overlaps(window, span) for window in windows):
                users.append(user)
        used = f" (in {', '.join(users)})" if users else ""
        lines.append(
            f"record {name}: {flag.channel} repeats its value from {time_text(span[0])} to "
            f"{time_text(span[1])} s"
            f"{used}; {_EFFECT}; choose windows without it, or map a column that moves"
        )
    for finding in stuck_findings(record):
        if finding.severity == "error":
            lines.append(f"record {name}: {finding.text}; {finding.remedy}")
    return lines


def _overlaps(window: tuple[float, float], span: tuple[float, float]) -> bool:
    return window[0] <= span[1] and span[0] <= window[1]
