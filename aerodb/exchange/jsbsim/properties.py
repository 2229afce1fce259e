"""What JSBSim calls the model variables, and in which units: the tables that export and import
share.

A property of JSBSim carries its unit in its name.  Here it is a number times powers of *symbols*:
model variables and the reference quantities ``S``, ``cbar``, ``b``, each in the unit JSBSim
computes with (`UNIT`; 1 where that is SI).  So the dynamic pressure and the reference quantities of
a force cancel without a rounding.

Where JSBSim has no property for a variable, an exported file defines a function
``aero/aeromatch/<variable>`` in SI, and the import knows it again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.xml_reader import Element
from flightmech.errors import ParseError, SchemaError
from flightmech.terms import list_regressors
from flightmech.units import DEGREE, FOOT, POUND_FORCE

PSF = POUND_FORCE / FOOT**2
OWN = "aero/aeromatch/"
COEFFICIENT = "aero/coefficient/"
LIFT_SQUARED = "aero/cl-squared"  # of the lift of the step before and the present dynamic pressure
ENGINE = re.compile(r"engine([1-9]\d*)\.(throttle|thrust)$")
UNIT = {
    "V": FOOT,
    "h": FOOT,
    "qbar": PSF,
    "thrust": POUND_FORCE,
}  # SI per unit in which JSBSim computes, where they differ
RATES = {
    "phat": ("p", "b"),
    "qhat": ("q", "cbar"),
    "rhat": ("r", "b"),
    "alphadothat": ("alpha_dot", "cbar"),
    "betadothat": ("beta_dot", "b"),
}

# variable: the property an export looks up, in the unit of `jsbsim_unit`
AXIS = {
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "mach": "velocities/mach",
    "V": "velocities/vt-fps",
    "qbar": "aero/qbar-psf",
    "h": "position/h-sl-ft",
    "phi": "attitude/phi-rad",
    "p": "velocities/p-aero-rad_sec",
    "q": "velocities/q-aero-rad_sec",
    "r": "velocities/r-aero-rad_sec",
    "delta_e": "fcs/elevator-pos-rad",
    "delta_r": "fcs/rudder-pos-rad",
    "delta_f": "fcs/flap-pos-rad",
    "delta_t": "fcs/elevator-tab-pos-rad",
    "delta_ta": "fcs/aileron-tab-pos-rad",
    "delta_tr": "fcs/rudder-tab-pos-rad",
    "delta_d": "fcs/stabilizer-difference-pos-rad",
    "delta_s": "fcs/spoiler-difference-pos-norm",
    "gear": "gear/gear-pos-norm",
    "speedbrake": "fcs/speedbrake-pos-norm",
}

# reduced rate: the properties whose product it is
REGRESSOR = {
    "phat": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "qhat": ("aero/ci2vel", "velocities/q-aero-rad_sec"),
    "rhat": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "alphadothat": ("aero/ci2vel", "aero/alphadot-rad_sec"),
    "betadothat": ("aero/bi2vel", "aero/betadot-rad_sec"),
}

_REDUCED = (
    "<quotient><product><property>{rate}</property><property>metrics/{length}-ft</property></product>"
    "<product><value>2</value><max><property>velocities/vt-fps</property><value>0.001</value></max></product></quotient>"
)
# variable JSBSim has not: the function that gives it in SI; the export fills the fields in braces
FUNCTION = {
    "delta_a": "<product><value>0.5</value><difference><property>fcs/right-aileron-pos-rad</property>"
    "<property>fcs/left-aileron-pos-rad</property></difference></product>",
    "h_agl": f"<product><value>{FOOT!r}</value><property>aero/h_b-mac-ft</property><property>metrics/bw-ft</property></product>",
    "dnz": "<difference><property>accelerations/Nz</property><value>1</value></difference>",
    "x_cg": "<sum><value>{x_ref_mac!r}</value><product><value>{chords_per_inch!r}</value><difference><property>inertia/cg-x-in</property>"
    "<property>metrics/aero-rp-x-in</property></difference></product></sum>",
    "CT": "<quotient><sum><value>0</value>{thrusts}</sum><product><property>aero/qbar-psf</property>"
    "<property>metrics/Sw-sqft</property></product></quotient>",
    "phat": _REDUCED.format(rate="velocities/p-aero-rad_sec", length="bw"),
    "qhat": _REDUCED.format(rate="velocities/q-aero-rad_sec", length="cbarw"),
    "rhat": _REDUCED.format(rate="velocities/r-aero-rad_sec", length="bw"),
    "alphadothat": _REDUCED.format(rate="aero/alphadot-rad_sec", length="cbarw"),
    "betadothat": _REDUCED.format(rate="aero/betadot-rad_sec", length="bw"),
}


def jsbsim_unit(variable: str) -> float:
    """Return the unit of JSBSim in which a variable stands, in SI; that of ``engine2.thrust`` is
    the one of ``thrust``.
    """
    return UNIT.get(variable.rsplit(".", 1)[-1], 1.0)


def throttle_property(engine: int) -> str:
    """Return the property of an engine's lever; engine 1 is the first."""
    return "fcs/throttle-cmd-norm" + (f"[{engine - 1}]" if engine > 1 else "")


