"""Remarks on the structure of a selected model, and on residuals that grow with the motion."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flighttest.remarks import Remark

DAMPING = {"Cl": "phat", "Cm": "qhat", "Cn": "rhat"}
"""Reduced rate that damps the rotation of each moment."""
# ratio of the standard errors for growing and for stationary residuals from which on it is remarked
GROWTH = 1.25


def remark_structure(estimates: xr.Dataset) -> list[Remark]:
    """Return remarks on a selected model: no damping term, and estimates that depend on the choice.

    Parameters
    ----------
    estimates : Dataset (term,)
        Those of a `Fit`; the attribute ``selection`` is that of a selected model.
    """
    a = estimates.attrs
    if not a.get("selection"):
        return []
    remarks = []
    terms = [str(term) for term in estimates["term"].values]
    damping = DAMPING.get(str(a["coefficient"]), "")
    if damping and damping not in terms:
        text = (
            f"no damping: {damping} is not in the selected model of {a['coefficient']}, because "
            f"{a.get('without_damping', 'it was not chosen')}; an aeroplane in flight has it: "
            f"other terms carry its effect, do not use their estimates without it"
        )
        remarks.append(Remark("structure", text, damping))
    if "stderr_models" not in estimates:
        return remarks
    if not a.get("models_complete", 1):
        text = (
            f"the search ended after {a['models_rated']} models, further ones may be as good; give "
            f"fewer candidates"
        )
        remarks.append(Remark("structure", text, "", float(a["models_rated"]), severity="note"))
    total, spread = estimates["stderr"].values, estimates["stderr_models"].values
    for k in np.flatnonzero(2.0 * spread**2 > total**2):
        text = (
            f"{terms[k]} depends on the choice of the terms: the spread of the models is "
            f"{spread[k]:.2g} of its standard error of {total[k]:.2g}"
        )
        remarks.append(Remark("structure", text, terms[k], float(spread[k]), float(total[k])))
    return remarks


def remark_growth(estimates: xr.Dataset) -> list[Remark]:
    """Return the estimates whose standard error changes if the residual grows with the motion."""
    if "stderr_growing" not in estimates:
        return []
    remarks = []
    for term, growing, stationary in zip(
        estimates["term"].values,
        estimates["stderr_growing"].values,
        estimates["stderr_stationary"].values,
    ):
        ratio = float(growing / stationary) if stationary > 0.0 else 1.0
        if 1.0 / GROWTH <= ratio <= GROWTH:
            continue
        text = (
            f"{term}: the residual grows with the motion, its standard error is {ratio:.2g} times "
            f"that of a stationary residual ({stationary:.2g}); the larger of both is used, look "
            f"for a missing term"
        )
        limit = GROWTH if ratio > 1.0 else 1.0 / GROWTH
        remarks.append(Remark("growth", text, str(term), ratio, limit))
    return remarks


def remark_noise(estimates: xr.Dataset) -> list[Remark]:
    """Return remarks on the noise of the regressors that an estimator stored as attributes."""
    remarks = []
    for kind in ("stated noise", "nonlinear noise"):
        text = estimates.attrs.get(kind.replace(" ", "_"))
        if text:
            remarks.append(Remark(kind, str(text)))
    return remarks
