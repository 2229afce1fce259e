"""Ground effect in closed form, LR-743 section 4.5.1, and as factor tables K_GE(h) of eq. (11).

    (13)  CL(GE) = k_0 CL_0 h^s0 + k_alpha CL_alpha alpha h^salpha
                   + k_q CL_q qhat h^sq + k_de CL_delta_e delta_e h^sde
    (14)  Cl(GE) = k h^s (CL phi)

with the coefficients out of ground effect, and h in metres.  A product k y h^s has no bound towards
the ground.  Every term therefore has a floor, the least flown height, below which the factor is
constant.  The heights of the report are those of its radio altimeter.  Here h is `h_agl`, the
height of the moment reference point.  Heights of an antenna must be converted to that point, or k
and s must be identified anew: (h + c)^s is not a multiple of h^s.

References
----------
.. [LR743] Report LR-743, 1993, eq. (11), (13), (14), table 2, Figs. 16 and 17.
"""

from __future__ import annotations

import numpy as np
import scipy
import xarray as xr

from aerodb.update.posterior import carry_covariance
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
from flightmech.terms import PowerFactor

_LARGEST_RATIO = 1e3  # of neighbouring breakpoints
_ROLL = "[LR743] eq. (14)"
_LIFT = "[LR743] eq. (13)"


def in_ground_effect(free: xr.Dataset, k: float, exponent: float, floor: float) -> xr.Dataset:
    """Return the ground effect of a term, k times the term times h^exponent, LR-743 eq. (13).

    Parameters
    ----------
    free : Dataset
        The term out of ground effect with its regressors, such as CL_0 or CL_alpha alpha.
    k : float
        Factor. [m to the power -exponent]
    exponent : float
        Exponent s of the height, negative for an effect that decreases with height.
    floor : float
        Height below which the factor is constant; the least flown height. [m]

    Returns
    -------
    Dataset
        A term with the power factor ``max(h_agl, floor)^exponent``.  Its standard errors are those
        of `free` times abs(k).

    Raises
    ------
    SchemaError
        A term with a height or a power factor already, a number that is not finite, a floor that is
        not positive.

    Examples
    --------
    LR-743 table 2, CL_0 at 40 deg of flap, 2 m over the ground:

    >>> from flightmech.terms import evaluate_term, make_term
    >>> term = in_ground_effect(make_term(0.827), 0.599, -1.45, floor=2.0)
    >>> round(float(evaluate_term(term, {"h_agl": 2.0})), 4)
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
    # Standard errors and the joint covariance scale like the values.
    leaf = free.assign(value=free["value"] * k)
    if "stderr" in free:
        leaf["stderr"] = free["stderr"] * abs(k)
    leaf = carry_covariance(free, leaf, k)
    leaf.attrs = {
        **free.attrs,
        "power": "h_agl",
        "exponent": float(exponent),
        "floor": float(floor),
        "history": _extend_history(
            free, f"in_ground_effect: {k:g} of the term in free air, {_LIFT}"
        ),
    }
    return _require_valid_term(leaf)


def _extend_history(leaf: xr.Dataset, line: str) -> str:
    """Return the history of a leaf with a further line."""
    lines = [str(leaf.attrs.get("history", "")), line]
    return "\n".join(filter(None, lines))


def bank_in_ground_effect(k: float, exponent: float, floor: float) -> xr.Dataset:
    """Return the rolling moment over the ground that levels the wings, LR-743 eq. (14).

    It is k h^exponent (CL phi).

    Parameters
    ----------
    k : float
        Factor; negative if the ground raises the lower wing. [m to the power -exponent per rad]
    exponent : float
        Exponent s of the height.
    floor : float
        Height below which the factor is constant. [m]

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

    >>> from flightmech.terms import evaluate_term
    >>> term = bank_in_ground_effect(-0.078, -1.09, floor=1.7)
    >>> round(float(evaluate_term(term, {"CL": 1.2, "phi": np.radians(5.0), "h_agl": 3.0})), 6)
    -0.002466
    """
    return _terms.make_term(
        k, regressors=("CL", "phi"), power=PowerFactor("h_agl", exponent, floor), references=_ROLL
    )


def with_height_table(leaf: xr.Dataset, top: float, tolerance: float = 1e-3) -> xr.Dataset:
    """Return a term with a factor table in place of its power factor.

    It is K_GE(h) of LR-743 eq. (11), from the formula.

    Parameters
    ----------
    leaf : Dataset
        A term with a power factor.
    top : float
        Last breakpoint, above the floor; beyond it the factor is (top)^exponent. [unit of the
        variable]
    tolerance : float
        Largest difference between breakpoints, as a share of the factor. [1]

    Returns
    -------
    Dataset
        Breakpoints from the floor to `top` with a constant ratio of neighbours.  ``K1`` (``K2`` if
        the term has a K1) has the attribute ``formula``.

    Raises
    ------
    SchemaError
        No power factor, no room for a factor over that variable, a term that goes on linearly
        beyond its tables, a `top` below the floor, a `tolerance` out of 0 ... 1.
    """
    factor = _demand_power_factor(leaf, top, tolerance)
    # A power law has the same relative error in all cells of one ratio of breakpoints.
    ratio = _breakpoint_ratio(factor.exponent, tolerance)
    # Number of equal ratios between floor and top, one at least.
    count = max(int(np.ceil(np.log(top / factor.floor) / np.log(ratio))), 1)
    points = np.geomspace(factor.floor, top, count + 1)
    # The ends are exact, without the rounding of the logarithm.
    points[[0, -1]] = factor.floor, top
    axis = (factor.variable, points, quantity_attributes(factor.variable))
    table = xr.DataArray(
        factor.at(points), {factor.variable: axis}, factor.variable, attrs={"formula": str(factor)}
    )
    key = "K1"
    if "K1" in leaf:
        key = "K2"
    new = leaf.assign({key: table})
    attributes = dict(leaf.attrs)
    for name in ("power", "exponent", "floor"):
        attributes.pop(name, None)
    new.attrs = attributes
    return _require_valid_term(new)


def _demand_power_factor(leaf: xr.Dataset, top: float, tolerance: float) -> PowerFactor:
    """Return the power factor of a term that a table with these limits can replace."""
    factor = _terms.power_factor(leaf)
    if factor is None:
        raise SchemaError("height table", ["the term has no power factor"])
    problems = []
    if leaf.attrs.get("outside", "hold") != "hold":
        # a table over the height would go on along its first and last line
        problems.append(
            "the term goes on linearly beyond its tables, and the factor is constant below its "
            "floor; extend its tables and make the attribute outside 'hold'"
        )
    if not top > factor.floor:
        problems.append(f"top is {top!r}; give more than the floor of {factor.floor:g}")
    if not 0.0 < tolerance < 1.0:
        problems.append(f"tolerance is {tolerance!r}; give a share between 0 and 1")
    if factor.variable in leaf.dims or {"K1", "K2"} <= set(leaf):
        problems.append(
            f"the term has no room for a factor over {factor.variable}; it has the tables "
            f"{' '.join(map(str, leaf.data_vars))}"
        )
    if problems:
        raise SchemaError("height table", problems)
    return factor


def _breakpoint_ratio(exponent: float, tolerance: float) -> float:
    """Return the ratio of neighbouring breakpoints with a given relative error between them."""
    if _chord_error(exponent, _LARGEST_RATIO) < tolerance:
        return _LARGEST_RATIO

    def excess(ratio: float) -> float:
        return _chord_error(exponent, ratio) - tolerance

    return float(scipy.optimize.brentq(excess, 1.0 + 1e-6, _LARGEST_RATIO))


def _chord_error(s: float, ratio: float) -> float:
    """Return the largest relative error of the chord of x^s from 1 to `ratio`."""
    slope = (ratio**s - 1.0) / (ratio - 1.0)
    if s in (0.0, 1.0):
        return 0.0
    # The relative error is largest where its derivative vanishes.
    x = s * (1.0 - slope) / (slope * (1.0 - s))
    return abs((1.0 + slope * (x - 1.0)) * x**-s - 1.0)


def _require_valid_term(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf; raise `SchemaError` if it is faulty."""
    problems = _terms.check_term(leaf)
    if problems:
        raise SchemaError("ground effect", problems)
    return leaf


