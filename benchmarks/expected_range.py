"""Standard errors of tables predicted before the estimates are known, against those of `tabulate`.

    python benchmarks/expected_range.py [PROJECT.toml ...] [--draws 40] [--seed 0]
        [--coefficients CL,Cm] [--programmes FOLDER --programme-seeds 301-303]

The fits of a project give which nodes were flown and with what errors; the estimates themselves are
not used for the prediction.  Per coefficient: the probability of chi-squared of `tabulate`, the
share of flown nodes within 20 % of the expectation and of the median over the draws, and the share
inside the range that a plan states.  Projects: the T-37 and the C182 of ``data``, or simulated T-37
programmes of other seeds, which ``table_coverage.py FOLDER --make`` has flown.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
import table_coverage
from planned_programme import before, local_fits

import aerodb
import flightmech
from aerodb.update.expectation import Expectation
from aerodb.update.observations import coefficient_of
from aeromatch.project.project import read_project
from aeromatch.project.sections import Controls
from aeromatch.workflow.aerodynamics import coefficients_of, fit_records
from aeromatch.workflow.windows import select_windows
from flighttest.flight_programme.planning.expected_range import draw_stderr, range_of_draws

DATA = Path(__file__).parents[1] / "data"


def compare(fits: list, prior, draws: int, seed: int) -> None:
    """Print a line for every coefficient."""
    for coefficient in dict.fromkeys(map(coefficient_of, fits)):
        local = [fit for fit in fits if coefficient_of(fit) == coefficient]
        found = aerodb.tabulate(local, prior, unplaced="warn")
        expectation = Expectation(prior)
        expected, flown = expectation.stderr(local), expectation.flown(local)
        ratios, medians, inside = [], [], []
        for name, drawn in draw_stderr(expectation, local, draws, seed).items():
            known = aerodb.terms(prior)[name]["stderr"].values > 0.0
            where = flown[name] & known
            achieved = found[name]["stderr"].values
            low, median, high = range_of_draws(drawn)
            ratios.append((achieved / np.where(known, expected[name], 1.0))[where])
            medians.append((achieved / np.where(known, median, 1.0))[where])
            inside.append(((achieved >= low) & (achieved <= high))[where])
        row = found.compatibility.loc[coefficient]
        shares = []
        for ratio in (ratios, medians):
            shares.append(100.0 * (np.abs(np.concatenate(ratio) - 1.0) < 0.2).mean())
        count = sum(map(len, inside))
        print(
            f"{coefficient}: {count} flown nodes, probability of chi-squared "
            f"{row['probability']:.2g}; within 20 % of the expectation {shares[0]:.0f} %, of the "
            f"median {shares[1]:.0f} %; in the range {100.0 * np.concatenate(inside).mean():.0f} %",
            flush=True,
        )


def programme_fits(folder: Path, seed: int) -> list:
    """Return the fits of a simulated T-37 programme that has been flown and reconstructed."""
    project = read_project(DATA / "t37" / "aeromatch.toml").with_changes(
        engine=None, controls=Controls(), gear=None, ground_effect=None
    )
    aircraft = flightmech.read_aircraft(project.aircraft)
    flown = table_coverage.programme(folder, seed, project, aircraft, make=False, jobs=1)
    windows = select_windows(project, flown["records"])
    data = coefficients_of(project, aircraft, flown["paths"], windows)
    return fit_records(project, data, windows)


def chosen(fits: list, coefficients: str) -> list:
    """Return the fits of some coefficients; of all without a choice."""
    names = coefficients.split(",")
    return [fit for fit in fits if not coefficients or coefficient_of(fit) in names]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("projects", nargs="*", type=Path)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--coefficients", default="", help="such as CL,Cm; default all")
    parser.add_argument("--programmes", type=Path, help="folder of table_coverage.py")
    parser.add_argument("--programme-seeds", default="301")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    shipped = [DATA / name / "aeromatch.toml" for name in ("t37", "c182")]
    if given.programmes:
        prior = before(read_project(shipped[0]))[1]
        for seed in table_coverage.seeds_of(given.programme_seeds):
            print(f"programme {seed}")
            fits = chosen(programme_fits(given.programmes, seed), given.coefficients)
            compare(fits, prior, given.draws, given.seed)
        return
    for file in given.projects or shipped:
        project = read_project(file)
        print(project.title)
        fits = chosen(local_fits(project, 1), given.coefficients)
        compare(fits, before(project)[1], given.draws, given.seed)


if __name__ == "__main__":
    main()
