"""Database of a similar aircraft, from that of a known one (LR-743, section 2.3).

Similar shapes have the same coefficients at the same Mach number.  Differences of shape increase
the standard errors.  Heights over the ground are measured in spans, so that their breakpoints and
floors scale with the span.  Mach numbers, heights over sea level and angles do not change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.grids import without_formula
from aerodb.store.schema import make_database, require_valid, terms
from aerodb.update.posterior import carry_covariance
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup

# By coefficient: relative and absolute error.  The absolute one applies to the basic term only,
# because increments are zero without their cause.
WIDENING: dict[str, tuple[float, float]] = {
    "CL": (0.05, 0.02),  # section and plan form differ a little: half the error of a DATCOM method
    "CD": (0.10, 0.002),  # surface, gaps, intakes
    "CX": (0.10, 0.005),
    "CZ": (0.05, 0.02),
    "Cm": (0.15, 0.01),  # tail volume and setting often differ
    "CY": (0.15, 0.005),
    "Cl": (0.20, 0.002),  # dihedral, sweep
    "Cn": (0.20, 0.002),  # fin volume
    "Ch_e": (0.30, 0.01),  # hinge moments follow nose shape and gaps
    "Ch_a": (0.30, 0.01),
    "Ch_r": (0.30, 0.01),
}
"""Standard errors that similarity adds to those of a node: engineering judgement, overridable."""

# Units of variables that are equal on similar aircraft, and the heights, which have a law.
_NUMBERS = ("1", "rad")
_HEIGHTS = ("h", "h_agl")

GROUPS: dict[str, tuple[str, ...]] = {
    "horizontal_tail": (
        "CL/elevator",
        "CL/tab",
        "CL/qhat",
        "CL/alphadothat",
        "Cm/elevator",
        "Cm/tab",
        "Cm/qhat",
        "Cm/alphadothat",
        "CD/elevator",
    ),
    "vertical_tail": (
        "CY/rudder",
        "Cl/rudder",
        "Cn/rudder",
        "CY/rhat",
        "Cn/rhat",
        "CY/betadothat",
        "Cn/betadothat",
    ),
    "ailerons": ("CY/aileron", "Cl/aileron", "Cn/aileron"),
}
"""Terms of one part of the aircraft, for factors such as the ratio of tail volumes.