def factor_table(leaf: xr.Dataset, axis: str) -> tuple[xr.Dataset, float]:
    """Return a term whose table is split into a factor K1 over one axis and a table.

    The new table goes over the other axes.

    Parameters
    ----------
    leaf : Dataset
        A term without K1; `axis` is one of the axes of its table.
    axis : str
        Axis of the factor, such as ``h_agl``.  K1 is one where the table is largest.

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
        The table does not have the axis, has no other axis, or has a factor K1 already.

    Notes
    -----
    The standard error of a node is that at the breakpoint where K1 is one, with `worst` added in
    quadrature.
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
    # Rows along the axis of the factor, columns over all other nodes.
    matrix = value.values.reshape(value.sizes[axis], -1)
    columns, size, rows = np.linalg.svd(matrix, full_matrices=False)
    # First singular pair, scaled to K1 = 1 where the factor is largest.
    largest = int(np.argmax(np.abs(columns[:, 0])))
    K1, table = columns[:, 0] / columns[largest, 0], columns[largest, 0] * size[0] * rows[0]
    worst = float(np.abs(np.outer(K1, table) - matrix).max())
    other_axes = value.isel({axis: 0}, drop=True)
    stderr = None
    if "stderr" in leaf:
        stderr = np.hypot(leaf["stderr"].transpose(axis, ...).values[largest], worst)
    factor = xr.DataArray(K1, {axis: (axis, value[axis].values, quantity_attributes(axis))}, axis)
    new = _terms.make_term(
        table.reshape(other_axes.shape),
        {str(name): other_axes[name].values for name in other_axes.dims},
        _terms.list_regressors(leaf),
        K1=factor,
        stderr=stderr,
        power=_terms.power_factor(leaf),
    )
    if "source" in leaf:
        source = leaf["source"].transpose(axis, ...).isel({axis: largest}, drop=True)
        new["source"] = other_axes.dims, source.values, dict(leaf["source"].attrs)
    history = _extend_history(leaf, f"factored: K1 over {axis}, largest difference {worst:.4g}")
    return new.assign_attrs({**leaf.attrs, "history": history}), worst
