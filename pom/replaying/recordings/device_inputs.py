"""Inputs that drove a device, compared with those of the flight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flightmech.names import lookup
from flightmech.units import from_si
from pom.cases.case_file import WIND
from pom.cases.job import ReplayJob
from pom.status import RECORDING_FAULT
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of

MOST_DELAY = 0.1  # [s] between the inputs of device and flight; larger ones are a departure
MOST_DIFFERENCE = 0.08
"""Largest rms difference of an input of the device, as a share of the movement of the input."""
MOST_GAIN = 0.1
"""Largest difference from 1 of the size of an input of the device over that of the flight."""
LEAST_MOVED = {"rad": 0.0175, "1": 0.02, "m": 0.005, "N": 5.0}
"""By unit: movement below which an input counts as held.  Others: 2 % of the largest size. [SI]"""
_LAGS = np.arange(-1.0, 1.001, 0.02)  # [s]
OPPOSITE = 0.25
"""Of the variance that the best delay leaves: an input of opposite sign leaves less."""


def compare_inputs(job: ReplayJob, outputs: Mapping[str, np.ndarray]) -> Iterator[RowRemark]:
    """Yield the remarks on the inputs that drove a device, compared with those of the flight.

    A device that was driven otherwise proves nothing, and a clock that is off looks like a delay.
    """
    missing: list[str] = []
    held: list[str] = []
    compared: list[str] = []
    for name in job.needed_inputs:
        if name in WIND:
            continue
        values = job.inputs[name]
        # the drive of an engine is recorded as the quantity itself
        quantity = name.removesuffix("_drive")
        source = output_of(quantity, outputs)
        if source not in outputs:
            is_moved = np.ptp(values) > _least_moved(quantity, values)
            (missing if is_moved else held).append(quantity)
            continue
        size = max(float(np.ptp(values)), _least_moved(quantity, values))
        difference = outputs[source] - values
        rms = float(np.sqrt(np.nanmean(difference**2)))
        unit = lookup(quantity.rpartition(".")[2] or quantity).display_units
        shown = f"{float(from_si(rms, unit)):.3g} {unit}".replace(" 1", "")
        text = f"{quantity} {shown} rms, {100.0 * rms / size:.3g} % of its movement"
        is_other = rms > MOST_DIFFERENCE * size
        if np.ptp(values) > _least_moved(quantity, values):
            delay, sign = _delay_and_sign(job.time, values, outputs[source])
            # a short input in a long window has a small rms, whatever its size
            gain = _gain(job.time, values, outputs[source], delay=delay)
            text += f", {gain:.2f} times its size, {delay:+.2f} s"
            if sign < 0.0:
                text += ", of opposite sign: turn its sign in the name map of the recording"
            is_other = is_other or abs(delay) > MOST_DELAY or not abs(gain - 1.0) <= MOST_GAIN
        compared.append(text)
        if is_other:
            yield RowRemark(
                "departure",
                f"departure: the inputs of the device are not those of the flight: {text}",
                RECORDING_FAULT,
            )
    if compared:
        yield RowRemark(
            "device", f"inputs of the device from those of the flight: {'; '.join(compared)}"
        )
    if held:
        text = f"not checked: {', '.join(held)} of the device, held in flight (not recorded)"
        yield RowRemark("not_checked", text)
    if missing:
        yield RowRemark(
            "departure",
            f"departure: the recording has no {', '.join(missing)}, so nothing shows that the "
            f"inputs of the flight drove the device",
            RECORDING_FAULT,
        )


def _least_moved(quantity: str, values: np.ndarray) -> float:
    unit = lookup(quantity.rpartition(".")[2] or quantity).units
    return LEAST_MOVED.get(unit, 0.02 * float(np.max(np.abs(values))) or 1.0)


def _delay_and_sign(
    time: np.ndarray, flight: np.ndarray, device: np.ndarray
) -> tuple[float, float]:
    """Return the delay of the input of a device after that of the flight [s], and its sign.

    The sign is -1 if the input with the other sign is much nearer to that of the flight.
    """
    good = np.isfinite(device)
    if good.sum() < 2:
        return 0.0, 1.0
    sums: dict[float, list[float]] = {1.0: [], -1.0: []}
    for lag in _LAGS:
        # The best lag leaves the least variance; a constant difference does not count.
        inside = (time + lag >= time[good][0]) & (time + lag <= time[good][-1])
        shifted = np.interp(time[inside] + lag, time[good], device[good])
        for sign, left in sums.items():
            left.append(float(np.var(sign * shifted - flight[inside])))
    # a doublet of the same sign, half a period later, looks like one of the other sign
    is_opposite = min(sums[-1.0]) < OPPOSITE * min(sums[1.0])
    sign = -1.0 if is_opposite else 1.0
    return float(_LAGS[int(np.argmin(sums[sign]))]), sign


def _gain(time: np.ndarray, flight: np.ndarray, device: np.ndarray, *, delay: float) -> float:
    """Return the size of the movement of an input of a device over that of the flight."""
    good = np.isfinite(device)
    if good.sum() < 2:
        return np.nan
    inside = (time + delay >= time[good][0]) & (time + delay <= time[good][-1])
    shifted = np.interp(time[inside] + delay, time[good], device[good])
    moved = flight[inside] - np.mean(flight[inside])
    return float(np.dot(shifted - np.mean(shifted), moved) / np.dot(moved, moved))
