"""Is the probability of a pass calibrated?

    python benchmarks/match_calibration.py PROGRAMMES VALIDATION --seeds 101-120 [--draws 100]

Simulated T-37 programmes of other seeds, as `benchmarks/table_coverage.py` keeps them in PROGRAMMES
(runs 01 to 16); the proving runs 21, 22, 26, 27, 29, 30 and 32 of the same aeroplane and
instruments are made and reconstructed in VALIDATION when they are not there.  Every programme is
identified, its final model flown against the proving runs, and against the flights that draws of
its posterior give there.  Event: the row is within a share of its tolerance.  Printed per share:
Brier score of the probabilities over all rows and seeds, that of the frequencies of each row over
the seeds, and how often rows of a stated probability came true.
"""

from __future__ import annotations

import argparse
import json
import pickle
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from table_coverage import ROOT, SCRIPT, programme, seeds_of

import flightmech
import flighttest
import pom
from aeromatch.project.project import Project, read_project
from aeromatch.project.sections import Controls
from aeromatch.workflow.aerodynamics import (
    a_priori,
    add_missing_terms,
    coefficients_of,
    final_database,
    fit_records,
)
from aeromatch.workflow.windows import select_windows
from flighttest.reconstruction.combined_biases import instrument_constants

RUNS = "21,22,26,27,29,30,32"
CASES = {
    "t37_21": "21_short_period", "t37_22": "22_roll_response", "t37_26": "26_phugoid",
    "t37_27": "27_dutch_roll",
    "t37_29": "29_flap_change", "t37_30": "30_gear_change", "t37_32": "32_rudder_response",
}  # fmt: skip
SHARES = (1.0, 0.4, 0.2, 0.1)
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def proving(
    here: Path,
    programmes: Path,
    seed: int,
    paths: dict[str, Any],
    project: Project,
    aircraft: flightmech.Aircraft,
) -> dict[str, Any]:
    """Return the reconstructed proving runs of a seed; what the identifying runs found of the
    instruments is their prior.
    """
    if not (here / "paths.pickle").exists():
        here.mkdir(parents=True, exist_ok=True)
        errors = str(programmes / f"seed{seed}" / "errors.json")
        job = [
            sys.executable,
            str(SCRIPT),
            "--only",
            RUNS,
            "--out",
            str(here / "recordings"),
            "--errors",
            errors,
        ]
        subprocess.run(job, check=True, stdout=subprocess.DEVNULL)
        # a run of a programme was solved with all others as its prior: what it found is what all of
        # them found
        prior = max(
            (instrument_constants(path.biases) for path in paths.values()),
            key=lambda found: found.sizes["parameter"],
        )
        files = sorted((here / "recordings").glob("*.nc"))
        found = {
            file.stem: flighttest.reconstruct(
                flighttest.read(file, project.names), aircraft, prior=prior
            )
            for file in files
        }
        with open(here / "paths.pickle", "wb") as file:
            pickle.dump(found, file)
    with open(here / "paths.pickle", "rb") as stored:
        return pickle.load(stored)


def identified(
    flown: dict[str, Any], project: Project, aircraft: flightmech.Aircraft, start: xr.DataTree
) -> xr.DataTree:
    """Return the final database of one programme."""
    windows = select_windows(project, flown["records"])
    fits = fit_records(
        project, coefficients_of(project, aircraft, flown["paths"], windows), windows
    )
    return final_database(project, start, fits)[0]


def ratios(
    db: xr.DataTree,
    paths: dict[str, Any],
    project: Project,
    aircraft: flightmech.Aircraft,
    draws: int,
) -> dict[str, Any]:
    """Return by row the ratio that decides, of the final model and of its draws."""
    given, cases = {}, []
    for stem, path in paths.items():
        case = pom.read_case(ROOT / "data" / "t37" / "cases" / f"{CASES[stem[:6]]}.toml")
        cases.append(case)
        given[case.record] = path
    with tempfile.TemporaryDirectory() as folder:
        fmu = flightmech.write_fmu(flightmech.compile(aircraft, db), Path(folder) / "final.fmu")
        found = pom.replay_sampled(
            cases, {"final": fmu}, {"final": db}, draws, 0, given, errors=project.errors, jobs=1
        )
    decided = {}
    for result in found:
        row = result.worst("final")
        if row is None:
            raise SystemExit(f"case {result.case.name}: the final model has no judged row")
        decided[result.case.name] = {
            "model": row["worst_ratio"],
            "draws": result.samples["final"].decides.tolist(),
        }
    return decided


def scores(
    found: list[dict[str, Any]], share: float
) -> tuple[float, float, list[tuple[int, float, float]]]:
    """Return the Brier scores of the probabilities and of the frequencies, and (count, mean
    probability, frequency) by bin.
    """
    rows = [name for name in found[0] if all(name in one for one in found)]
    p = np.array(
        [[np.mean(np.array(one[name]["draws"]) <= share) for name in rows] for one in found]
    )
    o = np.array([[one[name]["model"] <= share for name in rows] for one in found], float)
    places = np.clip(np.digitize(p, BINS) - 1, 0, len(BINS) - 2)
    table = [
        (int(np.sum(places == k)), float(p[places == k].mean()), float(o[places == k].mean()))
        for k in np.unique(places)
    ]
    return float(np.mean((p - o) ** 2)), float(np.mean((o.mean(axis=0) - o) ** 2)), table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("programmes", type=Path)
    parser.add_argument("validation", type=Path)
    parser.add_argument("--seeds", default="101-120")
    parser.add_argument("--draws", type=int, default=100)
    given = parser.parse_args()
    warnings.simplefilter("ignore", flightmech.errors.AeromatchWarning)
    project = read_project(ROOT / "data" / "t37" / "aeromatch.toml")
    errors = {
        **(project.errors or {}),
        "timing": 0.0,
    }  # accelerations and states of the simulated recordings have one clock
    project = project.with_changes(
        engine=None, controls=Controls(), gear=None, ground_effect=None, errors=errors
    )
    aircraft = flightmech.read_aircraft(project.aircraft)
    start = add_missing_terms(project, a_priori(project, aircraft))
    found = []
    for seed in seeds_of(given.seeds):
        here = given.validation / f"seed{seed}"
        kept = here / f"ratios{given.draws}.json"
        if not kept.exists():
            flown = programme(given.programmes, seed, project, aircraft, False, 1)
            if any(path.errors is None for path in flown["paths"].values()):
                raise SystemExit(
                    f"seed {seed}: paths without the errors of their states; delete its "
                    f"paths.pickle and reconstruct it again"
                )
            paths = proving(here, given.programmes, seed, flown["paths"], project, aircraft)
            kept.write_text(
                json.dumps(
                    ratios(
                        identified(flown, project, aircraft, start),
                        paths,
                        project,
                        aircraft,
                        given.draws,
                    )
                )
            )
        found.append(json.loads(kept.read_text()))
        print(
            seed,
            *(
                f"{name} {one['model']:.2f} {np.median(one['draws']):.2f}"
                for name, one in found[-1].items()
            ),
            flush=True,
        )
    for share in SHARES:
        own, frequencies, table = scores(found, share)
        print(
            f"within {100 * share:.0f} % of the tolerance: Brier score {own:.4f}, of the "
            f"frequencies {frequencies:.4f}"
        )
        for count, stated, came in table:
            print(f"    {count:4d} rows, probability {stated:.2f}, came true {came:.2f}")


if __name__ == "__main__":
    main()
