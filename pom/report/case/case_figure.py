"""Static figures of a case, for print and for readers without a script.

The panels are those that the script of the page draws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_axes,
    draw_line,
    draw_rectangle,
    draw_text,
    make_svg_figure,
    text_pieces,
)
from pom.report.case.panel_drawing import (
    Box,
    StripStyle,
    clear_line,
    draw_residuals_below,
    draw_tolerance,
    draw_window_and_traces,
    mark_models_beyond_scale,
)
from pom.report.case.panels import CasePanel, panel_description
from pom.report.presentation.quantities import SYMBOLS, fixed_decimals

LEFT, RIGHT, HEAD, FOOT = 54.0, 12.0, 17.0, 30.0
# Height of the panels of a page: A4 without margins and caption, `WIDTH` units across 180 mm.
PAGE = 960.0
# Heights of a judged panel, of its strip of differences, and of any other panel.
MAIN, STRIP, SMALL, GAP = 170.0, 38.0, 66.0, 5.0
TOP = 24.0  # height of the legend
_STRIP_STYLE = StripStyle(y_ticks=(-1.0, 0.0, 1.0), x_most=8, label_x=6, gap=GAP, marks_beyond=True)


def draw_case_figures(
    key: str,
    time: np.ndarray,
    panels: Sequence[CasePanel],
    styles: Mapping[str, str],
    events: Mapping[str, float] | None = None,
) -> list[str]:
    """Return the figures of a case, each at most one page high.

    The judged channels and the inputs come first, the other channels follow on further pages.

    Parameters
    ----------
    key : str
        Unique name of the case in the page.
    time : array (time,)
        Clock of the record. [s]
    panels : sequence of CasePanel
    styles : mapping of str to str
        Run name to the class of its line.
    events : mapping of str to float, optional
        Name to instant, marked in every panel. [s]
    """
    first: list[CasePanel] = []
    further: list[CasePanel] = []
    for panel in panels:
        group = further if panel.kind == "shown" else first
        group.append(panel)
    figures = []
    for i, page in enumerate([*_paginate(first), *_paginate(further)]):
        figures.append(
            _draw_figure(f"{key}-{i}", time, panels=page, styles=styles, events=events or {})
        )
    return figures


def _panel_height(panel: CasePanel) -> float:
    main = MAIN if panel.kind == "judged" else SMALL
    strip = STRIP + GAP if panel.half is not None else 0.0
    return HEAD + main + strip + GAP


def _paginate(panels: Sequence[CasePanel]) -> list[list[CasePanel]]:
    """Return the panels of every page."""
    pages: list[list[CasePanel]] = []
    room = 0.0
    for panel in panels:
        need = _panel_height(panel)
        if not pages or need > room:
            pages.append([])
            # The panels of a page that is up to 35 % too high are made lower by `_draw_figure`.
            room = 1.35 * (PAGE - FOOT)
        pages[-1].append(panel)
        room -= need
    return pages


def _draw_figure(
    name: str,
    time: np.ndarray,
    panels: Sequence[CasePanel],
    styles: Mapping[str, str],
    events: Mapping[str, float],
) -> str:
    """Return one page of panels."""
    # Only the bodies of the panels shrink, not their headings.
    heads = len(panels) * (HEAD + GAP) + FOOT + TOP
    bodies = sum(_panel_height(panel) - HEAD - GAP for panel in panels)
    scale = min(1.0, (PAGE - heads) / bodies)
    parts, top = [_draw_legend(panels, styles)], TOP
    event_names, boxes = _name_events(time, events)
    for i, panel in enumerate(panels):
        body, top = _draw_panel(
            f"{name}-{i}",
            time,
            panel=panel,
            styles=styles,
            top=top,
            scale=scale,
            last=i == len(panels) - 1,
            names=[] if i else boxes,
        )
        parts.append(body)
    parts += [_draw_events(time, top - GAP, events), event_names]
    middle = LEFT + (WIDTH - LEFT - RIGHT) / 2
    parts.append(draw_text(middle, top + 22, "time, s (clock of the record)", "caption", "middle"))
    description = " ".join([f"{panel_description(panel)}." for panel in panels])
    return make_svg_figure(top + FOOT, "".join(parts), description)


def _draw_legend(panels: Sequence[CasePanel], styles: Mapping[str, str]) -> str:
    """Return the line code of the runs, and the samples of band and exit."""
    present = {"applied"}
    for panel in panels:
        present.update(panel.traces)
    parts, x = [], LEFT
    for run, style in styles.items():
        if run == "applied" or run not in present:
            continue
        parts.append(draw_line(x, 9, x + 30, 9, f"trace {style}"))
        parts.append(draw_text(x + 35, 12.5, run, "caption"))
        # 6.4 units are about the width of a character.
        x += 52 + 6.4 * len(run)
    if any(panel.half is not None for panel in panels):
        parts += [
            draw_rectangle(x, 4, 26, 10, "band"),
            draw_text(x + 31, 12.5, "tolerance", "caption"),
            draw_rectangle(x + 96, 4, 26, 10, "exit"),
            draw_text(x + 127, 12.5, "outside", "caption"),
        ]
    return "".join(parts)


def _draw_events(time: np.ndarray, bottom: float, events: Mapping[str, float]) -> str:
    """Return a line through all panels at every event."""
    frame = _all_panels(time, bottom)
    parts = []
    for instant in events.values():
        if time[0] < instant < time[-1]:
            x = float(frame.px(instant))
            parts.append(draw_line(x, frame.top, x, frame.bottom, "event"))
    return "".join(parts)


def _name_events(time: np.ndarray, events: Mapping[str, float]) -> tuple[str, list[Box]]:
    """Return the names of the events at the top of the first panel, and their boxes."""
    frame = _all_panels(time, TOP + HEAD + 1.0)
    parts: list[str] = []
    boxes: list[Box] = []
    for name, instant in events.items():
        if time[0] < instant < time[-1]:
            x, text = float(frame.px(instant)) + 3, name.replace("_", " ")
            y = clear_line(x, frame.top + 9, text, "start", inward=11.0, taken=boxes)
            parts.append(draw_text(x, y, text, "tick halo"))
    return "".join(parts), boxes


def _all_panels(time: np.ndarray, bottom: float) -> Frame:
    """Return a frame over all panels of a page."""
    limits = (float(time[0]), float(time[-1]))
    return Frame(
        LEFT, TOP + HEAD, WIDTH - LEFT - RIGHT, height=bottom - TOP - HEAD, x=limits, y=(0.0, 1.0)
    )


def _draw_panel(
    name: str,
    time: np.ndarray,
    panel: CasePanel,
    styles: Mapping[str, str],
    top: float,
    scale: float,
    last: bool,
    names: Sequence[Box],
) -> tuple[str, float]:
    """Return a panel with its strip of differences, and the upper edge of the next one."""
    height = (MAIN if panel.kind == "judged" else SMALL) * scale
    x_limits = (float(time[0]), float(time[-1]))
    frame = Frame(LEFT, top + HEAD, WIDTH - LEFT - RIGHT, height=height, x=x_limits, y=panel.scale)
    content = draw_tolerance(frame, time, panel, styles)
    content += draw_window_and_traces(frame, time, panel, styles)
    parts = [
        _draw_heading(panel, top + 12),
        draw_axes(frame, x_labels=last and panel.half is None),
        clip_to_frame(frame, name, content),
        mark_models_beyond_scale(frame, time, panel, styles, names),
    ]
    residuals, bottom = draw_residuals_below(
        frame,
        name,
        time,
        panel=panel,
        styles=styles,
        strip_style=_STRIP_STYLE,
        height=STRIP * scale,
        with_time=last,
    )
    return "".join([*parts, residuals]), bottom + GAP


def _draw_heading(panel: CasePanel, y: float) -> str:
    """Return the quantity at the left, and verdict and ratio of every model at the right."""
    label, pieces = panel.label, []
    if not label.is_word:
        pieces.append((label.base, "symbol"))
        if label.sub:
            pieces.append((label.sub, "sub"))
        pieces.append(("\N{EN SPACE}", ""))
    unit = f", {label.unit}" if label.unit else ""
    pieces.append((f"{label.words or label.name}{unit}", "title"))
    heading = text_pieces(LEFT, y, pieces)
    verdicts = []
    for row in panel.rows:
        if row["measure"] == "trace":
            ratio = fixed_decimals(row["worst_ratio"], 2)
            verdicts.append(f"{row['run']} {SYMBOLS[row['verdict']]} {ratio}")
    if not verdicts:
        return heading
    return heading + draw_text(WIDTH - RIGHT, y, "\N{EM SPACE}".join(verdicts), "caption", "end")
