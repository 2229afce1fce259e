"""Which panels a case shows, in which order and on which scale: the one description that page
script and print share.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightmech.support.arrays import true_runs
from pom.judging.signals import RunSignals, signals_of_run, traces_of
from pom.report.presentation.quantities import QuantityLabel, fixed_decimals, quantity_label
from pom.report.presentation.traces import STEPS_PER_HEIGHT, step_of
from pom.result import PomResult
from pom.tolerances.bands import NotJudged, half_width, inside_window
from pom.tolerances.criteria import Criterion


@dataclass(frozen=True)
class Cross:
    """One cross plot; `x`, `y` by run over the window of the criterion, `half` the half width at
    the flight samples. [display units]
    """

    criteria: tuple[str, ...]
    abscissa: QuantityLabel
    ordinate: QuantityLabel
    x: dict[str, np.ndarray]
    y: dict[str, np.ndarray]
    half: np.ndarray

    @property
    def words(self) -> str:
        """Alternative text."""
        return (
            f"{self.ordinate.words or self.ordinate.name} against "
            f"{self.abscissa.words or self.abscissa.name}"
        )

    @property
    def steps(self) -> tuple[float, float]:
        """Steps in which abscissa and ordinate are stored."""
        x = np.concatenate(list(self.x.values()))
        span = float(np.nanmax(x) - np.nanmin(x)) or 1.0
        y = np.concatenate(list(self.y.values()))
        return span / (2 * STEPS_PER_HEIGHT), step_of(
            self.half, (float(np.nanmin(y)), float(np.nanmax(y)))
        )


def make_cross_plots(result: PomResult) -> list[Cross]:
    """Return the cross plots of the criteria that compare curves; several criteria on one pair of
    channels share a plot.
    """
    curves = [c for c in result.case.criteria if c.abscissa and c.channel and c.applies]
    if not curves:
        return []
    time = result.signals["time"].values
    held = {run: _signals(result, run, time) for run in ("flight", *result.runs)}
    found: dict[tuple[str, str], Cross] = {}
    for criterion in curves:
        pair = criterion.abscissa, criterion.channel
        runs = {
            run: signals for run, signals in held.items() if all(name in signals for name in pair)
        }
        if pair not in found and "flight" in runs:
            found[pair] = _cross(result, criterion, runs, inside_window(time, criterion.window))
    return list(found.values())


def _signals(result: PomResult, run: str, time: np.ndarray) -> RunSignals:
    """Return what a run holds of the channels of a result."""
    return signals_of_run(result.case, traces_of(result.signals, run), time)


def _cross(
    result: PomResult, criterion: Criterion, runs: Mapping[str, RunSignals], inside: np.ndarray
) -> Cross:
    names = tuple(
        c.name
        for c in result.case.criteria
        if (c.abscissa, c.channel) == (criterion.abscissa, criterion.channel)
    )
    x, y = quantity_label(criterion.abscissa), quantity_label(criterion.channel)
    flight = runs["flight"][criterion.channel][inside]
    try:
        half = y.width(np.broadcast_to(half_width(criterion, flight), flight.shape))
    except NotJudged:
        half = np.full(flight.shape, np.nan)
    xs, ys = (
        {run: shown.shown(signals[shown.name][inside]) for run, signals in runs.items()}
        for shown in (x, y)
    )
    return Cross(names, x, y, xs, ys, half)


# an outlier may widen a scale by this share of the height that flight and band need, on each side
ROOM = 0.5
# half a band never gets less than this share of the panel because of a model's trace
LEAST_BAND = 0.05
MARGIN = 0.05
# a panel takes the scale of its window when the rest of the record would squeeze that by more
SQUEEZED = 2.0
# an input whose half-second mean moves less than this share of a panel's least height is a constant
# with noise
STILL = 0.5


@dataclass(frozen=True)
class CasePanel:
    """One strip of a case's plot.

    Attributes
    ----------
    kind : {"judged", "input", "shown"}
    label : Label
    traces : dict of str to array (time,)
        Run name to values; an input panel has the single run ``applied``. [display unit]
    half : array (time,) or None
        Half width of the band; NaN outside the window. [display unit]
    window : tuple of float or None
        Window of the criterion. [s]
    exits : dict of str to list of (start, stop)
        Spans where a run is outside its band. [s]
    rows : sequence of mapping
        Verdict rows of this channel.
    limits : tuple of float
        Scale over the whole record. [display unit]
    scale : tuple of float
        That, or the scale of the window where the rest of the record would squeeze it: an angle of
        attack at standstill.
    fans : dict of str to array (quantile, time)
        Run name to the quantiles of its draws, the lowest first. [display unit]
    """

    kind: str
    label: QuantityLabel
    traces: dict[str, np.ndarray]
    half: np.ndarray | None
    window: tuple[float, float] | None
    exits: dict[str, list[tuple[float, float]]]
    rows: Sequence[Mapping[Hashable, Any]]
    limits: tuple[float, float]
    scale: tuple[float, float]
    fans: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def channel(self) -> str:
        """Canonical name of the quantity."""
        return self.label.name


def make_case_panels(result: PomResult) -> list[CasePanel]:
    """Return the panels of a case: judged channels, then the inputs that move, then what proves the
    condition.
    """
    channels = [str(name) for name in result.signals.data_vars]
    rows = result.rows
    judged = [str(c) for c in dict.fromkeys(row["channel"] for row in rows) if c in channels]
    banded = [name for name in judged if name in result.tolerance]
    measured = [name for name in judged if name not in banded]
    moving, _ = split_inputs(result)
    driven = [_driven(name, channels) for name in moving]
    others = [name for name in channels if name not in (*banded, *measured, *moving, *driven)]
    return [
        *(_compared(result, name, "judged", rows) for name in (*banded, *measured)),
        *(
            _compared(result, driven_by, "input", rows) if driven_by else _input(result, name)
            for name, driven_by in zip(moving, driven, strict=True)
        ),
        *(_compared(result, name, "shown", rows) for name in others),
    ]


def _driven(name: str, channels: Sequence[str]) -> str:
    """Return the channel that shows an input in flight and models: one that a pilot moves, or
    thrust that drives.
    """
    driven_by = name.removesuffix("_drive")
    return driven_by if driven_by in channels else ""


def split_inputs(result: PomResult) -> tuple[list[str], list[str]]:
    """Return the inputs that move during the run and those that stand still."""
    return result.once(_split_inputs)


def _split_inputs(result: PomResult) -> tuple[list[str], list[str]]:
    names = [str(name) for name in result.inputs.data_vars]
    time = result.inputs["time"].values
    count = max(1, min(len(time), round(0.5 * (len(time) - 1) / (time[-1] - time[0]))))
    moving = []
    for name in names:
        shown = quantity_label(name)
        values = result.inputs.variables[name].values
        if values.size and values.min() == values.max():
            continue
        mean = np.convolve(shown.shown(values), np.full(count, 1.0 / count), mode="valid")
        if np.ptp(mean) > max(STILL * shown.least_span, 1e-9 * np.abs(mean).max()):
            moving.append(name)
    return moving, [name for name in names if name not in moving]


def _compared(
    result: PomResult, name: str, kind: str, rows: Sequence[Mapping[Hashable, Any]]
) -> CasePanel:
    shown = quantity_label(name)
    time = result.signals["time"].values
    traces = dict(
        zip(
            map(str, result.signals["run"].values),
            shown.shown(result.signals.variables[name].values),
            strict=True,
        )
    )
    traces = {run: values for run, values in traces.items() if np.isfinite(values).any()}
    rows = [row for row in rows if row["channel"] == name]
    half = (
        shown.width(result.tolerance.variables[name].values) if name in result.tolerance else None
    )
    exits: dict[str, list[tuple[float, float]]] = {}
    if half is not None and "flight" in traces:
        exits = {
            run: spans_of_mask(time, is_outside_band(values, traces["flight"], half))
            for run, values in traces.items()
            if run != "flight"
        }
    inside = np.isfinite(half) if half is not None else np.zeros(len(time), bool)
    window = (float(time[inside][0]), float(time[inside][-1])) if inside.any() else _window(rows)
    whole = scale_limits(traces, half, shown.least_span)
    fans = {
        run: shown.shown(found.fan[name].values)
        for run, found in result.samples.items()
        if name in found.fan
    }
    return CasePanel(
        kind,
        shown,
        traces,
        half,
        window,
        exits,
        rows,
        whole,
        _scale(whole, traces, half, shown.least_span),
        fans,
    )


def _scale(
    whole: tuple[float, float],
    traces: dict[str, np.ndarray],
    half: np.ndarray | None,
    least_span: float,
) -> tuple[float, float]:
    """Return the scale of the whole record, or of the window where the rest would squeeze it."""
    if half is None or not np.isfinite(half).any():
        return whole
    inside = np.isfinite(half)
    own = scale_limits(
        {run: values[inside] for run, values in traces.items()}, half[inside], least_span
    )
    return own if whole[1] - whole[0] > SQUEEZED * (own[1] - own[0]) else whole


def _window(rows: Sequence[Mapping[Hashable, Any]]) -> tuple[float, float] | None:
    """Return the window of a channel that is judged without a band."""
    judged = [row for row in rows if row["verdict"] in ("pass", "fail")]
    return (float(judged[0]["window_start"]), float(judged[0]["window_stop"])) if judged else None


def _input(result: PomResult, name: str) -> CasePanel:
    shown = quantity_label(name)
    values = np.interp(
        result.signals["time"].values,
        result.inputs["time"].values,
        shown.shown(result.inputs.variables[name].values),
    )
    traces = {"applied": values}
    scale = scale_limits(traces, None, shown.least_span)
    return CasePanel("input", shown, traces, None, None, {}, [], scale, scale)


def is_outside_band(model: np.ndarray, flight: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return where a model is outside the band; a missing value inside the window counts as
    outside.
    """
    with np.errstate(invalid="ignore"):
        return np.isfinite(half) & ~(np.abs(model - flight) <= half * (1.0 + 1e-12))


