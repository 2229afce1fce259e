"""Flaps, controls, spoilers and tabs of a deck, at their span and chord."""

from __future__ import annotations

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import planform_nodes
from datcom_io.drawings.outlines import ALL, DeckOutline, mirror, place_on_surface

_SPOILERS, _DIFFERENTIAL_TAIL = (1, 2, 3), 5
_APEX = {"WGPLNF": "W", "HTPLNF": "H"}
_SURFACE_NAMES = {"WGPLNF": "wing", "HTPLNF": "horizontal tail"}
_KINDS = {
    1: "plain flap",
    2: "single-slotted flap",
    3: "Fowler flap",
    4: "double-slotted flap",
    5: "split flap",
    6: "leading-edge flap",
    7: "leading-edge slats",
    8: "Krueger flap",
}
_LEADING_EDGE = (6, 7, 8)


def device_outlines(deck: Deck) -> tuple[list[DeckOutline], list[str], list[str]]:
    """Return outlines of the devices of a case, a line for each, and what is not defined.

    The program puts a SYMFLP on the horizontal tail if the case has one, otherwise on the wing, and
    an ASYFLP on the wing.
    """
    outlines: list[DeckOutline] = []
    parts: list[str] = []
    omissions: list[str] = []
    surface = "HTPLNF" if "HTPLNF" in deck.namelists else "WGPLNF"
    if "SYMFLP" in deck.namelists:
        kind = round(deck.value("SYMFLP", "FTYPE") or 0.0)
        what = _KINDS.get(kind, "flap")
        _add_device(
            deck,
            ("SYMFLP", surface, what),
            (outlines, parts, omissions),
            at_leading_edge=kind in _LEADING_EDGE,
        )
    if "ASYFLP" in deck.namelists:
        kind = round(deck.value("ASYFLP", "STYPE") or 0.0)
        if kind == _DIFFERENTIAL_TAIL:
            parts.append("differential horizontal tail ($ASYFLP, STYPE=5): the tail is the control")
        elif kind in _SPOILERS:
            _add_device(
                deck, ("ASYFLP", "WGPLNF", "spoiler"), (outlines, parts, omissions), is_spoiler=True
            )
        else:
            _add_device(deck, ("ASYFLP", "WGPLNF", "aileron"), (outlines, parts, omissions))
    if "CONTAB" in deck.namelists:
        _add_tab(deck, surface, (outlines, parts, omissions))
    return outlines, parts, omissions


_Found = tuple[list[DeckOutline], list[str], list[str]]


def _add_device(
    deck: Deck,
    which: tuple[str, str, str],
    found: _Found,
    *,
    at_leading_edge: bool = False,
    is_spoiler: bool = False,
) -> None:
    """Add a device of a namelist on a surface."""
    name, surface, what = which
    outlines, parts, omissions = found
    on = _SURFACE_NAMES[surface]
    inner, outer = deck.value(name, "SPANFI"), deck.value(name, "SPANFO")
    chords = [deck.value(name, "CHRDFI"), deck.value(name, "CHRDFO")]
    hinge = deck.value(name, "XSPRME")
    if is_spoiler and hinge is not None:
        # A spoiler is at XSPRME of the chord. The deck has no chord of it.
        chords = [0.0, 0.0]
    if inner is None or outer is None or None in chords:
        omissions.append(
            f"the {what}: ${name} has no span or chord (SPANFI, SPANFO, CHRDFI, CHRDFO)"
        )
        return
    outline = _strip(
        deck,
        surface,
        (inner, outer),
        (float(chords[0] or 0.0), float(chords[1] or 0.0)),
        at_leading_edge=at_leading_edge,
        share=hinge if is_spoiler else None,
    )
    if outline is None:
        omissions.append(f"the {what}: its surface, the {on}, is not drawn")
        return
    outlines.append(DeckOutline(what, "device", outline, ALL))
    outlines.append(DeckOutline(what, "device", mirror(outline), ("top", "front")))
    text = f"{what} on the {on} (${name}): span {inner:g} to {outer:g}"
    if is_spoiler and hinge is not None:
        parts.append(f"{text}, at {hinge:g} of the chord")
        omissions.append("the chord of the spoiler: drawn as its hinge line")
    else:
        parts.append(f"{text}, chord {chords[0]:g} to {chords[1]:g}")


def _add_tab(deck: Deck, surface: str, found: _Found) -> None:
    """Add the control tab and the trim tab, at the trailing edge."""
    outlines, parts, omissions = found
    tabs = {
        "control tab": ("BITC", "BOTC", "CFITC", "CFOTC"),
        "trim tab": ("BITT", "BOTT", "CFITT", "CFOTT"),
    }
    for what, names in tabs.items():
        inner, outer, first, second = (deck.value("CONTAB", name) for name in names)
        if inner is None or outer is None or first is None or second is None:
            continue
        outline = _strip(deck, surface, (inner, outer), (first, second))
        if outline is None:
            omissions.append(f"the {what}: its surface is not drawn")
            continue
        outlines.append(DeckOutline(what, "device", outline, ALL))
        outlines.append(DeckOutline(what, "device", mirror(outline), ("top", "front")))
        parts.append(
            f"{what} ($CONTAB): span {inner:g} to {outer:g}, chord {first:g} to {second:g}"
        )


def _strip(
    deck: Deck,
    surface: str,
    span: tuple[float, float],
    chords: tuple[float, float],
    *,
    at_leading_edge: bool = False,
    share: float | None = None,
) -> np.ndarray | None:
    """Return the outline (4, 3) of a device, None if its surface has no outline.

    A device beyond the tip, or with a larger chord than its surface, is drawn as given: it is an
    error of the deck that the drawing shows.
    """
    nodes = planform_nodes(deck, surface) if surface in deck.namelists else None
    x = deck.value("SYNTHS", f"X{_APEX[surface]}")
    if nodes is None or x is None:
        return None
    apex = (x, deck.value("SYNTHS", f"Z{_APEX[surface]}") or 0.0)
    # Corners: inner and outer trailing or leading corner, then back along the other edge.
    stations = np.array([span[0], span[1], span[1], span[0]])
    local = np.interp(stations, nodes[0], nodes[1])
    width = np.array([chords[0], chords[1], 0.0, 0.0])
    behind = local - width
    if share is not None:
        behind = share * local
    elif at_leading_edge:
        behind = np.array([0.0, 0.0, chords[1], chords[0]])
    return place_on_surface(deck, surface, nodes, apex=apex, stations=stations, behind=behind)
