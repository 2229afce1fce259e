"""Maps of the validity envelope of each configuration, as text and as SVG.

A map is drawn in Mach number and in sideslip over the angle of attack.  All other variables are
held: sideslip and controls at zero, attached flow, out of ground effect, at 1500 m, and in the
sideslip map the median of the Mach numbers that the configuration was flown at.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.aircraft.controls import ICE
from flightmech.envelope.envelope import Envelope
from flightmech.envelope.evidence import PLANES, flown_configurations
from flightmech.envelope.regions import EXTRAPOLATED, REGIONS, axis_name, usual_width
from flightmech.errors import SchemaError
from flightmech.flown_states import CELL
from flightmech.names import ATTACHED_FLOW, lookup, value_text
from flightmech.short_text import ShortText
from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_axes,
    draw_text,
)
from flightmech.units import from_si

HELD = {"h": 1500.0, "h_agl": 1500.0, "beta": 0.0, "CT": 0.0, **ATTACHED_FLOW}
"""Values of the variables that a map does not show. [SI]"""
MARKS = "#+.x"
"""Characters of the regions in a text map."""
COLOURS = ("#1b7f4d", "#8fd1a8", "#f2c46d", "#b8b8b8")
LEAST_CELLS = 5  # visited cells from which on a configuration has a map of its own
_LEFT, _TOP, _HEIGHT, _FOOT, _GAP = 44.0, 40.0, 190.0, 40.0, 50.0
_BEYOND = 0.08  # of the range of the tables, shown beyond their ends
_LEGEND = 26.0
_MOST_POINTS = 300  # of the drawn path of a case
AT_REST = 0.01  # of an extension or a flap angle [1, rad]
EXTENDED = 0.5  # extension of a gear or speed brake that counts as extended


@dataclass(frozen=True)
class RegionMap(ShortText):
    """Regions of one configuration in one plane.

    Attributes
    ----------
    configuration : dict of str to float
        [SI]
    plane : (str, str)
        Abscissa and ordinate.
    held : dict of str to float
        All other variables. [SI]
    edges : (array, array)
        Edges of the cells, outer ones included. [SI]
    regions, leaving : array of uint8 (cell, cell)
        Region, and code of the axis that leaves.
    everywhere : tuple of str
        As in `Envelope`.
    """

    configuration: dict[str, float]
    plane: tuple[str, str]
    held: dict[str, float]
    edges: tuple[np.ndarray, np.ndarray]
    regions: np.ndarray
    leaving: np.ndarray
    everywhere: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Configuration in words."""
        return configuration_text(self.configuration)

    def report(self) -> str:
        """Return the map as lines of `MARKS`, the ordinate upward."""
        x, y = self.plane
        lines = [f"{self.title}: {y} over {x}"]
        centres = [_middles(edges) for edges in self.edges]
        for k in reversed(range(len(centres[1]))):
            marks = "".join(MARKS[code] for code in self.regions[:, k])
            lines.append(f"{_shown(y, centres[1][k]):>9} {marks}")
        ends = f"{_shown(x, centres[0][0])} ... {_shown(x, centres[0][-1])}"
        return "\n".join([*lines, f"{'':9} {x} {ends} {lookup(x).display_units}"])


def everywhere_text(names: Iterable[str]) -> str:
    """Return which terms are a-priori at every state; empty without one."""
    listed = ", ".join(names)
    if not listed:
        return ""
    return f"no state is better than a-priori: no flight supports {listed}, at any state"


def configuration_text(configuration: Mapping[Any, Any]) -> str:
    """Return flaps, gear, speed brake and ice in words; ``clean`` without any of them, and ``one
    configuration`` if none of them is stated.

    Examples
    --------
    >>> configuration_text({"delta_f": 0.698, "gear": 1.0, "speedbrake": 0.0})
    'flaps 40 deg, gear'
    """
    if not configuration:
        return "one configuration"
    parts = []
    flaps = configuration.get("delta_f", 0.0)
    if abs(flaps) >= AT_REST:
        parts.append(f"flaps {value_text('delta_f', flaps, '.0f')}")
    for name, word in (("gear", "gear"), ("speedbrake", "speed brake")):
        extension = configuration.get(name, 0.0)
        if extension >= EXTENDED:
            parts.append(word)
        elif extension >= AT_REST:
            parts.append(f"{word} {extension:.2g} extended")
    ice = configuration.get(ICE, 0.0)
    if ice >= AT_REST:
        parts.append("ice" if ice >= 1.0 - AT_REST else f"ice of {ice:.2g}")
    return ", ".join(parts) or "clean"


