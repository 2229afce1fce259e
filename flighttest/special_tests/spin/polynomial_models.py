"""A fitted polynomial model as a database that the kernel flies.

Reduced rates of the spin decomposition are linear in the body rates, with factors that depend on alpha and beta only::

    Omegahat = x phat + (b/cbar) y qhat + z rhat                 x, y, z = cos(al) cos(be), sin(be), sin(al) cos(be)
    phat_osc = phat - x Omegahat,  qhat_osc = qhat - (cbar/b) y Omegahat,  rhat_osc = rhat - z Omegahat
    rhat_wind = rhat cos(al) - phat sin(al)

So their terms become three tables over alpha and beta per coefficient, of phat, qhat and rhat.
Everything else is a product of powers and carries over exactly; deviations from a nominal state are
multiplied out first.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.errors import ParseError, SchemaError
from flightmech.support.input_files import csv_rows, read_text
from flightmech.terms import MAX_REGRESSORS, make_term
from flighttest.regression.equation_error.model import RegressionModel, term_powers
from flighttest.special_tests.spin.rotation_rates import WIND_RATES

ALPHA = np.radians(np.arange(-20.0, 60.5, 1.0))
BETA = np.radians(np.arange(-40.0, 40.5, 1.0))
_BODY_RATES = ("phat", "qhat", "rhat")
_IMPLICIT = (
    "alphadothat",
    "betadothat",
    "dnz",
)  # the kernel solves for them: regressors, never axes


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
    fitted : mapping of str to (Model, array (term,))
        Coefficient to its model and its estimates; ``{c: (fit.model,
        fit.estimates["estimate"].values)}``.
    aircraft : Aircraft
        For the lengths and the moment reference point.
    alpha, beta : array
        Breakpoints of the tables of the rates, needed for models with rates of `spin_variables`.
        [rad]
    title : str
        For the root of the database.

    Returns
    -------
    DataTree
        For `flightmech.compile`; terms such as ``CX/alpha2``, ``CZ/delta_e_delta_a``, ``Cm/basic``,
        ``Cl/phat``.

    Raises
    ------
    SchemaError
        Not the six coefficients CX CY CZ Cl Cm Cn.
    ParseError
        A term of too many factors, or a rate of the decomposition inside a product.

    Notes
    -----
    Between breakpoints 1 deg apart the tables of the rates are off by up to (1 deg)^2/8 = 4e-5 of their size.
    """
    wanted = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
    if missing := [name for name in wanted if name not in fitted]:
        raise SchemaError(
            "polynomial database",
            [f"no model of {name}; all of {' '.join(wanted)} are needed" for name in missing],
        )
    leaves: dict[str, xr.Dataset] = {}
    for coefficient, (model, estimates) in fitted.items():
        absolute, matrix = model.absolute()
        values = dict(zip(absolute.terms, matrix @ np.asarray(estimates, float), strict=True))
        rates = {
            term: value
            for term, value in values.items()
            if any(name in WIND_RATES for name in term_powers(term))
        }
        for term, value in values.items():
            if term not in rates:
                leaves[f"/{coefficient}/{_leaf_name(term)}"] = _term(term, value)
        if rates:
            factors = _rate_factors(rates, aircraft, *np.meshgrid(alpha, beta, indexing="ij"))
            for name, table in factors.items():
                if f"/{coefficient}/{name}" in leaves:
                    raise ParseError(
                        "<model>",
                        0,
                        f"{name} next to {' '.join(rates)} in {model}",
                        "body rates or rates of the decomposition",
                    )
                leaves[f"/{coefficient}/{name}"] = make_term(
                    table, {"alpha": alpha, "beta": beta}, [name]
                )
    x, y, z = reference_in(aircraft, {})
    about = {
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
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=about), **leaves})


def _leaf_name(term: str) -> str:
    return "basic" if term == "1" else term.replace("**", "").replace("*", "_")


def _term(term: str, value: float) -> xr.Dataset:
    """One product of powers: two factors are regressors, others become straight tables, one per
    axis variable.
    """
    factors = [name for name, power in term_powers(term).items() for _ in range(power)]
    factors.sort(key=lambda name: name not in _IMPLICIT)
    words, rest = factors[:MAX_REGRESSORS], factors[MAX_REGRESSORS:]
    if len(rest) != len(set(rest)) or set(rest) & set(_IMPLICIT):
        raise ParseError(
            "<model>",
            0,
            f"the term {term}",
            f"at most {MAX_REGRESSORS} factors next to first powers of other variables",
        )
    table, axes = np.array(value), {}
    for name in rest:
        axes[name] = np.array([-1.0, 1.0])
        table = np.multiply.outer(table, axes[name])
    return make_term(table, axes, words, outside="linear" if rest else "hold")


