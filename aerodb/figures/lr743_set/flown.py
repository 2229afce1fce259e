"""Flight data of ``aeromatch match``: samples, manoeuvres, local estimates, submodels."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.figures.symbols import number_text, printed_unit, to_printed_unit
from aerodb.store.evaluation import contributions
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.air import atmosphere
from flightmech.aircraft.controls import ICE
from flightmech.envelope.maps import AT_REST
from flightmech.errors import ParseError
from flightmech.short_text import ShortText
from flightmech.support.hdf5_seal import demand_self_contained

FLOWN = "flown.nc"
"""Name of the file in the folder that ``aeromatch match`` writes."""

# Columns that each table of the file must have.
_COLUMNS = {
    "samples": ("manoeuvre", "alpha", "mach", "CL"),
    "manoeuvres": (
        "record",
        "label",
        "h",
        "mach",
        "CL",
        "alpha",
        "mass",
        "delta_f",
        "gear",
        "speedbrake",
        "h_agl",
    ),
    "estimates": (
        "fit",
        "coefficient",
        "term",
        "estimate",
        "stderr",
        "alpha",
        "mach",
        "delta_f",
        "gear",
        "speedbrake",
        "h_agl",
    ),
    "submodels": ("submodel", "part", "technique", "residual"),
}
_GROUND = ("coefficient", "term", "y_inf", "k", "k_stderr", "s", "s_stderr", "correlation", "note")
# Height above the ground without ground effect, more than one span of any aeroplane. [m]
_FREE = 100.0
_HEIGHT_GAP = 300.0  # between two heights that are distinguished [m]


@dataclass(frozen=True)
class FlightData(ShortText):
    """Flight data of one project.

    Attributes
    ----------
    source : str
        Origin of the data in words.
    samples : DataFrame
        ``manoeuvre`` (row of `manoeuvres`) and variables and coefficients along it. [SI]
    manoeuvres : DataFrame
        ``record label start end`` and the means over the first half second, the steady condition
        from which the manoeuvre begins. [SI]
    estimates : DataFrame
        One row per local estimate: ``fit coefficient term estimate stderr`` and the means of its
        samples. [SI]
    submodels : DataFrame
        [LR743] table 1: ``submodel part technique residual``.
    ground : DataFrame
        [LR743] table 2; empty if no ground effect was identified.
    """

    source: str
    samples: pd.DataFrame
    manoeuvres: pd.DataFrame
    estimates: pd.DataFrame
    submodels: pd.DataFrame
    ground: pd.DataFrame


def read_flown(path: str | os.PathLike[str]) -> FlightData:
    """Return the flight data of a file that ``aeromatch match`` wrote.

    Raises
    ------
    ParseError
        The file is not such a file.
    FileNotFoundError
        The file does not exist.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: no such file; `aeromatch match` writes {FLOWN} next to its databases"
        )
    demand_self_contained(path)
    try:
        with xr.open_datatree(path, engine="h5netcdf", phony_dims="access") as tree:
            content = tree.load()
    except Exception as error:
        # A damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError and others.
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 file ({type(error).__name__}: {error})",
            f"{FLOWN} of `aeromatch match`",
        ) from error
    tables = {}
    for name in (*_COLUMNS, "ground"):
        tables[name] = pd.DataFrame()
        if name in content.children:
            tables[name] = content[name].to_dataset().to_dataframe()
    missing = []
    for name, columns in _COLUMNS.items():
        missing += [f"{name}/{column}" for column in columns if column not in tables[name]]
    # The table of the ground effect may be empty.
    if len(tables["ground"]):
        missing += [f"ground/{column}" for column in _GROUND if column not in tables["ground"]]
    if missing:
        raise ParseError(
            str(path), 0, f"a file without {', '.join(missing)}", f"{FLOWN} of `aeromatch match`"
        )
    return FlightData(str(content.attrs.get("title", path.name)), **tables)


def is_clean(table: pd.DataFrame) -> pd.Series:
    """Return whether rows are of the clean aeroplane in free air."""
    # files of records without ice have no column of it
    iced = table[ICE] if ICE in table else 0.0 * table["gear"]
    return (
        is_free(table)
        & (table["delta_f"].abs() < AT_REST)
        & (table["gear"] < AT_REST)
        & (table["speedbrake"] < AT_REST)
        & (iced < AT_REST)
    )


def is_free(table: pd.DataFrame) -> pd.Series:
    """Return whether rows are out of ground effect."""
    return table["h_agl"] >= _FREE


