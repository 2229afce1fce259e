"""Panels of a case, with their order and their scales, for the page and for print."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightmech.support.arrays import true_spans
from pom.judging.signals import RunSignals, signals_of_run, traces_of
from pom.report.case.panel_marks import (
    FLOW_ANGLES,
    JudgedValue,
    ModeMark,
    flight_mode,
    is_too_slow,
    judged_values,
)
from pom.report.presentation.quantities import QuantityLabel, fixed_decimals, quantity_label
from pom.report.presentation.traces import STEPS_PER_HEIGHT, step_of
from pom.result import PomResult
from pom.tolerances.bands import NotJudged, half_width, inside_window
from pom.tolerances.criteria import Criterion


@dataclass(frozen=True)
class Cross:
    """One cross plot.

    Attributes
    ----------
    criteria : tuple of str
        Criteria that the plot shows.
    abscissa, ordinate : QuantityLabel
    x, y : dict of str to array (sample,)
        Values by run, over the window of the criterion. [display units]
    half : array (sample,)
        Half width of the band at the flight samples; NaN if it is not judged. [display units]
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
        y = np.concatenate(list(self.y.values()))
        span = float(np.nanmax(x) - np.nanmin(x)) or 1.0
        x_step = span / (2 * STEPS_PER_HEIGHT)
        return x_step, step_of(self.half, (float(np.nanmin(y)), float(np.nanmax(y))))


def make_cross_plots(result: PomResult) -> list[Cross]:
    """Return the cross plots of the criteria that compare curves.

    Several criteria on one pair of channels share a plot.
    """
    criteria = []
    for criterion in result.case.criteria:
        if criterion.abscissa and criterion.channel and criterion.applies:
            criteria.append(criterion)
    if not criteria:
        return []
    time = result.signals["time"].values
    signals = {}
    for run in ("flight", *result.runs):
        signals[run] = signals_of_run(result.case, traces_of(result.signals, run), time)
    plots: dict[tuple[str, str], Cross] = {}
    for criterion in criteria:
        pair = (criterion.abscissa, criterion.channel)
        complete = {}
        for run, run_signals in signals.items():
            if pair[0] in run_signals and pair[1] in run_signals:
                complete[run] = run_signals
        if pair not in plots and "flight" in complete:
            inside = inside_window(time, criterion.window)
            plots[pair] = _make_cross(result, criterion, complete, inside)
    return list(plots.values())


def _make_cross(
    result: PomResult, criterion: Criterion, signals: Mapping[str, RunSignals], inside: np.ndarray
) -> Cross:
    """Return the cross plot of a criterion over the samples inside its window."""
    pair = (criterion.abscissa, criterion.channel)
    names = tuple(c.name for c in result.case.criteria if (c.abscissa, c.channel) == pair)
    abscissa, ordinate = quantity_label(criterion.abscissa), quantity_label(criterion.channel)
    flight = signals["flight"][criterion.channel][inside]
    try:
        width = np.broadcast_to(half_width(criterion, flight), flight.shape)
        half = ordinate.width(width)
    except NotJudged:
        half = np.full(flight.shape, np.nan)
    x, y = {}, {}
    for run, run_signals in signals.items():
        x[run] = abscissa.shown(run_signals[abscissa.name][inside])
        y[run] = ordinate.shown(run_signals[ordinate.name][inside])
    return Cross(names, abscissa, ordinate=ordinate, x=x, y=y, half=half)


# Largest share of the height of flight and band by which an outlier widens a scale, on each side.
ROOM = 0.5
# Least share of the panel that half a band keeps next to the trace of a model.
LEAST_BAND = 0.05
# Margin beyond the extreme values, as a share of the height.
MARGIN = 0.05
# Ratio of the scales of record and window above which a panel has the scale of its window.
SQUEEZED = 2.0
# An input is a constant with noise if its half-second mean moves less than this share of the least
# height of a panel.
STILL = 0.5