def thrust_property(engine: int) -> str:
    """Return the property of an engine's thrust."""
    return f"fcs/engine{engine}-thrust-lbs"


class PropertyValue(NamedTuple):
    """The value of a property: `factor` times powers of symbols, each in the unit of `UNIT`."""

    factor: float
    symbols: Mapping[str, int]


def _one(symbol: str, factor: float = 1.0) -> PropertyValue:
    return PropertyValue(factor, {symbol: 1})


# every property the import knows; ailerons are taken to move by the same angle, left = -delta_a
PROPERTY: dict[str, PropertyValue] = {
    **{name: _one(variable) for variable, name in AXIS.items()},
    "aero/alpha-deg": _one("alpha", 1.0 / DEGREE),
    "aero/beta-deg": _one("beta", 1.0 / DEGREE),
    "attitude/roll-rad": _one("phi"),
    "position/h-sl-meters": _one("h", FOOT),
    "velocities/vtrue-fps": _one("V"),
    "velocities/p-rad_sec": _one("p"),
    "velocities/q-rad_sec": _one("q"),
    "velocities/r-rad_sec": _one("r"),
    "aero/alphadot-rad_sec": _one("alpha_dot"),
    "aero/alphadot-deg_sec": _one("alpha_dot", 1.0 / DEGREE),
    "aero/betadot-rad_sec": _one("beta_dot"),
    "aero/betadot-deg_sec": _one("beta_dot", 1.0 / DEGREE),
    "fcs/elevator-pos-deg": _one("delta_e", 1.0 / DEGREE),
    "fcs/rudder-pos-deg": _one("delta_r", 1.0 / DEGREE),
    "fcs/flap-pos-deg": _one("delta_f", 1.0 / DEGREE),
    "fcs/left-aileron-pos-rad": _one("delta_a", -1.0),
    "fcs/left-aileron-pos-deg": _one("delta_a", -1.0 / DEGREE),
    "fcs/right-aileron-pos-rad": _one("delta_a"),
    "fcs/right-aileron-pos-deg": _one("delta_a", 1.0 / DEGREE),
    "metrics/Sw-sqft": _one("S"),
    "metrics/cbarw-ft": _one("cbar"),
    "metrics/bw-ft": _one("b"),
    "aero/qbar-area": PropertyValue(1.0, {"qbar": 1, "S": 1}),
    "aero/bi2vel": PropertyValue(0.5, {"b": 1, "V": -1}),
    "aero/ci2vel": PropertyValue(0.5, {"cbar": 1, "V": -1}),
    "aero/h_b-mac-ft": PropertyValue(1.0 / FOOT, {"h_agl": 1, "b": -1}),
    LIFT_SQUARED: PropertyValue(1.0, {"CL": 2}),
    **{OWN + variable: _one(variable) for variable in FUNCTION},
}