def group_heights(table: pd.DataFrame) -> np.ndarray:
    """Return the height of each row, the mean of its group; groups are 300 m apart. [m]"""
    h = table["h"].to_numpy(float)
    if not len(h):
        return np.array([])
    # A gap in the sorted heights begins a new group.
    order = np.argsort(h, kind="stable")
    group = np.empty(len(h), int)
    group[order] = np.concatenate([[0], np.cumsum(np.diff(h[order]) > _HEIGHT_GAP)])
    return np.array([h[group == number].mean() for number in group])


def height_text(h: float) -> str:
    """Return a height to the nearest hundred of its display unit, in words."""
    return f"{number_text(float(np.round(to_printed_unit('h', h), -2)))} {printed_unit('h')}"


_LEAST = 8  # samples of a manoeuvre
# Share of the largest rms excitation of the term. A manoeuvre with less contains no information.
_EXCITED = 0.1
# The same of a derivative with a constant. A manoeuvre with less shows errors of the other terms.
_MOVED = 0.3
# Upper limit of the correlation of neighbours, which short manoeuvres estimate poorly.
_MOST_RHO = 0.95
_LEAST_SQUARE = 1e-300  # avoids a division by zero if the residual vanishes
_LEAST_SPEED = 1.0  # avoids a division by zero at rest [m/s]


def partial_residuals(db: xr.DataTree, flown: FlightData, name: str) -> pd.DataFrame:
    """Return the value of a term that each manoeuvre which excites it requires.

    Parameters
    ----------
    db : DataTree
        Database with the other terms, which are subtracted.
    flown : FlightData
        Samples of the manoeuvres.
    name : str
        The term, such as ``Cl/beta_flap``.

    Returns
    -------
    DataFrame
        A row per manoeuvre: ``record label``, ``estimate`` and ``stderr``, and the means of the
        samples weighted by the square of the excitation, the point in the table at which the
        manoeuvre counts. [SI]  It is empty if the samples lack the coefficient or a variable.

    Notes
    -----
    C is the measured coefficient, O the sum of all other terms, and x the contribution of a table
    of ones (regressors, powers, factors K).  The estimate is sum(x (C - O)) / sum(x^2) over the
    samples at 10 Hz.  Its standard error is that of the scatter about it times
    sqrt((1 + rho) / (1 - rho)) with the correlation rho of neighbours.  It does not contain errors
    of the other terms.  The rate of the angle of attack is differentiated.  The excess of the load
    factor (``dnz``) is zero.
    """
    coefficient, _, contribution = name.partition("/")
    samples, leaves = flown.samples, terms(db)
    leaf = leaves[name]
    if coefficient not in samples:
        return pd.DataFrame()
    conditions = _sample_conditions(db, samples)
    needed: set[str] = set()
    for term, other_leaf in leaves.items():
        if term.startswith(f"{coefficient}/"):
            needed |= set(_terms.list_model_variables(other_leaf))
    if needed - set(conditions):
        return pd.DataFrame()

    # x: the term with ones in its table. y = C - O.
    unit = leaf.assign(value=xr.ones_like(leaf["value"]))
    x = np.broadcast_to(_terms.evaluate_term(unit, conditions, "clamp"), len(samples))
    parts = contributions(db, coefficient, conditions, "clamp")
    other_terms = sum(value for part, value in parts.items() if part != contribution)
    y = samples[coefficient].to_numpy(float) - other_terms

    rows = []
    is_finite = np.isfinite(x) & np.isfinite(y)
    manoeuvres = samples["manoeuvre"].to_numpy()
    excitation = pd.Series(x[is_finite] ** 2).groupby(manoeuvres[is_finite]).mean()
    for manoeuvre, size in excitation.items():
        selected = is_finite & (manoeuvres == manoeuvre)
        is_excited = size > _EXCITED**2 * excitation.max()
        if selected.sum() < _LEAST or not is_excited:
            continue
        manoeuvre_row = flown.manoeuvres.loc[[manoeuvre]].iloc[0]
        rows.append(_residual_row(manoeuvre_row, samples[selected], x[selected], y[selected]))
    return pd.DataFrame(rows)