@dataclass(frozen=True)
class CasePanel:
    """One panel of the plot of a case.

    Attributes
    ----------
    kind : {"judged", "input", "shown"}
    label : QuantityLabel
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
        The same, or the scale of the window if the other samples would squeeze it, as the angle of
        attack at standstill does. [display unit]
    fans : dict of str to array (quantile, time)
        Run name to the quantiles of its draws, the lowest first. [display unit]
    values : list of JudgedValue
        Judged values of the flight with their half widths. [display unit]
    mode : ModeMark or None
        Fitted mode of the flight that a criterion judges.
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
    values: list[JudgedValue] = field(default_factory=list)
    mode: ModeMark | None = None

    @property
    def channel(self) -> str:
        """Canonical name of the quantity."""
        return self.label.name


def make_case_panels(result: PomResult) -> list[CasePanel]:
    """Return the panels of a case: judged channels, moving inputs, then all other channels.

    Channels with a band come before channels that are judged by other measures.
    """
    channels = [str(name) for name in result.signals.data_vars]
    banded: list[str] = []
    measured: list[str] = []
    for channel in dict.fromkeys(row["channel"] for row in result.rows):
        name = str(channel)
        if name in channels:
            group = banded if name in result.tolerance else measured
            group.append(name)
    panels = [_make_channel_panel(result, name, "judged") for name in (*banded, *measured)]

    placed = {*banded, *measured}
    moving, _ = split_inputs(result)
    for name in moving:
        # A control that a pilot model moves has a channel: it differs between flight and models.
        channel = name.removesuffix("_drive")
        placed |= {name, channel}
        if channel in channels:
            panels.append(_make_channel_panel(result, channel, "input"))
        else:
            panels.append(_make_input_panel(result, name))
    for name in channels:
        if name not in placed:
            panel = _make_channel_panel(result, name, "shown")
            # a flow angle of an aeroplane that stands for the whole record has no sample
            if panel.traces or name not in FLOW_ANGLES:
                panels.append(panel)
    return panels


def split_inputs(result: PomResult) -> tuple[list[str], list[str]]:
    """Return the names of the inputs that move during the run, and of those that do not."""
    return result.once(_split_inputs)


def _split_inputs(result: PomResult) -> tuple[list[str], list[str]]:
    names = [str(name) for name in result.inputs.data_vars]
    time = result.inputs["time"].values
    # Samples in half a second.
    count = max(1, min(len(time), round(0.5 * (len(time) - 1) / (time[-1] - time[0]))))
    moving = []
    for name in names:
        label = quantity_label(name)
        values = result.inputs.variables[name].values
        if values.size and values.min() == values.max():
            continue
        mean = np.convolve(label.shown(values), np.full(count, 1.0 / count), mode="valid")
        # The second limit is that of rounding.
        if np.ptp(mean) > max(STILL * label.least_span, 1e-9 * np.abs(mean).max()):
            moving.append(name)
    return moving, [name for name in names if name not in moving]


def _make_channel_panel(result: PomResult, name: str, kind: str) -> CasePanel:
    """Return the panel of a channel of flight and models."""
    label = quantity_label(name)
    time = result.signals["time"].values
    runs = map(str, result.signals["run"].values)
    traces = {}
    for run, values in zip(runs, label.shown(result.signals.variables[name].values), strict=True):
        if np.isfinite(values).any():
            traces[run] = values
    rows = [row for row in result.rows if row["channel"] == name]
    half, window = None, _judged_window(rows)
    exits: dict[str, list[tuple[float, float]]] = {}
    if name in result.tolerance:
        half = label.width(result.tolerance.variables[name].values)
        inside = np.isfinite(half)
        if inside.any():
            window = (float(time[inside][0]), float(time[inside][-1]))
        exits = _list_exits(time, traces, half)
    # Flow angles have no meaning at rest.
    if name in FLOW_ANGLES:
        traces = _hide_slow_samples(result, traces, half)
    flight = traces.get("flight")
    values = judged_values(rows, label, time, flight)
    fans = {}
    for run, samples in result.samples.items():
        if name in samples.fan:
            fans[run] = label.shown(samples.fan[name].values)
    # The scale contains the curves, the band, and the judged single values.
    limits = scale_limits(traces, half, label.least_span)
    for mark in values:
        limits = (min(limits[0], mark.centre - mark.half), max(limits[1], mark.centre + mark.half))
    return CasePanel(
        kind,
        label,
        traces=traces,
        half=half,
        window=window,
        exits=exits,
        rows=rows,
        limits=limits,
        scale=_choose_scale(limits, traces, half, label.least_span),
        fans=fans,
        values=values,
        mode=flight_mode(result, label, time, flight) if rows else None,
    )


def _hide_slow_samples(
    result: PomResult, traces: Mapping[str, np.ndarray], half: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Return the traces of a flow angle without the samples of a standing or slow aeroplane.

    Judged samples stay.
    """
    slow, shown = is_too_slow(result), {}
    judged = np.isfinite(half) if half is not None else False
    for run, values in traces.items():
        hidden = slow.get(run, np.zeros(len(values), bool)) & ~judged
        kept = np.where(hidden, np.nan, values)
        if np.isfinite(kept).any():
            shown[run] = kept
    return shown


def _list_exits(
    time: np.ndarray, traces: Mapping[str, np.ndarray], half: np.ndarray
) -> dict[str, list[tuple[float, float]]]:
    """Return the spans [s] of every model outside the band; empty without a flight trace."""
    exits: dict[str, list[tuple[float, float]]] = {}
    if "flight" not in traces:
        return exits
    for run, values in traces.items():
        if run != "flight":
            exits[run] = true_spans(time, is_outside_band(values, traces["flight"], half))
    return exits


