"""One physical effect on all six coefficients at once, and what changes of reference do to it.

An effect is what one state, control or configuration does to the aeroplane: the tables of CL, CD,
CY, Cl, Cm, Cn that share a contribution name and a regressor.  Changes of reference quantities, of
axes and of the moment reference point act on forces and moments together, so they act on effects
and not on single terms.

Axes, as found on listings (see docs/explanation/database/aero-model.md): DATCOM's lift and drag, and its lateral moments
and rates, belong to stability axes, body axes turned by alpha about y.  ``d`` is the vector from
the new moment reference point to the old one, in body axes; it lies in the plane of symmetry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from aerodb.store.templates import HINGE

_LENGTH = {"Cl": "b", "Cm": "cbar", "Cn": "b"}
_RATE_LENGTH = {"phat": "b", "rhat": "b", "betadothat": "b", "qhat": "cbar", "alphadothat": "cbar"}


@dataclass(frozen=True)
class Effect:
    """What one cause does to the coefficients.

    Attributes
    ----------
    name : str
        Contribution: ``basic``, ``qhat``, ``elevator`` ...
    tables : mapping of str to DataArray
        Coefficient to table; a coefficient that is missing is zero.
    regressor : str
        Variable that multiplies every table; empty for none.
    zeros : mapping of str to sequence of float
        Axis to the breakpoints where the effect is zero by definition.
    judged : mapping of str to DataArray
        Coefficient to a mask of the cells that are not the program's own numbers.
    references, comment : str
        Where it comes from, what to know about it.

    Cells the listing does not print are NaN here; `aerodb.prior.effect_to_terms` fills or cuts
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
    return "; ".join(s for s in sentences if s)


def change_reference_quantities(
    effect: Effect, old: Mapping[str, float], new: Mapping[str, float]
) -> Effect:
    """Return an effect made dimensionless with other reference quantities.

    Parameters
    ----------
    old, new : mapping
        ``S`` [m2], ``cbar`` and ``b`` [m].

    Notes
    -----
    Forces scale with S, moments with S times their length; a derivative with respect to a reduced rate x l / 2V divides by l, one
    with respect to the thrust coefficient T / (qbar S) multiplies by S.  Hinge moments have the reference of their control.
    """
    rate = _RATE_LENGTH.get(effect.regressor)
    scaled = {}
    for coefficient, table in effect.tables.items():
        if coefficient in HINGE:
            scaled[coefficient] = table
            continue
        factor = 1.0 if effect.regressor == "CT" else old["S"] / new["S"]
        if coefficient in _LENGTH:
            factor *= old[_LENGTH[coefficient]] / new[_LENGTH[coefficient]]
        if rate:
            factor *= old[rate] / new[rate]
        scaled[coefficient] = table * factor
    return effect.with_tables(scaled)


def rotate_rolling_to_body(effect: Effect, alpha: xr.DataArray) -> Effect:
    """Return an effect of sideslip or of a roll control with its moments turned from stability to
    body axes.

    Parameters
    ----------
    alpha : DataArray (alpha,)
        Breakpoints for moments that do not depend on alpha themselves. [rad]

    Notes
    -----
    Cl_b = Cl_s cos(alpha) - Cn_s sin(alpha),  Cn_b = Cl_s sin(alpha) + Cn_s cos(alpha).  A moment without a method, altogether or
    at a Mach number, counts as zero in the other and stays absent.
    """
    Cl, Cn = (effect.tables.get(c, xr.DataArray(0.0)) for c in ("Cl", "Cn"))
    sin, cos = _sin_cos(_own_alpha(effect, alpha))
    turned = {"Cl": Cl * cos - _known(Cn) * sin, "Cn": _known(Cl) * sin + Cn * cos}
    return effect.with_tables({c: turned.get(c, table) for c, table in effect.tables.items()})


def _known(table: xr.DataArray) -> xr.DataArray:
    """Return a table with zeros at the Mach numbers where it holds no number at all."""
    if "mach" not in table.dims:
        return table
    return table.where(table.notnull().any([d for d in table.dims if d != "mach"]), 0.0)


