"""Panels of a case for paper, each a separate SVG with its alternative text.

Order of drawing: tolerance band, exits, flight above the band, models, and the flight again as a
hair line, so that no model hides it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_axes,
    draw_line,
    draw_rectangle,
    draw_text,
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
from pom.report.case.panels import CasePanel, panel_description, scale_limits
from pom.report.pdf.style import HEAD, LEFT, RIGHT, SPACE, Drawing, svg_drawing, title_pieces
from pom.report.presentation.quantities import fixed_decimals
from pom.report.presentation.verdict_text import WORDS

# Gap between panels, strip of differences, time axis at the foot of a page.
GAP, STRIP, FOOT = 3.0, 24.0, 27.0
_STRIP_STYLE = StripStyle(y_ticks=(-1.0, 1.0), x_most=10, label_x=4, gap=GAP, marks_beyond=False)
SQUEEZED = 2.0  # scale of the whole record over that of the window
LEAST, MOST = 30.0, 160.0  # height of an input panel
MOST_PANELS = 7  # on a page
JUDGED = 2.0  # height of a judged panel, in heights of an input panel


def arrange_panels(panels: Sequence[CasePanel], room: float) -> tuple[int, float]:
    """Return the number of panels on a page with `room` units of height, and the panel height.

    The height is that of an input panel.  Both are zero if not even one panel fits.
    """
    for count in range(min(MOST_PANELS, len(panels)), 0, -1):
        shares, margins = [], []
        for panel in panels[:count]:
            shares.append(_panel_share(panel))
            strip = STRIP + GAP if panel.half is not None else 0.0
            margins.append(HEAD + GAP + strip)
        height = (room - FOOT - sum(margins)) / sum(shares)
        if height >= LEAST:
            return count, min(height, MOST)
    return 0, 0.0


def _panel_share(panel: CasePanel) -> float:
    return JUDGED if panel.kind == "judged" else 1.0


def draw_case_panel(
    name: str,
    time: np.ndarray,
    panel: CasePanel,
    styles: Mapping[str, str],
    events: Mapping[str, float],
    height: float,
    first: bool,
    last: bool,
) -> Drawing:
    """Return the drawing of one panel.

    Parameters
    ----------
    name : str
        Identifier of the clipping paths, unique in the document.
    time : array (time,)
        Clock of the record. [s]
    panel : CasePanel
    styles : mapping of str to str
        Run to the class of its line.
    events : mapping of str to float
        Name to instant. [s]
    height : float
        Height of an input panel. [unit]
    first : bool
        Print the names of the events.
    last : bool
        Print the time axis of the page.
    """
    x_limits = (float(time[0]), float(time[-1]))
    scaled = _scale_to_window(panel)
    body_height = height * _panel_share(panel)
    width = WIDTH - LEFT - RIGHT
    frame = Frame(LEFT, HEAD, width, height=body_height, x=x_limits, y=scaled.limits)
    content = _draw_content(frame, time, scaled, styles)
    event_lines, names = _draw_events(frame, time, events, named=first)
    parts = [
        _draw_heading(scaled),
        draw_axes(frame, x_labels=last and scaled.half is None, x_most=10),
        clip_to_frame(frame, name, content),
        event_lines,
        mark_models_beyond_scale(frame, time, panel, styles, names),
    ]
    residuals, bottom = draw_residuals_below(
        frame,
        name,
        time,
        panel=scaled,
        styles=styles,
        strip_style=_STRIP_STYLE,
        height=STRIP,
        with_time=last,
    )
    parts.append(residuals)
    if last:
        parts.append(_draw_time_label(bottom))
    full_height = bottom + (FOOT if last else GAP)
    svg = svg_drawing(full_height, "".join(parts))
    return Drawing(svg, full_height, panel_description(scaled))


def _draw_time_label(bottom: float) -> str:
    middle = LEFT + (WIDTH - LEFT - RIGHT) / 2
    return draw_text(middle, bottom + 23.5, "time, s (clock of the record)", "caption", "middle")


def _scale_to_window(panel: CasePanel) -> CasePanel:
    """Return a judged panel on the scale of its window if the other samples would squeeze it.

    Samples outside the window that leave this scale are removed.
    """
    if panel.half is None:
        return panel
    inside = np.isfinite(panel.half)
    window_traces = {run: values[inside] for run, values in panel.traces.items()}
    limits = scale_limits(window_traces, panel.half[inside], panel.label.least_span)
    if not panel.limits[1] - panel.limits[0] > SQUEEZED * (limits[1] - limits[0]):
        return panel
    traces = {}
    # Outside the window only samples on the scale are drawn.
    for run, values in panel.traces.items():
        visible = inside | ((values >= limits[0]) & (values <= limits[1]))
        traces[run] = np.where(visible, values, np.nan)
    return replace(panel, limits=limits, traces=traces)


def _draw_heading(panel: CasePanel) -> str:
    """Return the quantity at the left, and verdict and ratio of every model at the right."""
    heading = text_pieces(LEFT, HEAD - 4.0, title_pieces(panel.label))
    rows = [row for row in panel.rows if row["measure"] == "trace"]
    rows.sort(key=lambda row: float(np.nan_to_num(row["worst_ratio"])))
    # Of several criteria on the channel the worst one remains, since it comes last.
    worst = {row["run"]: row for row in rows}
    pieces: list[tuple[str, str]] = []
    for run in panel.traces:
        if run not in worst:
            continue
        verdict = worst[run]["verdict"]
        gap = 3 * SPACE if pieces else ""
        pieces += [
            (f"{gap}{run} ", "caption"),
            (WORDS[verdict], "title" if verdict == "fail" else "caption"),
            (f" {fixed_decimals(worst[run]['worst_ratio'], 2)}", "caption"),
        ]
    if not pieces:
        return heading
    return heading + text_pieces(WIDTH - RIGHT, HEAD - 4.0, pieces, "end")


def _draw_content(
    frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]
) -> str:
    """Return band, exits, quantiles, judged values, window, traces and mode of a panel."""
    return draw_tolerance(frame, time, panel, styles) + draw_window_and_traces(
        frame, time, panel, styles
    )


def _draw_events(
    frame: Frame, time: np.ndarray, events: Mapping[str, float], named: bool
) -> tuple[str, list[Box]]:
    """Return a line at every event inside the record, with its name on request.

    The second value has the boxes of the names.
    """
    parts: list[str] = []
    boxes: list[Box] = []
    for name, instant in sorted(events.items(), key=lambda item: item[1]):
        if not time[0] < instant < time[-1]:
            continue
        x = float(frame.px(instant))
        parts.append(draw_line(x, frame.top, x, frame.bottom, "event"))
        if named:
            # Near the right edge the name is at the left of its line.  Heights alternate.
            anchor, shift = "start", 3
            if x > frame.left + 0.85 * frame.width:
                anchor, shift = "end", -3
            text = name.replace("_", " ")
            y = frame.top + 9
            y = clear_line(x + shift, y, text, anchor, inward=10.0, taken=boxes)
            parts.append(draw_text(x + shift, y, text, "tick halo", anchor))
    return "".join(parts), boxes


def draw_legend(styles: Mapping[str, str]) -> Drawing:
    """Return the line code of a case, with samples of band, exit and window."""
    # Name, width and drawing of every sample.
    samples = []
    for run, style in styles.items():
        samples.append((run, 30.0, draw_line(0, 8, 30, 8, f"trace {style}")))
    samples += [
        ("tolerance", 30.0, draw_rectangle(0, 2.5, 30, 11, "band")),
        ("out of tolerance", 30.0, draw_rectangle(0, 2.5, 30, 11, "exit")),
        ("window", 4.0, draw_line(2, 1, 2, 15, "window")),
    ]
    parts, x, y = [], 0.0, 0.0
    for name, width, sample in samples:
        # 5 units are about the width of a character.
        needed = width + 20.0 + 5.0 * len(name)
        if x + needed > WIDTH and x > 0.0:
            x, y = 0.0, y + 15.0
        label = draw_text(width + 4, 11.5, name, "caption")
        parts.append(f'<g transform="translate({x:.1f},{y:.1f})">{sample}{label}</g>')
        x += needed
    names = ", ".join([name for name, _, _ in samples])
    return Drawing(svg_drawing(y + 16.0, "".join(parts)), y + 16.0, f"Line code: {names}")
