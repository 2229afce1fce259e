"""Ground effect in closed form, as [LR743] 4.5.1 identified it, and the tables K_GE(h) of eq. (11)
made of it.

    (13)  CL(GE) = k_0 CL_0 h^s0 + k_alpha CL_alpha alpha h^salpha + k_q CL_q qhat h^sq + k_de
    CL_delta_e delta_e h^sde (14)  Cl(GE) = k h^s (CL phi)

with the coefficients out of ground effect, and h in metres.  A product k y h^s grows without bound
towards the ground, so every term has a floor: the least height that was flown, below which the
factor stays.  The heights of the report are those of its radio altimeter; here h is `h_agl`, the
height of the moment reference point.  Who has the height of the antenna counts it over, or
identifies k and s anew: (h + c)^s is no k h^s.

References
----------
.. [LR743] Report LR-743, 1993, eq. (11), (13), (14), table 2, Figs. 16 and 17.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from aerodb.update.posterior import carry_covariance
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
from flightmech.terms import PowerFactor

_ROLL = "[LR743] eq. (14)"
_LIFT = "[LR743] eq. (13)"


def in_ground_effect(free: xr.Dataset, k: float, exponent: float, floor: float) -> xr.Dataset:
    """Return what the ground adds to a term: k times the term times h^exponent, [LR743] eq. (13).

    Parameters
    ----------
    free : Dataset
        The term out of ground effect with its regressors: CL_0, CL_alpha alpha, CL_q qhat ...
    k : float
        Factor. [m to the power -exponent]
    exponent : float
        Exponent s of the height, negative for an effect that fades with height.
    floor : float
        Height below which the factor stays; the least height flown. [m]

    Returns
    -------
    Dataset
        A term with the power factor ``max(h_agl, floor)^exponent``; standard errors are those of
        `free` times abs(k).

    Raises
    ------
    SchemaError
        A term with a height or a power factor already, a number that is not finite, a floor that is
        not positive.

    Examples
    --------
    LR-743 table 2, CL_0 at 40 deg of flap, 2 m over the ground:

    >>> from flightmech.terms import evaluate, make
    >>> term = in_ground_effect(make(0.827), 0.599, -1.45, floor=2.0)
    >>> round(float(evaluate(term, {"h_agl": 2.0})), 4)
    0.1813
    """
    if not np.isfinite(k):
        raise SchemaError("ground effect", [f"k is {k!r}; give a finite number"])
    if "h_agl" in _terms.list_model_variables(free) or _terms.power_factor(free) is not None:
        raise SchemaError(
            "ground effect",
            [
                "the term depends on a height or has a power factor already; give it as it "
                "is in free air"
            ],
        )
    leaf = free.assign(value=free["value"] * k)
    if "stderr" in free:
        leaf["stderr"] = free["stderr"] * abs(k)
    leaf = carry_covariance(free, leaf, k)
    summary = f"in_ground_effect: {k:g} of the term in free air, {_LIFT}"
    history = "\n".join(text for text in (str(free.attrs.get("history", "")), summary) if text)
    leaf.attrs = {
        **free.attrs,
        "power": "h_agl",
        "exponent": float(exponent),
        "floor": float(floor),
        "history": history,
    }
    return _sound(leaf)


def bank_in_ground_effect(k: float, exponent: float, floor: float) -> xr.Dataset:
    """Return the rolling moment that turns the wings level over the ground: k h^exponent (CL phi),
    [LR743] eq. (14).

    Parameters
    ----------
    k : float
        Factor; negative where the ground raises the lower wing. [m to the power -exponent per rad]
    exponent : float
        Exponent s of the height.
    floor : float
        Height below which the factor stays. [m]

    Returns
    -------
    Dataset
        A term for ``Cl/ground`` with the regressors ``CL phi``; CL is the lift coefficient of the
        moment.

    Raises
    ------
    SchemaError
        A number that is not finite, a floor that is not positive.

    Examples
    --------
    LR-743 table 2: CL 1.2 and 5 deg of bank, 3 m over the ground:

    >>> from flightmech.terms import evaluate
    >>> term = bank_in_ground_effect(-0.078, -1.09, floor=1.7)
    >>> round(float(evaluate(term, {"CL": 1.2, "phi": np.radians(5.0), "h_agl": 3.0})), 6)
    -0.002466
    """
    return _terms.make_term(
        k, regressors=("CL", "phi"), power=PowerFactor("h_agl", exponent, floor), references=_ROLL
    )


def with_height_table(leaf: xr.Dataset, top: float, tolerance: float = 1e-3) -> xr.Dataset:
    """Return a term whose power factor is a table K1 instead: K_GE(h) of [LR743] eq. (11) from the
    formula.

    Parameters
    ----------
    leaf : Dataset
        A term with a power factor.
    top : float
        Last breakpoint, above the floor; beyond it the table holds (top)^exponent. [unit of the
        variable]
    tolerance : float
        Largest difference between breakpoints, as a share of the factor. [1]

    Returns
    -------
    Dataset
        Breakpoints from the floor to `top`, each the same multiple of the one before; ``K1`` has
        the attribute ``formula``.

    Raises
    ------
    SchemaError
        No power factor, no room for a factor over that variable, a `top` below the floor, a
        `tolerance` out of 0 ... 1.
    """
    factor = _terms.power_factor(leaf)
    if factor is None:
        raise SchemaError("height table", ["the term has no power factor"])
    problems = (
        []
        if top > factor.floor
        else [f"top is {top!r}; give more than the floor of {factor.floor:g}"]
    )
    problems += (
        []
        if 0.0 < tolerance < 1.0
        else [f"tolerance is {tolerance!r}; give a share between 0 and 1"]
    )
    if factor.variable in leaf.dims or {"K1", "K2"} <= set(leaf):
        problems.append(
            f"the term has no room for a factor over {factor.variable}; it has the tables "
            f"{' '.join(map(str, leaf.data_vars))}"
        )
    if problems:
        raise SchemaError("height table", problems)
    count = max(
        int(np.ceil(np.log(top / factor.floor) / np.log(_ratio(factor.exponent, tolerance)))), 1
    )
    points = np.geomspace(factor.floor, top, count + 1)
    points[[0, -1]] = factor.floor, top
    axis = (factor.variable, points, quantity_attributes(factor.variable))
    table = xr.DataArray(
        factor.at(points), {factor.variable: axis}, factor.variable, attrs={"formula": str(factor)}
    )
    kept = {
        key: item for key, item in leaf.attrs.items() if key not in ("power", "exponent", "floor")
    }
    tabled = leaf.assign({"K2" if "K1" in leaf else "K1": table})
    tabled.attrs = kept
    return _sound(tabled)


def _ratio(exponent: float, tolerance: float) -> float:
    """Return the ratio of neighbouring breakpoints at which a line between them leaves x^exponent
    by a share of it.
    """
    if _chord(exponent, 1e3) < tolerance:
        return 1e3
    return float(brentq(lambda ratio: _chord(exponent, ratio) - tolerance, 1.0 + 1e-6, 1e3))


def _chord(s: float, ratio: float) -> float:
    """Return the largest difference of the line from 1 to `ratio` from x^s, as a share of x^s."""
    slope = (ratio**s - 1.0) / (ratio - 1.0)
    if s in (0.0, 1.0):
        return 0.0
    x = s * (1.0 - slope) / (slope * (1.0 - s))
    return abs((1.0 + slope * (x - 1.0)) * x**-s - 1.0)


def _sound(leaf: xr.Dataset) -> xr.Dataset:
    problems = _terms.check_term(leaf)
    if problems:
        raise SchemaError("ground effect", problems)
    return leaf


def factor_table(leaf: xr.Dataset, axis: str) -> tuple[xr.Dataset, float]:
    """Return a term whose table is split into a factor K1 over one axis and a table over the
    others.

    Parameters
    ----------
    leaf : Dataset
        A term without K1; `axis` is one of the axes of its table.
    axis : str
        Axis of the factor, such as ``h_agl``. K1 is one where the table is largest.

    Returns
    -------
    leaf : Dataset
        The split term: the product closest to the table, in least squares over all nodes (first
        singular pair).
    worst : float
        Largest difference of the product from the table. [unit of the table]

    Raises
    ------
    SchemaError
        The table does not have the axis, has no other one, or has a factor K1 already.

    Notes
    -----
    The standard error of a node is that at the breakpoint where K1 is one, with `worst` added in squares.
    """
    if "K1" in leaf or axis not in leaf["value"].dims or leaf["value"].ndim < 2:
        names = " ".join(map(str, leaf["value"].dims))
        raise SchemaError(
            "factored",
            [
                f"needs a table over {axis} and another axis, without K1; this one goes over "
                f"{names or 'nothing'}"
            ],
        )
    value = leaf["value"].transpose(axis, ...)
    matrix = value.values.reshape(value.sizes[axis], -1)
    left, size, right = np.linalg.svd(matrix, full_matrices=False)
    at = int(np.argmax(np.abs(left[:, 0])))
    K1, table = left[:, 0] / left[at, 0], left[at, 0] * size[0] * right[0]
    worst = float(np.abs(np.outer(K1, table) - matrix).max())
    rest = value.isel({axis: 0}, drop=True)
    axes = {str(name): rest[name].values for name in rest.dims}
    stderr = (
        np.hypot(leaf["stderr"].transpose(axis, ...).values[at], worst)
        if "stderr" in leaf
        else None
    )
    factor = xr.DataArray(K1, {axis: (axis, value[axis].values, quantity_attributes(axis))}, axis)
    made = _terms.make_term(
        table.reshape(rest.shape),
        axes,
        _terms.list_regressors(leaf),
        K1=factor,
        stderr=stderr,
        power=_terms.power_factor(leaf),
    )
    if "source" in leaf:
        source = leaf["source"].transpose(axis, ...).isel({axis: at}, drop=True)
        made["source"] = rest.dims, source.values, dict(leaf["source"].attrs)
    summary = f"factored: K1 over {axis}, largest difference {worst:.4g}"
    history = "\n".join(text for text in (str(leaf.attrs.get("history", "")), summary) if text)
    return made.assign_attrs({**leaf.attrs, "history": history}), worst
