"""Polynomial models of the six coefficients as a CSV file: coefficient, term, estimate, sigma."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from flightmech.errors import ParseError

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
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        needed = (*COLUMNS, column)
        if missing := [name for name in needed if name not in (reader.fieldnames or ())]:
            raise ParseError(str(path), 1, f"columns {', '.join(reader.fieldnames or ())}", f"also {', '.join(missing)}")
        for row in reader:
            try:
                numbers = float(row[column]), float(row["sigma"])
            except (TypeError, ValueError) as error:
                raise ParseError(str(path), reader.line_num, str(error), f"numbers in {column} and sigma") from error
            rows.setdefault(row["coefficient"], []).append((row["term"], *numbers))
    found = {}
    for coefficient, lines in rows.items():
        terms = [term for term, _, _ in lines]
        variables = {name for term in terms for name in powers(term)}
        model = Model(coefficient, terms, {name: value for name, value in (nominal or {}).items() if name in variables})
        found[coefficient] = Polynomial(model, *np.array([numbers for _, *numbers in lines]).T)
    return found
