"""Excitation of a flight: which axes the controls excite, and which inputs move together."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd

from flightmech.quantities import time_text
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import (
    BAND,
    ResampledChannels,
    lowpass_if_possible,
)
from flighttest.reconstruction.quality.finding import Finding, iterate_rows

COLLINEAR = 0.9  # correlation of two inputs, or multiple correlation of one with the others
_TRIM_BAND = 0.05  # Hz, slower than any manoeuvre
_AXES = (("pitch", "delta_e", "q"), ("roll", "delta_a", "p"), ("yaw", "delta_r", "r"))
# rms over a second that counts as movement: surface [rad], rate [rad s-1], throttle [1]
_INPUT, _RATE, _LEVER = 0.25 * DEGREE, 0.4 * DEGREE, 0.02
_SECOND = 1.0  # s
_RESPONSE_TIME = 3.0  # s in which the aeroplane responds to an input
_MOST_POWER = 0.9  # share of the power that lies below the frequency of an input
_CONTROLS = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
_INPUTS = ("delta_e", "delta_a", "delta_r", "delta_s", "delta_d", "throttle")


def axis_excitation(signals: ResampledChannels) -> pd.DataFrame:
    """Return the movement of surface and rate of each axis.

    Returns
    -------
    DataFrame
        ``axis surface rate input response share frequency``: largest rms over one second of surface
        [rad] and rate [rad s-1] without trim and slow drift, share of the flight in which both move
        [1], frequency below which nine tenths of the movement of the surface lie [Hz].
    """
    table: list = []
    for axis, surface, rate in _AXES:
        if not {surface, rate} <= set(signals.values):
            continue
        mask = signals.mask((surface, rate))
        if not mask.any():
            continue
        deflection = _remove_slow_part(signals, surface)
        x = _moving_rms(deflection, signals.step)[mask]
        y = _moving_rms(_remove_slow_part(signals, rate), signals.step)[mask]
        excited = _extend_by_response(x > _INPUT, signals.step) & (y > _RATE)
        frequency = _highest_frequency(deflection[mask], signals.step)
        sizes = float(x.max()), float(y.max())
        table.append((axis, surface, rate, *sizes, float(np.mean(excited)), frequency))
    return pd.DataFrame(
        table, columns=["axis", "surface", "rate", "input", "response", "share", "frequency"]
    )


def input_correlations(signals: ResampledChannels) -> pd.DataFrame:
    """Return the correlations of the inputs that move, without trim; throttles count as one."""
    inputs, mask = _moving_inputs(signals)
    if len(inputs) < 2:
        return pd.DataFrame()
    names = list(inputs)
    correlations = np.corrcoef([x[mask] for x in inputs.values()])
    return pd.DataFrame(correlations, index=names, columns=names)


def excitation_findings(
    table: pd.DataFrame,
    matrix: pd.DataFrame,
    signals: ResampledChannels,
    flown: pd.DataFrame,
    purpose: str,
) -> list[Finding]:
    """Return the axes without excitation, the idle manoeuvres and the collinear inputs.

    Parameters
    ----------
    table, matrix : DataFrame
        Results of `axis_excitation` and `input_correlations`.
    signals : ResampledChannels
    flown : DataFrame
        Result of `flighttest.records.marked_manoeuvres`.
    purpose : str
        Records for ``validation`` need no excitation.
    """
    findings = _axis_findings(table, purpose)
    for row in iterate_rows(flown):
        findings += _manoeuvre_findings(row, signals)
    return findings + _collinear_findings(matrix)


def _axis_findings(table: pd.DataFrame, purpose: str) -> list[Finding]:
    """Return the finding on the axes that no input excites."""
    still = [row for row in iterate_rows(table) if row.share == 0.0]
    if not still:
        return []
    no_axis = len(still) == len(table)
    if no_axis:
        head = "no axis is excited"
    else:
        head = f"not excited: {', '.join(row.axis for row in still)}"
    sizes = [
        f"{row.axis}: {row.surface} moves by {row.input / DEGREE:.2g} deg rms, "
        f"{row.rate} by {row.response / DEGREE:.2g} deg/s"
        for row in still
    ]
    text = f"{head} ({'; '.join(sizes)})"
    remedy = (
        "no derivative of these axes can be identified from this record; fly doublets, "
        "3-2-1-1 or multisines"
    )
    severity = "warning" if no_axis and purpose != "validation" else "note"
    surfaces = tuple(row.surface for row in still)
    return [Finding(severity, "excitation", surfaces, text, remedy=remedy)]


def _manoeuvre_findings(row, signals: ResampledChannels) -> list[Finding]:
    """Return the controls of a manoeuvre that do not move at its times."""
    findings = []
    for control in str(row.control).split():
        name = _CONTROLS.get(control, control)
        if name not in signals or name not in _CONTROLS.values():
            continue
        inside = (signals.time >= row.start) & (signals.time <= row.end)
        if inside.sum() * signals.step <= _SECOND:
            continue
        movement = float(np.ptp(signals[name][inside]))
        if movement < 2.0 * _INPUT:
            text = (
                f"{row.manoeuvre} at {time_text(row.start)} ... {time_text(row.end)} s: {name} "
                "moves by "
                f"{movement / DEGREE:.2g} deg only"
            )
            finding = Finding(
                "warning",
                "excitation",
                (name,),
                text,
                remedy="check the times of the list of manoeuvres, and the pick-up",
                start=float(row.start),
                stop=float(row.end),
            )
            findings.append(finding)
    return findings


def _collinear_findings(matrix: pd.DataFrame) -> list[Finding]:
    """Return the pairs of inputs that move together, else the input that the others determine."""
    findings = []
    names, correlations = [str(name) for name in matrix.columns], matrix.to_numpy()
    for i, j in combinations(range(len(names)), 2):
        correlation = float(correlations[i, j])
        if abs(correlation) > COLLINEAR:
            findings.append(_pair_finding(names[i], names[j], correlation))
    if len(names) > 2 and not findings:
        # multiple correlation of each input with the others: R^2 = 1 - 1/(diagonal of the inverse)
        inverse = np.diag(np.linalg.pinv(correlations))
        multiple = np.sqrt(np.maximum(0.0, 1.0 - 1.0 / inverse))
        worst = int(np.argmax(multiple))
        if multiple[worst] > COLLINEAR:
            others = (*names[:worst], *names[worst + 1 :])
            text = (
                f"{names[worst]} is a combination of {', '.join(others)} (multiple "
                f"correlation {multiple[worst]:.3f})"
            )
            remedy = "fly the inputs one after the other, or as orthogonal multisines"
            channels = (names[worst], *others)
            findings.append(Finding("warning", "collinear", channels, text, remedy=remedy))
    return findings


def _pair_finding(first: str, second: str, correlation: float) -> Finding:
    text = (
        f"{first} and {second} move together (correlation {correlation:+.3f}): their "
        f"effects cannot be distinguished"
    )
    remedy = (
        "fly them one after the other, or as orthogonal multisines; else fix one at "
        "its a-priori value"
    )
    evidence = {"correlation": correlation}
    channels = (first, second)
    return Finding("warning", "collinear", channels, text, remedy=remedy, evidence=evidence)


def _moving_inputs(signals: ResampledChannels) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the inputs that move, and the samples at which all of them are valid."""
    levers = [name for name in signals.values if name.endswith(".throttle")]
    names = [name for name in _INPUTS if name in signals]
    mask = signals.mask((*names, *levers))
    columns = {name: _remove_slow_part(signals, name) for name in names}
    if levers:
        throttles = [_remove_slow_part(signals, name) for name in levers]
        columns["throttle"] = np.mean(throttles, axis=0)
    inputs: dict[str, np.ndarray] = {}
    if not mask.any():
        return inputs, mask
    for name, x in columns.items():
        least = _LEVER if name == "throttle" else _INPUT
        if _moving_rms(x, signals.step)[mask].max() > least:
            inputs[name] = x
    return inputs, mask


