"""Texts that a qualification test guide needs in addition to the verdicts, and how many are
missing.

14 CFR Part 60, Appendix A, paragraph 11 lists them: objective, procedures, evaluation, source of
the data, statements of compliance.  Initial conditions are on the page of every case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pom.cases.case import PomCase
from pom.result import PomResult

_TEXTS: dict[str, tuple[str, Callable[[PomCase], str]]] = {
    "objective": ("case.objective", lambda case: case.objective),
    "manoeuvre": ("case.description", lambda case: case.description),
    "automatic procedure": ("case.procedure", lambda case: case.procedure),
    "manual procedure": ("case.manual", lambda case: case.manual),
    "evaluation": ("case.evaluation", lambda case: case.evaluation),
    "source of the data": ("source.document", lambda case: case.source.get("document", "")),
    "revision of the source": ("source.revision", lambda case: case.source.get("revision", "")),
    "date of the data": ("source.date", lambda case: case.source.get("date", "")),
    "engine standard": ("source.engine", lambda case: case.source.get("engine", "")),
    "avionics standard": ("source.avionics", lambda case: case.source.get("avionics", "")),
    "statement of compliance": (
        "compliance",
        lambda case: "; ".join(case.compliance.values()),
    ),
}
"""By text: its key in the case file, and the text of a case."""


@dataclass(frozen=True)
class MissingText:
    """A text that cases of a report lack.

    Attributes
    ----------
    name, key : str
        The text, and its key in the case file.
    missing, total : int
        Cases without it, and all cases.
    cases : tuple of str
        Names of the cases without it.
    """

    name: str
    key: str
    missing: int
    total: int
    cases: tuple[str, ...]


def missing_texts(results: Sequence[PomResult]) -> list[MissingText]:
    """Return the texts that cases of a report lack, in the order of a test guide."""
    found = []
    for name, (key, text_of) in _TEXTS.items():
        cases = [item.case.name for item in results if not text_of(item.case).strip()]
        if cases:
            found.append(MissingText(name, key, len(cases), len(results), tuple(cases)))
    return found