def spans_of_mask(time: np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    """Return start and stop of every run of true samples. [s]"""
    return [(float(time[a]), float(time[b - 1])) for a, b in true_runs(mask)]


def scale_limits(
    traces: dict[str, np.ndarray], half: np.ndarray | None, least_span: float
) -> tuple[float, float]:
    """Return the scale of a panel: flight and band always fit, a model's outlier is clipped before
    it squeezes them.

    The models may widen the scale by `ROOM` of the height on each side, as long as half a band
    keeps `LEAST_BAND` of the panel.
    """
    base = traces.get("flight", next(iter(traces.values()), np.zeros(1)))
    width = np.where(np.isfinite(half), half, 0.0) if half is not None else 0.0
    low, high = _extent([base - width, base + width])
    if high - low < least_span:
        low, high = (low + high - least_span) / 2, (low + high + least_span) / 2
    height = (high - low) or max(abs(high), 1.0) * 0.1
    models = [v for run, v in traces.items() if v is not base]
    far_low, far_high = _extent(models) if models else (low, high)
    below, above = (min(max(x, 0.0), ROOM * height) for x in (low - far_low, far_high - high))
    widest = float(np.nanmax(half)) if half is not None and np.isfinite(half).any() else np.inf
    grown = max(height, widest / LEAST_BAND)
    scale = min(1.0, (grown - height) / (below + above)) if below + above > 0 else 1.0
    low, high = low - below * scale, high + above * scale
    pad = MARGIN * ((high - low) or height)
    return float(low - pad), float(high + pad)


def _extent(values: Sequence[np.ndarray]) -> tuple[float, float]:
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)


def panel_description(panel: CasePanel) -> str:
    """Return the alternative text of a panel, made from its verdicts."""
    name = panel.label.words or panel.channel
    head = f"{name} against time" + (f", {panel.label.unit}" if panel.label.unit else "")
    if panel.kind == "input":
        return f"{head}: input as recorded"
    parts = []
    for row in panel.rows:
        if row["verdict"] in ("pass", "fail"):
            state = {"pass": "within tolerance throughout", "fail": "outside tolerance"}[
                row["verdict"]
            ]
            at = f" at {fixed_decimals(row['at'], 1)} s" if np.isfinite(row["at"]) else ""
            parts.append(
                f"{row['run']}: {row['criterion'].replace('_', ' ')} {state}, "
                f"{fixed_decimals(row['worst_ratio'], 2)} of the tolerance{at}"
            )
    return f"{head}. " + "; ".join(parts) if parts else head
