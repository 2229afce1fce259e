"""Published local models from a CSV file: a row per value with its standard error, columns for the
conditions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError, IdentificationError, ParseError, SchemaError
from flightmech.names import lookup
from flightmech.support.input_files import WESTERN, csv_rows, read_text
from flightmech.units import parse_unit, to_si
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.uncertainty import collinearity

_TANGENT = (
    1e-4  # half the width of a tangent, of the value of the variable or of one, whichever is larger
)
_ROWS, _MOST = 16384, 33  # points of the grid in all, and along one variable
_RATES = ("phat", "qhat", "rhat", "alphadothat", "betadothat")  # zero unless stated


def published_fit(
    model: RegressionModel | str,
    values: Mapping[str, float],
    stderr: Mapping[str, float],
    conditions: Mapping[str, float | Sequence[float] | str],
    correlation: np.ndarray | None = None,
    name: str = "",
) -> Fit:
    """Return a fit of published values, for `aerodb.tabulate`, `join_fits` and `Fit.predict`.

    Parameters
    ----------
    model : Model or str
        Such as ``"Cm = 1 + alpha + qhat + delta_e"``; with `RegressionModel.reference` the values are those
        of an expansion about a point.
    values, stderr : mapping of str to float
        Value and standard error of every term of the model, reduced as here: rates by b/2V and
        cbar/2V, a derivative over q cbar/V is twice as large here. [1, 1/rad]
    conditions : mapping of str to float, (low, high) or str
        Where the model holds: every variable of the model and of the tables.  A number is the
        condition; a pair is the range over which the model was found or is stated to hold, needed
        for variables with higher powers and ramps; a name is a variable that moves as that one:
        ``{"alphadothat": "qhat"}`` where the value of ``qhat`` is the sum of both derivatives, as
        in a short period. Rates that are not named are zero. [SI]
    correlation : array (terms, terms), optional
        Of the values, in the order of the model; they are independent without it.
    name : str
        Source, for reports and provenance.

    Returns
    -------
    Fit
        ``data`` and ``design`` hold the grid of conditions with the coefficient of the model
        itself; what was not published, ``vif``, ``contribution``, ``R2``, ``residual_rms`` ..., is
        NaN.  Attribute ``domain`` is ``published``.

    Raises
    ------
    SchemaError
        A term without value or standard error, standard errors that are not positive, ranges that
        are none, a correlation that is none: every problem.
    UnknownName
        A variable that is not in the vocabulary.
    IdentificationError
        The conditions do not determine the terms, as a power at a single condition.

    Examples
    --------
    >>> fit = published_fit(
    ...     "Cm = 1 + alpha + qhat + delta_e",
    ...     {"1": 0.03, "alpha": -0.56, "qhat": -17.6, "delta_e": -1.16},
    ...     {"1": 0.01, "alpha": 0.06, "qhat": 1.8, "delta_e": 0.12},
    ...     {"mach": 0.27, "alpha": (0.03, 0.14), "delta_e": (-0.05, 0.02), "qhat": 0.0, "h": 2000.0},
    ...     name="NASA TM 0000",
    ... )
    >>> [float(x) for x in fit.estimates["estimate"]]
    [0.03, -0.56, -17.6, -1.16]
    """
    model = RegressionModel.parse(model) if isinstance(model, str) else model
    _demand(model, values, stderr, conditions, correlation)
    data = _grid(model, conditions)
    X, terms = model.design(data), list(model.terms)
    terms, X = list(model.terms), model.design(data)
    try:
        collinearity.demand_rank(X, terms)
    except IdentificationError as error:
        raise IdentificationError(
            f"{name or model}: the conditions do not determine the terms: {error}"
        ) from None
    theta, sd = (np.array([float(given[term]) for term in terms]) for given in (values, stderr))
    data[model.coefficient] = "sample", X @ theta
    design = least_squares.label_terms(X, terms)
    R = np.eye(len(terms)) if correlation is None else np.asarray(correlation, float)
    found = least_squares.regression_estimates(
        terms,
        theta,
        R * np.outer(sd, sd),
        sd,
        ([], np.zeros((len(terms), 0))),
        _unpublished(len(terms)),
    )
    found.attrs = {
        "coefficient": model.coefficient, "domain": "published", "R2": np.nan, "residual_rms": np.nan, "samples": 0, "manoeuvres": 0,
        "offset": np.nan, "name": name, "intercepts": "common",
    }  # fmt: skip
    return Fit(name, model, found, data, design, design)


def _unpublished(count: int) -> dict[str, tuple]:
    """Return what only samples could determine."""
    row, square = np.full(count, np.nan), np.full((count, count), np.nan)
    return {
        "vif": ("term", row),
        "contribution": ("term", row),
        "regressor_correlation": (("term", "term_"), square),
        "condition_index": ("component", row),
        "proportion": (("component", "term"), square),
    }


def _grid(
    model: RegressionModel, conditions: Mapping[str, float | Sequence[float] | str]
) -> xr.Dataset:
    """Return every combination of the conditions along ``sample``: two points per tangent, as many
    as fit in per range.
    """
    tied = {name: item for name, item in conditions.items() if isinstance(item, str)}
    ranges = {
        name: _ends(item, name in model.variables)
        for name, item in conditions.items()
        if not isinstance(item, str)
    }
    moving = [name for name, (low, high) in ranges.items() if high > low]
    wide = [name for name in moving if not isinstance(conditions[name], float | int)]
    room = _ROWS / 2 ** (len(moving) - len(wide))
    count = int(np.clip(room ** (1.0 / max(len(wide), 1)), 3, _MOST))
    levels = {
        name: np.linspace(*ends, count if name in wide else 1 + (name in moving))
        for name, ends in ranges.items()
    }
    mesh = np.meshgrid(*levels.values(), indexing="ij")
    columns = {name: x.ravel() for name, x in zip(levels, mesh)}
    size = len(next(iter(columns.values()))) if columns else 1
    columns = {name: np.zeros(size) for name in _RATES if name not in conditions} | columns
    columns |= {name: columns[other].copy() for name, other in tied.items()}
    return xr.Dataset(
        {name: ("sample", x, {"units": lookup(name).units}) for name, x in columns.items()}
    )


def _ends(condition: float | Sequence[float], moves: bool) -> tuple[float, float]:
    if not isinstance(condition, float | int):
        return float(condition[0]), float(condition[1])
    step = _TANGENT * max(1.0, abs(condition)) if moves else 0.0
    return condition - step, condition + step


def _demand(model: RegressionModel, values, stderr, conditions, correlation) -> None:
    """Raise with every problem."""
    problems = []
    for what, given in (("value", values), ("standard error", stderr)):
        problems += [f"{term} has no {what}" for term in model.terms if term not in given]
        problems += [
            f"{term} has a {what} and is no term of {model}"
            for term in given
            if term not in model.terms
        ]
    problems += [
        f"the value of {term} is {values[term]!r}; a number is needed"
        for term in values
        if not np.isfinite(values[term])
    ]
    problems += [
        f"the standard error of {term} is {stderr[term]!r}; give a positive one, wide if it "
        f"was not published"
        for term in stderr
        if not 0.0 < stderr[term] < np.inf
    ]
    problems += [
        text for name, item in conditions.items() for text in _faults(name, item, conditions)
    ]
    curved = {
        variable_of(factor)
        for term in model.terms
        for factor, power in term_powers(term).items()
        if power > 1 or "(" in factor
    }
    for name in model.variables:
        if name not in conditions:
            problems.append(
                f"{name} has no condition; give a number, a range (low, high), or the "
                f"variable that it moves with"
            )
        elif name in curved and isinstance(conditions[name], float | int):
            problems.append(
                f"{name} has the one condition {conditions[name]!r} and a power or ramp in "
                f"the model; give a range (low, high)"
            )
    if correlation is not None:
        problems += _correlation_faults(np.asarray(correlation, float), len(model.terms))
    if problems:
        raise SchemaError("published fit", problems)


def _faults(name: str, item: float | Sequence[float] | str, conditions: Mapping) -> list[str]:
    lookup(name)
    if isinstance(item, str):
        known = item in conditions and not isinstance(conditions[item], str)
        return (
            []
            if known
            else [f"{name} moves with {item!r}, which has no number or range of its own"]
        )
    ends = np.atleast_1d(np.asarray(item, float))
    if len(ends) > 2 or not np.isfinite(ends).all() or (len(ends) == 2 and not ends[0] < ends[1]):
        return [
            f"the condition of {name} is {item!r}; give a number, or a range (low, high) "
            f"with low below high"
        ]
    return []


def _correlation_faults(R: np.ndarray, count: int) -> list[str]:
    if R.shape != (count, count):
        return [f"the correlation is {R.shape}; the model has {count} terms"]
    whole = (
        np.isfinite(R).all() and np.allclose(R, R.T, atol=1e-12) and np.allclose(np.diag(R), 1.0)
    )
    if not whole or np.linalg.eigvalsh(R)[0] <= 0.0:
        return ["the correlation is not symmetric with a diagonal of ones and positive eigenvalues"]
    return []


NEEDED = ("model", "coefficient", "term", "value", "stderr")
_UNIT = "unit"
_REFERENCE = "reference"  # "alpha reference [deg]": the point about which the model is an expansion
_HEAD = re.compile(r"(.*?)\s*(?:\[(.*)\])?")
_RANGE = re.compile(r"\s*\.\.\.?\s*")  # 2 .. 6

Condition = float | tuple[float, float] | str


class _Row(NamedTuple):
    """One line of the file."""

    line: int
    term: str
    value: float
    stderr: float
    conditions: dict[str, Condition]
    reference: dict[str, float]


def read_published(path: str | Path) -> list[Fit]:
    """Return the local models of a CSV file as fits, for `aerodb.tabulate` and `join_fits`; no
    samples are invented.

    Parameters
    ----------
    path : path
        Separated by commas, or by semicolons, then with decimal points or commas; a line of names
        first.  Columns:

        - ``model``: name of the local model, which may have one row for each of its terms; ``coefficient``, ``term`` (``1``, ``alpha``,
          ``alpha**2``), ``value``, ``stderr``;
        - ``unit`` where value and standard error are not in SI, such as ``1/deg``;
        - any variable with its unit, ``alpha [deg]``: the condition, a number or a range ``2 .. 6`` over which the model holds, or the
          name of the variable that it moves with.  An empty cell states nothing; cells of one model
          must agree where they are filled;
        - ``alpha reference [deg]``: the point about which the model is an expansion.

    Returns
    -------
    list of Fit
        One per model and coefficient in the order of the file, as from `published_fit`, named by
        the column ``model``.

    Raises
    ------
    ParseError
        No line of names, or a row of another length.
    SchemaError
        Unknown or missing columns, cells that are no numbers, conditions that contradict each
        other, and every problem that `published_fit` finds in a model; all of them, with the line.
    """
    path = Path(path)
    text = read_text(path, "a CSV text with the columns " + ", ".join(NEEDED), WESTERN)
    first = text.split("\n", 1)[0]
    separator = ";" if first.count(";") > first.count(",") else ","
    lines = csv_rows(text, path, separator)
    columns = _columns(path, [cell.strip() for cell in lines[0]] if lines else [])
    problems: list[str] = []
    groups: dict[tuple[str, str], list[_Row]] = {}
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(lines[0]):
            raise ParseError(
                str(path),
                number,
                f"{len(cells)} cells",
                f"{len(lines[0])}, as the line of names has; quote texts with commas",
            )
        row = {name: cell.strip() for name, cell in zip(columns, cells, strict=True)}
        if separator == ";":
            row = {
                name: cell if name in ("model", "coefficient", "term") else cell.replace(",", ".")
                for name, cell in row.items()
            }
        read = _row(number, row, columns, problems)
        groups.setdefault((row["model"], row["coefficient"]), []).append(read)
    fits = [
        fit
        for (name, coefficient), rows in groups.items()
        if (fit := _fit(name, coefficient, rows, problems)) is not None
    ]
    if not groups:
        problems.append("no row below the line of names")
    if problems:
        raise SchemaError(str(path), problems)
    return fits


def _columns(path: Path, heads: list[str]) -> dict[str, str]:
    """Return the name of every column, with its unit."""
    split = [match.groups() if (match := _HEAD.fullmatch(head)) else (head, None) for head in heads]
    names = [name for name, _ in split]
    problems = [
        f"no column {name!r}; needed are {', '.join(NEEDED)}"
        for name in NEEDED
        if name not in names
    ]
    problems += [
        f"the column {name!r} stands twice"
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    for name, unit in split:
        if name in (*NEEDED, _UNIT):
            continue
        try:
            variable = lookup(name.removesuffix(_REFERENCE).strip())
            to_si(0.0, unit or variable.units, variable.units)
        except AeromatchError as error:
            problems.append(f"column {name!r}: {error}")
    if problems:
        raise SchemaError(str(path), problems)
    return {name: unit or "" for name, unit in split}


def _row(
    line: int, cells: Mapping[str, str], columns: Mapping[str, str], problems: list[str]
) -> _Row:
    scale = _scale(line, cells, problems)
    value, stderr = (
        scale * _number(line, key, cells[key], problems) for key in ("value", "stderr")
    )
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    for name, cell in cells.items():
        if name in (*NEEDED, _UNIT) or not cell:
            continue
        variable = name.removesuffix(_REFERENCE).strip()
        unit = columns[name] or lookup(variable).units
        if variable != name:
            reference[variable] = to_si(_number(line, name, cell, problems), unit)
        elif re.fullmatch(r"[A-Za-z_][\w.]*", cell):
            conditions[name] = cell
        else:
            ends = [to_si(_number(line, name, part, problems), unit) for part in _RANGE.split(cell)]
            conditions[name] = (
                ends[0]
                if len(ends) == 1
                else (ends[0], ends[1])
                if len(ends) == 2
                else _none(line, name, cell, problems)
            )
    return _Row(line, cells["term"], value, stderr, conditions, reference)


def _number(line: int, name: str, cell: str, problems: list[str]) -> float:
    try:
        return float(cell)
    except ValueError:
        return _none(line, name, cell, problems)


def _none(line: int, name: str, cell: str, problems: list[str]) -> float:
    what = (
        "a number"
        if name in NEEDED
        else "a number, a range such as 2 .. 6, or the name of a variable"
    )
    problems.append(f"line {line}: {name} is {cell!r}; give {what}")
    return float("nan")


def _scale(line: int, cells: Mapping[str, str], problems: list[str]) -> float:
    """Return the factor of the unit that a row states."""
    if not cells.get(_UNIT):
        return 1.0
    try:
        variables = [
            variable_of(factor)
            for factor, power in term_powers(cells["term"]).items()
            for _ in range(power)
            if factor != "1"
        ]
        expected = "/".join(["1", *(lookup(name).units for name in variables)])
        to_si(0.0, cells[_UNIT], expected)
        return parse_unit(cells[_UNIT])[1]
    except AeromatchError as error:
        problems.append(f"line {line}: {error}")
        return float("nan")


def _taken(known: dict, given: Mapping, place: str, line: int) -> list[str]:
    """Add the conditions of a row to those of its model; return those that contradict an earlier
    row.
    """
    return [
        f"{place}: {key} is {known[key]} and in line {line} {item}; a model has one condition"
        for key, item in given.items()
        if known.setdefault(key, item) != item
    ]


def _fit(name: str, coefficient: str, rows: list[_Row], problems: list[str]) -> Fit | None:
    """Return the local model of its rows, None when it is faulty."""
    place = f"{name or 'model without a name'}, {coefficient}, line {rows[0].line}"
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    before = len(problems)
    for row in rows:
        problems += _taken(conditions, row.conditions, place, row.line)
        problems += _taken(reference, row.reference, place, row.line)
    terms = [row.term for row in rows]
    problems += [
        f"{place}: the term {term} stands twice"
        for term in dict.fromkeys(terms)
        if terms.count(term) > 1
    ]
    if len(problems) > before or any(
        math.isnan(row.value) or math.isnan(row.stderr) for row in rows
    ):
        return None
    try:
        model = RegressionModel(coefficient, terms, reference)
        values, stderr = (
            {term: float(item) for term, item in zip(model.terms, column)}
            for column in zip(*((r.value, r.stderr) for r in rows))
        )
        return published_fit(model, values, stderr, conditions, name=name)
    except SchemaError as error:
        problems += [f"{place}: {text}" for text in error.problems]
    except AeromatchError as error:
        problems.append(f"{place}: {error}")
    return None