def _choose_scale(
    limits: tuple[float, float],
    traces: dict[str, np.ndarray],
    half: np.ndarray | None,
    least_span: float,
) -> tuple[float, float]:
    """Return the scale of the record, or of the window if the other samples would squeeze it."""
    if half is None or not np.isfinite(half).any():
        return limits
    inside = np.isfinite(half)
    window_traces = {run: values[inside] for run, values in traces.items()}
    window_limits = scale_limits(window_traces, half[inside], least_span)
    if limits[1] - limits[0] > SQUEEZED * (window_limits[1] - window_limits[0]):
        return window_limits
    return limits


def _judged_window(rows: Sequence[Mapping[Hashable, Any]]) -> tuple[float, float] | None:
    """Return the window [s] of the first judged row of a channel; None without one."""
    for row in rows:
        if row["verdict"] in ("pass", "fail"):
            return float(row["window_start"]), float(row["window_stop"])
    return None


def _make_input_panel(result: PomResult, name: str) -> CasePanel:
    """Return the panel of an input as recorded."""
    label = quantity_label(name)
    values = np.interp(
        result.signals["time"].values,
        result.inputs["time"].values,
        label.shown(result.inputs.variables[name].values),
    )
    traces = {"applied": values}
    limits = scale_limits(traces, None, label.least_span)
    return CasePanel(
        "input",
        label,
        traces=traces,
        half=None,
        window=None,
        exits={},
        rows=[],
        limits=limits,
        scale=limits,
    )


def is_outside_band(model: np.ndarray, flight: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return where a model is outside the band, (time,).

    A missing value inside the window counts as outside.
    """
    # The factor lets a value on the edge of the band pass in spite of rounding.
    with np.errstate(invalid="ignore"):
        return np.isfinite(half) & ~(np.abs(model - flight) <= half * (1.0 + 1e-12))


def scale_limits(
    traces: dict[str, np.ndarray], half: np.ndarray | None, least_span: float
) -> tuple[float, float]:
    """Return the limits of a panel, which always hold the flight and its band.

    Models widen the limits by at most `ROOM` of the height on each side, as long as half a band
    keeps `LEAST_BAND` of the panel.  Their values beyond the limits are clipped.

    Parameters
    ----------
    traces : dict of str to array (time,)
        Values by run. [display unit]
    half : array (time,) or None
        Half width of the band. [display unit]
    least_span : float
        Least height of the panel. [display unit]
    """
    base = traces.get("flight", next(iter(traces.values()), np.zeros(1)))
    width: np.ndarray | float = 0.0
    widest = np.inf
    if half is not None:
        width = np.where(np.isfinite(half), half, 0.0)
        if np.isfinite(half).any():
            widest = float(np.nanmax(half))
    low, high = _finite_extent([base - width, base + width])
    if high - low < least_span:
        low, high = (low + high - least_span) / 2, (low + high + least_span) / 2
    height = (high - low) or max(abs(high), 1.0) * 0.1

    # Extension at each side for the models, limited to `ROOM`.
    models = [values for values in traces.values() if values is not base]
    far_low, far_high = _finite_extent(models) if models else (low, high)
    below = min(max(low - far_low, 0.0), ROOM * height)
    above = min(max(far_high - high, 0.0), ROOM * height)
    if below + above > 0:
        # Both extensions shrink if half a band would get less than `LEAST_BAND` of the height.
        largest = max(height, widest / LEAST_BAND)
        scale = min(1.0, (largest - height) / (below + above))
        low, high = low - below * scale, high + above * scale
    margin = MARGIN * ((high - low) or height)
    return float(low - margin), float(high + margin)


def _finite_extent(values: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return least and largest finite value; zeros if there is none."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    if not len(finite):
        return 0.0, 0.0
    return float(finite.min()), float(finite.max())


def panel_description(panel: CasePanel) -> str:
    """Return the alternative text of a panel, made from its verdicts."""
    name = panel.label.words or panel.channel
    unit = f", {panel.label.unit}" if panel.label.unit else ""
    head = f"{name} against time{unit}"
    if panel.kind == "input":
        return f"{head}: input as recorded"
    states = {"pass": "within tolerance throughout", "fail": "outside tolerance"}
    parts = []
    for row in panel.rows:
        if row["verdict"] not in states:
            continue
        instant = f" at {fixed_decimals(row['at'], 1)} s" if np.isfinite(row["at"]) else ""
        parts.append(
            f"{row['run']}: {row['criterion'].replace('_', ' ')} {states[row['verdict']]}, "
            f"{fixed_decimals(row['worst_ratio'], 2)} of the tolerance{instant}"
        )
    if not parts:
        return head
    return f"{head}. {'; '.join(parts)}"
