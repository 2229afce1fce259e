"""Thin surfaces, body and controls of an aeroplane, from the cards of DATCOM decks. SI and radians.

Axes of the drawing: x aft, y right, z up, from the drawing datum of the deck.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from aerodb.estimators.coefficient_set import EstimateReference
from aerodb.estimators.vortex_lattice.sections import read_mean_line
from datcom_io.decks.cards import Namelist
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import DeckFile
from datcom_io.decks.device_fit import IS_FLAP, weigh_device_on_tail
from datcom_io.decks.planforms import measure_main_wing
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.units import DEGREE, FOOT, INCH

LENGTHS = {"FT": FOOT, "IN": INCH, "M": 1.0, "CM": 0.01}
_SURFACES = {
    "WGPLNF": ("wing", "XW", "ZW", "ALIW"),
    "HTPLNF": ("tail", "XH", "ZH", "ALIH"),
    "VTPLNF": ("fin", "XV", "ZV", ""),
    "VFPLNF": ("ventral fin", "XVF", "ZVF", ""),
}
_AILERON, _DIFFERENTIAL_TAIL = 4, 5  # STYPE of ASYFLP
_WHOLE_CHORD = 0.999  # share of the chord from which a control is the whole surface


@dataclass(frozen=True)
class HingedPart(ShortText):
    """A control on a surface.

    Attributes
    ----------
    control : str
        ``delta_e delta_a delta_r delta_f``.
    start, end : float
        Stations along the span of the surface. [m]
    chords : tuple of float
        Share of the local chord behind the hinge at `start` and `end`.
    """

    control: str
    start: float
    end: float
    chords: tuple[float, float]


@dataclass(frozen=True)
class ThinSurface(ShortText):
    """One surface: stations along its span from the root, in the plane of symmetry, to the tip.

    Attributes
    ----------
    name : str
        ``wing tail fin`` or ``ventral fin``.
    span : array (station,)
        Length along the span. [m]
    x, y, z : array (station,)
        Leading edge in the axes of the drawing. [m]
    chord : array (station,)
        [m]
    twist : array (station,)
        Incidence of the chord, positive nose up. [rad]
    mean_line : array
        At the stations of `aerodb.estimators.vortex_lattice.sections.STATIONS`. [chord]
    is_mirrored : bool
        Whether the left side has the same surface.
    controls : tuple of HingedPart
    """

    name: str
    span: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    chord: np.ndarray
    twist: np.ndarray
    mean_line: np.ndarray
    is_mirrored: bool
    controls: tuple[HingedPart, ...] = ()


@dataclass(frozen=True)
class ThinSurfaceModel(ShortText):
    """An aeroplane for a thin-surface method.

    Attributes
    ----------
    title : str
    reference : EstimateReference
    surfaces : tuple of ThinSurface
    body : array (3, station) or None
        Station x, height z of its centre line, and radius of the circle of equal area. [m]
    machs, alphas : tuple of float
        Conditions of the deck. [1, rad]
    remarks : tuple of str
        What the deck has and the model does not.
    """

    title: str
    reference: EstimateReference
    surfaces: tuple[ThinSurface, ...]
    body: np.ndarray | None
    machs: tuple[float, ...]
    alphas: tuple[float, ...]
    remarks: tuple[str, ...] = ()


def model_of_decks(
    decks: Sequence[DeckFile], rudder: tuple[float, float, float] | None = None
) -> ThinSurfaceModel:
    """Return the model of an aeroplane from its decks.

    Parameters
    ----------
    decks : sequence of DeckFile
        Every case of every deck gives its device; the case with the most surfaces gives the rest.
    rudder : tuple of float, optional
        Share of the chord behind the hinge, and start and end as shares of the span of the fin.
        DATCOM has no card for it.

    Raises
    ------
    SchemaError
        No wing, no reference quantities, or two decks that are not of one aeroplane.
    """
    cases = list(chain.from_iterable(decks))
    if not cases:
        raise SchemaError("deck", ["no case; give an input deck with WGPLNF"])
    # The case with the most surfaces is the aeroplane; the others add devices.
    base = max(cases, key=_count_surfaces)
    unit = LENGTHS[base.dim]
    _require_one_aeroplane(cases, base)
    surfaces, remarks = [], []
    parts = _find_devices(cases)
    for namelist, (name, *_) in _SURFACES.items():
        if namelist not in base.namelists:
            continue
        controls = [part for owner, part in parts if owner == namelist]
        if namelist == "VTPLNF" and rudder is not None:
            # DATCOM has no card for a rudder, so the user states it as shares of the fin.
            share, start, end = rudder
            half = (base.value(namelist, "SSPN") or 0.0) * unit
            controls.append(HingedPart("delta_r", start * half, end * half, (share, share)))
        surface, remark = _make_surface(base, namelist, tuple(controls), unit)
        surfaces.append(surface)
        if remark:
            remarks.append(f"{name}: {remark}")
    if "TVTPAN" in base.namelists:
        remarks.append("the vertical panels of TVTPAN are not modelled")
    if rudder is None and "VTPLNF" in base.namelists:
        remarks.append("no rudder: DATCOM has no card for it; state it to have its derivatives")
    scale = base.value("SYNTHS", "SCALE") or 1.0
    if scale != 1.0:
        remarks.append(f"SCALE={scale:g} is not applied: the model has the size of the cards")
    angles = base.schedule("FLTCON", "ALSCHD", "NALPHA")
    machs = base.schedule("FLTCON", "MACH", "NMACH")
    return ThinSurfaceModel(
        title=base.caseid.strip() or decks[0].file,
        reference=_read_reference(base, unit),
        surfaces=tuple(surfaces),
        body=_read_body(base, unit),
        machs=tuple(machs),
        alphas=tuple(alpha * DEGREE for alpha in angles),
        remarks=tuple(remarks),
    )


def _count_surfaces(case: Deck) -> int:
    return sum(name in case.namelists for name in (*_SURFACES, "BODY"))


def _require_one_aeroplane(cases: Iterable[Deck], base: Deck) -> None:
    """Raise unless the cases have the same wing, unit and moment centre."""
    problems = []
    if "WGPLNF" not in base.namelists:
        problems.append("no wing; give a deck with WGPLNF")
    for case in cases:
        for namelist, names in (
            ("WGPLNF", ("CHRDR", "CHRDTP", "SSPN", "SAVSI")),
            ("SYNTHS", ("XCG", "ZCG", "XW", "ZW")),
        ):
            for name in names:
                mine, its = base.value(namelist, name), case.value(namelist, name)
                if namelist in case.namelists and (mine, base.dim) != (its, case.dim):
                    problems.append(
                        f"{namelist} {name} is {its} {case.dim} in {case.caseid.strip()!r} and "
                        f"{mine} {base.dim} in {base.caseid.strip()!r}; give decks of one aeroplane"
                    )
    if problems:
        raise SchemaError("deck", problems)


def _read_reference(deck: Deck, unit: float) -> EstimateReference:
    """Return the reference quantities; those that OPTINS leaves out are of the main wing."""
    wing = measure_main_wing(deck)
    if wing is None:
        raise SchemaError("deck", ["the wing lacks CHRDR, CHRDTP, SSPN, SAVSI; complete WGPLNF"])
    S = deck.value("OPTINS", "SREF") or wing.area
    cbar = deck.value("OPTINS", "CBARR") or wing.mean_chord
    b = deck.value("OPTINS", "BLREF") or wing.span
    x = deck.value("SYNTHS", "XCG") or 0.0
    z = deck.value("SYNTHS", "ZCG") or 0.0
    return EstimateReference(S, cbar, b, x, z=z).in_units(unit)


def _make_surface(
    deck: Deck, namelist: str, controls: tuple[HingedPart, ...], unit: float
) -> tuple[ThinSurface, str]:
    """Return a surface with a station at each break and each end of a control, and a remark."""
    name, x_name, z_name, incidence_name = _SURFACES[namelist]

    def number(key: str, default: float = 0.0) -> float:
        value = deck.value(namelist, key)
        return default if value is None else value

    half = number("SSPN") * unit
    if not half > 0.0:
        raise SchemaError("deck", [f"{namelist} has no SSPN; give the semispan"])
    outer = number("SSPNOP") * unit
    middle = deck.value(namelist, "CHRDBP")
    y, chords, sweeps = [0.0, half], [number("CHRDR"), number("CHRDTP")], [number("SAVSI")]
    if 0.0 < outer < half and middle is not None:
        y, chords = [0.0, half - outer, half], [chords[0], middle, chords[1]]
        sweeps.append(number("SAVSO", sweeps[0]))
    # The sweep is that of the line at the share CHSTAT of the chord.
    edge = [0.0]
    for k, angle in enumerate(sweeps):
        run = np.tan(angle * DEGREE) * (y[k + 1] - y[k])
        edge.append(edge[-1] + run - number("CHSTAT") * unit * (chords[k + 1] - chords[k]))
    # The dihedral changes at the distance SSPNDD from the tip.
    outer_dihedral = number("SSPNDD") * unit
    dihedral_break = half
    if 0.0 < outer_dihedral < half:
        dihedral_break = half - outer_dihedral
    ends = chain.from_iterable((part.start, part.end) for part in controls)
    stations = np.unique([*y, dihedral_break, *(min(max(end, 0.0), half) for end in ends)])
    stations = stations[np.concatenate([[True], np.diff(stations) > 1e-6 * half])]
    x0 = (deck.value("SYNTHS", x_name) or 0.0) * unit
    z0 = (deck.value("SYNTHS", z_name) or 0.0) * unit
    letter = "F" if namelist == "VFPLNF" else namelist[0]
    line, remark = read_mean_line(deck, letter)
    surface = ThinSurface(
        name=name,
        span=stations,
        x=x0 + np.interp(stations, y, edge),
        y=stations,
        z=np.full_like(stations, z0),
        chord=np.interp(stations, y, chords) * unit,
        twist=np.zeros_like(stations),
        mean_line=line,
        is_mirrored=True,
        controls=controls,
    )
    if namelist in ("VTPLNF", "VFPLNF"):
        # The span of a fin is upright. Two fins stand at YV of both sides, a single one has YV 0.
        side, sense = ("YF", -1.0) if namelist == "VFPLNF" else ("YV", 1.0)
        aside = (deck.value("SYNTHS", side) or 0.0) * unit
        upright = replace(surface, y=np.full_like(stations, aside), z=z0 + sense * stations)
        return replace(upright, is_mirrored=aside > 0.0), remark
    inner_slope, outer_slope = (np.tan(number(key) * DEGREE) for key in ("DHDADI", "DHDADO"))
    rise = inner_slope * stations
    rise += (outer_slope - inner_slope) * np.maximum(stations - dihedral_break, 0.0)
    incidence = deck.value("SYNTHS", incidence_name) or 0.0
    twist = (incidence + number("TWISTA") * stations / half) * DEGREE
    return replace(surface, z=z0 + rise, twist=twist), remark


def _find_devices(cases: Iterable[Deck]) -> list[tuple[str, HingedPart]]:
    """Return the controls of all cases with their surface, one for each control."""
    found: dict[str, tuple[str, HingedPart]] = {}
    for case in cases:
        unit = LENGTHS[case.dim]
        for item in case.items:
            if not isinstance(item, Namelist) or item.name not in ("SYMFLP", "ASYFLP"):
                continue
            values = {}
            for assignment in item.assignments:
                if assignment.values:
                    values[assignment.variable] = float(assignment.values[0] or 0.0)
            place = _place_device(case, item.name, values)
            if place is None:
                continue
            namelist, control = place
            part = _make_part(case, namelist, control, values, unit)
            if part is not None:
                found.setdefault(control, (namelist, part))
        # A stabilizer that moves as a whole is the elevator of a deck with HINAX.
        if case.value("SYNTHS", "HINAX") is not None and "HTPLNF" in case.namelists:
            half = (case.value("HTPLNF", "SSPN") or 0.0) * unit
            whole = HingedPart("delta_e", 0.0, half, (1.0, 1.0))
            found.setdefault("delta_e", ("HTPLNF", whole))
    return list(found.values())


def _place_device(case: Deck, name: str, values: Mapping[str, float]) -> tuple[str, str] | None:
    """Return surface and control of a device, None for a spoiler and the like."""
    if name == "ASYFLP":
        style = round(values.get("STYPE", 0.0))
        if style == _AILERON:
            return "WGPLNF", "delta_a"
        return None
    has_tail = {"WGPLNF", "HTPLNF"} <= case.namelists.keys()
    several = sum(isinstance(item, Namelist) and item.name == "SYMFLP" for item in case.items) > 1
    if not has_tail:
        return "WGPLNF", "delta_f"
    # With several SYMFLP the place alone decides: the case holds the last one only.
    inner, outer = (values.get(key, 0.0) for key in ("SPANFI", "SPANFO"))
    half, wing = case.value("HTPLNF", "SSPN") or 0.0, case.value("WGPLNF", "SSPN") or 0.0
    exposed = case.value("WGPLNF", "SSPNE") or wing
    fits_wing_only = outer > 1.001 * half
    begins_at_wing = inner >= 0.98 * (wing - exposed) and inner > 0.2 * half
    if several:
        on_wing = fits_wing_only or (begins_at_wing and outer < 0.75 * half)
    else:
        on_wing = fits_wing_only or weigh_device_on_tail(case).weight >= IS_FLAP
    return ("WGPLNF", "delta_f") if on_wing else ("HTPLNF", "delta_e")


def _make_part(
    case: Deck, namelist: str, control: str, values: Mapping[str, float], unit: float
) -> HingedPart | None:
    """Return a control with its shares of the local chord, None if a card is missing."""
    keys = ("SPANFI", "SPANFO", "CHRDFI", "CHRDFO")
    if any(key not in values for key in keys):
        return None
    inner, outer, chord_in, chord_out = (values[key] * unit for key in keys)
    surface, _ = _make_surface(case, namelist, (), unit)
    local = np.interp([inner, outer], surface.span, surface.chord)
    shares = (chord_in / float(local[0]), chord_out / float(local[1]))
    if max(shares) > _WHOLE_CHORD:
        shares = (1.0, 1.0)
    return HingedPart(control, inner, min(outer, float(surface.span[-1])), shares)


def _read_body(deck: Deck, unit: float) -> np.ndarray | None:
    """Return stations, centre line and equivalent radius of the body, None without one."""
    x = np.array(deck.schedule("BODY", "X", "NX"))
    if x.size < 3:
        return None
    radius = np.array(deck.values("BODY", "R"))
    area = np.array(deck.values("BODY", "S"))
    upper, lower = np.array(deck.values("BODY", "ZU")), np.array(deck.values("BODY", "ZL"))
    n = x.size
    # Without upper and lower lines the body is one of revolution about its axis.
    centre = np.zeros(n)
    if upper.size >= n and lower.size >= n:
        centre = 0.5 * (upper[:n] + lower[:n])
    # Radius of the circle of the same area: by S, or by an ellipse of half width R and half height.
    if area.size >= n:
        equivalent = np.sqrt(area[:n] / np.pi)
        return np.array([x * unit, centre * unit, equivalent * unit])
    if radius.size < n:
        return None
    height = radius[:n]
    if upper.size >= n and lower.size >= n:
        height = 0.5 * (upper[:n] - lower[:n])
    return np.array([x, centre, np.sqrt(np.maximum(radius[:n] * height, 0.0))]) * unit
