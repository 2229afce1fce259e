"""Meaning of the properties of a JSBSim file: model variables, constants and further inputs.

A property that is not a quantity of the vocabulary becomes an input of the model if it belongs to
the controls or systems of the aircraft: ``fcs/spoiler-pos-norm`` is
``device.fcs_spoiler_pos_norm.setting``.  A quantity of the flight itself, such as ``aero/Re``, does
not: as an input it would not follow the flight.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from aerodb.exchange.jsbsim.products import NotAProduct, OpaqueFactor, Product, Sum
from aerodb.exchange.jsbsim.properties import (
    NORMALISED,
    PROPERTY,
    PropertyValue,
    jsbsim_unit,
    throttle_property,
    thrust_property,
)
from aerodb.exchange.spelling import spell
from aerodb.exchange.xml_reader import Element
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.units import DEGREE, parse_unit

_MOST_ENGINES = 8
# First parts of the properties that JSBSim computes from the state of the flight.
_FLIGHT = (
    "accelerations",
    "aero",
    "atmosphere",
    "attitude",
    "forces",
    "ic",
    "inertia",
    "metrics",
    "moments",
    "position",
    "simulation",
    "velocities",
)
# The hysteresis of the stall is a state that the file sets, so it is an input here.
_STATES = ("aero/stall-hyst-norm",)
# Last words of the names of properties that have another unit than an angle or a pure number.
_UNIT = re.compile(
    r"[-_](lbs?|lbsft|lbs_ft|ft|ft2|ft3|sqft|fps|kts|mph|psf|psi|hp|rpm|in|inhg|slugs|slugs_ft3|"
    r"rad_sec|deg_sec|fpm|gph|pph|sec|meters|mps|kg|degf|degc|degr|ftlbps|volts|amps|watts)$",
    re.IGNORECASE,
)
_LONGEST_NAME = 39  # of a further input without its prefix; NAME_SIZE of the kernel
_NOT_IN_WORD = re.compile("[^A-Za-z0-9]+")
_INDEX = re.compile(r"\[0\]")


def _engine_properties() -> dict[str, str]:
    """Return the variables of lever and thrust by property."""
    variables = {"propulsion/engine/thrust-lbs": "engine1.thrust"}
    for i in range(1, _MOST_ENGINES + 1):
        variables[throttle_property(i)] = f"engine{i}.throttle"
        variables[thrust_property(i)] = f"engine{i}.thrust"
        # JSBSim counts the engines from 0.
        variables[f"propulsion/engine[{i - 1}]/thrust-lbs"] = f"engine{i}.thrust"
    return variables


_ENGINES = _engine_properties()


class Inputs:
    """What the properties of one file are in the model.

    Parameters
    ----------
    travel : mapping of str to float
        Deflection at which a normalised position is 1, by variable. [rad]
    names : mapping of str to str
        Variable by property, with sign and unit: ``{"fcs/posElev_rad": "delta_e [rad]"}``.
    constants : mapping of str to float
        Properties that are numbers.
    incidence : float
        Incidence of the wing, by which ``aero/alpha-wing-rad`` exceeds ``aero/alpha-rad``. [rad]

    Attributes
    ----------
    devices : dict of str to str
        Property of each further input that was used, by its name ``device.*``.
    """

    def __init__(
        self,
        travel: Mapping[str, float],
        names: Mapping[str, str],
        constants: Mapping[str, float],
        incidence: float = 0.0,
    ):
        self.travel, self.constants, self.incidence = travel, constants, incidence
        self.named = {name.strip(): _parse_name(name, text) for name, text in names.items()}
        self.devices: dict[str, str] = {}

    def value(self, name: str) -> PropertyValue | None:
        """Return a property as powers of symbols, or None if it is not of this form."""
        # The names of the caller come first.
        if name in self.named:
            return self.named[name]
        if name in PROPERTY:
            return PROPERTY[name]
        if name in _ENGINES:
            return PropertyValue(1.0, {_ENGINES[name]: 1})
        variable, sense = NORMALISED.get(name, ("", 1.0))
        if variable in self.travel:
            return PropertyValue(sense / self.travel[variable], {variable: 1})
        return None

    def derived(self, name: str) -> Sum | None:
        """Return a property that is a function of others as a sum; None for any other property."""
        if name == "aero/alpha-wing-rad":
            return [Product(symbols={"alpha": 1}), Product(self.incidence)]
        if name == "aero/alpha-wing-deg":
            angles = Product(1.0 / DEGREE, {"alpha": 1}), Product(self.incidence / DEGREE)
            return list(angles)
        if name in _PROJECTED:
            symbols, factors = _PROJECTED[name]
            return [Product(symbols=symbols, opaque=factors)]
        return None

    def device(self, name: str) -> PropertyValue:
        """Return a property as a further input of the model.

        Raises
        ------
        NotAProduct
            It is a quantity of the flight, or it has a unit.
        """
        if name.split("/")[0] in _FLIGHT and name not in _STATES:
            raise NotAProduct(
                f"{name} is a quantity of the flight that the model does not have; "
                + spell(
                    f"names = {{{name!r}: variable}} states which variable it is",
                    f"--names '{name}=VARIABLE' states which variable it is",
                )
            )
        if _UNIT.search(name):
            raise NotAProduct(
                f"{name} has a unit, and a further input is an angle or a pure number; "
                + spell(
                    f"names = {{{name!r}: 'device.NAME.setting'}} takes the number of the file",
                    f"--names '{name}=device.NAME.setting' takes the number of the file",
                )
            )
        # The first of several has an index or none.
        name = _INDEX.sub("", name)
        kind, factor = "setting", 1.0
        if name.endswith(("-rad", "_rad", "-deg", "_deg")):
            kind = "deflection"
            factor = 1.0 / DEGREE if name.endswith("deg") else 1.0
        variable = _device_name(name, kind)
        if self.devices.setdefault(variable, name) != name:
            raise NotAProduct(
                f"{name} and {self.devices[variable]} would both be {variable}; "
                + spell("name one with names =", "name one with --names")
            )
        return PropertyValue(factor, {variable: 1})


def _device_name(name: str, kind: str) -> str:
    """Return the input that a property becomes, ``device.fcs_spoiler_pos_norm.setting``."""
    # The kernel limits the length of a name, so the first parts of a long path are left out.
    parts = name.split("/")
    while parts:
        word = _NOT_IN_WORD.sub("_", "_".join(parts)).strip("_")
        if len(word) + 1 + len(kind) <= _LONGEST_NAME:
            return f"{DEVICE}{word}.{kind}"
        parts = parts[1:]
    raise NotAProduct(
        f"{name} is too long for the name of an input; "
        + spell(
            f"names = {{{name!r}: 'device.NAME.{kind}'}} gives a shorter one",
            f"--names '{name}=device.NAME.{kind}' gives a shorter one",
        )
    )


def _parse_name(name: str, text: str) -> PropertyValue:
    """Return the property that is ``-delta_a [deg]`` as a multiple of this variable."""
    quantity, bracket, unit = text.strip().partition("[")
    sense = -1.0 if quantity.startswith("-") else 1.0
    quantity, unit = quantity.lstrip("-").strip(), unit.strip(" ]")
    # The look-up raises UnknownName for a quantity that is not in the vocabulary.
    expected = lookup(quantity).units
    is_angle = "rad" in expected
    if not bracket:
        # The property may state its unit at its end, as those of JSBSim do.
        unit = name[-3:] if is_angle and name.endswith(("rad", "deg")) else ""
        if not unit and is_angle:
            raise SchemaError(
                spell("names", "--names"),
                [f"{name} is {quantity}, in which unit? write {quantity} [rad] or [deg]"],
            )
    if not unit:
        # Any other property is in the unit in which JSBSim computes the variable.
        return PropertyValue(sense, {quantity: 1})
    dimension, to_si, offset = parse_unit(unit)
    lacks_angle = is_angle and "rad" not in unit and "deg" not in unit
    if dimension != parse_unit(expected)[0] or offset or lacks_angle:
        raise SchemaError(
            spell("names", "--names"),
            [f"{name}: unit {unit!r}, where {quantity} needs one such as {expected}"],
        )
    return PropertyValue(sense * jsbsim_unit(quantity) / to_si, {quantity: 1})


def _cosine(variable: str, power: int = 1) -> OpaqueFactor:
    text = f"cos({variable})" + (f"^{power}" if power > 1 else "")
    return OpaqueFactor(text, frozenset((variable,)), lambda at: np.cos(at[variable]) ** power)


def _sine(variable: str) -> OpaqueFactor:
    return OpaqueFactor(f"sin({variable})", frozenset((variable,)), lambda at: np.sin(at[variable]))


# Components of the airspeed and pressures of its projections: powers of symbols, and functions. u =
# V cos(alpha) cos(beta), v = V sin(beta), w = V sin(alpha) cos(beta), qbarUW = rho (u^2 + w^2)/2
_PROJECTED: dict[str, tuple[dict[str, int], tuple[OpaqueFactor, ...]]] = {
    "velocities/u-aero-fps": ({"V": 1}, (_cosine("alpha"), _cosine("beta"))),
    "velocities/v-aero-fps": ({"V": 1}, (_sine("beta"),)),
    "velocities/w-aero-fps": ({"V": 1}, (_sine("alpha"), _cosine("beta"))),
    "aero/qbarUW-psf": ({"qbar": 1}, (_cosine("beta", 2),)),
}


def declared_constants(sections: Iterable[Element]) -> dict[str, float]:
    """Return the constants of a file: properties of the flight that it declares with a value.

    A declared property of the controls or systems is an input, which starts at this value.  A
    property that a component of the file sets is not a constant.
    """
    values: dict[str, float] = {}
    written: set[str] = set()
    for section in sections:
        for element in section.walk():
            if element.tag == "property" and "value" in element.attributes:
                _add_constant(element, values)
            elif element.tag == "output":
                written.add(element.text)
            elif element.tag in ("function", "fcs_function"):
                written.add(element.attributes.get("name", ""))
    return {name: value for name, value in values.items() if name not in written}


def _add_constant(element: Element, values: dict[str, float]) -> None:
    if element.text.split("/")[0] not in _FLIGHT:
        return
    try:
        values[element.text] = float(element.attributes["value"])
    except ValueError:
        raise element.error(
            f"value {element.attributes['value']!r} of {element.text}", "a number"
        ) from None
