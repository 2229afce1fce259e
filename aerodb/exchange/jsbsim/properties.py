"""Properties and units of JSBSim for the model variables, for export and import.

A property of JSBSim has its unit in its name.  Here it is a number times powers of *symbols*: model
variables and the reference quantities ``S``, ``cbar``, ``b``, each in the unit in which JSBSim
computes (`UNIT`; 1 if that is SI).  So the dynamic pressure and the reference quantities of a force
cancel without rounding.

If JSBSim has no property for a variable, an exported file defines a function
``aero/aeromatch/<variable>`` in SI, and the import recognises it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.xml_reader import Element
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import ParseError, SchemaError
from flightmech.terms import list_regressors
from flightmech.units import DEGREE, FOOT, POUND_FORCE

PSF = POUND_FORCE / FOOT**2
OWN = "aero/aeromatch/"
COEFFICIENT = "aero/coefficient/"
# From the lift of the last step and the present dynamic pressure.
LIFT_SQUARED = "aero/cl-squared"
ENGINE = re.compile(r"engine([1-9]\d*)\.(throttle|thrust)$")
# SI value of the unit in which JSBSim computes. The unit of all other variables is SI.
UNIT = {
    "V": FOOT,
    "h": FOOT,
    "qbar": PSF,
    "thrust": POUND_FORCE,
}
# Variable: its property, in the unit of `jsbsim_unit`.
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

# Reduced rate: the properties whose product it is.
REGRESSOR = {
    "phat": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "qhat": ("aero/ci2vel", "velocities/q-aero-rad_sec"),
    "rhat": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "alphadothat": ("aero/ci2vel", "aero/alphadot-rad_sec"),
    "betadothat": ("aero/bi2vel", "aero/betadot-rad_sec"),
}

# The airspeed has a lower limit, so that a reduced rate stays finite at rest.
_REDUCED = (
    "<quotient>"
    "<product><property>{rate}</property><property>metrics/{length}-ft</property></product>"
    "<product><value>2</value><max><property>velocities/vt-fps</property><value>0.001</value></max>"
    "</product></quotient>"
)
# Variable that JSBSim does not have: the function that gives it in SI. The export fills the fields
# in braces from the aircraft.
FUNCTION = {
    "delta_a": "<product><value>0.5</value>"
    "<difference><property>fcs/right-aileron-pos-rad</property>"
    "<property>fcs/left-aileron-pos-rad</property></difference></product>",
    "h_agl": f"<product><value>{FOOT!r}</value>"
    "<property>aero/h_b-mac-ft</property><property>metrics/bw-ft</property></product>",
    "dnz": "<difference><property>accelerations/Nz</property><value>1</value></difference>",
    "x_cg": "<sum><value>{x_ref_mac!r}</value><product><value>{chords_per_inch!r}</value>"
    "<difference><property>inertia/cg-x-in</property>"
    "<property>metrics/aero-rp-x-in</property></difference></product></sum>",
    "CT": "<quotient><sum><value>0</value>{thrusts}</sum>"
    "<product><property>aero/qbar-psf</property>"
    "<property>metrics/Sw-sqft</property></product></quotient>",
    "phat": _REDUCED.format(rate="velocities/p-aero-rad_sec", length="bw"),
    "qhat": _REDUCED.format(rate="velocities/q-aero-rad_sec", length="cbarw"),
    "rhat": _REDUCED.format(rate="velocities/r-aero-rad_sec", length="bw"),
    "alphadothat": _REDUCED.format(rate="aero/alphadot-rad_sec", length="cbarw"),
    "betadothat": _REDUCED.format(rate="aero/betadot-rad_sec", length="bw"),
}


def jsbsim_unit(variable: str) -> float:
    """Return the unit in which JSBSim computes a variable, in SI.

    The unit of ``engine2.thrust`` is the unit of ``thrust``.
    """
    return UNIT.get(variable.rsplit(".", 1)[-1], 1.0)


def throttle_property(engine: int) -> str:
    """Return the property of an engine's lever; engine 1 is the first."""
    # JSBSim counts from 0, and the first engine has no index.
    return "fcs/throttle-cmd-norm" + (f"[{engine - 1}]" if engine > 1 else "")


def thrust_property(engine: int) -> str:
    """Return the property of an engine's thrust."""
    return f"fcs/engine{engine}-thrust-lbs"


