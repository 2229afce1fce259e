"""Shape of the aeroplane of an input deck: outlines in space, points, and what the deck lacks.

Axes are those of the deck, x aft, z up, and y right, in its unit of length. Each outline states in
which views it is drawn.

Source: J. Williams, S. Vukelich, The USAF Stability and Control Digital DATCOM, Vol. I,
AFFDL-TR-79-3032, figures of the namelists.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import planform_nodes
from datcom_io.drawings.devices import device_outlines
from datcom_io.drawings.outlines import ALL, DeckOutline, lifting_surface, mirror, upright_surface
from flightmech.short_text import ShortText

_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 33)
# Cases without an aeroplane made of parts.
_SPECIAL = {
    "LARWB": "a low-aspect-ratio wing-body ($LARWB), whose cards give areas and no outlines",
    "HYPEFF": "a hypersonic flap ($HYPEFF) on a flat plate",
    "TRNJET": "a transverse jet ($TRNJET) on a flat plate",
}


class MarkedPoint(NamedTuple):
    """A point of the drawing, such as the moment reference point."""

    name: str
    place: tuple[float, float, float]


@dataclass(frozen=True)
class DeckShape(ShortText):
    """Shape of the aeroplane of one case.

    Attributes
    ----------
    outlines : tuple of DeckOutline
        In the order of drawing. [of the deck]
    points : tuple of MarkedPoint
    parts : tuple of str
        A line for each part, with its main dimensions in the unit of the deck.
    omissions : tuple of str
        What the deck does not define, or not completely.
    dim : str
        Unit of length, ``FT IN M CM``.
    """

    outlines: tuple[DeckOutline, ...]
    points: tuple[MarkedPoint, ...]
    parts: tuple[str, ...]
    omissions: tuple[str, ...]
    dim: str


@dataclass
class _ShapeParts:
    outlines: list[DeckOutline] = field(default_factory=list)
    points: list[MarkedPoint] = field(default_factory=list)
    parts: list[str] = field(default_factory=list)
    omissions: list[str] = field(default_factory=list)


def shape_of_deck(deck: Deck) -> DeckShape:
    """Return the shape of the aeroplane of a case.

    Parameters
    ----------
    deck : Deck
        One case, as an item of `read_deck`.

    Returns
    -------
    DeckShape
        Without outlines if the deck has no part that can be drawn; `omissions` then states why.
    """
    found = _ShapeParts()
    for name, text in _SPECIAL.items():
        if name in deck.namelists:
            found.omissions.append(f"the case is {text}")
    if deck.dim == "FT" and not deck.has("DIM"):
        found.omissions.append("the unit: without a card DIM it is FT, the default")
    _add_body(deck, found)
    for name, letter, what in (("WGPLNF", "W", "wing"), ("HTPLNF", "H", "horizontal tail")):
        _add_lifting_surface(deck, name, letter, what, found)
    for name, letter, what in (("VTPLNF", "V", "vertical tail"), ("VFPLNF", "VF", "ventral fin")):
        _add_upright_surface(deck, name, letter, what, found)
    _add_twin_panels(deck, found)
    outlines, parts, omissions = device_outlines(deck)
    found.outlines += outlines
    found.parts += parts
    found.omissions += omissions
    _add_propulsion(deck, found)
    _add_centre(deck, found)
    scale = deck.value("SYNTHS", "SCALE")
    if scale not in (None, 0.0, 1.0):
        found.omissions.append(f"SCALE={scale:g}: the drawing has the dimensions before scaling")
    return DeckShape(
        tuple(found.outlines),
        tuple(found.points),
        tuple(found.parts),
        tuple(found.omissions),
        deck.dim,
    )


def _add_body(deck: Deck, found: _ShapeParts) -> None:
    """Add the body, whose half width is R or, without it, the radius of the area S."""
    if "BODY" not in deck.namelists:
        if not set(_SPECIAL) & set(deck.namelists):
            found.omissions.append("no body ($BODY)")
        return
    x = np.array(deck.schedule("BODY", "X", "NX"))
    arrays = {
        name: np.array(deck.values("BODY", name)[: len(x)]) for name in ("R", "S", "ZU", "ZL")
    }
    half = arrays["R"]
    note = ""
    # Without R the program takes the radius of a circle of the area S.
    if len(half) < len(x) and len(arrays["S"]) == len(x):
        half = np.sqrt(np.maximum(arrays["S"], 0.0) / np.pi)
        note = ", half width of a circle of the area S"
    if len(x) < 2 or len(half) < len(x) or not np.isfinite([x, half]).all():
        found.omissions.append(
            f"the body: $BODY has {len(x)} stations X with {len(arrays['R'])} R and "
            f"{len(arrays['S'])} S; each station needs R or S"
        )
        return
    top, bottom = half.copy(), -half
    heights = [arrays["ZU"], arrays["ZL"]]
    if all(len(z) == len(x) and np.isfinite(z).all() for z in heights):
        top, bottom = heights
    else:
        found.omissions.append(
            "ZU and ZL of the body at every station: its side view is a body of revolution about "
            "Z = 0, as the program takes it"
        )
    # Outline in the top view and in the side view: forward along one side, back along the other.
    zero = np.zeros_like(x)
    plan = np.column_stack([np.r_[x, x[::-1]], np.r_[half, -half[::-1]], np.r_[zero, zero]])
    side = np.column_stack([np.r_[x, x[::-1]], np.r_[zero, zero], np.r_[top, bottom[::-1]]])
    found.outlines.append(DeckOutline("body", "body", plan, ("top",)))
    found.outlines.append(DeckOutline("body", "body", side, ("side",)))
    # Ellipses in the front view, the largest last, so that it is on top.
    for k in np.argsort(half * (top - bottom), kind="stable"):
        middle, height = 0.5 * (top[k] + bottom[k]), 0.5 * (top[k] - bottom[k])
        ring = np.column_stack(
            [
                np.full_like(_CIRCLE, x[k]),
                half[k] * np.cos(_CIRCLE),
                middle + height * np.sin(_CIRCLE),
            ]
        )
        found.outlines.append(DeckOutline("body", "body", ring, ("front",)))
    found.parts.append(
        f"body: X {x[0]:g} to {x[-1]:g}, width {2.0 * half.max():.4g}, height "
        f"{(top - bottom).max():.4g}{note}"
    )


def _apex(deck: Deck, letter: str, what: str, found: _ShapeParts) -> tuple[float, float] | None:
    """Return X and Z of the apex of a surface; None if the deck does not place it."""
    x, z = deck.value("SYNTHS", f"X{letter}"), deck.value("SYNTHS", f"Z{letter}")
    if x is None:
        found.omissions.append(f"the {what}: $SYNTHS has no X{letter}, its place")
        return None
    if z is None:
        found.omissions.append(f"Z{letter} of the {what}: drawn at 0, as the program takes it")
    return x, z or 0.0


def _nodes(
    deck: Deck, name: str, what: str, found: _ShapeParts
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    if name not in deck.namelists:
        return None
    nodes = planform_nodes(deck, name)
    if nodes is None:
        wanted = ("CHRDR", "CHRDTP", "SSPN", "SAVSI")
        missing = [key for key in wanted if deck.value(name, key) is None]
        found.omissions.append(
            f"the {what}: ${name} has no {', '.join(missing) or 'chord or span above 0'}"
        )
    return nodes


def _add_lifting_surface(deck: Deck, name: str, letter: str, what: str, found: _ShapeParts) -> None:
    nodes = _nodes(deck, name, what, found)
    apex = _apex(deck, letter, what, found) if nodes is not None else None
    if nodes is None or apex is None:
        return
    outline = lifting_surface(deck, name, nodes, apex)
    style = "wing" if letter == "W" else "tail"
    found.outlines.append(DeckOutline(what, style, outline, ALL))
    found.outlines.append(DeckOutline(what, style, mirror(outline), ("top", "front")))
    y, chord, _ = nodes
    area = 2.0 * float(np.trapezoid(chord, y))
    dihedral, incidence = deck.value(name, "DHDADI"), deck.value("SYNTHS", f"ALI{letter}")
    text = (
        f"{what}: apex X {apex[0]:g}, Z {apex[1]:g}, span {2.0 * y[-1]:.4g}, chord {chord[0]:g} to "
        f"{chord[-1]:g}, area {area:.6g}"
    )
    if incidence is not None:
        text += f", incidence {incidence:g} deg"
    if dihedral is not None:
        text += f", dihedral {dihedral:g} deg"
    found.parts.append(text)


def _add_upright_surface(deck: Deck, name: str, letter: str, what: str, found: _ShapeParts) -> None:
    nodes = _nodes(deck, name, what, found)
    apex = _apex(deck, letter, what, found) if nodes is not None else None
    if nodes is None or apex is None:
        return
    # VERTUP is false for a vertical tail below the reference plane; a ventral fin points down.
    flags = deck.namelists.get("SYNTHS", {}).get("VERTUP", [True])
    is_up = letter == "V" and flags[0] is not False
    outline = upright_surface(nodes, apex, 1.0 if is_up else -1.0)
    found.outlines.append(DeckOutline(what, "fin", outline, ("side",)))
    line = outline[[0, len(nodes[0]) - 1]]
    found.outlines.append(DeckOutline(what, "fin", line, ("front",)))
    root_and_tip = np.vstack([outline[:1], outline[-1:]])
    found.outlines.append(DeckOutline(what, "fin", root_and_tip, ("top",)))
    y, chord, _ = nodes
    area = float(np.trapezoid(chord, y))
    found.parts.append(
        f"{what}: apex X {apex[0]:g}, Z {apex[1]:g}, {'up' if is_up else 'down'} {y[-1]:g}, chord "
        f"{chord[0]:g} to {chord[-1]:g}, area {area:.6g}"
    )


def _add_twin_panels(deck: Deck, found: _ShapeParts) -> None:
    """Add the twin vertical panels, as rectangles of their area, span and place."""
    if "TVTPAN" not in deck.namelists:
        return
    names = ("BV", "BH", "SV", "VLP", "ZP")
    span, between, area, arm, height = (deck.value("TVTPAN", name) for name in names)
    x_cg, z_cg = deck.value("SYNTHS", "XCG"), deck.value("SYNTHS", "ZCG")
    if not span or between is None or not area or arm is None or x_cg is None:
        found.omissions.append("the twin vertical panels: BV, BH, SV, VLP or XCG is missing")
        return
    # VLP is the distance from XCG to the quarter chord of the panels.
    chord = area / span
    x = x_cg + arm - 0.25 * chord
    z = (z_cg or 0.0) + (height or 0.0)
    for side in (-1.0, 1.0):
        y = 0.5 * side * between
        low, high = z - 0.5 * span, z + 0.5 * span
        corners = np.array([[x, y, low], [x + chord, y, low], [x + chord, y, high], [x, y, high]])
        found.outlines.append(DeckOutline("twin vertical panels", "fin", corners, ALL))
    found.parts.append(
        f"twin vertical panels: {between:g} from each other, span {span:g}, area {area:g} each"
    )
    found.omissions.append(
        "the plan of the twin vertical panels: drawn as rectangles of the area SV with their "
        "quarter chord at XCG + VLP"
    )


def _add_propulsion(deck: Deck, found: _ShapeParts) -> None:
    """Add propeller discs, and jets from inlet to exit."""
    if "PROPWR" in deck.namelists:
        names = ("PHALOC", "PHVLOC", "PRPRAD")
        x, z, radius = (deck.value("PROPWR", name) for name in names)
        if x is None or not radius:
            found.omissions.append("the propeller: PHALOC or PRPRAD of $PROPWR is missing")
        else:
            for y in _sides(deck, "PROPWR", "NENGSP", "YP"):
                ring = np.column_stack(
                    [
                        np.full_like(_CIRCLE, x),
                        y + radius * np.cos(_CIRCLE),
                        (z or 0.0) + radius * np.sin(_CIRCLE),
                    ]
                )
                found.outlines.append(DeckOutline("propeller", "engine", ring, ALL))
            found.parts.append(f"propeller: hub X {x:g}, Z {z or 0.0:g}, radius {radius:g}")
    if "JETPWR" in deck.namelists:
        inlet, exit_x, z = (deck.value("JETPWR", n) for n in ("JIALOC", "JEALOC", "JEVLOC"))
        radius = deck.value("JETPWR", "JERAD") or 0.0
        if inlet is None or exit_x is None:
            found.omissions.append("the jet: JIALOC or JEALOC of $JETPWR is missing")
            return
        for y in _sides(deck, "JETPWR", "NENGSJ", "JELLOC"):
            found.outlines += _jet(inlet, exit_x, y, z or 0.0, radius)
        found.parts.append(f"jet: inlet X {inlet:g}, exit X {exit_x:g}, Z {z or 0.0:g}")


def _sides(deck: Deck, name: str, count: str, lateral: str) -> Iterator[float]:
    """Yield the lateral places of one or two engines."""
    y = deck.value(name, lateral) or 0.0
    yield y
    if y and (deck.value(name, count) or 1.0) >= 2.0:
        yield -y


def _jet(inlet: float, exit_x: float, y: float, z: float, radius: float) -> Iterator[DeckOutline]:
    """Yield the outlines of a jet in the three views."""
    x = np.array([inlet, exit_x, exit_x, inlet])
    across = radius * np.array([1.0, 1.0, -1.0, -1.0])
    level = np.full(4, z)
    yield DeckOutline("jet", "engine", np.column_stack([x, y + across, level]), ("top",))
    yield DeckOutline("jet", "engine", np.column_stack([x, np.full(4, y), z + across]), ("side",))
    ring = np.column_stack(
        [
            np.full_like(_CIRCLE, exit_x),
            y + radius * np.cos(_CIRCLE),
            z + radius * np.sin(_CIRCLE),
        ]
    )
    yield DeckOutline("jet", "engine", ring, ("front",))


def _add_centre(deck: Deck, found: _ShapeParts) -> None:
    x, z = deck.value("SYNTHS", "XCG"), deck.value("SYNTHS", "ZCG")
    if x is None:
        if "SYNTHS" in deck.namelists:
            found.omissions.append("XCG, the centre of gravity and moment reference")
        return
    found.points.append(MarkedPoint("XCG, ZCG", (x, 0.0, z or 0.0)))
    found.parts.append(
        f"centre of gravity and moment reference: XCG {x:g}, ZCG {z or 0.0:g}"
        + ("" if z is not None else " (ZCG not given)")
    )
