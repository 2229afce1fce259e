"""Identification: every local model with its estimates, standard errors, collinearity, residual,
and where the flights were.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech.errors import IdentificationError
from flightmech.support.figures import (
    WIDTH,
    Frame,
    choose_ticks,
    clip_to_frame,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_text,
    find_axis_limits,
    make_svg_figure,
    text_pieces,
)
from flighttest.regression.uncertainty.prediction_errors import theil, theil_shares
from pom.report.presentation.quantities import (
    MISSING,
    fixed_decimals,
    format_number,
    quantity_label,
    symbol_parts,
)
from pom.report.presentation.traces import Pack, step_of
from pom.report.submodels.section import Picture

_LEFT, _TOP, _GAP, _FOOT = 50.0, 18.0, 62.0, 30.0
_HIGH, _LOW = 84.0, 40.0  # panel of the coefficient, of its residual
_WIDE = 0.66  # part of the width that the time histories take
_SPACE = "\N{NO-BREAK SPACE}"
_MOST_SAMPLES = 1500  # drawn: a line of 430 units shows no more
_MOST_LAG = 5.0  # [s] of the autocorrelation


def fit_picture(index: int, fit: flighttest.Fit) -> Picture:
    """Return coefficient and residual over the time of the samples, and the autocorrelation of the
    residual.
    """
    name = fit.model.coefficient
    base, sub = symbol_parts(name)
    every = max(1, -(-fit.data.sizes["sample"] // _MOST_SAMPLES))
    along, residual = fit.time_along, fit.residual
    time, rest, measured = along[::every], residual[::every], fit.data[name].values[::every]
    wide = _WIDE * WIDTH - _LEFT
    upper = Frame(
        _LEFT,
        _TOP,
        wide,
        _HIGH,
        (0.0, float(along[-1])),
        find_axis_limits(np.concatenate([measured, measured - rest]), 0.06),
    )
    lower = Frame(_LEFT, upper.bottom + 6.0, wide, _LOW, upper.x, find_axis_limits(rest, 0.06))
    starts = along[1:][np.diff(fit.data["manoeuvre"].values) != 0]
    parts = [
        text_pieces(
            _LEFT,
            _TOP - 5.0,
            [
                (base, "symbol"),
                (sub, "sub"),
                (
                    "\N{NO-BREAK SPACE}\N{NO-BREAK SPACE}measured, and fitted by the local "
                    "model (dashed)",
                    "caption",
                ),
            ],
        ),
        draw_axes(upper, x_labels=False, x_most=8),
        *(
            draw_line(float(frame.px(at)), frame.top, float(frame.px(at)), frame.bottom, "window")
            for frame in (upper, lower)
            for at in starts
        ),
        clip_to_frame(
            upper,
            f"fit-{index}",
            draw_curve(upper, time, measured, "trace run-0")
            + draw_curve(upper, time, measured - rest, "trace run-3"),
        ),
        draw_axes(lower, x_labels=True, x_most=8, y_ticks=choose_ticks(*lower.y, 3)),
        clip_to_frame(lower, f"fit-{index}-e", draw_curve(lower, time, rest, "trace run-0")),
        draw_text(
            _LEFT + wide / 2,
            lower.bottom + 24.0,
            "residual over the time of the samples, s",
            "caption",
            "middle",
        ),
    ]
    lag, correlation, bound = _autocorrelation(fit, along, residual)
    frame = Frame(
        _LEFT + wide + _GAP,
        _TOP,
        WIDTH - _LEFT - wide - _GAP - 8.0,
        lower.bottom - _TOP,
        (0.0, float(lag[-1])),
        (-0.5, 1.05),
    )
    parts += [
        draw_text(frame.left, _TOP - 5.0, "autocorrelation of the residual", "caption"),
        draw_axes(frame, x_labels=True, x_most=5),
    ]
    parts += [
        draw_line(frame.left, float(frame.py(at)), frame.right, float(frame.py(at)), "event")
        for at in (0.0,)
    ]
    parts += [
        draw_line(frame.left, float(frame.py(at)), frame.right, float(frame.py(at)), "window")
        for at in (-bound, bound)
    ]
    parts += [
        clip_to_frame(frame, f"fit-{index}-r", draw_curve(frame, lag, correlation, "trace run-0"))
    ]
    parts += [
        draw_text(frame.left + frame.width / 2, frame.bottom + 24.0, "lag, s", "caption", "middle")
    ]
    rms = format_number(float(np.sqrt(np.mean(residual**2))), 3)
    words = (
        f"{name} of {fit.name}: measured, fitted, residual with an rms of {rms}, its "
        f"autocorrelation"
    )
    return Picture("".join(parts), lower.bottom + _FOOT, words)


def _autocorrelation(
    fit: flighttest.Fit, along: np.ndarray, residual: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return lags [s], biased autocorrelation of the residual over the lags of all manoeuvres, and
    two standard errors of white noise.
    """
    step = float(np.median(np.diff(along)))
    pieces = np.split(
        residual - residual.mean(), np.flatnonzero(np.diff(fit.data["manoeuvre"].values)) + 1
    )
    most = min(round(_MOST_LAG / step), max(map(len, pieces)) - 1)
    total = np.array(
        [sum(float(v[k:] @ v[: len(v) - k]) for v in pieces if len(v) > k) for k in range(most + 1)]
    )
    return (
        step * np.arange(most + 1),
        total / total[0] if total[0] > 0.0 else total,
        2.0 / np.sqrt(len(residual)),
    )


