"""Scheme of a database: the build-up of LR-743 eq. (1) to (11) for all six coefficients.

Every entry is a product *K1 x table(axes) x regressors*, and a coefficient is the sum of its
entries.  LR-743 prints the equations of the lift coefficient; those of the other coefficients have
the same form.  The scheme does not contain numbers.  A term without a source is absent and counts
as zero (LR-743, section 3.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_NO_METHOD = "no method"

# Contribution, coefficients (empty for all of the group), axes, regressors, axis of K1, equation of
# LR-743, meaning, source in DATCOM, result in flight (LR-743, section 4.5).
Row = tuple[str, str, str, str, str, str, str, str, str]

# fmt: off
LONGITUDINAL: tuple[Row, ...] = (
    ("basic", "", "mach alpha", "", "", "(3)", "clean aeroplane in steady flight",
     "static page of the whole aeroplane, at one altitude", "(3) becomes a table over alpha and "
         "Mach number (Fig. 12)"),
    ("altitude", "", "h mach", "alpha", "", "(2)", "slope increment with altitude and Mach number",
     "static pages at the other altitudes less basic (Reynolds number only, no elasticity)",
     "not mentioned in 4.5"),
    ("flap", "", "delta_f mach alpha", "", "", "(2)", "increment of the flaps",
     "CL Cm: SYMFLP on the wing, D(CL), D(CM), wing-body | CD: SYMFLP on the wing, D(CD MIN) "
         "+ D(CDI)", "replaced (Fig. 13)"),
    ("flap_slope", "", "delta_f mach", "alpha", "", "(2)", "change of slope with the flaps",
     "CL: SYMFLP on the wing, (CLA)D less its value without deflection", "part of the table that "
         "is replaced"),
    ("elevator", "", "mach alpha", "delta_e", "", "(4)", "elevator effectiveness",
     "CL Cm: SYMFLP on the tail, D(CL), D(CM) over delta_e, or an all-movable stabilizer | "
         "CD: SYMFLP on the tail, D(CD MIN) + D(CDI)",
     "kept"),
    ("elevator_flap", "", "alpha delta_f", "delta_e", "", "(4)", "elevator effectiveness, "
        "increment with flaps",
     _NO_METHOD, "kept (Fig. 14)"),
    ("elevator_altitude", "", "mach h", "delta_e", "", "(4)", "elevator effectiveness, increment "
        "with Mach number and altitude",
     "no method (elastic tail); Mach number is in elevator", "could not be identified: dropped"),
    ("elevator_deflection", "", "delta_e", "delta_e", "", "(4)", "elevator effectiveness, "
        "decrease at large deflection",
     "contained in elevator, which goes over delta_e", "could not be identified: dropped"),
    ("tab", "", "mach alpha", "delta_t", "", "(5)", "elevator trim tab",
     "no method (CONTAB gives hinge moments only)", "could not be identified: deleted"),
    ("qhat", "", "mach h alpha", "qhat", "x_cg", "(6)", "pitch rate",
     "CL Cm: CLQ, CMQ", "replaced by a table over alpha and flap setting (Fig. 15)"),
    ("qhat_flap", "", "mach delta_f alpha", "qhat", "x_cg", "(6)", "pitch rate, increment with "
        "flaps",
     _NO_METHOD, "could not be identified: deleted"),
    ("alphadothat", "", "mach h alpha", "alphadothat", "x_cg", "(7)", "rate of angle of attack",
     "CL Cm: CLAD, CMAD; where they are missing, the tail's part from the downwash",
     "embedded in the pitch-rate term in the normal envelope (collinear)"),
    ("alphadothat_flap", "", "mach delta_f alpha", "alphadothat", "x_cg", "(7)",
     "rate of angle of attack, increment with flaps",
     _NO_METHOD, "embedded in the pitch-rate term"),
    ("load_factor", "", "mach h", "dnz", "", "(8)", "load factor (elastic aeroplane)",
     "no method (rigid aeroplane)", "could not be identified: deleted"),
    ("load_factor_flap", "", "mach delta_f", "dnz", "", "(8)", "load factor, increment with flaps",
     _NO_METHOD, "could not be identified: deleted"),
    ("speedbrake", "", "alpha mach", "", "speedbrake", "(9)", "speed brake", _NO_METHOD, "kept"),
    ("speedbrake_flap", "", "alpha delta_f", "", "speedbrake", "(9)", "speed brake, increment "
        "with flaps",
     _NO_METHOD, "could not be identified: eliminated"),
    ("gear", "", "alpha delta_f", "", "gear", "(10)", "undercarriage",
     _NO_METHOD, "kept; the cause of the first mismatch of section 5"),
    ("gear_mach", "", "alpha", "mach", "gear", "(10)",
     "undercarriage, increment with Mach number", _NO_METHOD, "deleted"),
    ("qhat_gear", "", "alpha delta_f", "qhat", "gear", "4.5", "pitch rate, increment with the "
        "undercarriage", _NO_METHOD, "added"),
    ("ground", "", "alpha mach delta_f", "", "h_agl", "(11)", "ground effect",
     "GRNDEF, page over ground less page in free air", "k h^s fitted to each part, (13)"),
    ("ground_flap", "", "alpha mach delta_f", "", "h_agl", "(11)", "ground effect, increment with "
        "flaps",
     "GRNDEF with SYMFLP on the wing, less the page without deflection", "k h^s fitted for each "
         "flap setting, (13)"),
    ("ground_elevator", "", "alpha mach delta_f", "delta_e", "h_agl", "(11)",
     "ground effect on the elevator",
     "GRNDEF with SYMFLP on the tail, unless the program carries pages from deflection to "
         "deflection (both builds do)",
     "k h^s fitted, (13)"),
    ("ground_alphadothat", "", "delta_f", "alphadothat", "h_agl", "(11)", "ground effect on the "
        "rate of angle of attack",
     "no method (dynamic pages ignore GRNDEF)", "a pitch-rate part instead, (13)"),
    ("power", "", "mach alpha", "CT", "", "-", "power effects without the thrust force itself, "
        "per thrust coefficient",
     "CL Cm: JETPWR, PROPWR: powered page less unpowered, the thrust force taken off | CD: "
         "PROPWR: slipstream", ""),
)

LATERAL: tuple[Row, ...] = (
    ("basic", "", "mach alpha", "", "", "like (3)", "asymmetry as built", "nothing: the program's "
        "aeroplane is symmetric", ""),
    ("beta", "", "mach alpha", "beta", "", "like (3)", "sideslip", "CYB, CLB, CNB", ""),
    ("beta_flap", "", "alpha delta_f", "beta", "", "like (2)", "sideslip, increment with flaps",
     _NO_METHOD, ""),
    ("beta_mach", "", "mach h", "beta", "", "like (2)", "sideslip, increment with Mach number and "
        "altitude",
     "no method (elastic fin); Mach number is in beta", ""),
    ("phat", "", "mach alpha", "phat", "", "like (6)", "roll rate", "CLP, CYP, CNP", ""),
    ("phat_flap", "", "alpha delta_f", "phat", "", "like (6)", "roll rate, increment with flaps",
     _NO_METHOD, ""),
    ("rhat", "", "mach alpha", "rhat", "", "like (6)", "yaw rate", "Cl Cn: CLR, CNR", ""),
    ("rhat_flap", "", "alpha delta_f", "rhat", "", "like (6)", "yaw rate, increment with flaps",
     _NO_METHOD, ""),
    ("aileron", "", "mach alpha", "delta_a", "", "like (4)", "aileron effectiveness",
     "Cl Cn: ASYFLP, STYPE 4: (CL)ROLL, CN over delta_a, wing-body", ""),
    ("aileron_flap", "", "alpha delta_f", "delta_a", "", "like (4)", "aileron effectiveness, "
        "increment with flaps", _NO_METHOD, ""),
    ("rudder", "", "mach alpha", "delta_r", "", "like (4)", "rudder effectiveness", _NO_METHOD, ""),
    ("rudder_flap", "", "alpha delta_f", "delta_r", "", "like (4)", "rudder effectiveness, "
        "increment with flaps", _NO_METHOD, ""),
    ("tab_aileron", "", "mach alpha", "delta_ta", "", "like (5)", "aileron trim tab",
     _NO_METHOD, ""),
    ("tab_rudder", "", "mach alpha", "delta_tr", "", "like (5)", "rudder trim tab", _NO_METHOD, ""),
    ("betadothat", "", "mach alpha", "betadothat", "", "like (7)", "rate of sideslip",
     _NO_METHOD, ""),
    ("speedbrake", "", "alpha mach", "beta", "speedbrake", "like (9)", "sideslip, increment with "
        "the speed brake", _NO_METHOD, ""),
    ("gear", "", "alpha delta_f", "beta", "gear", "like (10)", "sideslip, increment with the "
        "undercarriage", _NO_METHOD, ""),
    ("ground", "CY Cn", "alpha delta_f", "", "h_agl", "like (11)", "ground effect",
     "nothing: lateral columns over ground repeat those of free air", ""),
    ("ground", "Cl", "delta_f", "phi", "h_agl", "(14)", "rolling moment over ground that levels "
        "the wings; LR-743 multiplies CL too",
     "nothing: lateral columns over ground repeat those of free air", "Cl = k h^s CL phi, k "
         "-0.078, s -1.09 at 40 deg of flap (Table 2)"),
    ("spoiler", "", "mach alpha", "delta_s", "", "-", "spoilers as roll control",
     "Cl Cn: ASYFLP, STYPE 1 to 3: (CL)ROLL, CN over delta_s, wing-body", ""),
    ("differential_tail", "", "mach alpha", "delta_d", "", "-", "halves of the stabilizer "
        "deflected against each other",
     "Cl: ASYFLP, STYPE 5: (CL)ROLL over delta_d", ""),
)

HINGES: dict[str, tuple[Row, ...]] = {
    "Ch_e": (
        ("alpha", "", "mach alpha", "alpha", "", "-", "hinge moment of the elevator, angle of "
            "attack",
         "SYMFLP on the tail, (CH)A times the angle of attack of the tail", ""),
        ("delta", "", "mach delta_e", "delta_e", "", "-",
         "hinge moment of the elevator, deflection",
         "SYMFLP on the tail, (CH)D times the deflection", ""),
        ("tab", "", "mach", "delta_t", "", "-", "hinge moment of the elevator, trim tab",
         "CONTAB: the engineer's own B4 comes back", ""),
        ("tab_gearing", "", "mach alpha delta_e", "", "", "-", "hinge moment of the elevator, "
            "geared tab",
         "CONTAB: the engineer's own B2, D1 to D3 and gearing come back", ""),
    ),
    "Ch_a": (
        ("alpha", "", "mach alpha", "alpha", "", "-",
         "hinge moment of the aileron, angle of attack",
         "SYMFLP on the wing with the geometry of the aileron, (CH)A", ""),
        ("delta", "", "mach delta_a", "delta_a", "", "-", "hinge moment of the aileron, deflection",
         "SYMFLP on the wing with the geometry of the aileron, (CH)D times the deflection", ""),
        ("tab", "", "mach", "delta_ta", "", "-", "hinge moment of the aileron, trim tab",
         _NO_METHOD, ""),
    ),
    "Ch_r": (
        ("beta", "", "mach alpha", "beta", "", "-", "hinge moment of the rudder, sideslip",
         _NO_METHOD, ""),
        ("delta", "", "mach delta_r", "delta_r", "", "-",
         "hinge moment of the rudder, deflection", _NO_METHOD, ""),
        ("tab", "", "mach", "delta_tr", "", "-", "hinge moment of the rudder, trim tab",
         _NO_METHOD, ""),
    ),
}
# fmt: on


# Hinge moments of elevator, ailerons and rudder; they are allowed with any force axes.
HINGE = tuple(HINGES)
_COEFFICIENTS = ("CL", "CD", "Cm", "CY", "Cl", "Cn")
# Extensions from 0 to 1.  Without a table K1 they multiply the term.
_EXTENSIONS = ("gear", "speedbrake")


@dataclass(frozen=True)
class Slot:
    """One term of the scheme.

    Attributes
    ----------
    axes : tuple of str
        Axes that its table may have; a table without one of them is constant along it.
    regressors : tuple of str
        Variables that multiply the table.  A control or rate may be an axis of the table instead.
        The table then contains the effect of the variable and not its slope.
    K1 : str
        Axis of the factor table, empty for none: ``x_cg``, ``speedbrake``, ``gear``, ``h_agl``.
    equation : str
        Number in LR-743; ``-`` for an addition of this package, ``like (n)`` for the counterpart in
        another coefficient.
    meaning : str
        Meaning of the term.
    from_datcom : str
        Output of the program for the term, or the reason why there is none.
    identified : str
        Result of LR-743, section 4.5, from flight.
    """

    axes: tuple[str, ...]
    regressors: tuple[str, ...]
    K1: str
    equation: str
    meaning: str
    from_datcom: str
    identified: str


def lr743() -> dict[str, Slot]:
    """Return the scheme: the `Slot` of each term by name, in the order of the equations.

    References
    ----------
    .. [LR743] Report LR-743, 1993, eq. (1) to (11), sections 3.1 and 4.5.

    Examples
    --------
    >>> lr743()["CL/gear_mach"].regressors
    ('mach',)
    """
    groups = {
        **dict.fromkeys(("CL", "CD", "Cm"), LONGITUDINAL),
        **dict.fromkeys(("CY", "Cl", "Cn"), LATERAL),
        **HINGES,
    }
    slots = {}
    for coefficient, rows in groups.items():
        for row in rows:
            contribution, only = row[:2]
            if not only or coefficient in only.split():
                slots[f"{coefficient}/{contribution}"] = _make_slot(coefficient, row)
    return slots


def scheme_table() -> pd.DataFrame:
    """Return the scheme as a DataFrame: a row per term, the fields of `Slot` as columns.

    Lists are texts with blanks between their items.
    """
    import pandas as pd

    return pd.DataFrame.from_dict(scheme_texts(), orient="index").rename_axis("term")


def scheme_texts() -> dict[str, dict[str, str]]:
    """Return the rows of `scheme_table` by term."""
    rows = {}
    for name, slot in lr743().items():
        rows[name] = {
            "K1": slot.K1,
            "axes": " ".join(slot.axes),
            "regressors": " ".join(slot.regressors),
            "equation": slot.equation,
            "meaning": slot.meaning,
            "from_datcom": slot.from_datcom,
            "identified": slot.identified,
        }
    return rows


def make(
    name: str,
    breakpoints: Mapping[str, Sequence[float]] | None = None,
    *,
    value: Any = 0.0,
    K1: Mapping[str, Sequence[float]] | None = None,
    power: _terms.PowerFactor | None = None,
    stderr: Any = None,
    source: str | None = None,
    **text: str,
) -> xr.Dataset:
    """Return a leaf of the scheme with its axes and regressors.

    Parameters
    ----------
    name : str
        Term of the scheme, such as ``"CL/gear"``.
    breakpoints : mapping of str to sequence, optional
        Breakpoints by axis: any of the axes of the `Slot`.  A regressor given here becomes an
        axis. [SI]
    value : array or float
        Node values, in the order of `breakpoints`; one number applies to all nodes. [1 or per unit
        of the regressors]
    K1 : mapping of str to (breakpoints, factors), optional
        Factor table over the axis of the slot, ``{"gear": ([0, 1], [0, 1])}``.  Without it the
        undercarriage and the speed brake multiply the table, the c.g. factor is one, and ground
        effect needs ``h_agl`` among the axes.
    power : PowerFactor, optional
        Power factor, ground effect in closed form.  A power of ``h_agl`` counts as the height of
        the ground effect.
    stderr, source, **text
        As in `flightmech.terms.make_term`: standard error and source of the nodes, further
        attributes.

    Raises
    ------
    UnknownName
        A term that the scheme does not have.
    SchemaError
        An axis or factor that does not belong to the term, a shape that does not fit.

    Examples
    --------
    >>> make("CL/gear", {"alpha": [0.0, 0.2]}, value=0.01).attrs["regressors"]
    'gear'
    """
    scheme = lr743()
    if name not in scheme:
        raise UnknownName(name, scheme, "term", "aeromatch db scheme lists them")
    slot, axes, factors = scheme[name], dict(breakpoints or {}), dict(K1 or {})
    power_variable = ""
    if power is not None:
        power_variable = power.variable
    shape, array = tuple(len(points) for points in axes.values()), np.asarray(value, float)
    problems = _axis_faults(slot, axes, factors, power_variable)
    problems += _shape_faults(array, axes, shape)
    if problems:
        raise SchemaError(name, problems)
    # A regressor that became an axis is in the table, unless the slot has it as an axis as well.
    regressors = [word for word in slot.regressors if word not in axes or word in slot.axes]
    if slot.K1 in _EXTENSIONS and not factors and slot.K1 not in axes:
        regressors.append(slot.K1)
    leaf = _terms.make_term(
        np.broadcast_to(array, shape).copy(),
        axes,
        regressors,
        K1=_factor_table(factors, slot.K1),
        power=power,
        stderr=stderr,
        source=source,
    )
    return leaf.assign_attrs(text)


def _shape_faults(array: np.ndarray, axes: Mapping[str, Any], shape: tuple[int, ...]) -> list[str]:
    """Return the fault of node values that do not fit the breakpoints; a number always fits."""
    if array.shape in ((), shape):
        return []
    return [
        f"value has the shape {array.shape}, the breakpoints "
        f"{' '.join(axes) or '(none)'} have {shape}"
    ]


def _factor_table(factors: Mapping[str, Any], axis: str) -> xr.DataArray | None:
    """Return the factor table over an axis, None without factors."""
    if axis not in factors:
        return None
    import xarray as xr

    points, values = factors[axis]
    return xr.DataArray(np.asarray(values, float), {axis: np.asarray(points, float)}, axis)


def _make_slot(coefficient: str, row: Row) -> Slot:
    """Return the entry of one coefficient.

    LR-743 prints the equations and results of lift, and those of roll over ground.
    """
    _, _, axes, regressors, K1, equation, meaning, from_datcom, identified = row
    if coefficient in ("CD", "Cm") and equation.startswith("("):
        equation = f"like {equation}"
    if coefficient not in ("CL", "Cl"):
        identified = ""
    return Slot(
        axes=tuple(axes.split()),
        regressors=tuple(regressors.split()),
        K1=K1,
        equation=equation,
        meaning=meaning,
        from_datcom=_select_source(from_datcom, coefficient),
        identified=identified,
    )


def _axis_faults(
    slot: Slot, axes: Mapping[str, Any], K1: Mapping[str, Any], power: str
) -> list[str]:
    """Return the faults of axes and factors that do not fit a slot."""
    allowed = list(dict.fromkeys(filter(None, (*slot.axes, *slot.regressors, slot.K1))))
    problems = []
    for axis in axes:
        if axis not in allowed:
            problems.append(
                f"the axis {axis} does not belong here; allowed: {', '.join(allowed) or 'none'}"
            )
    requirement = "the term has no factor"
    if slot.K1:
        requirement = f"it goes over {slot.K1}"
    for axis, pair in K1.items():
        if axis != slot.K1:
            problems.append(f"K1 over {axis} does not belong here; {requirement}")
        elif axis in axes:
            problems.append(f"{axis} is an axis of K1 and of the table; leave one of them out")
        elif len(pair) != 2 or len(pair[0]) != len(pair[1]):
            problems.append(f"K1 over {axis} is not a pair of breakpoints and as many factors")
    if slot.K1 == "h_agl" and not K1 and "h_agl" not in (*axes, power):
        problems.append(
            "does not depend on height; give K1 over h_agl, h_agl among the breakpoints, or a "
            "power of it"
        )
    return problems


def _select_source(text: str, coefficient: str) -> str:
    """Return the source in DATCOM of one coefficient.

    ``CL Cm: CLQ, CMQ | CD: ...`` names the coefficients of each part.  The others have no method.
    A text without coefficients holds for all.
    """
    by_coefficient = {}
    for part in text.split("|"):
        names, _, source = part.strip().partition(": ")
        for name in names.split():
            if name in _COEFFICIENTS:
                by_coefficient[name] = source
    if not by_coefficient:
        return text
    return by_coefficient.get(coefficient, _NO_METHOD)
