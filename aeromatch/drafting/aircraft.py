"""Text of a drafted aircraft file: geometry of the cards, facts of the author, instruments."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from aeromatch.drafting.gaps import AircraftGap, channel_names, engine_numbers
from aeromatch.drafting.geometry import Geometry
from aeromatch.drafting.instruments import instrument_lines
from aeromatch.project.schemas import schema_lines
from flightmech.aircraft.controls import CONTROLS
from flightmech.names import lookup
from flightmech.quantities import finite_number
from flightmech.support.toml_quantities import UNFILLED
from flightmech.units import DEGREE

# What makes a thrust of the recorded speed of a propeller, for an author who knows its charts.
_PROPELLER = (
    "# The thrust follows from rpm and torque or manifold pressure by the charts of propeller and "
    "engine, which only you have",
    "# (how-to 'A propeller aircraft'). Keys, besides what turns it, such as [engine.piston]:",
    "# [engine.propeller]",
    "# diameter = ...",
    "# inertia = ...",
    "# rpm_high = ...",
    "# tables.CT_prop = { J = [...], blade_angle = [...], value = [[...], ...] }",
    "# tables.CP_prop = { J = [...], blade_angle = [...], value = [[...], ...] }",
)
MASS = {"mass": "2400 kg", "Ixx": "10826 kg m2", "Iyy": "8135 kg m2", "Izz": "15162 kg m2"}
"""Keys that neither cards nor records give, each with an example."""


@dataclass(frozen=True)
class StatedFacts:
    """Facts of the author in addition to listings and records; texts have their unit.

    Attributes
    ----------
    name : str
    values : dict of str to str
        ``mass Ixx Iyy Izz Ixz`` of the aircraft; ``temperature latitude runway_elevation`` of the
        records.
    cg : tuple of str (3,) or None
        Centre of gravity from the moment reference point.
    imu : tuple of str (3,) or None
        Position of the inertial unit from the moment reference point.
    """

    name: str = ""
    values: dict[str, str] = field(default_factory=dict)
    cg: tuple[str, str, str] | None = None
    imu: tuple[str, str, str] | None = None


def aircraft_text(
    geometry: Geometry, known: StatedFacts, records: Sequence[xr.DataTree]
) -> tuple[str, list[AircraftGap]]:
    """Return the text of an aircraft file, and the values that its author has to give or
    confirm.
    """
    gaps: list[AircraftGap] = []
    name = known.name or _title(geometry) or "aircraft"
    imu = [_value(text) for text in known.imu] if known.imu else None
    lines = [
        *schema_lines("aircraft"),
        "# Aircraft, drafted by `aeromatch init`.  Bare numbers are SI, texts carry their "
        "unit; positions in body axes (forward, right,",
        "# down) from the moment reference point, `reference` alone from the drawing datum.  "
        "Keys: `aeromatch schema`, page reference/project-keys of `./run docs`.",
        "",
        f"name = {json.dumps(name, ensure_ascii=False)}",
        *_reference_lines(geometry, gaps),
        *_mass_lines(known, gaps),
        *_engine_lines(geometry, records, gaps),
        *_travel_lines(records),
        *_hinge_lines(geometry),
        *instrument_lines(records, imu, gaps),
    ]
    return "\n".join(lines) + "\n", gaps


def _title(geometry: Geometry) -> str:
    return re.sub(r"\s+", " ", geometry.title).strip().title()


def _reference_lines(geometry: Geometry, gaps: list[AircraftGap]) -> list[str]:
    lines = []
    for key, text, unit in (
        ("S", "reference area", "m2"),
        ("cbar", "reference chord", "m"),
        ("b", "reference span", "m"),
    ):
        number = getattr(geometry, key)
        # The listings may lack a card with this reference.
        if number is None:
            remark = (
                f"{key} is not known: replace the {UNFILLED!r} in aircraft.toml, or give "
                f"listings or decks (--datcom)"
            )
            gaps.append(AircraftGap((key,), remark))
            value = json.dumps(UNFILLED)
        else:
            value = f"{number:.7g}"
        lines.append(f"{key} = {value}   # {text} [{unit}], of the DATCOM cards")
    if geometry.reference is not None:
        position = ", ".join(f"{x:.6g}" for x in geometry.reference)
        lines.append(
            f"reference = [{position}]   # moment reference point: XCG, ZCG of the cards [m]"
        )
    if geometry.x_ref_mac is not None:
        lines.append(
            f"x_ref_mac = {geometry.x_ref_mac:.4g}   # behind the leading edge of the wing's "
            f"mean chord, in chords; from the planform"
        )
    return lines


def _mass_lines(known: StatedFacts, gaps: list[AircraftGap]) -> list[str]:
    lines = ["", "# Mass and moments of inertia about the c.g., of the aircraft as flown."]
    for key, example in MASS.items():
        stated = known.values.get(key)
        if stated:
            lines.append(f"{key} = {_value(stated)}   # {lookup(key).long_name}")
            continue
        # A placeholder makes the project incomplete until the author replaces it.
        lines.append(
            f"{key} = {_value(UNFILLED)}   # {lookup(key).long_name}, such as {json.dumps(example)}"
        )
        text = f"{key} is not known: replace the {UNFILLED!r} in aircraft.toml"
        gaps.append(AircraftGap((key,), text))
    # Products of inertia are zero by default, so they need no placeholder.
    for key in ("Ixz", "Ixy", "Iyz"):
        if known.values.get(key):
            lines.append(f"{key} = {_value(known.values[key])}")
    comment = "   # from the moment reference point"
    if not known.cg:
        comment += "; CONFIRM: taken as there"
        text = "the c.g. is taken to be at the moment reference point: confirm cg in aircraft.toml"
        gaps.append(AircraftGap(("cg",), text))
    cg = known.cg or ("0.0", "0.0", "0.0")
    lines.append(f"cg = [{', '.join(map(_value, cg))}]{comment}")
    return lines


def _value(text: str) -> str:
    """Return a number unchanged and a text with a unit in quotes."""
    try:
        return repr(finite_number(text))
    except ValueError:
        return json.dumps(text)


def _engine_lines(
    geometry: Geometry, records: Sequence[xr.DataTree], gaps: list[AircraftGap]
) -> list[str]:
    channels = channel_names(records)
    numbers = engine_numbers(channels)
    # The cards or the records may show more engines.
    count = max(len(geometry.engines), max(numbers, default=0))
    lines: list[str] = []
    for index in range(count):
        position, source = (0.0, 0.0, 0.0), "CONFIRM: not known"
        if index < len(geometry.engines):
            position, source = geometry.engines[index], "from JETPWR or PROPWR of the cards"
        else:
            text = (
                f"the place of engine {index + 1} is not known: confirm position in aircraft.toml"
            )
            gaps.append(AircraftGap(("engine", index, "position"), text))
        coordinates = ", ".join(f"{x:.5g}" for x in position)
        lines += [
            "",
            "[[engine]]",
            f"position = [{coordinates}]   # where the thrust acts; {source}",
            "direction = [1.0, 0.0, 0.0]",
        ]
        if f"engine{index + 1}.rpm" in channels and f"engine{index + 1}.thrust" not in channels:
            lines += _PROPELLER
    return lines


def _travel_lines(records: Sequence[xr.DataTree]) -> list[str]:
    """Return the recorded travel of the controls as comments; it is less than the stops."""
    # Smallest and largest deflection over all records. [rad]
    travel: dict[str, tuple[float, float]] = {}
    for record in records:
        for node in record.children.values():
            for name in map(str, node.data_vars):
                if name in CONTROLS and lookup(name).units == "rad":
                    values = np.asarray(node.to_dataset()[name].values, float)
                    low, high = travel.get(name, (np.inf, -np.inf))
                    low = min(low, float(np.nanmin(values)))
                    travel[name] = low, max(high, float(np.nanmax(values)))
    if not travel:
        return []
    lines = ["", "# [limits]   # travel of the controls; recorded is:"]
    for name, (low, high) in travel.items():
        lines.append(f'# {name} = ["{low / DEGREE:.1f} deg", "{high / DEGREE:.1f} deg"]')
    return lines


def _hinge_lines(geometry: Geometry) -> list[str]:
    lines: list[str] = []
    for name, (area, chord) in geometry.surfaces.items():
        lines += [
            "",
            f"[control.{name}]   # behind the hinge, both sides, from the cards; used by "
            f"hinge moments",
            f"S_hinge = {area:.4g}",
            f"c_hinge = {chord:.4g}",
        ]
    return lines