MOST_SAMPLES = 1200  # drawn of one fit: a line of 650 units shows no more
LEAST_CORRELATION = 0.9  # from which two estimates are listed as correlated, as usual in the field
_BAR, _MIDDLE = (
    74.0,
    80.0,
)  # [px] half the length of the bar of an estimate, and where its zero lies
_LINES = 4  # line codes of the 1 g lines
_CELLS = 160  # of the map of test points, in each direction


def identification_chapter(
    fits: Sequence[flighttest.Fit], level_lines: Mapping[str, xr.Dataset], on_paper: bool
) -> dict[str, Any]:
    """Return what page and paper show of the identification.

    Parameters
    ----------
    fits : sequence of Fit
    level_lines : mapping of str to Dataset (mach,)
        1 g lines by what they are of, as `aerodb.figures.one_g_lines` returns them.
    on_paper : bool
        Draw the figures of the fits for paper.

    Returns
    -------
    dict
        ``fits`` (`describe_fits`, with ``drawing``), ``map`` (Picture or None), ``heads`` and ``body``:
        what the script of the page draws, and the traces it points into.
    """
    pack = Pack.empty()
    heads, rows = [_traces(fit, pack) for fit in fits], describe_fits(fits)
    for row, fit in zip(rows, fits, strict=True):
        row["drawing"] = (
            fit_picture(row["index"], fit) if on_paper and "time" in fit.data else None
        )  # published values have no samples
    return {
        "fits": rows,
        "map": sample_map(fits, level_lines),
        "heads": heads,
        "body": bytes(pack.body),
    }


