"""Sections, reference quantities and moment reference point of a JSBSim aircraft file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.units import DEGREE, FOOT, INCH, POUND

LENGTH_UNITS = {"FT": FOOT, "M": 1.0, "IN": INCH}
MASS_UNITS = {"LBS": POUND, "KG": 1.0}
_AREA_UNITS = {"FT2": FOOT**2, "M2": 1.0}
_ANGLE_UNITS = {"RAD": 1.0, "DEG": DEGREE}
# Element of <metrics>: its property.
_TAIL = {
    "htailarea": "metrics/Sh-sqft",
    "htailarm": "metrics/lh-ft",
    "vtailarea": "metrics/Sv-sqft",
    "vtailarm": "metrics/lv-ft",
}


def read_section(root: Element, tag: str) -> Element:
    """Return a section of an aircraft file, or of the file in its folder that it refers to."""
    element = root.first(tag)
    if element is None:
        raise root.error(f"no <{tag}>", f"an aircraft file with <{tag}>")
    name = element.attributes.get("file", "")
    if not name:
        return element
    # JSBSim looks for systems in a folder of their own as well.
    folder = Path(root.file).resolve().parent
    for candidate in (
        folder / name,
        folder / f"{name}.xml",
        folder / "Systems" / name,
        folder / "Systems" / f"{name}.xml",
    ):
        # A hostile file must not reach files outside its folder.
        if candidate.is_file() and candidate.resolve().is_relative_to(folder):
            section = read_xml(candidate)
            if section.tag != tag:
                raise section.error(
                    f"<{section.tag}>",
                    f"<{tag}>, which {Path(root.file).name} refers to in line {element.line}",
                )
            return section
    raise element.error(
        f"file {name!r}", f"a file in the folder of {Path(root.file).name}; put it there"
    )


def read_sizes(metrics: Element) -> dict[str, float]:
    """Return ``S``, ``cbar`` and ``b``. [m2, m, m]"""
    return {
        "S": _read_size(metrics, "wingarea", "FT2", units=_AREA_UNITS),
        "cbar": _read_size(metrics, "chord", "FT", units=LENGTH_UNITS),
        "b": _read_size(metrics, "wingspan", "FT", units=LENGTH_UNITS),
    }


def read_tail_sizes(metrics: Element) -> dict[str, float]:
    """Return the areas and arms of the tail by property. [ft2, ft]"""
    values = {}
    for tag, name in _TAIL.items():
        element = metrics.first(tag)
        if element is None:
            continue
        units, default = LENGTH_UNITS, "FT"
        if tag.endswith("area"):
            units, default = _AREA_UNITS, "FT2"
        values[name] = element.number * unit_of_element(element, default, units) / units[default]
    return values


def read_incidence(metrics: Element) -> float:
    """Return the incidence of the wing, zero if the file does not state it. [rad]"""
    element = metrics.first("wing_incidence")
    if element is None:
        return 0.0
    return element.number * unit_of_element(element, "RAD", _ANGLE_UNITS)


def _read_size(parent: Element, tag: str, default: str, units: Mapping[str, float]) -> float:
    element = parent.first(tag)
    if element is None:
        raise parent.error(
            f"<{parent.tag}> without <{tag}>", f"<{tag}> with a unit, {' or '.join(units)}"
        )
    if element.number <= 0.0:
        raise element.error(f"<{tag}> {element.number:g}", "a positive number")
    return element.number * unit_of_element(element, default, units)


def unit_of_element(element: Element, default: str, units: Mapping[str, float]) -> float:
    """Return the SI value of the unit of an element, one of `units`."""
    name = element.attributes.get("unit", default)
    if name not in units:
        raise element.error(f"unit {name!r} of <{element.tag}>", f"one of {', '.join(units)}")
    return units[name]


def read_reference(metrics: Element) -> dict[str, float]:
    """Return the moment reference point from the drawing datum, body directions. [m]"""
    for location in metrics.all("location"):
        if location.attributes.get("name") != "AERORP":
            continue
        scale = unit_of_element(location, "IN", LENGTH_UNITS)
        reference = {}
        # Structural axes have x aft and z up, body axes x forward and z down.
        for axis, sign in zip("xyz", (-1.0, 1.0, -1.0), strict=True):
            element = location.first(axis)
            if element is None:
                raise location.error(f"AERORP without <{axis}>", "x, y and z")
            reference[f"{axis}_ref"] = sign * element.number * scale
        return reference
    raise metrics.error(
        "no location AERORP", "the moment reference point, <location name='AERORP'>"
    )