def rates_to_body(roll: Effect, yaw: Effect) -> tuple[Effect, Effect]:
    """Return the effects of phat and rhat with moments *and* rates turned from stability to body
    axes.

    Notes
    -----
    With T = [[cos, -sin], [sin, cos]] of alpha, (Cl, Cn)_b = T (Cl, Cn)_s and (p, r)_s = T' (p, r)_b, so the matrix of
    derivatives turns as a tensor, T D T'.  The side force only sees the rates turn: CY_p of body axes is CY_p cos(alpha)
    - CY_r sin(alpha).  A derivative without a method counts as zero in the others [LR743] 3.1 and stays absent; CY_r has none.
    """
    lp, np_ = (roll.tables.get(c, xr.DataArray(0.0)) for c in ("Cl", "Cn"))
    lr, nr = (yaw.tables.get(c, xr.DataArray(0.0)) for c in ("Cl", "Cn"))
    sin, cos = _sin_cos(lp + np_ + lr + nr)
    rolling = {
        "CY": roll.tables.get("CY", 0.0) * cos,
        "Cl": lp * cos**2 - (lr + np_) * sin * cos + nr * sin**2,
        "Cn": np_ * cos**2 + (lp - nr) * sin * cos - lr * sin**2,
    }
    yawing = {
        "Cl": lr * cos**2 + (lp - nr) * sin * cos - np_ * sin**2,
        "Cn": nr * cos**2 + (lr + np_) * sin * cos + lp * sin**2,
    }
    return roll.with_tables({c: rolling[c] for c in roll.tables}), yaw.with_tables(
        {c: yawing[c] for c in yaw.tables}
    )


def transfer_moments(
    effect: Effect, d: Sequence[float], cbar: float, b: float, alpha: xr.DataArray
) -> Effect:
    """Return an effect with its moments about another point, M_new = M_old + d x F.

    Parameters
    ----------
    d : (3,)
        From the new point to the old one, body axes, y zero. [m]
    cbar, b : float
        Reference lengths. [m]
    alpha : DataArray (alpha,)
        Breakpoints for forces that do not depend on alpha themselves. [rad]
    """
    dx, _, dz = d
    tables = dict(effect.tables)
    if "CL" in tables or "CD" in tables:
        CL, CD = tables.get("CL", 0.0), tables.get("CD", 0.0)
        sin, cos = _sin_cos(_own_alpha(effect, alpha))
        CX, CZ = CL * sin - CD * cos, -CL * cos - CD * sin
        tables["Cm"] = tables.get("Cm", 0.0) + (dz * CX - dx * CZ) / cbar
    if "CY" in tables:
        tables["Cl"] = tables.get("Cl", 0.0) - dz * tables["CY"] / b
        tables["Cn"] = tables.get("Cn", 0.0) + dx * tables["CY"] / b
    return effect.with_tables(tables, f"moments moved by {-dx:.4f} m forward and {-dz:.4f} m down")


def rate_shift(
    basic: Effect, beta: Effect, d: Sequence[float], cbar: float, b: float
) -> dict[str, dict[str, xr.DataArray]]:
    """Return what the flow angles at the new point add to the rate derivatives, by effect name and
    coefficient.

    Notes
    -----
    Rotating about the new point, the old one sees other flow angles and another airspeed,

        alpha_old - alpha = -q (dx cos(alpha) + dz sin(alpha)) / V,    beta_old - beta = (r dx - p dz) / V,
        V_old / V - 1 = q (dz cos(alpha) - dx sin(alpha)) / V,

    and stability axes that are turned by the difference of alpha.  Exact to first order in the
    rates.  `basic` and `beta` are those about the new point.
    """
    dx, _, dz = d
    sin, cos = _sin_cos(next(iter(basic.tables.values())))
    turned = 2.0 / cbar * -(dx * cos + dz * sin)  # alpha_old - alpha, and V_old / V - 1, per qhat
    faster = 2.0 / cbar * (dz * cos - dx * sin)
    zero = xr.DataArray(0.0)
    tilt = {"CL": basic.tables.get("CD", zero), "CD": -basic.tables.get("CL", zero)}
    qhat = {
        c: (table.differentiate("alpha") + tilt.get(c, zero)) * turned + 2.0 * table * faster
        for c, table in basic.tables.items()
    }
    return {
        "qhat": qhat,
        "phat": {c: table * (-2.0 * dz / b) for c, table in beta.tables.items()},
        "rhat": {c: table * (2.0 * dx / b) for c, table in beta.tables.items()},
    }


def with_added(effect: Effect, more: Mapping[str, xr.DataArray]) -> Effect:
    """Return an effect with tables added to its own; a coefficient it lacks starts from zero."""
    tables = dict(effect.tables)
    for coefficient, table in more.items():
        tables[coefficient] = tables[coefficient] + table if coefficient in tables else table
    return effect.with_tables(tables)


def _own_alpha(effect: Effect, alpha: xr.DataArray) -> xr.DataArray:
    """Return the alpha axis of an effect's tables, or another one for tables without."""
    return next(
        (table["alpha"] for table in effect.tables.values() if "alpha" in table.dims), alpha
    )


def _sin_cos(table: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Return sine and cosine of the alpha axis of a table."""
    alpha = table["alpha"].values
    return xr.DataArray(np.sin(alpha), {"alpha": alpha}, "alpha"), xr.DataArray(
        np.cos(alpha), {"alpha": alpha}, "alpha"
    )