def region_maps(envelope: Envelope) -> list[RegionMap]:
    """Return the maps of every configuration that was flown in `LEAST_CELLS` cells or more.

    Raises
    ------
    SchemaError
        The envelope keeps no flown states, so that its configurations are not known.
    """
    states = envelope.states
    if states is None:
        raise SchemaError(
            "validity envelope",
            [
                "the database keeps no flown states: it is from before they were kept, or no "
                "flight identified it; join the fits again with this version"
            ],
        )
    maps = []
    for configuration, count in flown_configurations(states):
        if count < LEAST_CELLS:
            continue
        flown = np.ones(len(states.cells), bool)
        for name, value in configuration.items():
            flown &= states.cells[:, states.axes.index(name)] == round(value / CELL[name])
        mach = np.median(states.cells[flown, states.axes.index("mach")]) * CELL["mach"]
        for plane in PLANES:
            if set(plane) <= set(states.axes):
                maps.append(make_map(envelope, configuration, plane, {"mach": float(mach)}))
    return maps


def make_map(
    envelope: Envelope,
    configuration: Mapping[str, float],
    plane: tuple[str, str],
    held: Mapping[str, float],
) -> RegionMap:
    """Return the map of a configuration in a plane; `held` as in `RegionMap`, where not `HELD`."""
    edges = []
    for name in plane:
        inner = [np.zeros(0)]
        for table in envelope.tables:
            if name in table.axes:
                inner.append(table.edges[table.axes.index(name)])
        union = np.unique(np.concatenate(inner))
        if not union.size:
            union = np.zeros(1)
        # sides of the same place that differ by rounding are one
        union = union[np.append(True, np.diff(union) > 1e-6 * usual_width(name))]
        width = 3.0 * usual_width(name)
        edges.append(np.concatenate([[union[0] - width], union, [union[-1] + width]]))
    x, y = np.meshgrid(*(_middles(own) for own in edges), indexing="ij")
    fixed = {name: HELD.get(name, 0.0) for name in envelope.axes}
    fixed |= {**{name: float(value) for name, value in held.items()}, **configuration}
    others = {name: value for name, value in fixed.items() if name not in plane}
    regions, leaving = envelope.look_up({**others, plane[0]: x, plane[1]: y})
    shown = {name: value for name, value in others.items() if name not in configuration}
    return RegionMap(
        dict(configuration),
        plane,
        shown,
        edges=(edges[0], edges[1]),
        regions=regions,
        leaving=leaving,
        everywhere=envelope.everywhere,
    )


def _middles(edges: np.ndarray) -> np.ndarray:
    return 0.5 * (edges[1:] + edges[:-1])


def _shown(name: str, value: float) -> str:
    return f"{float(from_si(value, lookup(name).display_units)):.3g}"


def map_rows(maps: Sequence[RegionMap]) -> list[dict[str, Any]]:
    """Return one row per cell of the maps: configuration, centre [SI], region, axis that leaves."""
    rows = []
    for own in maps:
        x, y = (_middles(edges) for edges in own.edges)
        for i, k in np.ndindex(own.regions.shape):
            place = {**own.held, own.plane[0]: float(x[i]), own.plane[1]: float(y[k])}
            state = {name: place.get(name, 0.0) for name in ("alpha", "beta", "mach")}
            words = REGIONS[own.regions[i, k]], axis_name(int(own.leaving[i, k]))
            plane = {"map": f"{own.plane[1]} over {own.plane[0]}", **own.configuration}
            rows.append({**plane, **state, "region": words[0], "axis": words[1]})
    return rows


def draw_maps(
    maps: Sequence[RegionMap],
    paths: Mapping[str, Sequence[Mapping[str, np.ndarray]]] | None = None,
    key: str = "envelope",
) -> tuple[str, float]:
    """Return the SVG content of the maps, two to a row, and its height.

    Parameters
    ----------
    maps : sequence of RegionMap
    paths : mapping of str to sequence of mapping of str to array (time,), optional
        Flown paths by `RegionMap.title`, each with alpha and the ordinates. [SI]
    key : str
        Beginning of the names of the clip paths, unique in the page.
    """
    width = 0.5 * (WIDTH - _GAP - _LEFT) - 6.0
    parts, height = [_draw_legend()], _LEGEND
    for number, own in enumerate(maps):
        # Two maps to a row, from left to right.
        column, row = number % 2, number // 2
        left = _LEFT + column * (width + _GAP)
        top = _LEGEND + _TOP + row * (_TOP + _HEIGHT + _FOOT)
        frame = Frame(left, top, width, _HEIGHT, *_map_limits(own))
        parts += _draw_map(frame, own, (paths or {}).get(own.title, ()), f"{key}-{number}")
        height = top + _HEIGHT + _FOOT
    return "".join(parts), height


