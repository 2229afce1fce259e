"""One model of a report against itself: the same file in all cases.

A report is the proof of one model.  Reports can be joined, and a name is not a model: another FMU
for each case would pass everywhere.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import chain

from flightmech.support.console import count_text
from pom.result import PomResult
from pom.tolerances.bands import RowRemark

MODEL = "model"  # quantity of the remark
_FLOWN = re.compile(r", FMI .*sha256 ([0-9a-f]{64})")
"""Attribute of an FMU (`pom.fmu.models.FmuModel.origin`); recordings are of one case each."""


def identity_remarks(results: Sequence[PomResult]) -> list[dict[str, tuple[RowRemark, ...]]]:
    """Return the departures of cases whose model is another file in other cases, by model.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of dict of str to tuple of RowRemark
        Per result.  All cases of such a model depart: none of its files is proven by the report.
    """
    found: list[dict[str, tuple[RowRemark, ...]]] = [{} for _ in results]
    for run in dict.fromkeys(chain.from_iterable(result.runs for result in results)):
        hashes = [_flown_hash(result, run) for result in results]
        counts = Counter(filter(None, hashes))
        if len(counts) < 2:
            continue
        for k, digest in enumerate(hashes):
            if digest:
                others = count_text(counts.total() - counts[digest], "other case")
                text = (
                    f"departure: model {run} (sha256 {digest[:12]}) is another file in {others} of "
                    f"the report; fly all cases by one file, or give each model its name"
                )
                found[k][run] = (RowRemark("departure", text, MODEL),)
    return found


def _flown_hash(result: PomResult, run: str) -> str:
    """Return the hash of the FMU of a run; empty for a recording or an older result."""
    if run not in result.runs:
        return ""
    match = _FLOWN.search(str(result.signals.attrs.get(f"model.{run}", "")))
    return match[1] if match else ""
