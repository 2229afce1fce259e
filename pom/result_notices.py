"""Remarks of a result that stand next to its verdicts, as texts for page, terminal and files."""

from __future__ import annotations

from itertools import chain

from flightmech.support.console import count_text
from pom.result import PomResult
from pom.status import (
    BEYOND,
    CASE_WINDOW,
    DEPARTURES,
    NOT_CHECKED,
    NOTICES,
    OTHER_AIRCRAFT,
    PASSED,
    RECORDING_FAULT,
    UNCHECKED,
    UNPROBED,
    has_remark,
)


def trim_remarks(result: PomResult, run: str) -> list[str]:
    """Return the remarks on a trim beyond its limits, each once."""
    return collect_texts(result, run, ("trim",))


def record_remarks(result: PomResult, run: str) -> list[str]:
    """Return the errors of the flight record of a result, each once."""
    return collect_texts(result, run, ("record",))


def departure_remarks(result: PomResult, run: str) -> list[str]:
    """Return the departures of a result from the printed row, each once."""
    return collect_texts(result, run, DEPARTURES)


def unchecked_text(result: PomResult, run: str) -> str:
    """Return how many conditions of the row and probes are not checked; empty without one."""
    counts = []
    for kind, word in ((UNCHECKED, "condition"), (UNPROBED, "probe")):
        count = len(collect_texts(result, run, (kind,)))
        if count:
            counts.append(count_text(count, word))
    return f"{', '.join(counts)} not checked" if counts else ""


def unprobed_text(result: PomResult, run: str) -> str:
    """Return the probes of a pass that were not made, with their reasons; empty without one.

    Probes that were not made for one reason share it.
    """
    probes: dict[str, list[str]] = {}
    for text in collect_texts(result, run, (UNPROBED,)):
        probe, _, reason = text.removeprefix(NOT_CHECKED).partition(" (")
        probes.setdefault(reason, []).append(probe)
    texts = [f"{', '.join(names)} ({reason}" for reason, names in probes.items()]
    return f"{NOT_CHECKED}{'; '.join(texts)}" if texts else ""


def run_notices(result: PomResult, run: str) -> list[str]:
    """Return the remarks of the kinds `NOTICES`, which no criterion judges, each once."""
    return collect_texts(result, run, NOTICES)


def input_notices(result: PomResult, run: str) -> list[str]:
    """Return the departures of inputs that can be why a case fails, each once.

    They are those of the window of a case, the recording of a device and the aeroplane of a model.
    """
    kinds = (CASE_WINDOW, RECORDING_FAULT, OTHER_AIRCRAFT)
    texts: dict[str, None] = {}
    for row in result.rows:
        if row["run"] == run:
            remarks = [item.text for item in row["remarks"] if item.quantity in kinds]
            texts |= dict.fromkeys(remarks)
    return list(texts)


def spread_notice(result: PomResult, run: str) -> str:
    """Return `SampledReplay.unexplained` of the draws of a model; empty without draws."""
    samples, worst = result.samples.get(run), result.worst(run)
    if samples is None or worst is None:
        return ""
    ratios = {row["criterion"]: row["worst_ratio"] for row in result.rows if row["run"] == run}
    return samples.unexplained(ratios, worst["criterion"])


NO_EVIDENCE = (
    "no evidence given: a pass without evidence from flight does not exclude compensating errors"
)
"""Notice on results of which `lacks_evidence` is true."""


def is_beyond_master(result: PomResult) -> bool:
    """Return whether a run of a result is beyond its criterion about the master."""
    return any(has_remark(row, BEYOND) for row in result.rows)


def lacks_evidence(result: PomResult) -> bool:
    """Return whether a model of a result passes and was not compared with flight evidence."""
    for run in result.runs:
        if result.status(run) not in PASSED:
            continue
        own = (row["remarks"] for row in result.rows if row["run"] == run)
        kinds = {item.kind for item in chain.from_iterable(own)}
        if not kinds & {"evidence", "no_evidence"}:
            return True
    return False


def collect_texts(result: PomResult, run: str, kinds: tuple[str, ...]) -> list[str]:
    """Return the remarks of some kinds on a run, each once."""
    # a dictionary keeps the order of the remarks and drops repeated texts
    texts: dict[str, None] = {}
    for row in result.rows:
        if row["run"] != run:
            continue
        for remark in row["remarks"]:
            if remark.kind in kinds:
                texts[remark.text] = None
    return list(texts)


def is_additional(result: PomResult) -> bool:
    """Return whether the case states itself as additional: in another configuration than its
    row.
    """
    remarks = chain.from_iterable(row["remarks"] for row in result.rows)
    return any(remark.kind == "additional" for remark in remarks)
