"""What the flights show of one term of a database: the measured coefficient less all other terms, by manoeuvre."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from flightmech import terms as _terms
from flightmech.air import atmosphere

from ...store.evaluation import contributions
from ...store.schema import terms
from .flown import Flown

_LEAST = 8  # samples of a manoeuvre
_EXCITED = 0.1  # of the largest rms excitation of the term: a manoeuvre with less shows nothing of it
_MOST_RHO = 0.95  # of the correlation of neighbours, which short manoeuvres estimate poorly


def partial_residuals(db: xr.DataTree, flown: Flown, name: str) -> pd.DataFrame:
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
        A row per manoeuvre: ``record label``, ``estimate`` and ``stderr``, and the means of the samples weighted by the square of the
        excitation: where in the table the manoeuvre counts. [SI] Empty where the samples lack the coefficient or a variable.

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
    needed = {word for one, part in terms(db).items() if one.startswith(f"{coefficient}/") for word in _terms.variables(part)}
    if needed - set(conditions):
        return pd.DataFrame()
    unit = leaf.assign(value=xr.ones_like(leaf["value"]))
    x = np.broadcast_to(_terms.evaluate(unit, conditions, "clamp"), len(samples))
    parts = contributions(db, coefficient, conditions, "clamp")
    rest = samples[coefficient].to_numpy(float) - sum(value for part, value in parts.items() if part != own)
    rows = []
    good = np.isfinite(x) & np.isfinite(rest)
    excitation = pd.Series(x[good] ** 2).groupby(samples["manoeuvre"].to_numpy()[good]).mean()
    for manoeuvre, size in excitation.items():
        on = good & (samples["manoeuvre"] == manoeuvre).to_numpy()
        if on.sum() < _LEAST or not size > _EXCITED**2 * excitation.max():
            continue
        estimate, stderr = _slope(x[on], rest[on])
        at = {key: float(np.average(samples[key][on], weights=x[on] ** 2)) for key in samples if key not in ("manoeuvre", "time")}
        about = flown.manoeuvres.loc[[manoeuvre]].iloc[0]
        rows.append({**at, "record": about["record"], "label": about["label"], "estimate": estimate, "stderr": stderr})
    return pd.DataFrame(rows)


def _conditions(db: xr.DataTree, samples: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the samples as conditions of `contributions`, with the rate of the angle of attack per cbar/2V."""
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
