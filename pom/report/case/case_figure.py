"""The static figure of a case: the same panels as the page's script draws, for print and for
readers without a script.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_area,
    draw_axes,
    draw_curve,
    draw_line,
    draw_rectangle,
    draw_text,
    make_svg_figure,
    text_pieces,
)
from pom.report.case.panels import CasePanel, panel_description
from pom.report.presentation.quantities import SYMBOLS, fixed_decimals
from pom.report.presentation.traces import LANE, beyond_scale_mark, exit_ticks, quantile_areas

LEFT, RIGHT, HEAD, FOOT = 54.0, 12.0, 17.0, 30.0
# a page's worth of panels: A4 less margins and caption at `WIDTH` units across 180 mm
PAGE = 960.0
MAIN, STRIP, SMALL, GAP = 170.0, 38.0, 66.0, 5.0
RESIDUAL = 1.6


def draw_case_figures(
    key: str,
    time: np.ndarray,
    panels: Sequence[CasePanel],
    styles: Mapping[str, str],
    events: Mapping[str, float] | None = None,
) -> list[str]:
    """Return the figures of a case, each at most one page high: what is judged and the inputs, then
    the rest.

    Parameters
    ----------
    key : str
        Unique name of the case in the page.
    time : array (time,)
        Clock of the record. [s]
    panels : sequence of Panel
    styles : mapping of str to str
        Run name to the class of its line.
    events : mapping of str to float, optional
        Name to instant, marked in every panel. [s]
    """
    first = [p for p in panels if p.kind != "shown"]
    pages = [
        page for part in (first, [p for p in panels if p.kind == "shown"]) for page in _pages(part)
    ]
    return [_figure(f"{key}-{i}", time, page, styles, events or {}) for i, page in enumerate(pages)]


def _height(panel: CasePanel) -> float:
    main = MAIN if panel.kind == "judged" else SMALL
    return HEAD + main + (STRIP + GAP if panel.half is not None else 0.0) + GAP


def _pages(panels: Sequence[CasePanel]) -> list[list[CasePanel]]:
    """Fill pages; a part that overfills one page by little is pressed onto it by `_figure`."""
    pages: list[list[CasePanel]] = []
    room = 0.0
    for panel in panels:
        need = _height(panel)
        if not pages or need > room:
            pages.append([])
            room = 1.35 * (PAGE - FOOT)
        pages[-1].append(panel)
        room -= need
    return pages


def _figure(
    name: str,
    time: np.ndarray,
    panels: Sequence[CasePanel],
    styles: Mapping[str, str],
    events: Mapping[str, float],
) -> str:
    heads = len(panels) * (HEAD + GAP) + FOOT + 24.0
    bodies = sum(_height(p) - HEAD - GAP for p in panels)
    scale = min(1.0, (PAGE - heads) / bodies)
    parts, top = [_legend(panels, styles)], 24.0
    for i, panel in enumerate(panels):
        last = i == len(panels) - 1
        body, top = _panel(f"{name}-{i}", time, panel, styles, top, scale, last)
        parts.append(body)
    parts.append(_events(time, top - GAP, events))
    parts.append(
        draw_text(
            LEFT + (WIDTH - LEFT - RIGHT) / 2,
            top + 22,
            "time, s (clock of the record)",
            "caption",
            "middle",
        )
    )
    return make_svg_figure(
        top + FOOT, "".join(parts), " ".join(panel_description(p) + "." for p in panels)
    )


def _legend(panels: Sequence[CasePanel], styles: Mapping[str, str]) -> str:
    runs = [run for run in styles if run != "applied" and any(run in p.traces for p in panels)]
    parts, x = [], LEFT
    for run in runs:
        parts.append(draw_line(x, 9, x + 30, 9, f"trace {styles[run]}"))
        parts.append(draw_text(x + 35, 12.5, run, "caption"))
        x += 52 + 6.4 * len(run)
    if any(p.half is not None for p in panels):
        parts += [
            draw_rectangle(x, 4, 26, 10, "band"),
            draw_text(x + 31, 12.5, "tolerance", "caption"),
        ]
        parts += [
            draw_rectangle(x + 96, 4, 26, 10, "exit"),
            draw_text(x + 127, 12.5, "outside", "caption"),
        ]
    return "".join(parts)


def _events(time: np.ndarray, bottom: float, events: Mapping[str, float]) -> str:
    """Return a line through all panels at every event, named beneath them."""
    frame = Frame(
        LEFT,
        24.0 + HEAD,
        WIDTH - LEFT - RIGHT,
        bottom - 24.0 - HEAD,
        (float(time[0]), float(time[-1])),
        (0.0, 1.0),
    )
    parts = []
    for i, (name, at) in enumerate(events.items()):
        if time[0] < at < time[-1]:
            x = float(frame.px(at))
            parts += [
                draw_line(x, frame.top, x, frame.bottom, "event"),
                draw_text(x + 3, frame.top + 9 + 11 * (i % 2), name.replace("_", " "), "tick halo"),
            ]
    return "".join(parts)


def _panel(
    name, time, panel: CasePanel, styles, top: float, scale: float, last: bool
) -> tuple[str, float]:
    height = (MAIN if panel.kind == "judged" else SMALL) * scale
    x = (float(time[0]), float(time[-1]))
    frame = Frame(LEFT, top + HEAD, WIDTH - LEFT - RIGHT, height, x, panel.scale)
    parts = [_head(panel, top + 12), draw_axes(frame, x_labels=last and panel.half is None)]
    parts.append(clip_to_frame(frame, name, _inside(frame, time, panel, styles)))
    clear = replace(frame, height=frame.height - LANE * sum(map(bool, panel.exits.values())))
    parts += [
        beyond_scale_mark(clear, time, values, styles[run])
        for run, values in panel.traces.items()
        if run != "flight"
    ]
    bottom = frame.bottom
    if panel.half is not None:
        low = Frame(LEFT, bottom + GAP, frame.width, STRIP * scale, x, (-RESIDUAL, RESIDUAL))
        parts += [
            exit_ticks(frame, panel.exits, styles),
            _residual(low, f"{name}-e", time, panel, panel.half, styles, last),
        ]
        bottom = low.bottom
    return "".join(parts), bottom + GAP


def _head(panel: CasePanel, y: float) -> str:
    shown = panel.label
    pieces = (
        []
        if shown.is_word
        else [
            (shown.base, "symbol"),
            *([(shown.sub, "sub")] if shown.sub else []),
            ("\N{EN SPACE}", ""),
        ]
    )
    unit = f", {shown.unit}" if shown.unit else ""
    pieces.append((f"{shown.words or shown.name}{unit}", "title"))
    body = text_pieces(LEFT, y, pieces)
    rows = [row for row in panel.rows if row["measure"] == "trace"]
    words = [
        f"{row['run']} {SYMBOLS[row['verdict']]} {fixed_decimals(row['worst_ratio'], 2)}"
        for row in rows
    ]
    return body + (
        draw_text(WIDTH - RIGHT, y, "\N{EM SPACE}".join(words), "caption", "end") if words else ""
    )


def _inside(frame: Frame, time, panel: CasePanel, styles) -> str:
    parts = []
    flight = panel.traces.get("flight")
    if panel.half is not None and flight is not None:
        low, high = flight - panel.half, flight + panel.half
        parts.append(draw_area(frame, time, low, high, "band"))
        for run, values in panel.traces.items():
            if panel.exits.get(run):
                parts.append(_exceedance(frame, time, values, low, high))
    parts += [
        quantile_areas(frame, time, quantiles, styles[run]) for run, quantiles in panel.fans.items()
    ]
    if panel.window:
        parts += [
            draw_line(float(frame.px(t)), frame.top, float(frame.px(t)), frame.bottom, "window")
            for t in panel.window
        ]
    for run, values in panel.traces.items():
        parts.append(draw_curve(frame, time, values, f"trace {styles[run]}"))
    return "".join(parts)


def _exceedance(frame: Frame, time, values, low, high) -> str:
    """Return the area between band and trace where the trace is outside, tinted and hatched."""
    with np.errstate(invalid="ignore"):
        above, below = np.where(values > high, values, high), np.where(values < low, values, low)
    shapes = ""
    for a, b, out in ((high, above, values > high), (below, low, values < low)):
        wide = out | np.roll(out, 1) | np.roll(out, -1)
        shapes += draw_area(
            frame, time, np.where(wide, a, np.nan), np.where(wide, b, np.nan), "exit"
        )
    return shapes


def _residual(
    frame: Frame, name: str, time, panel: CasePanel, half: np.ndarray, styles, last: bool
) -> str:
    flight = panel.traces["flight"]
    unit_band = np.where(np.isfinite(half), 1.0, np.nan)
    parts = [
        draw_axes(frame, x_labels=last, y_ticks=(-1.0, 0.0, 1.0)),
        draw_text(6, frame.top + frame.height / 2 + 3.5, "e/t", "caption"),
    ]
    body = draw_area(frame, time, -unit_band, unit_band, "band")
    for run, values in panel.traces.items():
        if run != "flight":
            with np.errstate(invalid="ignore", divide="ignore"):
                ratio = np.where(half > 0, (values - flight) / half, np.nan)
            body += draw_curve(frame, time, ratio, f"trace {styles[run]}")
            parts.append(beyond_scale_mark(frame, time, ratio, styles[run], with_value=False))
    return "".join(parts) + clip_to_frame(frame, name, body)
