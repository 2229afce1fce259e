"""Function that performs the command ``flight tabulate``: fits join the tables of a database."""

from __future__ import annotations

from typing import Any

import click
import pandas as pd

import aerodb
from flightmech.support.console import print_json, print_table, show_progress
from flighttest.regression.combining.published_table import read_published
from flighttest.regression.equation_error.fit_file import open_fit

_TABULATED = {
    "nodes": "nodes",
    "flight": "from flight",
    "identified": "identified",
    "ratio_median": "std. error / a priori",
}


def run_tabulate(fits, database_file, held, way, unplaced, output, as_json) -> None:
    """Perform the command ``tabulate``."""
    prior = aerodb.open(database_file)
    local_models: list[Any] = []
    for path in fits:
        if path.lower().endswith(".csv"):
            local_models += read_published(path)
        else:
            local_models.append(open_fit(path))
    with show_progress(f"join {len(local_models)} fits with the tables"):
        join = aerodb.tabulate if way == "tabulate" else aerodb.update.join_submodels
        tabulation = join(local_models, prior, held, unplaced=unplaced)
    aerodb.save(aerodb.replace_terms(prior, tabulation, note="identified from flight"), output)
    if as_json:
        terms = {str(name): row.to_dict() for name, row in tabulation.report.iterrows()}
        print_json(
            {
                "terms": terms,
                "fits": tabulation.points.reset_index(),
                "compatibility": tabulation.compatibility.reset_index(),
                "unplaced": tabulation.unplaced.reset_index(),
                "warnings": list(tabulation.notices),
                "file": output,
            }
        )
        return
    _print_decisions(tabulation.report)
    click.echo()
    _print_distances(tabulation.points)
    if len(tabulation.unplaced):
        click.echo()
        _print_unplaced(tabulation.unplaced)
    click.echo(f"\nwritten: {output}")


def _print_decisions(report: pd.DataFrame) -> None:
    """Print the figures of each term and the decision about it."""
    rows = []
    for name, row in report.iterrows():
        cells = [f"{row[key]:.{2 if key.startswith('ratio') else 0}f}" for key in _TABULATED]
        rows.append((name, *cells, row["decision"]))
    right = list(_TABULATED.values())
    print_table(["term", *right, "decision"], rows, right=right)


def _print_distances(points: pd.DataFrame) -> None:
    """Print how far the measured estimates are from the tables, before and after."""
    rows = []
    for row in points.reset_index().itertuples():
        rms = f"{row.rms_prior:.4g}", f"{row.rms:.4g}"
        suspect = "suspect" if row.suspect else ""
        rows.append((row.coefficient, row.fit, *rms, f"{row.distance:.1f}", suspect))
    right = ["rms before", "rms after", "distance"]
    print_table(["coefficient", "fit", *right, ""], rows, "Measured less tables", right=right)


def _print_unplaced(unplaced: pd.DataFrame) -> None:
    """Print the estimates of terms that the database does not have."""
    rows = []
    for (coefficient, fit), row in zip(
        unplaced.index, unplaced.itertuples(index=False), strict=True
    ):
        numbers = f"{row.estimate:.4g}", f"{row.stderr:.2g}", f"{row.t:.1f}"
        rows.append((coefficient, fit, row.term, *numbers, row.reason))
    right = ["estimate", "stderr", "t"]
    columns = ["coefficient", "fit", "term", *right, "reason"]
    print_table(columns, rows, "Terms without a place in the database", right=right)
