"""Standard errors of a-priori estimates that are calibrated on aircraft with published derivatives.

The figures are rows of `calibrated_errors.csv`, which `benchmarks/prior_calibration.py` derives:
relative and absolute standard error of a term by program, with the number of aircraft behind it.
A term without a row keeps the figure of the identification guide (`aerodb.prior.prior_errors`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files

import pandas as pd

from aerodb.prior.prior_errors import PriorErrors, errors_with

TABLE = "calibrated_errors.csv"


@cache
def read_calibration() -> pd.DataFrame:
    """Return the table of the calibration, one row per program and term.

    Returns
    -------
    DataFrame
        Columns ``program``, ``term``, ``method``, ``count`` (aircraft), ``ratio`` (mean of published
        over estimated), ``factor`` (on the errors of the guide), ``relative``, ``absolute`` [1, unit
        of the table].
    """
    with (files("aerodb.prior") / TABLE).open(encoding="ascii") as stream:
        return pd.read_csv(stream, comment="#")


def errors_of(
    program: str,
    overrides: Mapping[str, tuple[float, float] | float] | None = None,
    *regimes: float,
) -> PriorErrors:
    """Return the calibrated rules of a program, with the figures of a project in their place.

    Parameters
    ----------
    program : str
        ``DATCOM`` or ``OptVL``.
    overrides, *regimes
        As in `aerodb.prior.prior_errors.errors_with`.
    """
    rules = errors_with(overrides, *regimes)
    terms = dict(rules.terms)
    table = read_calibration()
    for row in table[table["program"] == program].itertuples():
        if row.term not in (overrides or {}):
            terms[str(row.term)] = float(row.relative), float(row.absolute)
    return replace(rules, terms=terms)
