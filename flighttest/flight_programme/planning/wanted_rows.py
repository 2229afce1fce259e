"""Rows of a proof of match as wanted quantities of a flight-test programme.

A row compares channels of a case along time, or numbers of its motion.  Each comparison at an
instant is a *function*: model minus reference over the tolerance.  Its gradient by the nodes of the
database gives its standard error after any choice of manoeuvres.  The width of a criterion is two
standard errors of its widest function, so a width of one is a match in 95 of 100 programmes at that
instant.  Of the alternatives of a group the narrowest counts, of the groups the widest, as in a
verdict.

`aeromatch pom spread` computes the gradients; this module holds and stores them.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.expectation import Expectation, LinearSpread, sum_spreads
from aerodb.update.observations import coefficient_of
from flightmech.errors import ParseError, SchemaError
from flightmech.short_text import ShortText
from flightmech.support.array_files.netcdf_trees import read_netcdf_tree
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.kept_stages.content_hashes import content_hash
from flighttest.flight_programme.planning.catalogue import Catalogue, WantedRow

# Standard errors in a width: 95 % of a normal distribution.
WIDTH = 2.0
_FORM = "gradients of rows of a proof of match, as `aeromatch pom spread -o` writes them"


@dataclass(frozen=True)
class RowGradients(ShortText):
    """Gradients of a row by the nodes of a database.

    Attributes
    ----------
    wanted : WantedRow
        The row in the catalogue.
    functions : DataFrame
        One row per function: ``criterion``, ``group``, ``time`` (NaN for a number) [s], and
        ``ground``: the function is not a comparison, but the contribution of all terms over
        height to the coefficient named by ``criterion``.
    gradients : dict of str to array (function, *axes)
        Change of the functions by the nodes of a term, in the shape of its table.
        [1/unit of the term]
    notes : tuple of str
        What the prediction assumes, and criteria that it does not contain.
    """

    wanted: WantedRow
    functions: pd.DataFrame
    gradients: dict[str, np.ndarray]
    notes: tuple[str, ...] = ()

    def widths(self, stderr: np.ndarray) -> pd.Series:
        """Return the width of every criterion, from standard errors (function,)."""
        compared = ~self.functions["ground"].to_numpy(bool)
        criteria = self.functions["criterion"].to_numpy()[compared]
        return WIDTH * pd.Series(stderr[compared]).groupby(criteria).max()

    def ground_errors(self, stderr: np.ndarray) -> dict[str, float]:
        """Return the largest standard error of the ground effect by coefficient."""
        ground = self.functions["ground"].to_numpy(bool)
        criteria = self.functions["criterion"].to_numpy()[ground]
        largest = pd.Series(stderr[ground]).groupby(criteria).max()
        return {str(name): float(error) for name, error in largest.items()}

    def decides(self, stderr: np.ndarray) -> tuple[str, float]:
        """Return the criterion that decides, and its width; standard errors (function,)."""
        widths = self.widths(stderr)
        compared = self.functions[~self.functions["ground"].to_numpy(bool)]
        groups = compared.groupby("criterion")["group"].first()
        best = widths.groupby(groups).idxmin()
        name = max(best, key=lambda criterion: widths[criterion])
        return str(name), float(widths[name])

    @property
    def coefficients(self) -> list[str]:
        """Coefficients whose terms matter."""
        return list(dict.fromkeys(name.split("/")[0] for name in self.gradients))


def spreads_of_row(
    row: RowGradients, expectation: Expectation, fits: Sequence[Any]
) -> list[LinearSpread]:
    """Return the spread of the functions of a row by each coefficient."""
    spreads = []
    for coefficient in row.coefficients:
        local = [fit for fit in fits if coefficient_of(fit) == coefficient]
        spreads.append(expectation.spread_of(coefficient, local, row.gradients))
    return spreads


def shares_of_row(
    row: RowGradients, expectation: Expectation, fits: Sequence[Any]
) -> dict[str, float]:
    """Return the share of each term in the variance of the function that decides.

    It is the covariance of the contribution of the term with the function, over the variance of the
    function.  Shares add up to one, and may be negative where terms compensate each other.
    """
    stderr = sum_spreads(spreads_of_row(row, expectation, fits))
    name, _ = row.decides(stderr)
    own = (row.functions["criterion"] == name) & ~row.functions["ground"].astype(bool)
    k = int(np.argmax(np.where(own, stderr, -1.0)))
    if not stderr[k] > 0.0:
        return {}
    # cov(part, whole) = (var(whole + part) - var(whole - part))/4
    count = len(row.gradients)
    varied = {}
    for number, (term, gradient) in enumerate(row.gradients.items()):
        signs = np.ones((2, count))
        signs[:, number] += [1.0, -1.0]
        shape = (2 * count, *(1 for _ in gradient.shape[1:]))
        varied[term] = signs.reshape(shape) * gradient[k]
    up, down = expectation.stderr_of(fits, varied).reshape(2, count)
    shares = (up**2 - down**2) / (4.0 * stderr[k] ** 2)
    ordered = sorted(zip(row.gradients, shares.tolist(), strict=True), key=lambda pair: -pair[1])
    return dict(ordered)


def save_rows(rows: Sequence[RowGradients], database: xr.DataTree, path: str | os.PathLike) -> None:
    """Write gradients, with the content of the database that they belong to."""
    groups = {"/": xr.Dataset(attrs={"form": _FORM, "database": digest_of(database)})}
    for number, row in enumerate(rows, 1):
        variables: dict[str, Any] = {"time": ("function", row.functions["time"].to_numpy(float))}
        for term, gradient in row.gradients.items():
            name = term.replace("/", ".")
            axes = [f"{name}.{k}" for k in range(gradient.ndim - 1)]
            variables[name] = (("function", *axes), gradient)
        attributes = {
            "wanted": row.wanted.model_dump_json(),
            "criterion": json.dumps(row.functions["criterion"].tolist()),
            "group": json.dumps(row.functions["group"].tolist()),
            "ground": json.dumps(row.functions["ground"].astype(bool).tolist()),
            "terms": json.dumps(list(row.gradients)),
            "notes": json.dumps(row.notes),
        }
        groups[f"/row{number}"] = xr.Dataset(variables, attrs=attributes)
    with written_atomically(Path(path)) as part:
        write_netcdf(groups, part)


def read_rows(
    path: str | os.PathLike, catalogue: Catalogue, database: xr.DataTree
) -> list[RowGradients]:
    """Return the gradients of the wanted rows of a catalogue from a file of `save_rows`.

    Raises
    ------
    ParseError
        The file is another one.
    SchemaError
        The file belongs to another database, or lacks a row of the catalogue.
    """
    try:
        tree, _ = read_netcdf_tree(Path(path))
        if tree.attrs.get("form") != _FORM:
            raise ValueError("another content")
        known = [_row_of(node.to_dataset()) for node in tree.children.values()]
    except (OSError, ValueError, KeyError) as error:
        raise ParseError(str(path), 0, str(error), _FORM) from error
    if tree.attrs["database"] != digest_of(database):
        raise SchemaError(
            str(path),
            ["it belongs to another database; run `aeromatch pom spread` with this one"],
        )
    rows, problems = [], []
    for wanted in catalogue.wanted_row:
        matching = [row for row in known if _same_case(row.wanted, wanted)]
        if matching:
            row = matching[0]
            rows.append(RowGradients(wanted, row.functions, row.gradients, row.notes))
        else:
            problems.append(
                f"no row {wanted.name}; run `aeromatch pom spread` with this catalogue again"
            )
    if problems:
        raise SchemaError(str(path), problems)
    return rows


def demand_rows(catalogue: Catalogue, rows: Sequence[RowGradients]) -> None:
    """Raise if a catalogue wants rows whose gradients are not there."""
    names = {row.wanted.name for row in rows}
    missing = [wanted.name for wanted in catalogue.wanted_row if wanted.name not in names]
    if missing:
        raise SchemaError(
            "catalogue",
            [
                f"wanted_row {name}: its gradients are missing; run `aeromatch pom spread` and "
                "give its file by --rows"
                for name in missing
            ],
        )


def digest_of(database: xr.DataTree) -> str:
    """Return a hash of the values and standard errors of a database."""
    content = {}
    for name, leaf in terms(database).items():
        arrays = [leaf[key].values for key in ("value", "stderr") if key in leaf]
        content[name] = [*arrays, *(leaf[axis].values for axis in leaf["value"].dims)]
    return content_hash(content)


def _same_case(one: WantedRow, other: WantedRow) -> bool:
    """Return whether two wanted rows differ at most in their bound."""
    return one.model_copy(update={"ratio": other.ratio}) == other


def _row_of(data: xr.Dataset) -> RowGradients:
    """Return a row from its group in a file."""
    functions = pd.DataFrame(
        {
            "criterion": json.loads(data.attrs["criterion"]),
            "group": json.loads(data.attrs["group"]),
            "time": data["time"].values,
            "ground": json.loads(data.attrs["ground"]),
        }
    )
    gradients = {}
    for term in json.loads(data.attrs["terms"]):
        gradients[term] = data[term.replace("/", ".")].values
    wanted = WantedRow.model_validate_json(data.attrs["wanted"])
    return RowGradients(wanted, functions, gradients, tuple(json.loads(data.attrs["notes"])))
