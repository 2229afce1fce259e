"""Modal measures: period, time to half, damping ratio, and the lag between bank and sideslip."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from flightmech.names import WRAPPED
from flightmech.units import DEGREE
from pom.judging.measures.damped_sine import DampedSine, fit_mode, phase_at
from pom.judging.signals import Comparison, trace_of
from pom.result import PomResult
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    RowRemark,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.channels import plain_id
from pom.tolerances.criteria import Criterion

MINIMUM_CYCLES = {"2.c.9": 3.0, "2.d.7": 6.0}
"""Full cycles that the table requires; a time to half or double in the record is judged, too."""
STRICT_CYCLES = ("2.d.7",)
"""Tests whose row has no time to half in place of the cycles: fewer cycles are a departure."""

LEAST_AMPLITUDE = 0.1  # of the amplitude of the flight: a smaller mode of the model is not excited
PHUGOID = "2.c.9"
BANKED = 10.0 * DEGREE
"""Largest bank difference of a phugoid in the plane of symmetry.

Lift is then 1.5 % above weight.
"""
_MEASURES = ("period", "t_half", "damping_ratio")
_FITTED = (*_MEASURES, "cycles", "amplitude", "residual_rms")
# To test the influence of the window, each of its ends moves inwards by the smaller of these.
_END_SHIFT = 1.0 / 3.0  # of the period
_MOST_END_SHIFT = 0.25  # of the window


def judge_mode(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge period, time to half or damping ratio of the free response.

    A model fails if it does not oscillate where the flight does, or with less than a tenth of its
    amplitude. Such a model was not excited, and the fit would describe its rounding errors. It
    also fails, whatever the width, if one amplitude grows and the other decays: at a damping ratio
    of 0.01 the tolerance of 0.02 would pass an unstable model.
    """
    t, flight, model = _unwrap_angles(criterion.channel, match.both(criterion))
    flight_mode = _fit_once("flight", t, flight)
    required = MINIMUM_CYCLES.get(plain_id(match.case.id), 0.0)
    if flight_mode.cycles < required and abs(flight_mode.t_half) > flight_mode.duration:
        raise Invalid(
            f"{flight_mode.cycles:.1f} cycles and less than the time to half "
            f"({flight_mode.t_half:.0f} s) in {flight_mode.duration:.0f} s; "
            f"the table requires {required:g} cycles or the time to half"
        )
    value = getattr(flight_mode, criterion.measure)
    # A model without a mode is a failure of the model, not of the data.
    try:
        model_mode = _demand_excitation(_fit_once("the model", t, model), flight_mode)
    except Invalid as error:
        return Judgement(
            "fail",
            at=float(t[0]),
            remarks=(
                _values_remark(criterion.measure, {"flight": flight_mode}),
                RowRemark("no_mode", str(error)),
            ),
            flight=value,
        )
    cycles = flight_mode.cycles
    remarks = (
        _values_remark(criterion.measure, {"flight": flight_mode, "model": model_mode}),
        RowRemark("cycles", f"{cycles:.1f} cycles", values={"flight": cycles}, unit="1"),
        *_cycle_departure(match, cycles, required),
        *_window_remarks(criterion, value, time=t, flight=flight),
        *_bank_remarks(criterion, match),
    )
    model_value = getattr(model_mode, criterion.measure)
    outcome = judge_number(criterion, value, model_value, at=float(t[0]), remarks=remarks)
    # A period has no stability. Opposite signs of sigma: one amplitude grows, the other decays.
    if criterion.measure != "period" and flight_mode.sigma * model_mode.sigma < 0.0:
        # the first remark is the reason of the failure
        remarks = (RowRemark("stability", "stability differs"), *remarks)
        return replace(outcome, verdict="fail", remarks=remarks)
    return outcome


def _cycle_departure(match: Comparison, cycles: float, required: float) -> tuple[RowRemark, ...]:
    """Return the departure of a record with fewer cycles than its row requires."""
    if plain_id(match.case.id) not in STRICT_CYCLES or cycles >= required:
        return ()
    text = (
        f"departure: the free response has {cycles:.1f} cycles, the row requires {required:g} "
        f"complete cycles"
    )
    return (RowRemark("departure", text, "cycles"),)


def _bank_remarks(criterion: Criterion, match: Comparison) -> tuple[RowRemark, ...]:
    """Return a remark on a phugoid that the model flies in a turn; none without a bank angle."""
    if plain_id(match.case.id) != PHUGOID:
        return ()
    if "phi" not in match.flight or "phi" not in match.model:
        return ()
    # Differences along the shorter arc. fmax ignores gaps in a recorded bank.
    difference = np.abs(np.angle(np.exp(1j * (match.model["phi"] - match.flight["phi"]))))
    largest = float(np.fmax.reduce(difference[inside_window(match.time, criterion.window)]))
    if not largest > BANKED:
        return ()
    text = (
        f"bank of the model up to {largest / DEGREE:.0f} deg off the flight's, a turn and no "
        f"phugoid: let a math pilot hold the wings"
    )
    values = {"largest": largest / DEGREE, "limit": BANKED / DEGREE}
    return (RowRemark("bank", text, "phi", values=values, unit="deg"),)