# property: the one whose magnitude it is
MAGNITUDE = {
    "aero/mag-beta-rad": "aero/beta-rad",
    "aero/mag-beta-deg": "aero/beta-deg",
    "fcs/mag-elevator-pos-rad": "fcs/elevator-pos-rad",
    "fcs/mag-left-aileron-pos-rad": "fcs/left-aileron-pos-rad",
    "fcs/mag-right-aileron-pos-rad": "fcs/right-aileron-pos-rad",
    "fcs/mag-rudder-pos-rad": "fcs/rudder-pos-rad",
}

# deflection as a fraction: variable and sense; the angle at 1 must come from the user
NORMALISED = {
    "fcs/elevator-pos-norm": ("delta_e", 1.0),
    "fcs/left-aileron-pos-norm": ("delta_a", -1.0),
    "fcs/right-aileron-pos-norm": ("delta_a", 1.0),
    "fcs/rudder-pos-norm": ("delta_r", 1.0),
    "fcs/flap-pos-norm": ("delta_f", 1.0),
}

# all values a variable can take: within them a line or a magnitude is a table without any loss
RANGE = {
    "beta": (-math.pi / 2, math.pi / 2),
    **{
        name: (-math.pi, math.pi)
        for name in ("alpha", "phi", "delta_e", "delta_a", "delta_r", "delta_f")
    },
    "gear": (0.0, 1.0),
    "speedbrake": (0.0, 1.0),
}


_LOOKUP = ("column", "row", "table", "axis4")  # from the last dimension backwards


def factor_elements(leaf: xr.Dataset, native: bool) -> list[ET.Element]:
    """Return the factors of a term: its regressors and tables as elements of a product; `native` as
    in `table`.
    """
    words = list_regressors(leaf)
    found = [_text("property", LIFT_SQUARED)] if words == ("CL", "CL") else []
    for word in () if found else words:
        found += [_text("property", name) for name in REGRESSOR.get(word) or (property_of(word),)]
        if jsbsim_unit(word) != 1.0:
            found.append(_text("value", repr(jsbsim_unit(word))))
    return found + [
        table_element(leaf[name], native) for name in ("value", "K1", "K2") if name in leaf
    ]


def property_of(variable: str) -> str:
    """Return the property that holds a variable, in the unit of `jsbsim_unit`."""
    engine = ENGINE.match(variable)
    if engine:
        return (
            throttle_property(int(engine[1]))
            if engine[2] == "throttle"
            else thrust_property(int(engine[1]))
        )
    return AXIS.get(variable, OWN + variable)


def table_element(values: xr.DataArray, native: bool) -> ET.Element:
    """Return a table of 0 to 4 axes as an element of a function.

    Parameters
    ----------
    values : DataArray
        The nodes; coordinates in SI.
    native : bool
        Four axes as a table of JSBSim 1.3.1; else as tables of three, interpolated over the first
        axis.
    """
    if values.ndim == 0:
        return _text("value", repr(float(values)))
    axes = [str(axis) for axis in values.dims]
    points = [_points(values, axis) for axis in axes]
    if values.ndim == 4 and not native:
        return _slices(values, points[0])
    element = ET.Element("table")
    if values.ndim == 1:
        element.append(_text("independentVar", property_of(axes[0]), lookup="row"))
        _data(element, _rows(points[0], values.values[:, None]))
        return element
    for axis, lookup in zip(reversed(axes), _LOOKUP):
        element.append(_text("independentVar", property_of(axis), lookup=lookup))
    _blocks(element, values.values, points)
    return element