def required_slopes(
    db: xr.DataTree, flown: FlightData, coefficient: str, moved: Sequence[str]
) -> pd.DataFrame:
    """Return the derivative that each manoeuvre requires, less all other terms of a database.

    Parameters
    ----------
    db : DataTree
        Database with the other terms.
    flown : FlightData
        Samples of the manoeuvres.
    coefficient : str
        Such as ``CL``.
    moved : sequence of str
        The variable of the derivative, and variables that move together with it, such as ``qhat
        alphadothat``.

    Returns
    -------
    DataFrame
        As of `partial_residuals`, with one row per manoeuvre that moves the variable.

    Notes
    -----
    It is the slope of C - O over the variable, with the coefficient O of the database at the
    samples and all of `moved` at zero. A constant is estimated along: an error of O at trim is not
    part of the derivative. The local models divide the same lift between elevator, pitch rate and
    angle of attack in other ways, and can be compared as a whole only.
    """
    samples = flown.samples
    conditions = _sample_conditions(db, samples)
    needed: set[str] = set()
    for name, leaf in terms(db).items():
        if name.startswith(f"{coefficient}/"):
            needed |= set(_terms.list_model_variables(leaf))
    if coefficient not in samples or needed - set(conditions) or moved[0] not in conditions:
        return pd.DataFrame()
    x = conditions[moved[0]]
    # The coefficient without the terms of the moved variables: they are zero at zero.
    at_zero = {**conditions, **{name: np.zeros(len(samples)) for name in moved}}
    other_terms = sum(contributions(db, coefficient, at_zero, "clamp").values())
    y = samples[coefficient].to_numpy(float) - other_terms

    manoeuvres = samples["manoeuvre"].to_numpy()
    is_finite = np.isfinite(x) & np.isfinite(y)
    excitation = pd.Series(x[is_finite]).groupby(manoeuvres[is_finite]).std()
    rows = []
    for manoeuvre, size in excitation.items():
        selected = is_finite & (manoeuvres == manoeuvre)
        if selected.sum() < _LEAST or not size > _MOVED * excitation.max():
            continue
        row = flown.manoeuvres.loc[[manoeuvre]].iloc[0]
        # Deviations from the mean: the constant is estimated along.
        about_mean = [value[selected] - value[selected].mean() for value in (x, y)]
        rows.append(_residual_row(row, samples[selected], *about_mean))
    return pd.DataFrame(rows)


def _residual_row(
    manoeuvre: pd.Series, samples: pd.DataFrame, x: np.ndarray, y: np.ndarray
) -> dict[str, float | str]:
    """Return the estimate of one manoeuvre, and the weighted means of its samples."""
    row: dict[str, float | str] = {}
    for key in samples:
        if key not in ("manoeuvre", "time"):
            row[str(key)] = float(np.average(samples[key], weights=x**2))
    estimate, stderr = _fit_slope(x, y)
    row |= {
        "record": manoeuvre["record"],
        "label": manoeuvre["label"],
        "estimate": estimate,
        "stderr": stderr,
    }
    return row


def _sample_conditions(db: xr.DataTree, samples: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the samples as conditions of `contributions`, with the reduced rate of alpha."""
    conditions = {str(key): samples[key].to_numpy(float) for key in samples if key != "manoeuvre"}
    conditions.setdefault(ICE, np.zeros(len(samples)))
    if {"alpha", "time", "mach", "h"} <= conditions.keys():
        rate = np.zeros(len(samples))
        for indices in samples.groupby("manoeuvre", sort=False).indices.values():
            if len(indices) > 1:
                alpha, time = conditions["alpha"][indices], conditions["time"][indices]
                rate[indices] = np.gradient(alpha, time)
        # alphadothat = alpha_dot cbar / (2 V)
        speed = conditions["mach"] * atmosphere(conditions["h"]).a_sound
        chord = float(db.attrs["cbar"])
        conditions["alphadothat"] = rate * chord / (2.0 * np.maximum(speed, _LEAST_SPEED))
    return conditions | {"dnz": np.zeros(len(samples))}


def _fit_slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the least-squares factor of `x` in `y` and its standard error."""
    square = float(x @ x)
    estimate = float(x @ y) / square
    residual = y - estimate * x
    residual_square = float(residual @ residual)
    # Correlation of neighbours, which widens the standard error.
    products = residual[1:] @ residual[:-1]
    rho = float(np.clip(products / max(residual_square, _LEAST_SQUARE), 0.0, _MOST_RHO))
    scatter = residual_square / (len(x) - 1)
    return estimate, float(np.sqrt(scatter / square * (1.0 + rho) / (1.0 - rho)))