def _window_remarks(
    criterion: Criterion, value: float, *, time: np.ndarray, flight: np.ndarray
) -> tuple[RowRemark, ...]:
    """Return a remark if a shorter window changes the flight value by more than the tolerance.

    The verdict does not change: the model is compared with the flight in the window of the case.
    """
    limit = float(half_width(criterion, value)[0])
    modes = _fit_shorter_windows(time.tobytes(), flight.tobytes())
    if not modes or not limit > 0.0:
        return ()
    # The window whose value differs most from that of the case.
    start, stop, mode = max(
        modes, key=lambda item: abs(getattr(item[2], criterion.measure) - value)
    )
    changed = getattr(mode, criterion.measure)
    if not abs(changed - value) > limit:
        return ()
    text = (
        f"the flight depends on the window: {criterion.measure.replace('_', ' ')} "
        f"{value:.4g} in the window of the case, {changed:.4g} in "
        f"{start:.1f} ... {stop:.1f} s, which is more than the tolerance ({limit:.3g}); "
        f"choose a window in which the mode is alone"
    )
    values = {"flight": value, "moved": changed, "limit": limit}
    unit = _unit_of(criterion.measure)
    return (RowRemark("window", text, criterion.measure, values=values, unit=unit),)


@lru_cache(maxsize=64)
def _fit_shorter_windows(
    times: bytes, samples: bytes
) -> tuple[tuple[float, float, DampedSine], ...]:
    """Return start, stop and mode of a flight in windows with one end moved inwards."""
    # Arrays are not hashable, so the cache is keyed by their bytes.
    time, y = np.frombuffer(times), np.frombuffer(samples)
    full = _fit_or_reason(times, samples)
    if isinstance(full, str):
        return ()
    shift = min(_END_SHIFT * full.period, _MOST_END_SHIFT * full.duration)
    modes = []
    for start, stop in ((time[0] + shift, time[-1]), (time[0], time[-1] - shift)):
        inside = (time >= start) & (time <= stop)
        try:
            modes.append((float(start), float(stop), fit_mode(time[inside], y[inside])))
        except Invalid:
            continue
    return tuple(modes)


def _demand_excitation(model: DampedSine, flight: DampedSine) -> DampedSine:
    """Return the mode of a model; raise if its amplitude is too small to be compared."""
    share = model.amplitude / flight.amplitude
    if share < LEAST_AMPLITUDE:
        raise Invalid(f"the model hardly oscillates: {share:.2g} of the amplitude of the flight")
    return model


def _values_remark(measure: str, modes: Mapping[str, DampedSine]) -> RowRemark:
    """Return the remark with the measured values of flight and model."""
    text = ", ".join(f"{who} {_value_text(measure, mode)}" for who, mode in modes.items())
    values = {who: float(getattr(mode, measure)) for who, mode in modes.items()}
    return RowRemark("values", text, measure, values=values, unit=_unit_of(measure))


def _unit_of(measure: str) -> str:
    return "1" if measure == "damping_ratio" else "s"


def _value_text(measure: str, mode: DampedSine) -> str:
    """Return a measured value in words; a negative time is a time to double."""
    if measure == "damping_ratio":
        return f"zeta {mode.damping_ratio:.4f}"
    value = getattr(mode, measure)
    if value < 0.0:
        return f"{abs(value):.2f} s to double"
    return f"{abs(value):.2f} s"


@lru_cache(maxsize=256)
def _fit_or_reason(time: bytes, y: bytes) -> DampedSine | str:
    """Return the mode of samples, or why they have none.

    Period, damping and time to half share one fit, and all models of a case share that of the
    flight.
    """
    try:
        return fit_mode(np.frombuffer(time), np.frombuffer(y))
    except Invalid as error:
        return str(error)


def _fit_once(who: str, time: np.ndarray, y: np.ndarray) -> DampedSine:
    """Return the mode of a run; raise with the name of the run if it has none."""
    mode = _fit_or_reason(time.tobytes(), y.tobytes())
    if isinstance(mode, str):
        raise Invalid(f"{who}: {mode}")
    return mode


