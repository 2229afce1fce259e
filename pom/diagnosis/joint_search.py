"""Search for the terms that several cases need together: one case changes the other cases.

All cases are judged with the union of the terms that single cases need. If a case is judged worse
than with the final model, all other terms are taken from the final model as well. They are then
left out again in halves and quarters, as far as the verdict remains
[ZellerHildebrandt2002]_. The terms without which the final model suffers least are left out first.
The remaining terms are added to the union. This repeats until every case is judged as well as with
the final model.

References
----------
.. [ZellerHildebrandt2002] A. Zeller, R. Hildebrandt, Simplifying and isolating failure-inducing
   input, IEEE Trans. Software Eng. 28(2), 2002.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import pandas as pd
from joblib import Parallel, delayed

from pom.diagnosis.corrected_model import corrected_terms
from pom.diagnosis.kept_diagnosis import LateBench
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.swap_judgement import MATCHED, DiagnosisRows
from pom.diagnosis.swap_runs import SwapBench


def join_tables(
    diagnoses: Mapping[str, pd.DataFrame],
    benches: Mapping[str, SwapBench | LateBench],
    jobs: int = 1,
) -> dict[str, pd.DataFrame]:
    """Return the tables of `join_diagnoses` from benches by name of the case.

    Runs of different cases are flown in threads at the same time.
    """
    # Only cases that the final model passes take part.
    passed = {}
    for name, bench in benches.items():
        if _verdict(bench, bench.names) in MATCHED:
            passed[name] = bench
    union = corrected_terms(diagnoses.values())
    added = _find_added_terms(passed, union, jobs)
    corrected = set(union)
    for names in added.values():
        corrected.update(names)
    tables = {}
    for name, table in diagnoses.items():
        tables[name] = _with_joint_rows(
            table, benches[name], corrected=corrected, added=added.get(name, [])
        )
    return tables


class _Addition(NamedTuple):
    """Terms of the corrected model, and the case for which each further term was added."""

    terms: set[str]
    case_of_term: dict[str, str]


def _find_added_terms(
    benches: Mapping[str, SwapBench | LateBench], union: Sequence[str], jobs: int
) -> dict[str, list[str]]:
    """Return the terms that are added to the union, by a case that needs them."""
    addition = _add_until_all_pass(benches, union, jobs)
    terms, case_of_term = addition

    def find_needing_case(term: str) -> str | None:
        """Return a case that needs a term; first the case for which it was added."""
        for name in (case_of_term[term], *benches):
            if not _is_as_good(benches[name], terms - {term}):
                return name
        return None

    # A term that was added later can make an earlier one unnecessary.
    for term in reversed(list(case_of_term)):
        if find_needing_case(term) is None:
            terms.remove(term)
            del case_of_term[term]
    added: dict[str, list[str]] = {}
    for term, name in case_of_term.items():
        added.setdefault(find_needing_case(term) or name, []).append(term)
    return added


def _add_until_all_pass(
    benches: Mapping[str, SwapBench | LateBench], union: Sequence[str], jobs: int
) -> _Addition:
    """Return the union with further terms, with which every case is as good as with the final
    model.
    """
    terms, case_of_term = set(union), dict[str, str]()
    is_failing = True
    while is_failing:
        is_failing = False
        # Fly all cases at once without further terms. The benches store the judgements.
        calls = [delayed(_verdict)(bench, frozenset(terms)) for bench in benches.values()]
        Parallel(n_jobs=jobs, backend="threading")(calls)
        for name, bench in benches.items():
            if _is_as_good(bench, terms):
                continue
            further = _find_least_addition(bench, terms)
            case_of_term |= dict.fromkeys(further, name)
            terms.update(further)
            # The further terms can change the verdict of cases that passed before.
            is_failing = True
    return _Addition(terms, case_of_term)


def _verdict(bench: SwapBench | LateBench, names: Collection[str]) -> str:
    """Return the verdict with these terms and parts of the final model, if the case has them."""
    (judged,) = bench.judged([[name for name in bench.names if name in names]], exact=True)
    return judged.verdict


def _is_as_good(bench: SwapBench | LateBench, names: Collection[str]) -> bool:
    """Return whether the case is judged as well as with all terms of the final model."""
    return _verdict(bench, names) in ("pass", _verdict(bench, bench.names))


def _find_least_addition(bench: SwapBench | LateBench, terms: Collection[str]) -> list[str]:
    """Return further names, next to the terms of the model, of which none can be left out."""
    free = [name for name in bench.names if name not in terms]
    # With idle terms the diagnosis has screened the bench. A late bench has the idle terms of its
    # diagnosis, so a screening would change none of its judgements.
    if isinstance(bench, SwapBench) and not bench.idle:
        screen_idle_terms(bench)
    omissions = []
    for omitted in free:
        omissions.append([name for name in bench.names if name != omitted])
    # Loss of the final model without each name: a failed verdict, then the mismatch.
    loss = {}
    for name, judged in zip(free, bench.judged(omissions), strict=True):
        loss[name] = (not judged.matched, judged.total)
    needed = sorted(free, key=lambda name: loss[name])
    # Bisection: a part that can be left out as a whole is not divided.
    parts = [needed]
    while parts:
        part = parts.pop()
        without_part = [name for name in needed if name not in part]
        if _is_as_good(bench, {*terms, *without_part}):
            needed = without_part
        elif len(part) > 1:
            half = len(part) // 2
            parts += [part[half:], part[:half]]
    return needed


def _with_joint_rows(
    table: pd.DataFrame,
    bench: SwapBench | LateBench,
    *,
    corrected: Collection[str],
    added: Sequence[str],
) -> pd.DataFrame:
    """Return a diagnosis with the rows of the stage ``joint``."""
    if not added:
        return table
    base = [name for name in bench.names if name in corrected and name not in added]
    steps = [[*base, *added[:k]] for k in range(len(added) + 1)]
    start, end, *judged_steps = bench.judged([(), bench.names, *steps], exact=True)
    rows = DiagnosisRows(start, end)
    for name, judged in zip(["", *added], judged_steps, strict=True):
        rows.add("joint", name, judged)
    return pd.concat([table, pd.DataFrame(rows.rows)], ignore_index=True)
