"""What was flown, as ``aeromatch match`` writes it next to its databases: samples, manoeuvres,
local estimates, submodels.
"""

from __future__ import annotations

import os
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
from flightmech.errors import ParseError

FLOWN = "flown.nc"
"""Name of the file in the folder that ``aeromatch match`` writes."""

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
_AT_REST = 0.01  # of an extension or a flap angle [1, rad]
# height above the ground from which there is no ground effect, more than one span of any aeroplane
# [m]
_FREE = 100.0
_APART = 300.0  # between two heights that were flown [m]


@dataclass(frozen=True)
class FlightData:
    """What was flown.

    Attributes
    ----------
    source : str
        What the data come from, in words.
    samples : DataFrame
        ``manoeuvre`` (row of `manoeuvres`) and variables and coefficients along it. [SI]
    manoeuvres : DataFrame
        ``record label start end`` and the means over the first half second: the steady condition
        from which it begins. [SI]
    estimates : DataFrame
        One row per local estimate: ``fit coefficient term estimate stderr`` and the means of its
        samples. [SI]
    submodels : DataFrame
        [LR743] table 1: ``submodel part technique residual``.
    ground : DataFrame
        [LR743] table 2; empty where no ground effect was identified.
    """

    source: str
    samples: pd.DataFrame
    manoeuvres: pd.DataFrame
    estimates: pd.DataFrame
    submodels: pd.DataFrame
    ground: pd.DataFrame


def read_flown(path: str | os.PathLike) -> FlightData:
    """Return what was flown from a file that ``aeromatch match`` wrote.

    Raises
    ------
    ParseError
        Not such a file.
    FileNotFoundError
        It is not there.
    """
    if not Path(path).exists():
        raise FileNotFoundError(
            f"{path}: no such file; `aeromatch match` writes {FLOWN} next to its databases"
        )
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            held = tree.load()
    except (
        Exception
    ) as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 file ({type(error).__name__}: {error})",
            f"{FLOWN} of `aeromatch match`",
        ) from error
    tables = {
        name: held[name].to_dataset().to_dataframe() if name in held.children else pd.DataFrame()
        for name in (*_COLUMNS, "ground")
    }
    lacking = [
        f"{name}/{column}"
        for name, columns in _COLUMNS.items()
        for column in columns
        if column not in tables[name]
    ]
    if len(tables["ground"]):
        lacking += [f"ground/{column}" for column in _GROUND if column not in tables["ground"]]
    if lacking:
        raise ParseError(
            str(path), 0, f"a file without {', '.join(lacking)}", f"{FLOWN} of `aeromatch match`"
        )
    return FlightData(str(held.attrs.get("title", Path(path).name)), **tables)


def is_clean(table: pd.DataFrame) -> pd.Series:
    """Whether rows are of the clean aeroplane in free air."""
    return (
        is_free(table)
        & (table["delta_f"].abs() < _AT_REST)
        & (table["gear"] < _AT_REST)
        & (table["speedbrake"] < _AT_REST)
    )


def is_free(table: pd.DataFrame) -> pd.Series:
    """Whether rows are out of ground effect."""
    return table["h_agl"] >= _FREE


def configuration_text(row: pd.Series) -> str:
    """Return the configuration in words: ``clean``, ``flaps 40 deg, gear``."""
    words = (
        [f"flaps {number_text(float(np.round(to_printed_unit('delta_f', row['delta_f']))))} deg"]
        if abs(row["delta_f"]) >= _AT_REST
        else []
    )
    words += [
        word for word, name in (("gear", "gear"), ("speed brake", "speedbrake")) if row[name] >= 0.5
    ]
    return ", ".join(words) or "clean"


def group_heights(table: pd.DataFrame) -> np.ndarray:
    """Return the height at which each row was flown, those within 300 m of each other as their
    mean. [m]
    """
    h = table["h"].to_numpy(float)
    order = np.argsort(h, kind="stable")
    group = np.empty(len(h), int)
    group[order] = np.concatenate([[0], np.cumsum(np.diff(h[order]) > _APART)]) if len(h) else []
    return np.array([h[group == one].mean() for one in group])


def height_text(h: float) -> str:
    """Return a height as it is named: to the nearest hundred of its display unit."""
    return f"{number_text(float(np.round(to_printed_unit('h', h), -2)))} {printed_unit('h')}"