def identification_page(found: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """Return of a `identification_chapter` what the template ``identification.html`` needs, what the script draws,
    and the traces it points into.
    """
    where = found["map"]
    context = {
        "fits": found["fits"],
        "map": make_svg_figure(where.height, where.body, where.words) if where else "",
    }
    return context, {"fits": found["heads"]}, found["body"]


def describe_fits(fits: Sequence[flighttest.Fit]) -> list[dict[str, Any]]:
    """Return what page and paper state of every fit: model, figures of merit, estimates, correlated
    estimates, remarks.
    """
    return [_fit(i, fit) for i, fit in enumerate(fits)]


def _fit(index: int, fit: flighttest.Fit) -> dict[str, Any]:
    found = fit.estimates
    names = [str(name) for name in found["term"].values]
    largest_vif = (
        float(np.nanmax(found["vif"].values))
        if "vif" in found and np.isfinite(found["vif"].values).any()
        else math.nan
    )
    return {
        "index": index,
        "name": fit.name,
        "coefficient": fit.model.coefficient,
        "symbol": symbol_parts(fit.model.coefficient),
        "model": str(fit.model),
        "domain": str(found.attrs.get("domain", "time")),
        "samples": found.attrs.get("samples", fit.data.sizes["sample"]),
        "manoeuvres": found.attrs.get("manoeuvres", 1),
        "R2": fixed_decimals(found.attrs.get("R2"), 4),
        "rms": format_number(found.attrs.get("residual_rms"), 3),
        **_agreement(fit),
        "vif": fixed_decimals(largest_vif, 1),
        "remarks": [str(remark) for remark in fit.remarks],
        "terms": [_term(fit, i, name) for i, name in enumerate(names)],
        "correlated": _correlated(fit, names),
    }


def _agreement(fit: flighttest.Fit) -> dict[str, str]:
    """Return Theil's coefficient and what the residual consists of."""

    measured = fit.data[fit.model.coefficient].values
    predicted = measured - fit.residual
    try:
        shares = theil_shares(measured, predicted)
        return {
            "theil": fixed_decimals(theil(measured, predicted), 3),
            "shares": " / ".join(fixed_decimals(100.0 * share, 0) for share in shares),
        }
    except IdentificationError:
        return {"theil": MISSING, "shares": MISSING}


def _term(fit: flighttest.Fit, index: int, name: str) -> dict[str, Any]:
    found = fit.estimates.isel(term=index)

    def of(variable: str) -> float:
        return float(found[variable]) if variable in found else math.nan

    estimate, stderr = of("estimate"), of("stderr")
    return {
        "name": name,
        "estimate": format_number(estimate, 4),
        "stderr": format_number(stderr, 2),
        "systematic": format_number(of("stderr_systematic"), 2),
        "ratio": fixed_decimals(abs(estimate) / stderr if stderr > 0.0 else math.nan, 1),
        "vif": fixed_decimals(of("vif"), 1),
        "contribution": f"{fixed_decimals(100.0 * of('contribution'), 0)} %"
        if math.isfinite(of("contribution"))
        else MISSING,
        "bar": _error_bar(estimate, stderr),
    }


def _error_bar(estimate: float, stderr: float) -> dict[str, float] | None:
    """Return places of zero, estimate and its two standard errors on a line that the larger of them
    fills. [px]
    """
    reach = abs(estimate) + 2.0 * stderr
    if not math.isfinite(reach) or reach == 0.0:
        return None
    at, wide = _BAR * estimate / reach, 2.0 * _BAR * stderr / reach
    return {
        "at": round(_MIDDLE + at, 1),
        "low": round(_MIDDLE + at - wide, 1),
        "high": round(_MIDDLE + at + wide, 1),
        "zero": _MIDDLE,
    }


def _correlated(fit: flighttest.Fit, names: Sequence[str]) -> list[str]:
    """Return the pairs of estimates that can hardly be distinguished."""
    if "correlation" not in fit.estimates:
        return []
    table = fit.estimates["correlation"].values
    pairs = [
        (a, b) for a in range(len(names)) for b in range(a) if abs(table[a, b]) >= LEAST_CORRELATION
    ]
    return [f"{names[b]} with {names[a]}: {fixed_decimals(table[a, b], 3)}" for a, b in pairs]


def _traces(fit: flighttest.Fit, pack: Pack) -> dict[str, Any]:
    """Return the measured and the fitted coefficient over the samples, thinned to what a figure can
    show.
    """
    measured = fit.data[fit.model.coefficient].values
    every = max(1, math.ceil(len(measured) / MOST_SAMPLES))
    fitted = (measured - fit.residual)[::every]
    measured = measured[::every]
    step = step_of(None, (float(np.nanmin(measured)), float(np.nanmax(measured))))
    runs = (
        fit.data["manoeuvre"].values[::every]
        if "manoeuvre" in fit.data
        else np.zeros(len(measured))
    )
    base, sub = symbol_parts(fit.model.coefficient)
    return {
        "base": base,
        "sub": sub,
        "every": every,
        "starts": [int(i) for i in np.flatnonzero(np.diff(runs)) + 1],
        "measured": pack.add(measured, step),
        "fitted": pack.add(fitted, step),
        "alt": f"{fit.model.coefficient} of {fit.name}, measured and fitted",
    }


def sample_map(
    fits: Sequence[flighttest.Fit], level_lines: Mapping[str, xr.Dataset] | None = None
) -> Picture | None:
    """Return a figure of angles of attack and Mach numbers of the samples, with 1 g lines, as
    LR-743 Fig. 9; None without samples.
    """
    held = [fit.data for fit in fits if "alpha" in fit.data and "mach" in fit.data]
    if not held:
        return None
    alpha, mach = (
        np.concatenate([data[name].values for data in held]) for name in ("alpha", "mach")
    )
    good = np.isfinite(alpha) & np.isfinite(mach)
    x, y = mach[good], quantity_label("alpha").shown(alpha[good])
    if not len(x):
        return None
    frame = Frame(54.0, 12.0, WIDTH - 66.0, 240.0, _reach(x), _reach(y))
    cells = np.unique(
        np.stack(
            [
                np.floor(_CELLS * (v - low) / (high - low))
                for v, (low, high) in ((x, frame.x), (y, frame.y))
            ]
        ),
        axis=1,
    )
    centres = [
        low + (cell + 0.5) / _CELLS * (high - low)
        for cell, (low, high) in zip(cells, (frame.x, frame.y), strict=True)
    ]
    body = draw_axes(frame, x_labels=True) + draw_dots(frame, centres[0], centres[1], "test-point")
    body += text_pieces(
        frame.left + frame.width / 2, frame.bottom + 28, [("M", "symbol")], "middle"
    ) + text_pieces(8, 20, [("α", "symbol"), (", deg", "caption")])
    words, bottom = f"Angle of attack and Mach number of {len(x)} samples", frame.bottom + 36
    for i, (name, one) in enumerate((level_lines or {}).items()):
        css, column, down = f"run-{i % _LINES}", i % 2, bottom + 4 + 14 * (i // 2)
        body += clip_to_frame(
            frame,
            f"level-{i}",
            draw_curve(
                frame,
                one["mach"].values,
                quantity_label("alpha").shown(one["alpha"].values),
                f"trace {css}",
            ),
        )
        left = frame.left + column * frame.width / 2
        body += draw_line(left, down, left + 30, down, f"trace {css}") + draw_text(
            left + 36, down + 3.5, f"{i + 1}: 1 g, {name}", "caption"
        )
        body += _numbered(frame, i + 1, one)
    if level_lines:
        words, bottom = (
            f"{words}; 1 g lines: {', '.join(level_lines)}",
            bottom + 10 + 14 * -(-len(level_lines) // 2),
        )
    return Picture(body, bottom, words)


def _numbered(frame: Frame, number: int, one: xr.Dataset) -> str:
    """Return the number of a 1 g line, where it leaves the frame."""
    x, y = one["mach"].values, quantity_label("alpha").shown(one["alpha"].values)
    inside = np.flatnonzero(
        (x >= frame.x[0]) & (x <= frame.x[1]) & (y >= frame.y[0]) & (y <= frame.y[1])
    )
    if not len(inside):
        return ""
    return draw_text(
        float(frame.px(x[inside[-1]])) - 3,
        float(frame.py(y[inside[-1]])) - 4,
        str(number),
        "caption",
        "end",
    )


def _reach(values: np.ndarray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    pad = 0.04 * (high - low) or 0.05
    return low - pad, high + pad
