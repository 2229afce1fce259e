"""The database of a similar aircraft: coefficients kept, lengths changed, doubt added ([LR743]
section 2.3).

Shapes that are alike have the same coefficients at the same Mach number; what is not alike widens
the standard errors.  Heights over the ground are counted in spans, so their breakpoints and floors
grow with the span; Mach numbers, heights over sea level and angles stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from aerodb.store.grids import without_formula
from aerodb.store.schema import make_database, require_valid, terms
from aerodb.update.posterior import carry_covariance
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.errors import SchemaError, UnknownName

# coefficient: (relative, absolute); the absolute one for the basic term only, increments are zero
# without their cause
WIDENING: dict[str, tuple[float, float]] = {
    "CL": (
        0.05,
        0.02,
    ),  # section and plan form differ a little: half of what a DATCOM-type method is given
    "CD": (0.10, 0.002),  # surface, gaps, intakes
    "CX": (0.10, 0.005),
    "CZ": (0.05, 0.02),
    "Cm": (0.15, 0.01),  # tail volume and its setting are what designers change first
    "CY": (0.15, 0.005),
    "Cl": (0.20, 0.002),  # dihedral, sweep
    "Cn": (0.20, 0.002),  # fin volume
    "Ch_e": (0.30, 0.01),  # hinge moments follow nose shape and gaps
    "Ch_a": (0.30, 0.01),
    "Ch_r": (0.30, 0.01),
}
"""Standard errors that similarity adds to those a node has: engineering judgement, overridable."""

GROUPS: dict[str, tuple[str, ...]] = {
    "horizontal_tail": tuple(
        f"{c}/{name}" for c in ("CL", "Cm") for name in ("elevator", "tab", "qhat", "alphadothat")
    )
    + ("CD/elevator",),
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
"""Terms that go with one part of the aircraft, for factors such as the ratio of tail volumes.  The slopes over alpha and beta hold wing and
body as well and belong to no group."""


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
        Of the known aircraft; it is left as it is.
    aircraft : Aircraft
        The new one, e.g. from `flightmech.aircraft.rescale`: reference area, chord, span and moment
        reference point are taken from it.  The point must lie at the same place of the shape.
    factors : mapping of str to float, optional
        Factors on single terms (``"Cm/elevator"``) or on `GROUPS` (``"horizontal_tail"``), such as
        a ratio of tail volumes. [1]
    widening : mapping of str to (float, float), optional
        Coefficient to the relative and absolute standard error added, laid over `WIDENING`.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        Every node has the source ``judgement`` and stderr = hypot(stderr, relative |value|,
        absolute); the absolute figure goes to basic terms only.  Check cases of the known aircraft
        and its undo history are not taken over.

    Raises
    ------
    UnknownName
        A factor for a term or group, or a widening for a coefficient, that is not there.
    SchemaError
        A figure that is negative or not finite.
    """
    require_valid(db)
    leaves = terms(db)
    by = dict(_by_term(leaves, dict(factors or {})))
    wide = _widening(widening)
    span = aircraft.b / float(db.attrs["b"])
    summary = [
        f"from {db.attrs.get('aircraft', 'another aircraft')} to {aircraft.name}, span ratio "
        f"{span:.6g}"
    ]
    summary += [f"{name} times {value:g}" for name, value in (factors or {}).items()]
    line = f"rescale: {'; '.join(summary)}{f' ({note})' if note else ''}"
    scaled = {
        name: _scaled(name, leaf, by.get(name, 1.0), span, wide[name.split("/")[0]], line)
        for name, leaf in leaves.items()
    }
    scaled_place = {
        name: span * float(db.attrs.get(name, 0.0)) for name in ("x_ref", "y_ref", "z_ref")
    }
    place = dict(zip(scaled_place, reference_in(aircraft, scaled_place), strict=True))
    attributes = {
        **{str(key): item for key, item in db.attrs.items()},
        "aircraft": aircraft.name,
        "title": f"{aircraft.name}, by similarity",
    }
    attributes |= {"S": aircraft.S, "cbar": aircraft.cbar, "b": aircraft.b, **place}
    history = str(db.attrs.get("history", ""))
    return make_database(
        scaled, **{**attributes, "history": f"{history}\n{line}" if history else line}
    )


def _by_term(
    leaves: Mapping[str, xr.Dataset], factors: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    bad = [
        f"{name} is {value!r}; give a finite number"
        for name, value in factors.items()
        if not np.isfinite(value)
    ]
    if bad:
        raise SchemaError("factors", bad)
    found: dict[str, float] = {}
    for name, value in factors.items():
        if name not in GROUPS and name not in leaves:
            raise UnknownName(name, [*GROUPS, *leaves], "term or group")
        for term in GROUPS.get(name, (name,)):
            if term in leaves:
                found[term] = found.get(term, 1.0) * value
    yield from found.items()


def _widening(
    overrides: Mapping[str, tuple[float, float]] | None,
) -> dict[str, tuple[float, float]]:
    found = dict(WIDENING)
    for name, pair in (overrides or {}).items():
        if name not in found:
            raise UnknownName(name, found, "coefficient")
        if len(pair) != 2 or not all(np.isfinite(x) and x >= 0.0 for x in pair):
            raise SchemaError(
                "widening",
                [f"{name} is {pair!r}; give (relative, absolute), two numbers of zero or more"],
            )
        found[name] = (float(pair[0]), float(pair[1]))
    return found


def _scaled(
    name: str, leaf: xr.Dataset, by: float, span: float, wide: tuple[float, float], line: str
) -> xr.Dataset:
    value = leaf["value"].values * by
    stderr = leaf["stderr"].values * abs(by) if "stderr" in leaf else np.zeros_like(value)
    absolute = wide[1] if name.endswith("/basic") else 0.0
    dims, times = leaf["value"].dims, by
    new = leaf.assign(
        value=leaf["value"].copy(data=value),
        stderr=(dims, np.sqrt(stderr**2 + (wide[0] * value) ** 2 + absolute**2)),
    )
    new["source"] = dims, np.full(value.shape, _terms.SOURCES.index("judgement"), np.uint8)
    new["source"].attrs = {"flag_values": "0 1 2", "flag_meanings": " ".join(_terms.SOURCES)}
    if "h_agl" in new.coords:
        attributes = new["h_agl"].attrs
        new = new.assign_coords(h_agl=new["h_agl"].values * span)
        new["h_agl"].attrs = attributes
        new = without_formula(new)
    power = _terms.power_factor(leaf)
    if power is not None and power.variable == "h_agl":  # max(h/span, floor)^s
        part = span**-power.exponent
        new = new.assign(value=new["value"] * part, stderr=new["stderr"] * part).assign_attrs(
            floor=power.floor * span
        )
        times *= part
    new = carry_covariance(leaf, new, times)
    history = str(leaf.attrs.get("history", ""))
    return new.assign_attrs(history=f"{history}\n{line}" if history else line)
