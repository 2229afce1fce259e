"""A first aircraft file: geometry from the cards, noise of the instruments from the records, the
rest as stated or left to be filled in.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerodb.prior.roles import CaseRole, assign_roles
from aeromatch.project.editing import schema_lines
from datcom_io.arrays.conditions import control_surface
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import read_deck
from datcom_io.reading.reader import read
from flightmech.aircraft.controls import CONTROLS
from flightmech.names import lookup
from flightmech.support.toml_quantities import UNFILLED
from flightmech.units import DEGREE, to_si
from flighttest.reconstruction.quality.checks.samples import channel_table

_LENGTHS = {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"}
_ENOUGH_WORDS = 3  # of a CASEID card that make the name of an aircraft


@dataclass(frozen=True)
class Geometry:
    """Reference quantities and places from cards.

    Attributes
    ----------
    S, cbar, b : float or None
        Reference area, chord, span. [m2, m, m]
    reference : tuple of float (3,) or None
        Moment reference point from the drawing datum, body directions. [m]
    x_ref_mac : float or None
        Its place behind the leading edge of the mean chord of the wing, in chords. [1]
    engines : tuple of (3,)
        Where the thrust acts by JETPWR or PROPWR, from the moment reference point. [m]
    surfaces : dict of str to (S_hinge, c_hinge)
        Area behind the hinge and its mean chord, of the elevator and the aileron. [m2, m]
    flap : float or None
        Largest deflection of the flaps in the listings. [rad]
    title : str
        Of the first case.
    roles : tuple of Assignment
        What every case of the listings was taken for; empty without listings.
    places : dict of str to list of str
        By role, ``FILE`` or ``FILE:NUMBER`` with the path of the file.
    powered : bool
        Whether the clean pages are computed with power.
    """

    S: float | None = None
    cbar: float | None = None
    b: float | None = None
    reference: tuple[float, float, float] | None = None
    x_ref_mac: float | None = None
    engines: tuple[tuple[float, float, float], ...] = ()
    surfaces: dict[str, tuple[float, float]] = field(default_factory=dict)
    flap: float | None = None
    title: str = ""
    roles: tuple[CaseRole, ...] = ()
    places: dict[str, list[str]] = field(default_factory=dict)
    powered: bool = False


def geometry_of(listings: Sequence[Path], decks: Sequence[Path]) -> Geometry:
    """Return what listings, and decks where there are no listings, say.

    Raises
    ------
    ParseError
        A file is damaged, or none.
    SchemaError
        The listings belong to several aircraft.
    """
    read_in = {path: read(path) for path in listings}
    roles = tuple(assign_roles(read_in.values())) if read_in else ()
    owner = {id(case): path for path, listing in read_in.items() for case in listing.cases}
    lone = {path for path, listing in read_in.items() if len(listing.cases) == 1}
    places: dict[str, list[str]] = {}
    for item in roles:
        path = owner[id(item.case)]
        for role in item.roles:
            places.setdefault(role, []).append(
                str(path) if path in lone else f"{path}:{item.case.ordinal}"
            )
    clean = next((item.case for item in roles if "clean" in item.roles), None)
    cards = [case.deck for item in roles for case in [item.case]] + [
        deck for path in decks for deck in read_deck(path)
    ]
    main = (
        clean.deck
        if clean is not None
        else max(cards, key=lambda deck: len(deck.namelists), default=None)
    )
    if main is None:
        return Geometry()
    printed: dict[str, Any] = (
        {str(key): item for key, item in clean.to_datatree().attrs.items()}
        if clean is not None
        else {}
    )
    found = _references(main, printed)
    return Geometry(
        **found,
        engines=_engine_places(cards, main),
        surfaces=_surfaces(cards),
        flap=_flap(
            [item.case.deck for item in roles if {"flaps", "ground_flap"} & set(item.roles)]
        ),
        title=clean.name if clean is not None else main.caseid,
        roles=roles,
        places=places,
        powered=clean is not None
        and any(page.power != "off" for page in clean.pages if page.kind == "static"),
    )


def _references(deck: Deck, printed: dict[str, Any]) -> dict[str, Any]:
    """Return areas, lengths and the reference point; as printed, else as on the cards, else of the
    wing, as the program takes them.
    """
    length = _length(deck)
    wing = _planform(deck)
    S, cbar, b = (printed.get(name) for name in ("S", "cbar", "b"))
    card = {
        name: deck.value("OPTINS", variable)
        for name, variable in (("S", "SREF"), ("cbar", "CBARR"), ("b", "BLREF"))
    }
    S = S or (card["S"] * length**2 if card["S"] else wing.get("S"))
    cbar = cbar or (card["cbar"] * length if card["cbar"] else wing.get("cbar"))
    b = b or (card["b"] * length if card["b"] else wing.get("b"))
    x, z = deck.value("SYNTHS", "XCG"), deck.value("SYNTHS", "ZCG")
    if x is None:
        return {"S": S, "cbar": cbar, "b": b}
    at = x * length
    mac = (at - wing["leading_edge"]) / cbar if wing and cbar else None
    return {
        "S": S,
        "cbar": cbar,
        "b": b,
        "reference": (-at, 0.0, -(z or 0.0) * length + 0.0),
        "x_ref_mac": mac,
    }


def _length(deck: Deck) -> float:
    """Return the metres in one unit of length of a deck."""
    return float(to_si(1.0, _LENGTHS[deck.dim]))


def _planform(deck: Deck) -> dict[str, float]:
    """Return area, mean chord, span and leading edge of the mean chord of the wing from the drawing
    datum. [m]

    Notes
    -----
    Straight or cranked: chords are linear between root, break and tip; the mean chord is that of the integral of c^2.
    """
    names = ("CHRDR", "CHRDTP", "SSPN", "SAVSI", "CHSTAT")
    root, tip, half, sweep, station = (deck.value("WGPLNF", name) for name in names)
    apex = deck.value("SYNTHS", "XW")
    if root is None or tip is None or half is None or sweep is None or apex is None:
        return {}
    outer = deck.value("WGPLNF", "SSPNOP") or 0.0
    middle = deck.value("WGPLNF", "CHRDBP")
    y, c, sweeps = [0.0, half], [root, tip], [sweep]
    if outer > 0.0 and middle is not None:
        y, c, sweeps = (
            [0.0, half - outer, half],
            [root, middle, tip],
            [sweep, deck.value("WGPLNF", "SAVSO") or sweep],
        )
    edge = [apex]
    for k, angle in enumerate(sweeps):  # the sweep is that of the line at CHSTAT of the chord
        span = y[k + 1] - y[k]
        edge.append(
            edge[-1] + span * np.tan(np.radians(angle)) - (station or 0.0) * (c[k + 1] - c[k])
        )
    fine = np.linspace(0.0, half, 2001)
    chord, lead = np.interp(fine, y, c), np.interp(fine, y, edge)
    area = np.trapezoid(chord, fine)
    mean = float(np.trapezoid(chord**2, fine) / area)
    at = float(np.trapezoid(chord * lead, fine) / area)
    unit = _length(deck)
    return {
        "S": 2.0 * float(area) * unit**2,
        "cbar": mean * unit,
        "b": 2.0 * half * unit,
        "leading_edge": at * unit,
    }


def _engine_places(cards: Sequence[Deck], main: Deck) -> tuple[tuple[float, float, float], ...]:
    """Return where jets or propellers push, from the moment reference point."""
    names = {
        "JETPWR": ("NENGSJ", "JEALOC", "JELLOC", "JEVLOC"),
        "PROPWR": ("NENGSP", "PHALOC", "YP", "PHVLOC"),
    }
    for deck in cards:
        for namelist, (count, along, aside, up) in names.items():
            x, y, z = (deck.value(namelist, name) for name in (along, aside, up))
            if x is None:
                continue
            unit = _length(deck)
            x0, z0 = main.value("SYNTHS", "XCG") or 0.0, main.value("SYNTHS", "ZCG") or 0.0
            place = ((x0 - x) * unit, (y or 0.0) * unit, (z0 - (z or 0.0)) * unit)
            lone = round(deck.value(namelist, count) or 1.0) < 2
            return (
                (place,)
                if lone
                else ((place[0], -abs(place[1]), place[2]), (place[0], abs(place[1]), place[2]))
            )
    return ()


def _surfaces(cards: Sequence[Deck]) -> dict[str, tuple[float, float]]:
    """Return area and mean chord behind the hinge of elevator (SYMFLP on the tail) and ailerons
    (ASYFLP), both sides together.
    """
    found = {}
    for deck in cards:
        for namelist, name in (("SYMFLP", "delta_e"), ("ASYFLP", "delta_a")):
            values = [deck.value(namelist, key) for key in ("CHRDFI", "CHRDFO", "SPANFI", "SPANFO")]
            if (
                name in found
                or any(value is None for value in values)
                or (name == "delta_e" and not _on_tail(deck))
            ):
                continue
            inner, outer, start, end = (float(value) for value in values if value is not None)
            unit = _length(deck)
            found[name] = (inner + outer) * (end - start) * unit**2, 0.5 * (inner + outer) * unit
    return found


def _flap(decks: Sequence[Deck]) -> float | None:
    """Return the largest deflection of the flaps. [rad]"""
    angles = [
        angle
        for deck in decks
        for angle in deck.schedule("SYMFLP", "DELTA", "NDELTA")
        if np.isfinite(angle)
    ]
    return float(np.radians(max(angles))) if angles else None


def _on_tail(deck: Deck) -> bool:

    return "SYMFLP" in deck.namelists and control_surface(deck) == "tail"


MASS = {"mass": "2400 kg", "Ixx": "10826 kg m2", "Iyy": "8135 kg m2", "Izz": "15162 kg m2"}
"""Keys that neither cards nor records give, each with an example."""
# least noise per sample, and size of the constant error of an ordinary instrument, by unit and
# channel
_LEAST = {
    "rad s-1": 1e-4,
    "rad": 2e-4,
    "m s-2": 5e-3,
    "m s-1": 0.05,
    "Pa": 2.0,
    "K": 0.1,
    "m": 0.3,
    "1": 1e-4,
}
_BIAS = {
    "rad s-1": 0.2 * DEGREE,
    "rad": 0.5 * DEGREE,
    "m s-2": 0.2,
    "Pa": 100.0,
    "K": 2.0,
    "m": 1.0,
    "m s-1": 0.5,
    "1": 0.01,
}
_IMU = ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu")
_SPEEDS = ("q_c", "V_cas", "V", "mach")
_STEP = 1.0 / np.sqrt(12.0)  # standard deviation of rounding, in steps


@dataclass(frozen=True)
class StatedFacts:
    """What the author knows in addition to listings and records; texts carry their unit.

    Attributes
    ----------
    name : str
    values : dict of str to str
        ``mass Ixx Iyy Izz Ixz`` of the aircraft; ``temperature latitude runway_elevation`` of the
        records.
    cg : tuple of str (3,) or None
        Centre of gravity from the moment reference point.
    imu : tuple of str (3,) or None
        Place of the inertial unit from the moment reference point.
    """

    name: str = ""
    values: dict[str, str] = field(default_factory=dict)
    cg: tuple[str, str, str] | None = None
    imu: tuple[str, str, str] | None = None


def aircraft_text(
    geometry: Geometry, known: StatedFacts, records: Sequence[xr.DataTree]
) -> tuple[str, list[str]]:
    """Return the text of an aircraft file, and what its author has to give or confirm."""
    remarks: list[str] = []
    lines = [
        *schema_lines("aircraft"),
        "# Aircraft, drafted by `aeromatch init`.  Bare numbers are SI, texts carry their "
        "unit; positions in body axes (forward, right,",
        "# down) from the moment reference point, `reference` alone from the drawing datum.  "
        "Keys: docs/reference/project-keys.md",
        "",
        f"name = {json.dumps(known.name or _title(geometry) or 'aircraft', ensure_ascii=False)}",
    ]
    for key, about in (
        ("S", "reference area"),
        ("cbar", "reference chord"),
        ("b", "reference span"),
    ):
        value, unit = getattr(geometry, key), "m2" if key == "S" else "m"
        lines.append(
            f"{key} = {_known(key, value, remarks)}   # {about} [{unit}], of the DATCOM cards"
        )
    if geometry.reference is not None:
        place = ", ".join(f"{x:.6g}" for x in geometry.reference)
        lines.append(f"reference = [{place}]   # moment reference point: XCG, ZCG of the cards [m]")
    if geometry.x_ref_mac is not None:
        lines.append(
            f"x_ref_mac = {geometry.x_ref_mac:.4g}   # behind the leading edge of the wing's "
            f"mean chord, in chords; from the planform"
        )
    lines += ["", "# Mass and moments of inertia about the c.g., of the aircraft as flown."]
    for key, example in MASS.items():
        given = known.values.get(key)
        lines.append(
            f"{key} = {_value(given or UNFILLED)}   # "
            f"{lookup(key).long_name}{'' if given else f', such as {json.dumps(example)}'}"
        )
        if not given:
            remarks.append(f"{key} is not known: replace the {UNFILLED!r} in aircraft.toml")
    for key in ("Ixz", "Ixy", "Iyz"):
        if known.values.get(key):
            lines.append(f"{key} = {_value(known.values[key])}")
    cg = known.cg or ("0.0", "0.0", "0.0")
    lines.append(
        f"cg = [{', '.join(map(_value, cg))}]   # from the moment reference point"
        + ("" if known.cg else "; CONFIRM: taken as there")
    )
    if not known.cg:
        remarks.append(
            "the c.g. is taken to be at the moment reference point: confirm cg in aircraft.toml"
        )
    lines += _engines(geometry, records, remarks)
    lines += _limits(records)
    for name, (area, chord) in geometry.surfaces.items():
        lines += [
            "",
            f"[control.{name}]   # behind the hinge, both sides, from the cards; used by "
            f"hinge moments",
        ]
        lines += [f"S_hinge = {area:.4g}", f"c_hinge = {chord:.4g}"]
    return "\n".join([*lines, *_instruments(records, known, remarks)]) + "\n", remarks


def _title(geometry: Geometry) -> str:
    return re.sub(r"\s+", " ", geometry.title).strip().title()


def _known(key: str, value: float | None, remarks: list[str]) -> str:
    if value is None:
        remarks.append(
            f"{key} is not known: replace the {UNFILLED!r} in aircraft.toml, or give "
            f"listings or decks (--datcom)"
        )
        return json.dumps(UNFILLED)
    return f"{value:.7g}"


def _value(text: str) -> str:
    """Return a number as it is and a text with a unit in quotes."""
    try:
        return repr(float(text))
    except ValueError:
        return json.dumps(text)


def _engines(geometry: Geometry, records: Sequence[xr.DataTree], remarks: list[str]) -> list[str]:
    channels = {
        str(name)
        for record in records
        for node in record.children.values()
        for name in node.data_vars
    }
    numbers = sorted({int(name[6]) for name in channels if re.match(r"engine[1-9]\.", name)})
    count = max(len(geometry.engines), max(numbers, default=0))
    lines = []
    for number in range(1, count + 1):
        place = geometry.engines[number - 1] if number <= len(geometry.engines) else (0.0, 0.0, 0.0)
        given = number <= len(geometry.engines)
        lines += [
            "",
            "[[engine]]",
            f"position = [{', '.join(f'{x:.5g}' for x in place)}]   # {_source(given)}",
            "direction = [1.0, 0.0, 0.0]",
        ]
        if not given:
            remarks.append(
                f"the place of engine {number} is not known: confirm position in aircraft.toml"
            )
    if count and not any(name.endswith(".thrust") for name in channels):
        remarks.append(
            "no thrust is recorded: give each [[engine]] a deck or a table of thrust, else "
            "the coefficients hold the thrust"
        )
    return lines


def _source(given: bool) -> str:
    return (
        "where the thrust acts; from JETPWR or PROPWR of the cards"
        if given
        else "where the thrust acts; CONFIRM: not known"
    )


def _limits(records: Sequence[xr.DataTree]) -> list[str]:
    """Return the travel of the controls as comments: what is recorded is less than the stops."""
    seen: dict[str, tuple[float, float]] = {}
    for record in records:
        for node in record.children.values():
            for name in map(str, node.data_vars):
                if name in CONTROLS and lookup(name).units == "rad":
                    x = np.asarray(node.to_dataset()[name].values, float)
                    low, high = seen.get(name, (np.inf, -np.inf))
                    seen[name] = min(low, float(np.nanmin(x))), max(high, float(np.nanmax(x)))
    if not seen:
        return []
    shown = [
        f'# {name} = ["{low / DEGREE:.1f} deg", "{high / DEGREE:.1f} deg"]'
        for name, (low, high) in seen.items()
    ]
    return ["", "# [limits]   # travel of the controls; recorded is:", *shown]


def _instruments(
    records: Sequence[xr.DataTree], known: StatedFacts, remarks: list[str]
) -> list[str]:
    noise = noise_by_channel(records)
    if not noise:
        return []
    lines = [
        "",
        "# Instruments: noise is white noise per sample, estimated from the records and "
        "never below that of ordinary instruments;",
    ]
    lines += [
        "# bias_sigma is one standard error of the constant error of ordinary instruments: "
        "write what the data sheets state."
    ]
    imu = [name for name in _IMU if name in noise]
    if imu:
        place = known.imu or ("0.0", "0.0", "0.0")
        lines += ["", "[instruments.imu]"]
        lines.append(
            f"position = [{', '.join(map(_value, place))}]"
            + ("" if known.imu else "   # CONFIRM: taken as at the c.g.")
        )
        lines += _spec(noise, imu)
        if not known.imu:
            remarks.append(
                "the place of the inertial unit is not known: confirm position of "
                "[instruments.imu] in aircraft.toml"
            )
    vanes = [name for name in ("alpha_vane", "beta_vane") if name in noise]
    if vanes:
        factors = ", ".join(f"{name} = [1.0, 0.1]" for name in vanes)
        lines += [
            "",
            "[instruments.vanes]",
            "position = [0.0, 0.0, 0.0]   # CONFIRM: place of the vanes",
            *_spec(noise, vanes),
        ]
        lines += [
            f"factor = {{ {factors} }}   # upwash: mean and standard error",
            "lag = [0.05, 0.03]",
        ]
        remarks.append(
            "the place of the vanes is not known: confirm position of [instruments.vanes] in "
            "aircraft.toml"
        )
    return lines + _air_data(noise) + _satellite(noise)


def _air_data(noise: Mapping[str, float]) -> list[str]:
    shown = next((name for name in _SPEEDS if name in noise), "")
    pressure = noise.get("p_static") or (
        12.0 * noise["h_baro"] if "h_baro" in noise else None
    )  # 12 Pa in a metre near the ground
    found = {
        **({shown: noise[shown]} if shown else {}),
        **({"p_static": max(pressure, _LEAST["Pa"])} if pressure else {}),
    }
    if "temperature" in noise:
        found["temperature"] = noise["temperature"]
    if not found:
        return []
    lines = [
        "",
        "[instruments.air_data]",
        *_spec(found, list(found), [name for name in found if name != shown or shown == "q_c"]),
    ]
    if shown == "q_c":
        lines.append(
            "static_error = [0.0, 0.03]   # static-pressure error over impact pressure: mean "
            "and standard error"
        )
    elif shown:
        lines.append(
            f"factor = {{ {shown} = [1.0, 0.03] }}   # scale of the airspeed: mean and "
            f"standard error"
        )
    return [*lines, "delay = [0.1, 0.1]   # latency [s]: mean and standard error"]


def _satellite(noise: Mapping[str, float]) -> list[str]:
    names = [name for name in ("vn", "ve", "vd", "h_gps") if name in noise]
    return (
        ["", "[instruments.gps]", *_spec(noise, names, []), "delay = [0.15, 0.1]"] if names else []
    )


def _spec(
    noise: Mapping[str, float], names: Sequence[str], biased: Sequence[str] | None = None
) -> list[str]:
    shown = ", ".join(f"{name} = {noise[name]:.2g}" for name in names)
    bias = ", ".join(
        f"{name} = {_BIAS[lookup(name).units]:.2g}"
        for name in (names if biased is None else biased)
    )
    return [f"noise = {{ {shown} }}", *([f"bias_sigma = {{ {bias} }}"] if bias else [])]


def noise_by_channel(records: Sequence[xr.DataTree]) -> dict[str, float]:
    """Return one sigma of the noise of every channel: white noise, or rounding where that is
    larger, the median of the records. [SI]
    """
    found: dict[str, list[float]] = {}
    for record in records:
        for row in channel_table(record).to_dict("records"):
            sizes: list[Any] = [
                row["noise"],
                _STEP * row["resolution"] if row["repeated"] > 0.05 else np.nan,
                _LEAST.get(row["units"], 0.0),
            ]
            found.setdefault(row["channel"], []).append(float(np.nanmax(sizes)))
    return {name: float(np.median(sizes)) for name, sizes in found.items()}
