"""One model of a report against itself: the same file in all cases.

A report is the proof of one model.  Reports can be joined, and a name is not a model: another FMU
for each case would pass everywhere.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import chain

from pom.result import PomResult
from pom.tolerances.bands import RowRemark

MODEL = "model"  # quantity of the remark
_FLOWN = re.compile(r", FMI .*sha256 ([0-9a-f]{64})")
"""Attribute of an FMU (`pom.fmu.models.FmuModel.origin`); recordings are of one case each."""


def identity_remarks(results: Sequence[PomResult]) -> list[dict[str, tuple[RowRemark, ...]]]:
    """Return the departures of cases whose model is another file than in most cases, by model.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of dict of str to tuple of RowRemark
        Per result.  Of two files with equally many cases the first one counts.
    """
    found: list[dict[str, tuple[RowRemark, ...]]] = [{} for _ in results]
    for run in dict.fromkeys(chain.from_iterable(result.runs for result in results)):
        hashes = [_flown_hash(result, run) for result in results]
        counts = Counter(filter(None, hashes))
        if len(counts) < 2:
            continue
        # most_common keeps the order of the cases
        (most, number), *_ = counts.most_common()
        for k, digest in enumerate(hashes):
            if digest and digest != most:
                plural = "s" if number > 1 else ""
                text = (
                    f"departure: model {run} is another file here (sha256 {digest[:12]}) than in "
                    f"{number} case{plural} of the report ({most[:12]}); fly all cases by one file, or "
                    f"give each model its name"
                )
                found[k][run] = (RowRemark("departure", text, MODEL),)
    return found


def _flown_hash(result: PomResult, run: str) -> str:
    """Return the hash of the FMU of a run; empty for a recording or an older result."""
    if run not in result.runs:
        return ""
    match = _FLOWN.search(str(result.signals.attrs.get(f"model.{run}", "")))
    return match[1] if match else ""