_LEAST = 8  # samples of a manoeuvre
_EXCITED = (
    0.1  # of the largest rms excitation of the term: a manoeuvre with less shows nothing of it
)
_MOST_RHO = 0.95  # of the correlation of neighbours, which short manoeuvres estimate poorly


def partial_residuals(db: xr.DataTree, flown: FlightData, name: str) -> pd.DataFrame:
    """Return for each manoeuvre that excites a term what its value would have to be there.

    Parameters
    ----------
    db : DataTree
        Its other terms are taken off.
    flown : Flown
        Samples of the manoeuvres.
    name : str
        The term, such as ``Cl/beta_flap``.

    Returns
    -------
    DataFrame
        A row per manoeuvre: ``record label``, ``estimate`` and ``stderr``, and the means of the
        samples weighted by the square of the excitation: where in the table the manoeuvre counts.
        [SI] Empty where the samples lack the coefficient or a variable.

    Notes
    -----
    With the measured coefficient C, all other terms O and what one unit of the table makes x (regressors, powers, factors K): the
    estimate is sum(x (C - O)) / sum(x^2) over the samples at 10 Hz.  Its standard error is that of the scatter about it, widened by
    sqrt((1 + rho) / (1 - rho)) with the correlation rho of neighbours; errors of the other terms are not in it.  The rate of the angle of
    attack is differentiated; the excess of the load factor (``dnz``) counts as zero.
    """
    coefficient, _, own = name.partition("/")
    samples = flown.samples
    leaf = terms(db)[name]
    if coefficient not in samples:
        return pd.DataFrame()
    conditions = _conditions(db, samples)
    needed = {
        word
        for one, part in terms(db).items()
        if one.startswith(f"{coefficient}/")
        for word in _terms.list_model_variables(part)
    }
    if needed - set(conditions):
        return pd.DataFrame()
    unit = leaf.assign(value=xr.ones_like(leaf["value"]))
    x = np.broadcast_to(_terms.evaluate_term(unit, conditions, "clamp"), len(samples))
    parts = contributions(db, coefficient, conditions, "clamp")
    rest = samples[coefficient].to_numpy(float) - sum(
        value for part, value in parts.items() if part != own
    )
    rows = []
    good = np.isfinite(x) & np.isfinite(rest)
    excitation = pd.Series(x[good] ** 2).groupby(samples["manoeuvre"].to_numpy()[good]).mean()
    for manoeuvre, size in excitation.items():
        on = good & (samples["manoeuvre"] == manoeuvre).to_numpy()
        if on.sum() < _LEAST or not size > _EXCITED**2 * excitation.max():
            continue
        estimate, stderr = _slope(x[on], rest[on])
        at = {
            key: float(np.average(samples[key][on], weights=x[on] ** 2))
            for key in samples
            if key not in ("manoeuvre", "time")
        }
        about = flown.manoeuvres.loc[[manoeuvre]].iloc[0]
        rows.append(
            {
                **at,
                "record": about["record"],
                "label": about["label"],
                "estimate": estimate,
                "stderr": stderr,
            }
        )
    return pd.DataFrame(rows)


def _conditions(db: xr.DataTree, samples: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the samples as conditions of `contributions`, with the rate of the angle of attack per
    cbar/2V.
    """
    found = {str(key): samples[key].to_numpy(float) for key in samples if key != "manoeuvre"}
    if {"alpha", "time", "mach", "h"} <= found.keys():
        rate = np.zeros(len(samples))
        for places in samples.groupby("manoeuvre", sort=False).indices.values():
            if len(places) > 1:
                rate[places] = np.gradient(found["alpha"][places], found["time"][places])
        speed = found["mach"] * atmosphere(found["h"]).a_sound
        found["alphadothat"] = rate * float(db.attrs["cbar"]) / (2.0 * np.maximum(speed, 1.0))
    return found | {"dnz": np.zeros(len(samples))}


def _slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the least-squares factor of `x` in `y` and its standard error, neighbours correlated."""
    square = float(x @ x)
    estimate = float(x @ y) / square
    left = y - estimate * x
    rho = float(np.clip(left[1:] @ left[:-1] / max(float(left @ left), 1e-300), 0.0, _MOST_RHO))
    scatter = float(left @ left) / (len(x) - 1)
    return estimate, float(np.sqrt(scatter / square * (1.0 + rho) / (1.0 - rho)))
