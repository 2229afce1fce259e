"""What an import of a JSBSim file remarks on: further inputs, and functions with the same name."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from aerodb.exchange.jsbsim.inputs import Inputs
from aerodb.exchange.jsbsim.properties import NORMALISED
from aerodb.exchange.spelling import spell
from aerodb.exchange.xml_reader import Element
from flightmech.terms import list_model_variables


def describe_devices(inputs: Inputs, leaves: Mapping[str, xr.Dataset]) -> str:
    """Return which properties became further inputs of the model; ``""`` if none did."""
    parts = []
    fractions: set[str] = set()
    for variable, name in _used_devices(inputs, leaves).items():
        parts.append(f"{name} is {variable}")
        if name in NORMALISED:
            fractions.add(NORMALISED[name][0])
    if not parts:
        return ""
    text = (
        f"properties that are not a quantity of the vocabulary became inputs, which are 0 unless "
        f"they are set: {', '.join(parts)}; name one that is meant with "
        f"{spell('names =', '--names')}"
    )
    used = _used_variables(leaves)
    for variable in sorted(fractions):
        text += f"; {_state_travel(variable)} makes the fraction {variable}"
        if variable in used:
            text += ", whose angle other terms have: without it each moves on its own, as in JSBSim"
    return text


def describe_repeated(aerodynamics: Element) -> str:
    """Return which functions the file defines more than once; ``""`` if none."""
    lines: dict[str, list[int]] = {}
    for element in aerodynamics.walk():
        name = element.attributes.get("name", "")
        if element.tag == "function" and name:
            lines.setdefault(name, []).append(element.line)
    parts = []
    for name, places in lines.items():
        if len(places) > 1:
            parts.append(f"{name} is defined twice, in lines {', '.join(map(str, places))}")
    if not parts:
        return ""
    return (
        f"{'; '.join(parts)}; JSBSim refuses such a file. Each is a term here, and a function that "
        f"uses the name has the last one; give each a name of its own"
    )


def _used_variables(leaves: Mapping[str, xr.Dataset]) -> set[str]:
    return set().union(*(list_model_variables(leaf) for leaf in leaves.values()))


def _used_devices(inputs: Inputs, leaves: Mapping[str, xr.Dataset]) -> dict[str, str]:
    """Return the properties of the further inputs in the terms, by input."""
    used = _used_variables(leaves)
    return {variable: name for variable, name in inputs.devices.items() if variable in used}


def _state_travel(variable: str) -> str:
    return spell(
        f"travel = {{{variable!r}: angle where it is 1}}", f"--travel '{variable}=ANGLE deg'"
    )
