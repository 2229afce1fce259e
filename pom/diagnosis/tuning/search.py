"""Search for the smallest moves of terms, relative to the flight evidence, with which rows pass.

The evidence is a database with its covariance V. The tuned model minimises (g - e)' V^-1 (g - e)
over all models whose replays are within tolerance. The ratios are linearised in the directions that
the flights determine (`Directions`). The shortest step inside all linear limits
(`least_distance`) is flown, and the ratios are linearised again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from pom.diagnosis.sampling.sampled_bench import SampledRun
from pom.diagnosis.tuning.tuner import Tuner, all_pass
from pom.diagnosis.tuning.tuning_log import Tuning
from pom.replaying.replay_case import ReplayPlan

BOUND = 2.0  # standard errors of a node, without a rationale for its term


def tune(
    plans: Sequence[ReplayPlan],
    database: xr.DataTree,
    aircraft: Aircraft,
    wanted: Sequence[str] | None = None,
    evidence: xr.DataTree | None = None,
    rationale: Mapping[str, str] | None = None,
    bound: float = BOUND,
    jobs: int = 1,
) -> Tuning:
    """Move terms so that rows pass, inside the standard errors of the evidence.

    Parameters
    ----------
    plans : sequence of Plan
        Cases, of `pom.replaying.plan_of`; all with one aircraft.
    database : DataTree
        The model.
    aircraft : Aircraft
    wanted : sequence of str, optional
        Names of the cases that must pass. Default: the cases that fail. Cases that pass must
        continue to pass. The outcome of every case is reported.
    evidence : DataTree, optional
        Database identified from flight, with standard errors and the axes of the model. Default:
        the model itself.
    rationale : mapping of str to str, optional
        By term: who allows it to leave the bound, when and why.
    bound : float
        Of every node of a term without a rationale. [standard errors]
    jobs : int
        Threads; -1 for one per core.  The tuning does not depend on it.

    Returns
    -------
    Tuning
        If the rows cannot pass inside the bounds, it has a refusal and no database, and ``moves``
        and ``rows`` are those of the necessary moves. Nothing moves if the requested cases pass.

    Raises
    ------
    UnknownName
        A requested case, or a term with a rationale, that does not exist.
    SchemaError
        A case with a control law or with trim surfaces to solve for, a requested case that cannot
        be flown or judged, an evidence without standard errors or with a table that the model does
        not have, a rationale without name, date and reason, a bound that is not positive.
    """
    if not bound > 0.0:
        raise SchemaError(
            "tuning", [f"the bound is {bound:g} standard errors; give a number above 0"]
        )
    tuner = Tuner.of(
        plans,
        database,
        aircraft=aircraft,
        requested=wanted,
        evidence=evidence,
        rationale=dict(rationale or {}),
        jobs=jobs,
    )
    before = tuner.fly(None, tuner.benches)
    requested = _requested_cases(before, wanted)
    tuner.demanded = requested
    if all_pass({name: before[name] for name in requested}):
        rows = tuner.case_rows(requested, before, before)
        return Tuning(database, tuner.move_rows(None), rows, distance=0.0, bound=bound)
    return _search_moves(tuner, before, requested, bound=bound)


def _search_moves(
    tuner: Tuner, before: Mapping[str, SampledRun], requested: Sequence[str], *, bound: float
) -> Tuning:
    """Return the outcome for cases that do not pass with the model itself."""
    z, after, passed = tuner.search_all(before, bound)
    if passed:
        refusal = ""
    else:
        # Without a bound the search gives the price of the rows.
        z, after, passed = tuner.search_all(before, np.inf)
        refusal = tuner.refusal_text(z, passed, requested, bound=bound)
    moves, rows = tuner.move_rows(z), tuner.case_rows(requested, before, after)
    tuned = None
    if not refusal:
        tuned = tuner.tuned_database(z, moves, requested)
    distance = float(np.linalg.norm(z))
    return Tuning(tuned, moves, rows, distance=distance, bound=bound, refusal=refusal)


def _requested_cases(before: Mapping[str, SampledRun], wanted: Sequence[str] | None) -> list[str]:
    """Return the cases that must pass: the requested cases, else the cases that fail."""
    if wanted is None:
        return [name for name, run in before.items() if run.status in ("fail", "limits_exceeded")]
    problems = []
    for name in wanted:
        run = before[name]
        if run.status == "invalid":
            reason = run.failure or "the record lacks what is judged"
            problems.append(f"{name}: the model cannot be flown or judged: {reason}")
        elif run.status == "not_tested":
            problems.append(
                f"{name}: nothing of it is judged, no change of the model can make it pass"
            )
    if problems:
        raise SchemaError("rows to tune", problems)
    return list(dict.fromkeys(wanted))