def _unwrap_angles(
    channel: str, traces: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, flight and model; angles without jumps by a full turn."""
    if channel not in WRAPPED:
        return traces
    time, flight, model = traces
    return time, np.unwrap(flight), np.unwrap(model)


def peak_lag(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the time from a bank peak to the nearest sideslip peak, from phases of the fit."""
    t, flight_bank, model_bank = _unwrap_angles("phi", match.both(criterion, "phi"))
    _, flight_slip, model_slip = match.both(criterion, "beta")
    # Sideslip gives frequency and damping; the bank is fitted at the same values.
    mode = _fit_once("flight", t, flight_slip)
    lag = _bank_lag(mode, t, flight_bank)
    try:
        model_mode = _demand_excitation(_fit_once("the model", t, model_slip), mode)
        model_lag = _bank_lag(model_mode, t, model_bank)
    except Invalid as error:
        text = f"flight {lag:.2f} s"
        return Judgement(
            "fail",
            at=float(t[0]),
            remarks=(
                RowRemark("values", text, "lag", values={"flight": lag}, unit="s"),
                RowRemark("no_mode", str(error)),
            ),
            flight=lag,
        )
    # A lag of the model that differs by its full periods belongs to the same peak of another cycle.
    model_lag -= model_mode.period * round((model_lag - lag) / model_mode.period)
    text = f"flight {lag:.2f} s, model {model_lag:.2f} s"
    if half_width(criterion, lag)[0] <= 0.0:
        raise Invalid(f"the tolerance is zero wide; {text}")
    values = {"flight": lag, "model": model_lag}
    remark = RowRemark("values", text, "lag", values=values, unit="s")
    return judge_number(criterion, lag, model_lag, at=float(t[0]), remarks=(remark,))


def _bank_lag(sideslip: DampedSine, time: np.ndarray, bank: np.ndarray) -> float:
    """Return (phase of bank - phase of sideslip) / wd, within half a period. [s]"""
    phase = phase_at(time - time[0], bank, sigma=sideslip.sigma, wd=sideslip.wd)
    return math.remainder(phase - sideslip.phase, 2.0 * math.pi) / sideslip.wd


MODE_COLUMNS = ("run", "channel", "window_start", "window_stop", *_FITTED, "lag", "note")


def mode_table(result: PomResult) -> pd.DataFrame:
    """Return the modes of flight and models that the modal criteria of a case judge.

    Parameters
    ----------
    result : PomResult

    Returns
    -------
    DataFrame
        Columns `MODE_COLUMNS`, one row per fitted channel, window and run, flight first: ``period
        t_half`` [s], ``damping_ratio``, ``cycles`` in the window, ``amplitude residual_rms`` [SI],
        ``lag`` of bank behind sideslip [s] on the rows of ``beta`` where that is judged; NaN and a
        ``note`` where no mode could be fitted.
    """
    return result.once(_make_mode_table)


def keep_modes(result: PomResult, rows: Sequence[Mapping[str, Any]]) -> None:
    """Store rows as the `mode_table` of a result; they come from an equal result."""
    result.keep(_make_mode_table, _table_of_rows(rows))


def _make_mode_table(result: PomResult) -> pd.DataFrame:
    # Channels and windows to fit, and whether a criterion needs the lag of bank there.
    fitted: dict[tuple[str, tuple[float, float]], bool] = {}
    for criterion in result.case.criteria:
        with_lag = criterion.measure == "peak_lag"
        if not criterion.applies or not (with_lag or criterion.measure in _MEASURES):
            continue
        needed = {criterion.channel}
        channel = criterion.channel
        if with_lag:
            channel, needed = "beta", {"beta", "phi"}
        if needed <= set(result.signals):
            key = channel, criterion.window
            fitted[key] = fitted.get(key, False) or with_lag
    rows = []
    for (channel, window), with_lag in fitted.items():
        for run in result.signals["run"].values:
            rows.append(_mode_row(result, str(run), channel, window=window, with_lag=with_lag))
    return _table_of_rows(rows)


def _table_of_rows(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(MODE_COLUMNS))


def _mode_row(
    result: PomResult, run: str, channel: str, *, window: tuple[float, float], with_lag: bool
) -> dict[str, object]:
    """Return the fitted mode of one run, or a note why it has none."""
    mask = inside_window(result.signals["time"].values, window)
    time = result.signals["time"].values[mask]
    row: dict[str, object] = {
        "run": run,
        "channel": channel,
        "window_start": window[0],
        "window_stop": window[1],
        "note": "",
    }
    samples = trace_of(result.signals, run, channel)[mask]
    try:
        demand_finite(run, time, samples)
        # the fits are cached from the judgement
        mode = _fit_once(run, time, samples)
        if run != "flight":
            flight = trace_of(result.signals, "flight", channel)[mask]
            mode = _demand_excitation(mode, _fit_once("flight", time, flight))
        lag = math.nan
        if with_lag:
            lag = _bank_lag(mode, time, trace_of(result.signals, run, "phi")[mask])
    except Invalid as error:
        return {**row, "note": str(error).removeprefix(f"{run}: ")}
    values = {name: getattr(mode, name) for name in _FITTED}
    return {**row, **values, "lag": lag}
