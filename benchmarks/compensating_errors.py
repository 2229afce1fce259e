"""Errors that compensate each other: pairs of wrong terms in an identified model, replayed and
judged against the flights of its cases.

    aeromatch demo -o out/t37 python benchmarks/compensating_errors.py out/t37/final.nc
    out/t37/final.toml data/t37/cases/*.toml --pairs 200

Every pair scales two terms that flight found by random factors between a half and two.  All cases
are flown by the kernel with the terms scaled, judged as `pom.replay` judges, and compared with the
flight evidence (the unscaled database).  Printed: how often a case passes while a term that it uses
lies beyond three standard errors of the evidence, and how often a pass of that kind carries no
notice; the same for pairs that pass every case; last, the notices on the unscaled model.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np

import aerodb
import flightmech
import pom
from pom.judging.beyond_the_bands import FAR, Evidence, distance_remarks
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import plan_of
from pom.replaying.result_assembly import assemble_result
from pom.result_notices import run_notices


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("database", type=Path)
    parser.add_argument("aircraft", type=Path)
    parser.add_argument("cases", type=Path, nargs="+")
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    final, aircraft = aerodb.open(given.database), flightmech.read_aircraft(given.aircraft)
    rng = np.random.default_rng(given.seed)
    names = [
        name
        for name, leaf in aerodb.terms(final).items()
        if "source" in leaf and (leaf["source"].values == 1).any()
    ]
    factors = [{}] + [
        dict(
            zip(rng.choice(names, 2, replace=False), 2.0 ** rng.uniform(-1.0, 1.0, 2), strict=True)
        )
        for _ in range(given.pairs)
    ]
    sims = [flightmech.compile(aircraft, scaled(final, choice)) for choice in factors]
    passes, far, silent = (np.zeros((len(given.cases), len(factors)), bool) for _ in range(3))
    for i, file in enumerate(given.cases):
        plan = plan_of(pom.read_case(file))
        evidence = Evidence(final, plan.states, hinges=plan.case.drive.level != "recorded")
        for k, sim in enumerate(sims):
            outputs, failures = replay_choices(sim, plan.job)
            found = {name: values[0] for name, values in outputs.items()}
            remarks = distance_remarks(evidence.distances(sim))
            result = assemble_result(
                plan.case,
                plan.states,
                plan.job,
                {"model": found},
                {"model": failures[0]},
                more={"model": remarks},
            )
            passes[i, k] = result.status("model") == "pass"
            far[i, k] = any(size > FAR for size in evidence.distances(sim).values())
            silent[i, k] = not run_notices(result, "model")
            if k == 0:
                seen = "; ".join(run_notices(result, "model")) or "no notice"
                print(
                    f"{plan.case.id:8s}{plan.case.name:28s} unscaled: "
                    f"{result.status('model')}; {seen}",
                    flush=True,
                )
    wrong = (passes & far)[:, 1:]
    print(f"{given.pairs} pairs x {len(given.cases)} cases: {passes[:, 1:].sum()} cases pass,")
    print(
        f"    {wrong.sum()} of them with a term beyond {FAR:g} standard errors, "
        f"{(wrong & silent[:, 1:]).sum()} of those without a notice"
    )
    every = passes[:, 1:].all(axis=0)
    print(
        f"{every.sum()} pairs pass all cases; {(every & far[:, 1:].any(axis=0)).sum()} of "
        f"them have a term beyond {FAR:g} standard errors,"
    )
    print(
        f"    {(every & (far & silent)[:, 1:].any(axis=0)).sum()} with a case that uses the "
        f"term and carries no notice"
    )


def scaled(database, choice):
    for name, factor in choice.items():
        database = aerodb.edit.scale(database, name, factor)
    return database


if __name__ == "__main__":
    main()
