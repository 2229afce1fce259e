"""Polynomial models of a spin, and their databases for simulation.

Reduced rates of the spin decomposition are linear in the body rates, with factors that depend on
alpha and beta only::

    x, y, z = cos(alpha) cos(beta), sin(beta), sin(alpha) cos(beta)
    Omegahat = x phat + (b/cbar) y qhat + z rhat
    phat_osc = phat - x Omegahat
    qhat_osc = qhat - (cbar/b) y Omegahat
    rhat_osc = rhat - z Omegahat
    rhat_wind = rhat cos(alpha) - phat sin(alpha)

So their terms become three tables over alpha and beta per coefficient, of phat, qhat and rhat.  All
other terms are products of powers, which a database has without an error.  Deviations from a
nominal state are multiplied out first.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.errors import ParseError, SchemaError
from flightmech.names import IMPLICIT
from flightmech.terms import MAX_REGRESSORS, make_term
from flighttest.records.text_tables import read_text_table
from flighttest.regression.equation_error.model import RegressionModel, term_powers
from flighttest.special_tests.spin.rotation_rates import WIND_RATES

ALPHA = np.radians(np.arange(-20.0, 60.5, 1.0))
BETA = np.radians(np.arange(-40.0, 40.5, 1.0))
_REQUIRED = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
_BODY_RATES = ("phat", "qhat", "rhat")
COLUMNS = ("coefficient", "term", "estimate", "sigma")

# Glide model, eq. (24)-(29)
GLIDE: Mapping[str, tuple[str, ...]] = {
    "CX": ("alpha", "qhat", "delta_e", "alpha**2", "beta**2", "1"),
    "CY": ("beta", "phat", "rhat", "delta_a", "delta_r", "1"),
    "CZ": ("alpha", "qhat", "delta_e", "beta**2", "1"),
    "Cl": ("beta", "phat", "rhat", "delta_a", "1"),
    "Cm": ("alpha", "qhat", "delta_e", "alpha**2", "alpha**3", "qhat**3", "1"),
    "Cn": ("beta", "phat", "rhat", "delta_a", "delta_r", "beta**2", "beta**3", "1"),
}
_RATES = ("Omegahat", "phat_osc", "qhat_osc", "rhat_osc")
_SURFACES = ("delta_e", "delta_a", "delta_r")
_LINEAR = (*_RATES, *_SURFACES)
# Spin model, eq. (30)-(35)
SPIN: Mapping[str, tuple[str, ...]] = {
    "CX": ("alpha", "alphadothat", "beta", *_LINEAR, "delta_e**2", "1"),
    "CY": ("alphadothat", "beta", "betadothat", *_LINEAR, "delta_e**2", "1"),
    "CZ": ("alpha", "alphadothat", "beta", *_LINEAR, "delta_e**2", "delta_e*delta_a", "1"),
    "Cl": ("alpha", "alphadothat", "beta", "betadothat", *_LINEAR, "delta_r**2", "1"),
    "Cm": ("alpha", "alphadothat", "beta", *_LINEAR, "delta_e**2", "delta_e*delta_a", "1"),
    "Cn": ("alpha", "alphadothat", "beta", "betadothat", *_LINEAR, "delta_a**2", "1"),
}


def polynomial_database(
    fitted: Mapping[str, tuple[RegressionModel, np.ndarray]],
    aircraft: Aircraft,
    alpha: np.ndarray = ALPHA,
    beta: np.ndarray = BETA,
    title: str = "",
) -> xr.DataTree:
    """Return fitted models as a database in body axes (``force_axes`` "body": CX CY CZ).

    Parameters
    ----------
    fitted : mapping of str to (RegressionModel, array (term,))
        Coefficient to its model and its estimates; ``{c: (fit.model,
        fit.estimates["estimate"].values)}``.
    aircraft : Aircraft
        Reference lengths and moment reference point.
    alpha, beta : array
        Breakpoints of the tables of the rates, for models with rates of `spin_variables`. [rad]
    title : str
        Title of the database.

    Returns
    -------
    DataTree
        For `flightmech.compile`; terms such as ``CX/alpha2``, ``CZ/delta_e_delta_a``, ``Cm/basic``,
        ``Cl/phat``.

    Raises
    ------
    SchemaError
        One of the six coefficients CX CY CZ Cl Cm Cn is missing.
    ParseError
        A term has too many factors, or a rate of the decomposition is in a product.

    Notes
    -----
    Between breakpoints 1 deg apart the tables of the rates have errors of up to (1 deg)^2/8 = 4e-5
    of their size.
    """
    missing = [name for name in _REQUIRED if name not in fitted]
    if missing:
        problems = [
            f"no model of {name}; all of {' '.join(_REQUIRED)} are needed" for name in missing
        ]
        raise SchemaError("polynomial database", problems)
    leaves = {"/": _make_root(aircraft, title)}
    for coefficient, (model, estimates) in fitted.items():
        terms = _coefficient_terms(model, estimates, aircraft, alpha=alpha, beta=beta)
        for name, leaf in terms.items():
            leaves[f"/{coefficient}/{name}"] = leaf
    return xr.DataTree.from_dict(leaves)


def _make_root(aircraft: Aircraft, title: str) -> xr.Dataset:
    """Return the root of the database with the references of the aircraft."""
    x, y, z = reference_in(aircraft, {})
    attributes = {
        "title": title,
        "aircraft": aircraft.name,
        "force_axes": "body",
        "S": aircraft.S,
        "cbar": aircraft.cbar,
        "b": aircraft.b,
        "x_ref": x,
        "y_ref": y,
        "z_ref": z,
    }
    return xr.Dataset(attrs=attributes)


def _coefficient_terms(
    model: RegressionModel,
    estimates: np.ndarray,
    aircraft: Aircraft,
    *,
    alpha: np.ndarray,
    beta: np.ndarray,
) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient: products of powers, then tables of the body rates."""
    absolute, matrix = model.absolute()
    values = dict(zip(absolute.terms, matrix @ np.asarray(estimates, float), strict=True))
    leaves, rates = {}, {}
    for term, value in values.items():
        if any(name in WIND_RATES for name in term_powers(term)):
            rates[term] = value
        else:
            leaves[_leaf_name(term)] = _make_product(term, value)
    if not rates:
        return leaves
    factors = _rate_factors(rates, aircraft, *np.meshgrid(alpha, beta, indexing="ij"))
    for name, table in factors.items():
        if name in leaves:
            raise ParseError(
                "<model>",
                0,
                f"{name} next to {' '.join(rates)} in {model}",
                "body rates or rates of the decomposition",
            )
        leaves[name] = make_term(table, {"alpha": alpha, "beta": beta}, [name])
    return leaves


