"""Panels for paper: one SVG per panel, so that each carries its own alternative text.

Built from the primitives of `flightmech.support.figures`; lengths are its units, 720 of them across
the column (182 mm on A4), so that text of 10 units is 7.2 pt.  Order of drawing: band, exits,
flight on top of the band, models, and the flight again as a hair line, so that no model hides it.
What must be seen in grey has a pattern or a dash in addition to its colour.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from flightmech.support.figures import (
    WIDTH,
    Frame,
    choose_ticks,
    clip_to_frame,
    draw_area,
    draw_axes,
    draw_curve,
    draw_line,
    draw_rectangle,
    draw_text,
    text_pieces,
    tick_text,
)
from pom.diagnosis.waterfall import OTHERS
from pom.diagnosis.waterfall import waterfall as steps_of
from pom.report.case.panels import CasePanel, Cross, panel_description, scale_limits
from pom.report.presentation.quantities import (
    QuantityLabel,
    fixed_decimals,
    pretty_unit,
    term_words,
)
from pom.report.presentation.traces import LANE, beyond_scale_mark, exit_ticks, quantile_areas
from pom.report.presentation.verdict_text import WORDS, criterion_words

FAMILY = "Source Sans Pro"
BAND, EDGE, EXIT, GRID, QUIET = "#dbe9f6", "#7ea6cc", "#d55e00", "#dedede", "#444444"
# class -> colour, dash, width: the line code of LR-743 Figs. 18 to 21, then two spare styles
LINES = {
    "run-0": ("#000000", "", 1.7),
    "run-1": ("#5e5e5e", "1.6 2.4", 1.8),
    "run-2": ("#8a5a00", "7 3", 1.4),
    "run-3": ("#0072b2", "9 2.6 1.8 2.6", 1.4),
    "run-4": ("#7a3e9d", "13 4", 1.4),
    "run-5": ("#00664b", "9 2.6 1.8 2.6 1.8 2.6", 1.4),
}

_STYLE = f"""
text{{font-family:"{FAMILY}";font-size:10.6px;fill:#000}}
.tick,.tick text{{font-size:10.2px;fill:#222}}
.caption{{font-size:10.6px;fill:#222}}
.title{{font-size:10.6px;font-weight:600}}
.symbol{{font-size:11.5px;font-style:italic}}
.sub{{font-size:10px}}
.halo{{paint-order:stroke;stroke:#fff;stroke-width:3;stroke-linejoin:round;fill:#000}}
.grid{{fill:none;stroke:{GRID};stroke-width:.5}}
.frame{{fill:none;stroke:{QUIET};stroke-width:.7}}
.window{{stroke:{QUIET};stroke-width:.8;stroke-dasharray:2 2}}
.event{{stroke:{QUIET};stroke-width:.7}}
.band{{fill:{BAND};stroke:{EDGE};stroke-width:.6}}
.exit{{fill:url(#hatching)}}
.trace{{fill:none;stroke-linejoin:round}}
.fan{{stroke:none;fill-opacity:.24}}
.hair{{fill:none;stroke:#000;stroke-width:.45;stroke-linejoin:round}}
.lane{{stroke-width:2.4}}
.error{{stroke:none;fill-opacity:.18}}
.node{{fill:none;stroke-width:2.4;stroke-linecap:round}}
.node.hollow{{stroke:#fff;stroke-width:1.2}}
.rug{{stroke:{QUIET};stroke-width:.6}}
.test-point{{stroke:#0072b2;stroke-width:2.2;stroke-linecap:round}}
.tickmark{{stroke:{EXIT};stroke-width:1.4}}
.arrow{{stroke:none}}
.bar{{fill:#9db8d2;stroke:#1f4e79;stroke-width:.7}}
.rise{{fill:url(#hatching);stroke:{EXIT};stroke-width:.7}}
.total{{fill:#4d4d4d}}
.joint{{stroke:{QUIET};stroke-width:.6;stroke-dasharray:2 2}}
"""
_HATCHING = (
    '<pattern id="hatching" width="5" height="5" patternUnits="userSpaceOnUse" '
    'patternTransform="rotate(45)">'
    f'<rect width="5" height="5" fill="{EXIT}" fill-opacity=".2"/>'
    f'<line x1="0" y1="0" x2="0" y2="5" stroke="{EXIT}" stroke-width="1.3"/></pattern>'
)


def style_definitions() -> str:
    """Return styles and patterns, to stand at the head of every drawing."""
    lines = ""
    for name, (colour, dash, width) in LINES.items():
        dashes = f";stroke-dasharray:{dash}" if dash else ""
        lines += f".{name}{{stroke:{colour}}}.trace.{name}{{stroke-width:{width}{dashes}}}.arrow.{name},.{name}-area{{fill:{colour}}}"
    return f"<style>{_STYLE}{lines}</style><defs>{_HATCHING}</defs>"


LEFT, RIGHT = 50.0, 6.0
HEAD, GAP, STRIP, FOOT = 15.0, 3.0, 24.0, 27.0
RESIDUAL = 1.6
SQUEEZED = 2.0  # scale of the whole record over that of the window
LEAST, MOST = 30.0, 160.0  # height of an input panel
MOST_PANELS = 7  # on a page
_INSTANTS = ("end_value", "steady")
# the font has no wider one, and one glyph from elsewhere changes the font of its whole line
_SPACE = "\N{NO-BREAK SPACE}"
JUDGED = 2.0  # a judged panel has so many heights of an input panel


@dataclass(frozen=True)
class Drawing:
    """An SVG with its height in units and its alternative text."""

    svg: str
    height: float
    words: str


def arrange_panels(panels: Sequence[CasePanel], room: float) -> tuple[int, float]:
    """Return how many of the panels go on a page with `room` units of height, and the height of an
    input panel there.
    """
    for count in range(min(MOST_PANELS, len(panels)), 0, -1):
        chosen = panels[:count]
        shares = sum(JUDGED if panel.kind == "judged" else 1.0 for panel in chosen)
        height = (
            room
            - FOOT
            - sum(HEAD + GAP + (STRIP + GAP if panel.half is not None else 0.0) for panel in chosen)
        ) / shares
        if height >= LEAST:
            return count, min(height, MOST)
    return 0, 0.0


def draw_case_panel(
    name: str,
    time: np.ndarray,
    panel: CasePanel,
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
    parts = [_head(panel), draw_axes(frame, x_labels=last and panel.half is None, x_most=10)]
    parts += [
        clip_to_frame(frame, name, _inside(frame, time, panel, styles)),
        _marks(frame, time, events, first),
    ]
    clear = Frame(
        frame.left,
        frame.top,
        frame.width,
        main - LANE * sum(map(bool, panel.exits.values())),
        x,
        panel.limits,
    )
    parts += [
        beyond_scale_mark(clear, time, values, styles[run])
        for run, values in whole.traces.items()
        if run != "flight"
    ]
    bottom = frame.bottom
    if panel.half is not None:
        low = Frame(LEFT, bottom + GAP, frame.width, STRIP, x, (-RESIDUAL, RESIDUAL))
        parts += [
            exit_ticks(frame, panel.exits, styles),
            _residual(low, f"{name}-e", time, panel, panel.half, styles, last),
        ]
        bottom = low.bottom
    if last:
        parts.append(
            draw_text(
                LEFT + frame.width / 2,
                bottom + 23.5,
                "time, s (clock of the record)",
                "caption",
                "middle",
            )
        )
    full = bottom + (FOOT if last else GAP)
    return Drawing(svg_drawing(full, "".join(parts)), full, panel_description(panel))


def _scaled(panel: CasePanel) -> CasePanel:
    """Return a judged panel on the scale of its window, where the rest would squeeze it; of the
    rest what leaves the scale is left out.
    """
    if panel.half is None:
        return panel
    inside = np.isfinite(panel.half)
    own = scale_limits(
        {run: values[inside] for run, values in panel.traces.items()},
        panel.half[inside],
        panel.label.least_span,
    )
    squeezed = panel.limits[1] - panel.limits[0] > SQUEEZED * (own[1] - own[0])
    if not squeezed:
        return panel
    fits = {
        run: inside | ((values >= own[0]) & (values <= own[1]))
        for run, values in panel.traces.items()
    }
    return replace(
        panel,
        limits=own,
        traces={run: np.where(fits[run], values, np.nan) for run, values in panel.traces.items()},
    )


def svg_drawing(height: float, body: str) -> str:
    """Return a whole drawing with the styles of the paper."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} '
        f'{height:.1f}">{style_definitions()}{body}</svg>'
    )


def _head(panel: CasePanel) -> str:
    shown = panel.label
    pieces = (
        []
        if shown.is_word
        else [
            (shown.base, "symbol"),
            *([(shown.sub, "sub")] if shown.sub else []),
            (2 * _SPACE, ""),
        ]
    )
    pieces.append(
        (f"{shown.words or shown.name}{f', {shown.unit}' if shown.unit else ''}", "title")
    )
    body = text_pieces(LEFT, HEAD - 4.0, pieces)
    traced = sorted(
        (row for row in panel.rows if row["measure"] == "trace"),
        key=lambda row: float(np.nan_to_num(row["worst_ratio"])),
    )
    worst = {row["run"]: row for row in traced}  # of several criteria on the channel the worst
    rows = [worst[run] for run in panel.traces if run in worst]
    words: list[tuple[str, str]] = []
    for row in rows:
        gap, verdict = 3 * _SPACE if words else "", row["verdict"]
        words += [
            (f"{gap}{row['run']} ", "caption"),
            (WORDS[verdict], "title" if verdict == "fail" else "caption"),
        ]
        words.append((f" {fixed_decimals(row['worst_ratio'], 2)}", "caption"))
    return body + (text_pieces(WIDTH - RIGHT, HEAD - 4.0, words, "end") if words else "")


def _inside(frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]) -> str:
    parts, flight = [], panel.traces.get("flight")
    if panel.half is not None and flight is not None:
        low, high = flight - panel.half, flight + panel.half
        parts.append(draw_area(frame, time, low, high, "band"))
        parts += [
            _exceedance(frame, time, values, low, high)
            for run, values in panel.traces.items()
            if panel.exits.get(run)
        ]
    parts += [
        quantile_areas(frame, time, quantiles, styles[run]) for run, quantiles in panel.fans.items()
    ]
    parts.append(_scalars(frame, time, panel))
    if panel.window:
        parts += [
            draw_line(float(frame.px(t)), frame.top, float(frame.px(t)), frame.bottom, "window")
            for t in panel.window
        ]
    curves = {
        run: draw_curve(frame, time, values, f"trace {styles[run]}")
        for run, values in panel.traces.items()
    }
    parts += curves.values()
    if len(curves) > 1 and "flight" in curves:
        parts.append(curves["flight"].replace(f"trace {styles['flight']}", "hair"))
    return "".join(parts)


def _exceedance(
    frame: Frame, time: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray
) -> str:
    """Return the hatched area between band and trace where the trace is outside."""
    with np.errstate(invalid="ignore"):
        above, below = np.where(values > high, values, high), np.where(values < low, values, low)
        sides = ((high, above, values > high), (below, low, values < low))
    shapes = ""
    for a, b, out in sides:
        wide = out | np.roll(out, 1) | np.roll(out, -1)
        shapes += draw_area(
            frame, time, np.where(wide, a, np.nan), np.where(wide, b, np.nan), "exit"
        )
    return shapes


def _marks(frame: Frame, time: np.ndarray, events: Mapping[str, float], named: bool) -> str:
    parts = []
    for i, (name, at) in enumerate(sorted(events.items(), key=lambda item: item[1])):
        if time[0] < at < time[-1]:
            x = float(frame.px(at))
            anchor, shift = ("end", -3) if x > frame.left + 0.85 * frame.width else ("start", 3)
            parts.append(draw_line(x, frame.top, x, frame.bottom, "event"))
            if named:
                parts.append(
                    draw_text(
                        x + shift,
                        frame.top + 9 + 10 * (i % 2),
                        name.replace("_", " "),
                        "tick halo",
                        anchor,
                    )
                )
    return "".join(parts)


def _scalars(frame: Frame, time: np.ndarray, panel: CasePanel) -> str:
    """Return a bar of tolerance about the flight value of what is judged at one instant."""
    parts = []
    for at, half in {
        (row["at"], row["width"])
        for row in panel.rows
        if row["measure"] in _INSTANTS and pretty_unit(row["unit"]) == panel.label.unit
    }:
        if "flight" in panel.traces and np.isfinite(at) and np.isfinite(half):
            x, middle = float(frame.px(at)), float(np.interp(at, time, panel.traces["flight"]))
            low, high = (float(frame.py(middle + side * half)) for side in (-1.0, 1.0))
            parts.append(draw_rectangle(x - 3.0, high, 6.0, low - high, "band"))
    return "".join(sorted(parts))


def _residual(
    frame: Frame,
    name: str,
    time: np.ndarray,
    panel: CasePanel,
    half: np.ndarray,
    styles: Mapping[str, str],
    last: bool,
) -> str:
    """Return the strip of differences over tolerance."""
    flight, unit_band = panel.traces["flight"], np.where(np.isfinite(half), 1.0, np.nan)
    parts = [draw_axes(frame, x_labels=last, x_most=10, y_ticks=(-1.0, 1.0))]
    parts.append(draw_text(4, frame.top + frame.height / 2 + 3.5, "e/t", "caption"))
    body = draw_area(frame, time, -unit_band, unit_band, "band")
    for run, values in panel.traces.items():
        if run != "flight":
            with np.errstate(invalid="ignore", divide="ignore"):
                ratio = np.where(half > 0, (values - flight) / half, np.nan)
            body += draw_curve(frame, time, ratio, f"trace {styles[run]}")
    return "".join(parts) + clip_to_frame(frame, name, body)


def draw_legend(styles: Mapping[str, str]) -> Drawing:
    """Return the line code of a case with the samples of band, exit and window."""
    samples = [
        (run, 30.0, draw_line(0, 8, 30, 8, f"trace {style}")) for run, style in styles.items()
    ]
    samples += [
        ("tolerance", 30.0, draw_rectangle(0, 2.5, 30, 11, "band")),
        ("out of tolerance", 30.0, draw_rectangle(0, 2.5, 30, 11, "exit")),
    ]
    samples.append(("window", 4.0, draw_line(2, 1, 2, 15, "window")))
    parts, x, y = [], 0.0, 0.0
    for name, wide, sample in samples:
        needed = wide + 20.0 + 5.0 * len(name)
        if x + needed > WIDTH and x > 0.0:
            x, y = 0.0, y + 15.0
        parts.append(
            f'<g transform="translate({x:.1f},{y:.1f})">{sample}{draw_text(wide + 4, 11.5, name, "caption")}</g>'
        )
        x += needed
    return Drawing(
        svg_drawing(y + 16.0, "".join(parts)),
        y + 16.0,
        "Line code: " + ", ".join(name for name, _, _ in samples),
    )


HEIGHT, CROSS_PLOT_FOOT, MARGIN = 230.0, 30.0, 0.05


def cross_drawing(
    name: str, cross: Cross, styles: Mapping[str, str], rows: Sequence[Mapping[Hashable, Any]]
) -> Drawing:
    """Return a cross plot.

    Parameters
    ----------
    name : str
        Unique in the document; it names a clipping path.
    styles : mapping of str to str
        Run to the class of its line.
    rows : sequence of mapping
        Verdict rows of the case, for the alternative text.
    """
    flight_x, flight_y = cross.x["flight"], cross.y["flight"]
    half = np.where(np.isfinite(cross.half), cross.half, 0.0)
    x = _limits(cross.x.values())
    y = _limits([*cross.y.values(), flight_y - half, flight_y + half])
    frame = Frame(LEFT, HEAD, WIDTH - LEFT - RIGHT, HEIGHT, x, y)
    body = (
        _path(
            frame,
            np.append(flight_x, flight_x[::-1]),
            np.append(flight_y + half, (flight_y - half)[::-1]),
            "band",
            "z",
        )
        if half.any()
        else ""
    )
    body += "".join(
        _path(frame, cross.x[run], cross.y[run], f"trace {styles[run]}") for run in cross.x
    )
    body += _path(frame, flight_x, flight_y, "hair")
    parts = [
        text_pieces(LEFT, HEAD - 4.0, _title(cross.ordinate)),
        draw_axes(frame, x_labels=True, x_most=10),
        clip_to_frame(frame, name, body),
    ]
    parts.append(
        draw_text(
            LEFT + frame.width / 2, frame.bottom + 24.0, _words(cross.abscissa), "caption", "middle"
        )
    )
    judged = [f"{row['run']}: {criterion_words(row['criterion'])} {row['verdict'].replace('_', ' ')}, "
        f"{fixed_decimals(row['worst_ratio'], 2)} of the tolerance"
            for row in rows if row["criterion"] in cross.criteria]  # fmt: skip
    return Drawing(
        svg_drawing(frame.bottom + CROSS_PLOT_FOOT, "".join(parts)),
        frame.bottom + CROSS_PLOT_FOOT,
        ". ".join([cross.words, *judged]),
    )


def _limits(values: Any) -> tuple[float, float]:
    joined = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = (float(joined.min()), float(joined.max())) if joined.size else (0.0, 1.0)
    pad = MARGIN * ((high - low) or max(abs(high), 1.0))
    return low - pad, high + pad


def _path(frame: Frame, x: np.ndarray, y: np.ndarray, css: str, end: str = "") -> str:
    """Return a line through points whose abscissa may turn back; points nearer than half a unit to
    the last one are left out.
    """
    good = np.isfinite(x) & np.isfinite(y)
    px, py = frame.px(x[good]), frame.py(y[good])
    kept: list[tuple[float, float]] = []
    for point in zip(px.tolist(), py.tolist(), strict=True):
        if not kept or abs(point[0] - kept[-1][0]) + abs(point[1] - kept[-1][1]) > 0.5:
            kept.append(point)
    return (
        f'<path class="{css}" d="M{" ".join(f"{a:.1f},{b:.1f}" for a, b in kept)}{end}"/>'
        if kept
        else ""
    )


def _title(shown: QuantityLabel) -> list[tuple[str, str]]:
    pieces = (
        []
        if shown.is_word
        else [
            (shown.base, "symbol"),
            *([(shown.sub, "sub")] if shown.sub else []),
            (2 * "\N{NO-BREAK SPACE}", ""),
        ]
    )
    return [*pieces, (_words(shown), "title")]


def _words(shown: QuantityLabel) -> str:
    return f"{shown.words or shown.name}{f', {shown.unit}' if shown.unit else ''}"


WATERFALL_LEFT, WATERFALL_RIGHT, ROW, WATERFALL_HEAD = 350.0, 96.0, 16.0, 16.0


def draw_waterfall(table: pd.DataFrame) -> Drawing | None:
    """Draw the Shapley shares of a diagnosis as steps of the total mismatch.

    Parameters
    ----------
    table : DataFrame
        From `pom.diagnose`.

    Returns
    -------
    Drawing or None
        None when the diagnosis has no shares: the a-priori model passes, or the final one is no
        better.
    """
    steps = steps_of(table).dropna(subset=["start", "stop"]).to_dict("records")
    if not steps:
        return None
    bars = [("a-priori model", 0.0, steps[0]["start"], "total", "")]
    for step in steps:
        css = "bar" if step["stop"] <= step["start"] else "rise"
        bars.append(
            (
                _called(str(step["term"])),
                step["start"],
                step["stop"],
                css,
                _share(step["explained"], step["stderr"]),
            )
        )
    bars.append(("final model", 0.0, steps[-1]["stop"], "total", ""))
    edges = np.array([(start, stop) for _, start, stop, _, _ in bars])
    low, high = float(min(edges.min(), 0.0)), float(edges.max()) * 1.02
    scale = (WIDTH - WATERFALL_LEFT - WATERFALL_RIGHT) / ((high - low) or 1.0)

    def at(mismatch: float) -> float:
        return WATERFALL_LEFT + (mismatch - low) * scale

    bottom, marks = WATERFALL_HEAD + ROW * len(bars), choose_ticks(low, high, 5)
    parts = [draw_line(at(x), WATERFALL_HEAD - 3, at(x), bottom, "grid") for x in marks]
    parts += [
        draw_text(at(x), WATERFALL_HEAD - 5, word, "tick", "middle")
        for x, word in zip(marks, tick_text(marks), strict=True)
    ]
    parts.append(
        draw_text(
            WATERFALL_LEFT - 20,
            WATERFALL_HEAD - 5,
            "total mismatch, in half widths",
            "caption",
            "end",
        )
    )
    for i, (name, start, stop, css, share) in enumerate(bars):
        y = WATERFALL_HEAD + ROW * i
        a, b = sorted((at(start), at(stop)))
        parts += [
            draw_text(WATERFALL_LEFT - 8, y + 11.5, _fit(name), "", "end"),
            draw_rectangle(a, y + 2.5, max(b - a, 1.0), ROW - 5.0, css),
        ]
        parts.append(draw_text(b + 5, y + 11.5, share or fixed_decimals(stop, 2), "tick"))
        if i + 1 < len(bars):
            parts.append(draw_line(at(stop), y + ROW - 2.5, at(stop), y + ROW + 2.5, "joint"))
    steps_in_words = "; ".join(
        f"{name}: {share or fixed_decimals(stop, 2)}" for name, _, stop, _, share in bars
    )
    alternative = f"Shares of the terms in the total mismatch, in half widths. {steps_in_words}."
    return Drawing(svg_drawing(bottom + 3.0, "".join(parts)), bottom + 3.0, alternative)


def _called(term: str) -> str:
    if term == OTHERS:
        return "all other terms together"
    meaning = term_words(term)
    return f"{term}  ({meaning})" if meaning else term


def _share(explained: float, stderr: float) -> str:
    """Return the share of the gap that a term explains, with its standard error when it was
    sampled.
    """
    if not math.isfinite(explained):
        return ""
    tail = (
        f" ± {fixed_decimals(100.0 * stderr, 0)}" if math.isfinite(stderr) and stderr > 0.0 else ""
    )
    return f"explains {fixed_decimals(100.0 * explained, 0)}{tail} %"


def _fit(name: str, most: int = 72) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"