def _rate_factors(
    rates: Mapping[str, float], aircraft: Aircraft, alpha: np.ndarray, beta: np.ndarray
) -> dict[str, np.ndarray]:
    """What multiplies phat, qhat and rhat: arrays of the shape of `alpha` and `beta`."""
    x, y, z = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
    ratio, zero, one = aircraft.b / aircraft.cbar, np.zeros_like(x), np.ones_like(x)
    Omega = np.stack([x, ratio * y, z])
    rows = {
        "Omegahat": Omega,
        "phat_osc": np.stack([one, zero, zero]) - x * Omega,
        "qhat_osc": np.stack([zero, one, zero]) - y / ratio * Omega,
        "rhat_osc": np.stack([zero, zero, one]) - z * Omega,
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


GLIDE: Mapping[str, tuple[str, ...]] = {  # eq. (24)-(29)
    "CX": ("alpha", "qhat", "delta_e", "alpha**2", "beta**2", "1"),
    "CY": ("beta", "phat", "rhat", "delta_a", "delta_r", "1"),
    "CZ": ("alpha", "qhat", "delta_e", "beta**2", "1"),
    "Cl": ("beta", "phat", "rhat", "delta_a", "1"),
    "Cm": ("alpha", "qhat", "delta_e", "alpha**2", "alpha**3", "qhat**3", "1"),
    "Cn": ("beta", "phat", "rhat", "delta_a", "delta_r", "beta**2", "beta**3", "1"),
}
_RATES = ("Omegahat", "phat_osc", "qhat_osc", "rhat_osc")
_SURFACES = ("delta_e", "delta_a", "delta_r")
SPIN: Mapping[str, tuple[str, ...]] = {  # eq. (30)-(35)
    "CX": ("alpha", "alphadothat", "beta", *_RATES, *_SURFACES, "delta_e**2", "1"),
    "CY": ("alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_e**2", "1"),
    "CZ": (
        "alpha",
        "alphadothat",
        "beta",
        *_RATES,
        *_SURFACES,
        "delta_e**2",
        "delta_e*delta_a",
        "1",
    ),
    "Cl": ("alpha", "alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_r**2", "1"),
    "Cm": (
        "alpha",
        "alphadothat",
        "beta",
        *_RATES,
        *_SURFACES,
        "delta_e**2",
        "delta_e*delta_a",
        "1",
    ),
    "Cn": ("alpha", "alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_a**2", "1"),
}


def models_of_structure(
    structure: Mapping[str, tuple[str, ...]], nominal: Mapping[str, float] | None = None
) -> dict[str, RegressionModel]:
    """Return one model per coefficient.

    Parameters
    ----------
    structure : mapping of str to tuple of str
        Coefficient to terms: `GLIDE`, `SPIN`, or any other.
    nominal : mapping of str to float, optional
        Values that variables count from, as `nominal_variables` gives them; variables that it lacks
        are absolute.  The published spin model is in deviations, the glide model is absolute. [SI]

    Raises
    ------
    UnknownName
        A variable or a coefficient that is not in the vocabulary.
    """
    found = {}
    for coefficient, terms in structure.items():
        variables = {name for term in terms for name in term_powers(term)}
        found[coefficient] = RegressionModel(
            coefficient,
            terms,
            {name: value for name, value in (nominal or {}).items() if name in variables},
        )
    return found


COLUMNS = ("coefficient", "term", "estimate", "sigma")


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
            coefficient, found_row = (
                row["coefficient"],
                (row["term"], float(row[column]), float(row["sigma"])),
            )
        except (KeyError, ValueError) as error:
            raise ParseError(
                str(path), number, str(error), f"numbers in {column} and sigma"
            ) from error
        rows.setdefault(coefficient, []).append(found_row)
    found = {}
    for coefficient, lines in rows.items():
        terms = [term for term, _, _ in lines]
        variables = {name for term in terms for name in term_powers(term)}
        model = RegressionModel(
            coefficient,
            terms,
            {name: value for name, value in (nominal or {}).items() if name in variables},
        )
        found[coefficient] = Polynomial(model, *np.array([numbers for _, *numbers in lines]).T)
    return found