def extend_linearly(leaf: xr.Dataset, reach: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """Return a term that goes on linearly beyond its tables as one that holds, its tables continued
    to `reach`.
    """
    if leaf.attrs.get("outside", "hold") == "hold":
        return leaf
    tables = {name: leaf[name] for name in ("value", "K1", "K2") if name in leaf}
    for name, values in tables.items():
        for axis in map(str, values.dims):
            tables[name] = _continued(tables[name], axis, *reach[axis])
    return xr.Dataset(tables, attrs={**leaf.attrs, "outside": "hold"})


def _continued(values: xr.DataArray, axis: str, low: float, high: float) -> xr.DataArray:
    points = values[axis].values
    ends = [end for end in (low, high) if end < points[0] or end > points[-1]]
    return (
        values.interp({axis: np.union1d(points, ends)}, kwargs={"fill_value": "extrapolate"})
        if ends
        else values
    )


def _points(values: xr.DataArray, axis: str) -> np.ndarray:
    points = values[axis].values / jsbsim_unit(axis)
    if (np.diff(points) <= 0).any():
        raise SchemaError(
            "JSBSim table",
            [f"breakpoints of {axis} fall together in the unit of JSBSim; regrid the term"],
        )
    return points


def _blocks(parent: ET.Element, values: np.ndarray, points: list[np.ndarray]) -> None:
    if values.ndim == 2:
        head = " ".join(repr(float(x)) for x in points[1])
        _data(parent, [head, *_rows(points[0], values)])
        return
    for point, part in zip(points[0], values):
        inner = ET.SubElement(parent, "tableData", breakPoint=repr(float(point)))
        if part.ndim > 2:
            _blocks(inner, part, points[1:])
        else:
            inner.text = _lines(
                [" ".join(repr(float(x)) for x in points[2]), *_rows(points[1], part)]
            )


def _slices(values: xr.DataArray, points: np.ndarray) -> ET.Element:
    element = ET.Element("interpolate1d")
    element.append(_text("property", property_of(str(values.dims[0]))))
    for number, point in enumerate(points):
        element.append(_text("value", repr(float(point))))
        element.append(table_element(values[number], native=False))
    return element


def _rows(points: np.ndarray, values: np.ndarray) -> list[str]:
    return [" ".join(repr(float(x)) for x in (point, *row)) for point, row in zip(points, values)]


def _data(parent: ET.Element, lines: list[str]) -> None:
    ET.SubElement(parent, "tableData").text = _lines(lines)


def _lines(lines: list[str]) -> str:
    return "\n" + "\n".join(lines) + "\n"


def _text(tag: str, text: str, **attributes: str) -> ET.Element:
    element = ET.Element(tag, attributes)
    element.text = text
    return element


_ENDS = (-1.0, 1.0)  # domain and range that JSBSim takes where a file states none
_SAME = 1e-6  # relative: limits written with seven digits


def stated_travel(control: Element) -> dict[str, float]:
    """Return the angle at which a position counts 1, by variable, from the elements of a
    ``<flight_control>``. [rad]
    """
    found: dict[str, float] = {}
    for element in control.walk():
        if element.tag == "aerosurface_scale" and (angle := _angle(element)) is not None:
            variable, value = angle
            found.setdefault(variable, value)
    return found


def _angle(scale: Element) -> tuple[str, float] | None:
    """Return the variable that a scaling turns into a fraction, and its angle at 1; None for any
    other scaling.
    """
    output, given, centred = (scale.first(tag) for tag in ("output", "input", "zero_centered"))
    if (
        output is None
        or given is None
        or output.text not in NORMALISED
        or given.text not in PROPERTY
    ):
        return None
    variable, _ = NORMALISED[output.text]
    symbols = PROPERTY[given.text].symbols
    if symbols != {variable: 1} or (
        centred is not None and centred.text not in ("true", "1") and not _through_zero(scale)
    ):
        return None
    gain = scale.first("gain")
    domain, reach = _ends(scale, "domain"), _ends(scale, "range")
    sides = [
        x / (y * (1.0 if gain is None else gain.number))
        for x, y in zip(domain, reach)
        if x != 0.0 and y != 0.0
    ]
    if not sides or max(sides) - min(sides) > _SAME * abs(sides[0]) or sides[0] <= 0.0:
        return None
    return variable, sides[0] / abs(PROPERTY[given.text].factor)


def _through_zero(scale: Element) -> bool:
    """Return whether a linear scaling maps zero to zero."""
    (low, high), (bottom, top) = _ends(scale, "domain"), _ends(scale, "range")
    return bottom * high == top * low


def _ends(scale: Element, tag: str) -> tuple[float, float]:
    pair = scale.first(tag)
    if pair is None:
        return _ENDS
    low, high = pair.first("min"), pair.first("max")
    try:
        return (0.0 if low is None else low.number, 0.0 if high is None else high.number)
    except ParseError:  # an end that is a property: no number that the file states
        return 0.0, 0.0
