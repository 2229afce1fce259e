"""Standard errors of tables predicted before the estimates are known, against those of `tabulate`.

    python benchmarks/expected_range.py [PROJECT.toml ...] [--draws 40] [--seed 0]

The fits of a project give which nodes were flown and with what errors; the estimates themselves are
not used for the prediction.  Per coefficient: the probability of chi-squared of `tabulate`, the
share of flown nodes within 20 % of the expectation and of the median over the draws, and the share
inside the range of 90 %.  Projects: the T-37 and the C182 of ``data``.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from planned_programme import before, local_fits

import aerodb
from aerodb.update.expectation import Expectation
from aerodb.update.observations import coefficient_of
from aeromatch.project.project import read_project
from flighttest.flight_programme.planning.expected_range import draw_stderr

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
            low, median, high = np.nanquantile(drawn, (0.05, 0.5, 0.95), axis=0)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("projects", nargs="*", type=Path)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    shipped = [DATA / name / "aeromatch.toml" for name in ("t37", "c182")]
    for file in given.projects or shipped:
        project = read_project(file)
        print(project.title)
        compare(local_fits(project, 1), before(project)[1], given.draws, given.seed)


if __name__ == "__main__":
    main()