class PropertyValue(NamedTuple):
    """The value of a property: `factor` times powers of symbols, each in the unit of `UNIT`."""

    factor: float
    symbols: Mapping[str, int]


def _multiple_of(symbol: str, factor: float = 1.0) -> PropertyValue:
    return PropertyValue(factor, {symbol: 1})


# All properties that the import accepts. Both ailerons move by the same angle, left = -delta_a.
PROPERTY: dict[str, PropertyValue] = {
    **{name: _multiple_of(variable) for variable, name in AXIS.items()},
    "aero/alpha-deg": _multiple_of("alpha", 1.0 / DEGREE),
    "aero/beta-deg": _multiple_of("beta", 1.0 / DEGREE),
    "attitude/roll-rad": _multiple_of("phi"),
    "position/h-sl-meters": _multiple_of("h", FOOT),
    "velocities/vtrue-fps": _multiple_of("V"),
    "velocities/p-rad_sec": _multiple_of("p"),
    "velocities/q-rad_sec": _multiple_of("q"),
    "velocities/r-rad_sec": _multiple_of("r"),
    "aero/alphadot-rad_sec": _multiple_of("alpha_dot"),
    "aero/alphadot-deg_sec": _multiple_of("alpha_dot", 1.0 / DEGREE),
    "aero/betadot-rad_sec": _multiple_of("beta_dot"),
    "aero/betadot-deg_sec": _multiple_of("beta_dot", 1.0 / DEGREE),
    "fcs/elevator-pos-deg": _multiple_of("delta_e", 1.0 / DEGREE),
    "fcs/rudder-pos-deg": _multiple_of("delta_r", 1.0 / DEGREE),
    "fcs/flap-pos-deg": _multiple_of("delta_f", 1.0 / DEGREE),
    "fcs/left-aileron-pos-rad": _multiple_of("delta_a", -1.0),
    "fcs/left-aileron-pos-deg": _multiple_of("delta_a", -1.0 / DEGREE),
    "fcs/right-aileron-pos-rad": _multiple_of("delta_a"),
    "fcs/right-aileron-pos-deg": _multiple_of("delta_a", 1.0 / DEGREE),
    "metrics/Sw-sqft": _multiple_of("S"),
    "metrics/cbarw-ft": _multiple_of("cbar"),
    "metrics/bw-ft": _multiple_of("b"),
    "aero/qbar-area": PropertyValue(1.0, {"qbar": 1, "S": 1}),
    # rho = 2 qbar / V^2, in slugs per cubic foot if pressure and speed are in pounds and feet
    "atmosphere/rho-slugs_ft3": PropertyValue(2.0, {"qbar": 1, "V": -2}),
    "aero/bi2vel": PropertyValue(0.5, {"b": 1, "V": -1}),
    "aero/ci2vel": PropertyValue(0.5, {"cbar": 1, "V": -1}),
    "aero/h_b-mac-ft": PropertyValue(1.0 / FOOT, {"h_agl": 1, "b": -1}),
    LIFT_SQUARED: PropertyValue(1.0, {"CL": 2}),
    **{OWN + variable: _multiple_of(variable) for variable in FUNCTION},
}

# Property: the property whose magnitude it is.
MAGNITUDE = {
    "aero/mag-beta-rad": "aero/beta-rad",
    "aero/mag-beta-deg": "aero/beta-deg",
    "fcs/mag-elevator-pos-rad": "fcs/elevator-pos-rad",
    "fcs/mag-left-aileron-pos-rad": "fcs/left-aileron-pos-rad",
    "fcs/mag-right-aileron-pos-rad": "fcs/right-aileron-pos-rad",
    "fcs/mag-rudder-pos-rad": "fcs/rudder-pos-rad",
}

# Deflection as a fraction: variable and sense. The user or the file states the angle at 1.
NORMALISED = {
    "fcs/elevator-pos-norm": ("delta_e", 1.0),
    "fcs/left-aileron-pos-norm": ("delta_a", -1.0),
    "fcs/right-aileron-pos-norm": ("delta_a", 1.0),
    "fcs/rudder-pos-norm": ("delta_r", 1.0),
    "fcs/flap-pos-norm": ("delta_f", 1.0),
}

