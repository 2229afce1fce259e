"""Pairs of planted faults over the cases of the demo: are both named among the first terms?

    python benchmarks/culprits.py [out/t37] [case ...] --pairs 20 --seed 1

The folder holds final.nc and final.toml of the demo. The suspect model is a draw from the posterior
of the final database, so that all terms differ from the evidence, by their standard errors. Two of
its terms are scaled: random terms that flight found and that the cases feel (half of the pairs of
one coefficient, which can compensate each other), by random factors 0.5 to 0.8 or 1.25 to 2.
The final database is the right model and the evidence. Printed for each pair: the first three terms
of the joint ranking, their places, whether a case fails at all, and the first three terms that the
diagnoses of single cases need (`corrected_terms`).
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import flightmech
import pom
from pom.cases.reference_states import recorded_states
from pom.diagnosis.corrected_model import corrected_terms
from pom.diagnosis.culprits.ranking import rank_culprits
from pom.diagnosis.diagnosis import diagnose_bench
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench
from pom.judging.beyond_the_bands import FAR, Evidence

# Cases that fly recorded surfaces, without the 96 s of the phugoid and without wheels on ground.
CASES = (
    "21_short_period",
    "22_roll_response",
    "23_power_chop",
    "24_power_slam",
    "27_dutch_roll",
    "28_spiral",
    "29_flap_change",
    "30_gear_change",
    "32_rudder_response",
)
FIRST = 3  # places among which both terms are wanted
FELT = 0.05  # half widths: a fault that moves every case by less is drawn again


def main() -> None:
    """Print the rank of both faults of every pair, and how many pairs have both in front."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/t37"))
    parser.add_argument("cases", nargs="*", help="names of cases of data/t37/cases")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise", type=float, default=1.0, help="of the draw, standard errors")
    parser.add_argument("--single", action="store_true", help="also the diagnoses of single cases")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    final = aerodb.open(given.folder / "final.nc")
    aircraft = flightmech.read_aircraft(given.folder / "final.toml")
    flights = {}
    for name in given.cases or CASES:
        case = pom.read_case(f"data/t37/cases/{name}.toml")
        flights[name] = (case, recorded_states(case))
    candidates = used_terms(final, aircraft, flights)
    print(f"{len(flights)} cases, {len(candidates)} terms that flight found and the cases use")
    named = named_single = refuted = named_refuted = 0
    for number in range(given.pairs):
        rng = np.random.default_rng([given.seed, number])
        benches, faults, redrawn = planted_benches(
            rng, final, aircraft, flights, candidates=candidates, noise=given.noise, number=number
        )
        start = time.process_time()
        ranked = rank_culprits(benches, final)
        spent = time.process_time() - start
        order = list(ranked["term"])
        places = sorted(order.index(name) + 1 for name in faults)
        is_named = places[-1] <= FIRST
        named += is_named
        distances = ranked.set_index("term")["distance"][list(faults)]
        if (distances > FAR).all():
            refuted += 1
            named_refuted += is_named
        verdicts = [bench.judged([()])[0].matched for bench in benches.values()]
        text = ", ".join(f"{name} x {factor:.2f}" for name, factor in faults.items())
        line = f"{number:3d} {text:46s} places {places}, {verdicts.count(False)} cases fail"
        line += f", from evidence {distances.round(1).to_list()}"
        line += f", first {order[:FIRST]}, {spent:.1f} s, {redrawn} redrawn"
        if given.single:
            tables = [diagnose_bench(bench) for bench in benches.values()]
            needed = corrected_terms(tables)[:FIRST]
            named_single += set(faults) <= set(needed)
            line += f"; single cases {needed}"
        print(line, flush=True)
    print(f"both among the first {FIRST}: {named} of {given.pairs}")
    print(
        f"    of pairs with both faults beyond {FAR:g} standard errors of the evidence: "
        f"{named_refuted} of {refuted}"
    )
    if given.single:
        print(f"both among the first {FIRST} that single cases need: {named_single}")


def used_terms(final: xr.DataTree, aircraft, flights) -> list[str]:
    """Return the terms from flight that at least one case uses."""
    sim = flightmech.compile(aircraft, final)
    used: dict[str, None] = {}
    for case, states in flights.values():
        evidence = Evidence(final, states, hinges=case.drive.level != "recorded")
        used |= dict.fromkeys(evidence.distances(sim))
    return list(used)


def planted_benches(rng, final, aircraft, flights, *, candidates, noise, number):
    """Return benches with two faults that are felt, the faults, and how many were drawn again."""
    leaves = aerodb.terms(final)
    drawn = aerodb.update.draw(final, 1, seed=int(rng.integers(2**31)))
    values = {}
    for name, nodes in drawn.items():
        value = leaves[name]["value"].values
        values[name] = value + noise * (nodes[0] - value)
    for redrawn in range(100):
        faults = draw_faults(rng, candidates, same=number % 2 == 1)
        planted = {}
        for name, nodes in values.items():
            planted[name] = leaves[name].assign(
                value=leaves[name]["value"].copy(data=nodes * faults.get(name, 1.0))
            )
        suspect = aerodb.replace_terms(final, planted)
        models = SwapModels.of(suspect, final, (aircraft, aircraft))
        benches = {}
        for name, (case, states) in flights.items():
            benches[name] = SwapBench.of(case, models, states)
        if all(is_felt(benches, name) for name in faults):
            for bench in benches.values():
                screen_idle_terms(bench)
            return benches, faults, redrawn
    raise SystemExit("no pair of faults is felt by these cases; give more cases")


def draw_faults(rng, candidates, *, same: bool) -> dict[str, float]:
    """Return two terms, of one coefficient if `same`, with their factors."""
    first = str(rng.choice(candidates))
    others = [name for name in candidates if name != first]
    if same:
        head = first.split("/")[0]
        others = [name for name in others if name.split("/")[0] == head] or others
    factors = rng.uniform([0.5, 0.5], [0.8, 0.8]) ** rng.choice([-1.0, 1.0], 2)
    return dict(zip((first, str(rng.choice(others))), factors.tolist(), strict=True))


def is_felt(benches, name: str) -> bool:
    """Return whether the fault alone moves the mismatch of the final model of any case."""
    for bench in benches.values():
        (end, without) = bench.judged(
            [bench.names, [one for one in bench.names if one != name]], exact=True
        )
        if without.total**2 - end.total**2 >= FELT**2:
            return True
    return False


if __name__ == "__main__":
    main()