def _map_limits(own: RegionMap) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the limits of both axes in display units: the tables, and a little beyond them."""
    limits = []
    for k, name in enumerate(own.plane):
        inside = np.flatnonzero((own.regions < EXTRAPOLATED).any(axis=1 - k))
        edges = own.edges[k]
        low, high = edges[0], edges[-1]
        if inside.size:
            low, high = edges[inside[0]], edges[inside[-1] + 1]
        margin = _BEYOND * (high - low)
        low = 0.0 if name == "mach" else low - margin
        limits.append((float(_display(name, low)), float(_display(name, high + margin))))
    return limits[0], limits[1]


def _display(name: str, values: float | np.ndarray) -> np.ndarray:
    return np.asarray(from_si(values, lookup(name).display_units), dtype=float)


def _draw_map(
    frame: Frame, own: RegionMap, lines: Sequence[Mapping[str, np.ndarray]], key: str
) -> list[str]:
    """Return the elements of one map."""
    x, y = own.plane
    px = frame.px(_display(x, own.edges[0]))
    py = frame.py(_display(y, own.edges[1]))
    cells = []
    for i, column in enumerate(own.regions):
        # cells of one region that follow each other are one rectangle
        starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1, [len(column)]])
        for first, last in itertools.pairwise(starts):
            cells.append(
                f'<rect x="{px[i]:.1f}" y="{py[last]:.1f}" width="{px[i + 1] - px[i] + 0.3:.1f}" '
                f'height="{py[first] - py[last] + 0.3:.1f}" fill="{COLOURS[column[first]]}"/>'
            )
    for line in lines:
        step = max(1, len(line[x]) // _MOST_POINTS)
        points = zip(frame.px(_display(x, line[x][::step])), frame.py(_display(y, line[y][::step])))
        text = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        cells.append(f'<polyline points="{text}" fill="none" stroke="#101010" stroke-width="1"/>')
    held = [
        value_text(name, own.held[name], ".3g") for name in ("mach", "beta") if name in own.held
    ]
    other = "mach" if y == "beta" else "beta"
    labels = {name: name + _unit_of(name) for name in own.plane}
    second = f"{labels[y]}, over alpha; {other} {held[0]}" if held else f"{labels[y]}, over alpha"
    middle = frame.left + 0.5 * frame.width
    return [
        clip_to_frame(frame, key, "".join(cells)),
        draw_axes(frame, x_labels=True),
        draw_text(frame.left, frame.top - 20.0, own.title, "label"),
        draw_text(frame.left, frame.top - 6.0, second, "label"),
        draw_text(middle, frame.bottom + 27.0, labels[x], "label", "middle"),
    ]


def _unit_of(name: str) -> str:
    """Return ``, deg``; empty for a ratio."""
    unit = lookup(name).display_units
    return "" if unit == "1" else f", {unit}"


def _draw_legend() -> str:
    parts, left = [], _LEFT
    for colour, word in zip(COLOURS, REGIONS, strict=True):
        parts.append(f'<rect x="{left:.0f}" y="6" width="14" height="10" fill="{colour}"/>')
        parts.append(draw_text(left + 19.0, 15.0, word, "label"))
        left += 46.0 + 6.0 * len(word)
    parts.append(f'<path d="M{left:.0f},11h18" stroke="#101010" stroke-width="1"/>')
    parts.append(draw_text(left + 23.0, 15.0, "flown by a case", "label"))
    return "".join(parts)


def standalone_svg(maps: Sequence[RegionMap]) -> str:
    """Return the maps as an SVG file."""
    body, height = draw_maps(maps)
    style = (
        "text{font:11px sans-serif;fill:#101010}.grid{fill:none;stroke:#808080;stroke-width:.3}"
        ".frame{fill:none;stroke:#404040;stroke-width:.8}.tick text{font-size:9px}"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}" '
        f'width="{WIDTH:.0f}"><style>{style}</style><rect width="100%" height="100%" '
        f'fill="white"/>{body}</svg>\n'
    )