The slopes over alpha and beta contain wing and body as well and do not belong to any group.
"""


def rescale(
    db: xr.DataTree,
    aircraft: Aircraft,
    factors: Mapping[str, float] | None = None,
    widening: Mapping[str, tuple[float, float]] | None = None,
    note: str = "",
) -> xr.DataTree:
    """Return the database of a known aircraft for a similar one.

    Parameters
    ----------
    db : DataTree
        Database of the known aircraft; it does not change.
    aircraft : Aircraft
        The similar aircraft, for example from `flightmech.aircraft.rescale`, with reference area,
        chord, span and moment reference point.  The point must be at the same position of the
        shape.
    factors : mapping of str to float, optional
        Factors on single terms (``"Cm/elevator"``) or on `GROUPS` (``"horizontal_tail"``), such as
        a ratio of tail volumes. [1]
    widening : mapping of str to (float, float), optional
        Added relative and absolute standard error by coefficient, in place of `WIDENING`.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        Every node has the source ``judgement`` and stderr = hypot(stderr, relative |value|,
        absolute).  The absolute figure applies to basic terms only.  Check cases and undo history
        of the known aircraft are not copied.

    Raises
    ------
    UnknownName
        A factor for an unknown term or group, or a widening for an unknown coefficient.
    SchemaError
        A figure that is negative or not finite, or a term over a speed, a rate, a pressure or a
        force, whose values on the similar aircraft are others.
    """
    require_valid(db)
    leaves = terms(db)
    _demand_similar_variables(leaves)
    by_term = _factors_by_term(leaves, factors or {})
    errors = _added_errors(widening)
    span = aircraft.b / float(db.attrs["b"])
    summary = [
        f"from {db.attrs.get('aircraft', 'another aircraft')} to {aircraft.name}, span ratio "
        f"{span:.6g}"
    ]
    summary += [f"{name} times {value:g}" for name, value in (factors or {}).items()]
    line = f"rescale: {'; '.join(summary)}"
    if note:
        line = f"{line} ({note})"
    scaled = {}
    for name, leaf in leaves.items():
        relative, absolute = errors[name.split("/")[0]]
        if not name.endswith("/basic"):
            absolute = 0.0
        new = _scale_leaf(leaf, by_term.get(name, 1.0), span, relative=relative, absolute=absolute)
        scaled[name] = new.assign_attrs(history=_extend_history(leaf.attrs, line))
    # The reference point of the aircraft file, by default the known one at the same scale.
    scaled_point = {}
    for name in ("x_ref", "y_ref", "z_ref"):
        scaled_point[name] = span * float(db.attrs.get(name, 0.0))
    point = dict(zip(scaled_point, reference_in(aircraft, scaled_point), strict=True))
    # Attributes of the known aircraft, with the quantities of the similar one.
    attributes = {str(key): item for key, item in db.attrs.items()}
    attributes |= {
        "aircraft": aircraft.name,
        "title": f"{aircraft.name}, by similarity",
        "S": aircraft.S,
        "cbar": aircraft.cbar,
        "b": aircraft.b,
        **point,
        "history": _extend_history(db.attrs, line),
    }
    return make_database(scaled, **attributes)


def _demand_similar_variables(leaves: Mapping[str, xr.Dataset]) -> None:
    """Raise for terms over variables that have no law of similarity here."""
    problems = []
    for name, leaf in leaves.items():
        for variable in sorted(_terms.list_model_variables(leaf)):
            units = lookup(variable).units
            if units in _NUMBERS or variable in _HEIGHTS:
                continue
            problems.append(
                f"{name} depends on {variable} [{units}], whose values do not carry over to "
                f"another size; express it by a ratio (Mach number, qhat, CT), or delete the term"
            )
    if problems:
        raise SchemaError("rescale", problems)


def _extend_history(attributes: Mapping[Any, Any], line: str) -> str:
    """Return the history of some attributes with a further line."""
    return "\n".join(filter(None, [str(attributes.get("history", "")), line]))


def _factors_by_term(
    leaves: Mapping[str, xr.Dataset], factors: Mapping[str, float]
) -> dict[str, float]:
    """Return the factor of each term: the product of its own and those of its groups."""
    problems = []
    for name, value in factors.items():
        if not np.isfinite(value):
            problems.append(f"{name} is {value!r}; give a finite number")
    if problems:
        raise SchemaError("factors", problems)
    # A term may have its own factor and that of its group.
    by_term: dict[str, float] = {}
    for name, value in factors.items():
        if name not in GROUPS and name not in leaves:
            raise UnknownName(name, [*GROUPS, *leaves], "term or group")
        for term in GROUPS.get(name, (name,)):
            if term in leaves:
                by_term[term] = by_term.get(term, 1.0) * value
    return by_term


def _added_errors(
    overrides: Mapping[str, tuple[float, float]] | None,
) -> dict[str, tuple[float, float]]:
    """Return the added relative and absolute standard error by coefficient."""
    errors = dict(WIDENING)
    for name, pair in (overrides or {}).items():
        if name not in errors:
            raise UnknownName(name, errors, "coefficient")
        if len(pair) != 2 or not all(np.isfinite(x) and x >= 0.0 for x in pair):
            raise SchemaError(
                "widening",
                [f"{name} is {pair!r}; give (relative, absolute), two numbers of zero or more"],
            )
        errors[name] = (float(pair[0]), float(pair[1]))
    return errors


def _scale_leaf(
    leaf: xr.Dataset, factor: float, span: float, *, relative: float, absolute: float
) -> xr.Dataset:
    """Return a leaf of the similar aircraft; `span` is the ratio of the spans."""
    # stderr = hypot(stderr, relative |value|, absolute) with the scaled value.
    value = leaf["value"].values * factor
    stderr = np.zeros_like(value)
    if "stderr" in leaf:
        stderr = leaf["stderr"].values * abs(factor)
    dims = leaf["value"].dims
    new = leaf.assign(
        value=leaf["value"].copy(data=value),
        stderr=(dims, np.sqrt(stderr**2 + (relative * value) ** 2 + absolute**2)),
    )
    new["source"] = dims, np.full(value.shape, _terms.SOURCES.index("judgement"), np.uint8)
    new["source"].attrs = dict(_terms.SOURCE_ATTRS)
    # Heights over the ground scale with the span, and their attributes stay.
    if "h_agl" in new.coords:
        attributes = new["h_agl"].attrs
        new = new.assign_coords(h_agl=new["h_agl"].values * span)
        new["h_agl"].attrs = attributes
        new = without_formula(new)
    # A power factor of the height in spans: max(h / span, floor)^s = span^-s max(h, span floor)^s.
    power = _terms.power_factor(leaf)
    if power is not None and power.variable == "h_agl":
        share = span**-power.exponent
        new = new.assign(value=new["value"] * share, stderr=new["stderr"] * share)
        new = new.assign_attrs(floor=power.floor * span)
        factor *= share
    return carry_covariance(leaf, new, factor)
