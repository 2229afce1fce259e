"""Panels for paper: one SVG per panel, so that each carries its own alternative text.

Built from the primitives of `flightmech.support.svg_chart`; lengths are its units, 720 of them across the column (182 mm on A4), so
that text of 10 units is 7.2 pt.  Order of drawing: band, exits, flight on top of the band, models, and the flight again as a hair line, so
that no model hides it.  What must be seen in grey has a pattern or a dash in addition to its colour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.support.svg_chart import WIDTH, Frame, area, axes, clipped, curve, line, rect, spaced, text
from pom.report.case.panels import Panel, description, limits
from pom.report.presentation.quantities import fixed, pretty_unit
from pom.report.presentation.trace_marks import LANE, beyond, exit_ticks, fan
from pom.report.presentation.verdict_text import WORDS

from .style import defs

LEFT, RIGHT = 50.0, 6.0
HEAD, GAP, STRIP, FOOT = 15.0, 3.0, 24.0, 27.0
RESIDUAL = 1.6
SQUEEZED = 2.0  # scale of the whole record over that of the window
LEAST, MOST = 30.0, 160.0  # height of an input panel
MOST_PANELS = 7  # on a page
_INSTANTS = ("end_value", "steady")
_SPACE = "\N{NO-BREAK SPACE}"  # the font has no wider one, and one glyph from elsewhere changes the font of its whole line
JUDGED = 2.0  # a judged panel has so many heights of an input panel


@dataclass(frozen=True)
class Drawing:
    """An SVG with its height in units and its alternative text."""

    svg: str
    height: float
    words: str


def arranged(panels: Sequence[Panel], room: float) -> tuple[int, float]:
    """Return how many of the panels go on a page with `room` units of height, and the height of an input panel there."""
    for count in range(min(MOST_PANELS, len(panels)), 0, -1):
        chosen = panels[:count]
        shares = sum(JUDGED if panel.kind == "judged" else 1.0 for panel in chosen)
        height = (room - FOOT - sum(HEAD + GAP + (STRIP + GAP if panel.half is not None else 0.0) for panel in chosen)) / shares
        if height >= LEAST:
            return count, min(height, MOST)
    return 0, 0.0


def drawing(
    name: str,
    time: np.ndarray,
    panel: Panel,
    styles: Mapping[str, str],
    events: Mapping[str, float],
    height: float,
    first: bool,
    last: bool,
):
    """Return one panel as a `Drawing`.

    Parameters
    ----------
    name : str
        Unique in the document; it names clipping paths.
    time : array (time,)
        Clock of the record. [s]
    styles : mapping of str to str
        Run to the class of its line.
    events : mapping of str to float
        Name to instant. [s]
    height : float
        Of an input panel. [unit]
    first, last : bool
        The panel bears the names of the events, the time axis of its page.
    """
    x = (float(time[0]), float(time[-1]))
    whole, panel = panel, _scaled(panel)
    main = height * (JUDGED if panel.kind == "judged" else 1.0)
    frame = Frame(LEFT, HEAD, WIDTH - LEFT - RIGHT, main, x, panel.limits)
    parts = [_head(panel), axes(frame, x_labels=last and panel.half is None, x_most=10)]
    parts += [clipped(frame, name, _inside(frame, time, panel, styles)), _marks(frame, time, events, first)]
    clear = Frame(frame.left, frame.top, frame.width, main - LANE * sum(map(bool, panel.exits.values())), x, panel.limits)
    parts += [beyond(clear, time, values, styles[run]) for run, values in whole.traces.items() if run != "flight"]
    bottom = frame.bottom
    if panel.half is not None:
        low = Frame(LEFT, bottom + GAP, frame.width, STRIP, x, (-RESIDUAL, RESIDUAL))
        parts += [exit_ticks(frame, panel.exits, styles), _residual(low, f"{name}-e", time, panel, panel.half, styles, last)]
        bottom = low.bottom
    if last:
        parts.append(text(LEFT + frame.width / 2, bottom + 23.5, "time, s (clock of the record)", "caption", "middle"))
    full = bottom + (FOOT if last else GAP)
    return Drawing(svg(full, "".join(parts)), full, description(panel))


def _scaled(panel: Panel) -> Panel:
    """Return a judged panel on the scale of its window, where the rest would squeeze it; of the rest what leaves the scale is left out."""
    if panel.half is None:
        return panel
    inside = np.isfinite(panel.half)
    own = limits({run: values[inside] for run, values in panel.traces.items()}, panel.half[inside], panel.label.least_span)
    squeezed = panel.limits[1] - panel.limits[0] > SQUEEZED * (own[1] - own[0])
    if not squeezed:
        return panel
    fits = {run: inside | ((values >= own[0]) & (values <= own[1])) for run, values in panel.traces.items()}
    return replace(panel, limits=own, traces={run: np.where(fits[run], values, np.nan) for run, values in panel.traces.items()})


def svg(height: float, body: str) -> str:
    """Return a whole drawing with the styles of the paper."""
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.1f}">{defs()}{body}</svg>'


def _head(panel: Panel) -> str:
    shown = panel.label
    pieces = [] if shown.is_word else [(shown.base, "symbol"), *([(shown.sub, "sub")] if shown.sub else []), (2 * _SPACE, "")]
    pieces.append((f"{shown.words or shown.name}{f', {shown.unit}' if shown.unit else ''}", "title"))
    body = spaced(LEFT, HEAD - 4.0, pieces)
    traced = sorted((row for row in panel.rows if row["measure"] == "trace"), key=lambda row: float(np.nan_to_num(row["worst_ratio"])))
    worst = {row["run"]: row for row in traced}  # of several criteria on the channel the worst
    rows = [worst[run] for run in panel.traces if run in worst]
    words: list[tuple[str, str]] = []
    for row in rows:
        gap, verdict = 3 * _SPACE if words else "", row["verdict"]
        words += [(f"{gap}{row['run']} ", "caption"), (WORDS[verdict], "title" if verdict == "fail" else "caption")]
        words.append((f" {fixed(row['worst_ratio'], 2)}", "caption"))
    return body + (spaced(WIDTH - RIGHT, HEAD - 4.0, words, "end") if words else "")


def _inside(frame: Frame, time: np.ndarray, panel: Panel, styles: Mapping[str, str]) -> str:
    parts, flight = [], panel.traces.get("flight")
    if panel.half is not None and flight is not None:
        low, high = flight - panel.half, flight + panel.half
        parts.append(area(frame, time, low, high, "band"))
        parts += [_exceedance(frame, time, values, low, high) for run, values in panel.traces.items() if panel.exits.get(run)]
    parts += [fan(frame, time, quantiles, styles[run]) for run, quantiles in panel.fans.items()]
    parts.append(_scalars(frame, time, panel))
    if panel.window:
        parts += [line(float(frame.px(t)), frame.top, float(frame.px(t)), frame.bottom, "window") for t in panel.window]
    curves = {run: curve(frame, time, values, f"trace {styles[run]}") for run, values in panel.traces.items()}
    parts += curves.values()
    if len(curves) > 1 and "flight" in curves:
        parts.append(curves["flight"].replace(f"trace {styles['flight']}", "hair"))
    return "".join(parts)


def _exceedance(frame: Frame, time: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    """Return the hatched area between band and trace where the trace is outside."""
    with np.errstate(invalid="ignore"):
        above, below = np.where(values > high, values, high), np.where(values < low, values, low)
        sides = ((high, above, values > high), (below, low, values < low))
    shapes = ""
    for a, b, out in sides:
        wide = out | np.roll(out, 1) | np.roll(out, -1)
        shapes += area(frame, time, np.where(wide, a, np.nan), np.where(wide, b, np.nan), "exit")
    return shapes


def _marks(frame: Frame, time: np.ndarray, events: Mapping[str, float], named: bool) -> str:
    parts = []
    for i, (name, at) in enumerate(sorted(events.items(), key=lambda item: item[1])):
        if time[0] < at < time[-1]:
            x = float(frame.px(at))
            anchor, shift = ("end", -3) if x > frame.left + 0.85 * frame.width else ("start", 3)
            parts.append(line(x, frame.top, x, frame.bottom, "event"))
            if named:
                parts.append(text(x + shift, frame.top + 9 + 10 * (i % 2), name.replace("_", " "), "tick halo", anchor))
    return "".join(parts)


def _scalars(frame: Frame, time: np.ndarray, panel: Panel) -> str:
    """Return a bar of tolerance about the flight value of what is judged at one instant."""
    parts = []
    for at, half in {
        (row["at"], row["width"]) for row in panel.rows if row["measure"] in _INSTANTS and pretty_unit(row["unit"]) == panel.label.unit
    }:
        if "flight" in panel.traces and np.isfinite(at) and np.isfinite(half):
            x, middle = float(frame.px(at)), float(np.interp(at, time, panel.traces["flight"]))
            low, high = (float(frame.py(middle + side * half)) for side in (-1.0, 1.0))
            parts.append(rect(x - 3.0, high, 6.0, low - high, "band"))
    return "".join(sorted(parts))


def _residual(frame: Frame, name: str, time: np.ndarray, panel: Panel, half: np.ndarray, styles: Mapping[str, str], last: bool) -> str:
    """Return the strip of differences over tolerance."""
    flight, unit_band = panel.traces["flight"], np.where(np.isfinite(half), 1.0, np.nan)
    parts = [axes(frame, x_labels=last, x_most=10, y_ticks=(-1.0, 1.0))]
    parts.append(text(4, frame.top + frame.height / 2 + 3.5, "e/t", "caption"))
    body = area(frame, time, -unit_band, unit_band, "band")
    for run, values in panel.traces.items():
        if run != "flight":
            with np.errstate(invalid="ignore", divide="ignore"):
                ratio = np.where(half > 0, (values - flight) / half, np.nan)
            body += curve(frame, time, ratio, f"trace {styles[run]}")
    return "".join(parts) + clipped(frame, name, body)


def legend(styles: Mapping[str, str]) -> Drawing:
    """Return the line code of a case with the samples of band, exit and window."""
    samples = [(run, 30.0, line(0, 8, 30, 8, f"trace {style}")) for run, style in styles.items()]
    samples += [("tolerance", 30.0, rect(0, 2.5, 30, 11, "band")), ("out of tolerance", 30.0, rect(0, 2.5, 30, 11, "exit"))]
    samples.append(("window", 4.0, line(2, 1, 2, 15, "window")))
    parts, x, y = [], 0.0, 0.0
    for name, wide, sample in samples:
        needed = wide + 20.0 + 5.0 * len(name)
        if x + needed > WIDTH and x > 0.0:
            x, y = 0.0, y + 15.0
        parts.append(f'<g transform="translate({x:.1f},{y:.1f})">{sample}{text(wide + 4, 11.5, name, "caption")}</g>')
        x += needed
    return Drawing(svg(y + 16.0, "".join(parts)), y + 16.0, "Line code: " + ", ".join(name for name, _, _ in samples))
