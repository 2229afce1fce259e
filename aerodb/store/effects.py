"""Effects on all six coefficients at once, and their changes of reference.

An effect is the action of one state, control or configuration on the aeroplane.  It consists of the
tables of CL, CD, CY, Cl, Cm, Cn that share a contribution name and a regressor.  Changes of
reference quantities, of axes and of the moment reference point involve forces and moments together.
They therefore apply to effects and not to single terms.

Axes of the listings (docs/explanation/database/from-datcom.md): DATCOM's lift and drag, and its
lateral moments and rates, refer to stability axes, which are body axes turned by alpha about y.
``d`` is the vector from the new moment reference point to the old one, in body axes.  It lies in
the plane of symmetry.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from aerodb.store.templates import HINGE
from flightmech.errors import AeromatchWarning
from flightmech.names import REDUCED_RATES
from flightmech.support.array_files.labelled_arrays import make_variable

_ZERO = xr.DataArray(make_variable((), np.array(0.0)))
# Reference length of each moment, and of each reduced rate x l / 2V.
_LENGTH = {"Cl": "b", "Cm": "cbar", "Cn": "b"}
# Forces that programs seldom compute and that are small but for the move of the reference point.
_OF_THE_MOVE_ALONE = {"qhat": ("CD",), "rhat": ("CY",)}
_RATE_LENGTH = {name: length for name, (_, length) in REDUCED_RATES.items()}


@dataclass(frozen=True)
class Effect:
    """Effect of one cause on the coefficients.

    Attributes
    ----------
    name : str
        Contribution: ``basic``, ``qhat``, ``elevator`` ...
    tables : mapping of str to DataArray
        Table by coefficient; a coefficient without a table is zero.
    regressor : str
        Variable that multiplies every table; empty for none.
    zeros : mapping of str to sequence of float
        Breakpoints where the effect is zero by definition, by axis.
    judged : mapping of str to DataArray
        Mask of the cells whose numbers do not come from the program, by coefficient.
    references, comment : str
        Origin of the effect, and a remark on it.

    Notes
    -----
    Cells that the listing does not print are NaN; `aerodb.prior.effect_to_terms` fills or removes
    them.
    """

    name: str
    tables: Mapping[str, xr.DataArray]
    regressor: str = ""
    zeros: Mapping[str, Sequence[float]] = field(default_factory=dict)
    judged: Mapping[str, xr.DataArray] = field(default_factory=dict)
    references: str = ""
    comment: str = ""

    def with_tables(self, tables: Mapping[str, xr.DataArray], comment: str = "") -> Effect:
        """Return the effect with other tables, and a further sentence in its comment."""
        return replace(self, tables=dict(tables), comment=join_sentences(self.comment, comment))


def join_sentences(*sentences: str) -> str:
    """Return sentences as one text, empty ones left out."""
    return "; ".join(filter(None, sentences))


def change_reference_quantities(
    effect: Effect, old: Mapping[str, float], new: Mapping[str, float]
) -> Effect:
    """Return an effect for other reference quantities.

    Parameters
    ----------
    effect : Effect
    old, new : mapping
        ``S`` [m2], ``cbar`` and ``b`` [m].

    Notes
    -----
    Coefficients of forces are divided by S, those of moments by S times their length.  A derivative
    with respect to a reduced rate x l / 2V is divided by l.  One with respect to the thrust
    coefficient T / (qbar S) is multiplied by S.  Hinge moments have the reference of their control.
    """
    rate = _RATE_LENGTH.get(effect.regressor)
    scaled = {}
    for coefficient, table in effect.tables.items():
        if coefficient in HINGE:
            scaled[coefficient] = table
            continue
        # C_new = C_old (S l)_old / (S l)_new; the thrust coefficient contains S as well.
        factor = old["S"] / new["S"]
        if effect.regressor == "CT":
            factor = 1.0
        if coefficient in _LENGTH:
            factor *= old[_LENGTH[coefficient]] / new[_LENGTH[coefficient]]
        if rate:
            factor *= old[rate] / new[rate]
        scaled[coefficient] = table * factor
    return effect.with_tables(scaled)


def rotate_rolling_to_body(effect: Effect, alpha: xr.DataArray) -> Effect:
    """Return an effect of sideslip or of a roll control with its moments in body axes.

    Parameters
    ----------
    effect : Effect
        With moments in stability axes.
    alpha : DataArray (alpha,)
        Breakpoints for moments that do not depend on alpha. [rad]

    Notes
    -----
    Cl_b = Cl_s cos(alpha) - Cn_s sin(alpha),  Cn_b = Cl_s sin(alpha) + Cn_s cos(alpha).  A moment
    without a method, at all or at a Mach number, counts as zero in the other moment and stays
    absent.
    """
    Cl, Cn = effect.tables.get("Cl", _ZERO), effect.tables.get("Cn", _ZERO)
    sin, cos = _sin_cos(_alpha_of_effect(effect, alpha))
    tables = dict(effect.tables)
    if "Cl" in tables:
        tables["Cl"] = Cl * cos - _fill_missing_mach(Cn) * sin
    if "Cn" in tables:
        tables["Cn"] = _fill_missing_mach(Cl) * sin + Cn * cos
    return effect.with_tables(tables)


def _fill_missing_mach(table: xr.DataArray) -> xr.DataArray:
    """Return a table with zeros at the Mach numbers where it has no number at all."""
    if "mach" not in table.dims:
        return table
    other_axes = [axis for axis in table.dims if axis != "mach"]
    return table.where(table.notnull().any(other_axes), 0.0)


def rates_to_body(roll: Effect, yaw: Effect) -> tuple[Effect, Effect]:
    """Return the effects of phat and rhat with moments and rates in body axes.

    Parameters
    ----------
    roll, yaw : Effect
        Effects of phat and rhat in stability axes.

    Notes
    -----
    With T = [[cos, -sin], [sin, cos]] of alpha, (Cl, Cn)_b = T (Cl, Cn)_s and
    (p, r)_s = T' (p, r)_b.  The matrix D of derivatives therefore transforms as a tensor, T D T'.
    Only the rates of the side force turn: CY_p of body axes is CY_p cos(alpha) - CY_r
    sin(alpha), and CY_r is CY_p sin(alpha) + CY_r cos(alpha).  A derivative without a method counts
    as zero in the others (LR-743, section 3.1) and stays absent.
    """
    lp, np_ = roll.tables.get("Cl", _ZERO), roll.tables.get("Cn", _ZERO)
    lr, nr = yaw.tables.get("Cl", _ZERO), yaw.tables.get("Cn", _ZERO)
    printed = lp + np_ + lr + nr
    # Supersonic pages print neither rolling nor yawing moments, at most a side force.
    if "alpha" not in printed.dims:
        printed = roll.tables.get("CY", printed)
    if "alpha" not in printed.dims:
        return roll, yaw
    sin, cos = _sin_cos(printed)
    # T D T' with D = [[lp, lr], [np, nr]].
    rolling = {
        "CY": roll.tables.get("CY", 0.0) * cos,
        "Cl": lp * cos**2 - (lr + np_) * sin * cos + nr * sin**2,
        "Cn": np_ * cos**2 + (lp - nr) * sin * cos - lr * sin**2,
    }
    yawing = {
        "Cl": lr * cos**2 + (lp - nr) * sin * cos - np_ * sin**2,
        "Cn": nr * cos**2 + (lr + np_) * sin * cos + lp * sin**2,
    }
    # DATCOM has no method for CY_r, other programs compute it.
    if "CY" in yaw.tables:
        side_p, side_r = roll.tables.get("CY", _ZERO), yaw.tables["CY"]
        rolling["CY"] = side_p * cos - side_r * sin
        yawing["CY"] = side_p * sin + side_r * cos
    body_roll = roll.with_tables({name: rolling[name] for name in roll.tables})
    return body_roll, yaw.with_tables({name: yawing[name] for name in yaw.tables})


def transfer_moments(
    effect: Effect, d: Sequence[float], cbar: float, b: float, alpha: xr.DataArray
) -> Effect:
    """Return an effect with its moments about another point, M_new = M_old + d x F.

    Parameters
    ----------
    effect : Effect
    d : (3,)
        Vector from the new point to the old one, body axes, y zero. [m]
    cbar, b : float
        Reference lengths. [m]
    alpha : DataArray (alpha,)
        Breakpoints for forces that do not depend on alpha. [rad]
    """
    dx, _, dz = d
    tables = dict(effect.tables)
    if "CL" in tables or "CD" in tables:
        CL, CD = tables.get("CL", 0.0), tables.get("CD", 0.0)
        sin, cos = _sin_cos(_alpha_of_effect(effect, alpha))
        # Stability to body axes: x forward, z down.
        CX, CZ = CL * sin - CD * cos, -CL * cos - CD * sin
        tables["Cm"] = tables.get("Cm", 0.0) + (dz * CX - dx * CZ) / cbar
    if "CY" in tables:
        tables["Cl"] = tables.get("Cl", 0.0) - dz * tables["CY"] / b
        tables["Cn"] = tables.get("Cn", 0.0) + dx * tables["CY"] / b
    return effect.with_tables(tables, f"moments moved by {-dx:.4f} m forward and {-dz:.4f} m down")


def rate_shift(
    basic: Effect, beta: Effect, d: Sequence[float], cbar: float, b: float
) -> dict[str, dict[str, xr.DataArray]]:
    """Return the change of the rate derivatives by a move of the reference point.

    Parameters
    ----------
    basic, beta : Effect
        Effects of incidence and of sideslip about the new point.
    d : (3,)
        Vector from the new point to the old one, body axes, y zero. [m]
    cbar, b : float
        Reference lengths. [m]

    Returns
    -------
    dict of str to dict of str to DataArray
        Added tables by effect name and coefficient.

    Warns
    -----
    AeromatchWarning
        With one angle of attack the slope over alpha is unknown, and its share is left out.

    Notes
    -----
    In a rotation about the new point, the flow angles and the airspeed at the old point differ,

        alpha_old - alpha = -q (dx cos(alpha) + dz sin(alpha)) / V,
        beta_old - beta = (r dx - p dz) / V,
        V_old / V - 1 = q (dz cos(alpha) - dx sin(alpha)) / V,

    and the stability axes turn by the difference of alpha.  The change is exact to first order in
    the rates.
    """
    dx, _, dz = d
    sin, cos = _sin_cos(next(iter(basic.tables.values())))
    # alpha_old - alpha and V_old / V - 1 per unit of qhat = q cbar / 2V.
    alpha_change = 2.0 / cbar * -(dx * cos + dz * sin)
    speed_change = 2.0 / cbar * (dz * cos - dx * sin)
    # Stability axes turn with alpha: lift gains the drag, drag loses the lift.
    tilt = {"CL": basic.tables.get("CD", _ZERO), "CD": -basic.tables.get("CL", _ZERO)}
    if sin.size == 1:
        warnings.warn(
            "one angle of attack: the terms over qhat are moved to the reference point without "
            "the slopes of CL, CD and Cm over alpha; give several angles",
            AeromatchWarning,
            stacklevel=3,
        )
    qhat = {}
    for name, table in basic.tables.items():
        slope = _slope_over_alpha(table) + tilt.get(name, _ZERO)
        qhat[name] = slope * alpha_change + 2.0 * table * speed_change
    phat, rhat = {}, {}
    for name, table in beta.tables.items():
        phat[name] = table * (-2.0 * dz / b)
        rhat[name] = table * (2.0 * dx / b)
    return {"qhat": qhat, "phat": phat, "rhat": rhat}


def with_added(effect: Effect, more: Mapping[str, xr.DataArray]) -> Effect:
    """Return an effect with added tables; a coefficient without a table starts from zero."""
    tables = dict(effect.tables)
    for coefficient, table in more.items():
        if coefficient in tables:
            table = tables[coefficient] + table
        tables[coefficient] = table
    return effect.with_tables(tables)


def without_partial_sums(effect: Effect, given: Collection[str]) -> Effect:
    """Return an effect without the coefficients that a move of the reference point added.

    A derivative that was not known about the old point is not known about the new one: the part
    that the move adds is not all of it.

    Parameters
    ----------
    effect : Effect
        About the new point.
    given : collection of str
        Coefficients that it had about the old point.
    """
    allowed = {*given, *_OF_THE_MOVE_ALONE.get(effect.name, ())}
    tables = {name: table for name, table in effect.tables.items() if name in allowed}
    return effect.with_tables(tables)


def _alpha_of_effect(effect: Effect, default: xr.DataArray) -> xr.DataArray:
    """Return the alpha axis of the tables of an effect, or the default if they have none."""
    for table in effect.tables.values():
        if "alpha" in table.dims:
            return table["alpha"]
    return default


def _slope_over_alpha(table: xr.DataArray) -> xr.DataArray:
    """Return the derivative of a table with respect to alpha, zero with one angle."""
    if table.sizes["alpha"] == 1:
        return xr.zeros_like(table)
    return table.differentiate("alpha")


def _sin_cos(table: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Return sine and cosine of the alpha axis of a table."""
    alpha = table["alpha"].values
    sin = xr.DataArray(np.sin(alpha), {"alpha": alpha}, "alpha")
    return sin, xr.DataArray(np.cos(alpha), {"alpha": alpha}, "alpha")