# All values of a variable. Inside them a line or a magnitude is exactly a table.
RANGE = {
    "beta": (-math.pi / 2, math.pi / 2),
    **dict.fromkeys(
        ("alpha", "phi", "delta_e", "delta_a", "delta_r", "delta_f"), (-math.pi, math.pi)
    ),
    "gear": (0.0, 1.0),
    "speedbrake": (0.0, 1.0),
}


def variable_range(variable: str) -> tuple[float, float] | None:
    """Return all values of a variable, or None if they are not limited."""
    # A fraction of JSBSim is within -1 ... 1.
    if variable.startswith(DEVICE) and variable.endswith("_norm.setting"):
        return -1.0, 1.0
    return RANGE.get(variable)


# Values of the attribute ``lookup``, from the last dimension of a table backwards.
_LOOKUP = ("column", "row", "table", "axis4")


def factor_elements(leaf: xr.Dataset, native: bool) -> list[ET.Element]:
    """Return regressors and tables of a term as elements of a product.

    `native` is that of `table_element`.
    """
    regressors = list_regressors(leaf)
    factors: list[ET.Element] = []
    if regressors == ("CL", "CL"):
        factors.append(_text_element("property", LIFT_SQUARED))
        regressors = ()
    for regressor in regressors:
        for name in REGRESSOR.get(regressor) or (property_of(regressor),):
            factors.append(_text_element("property", name))
        # The term is in SI, so the unit of JSBSim is a factor.
        if jsbsim_unit(regressor) != 1.0:
            factors.append(_text_element("value", repr(jsbsim_unit(regressor))))
    for name in ("value", "K1", "K2"):
        if name in leaf:
            factors.append(table_element(leaf[name], native))
    return factors


def property_of(variable: str) -> str:
    """Return the property that holds a variable, in the unit of `jsbsim_unit`."""
    engine = ENGINE.match(variable)
    if engine is None:
        return AXIS.get(variable, OWN + variable)
    number = int(engine[1])
    return throttle_property(number) if engine[2] == "throttle" else thrust_property(number)


def table_element(values: xr.DataArray, native: bool) -> ET.Element:
    """Return a table of 0 to 4 axes as an element of a function.

    Parameters
    ----------
    values : DataArray
        The nodes; coordinates in SI.
    native : bool
        Whether four axes become a table of JSBSim 1.3.1.  Else they become tables of three axes,
        interpolated over the first axis.
    """
    if values.ndim == 0:
        return _text_element("value", repr(float(values)))
    axes = [str(axis) for axis in values.dims]
    points = [_axis_points(values, axis) for axis in axes]
    if values.ndim == 4 and not native:
        return _interpolation_element(values, points[0])
    element = ET.Element("table")
    if values.ndim == 1:
        element.append(_text_element("independentVar", property_of(axes[0]), lookup="row"))
        _write_table_data(element, _row_lines(points[0], values.values[:, None]))
        return element
    for axis, lookup in zip(reversed(axes), _LOOKUP, strict=False):
        element.append(_text_element("independentVar", property_of(axis), lookup=lookup))
    _write_blocks(element, values.values, points)
    return element


