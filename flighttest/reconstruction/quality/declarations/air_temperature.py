"""Temperature of the air against the standard atmosphere, and against climbs and descents.

Days are up to 35 K warmer and, over land in winter, up to 70 K colder than standard.  Fahrenheit
taken as Celsius is warmer than that below 2000 m or so, and so is the total temperature of a fast
jet.

The barometric equation is sharper where a receiver records the height: air that is 1 % warmer is
1 % less dense, and the same change of pressure is a 1 % larger change of height.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.air import R_AIR, atmosphere, pressure_altitude
from flightmech.units import G0
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding, map_entry
from flighttest.regression.uncertainty.jackknife import block_jackknife

_POSSIBLE = (-75.0, 38.0)  # K
_RESTORED = 25.0  # K within which a change of unit must bring it
_ENOUGH = 5.0  # s
_ZERO, _RATIO = 273.15, 1.8
_FAHRENHEIT = (1.0 / _RATIO, _ZERO - (_ZERO + 32.0) / _RATIO)  # factor; shift [K]
# error of a scale of the airspeed that the unit explains; temperature above standard [K] that is
# rare and that the unit may explain
_SCALE_ERROR, _RARE = 0.015, 28.0
# Barometric equation
_BAND, _CLOCK = 0.2, 0.5  # Hz of the signals; s between samples
_SAMPLES, _BLOCKS = 60, 12  # fewest samples; blocks of the jackknife
_SLOPE, _SIGMAS = 0.015, 4.0  # error of the temperature over itself that is reported
_KNOWN = 0.0045  # standard error of the slope up to which the temperature counts as checked
_SPEED = 100.0  # m/s, unit of the airspeed whose square is the position error
_TITLE = "level of the temperature, by climbs and descents"
_ROW = ("temperature_level", _TITLE)


def temperature_findings(signals: ResampledChannels, record: xr.DataTree) -> list[Finding]:
    """Return whether the recorded temperature is one of the air at this height.

    Parameters
    ----------
    signals : Signals
        Mistakes undone.
    record : DataTree
    """
    full = signals.completed(("p_static",))
    if not {"temperature", "p_static"} <= set(full.values):
        return []
    mask = full.mask(("temperature", "p_static"))
    if mask.sum() * full.step < _ENOUGH:
        return []
    p_static = np.clip(full["p_static"][mask], 1e3, 1.2e5)
    standard = atmosphere(pressure_altitude(p_static)).temperature
    temperature = full["temperature"][mask]
    apart = float(np.median(temperature - standard))
    middle = float(np.median(temperature))
    slope, shift = _FAHRENHEIT
    converted = float(np.median(slope * temperature + shift - standard))
    if _POSSIBLE[0] <= apart <= _POSSIBLE[1]:
        if apart < _RARE or abs(converted) > _RESTORED:
            return []
        text = (
            f"temperature is {middle - _ZERO:.0f} degC, {apart:+.0f} K off the standard atmosphere "
            f"at the pressure of the flight: a very hot day, or degF taken as degC "
            f"({converted:+.0f} K)"
        )
        line = map_entry(record, "temperature", slope, shift)
        remedy = f"compare with the weather of the day; if it is degF: {line}"
        evidence = {"difference": apart}
        return [Finding("note", "unit", ("temperature",), text, remedy, evidence=evidence)]
    text = (
        f"temperature is {middle - _ZERO:.0f} degC and {apart:+.0f} K off the standard "
        f"atmosphere at the pressure of the flight "
        f"(days differ by {_POSSIBLE[0]:g} to {_POSSIBLE[1]:g} K)"
    )
    if abs(converted) < _RESTORED:
        text += (
            ": it is in degF and was taken as degC; or it is the total temperature, or the "
            "height is wrong"
        )
        remedy = map_entry(record, "temperature", slope, shift)
    else:
        text += ": unit or column are wrong, or the height is"
        remedy = "check the columns of temperature and height in the name map"
    evidence = {"difference": apart}
    return [Finding("warning", "unit", ("temperature",), text, remedy, evidence=evidence)]


def explain_by_fahrenheit(
    airspeed: list[Finding], signals: ResampledChannels, record: xr.DataTree
) -> list[Finding]:
    """Return the findings on the airspeed with those that degF taken as degC explains as such.

    Parameters
    ----------
    airspeed : list of Finding
        Scale of the airspeed. One that is formed from impact pressure or calibrated airspeed grows
        with the square root of the temperature.
    signals : ResampledChannels
    record : DataTree
    """
    full = signals.completed(("p_static",))
    if "V" in signals or not {"temperature", "p_static"} <= set(full.values):
        return airspeed
    mask = full.mask(("temperature", "p_static"))
    if mask.sum() * full.step < _ENOUGH:
        return airspeed
    recorded = float(np.median(full["temperature"][mask]))
    pressures = np.clip(full["p_static"][mask], 1e3, 1.2e5)
    standard = float(np.median(atmosphere(pressure_altitude(pressures)).temperature))
    slope, shift = _FAHRENHEIT
    true = slope * recorded + shift
    closer = abs(true - standard) < min(_RESTORED, abs(recorded - standard))
    explained = []
    for finding in airspeed:
        scale, stderr = finding.evidence.get("slope", 1.0), finding.evidence.get("stderr", 0.0)
        same = abs(scale - np.sqrt(recorded / max(true, 1.0))) < _SCALE_ERROR + 3.0 * stderr
        if finding.kind == "scale" and closer and same:
            text = (
                f"temperature is in degF and was taken as degC: it reads {recorded - _ZERO:.1f} "
                f"degC, {recorded - standard:+.0f} K off the standard atmosphere at the pressure "
                f"of the flight ({true - _ZERO:.1f} degC, {true - standard:+.0f} K, from degF), "
                f"and the airspeed formed from it is {scale:.3f} of that of accelerations and "
                f"ground velocity"
            )
            line = map_entry(record, "temperature", slope, shift)
            channels = ("temperature", *finding.channels)
            finding = Finding(
                "error", "unit", channels, text, line, evidence=dict(finding.evidence)
            )
        explained.append(finding)
    return explained


def climb_findings(
    signals: ResampledChannels,
) -> tuple[list[Finding], list[tuple[str, str, tuple[str, ...], str]]]:
    """Return the finding on a temperature that climbs and descents contradict, or why not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes.

    Notes
    -----
    dh = -(R T/g0) dp/p along the path, with the recorded temperature, is regressed on the height of
    the satellite receiver. Further regressors are the climb rate (delay between the two), time
    (weather and drift of the receiver) and the square of the airspeed (error of the static port).
    The slope is the true temperature over the recorded one, both in K.
    """
    if "temperature" not in signals:
        return [], []
    full = signals.completed(("p_static", "V"))
    missing = tuple(name for name in ("h_gps", "p_static") if name not in full)
    if missing:
        return [], [(*_ROW, missing, f"not recorded: {'; '.join(missing)}")]
    slope = _barometric_slope(full)
    if slope is None or not slope[1] < _KNOWN:
        return [], [(*_ROW, (), "too little climb and descent in steady air: 50 m or more show it")]
    value, stderr = slope
    if abs(value - 1.0) < _SLOPE + _SIGMAS * stderr:
        return [], []
    # The thickness of a layer is proportional to its temperature (hypsometric equation).
    middle = float(np.median(full["temperature"][full.flying]))
    error = middle * (1.0 - value)
    text = (
        f"temperature is about {error:+.0f} K wrong (standard error {middle * stderr:.0f} K): the "
        f"height of the satellite receiver changes by {value:.3f} of what pressure and temperature "
        f"give in climbs and descents"
    )
    remedy = (
        "check unit and offset of the temperature, whether it is the total temperature, and the "
        "units of the two heights"
    )
    evidence = {"slope": value, "stderr": stderr}
    channels = ("temperature", "h_gps")
    return [Finding("warning", "definition", channels, text, remedy, evidence=evidence)], []


def _barometric_slope(full: ResampledChannels) -> tuple[float, float] | None:
    """Return the slope of height over barometric height, and its standard error."""
    needs = ("h_gps", "temperature", "p_static")
    every = max(1, round(_CLOCK / full.step))
    samples = np.flatnonzero(full.mask(needs))[::every]
    if len(samples) < _SAMPLES:
        return None
    smooth = [lowpass_if_possible(full[name], full.step, _BAND) for name in needs]
    height, temperature, p_static = smooth
    logarithm = np.log(np.clip(p_static, 1e3, 2e5))
    rise = -R_AIR / G0 * np.gradient(logarithm) * temperature
    time = full.time[samples]
    columns = [
        np.cumsum(rise)[samples],
        np.gradient(height, full.step)[samples],
        np.ones_like(time),
        (time - time.mean()) / np.ptp(time),
    ]
    if "V" in full:
        speed = lowpass_if_possible(full["V"], full.step, _BAND)[samples]
        columns.append((speed / _SPEED) ** 2)
    X, y = np.stack(columns, axis=1), height[samples]
    # columns of unit size, so that the condition number does not depend on their units
    X = X / np.maximum(np.abs(X).max(axis=0), 1e-12)
    size = np.abs(columns[0]).max()
    if not size > 0.0 or not np.linalg.cond(X) < 1e8:
        return None
    stderr = block_jackknife(
        lambda kept: first_coefficient(X[kept], y[kept]), len(samples), _BLOCKS
    )
    return first_coefficient(X, y) / size, float(stderr) / size


def first_coefficient(X: np.ndarray, y: np.ndarray) -> float:
    """Return the least-squares coefficient of the first column of X."""
    return float(np.linalg.lstsq(X, y, rcond=None)[0][0])