def _remove_slow_part(signals: ResampledChannels, name: str) -> np.ndarray:
    """Return a channel without trim; without its mean if the clock is too slow for a filter."""
    x = lowpass_if_possible(signals[name], signals.step, BAND)
    slow = lowpass_if_possible(x, signals.step, _TRIM_BAND)
    if slow is x:
        return x - x.mean()
    return x - slow


def _moving_rms(x: np.ndarray, step: float) -> np.ndarray:
    """Return the rms over a second around each sample."""
    width = max(round(_SECOND / step), 1)
    mean_square = np.convolve(x**2, np.ones(width) / width, mode="same")
    return np.sqrt(np.maximum(mean_square, 0.0))


def _extend_by_response(moving: np.ndarray, step: float) -> np.ndarray:
    """Return the samples of an input and of the seconds in which the aeroplane responds to it."""
    window = np.ones(max(round(_RESPONSE_TIME / step), 1))
    return np.convolve(moving, window, mode="full")[: len(moving)] > 0.5


def _highest_frequency(x: np.ndarray, step: float) -> float:
    """Return the frequency below which most of the power lies; NaN without power. [Hz]"""
    power = np.cumsum(np.abs(np.fft.rfft(x - x.mean())) ** 2)
    if not power[-1] > 0.0:
        return float("nan")
    return float(np.searchsorted(power, _MOST_POWER * power[-1]) / (len(x) * step))