def extend_linearly(leaf: xr.Dataset, reach: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """Return a term with constant ends; a linear continuation becomes breakpoints up to `reach`."""
    if leaf.attrs.get("outside", "hold") == "hold":
        return leaf
    tables = {name: leaf[name] for name in ("value", "K1", "K2") if name in leaf}
    for name, values in tables.items():
        for axis in map(str, values.dims):
            tables[name] = _extend_axis(tables[name], axis, *reach[axis])
    return xr.Dataset(tables, attrs={**leaf.attrs, "outside": "hold"})


def _extend_axis(values: xr.DataArray, axis: str, low: float, high: float) -> xr.DataArray:
    points = values[axis].values
    ends = [end for end in (low, high) if end < points[0] or end > points[-1]]
    if not ends:
        return values
    extended = np.union1d(points, ends)
    return values.interp({axis: extended}, kwargs={"fill_value": "extrapolate"})


def _axis_points(values: xr.DataArray, axis: str) -> np.ndarray:
    """Return the breakpoints of an axis in the unit of JSBSim."""
    points = values[axis].values / jsbsim_unit(axis)
    # The division may round two close breakpoints to the same number.
    if (np.diff(points) <= 0).any():
        raise SchemaError(
            "JSBSim table",
            [f"breakpoints of {axis} fall together in the unit of JSBSim; regrid the term"],
        )
    return points


def _write_blocks(parent: ET.Element, values: np.ndarray, points: list[np.ndarray]) -> None:
    """Write a table of two to four axes as nested blocks of rows and columns."""
    if values.ndim == 2:
        _write_table_data(parent, _table_lines(points[0], points[1], values))
        return
    for point, block in zip(points[0], values, strict=True):
        inner = ET.SubElement(parent, "tableData", breakPoint=repr(float(point)))
        if block.ndim > 2:
            _write_blocks(inner, block, points[1:])
        else:
            inner.text = _block_text(_table_lines(points[1], points[2], block))


def _interpolation_element(values: xr.DataArray, points: np.ndarray) -> ET.Element:
    """Return an interpolation over the first axis between tables of the other axes."""
    element = ET.Element("interpolate1d")
    element.append(_text_element("property", property_of(str(values.dims[0]))))
    for index, point in enumerate(points):
        element.append(_text_element("value", repr(float(point))))
        element.append(table_element(values[index], native=False))
    return element


def _table_lines(rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> list[str]:
    """Return a line of column breakpoints, then a line for each row."""
    return [_number_line(columns), *_row_lines(rows, values)]


def _row_lines(points: np.ndarray, values: np.ndarray) -> list[str]:
    """Return lines of a row breakpoint and the values of the row."""
    return [_number_line((point, *row)) for point, row in zip(points, values, strict=True)]


def _number_line(numbers: np.ndarray | tuple[Any, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _write_table_data(parent: ET.Element, lines: list[str]) -> None:
    ET.SubElement(parent, "tableData").text = _block_text(lines)


def _block_text(lines: list[str]) -> str:
    return "\n" + "\n".join(lines) + "\n"


def _text_element(tag: str, text: str, **attributes: str) -> ET.Element:
    element = ET.Element(tag, attributes)
    element.text = text
    return element


_ENDS = (-1.0, 1.0)  # domain and range of JSBSim if a file states none
_SAME = 1e-6  # relative difference of limits written with seven digits


def stated_travel(control: Element) -> dict[str, float]:
    """Return the angle at which a position is 1, by variable, from a ``<flight_control>``. [rad]"""
    travel: dict[str, float] = {}
    for element in control.walk():
        if element.tag != "aerosurface_scale":
            continue
        scaling = _scaling_to_fraction(element)
        if scaling is not None:
            variable, angle = scaling
            travel.setdefault(variable, angle)
    return travel


def _scaling_to_fraction(scale: Element) -> tuple[str, float] | None:
    """Return variable and angle at 1 of a scaling to a fraction; None for any other scaling."""
    output, source, centred = (scale.first(tag) for tag in ("output", "input", "zero_centered"))
    if output is None or source is None:
        return None
    if output.text not in NORMALISED or source.text not in PROPERTY:
        return None
    variable, _ = NORMALISED[output.text]
    if PROPERTY[source.text].symbols != {variable: 1}:
        return None
    # A scaling that is not centred must still map zero to zero.
    is_centred = centred is None or centred.text in ("true", "1")
    if not is_centred and not _maps_zero_to_zero(scale):
        return None
    gain = scale.first("gain")
    # Input per output on either side of zero. Both must agree.
    slopes = []
    for x, y in zip(_scale_ends(scale, "domain"), _scale_ends(scale, "range"), strict=True):
        if x != 0.0 and y != 0.0:
            slopes.append(x / (y * (1.0 if gain is None else gain.number)))
    if not slopes or max(slopes) - min(slopes) > _SAME * abs(slopes[0]) or slopes[0] <= 0.0:
        return None
    return variable, slopes[0] / abs(PROPERTY[source.text].factor)


def _maps_zero_to_zero(scale: Element) -> bool:
    (low, high), (bottom, top) = _scale_ends(scale, "domain"), _scale_ends(scale, "range")
    return bottom * high == top * low


def _scale_ends(scale: Element, tag: str) -> tuple[float, float]:
    pair = scale.first(tag)
    if pair is None:
        return _ENDS
    low, high = pair.first("min"), pair.first("max")
    try:
        return (0.0 if low is None else low.number), (0.0 if high is None else high.number)
    except ParseError:
        # An end may be a property, whose value the file does not state.
        return 0.0, 0.0
