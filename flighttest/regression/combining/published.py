"""Fits of published values, on a grid of the conditions in which the values hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError
from flightmech.names import lookup
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.uncertainty import collinearity

Condition = float | Sequence[float] | str

# half the range over which a tangent is taken, of the value of the variable or of one, whichever is
# larger
_TANGENT = 1e-4
_ROWS, _MOST = 16384, 33  # points of the grid in total, and along one variable
_FEWEST = 3  # points along a range: they determine a parabola
_RATES = ("phat", "qhat", "rhat", "alphadothat", "betadothat")  # zero unless stated


def published_fit(
    model: RegressionModel | str,
    values: Mapping[str, float],
    stderr: Mapping[str, float],
    conditions: Mapping[str, Condition],
    correlation: np.ndarray | None = None,
    name: str = "",
) -> Fit:
    """Return a fit of published values, for `aerodb.tabulate`, `join_fits` and `Fit.predict`.

    Parameters
    ----------
    model : RegressionModel or str
        Such as ``"Cm = 1 + alpha + qhat + delta_e"``. With `RegressionModel.reference` the values
        are those of an expansion about a point.
    values, stderr : mapping of str to float
        Value and standard error of every term of the model. Rates are reduced by b/2V and cbar/2V:
        a derivative over q cbar/V is twice as large here. [1, 1/rad]
    conditions : mapping of str to float, (low, high) or str
        Conditions in which the model holds: every variable of the model and of the tables. A number
        is the condition. A pair is the range in which the model was determined or is stated to
        hold; variables with higher powers and ramps need it. A name is a variable that is equal to
        this one: ``{"alphadothat": "qhat"}`` if the value of ``qhat`` is the sum of both
        derivatives, as in a short period. Rates without condition are zero. [SI]
    correlation : array (terms, terms), optional
        Correlation of the values, in the order of the model; default independent.
    name : str
        Source, for reports and provenance.

    Returns
    -------
    Fit
        ``data`` and ``design`` contain the grid of conditions with the coefficient of the model
        itself. Figures that need samples, ``vif``, ``contribution``, ``R2``, ``residual_rms`` ...,
        are NaN. Attribute ``domain`` is ``published``.

    Raises
    ------
    SchemaError
        A term without value or standard error, standard errors that are not positive, invalid
        ranges, or an invalid correlation. One error lists every problem.
    UnknownName
        A variable that is not in the vocabulary.
    IdentificationError
        The conditions do not determine the terms, such as a power at a single condition.

    Examples
    --------
    >>> fit = published_fit(
    ...     "Cm = 1 + alpha + qhat + delta_e",
    ...     {"1": 0.03, "alpha": -0.56, "qhat": -17.6, "delta_e": -1.16},
    ...     {"1": 0.01, "alpha": 0.06, "qhat": 1.8, "delta_e": 0.12},
    ...     {"mach": 0.27, "alpha": (0.03, 0.14), "delta_e": (-0.05, 0.02), "qhat": 0.0, "h": 2e3},
    ...     name="NASA TM 0000",
    ... )
    >>> [float(x) for x in fit.estimates["estimate"]]
    [0.03, -0.56, -17.6, -1.16]
    """
    if isinstance(model, str):
        model = RegressionModel.parse(model)
    _demand_values(model, values, stderr=stderr, conditions=conditions, correlation=correlation)
    data = _make_grid(model, conditions)
    X, terms = model.design(data), list(model.terms)
    try:
        collinearity.demand_rank(X, terms)
    except IdentificationError as error:
        raise IdentificationError(
            f"{name or model}: the conditions do not determine the terms: {error}"
        ) from None
    # The grid has the coefficient of the model itself, without noise: its fit is the model.
    theta = np.array([float(values[term]) for term in terms])
    sigma = np.array([float(stderr[term]) for term in terms])
    R = np.eye(len(terms))
    if correlation is not None:
        R = np.asarray(correlation, float)
    data[model.coefficient] = "sample", X @ theta
    design = least_squares.label_terms(X, terms)
    estimates = least_squares.regression_estimates(
        terms,
        theta,
        covariance=R * np.outer(sigma, sigma),
        white=sigma,
        systematic=([], np.zeros((len(terms), 0))),
        extra=_unpublished_variables(len(terms)),
    )
    estimates.attrs = {
        "coefficient": model.coefficient,
        "domain": "published",
        "R2": np.nan,
        "residual_rms": np.nan,
        "samples": 0,
        "manoeuvres": 0,
        "offset": np.nan,
        "name": name,
        "intercepts": "common",
    }
    return Fit(name, model, estimates, data=data, design=design, regressors=design)


def _unpublished_variables(count: int) -> dict[str, Any]:
    """Return the diagnostics that only samples could determine, as NaN."""
    row, square = np.full(count, np.nan), np.full((count, count), np.nan)
    return {
        "vif": ("term", row),
        "contribution": ("term", row),
        "regressor_correlation": (("term", "term_"), square),
        "condition_index": ("component", row),
        "proportion": (("component", "term"), square),
    }


def _make_grid(model: RegressionModel, conditions: Mapping[str, Condition]) -> xr.Dataset:
    """Return every combination of the conditions along ``sample``.

    A tangent has two points. The ranges share the other points of the grid.
    """
    ranges, tied, wide = {}, {}, []
    for name, condition in conditions.items():
        if isinstance(condition, str):
            tied[name] = condition
            continue
        ranges[name] = _condition_range(condition, name in model.variables)
        if not isinstance(condition, float | int) and ranges[name][1] > ranges[name][0]:
            wide.append(name)
    tangents = [name for name, (low, high) in ranges.items() if high > low and name not in wide]
    # points per range, so that the grid has at most _ROWS points
    available = _ROWS / 2 ** len(tangents)
    count = int(np.clip(available ** (1.0 / max(len(wide), 1)), _FEWEST, _MOST))
    levels = []
    for name, (low, high) in ranges.items():
        points = 1
        if name in wide:
            points = count
        elif name in tangents:
            points = 2
        levels.append(np.linspace(low, high, points))
    mesh = np.meshgrid(*levels, indexing="ij")
    size = mesh[0].size if mesh else 1
    columns = {name: np.zeros(size) for name in _RATES if name not in conditions}
    for name, values in zip(ranges, mesh):
        columns[name] = values.ravel()
    for name, source in tied.items():
        columns[name] = columns[source].copy()
    variables = {}
    for name, column in columns.items():
        variables[name] = "sample", column, {"units": lookup(name).units}
    return xr.Dataset(variables)


def _condition_range(condition: float | Sequence[float], is_variable: bool) -> tuple[float, float]:
    """Return the ends of a range; those of a tangent for a single value of a model variable."""
    if not isinstance(condition, float | int):
        return float(condition[0]), float(condition[1])
    step = _TANGENT * max(1.0, abs(condition)) if is_variable else 0.0
    return condition - step, condition + step


def _demand_values(
    model: RegressionModel,
    values: Mapping[str, float],
    stderr: Mapping[str, float],
    conditions: Mapping[str, Condition],
    correlation: np.ndarray | None,
) -> None:
    """Raise one error with every problem of published values."""
    problems = [
        *_list_term_faults(model, values, "value"),
        *_list_term_faults(model, stderr, "standard error"),
    ]
    for term, value in values.items():
        if not np.isfinite(value):
            problems.append(f"the value of {term} is {value!r}; a number is needed")
    for term, sigma in stderr.items():
        if not 0.0 < sigma < np.inf:
            problems.append(
                f"the standard error of {term} is {sigma!r}; give a positive one, wide if it "
                f"was not published"
            )
    for name, condition in conditions.items():
        problems += _list_condition_faults(name, condition, conditions)
    problems += _list_variable_faults(model, conditions)
    if correlation is not None:
        problems += _list_correlation_faults(np.asarray(correlation, float), len(model.terms))
    if problems:
        raise SchemaError("published fit", problems)


def _list_term_faults(model: RegressionModel, column: Mapping[str, float], label: str) -> list[str]:
    """Return the terms without a value, and the values without a term."""
    faults = [f"{term} has no {label}" for term in model.terms if term not in column]
    for term in column:
        if term not in model.terms:
            faults.append(f"{term} has a {label} and is not a term of {model}")
    return faults


def _list_variable_faults(model: RegressionModel, conditions: Mapping[str, Condition]) -> list[str]:
    """Return the model variables without a condition that determines their terms."""
    # A power or a ramp needs a range: one tangent does not determine it.
    curved = set()
    for term in model.terms:
        for factor, power in term_powers(term).items():
            if power > 1 or "(" in factor:
                curved.add(variable_of(factor))
    faults = []
    for name in model.variables:
        if name not in conditions:
            faults.append(
                f"{name} has no condition; give a number, a range (low, high), or the "
                f"variable that it moves with"
            )
        elif name in curved and isinstance(conditions[name], float | int):
            faults.append(
                f"{name} has the one condition {conditions[name]!r} and a power or ramp in "
                f"the model; give a range (low, high)"
            )
    return faults


def _list_condition_faults(
    name: str, condition: Condition, conditions: Mapping[str, Condition]
) -> list[str]:
    """Return what is wrong with one condition."""
    lookup(name)
    if isinstance(condition, str):
        if condition in conditions and not isinstance(conditions[condition], str):
            return []
        return [
            f"{name} moves with {condition!r}, which has neither a number nor a range in "
            f"the conditions"
        ]
    ends = np.atleast_1d(np.asarray(condition, float))
    if len(ends) > 2 or not np.isfinite(ends).all() or (len(ends) == 2 and not ends[0] < ends[1]):
        return [
            f"the condition of {name} is {condition!r}; give a number, or a range (low, high) "
            f"with low below high"
        ]
    return []


def _list_correlation_faults(R: np.ndarray, count: int) -> list[str]:
    """Return what is wrong with a correlation matrix."""
    if R.shape != (count, count):
        return [f"the correlation is {R.shape}; the model has {count} terms"]
    is_symmetric = np.isfinite(R).all() and np.allclose(R, R.T, atol=1e-12)
    if not is_symmetric or not np.allclose(np.diag(R), 1.0) or np.linalg.eigvalsh(R)[0] <= 0.0:
        return ["the correlation is not symmetric with a diagonal of ones and positive eigenvalues"]
    return []
