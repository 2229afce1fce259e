"""Unit of the clock of a record, from angles and their rates.

The integral of an angular rate over the clock is the change of the angle. A clock in milliseconds
that was read as seconds, or a counter of samples, gives the same factor for bank, pitch and
heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.finding import Finding

# Samples of a block. The trend of each block is removed, because biases of gyros add a trend to the
# angle.
_BLOCK = 256
_FEWEST = 512  # samples of a record
_CORRELATION = 0.9
_AGREE = 1.06  # largest ratio of the factors of two angles
_RIGHT = 1.25  # factor below which the clock is correct: scale errors are another finding
# A smaller factor, from _SLIGHT on, is that of the clock under two conditions.  Three angles agree
# within _SAME, and the integral of a velocity over the change of its coordinate has the factor
# within _NEAR_VELOCITY: a wrong scale of all gyros does not change the velocity.  Sound records
# have 0.956 to 1.058 there, by the delay of receivers and the temperature.
_SLIGHT, _SAME, _NEAR_VELOCITY = 1.15, 1.02, 1.07
_COORDINATES = (
    ("vd", "h_gps"),
    ("vn", "north"),
    ("ve", "east"),
    ("vd", "h_baro"),
    ("hdot", "h_baro"),
)
_OF_ANGLES = 1.04  # ratio to 57.3 or 1/57.3 of rates or angles in degrees: another finding
_NEAR = 1.04  # ratio of a factor to the factor of a unit
_UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9, "min": 1.0 / 60.0, "h": 1.0 / 3600.0}
# Factors of seconds that were read as another unit.
_SECONDS_AS = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
_POSSIBLE = (0.5, 5000.0)  # Hz: rates of a clock whose samples determine angles and rates
_ANGLES = ("phi", "theta", "psi")
_LEAST_COSINE = 0.1  # of the pitch attitude


@dataclass(frozen=True)
class ClockScale:
    """Unit of a clock.

    Attributes
    ----------
    factor : float
        Counts of the clock in one second.
    rate : float
        Samples in one second. [Hz]
    unit : str
        Unit of the clock, empty if it is not a unit of time.
    taken : str
        Unit in the name map or the file.
    angles : tuple of str
        Angles, and a coordinate, that determine the factor.
    """

    factor: float
    rate: float
    unit: str
    taken: str
    angles: tuple[str, ...]


def clock_scale(record: xr.DataTree) -> ClockScale | None:
    """Return the unit of the clock; None for seconds, or if the record does not determine it."""
    data = _attitude_leaf(record)
    if data is None or data.sizes["time"] < _FEWEST:
        return None
    factors = {}
    for name in _ANGLES:
        factor = _rate_factor(data, name)
        if factor is not None:
            factors[name] = factor
    # A clock changes all angles alike, a wrong unit of one channel does not.
    if len(factors) < 2 or max(factors.values()) > _AGREE * min(factors.values()):
        return None
    factor, rate = float(np.median(list(factors.values()))), float(data.attrs["rate"])
    if _ratio(factor, 1.0) < _RIGHT:
        return _slight_scale(record, factors, factor, rate)
    if _ratio(max(factor, 1.0 / factor), 1.0 / DEGREE) < _OF_ANGLES:
        return None
    unit, file_unit = _clock_units(factor)
    # Rates in mrad/s have the same factor. If the rate is possible as read, the clock is correct.
    if unit in ("s", "ms", "us", "ns") and _POSSIBLE[0] <= rate <= _POSSIBLE[1]:
        return None
    return ClockScale(factor, factor * rate, unit=unit, taken=file_unit, angles=tuple(factors))


def _slight_scale(
    record: xr.DataTree, factors: dict[str, float], factor: float, rate: float
) -> ClockScale | None:
    """Return a clock that is stretched by a little; None if angles and velocity do not show it."""
    agree = max(factors.values()) < _SAME * min(factors.values())
    if _ratio(factor, 1.0) < _SLIGHT or len(factors) < len(_ANGLES) or not agree:
        return None
    for velocity, coordinate in _COORDINATES:
        of_velocity = _velocity_factor(record, velocity, coordinate)
        if of_velocity is not None:
            if _ratio(of_velocity, factor) > _NEAR_VELOCITY:
                return None
            angles = (*factors, coordinate)
            return ClockScale(factor, factor * rate, unit="", taken="s", angles=angles)
    return None


def _velocity_factor(record: xr.DataTree, velocity: str, coordinate: str) -> float | None:
    """Return the ratio of the integral of a velocity to the change of its coordinate.

    The result is None if one of them is not recorded, or if the two are not correlated.
    """
    columns = {}
    for node in record.children.values():
        for name in {velocity, coordinate} & set(node.data_vars):
            data = node.to_dataset()
            columns[name] = data["time"].values, data[name].values.astype(float)
    if len(columns) < 2:
        return None
    (time, speed), (other_time, place) = columns[velocity], columns[coordinate]
    if len(time) != len(other_time) or not np.array_equal(time, other_time):
        place = np.interp(time, other_time, place)
    # heights are positive up, and vd down
    return _integral_ratio(time, -speed if velocity == "vd" else speed, place)


def _attitude_leaf(record: xr.DataTree) -> xr.Dataset | None:
    """Return the first leaf with attitude and rates."""
    for node in record.children.values():
        if {"phi", "theta", "p", "q", "r"} <= set(node.data_vars):
            return node.to_dataset()
    return None


def _clock_units(factor: float) -> tuple[str, str]:
    """Return the unit of a clock, empty if there is none, and the unit in the file."""
    for count, file_unit in _SECONDS_AS.items():
        if _ratio(factor, count) < _NEAR:
            return "s", file_unit
    for unit, count in _UNITS.items():
        if _ratio(factor, count) < _NEAR:
            return unit, "s"
    return "", "s"


def clock_findings(scale: ClockScale | None) -> list[Finding]:
    """Return the error of a clock that does not count seconds."""
    if scale is None:
        return []
    if scale.unit:
        fault = f"is in {scale.unit} and was taken as {scale.taken}"
        line = f'unit = "{scale.unit}"'
    else:
        fault = f"counts {scale.factor:.4g} in a second"
        line = f'rate = "{scale.rate:.4g} Hz"'
    text = (
        f"the clock {fault}: the rates of {', '.join(scale.angles)}, summed over it, are "
        f"{scale.factor:.4g} times their changes"
    )
    remedy = f"{line}   # in [time] of the name map, with the column of the clock"
    evidence = {"factor": scale.factor, "rate": scale.rate}
    channels = ("time", *scale.angles)
    return [Finding("error", "unit", channels, text=text, remedy=remedy, evidence=evidence)]


def on_seconds(record: xr.DataTree, scale: ClockScale | None) -> xr.DataTree:
    """Return a record with a clock in seconds."""
    if scale is None:
        return record
    leaves = {}
    for name, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values / scale.factor
        rate = float(data.attrs["rate"]) * scale.factor
        leaves[f"/{name}"] = data.assign_coords(time=time).assign_attrs(rate=rate)
    return xr.DataTree.from_dict({"/": record.to_dataset(), **leaves})


def _ratio(a: float, b: float) -> float:
    """Return the ratio of two factors, at least one."""
    return max(a / b, b / a)


def _rate_factor(data: xr.Dataset, name: str) -> float | None:
    """Return the ratio of the integral of the rates to the change of an angle.

    The result is None if the two are not correlated.
    """
    if name not in data:
        return None
    angle = data[name].values.astype(float)
    if name != "theta" and np.isfinite(angle).all():
        angle = np.unwrap(angle)
    return _integral_ratio(data["time"].values, _angle_rate(data, name), angle)


def _integral_ratio(time: np.ndarray, rate: np.ndarray, angle: np.ndarray) -> float | None:
    """Return the size of the integral of a rate over that of the change; None if uncorrelated."""
    # Integral of the rate by the trapezoidal rule.
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
    # Blocks without trend: biases of gyros do not count.
    y, z = _detrend_blocks(angle), _detrend_blocks(integral)
    finite = np.isfinite(y).all(axis=1) & np.isfinite(z).all(axis=1)
    y, z = y[finite].ravel(), z[finite].ravel()
    size = float(np.sqrt((y @ y) * (z @ z)))
    if not size or float(y @ z) / size < _CORRELATION:
        return None
    return float(np.sqrt((z @ z) / (y @ y)))


def _angle_rate(data: xr.Dataset, name: str) -> np.ndarray:
    """Return the rate of an Euler angle from attitude and body rates (time,). [rad s-1]"""
    phi, theta = data["phi"].values.astype(float), data["theta"].values.astype(float)
    p, q, r = (data[axis].values.astype(float) for axis in ("p", "q", "r"))
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    # psi_dot = (q sin phi + r cos phi)/cos theta
    psi_dot = (q * sf + r * cf) / np.where(np.abs(ct) < _LEAST_COSINE, _LEAST_COSINE, ct)
    if name == "phi":
        return p + psi_dot * st
    if name == "theta":
        return q * cf - r * sf
    return psi_dot


def _detrend_blocks(x: np.ndarray) -> np.ndarray:
    """Return the complete blocks of a signal without their straight line (block, sample)."""
    count = len(x) // _BLOCK
    blocks = x[: count * _BLOCK].reshape(count, -1)
    t = np.linspace(-1.0, 1.0, blocks.shape[1])
    slope = blocks @ t / (t @ t)
    return blocks - blocks.mean(axis=1, keepdims=True) - slope[:, None] * t