def _leaf_name(term: str) -> str:
    if term == "1":
        return "basic"
    return term.replace("**", "").replace("*", "_")


def _make_product(term: str, value: float) -> xr.Dataset:
    """Return the term of a product of powers.

    Up to `MAX_REGRESSORS` factors are regressors. Every other factor is the axis of a table that is
    a straight line.
    """
    factors = []
    for name, power in term_powers(term).items():
        factors += [name] * power
    # variables that cannot be axes come first
    factors.sort(key=lambda name: name not in IMPLICIT)
    regressors, axis_names = factors[:MAX_REGRESSORS], factors[MAX_REGRESSORS:]
    is_repeated = len(axis_names) != len(set(axis_names))
    if is_repeated or set(axis_names) & set(IMPLICIT):
        raise ParseError(
            "<model>",
            0,
            f"the term {term}",
            f"at most {MAX_REGRESSORS} factors next to first powers of other variables",
        )
    table, axes = np.array(value), {}
    for name in axis_names:
        axes[name] = np.array([-1.0, 1.0])
        table = np.multiply.outer(table, axes[name])
    # a straight line continues outside its two nodes
    outside = "linear" if axis_names else "hold"
    return make_term(table, axes, regressors, outside=outside)


def _rate_factors(
    rates: Mapping[str, float], aircraft: Aircraft, alpha: np.ndarray, beta: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the factors of phat, qhat and rhat, in the shape of `alpha` and `beta`."""
    x, y, z = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
    ratio, zero, unity = aircraft.b / aircraft.cbar, np.zeros_like(x), np.ones_like(x)
    # rows of the decomposition: factors of phat, qhat, rhat
    Omega = np.stack([x, ratio * y, z])
    rows = {
        "Omegahat": Omega,
        "phat_osc": np.stack([unity, zero, zero]) - x * Omega,
        "qhat_osc": np.stack([zero, unity, zero]) - y / ratio * Omega,
        "rhat_osc": np.stack([zero, zero, unity]) - z * Omega,
        "rhat_wind": np.stack([-np.sin(alpha), zero, np.cos(alpha)]),
    }
    total = np.zeros_like(Omega)
    for term, value in rates.items():
        if term not in rows:
            raise ParseError(
                "<model>", 0, f"the term {term}", f"{' '.join(rows)} alone and to the first power"
            )
        total += value * rows[term]
    return dict(zip(_BODY_RATES, total, strict=True))


def models_of_structure(
    structure: Mapping[str, tuple[str, ...]], nominal: Mapping[str, float] | None = None
) -> dict[str, RegressionModel]:
    """Return one model per coefficient.

    Parameters
    ----------
    structure : mapping of str to tuple of str
        Coefficient to terms: `GLIDE`, `SPIN`, or any other.
    nominal : mapping of str to float, optional
        Nominal values of variables, as from `nominal_variables`; other variables are absolute.  The
        published spin model is in deviations, the glide model is absolute. [SI]

    Raises
    ------
    UnknownName
        A variable or a coefficient is not in the vocabulary.
    """
    models = {}
    for coefficient, terms in structure.items():
        models[coefficient] = _make_model(coefficient, terms, nominal or {})
    return models


def _make_model(
    coefficient: str, terms: Sequence[str], nominal: Mapping[str, float]
) -> RegressionModel:
    """Return a model in deviations from the nominal values of its own variables."""
    variables: set[str] = set()
    for term in terms:
        variables |= set(term_powers(term))
    reference = {name: value for name, value in nominal.items() if name in variables}
    return RegressionModel(coefficient, terms, reference)


class Polynomial(NamedTuple):
    """A model of one coefficient with its estimates and their standard errors, (term,)."""

    model: RegressionModel
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
        Nominal values of variables, as from `nominal_variables`. [SI]
    column : str
        Column of the estimates.

    Returns
    -------
    dict of str to Polynomial
        In the order of the file.

    Raises
    ------
    ParseError
        A column or a number is missing; the error names the line.
    UnknownName
        A coefficient or variable is not in the vocabulary.
    """
    table = read_text_table(path, "polynomials in CSV")
    missing = [name for name in (*COLUMNS, column) if name not in table.names]
    if missing:
        found = f"columns {', '.join(table.names)}"
        raise ParseError(str(path), 1, found, f"also {', '.join(missing)}")
    # terms and numbers (estimate, sigma) by coefficient
    terms: dict[str, list[str]] = {}
    numbers: dict[str, list[tuple[float, float]]] = {}
    for row, line in enumerate(table.lines):
        pair = table.number(row, column), table.number(row, "sigma")
        if not np.isfinite(pair).all():
            found, expected = "an empty cell or NaN", f"numbers in {column} and sigma"
            raise ParseError(str(path), line, found, expected)
        coefficient = table.text(row, "coefficient")
        terms.setdefault(coefficient, []).append(table.text(row, "term"))
        numbers.setdefault(coefficient, []).append(pair)
    polynomials = {}
    for coefficient, rows in terms.items():
        model = _make_model(coefficient, rows, nominal or {})
        estimates, sigma = np.array(numbers[coefficient]).T
        polynomials[coefficient] = Polynomial(model, estimates, sigma)
    return polynomials
