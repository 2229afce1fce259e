"""Polynomial models of the six coefficients as a CSV file: coefficient, term, estimate, sigma."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files.text import csv_rows, read_text

from ..equation_error.model import Model, powers

COLUMNS = ("coefficient", "term", "estimate", "sigma")


class Polynomial(NamedTuple):
    """A model of one coefficient with its estimates and their standard errors, (term,)."""

    model: Model
    estimates: np.ndarray
    sigma: np.ndarray


def read_polynomials(
    path: str | os.PathLike, nominal: Mapping[str, float] | None = None, column: str = "estimate"
) -> dict[str, Polynomial]:
    """Return the models of a CSV file.

    Parameters
    ----------
    path : path
        Columns ``coefficient term estimate sigma``, and others that `column` may name.
    nominal : mapping of str to float, optional
        Values that variables count from, as `nominal_variables` gives them. [SI]
    column : str
        Where the estimates stand.

    Returns
    -------
    dict of str to Polynomial
        In the order of the file.

    Raises
    ------
    ParseError
        A column or a number that is missing, with its line.
    UnknownName
        A coefficient or variable that is not in the vocabulary.
    """
    rows: dict[str, list[tuple[str, float, float]]] = {}
    names, *cells = csv_rows(read_text(path, "polynomials in CSV"), path) or [[]]
    if missing := [name for name in (*COLUMNS, column) if name not in names]:
        raise ParseError(str(path), 1, f"columns {', '.join(names)}", f"also {', '.join(missing)}")
    for number, line in enumerate(cells, 2):
        if not line:
            continue
        row = dict(zip(names, line))
        try:
            coefficient, found_row = row["coefficient"], (row["term"], float(row[column]), float(row["sigma"]))
        except (KeyError, ValueError) as error:
            raise ParseError(str(path), number, str(error), f"numbers in {column} and sigma") from error
        rows.setdefault(coefficient, []).append(found_row)
    found = {}
    for coefficient, lines in rows.items():
        terms = [term for term, _, _ in lines]
        variables = {name for term in terms for name in powers(term)}
        model = Model(coefficient, terms, {name: value for name, value in (nominal or {}).items() if name in variables})
        found[coefficient] = Polynomial(model, *np.array([numbers for _, *numbers in lines]).T)
    return found
