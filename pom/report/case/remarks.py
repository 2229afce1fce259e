"""Texts next to the verdicts: what the case sets, remarks of rows, rationales, engineers' ticks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pom.cases.case import PomCase
from pom.result import PomResult
from pom.tolerances.rows import rows

from ..presentation.quantities import has_ends, label, measured, short
from ..presentation.verdict_text import MARKS, MODAL, remark_text, words

IN_MODE_TABLE = ("values", "cycles", "no_mode")
"""Kinds of remarks that only repeat what stands in the table of modes."""

_REFERENCES = {
    "engineering": "The reference is an engineering simulator, not a flight; {share} of the flight tolerance is applied.",
    "footprint": "Footprint: the response of the device itself, kept for later comparison; no band is drawn and nothing is judged.",
}


def notes(result: PomResult) -> list[str]:
    """Return what the reader must know in addition to the verdicts."""
    case = result.case
    found = [case.notes] if case.notes else []
    if case.reference in _REFERENCES:
        found.append(_REFERENCES[case.reference].format(share=share(case.fraction)))
    elif case.fraction != 1.0:
        found.append(f"{share(case.fraction)} of the tolerance is applied, as the case file states.")
    if case.shortened:
        found.append(f"The window is shorter than the table requires: {case.shortened}.")
    if case.conditions:
        given = ", ".join(f"{label(name).words or name} {_given(value, name)}" for name, value in case.conditions.items())
        found.append(f"From the case file, not from the record: {given}.")
    found += list(dict.fromkeys(remark.text for row in result.rows for remark in row["remarks"] if remark.kind == "record"))
    found += _of_rows(result)
    marks = sorted({MARKS[p] for p in result.verdict["provenance"] if p in ("memory", "partial")})
    if marks:
        found.append(f"Rows marked “{'” or “'.join(marks)}” were not read word for word in the regulation; check them there first.")
    return list(dict.fromkeys(found))


def objective(case: PomCase) -> str:
    """Return the objective of a case: that of the case file, else what its entry of the tolerance table compares."""
    if case.objective:
        return case.objective
    judged = ", ".join(dict.fromkeys(words(criterion.name) for criterion in case.criteria if criterion.applies))
    title = next((row["title"] for row in rows() if (row["standard"], row["test_id"]) == (case.standard, case.id)), case.title)
    if case.reference == "footprint":
        return f"{title}: {judged} of the device, kept for later comparison."
    other = "an engineering simulator" if case.reference == "engineering" else "flight"
    return f"{title}: {judged} of the models against {other}, within the tolerances of {case.id}."


def share(fraction: float) -> str:
    """Return a fraction of the tolerance as printed.

    Examples
    --------
    >>> share(0.2)
    '20 %'
    """
    return f"{short(100.0 * fraction)} %"


def _of_rows(result: PomResult) -> list[str]:
    """Return the remarks of the verdict rows, each once, behind the criteria and models it is about."""
    places: dict[str, list[tuple[str, str]]] = {}
    longest: dict[str, list[str]] = {}
    for row in result.rows:
        fitted = row["measure"] in MODAL and row["verdict"] in ("pass", "fail")
        for remark in row["remarks"]:
            if remark.kind == "outside":
                longest.setdefault(row["run"], []).append(f"{words(row['criterion'])} {remark.values['longest']:.2f} s")
            elif remark.kind != "record" and not (fitted and remark.kind in IN_MODE_TABLE):
                places.setdefault(remark_text(remark), []).append((words(row["criterion"]), row["run"]))
    found: dict[str, list[str]] = {}
    for text, where in places.items():
        found.setdefault(_where(where, result), []).append(text)
    spans = [f"{run}, longest run outside: {', '.join(texts)}" for run, texts in longest.items()]
    return [*spans, *(f"{where}: {'; '.join(texts)}" for where, texts in found.items())]


def _given(value: float, name: str) -> str:
    """Return a value as somebody set it, without trailing zeros."""
    shown = label(name)
    if has_ends(name):
        return measured(value, name)
    return f"{short(float(shown.shown(value)))}\N{NO-BREAK SPACE}{shown.unit}".rstrip("\N{NO-BREAK SPACE}")


def _where(found: Sequence[tuple[str, str]], result: PomResult) -> str:
    """Return what a remark is about: criteria and models, each left out when it is all of them."""
    criteria, runs = list(dict.fromkeys(c for c, _ in found)), list(dict.fromkeys(r for _, r in found))
    every = len(criteria) == result.verdict["criterion"].nunique() and len(runs) < len(result.runs)
    parts = ([] if every else criteria) + ([] if len(runs) == len(result.runs) else runs)
    return ", ".join(parts or criteria)


def rationales(result: PomResult) -> list[tuple[str, str]]:
    """Return how the case file explains criteria or channels: (what, why)."""
    return [(label(name).words or words(name), why) for name, why in result.case.rationale.items()]


def ticks(result: PomResult) -> list[dict[str, Any]]:
    """Return the criteria that an engineer judges, with the tick of the case file where there is one."""
    wanted = result.verdict.loc[result.verdict["verdict"] == "advisory", "criterion"]
    names = dict.fromkeys([*wanted, *result.case.ticks])
    return [{"criterion": words(name), "tick": result.case.ticks.get(name, "")} for name in names]


def data_source(result: PomResult) -> list[tuple[str, str]]:
    """Return where the flight data come from, and how fast they were sampled: (what, words)."""
    time = result.signals["time"].values
    rate = (len(time) - 1) / (time[-1] - time[0])
    return [*((words(key), text) for key, text in result.case.source.items()), ("samples", f"{len(time)} at {short(rate, 3)} per second")]
