"""Whether the clock of a record counts seconds.

The integral of an angular rate over the clock is the change of the angle.  A clock in milliseconds
that is taken for seconds, or a counter of samples, gives the same factor for bank, pitch and
heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.finding import Finding

_BLOCK = 256  # samples without a common trend: what biases of gyros add to the angle is a trend
_FEWEST = 512
_CORRELATION = 0.9
_AGREE = 1.06  # ratio of the factors of two angles
_RIGHT = 1.25  # factor that is not a wrong clock: scale errors are another finding
_OF_ANGLES = 1.04  # about 57.3: rates or angles in degrees, which other checks name
_UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9, "min": 1.0 / 60.0, "h": 1.0 / 3600.0}
_TWICE = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}  # seconds that are taken for these
_NEAR = 1.04
_POSSIBLE = (0.5, 5000.0)  # Hz, of a clock whose samples show angles and rates
_ANGLES = ("phi", "theta", "psi")


@dataclass(frozen=True)
class ClockScale:
    """What a clock counts.

    Attributes
    ----------
    factor : float
        Its counts in one second.
    rate : float
        Samples in one second. [Hz]
    unit, taken : str
        Its unit, empty where it is none, and the one that the name map or the file states.
    angles : tuple of str
        Angles that show it.
    """

    factor: float
    rate: float
    unit: str
    taken: str
    angles: tuple[str, ...]


def clock_scale(record: xr.DataTree) -> ClockScale | None:
    """Return what the clock of a record counts; None for seconds, or where the record does not show
    it.
    """
    leaf = next(
        (
            node
            for node in record.children.values()
            if {"phi", "theta", "p", "q", "r"} <= set(node.data_vars)
        ),
        None,
    )
    if leaf is None or leaf.sizes["time"] < _FEWEST:
        return None
    data = leaf.to_dataset()
    found = {name: factor for name in _ANGLES if (factor := _factor(data, name)) is not None}
    factors = list(found.values())
    if len(factors) < 2 or max(factors) > _AGREE * min(factors):
        return None
    factor, rate = float(np.median(factors)), float(data.attrs["rate"])
    if _ratio(factor, 1.0) < _RIGHT or _ratio(max(factor, 1.0 / factor), 1.0 / DEGREE) < _OF_ANGLES:
        return None
    unit = next((name for name, count in _UNITS.items() if _ratio(factor, count) < _NEAR), "")
    taken = next((taken for count, taken in _TWICE.items() if _ratio(factor, count) < _NEAR), "s")
    if taken != "s":
        unit = "s"
    possible = _POSSIBLE[0] <= rate <= _POSSIBLE[1]
    if unit in ("s", "ms", "us", "ns") and possible:  # rates in mrad/s show the same
        return None
    return ClockScale(factor, factor * rate, unit, taken, tuple(found))


def clock_findings(scale: ClockScale | None) -> list[Finding]:
    """Return the error of a clock that does not count seconds."""
    if scale is None:
        return []
    what = (
        f"is in {scale.unit} and was taken as {scale.taken}"
        if scale.unit
        else f"counts {scale.factor:.4g} in a second"
    )
    text = (
        f"the clock {what}: {', '.join(scale.angles)} change {scale.factor:.4g} times as much "
        f"as their rates say"
    )
    line = f'unit = "{scale.unit}"' if scale.unit else f'rate = "{scale.rate:.4g} Hz"'
    remedy = f"{line}   # in [time] of the name map, with the column of the clock"
    evidence = {"factor": scale.factor, "rate": scale.rate}
    return [Finding("error", "unit", ("time", *scale.angles), text, remedy, evidence=evidence)]


def on_seconds(record: xr.DataTree, scale: ClockScale | None) -> xr.DataTree:
    """Return a record on the clock that its motion shows."""
    if scale is None:
        return record
    leaves = {}
    for name, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values / scale.factor
        rate = float(data.attrs["rate"]) * scale.factor
        leaves[f"/{name}"] = data.assign_coords(time=time).assign_attrs(rate=rate)
    return xr.DataTree.from_dict({"/": record.to_dataset(), **leaves})


def _ratio(one: float, other: float) -> float:
    return max(one / other, other / one)


def _factor(data: xr.Dataset, name: str) -> float | None:
    """Return by how much an integral of rates exceeds the change of an angle; None where they do
    not go together.
    """
    if name not in data:
        return None
    x = {one: data[one].values.astype(float) for one in ("phi", "theta", "p", "q", "r", name)}
    sf, cf, st, ct = np.sin(x["phi"]), np.cos(x["phi"]), np.sin(x["theta"]), np.cos(x["theta"])
    turn = (x["q"] * sf + x["r"] * cf) / np.where(np.abs(ct) < 0.1, 0.1, ct)
    rates = {"phi": x["p"] + turn * st, "theta": x["q"] * cf - x["r"] * sf, "psi": turn}
    rate, step = rates[name], np.diff(data["time"].values)
    grown = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step)])
    angle = x[name] if name == "theta" else _unwrapped(x[name])
    blocks = len(angle) // _BLOCK
    y, z = (_without_trend(part[: blocks * _BLOCK].reshape(blocks, -1)) for part in (angle, grown))
    whole = np.isfinite(y).all(axis=1) & np.isfinite(z).all(axis=1)
    y, z = y[whole].ravel(), z[whole].ravel()
    size = float(np.sqrt((y @ y) * (z @ z)))
    if not size or float(y @ z) / size < _CORRELATION:
        return None
    return float(np.sqrt((z @ z) / (y @ y)))


def _unwrapped(x: np.ndarray) -> np.ndarray:
    return np.unwrap(x) if np.isfinite(x).all() else x


def _without_trend(blocks: np.ndarray) -> np.ndarray:
    """Return rows without their straight line."""
    t = np.linspace(-1.0, 1.0, blocks.shape[1])
    slope = blocks @ t / (t @ t)
    return blocks - blocks.mean(axis=1, keepdims=True) - slope[:, None] * t
