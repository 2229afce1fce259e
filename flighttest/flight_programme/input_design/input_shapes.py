"""Test inputs that move one axis at a time: doublet, 1-2-1, 3-2-1-1, other multisteps, sweep.

The power of a multistep lies about one value of omega dt, with dt the length of its unit step. So
the mode that is to be excited determines dt.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flighttest.flight_programme.input_design.input_signals import (
    LEAD_IN,
    RATE,
    assemble_signal,
    axes_of,
)

PATTERNS = {"doublet": (1, 1), "1-2-1": (1, 2, 1), "3-2-1-1": (3, 2, 1, 1)}
# Value of omega dt for the mode: the peak of the spectrum. It is the upper middle of the band for
# 3-2-1-1, whose band is broad.
PLACE = {"doublet": 2.3, "1-2-1": 1.75, "3-2-1-1": 1.6}
# Fewest samples per cycle of the highest frequency of a sweep.
_SAMPLES_PER_CYCLE = 10.0
# Fewest cycles of the first frequency of a sweep.
_CYCLES = 4.0


def unit_step(pattern: str, omega: float) -> float:
    """Return the length of the unit step of a multistep that excites a mode. [s]

    Parameters
    ----------
    pattern : {"doublet", "1-2-1", "3-2-1-1"}
    omega : float
        Natural frequency of the mode. [rad s-1]

    Examples
    --------
    >>> unit_step("3-2-1-1", 4.0)
    0.4
    """
    if pattern not in PLACE:
        raise UnknownName(pattern, PLACE, "pattern")
    if not omega > 0.0:
        raise SchemaError("multistep", [f"natural frequency {omega:g} rad/s; it must be positive"])
    return PLACE[pattern] / omega


def multistep(
    axis: str,
    amplitude: float,
    step: float,
    widths: Sequence[float] = PATTERNS["3-2-1-1"],
    rate: float = RATE,
    lead_in: float = LEAD_IN,
    rise: float = 0.0,
    free: float = 0.0,
) -> xr.Dataset:
    """Return steps of alternating sign.

    Parameters
    ----------
    axis : str
        Quantity that moves.
    amplitude : float
        Height of the steps; its sign is the sign of the first step. [SI]
    step : float
        Length of the unit step, as from `unit_step`. [s]
    widths : sequence of float
        Lengths in unit steps: ``PATTERNS["doublet"]`` ...
    rate, lead_in : float
        Samples per second [Hz]; quiet time before and after [s].
    rise : float
        Length of the ramp of every edge, centred on it; 0 is one sample. [s]
    free : float
        Quiet time after the last step that counts as moving: the free response. [s]

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    SchemaError
        A step is shorter than two samples or than the ramp.
    """
    lookup(axis)
    edges = np.cumsum([0.0, *(np.asarray(widths, float) * step)])
    shortest, ramp = float(np.diff(edges).min()), max(rise, 1.0 / rate)
    if not shortest >= max(2.0 / rate, ramp):
        problem = (
            f"the shortest step takes {shortest:g} s; at {rate:g} Hz and a rise of {ramp:g} s it "
            "is too short"
        )
        raise SchemaError("multistep", [problem])
    # levels before, between and after the edges: 0, 1, -1, ..., 0
    levels = np.zeros(len(widths) + 2)
    levels[1:-1:2], levels[2:-1:2] = 1.0, -1.0
    time = np.arange(int(np.ceil((edges[-1] + ramp + free) * rate)) + 1) / rate
    # ramps from 0 to 1, (edge, time); the first is centred half a ramp after the start
    centres = edges[:, None] + ramp / 2.0
    ramps = np.clip((time - (centres - ramp / 2.0)) / ramp, 0.0, 1.0)
    jumps = np.diff(levels)[:, None] * ramps
    return assemble_signal(
        {axis: amplitude * jumps.sum(axis=0)}, rate, lead_in=lead_in, kind="multistep"
    )


def sweep(
    axis: str,
    amplitude: float,
    band: tuple[float, float],
    duration: float,
    rate: float = RATE,
    lead_in: float = LEAD_IN,
    law: str = "logarithmic",
    fade: float = 0.05,
) -> xr.Dataset:
    """Return a sine whose frequency rises from one end of a band to the other.

    Parameters
    ----------
    axis : str
        Quantity that moves.
    amplitude : float
        [SI]
    band : (float, float)
        First and last frequency. [Hz]
    duration : float
        Time from the first to the last frequency, at least four cycles of the first. [s]
    rate, lead_in : float
        Samples per second [Hz]; quiet time before and after [s].
    law : {"logarithmic", "linear"}
        Equal time per octave, or per hertz.
    fade : float
        Part of the duration over which the amplitude grows at the start and falls at the end.

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    SchemaError
        The band is upside down, a cycle has too few samples, or the duration is too short.
    """
    lookup(axis)
    if law not in ("logarithmic", "linear"):
        raise ValueError(f"law is {law!r}; allowed: logarithmic, linear")
    _check_sweep(band, duration, rate)
    low, high = band
    # time over duration, and the integral of the frequency over it
    s = np.arange(round(duration * rate) + 1) / (duration * rate)
    if law == "linear":
        cycles = duration * (low * s + (high - low) * s**2 / 2.0)
    else:
        growth = np.log(high / low)
        cycles = duration * low * np.expm1(growth * s) / growth
    envelope = np.ones_like(s)
    if fade > 0.0:
        envelope = np.clip(np.minimum(s, 1.0 - s) / fade, 0.0, 1.0)
    u = amplitude * envelope * np.sin(2.0 * np.pi * cycles)
    return assemble_signal({axis: u}, rate, lead_in=lead_in, kind="sweep")


def _check_sweep(band: tuple[float, float], duration: float, rate: float) -> None:
    """Raise SchemaError for a band or a duration that gives no proper sweep."""
    low, high = band
    highest = rate / _SAMPLES_PER_CYCLE
    problems = []
    if not 0.0 < low < high <= highest:
        problems.append(f"band {low:g} ... {high:g} Hz; allowed: rising, up to {highest:g} Hz")
    if low > 0.0 and duration < _CYCLES / low:
        problems.append(
            f"{duration:g} s hold {duration * low:.1f} cycles of {low:g} Hz; give at least "
            f"{_CYCLES / low:g} s"
        )
    if problems:
        raise SchemaError("sweep", problems)


def in_sequence(signals: Sequence[xr.Dataset], pause: float = 0.0) -> xr.Dataset:
    """Return several test inputs one after the other as one input: rudder, then aileron.

    Parameters
    ----------
    signals : sequence of Dataset (time,)
        All of one rate.  An axis that a signal does not have is zero meanwhile.
    pause : float
        Additional quiet time between them. [s]

    Raises
    ------
    SchemaError
        The rates differ, or there is no signal.
    """
    rates = {float(signal.attrs["rate"]) for signal in signals}
    if len(rates) != 1:
        listed = ", ".join(f"{rate:g}" for rate in sorted(rates)) or "none"
        raise SchemaError("test inputs in sequence", [f"rates {listed}; give one rate"])
    if len(signals) == 1:
        return signals[0]
    rate = rates.pop()
    gap = np.zeros(round(pause * rate))
    # axes in the order of their first signal
    columns: dict[str, list[np.ndarray]] = {}
    for signal in signals:
        for name in axes_of(signal):
            columns.setdefault(name, [])
    for number, signal in enumerate(signals):
        # the last sample is the trim; the next signal, or the assembled input, adds it again
        size = signal.sizes["time"] - 1
        for name, parts in columns.items():
            if number:
                parts.append(gap)
            if name in signal:
                parts.append(signal[name].values[:size])
            else:
                parts.append(np.zeros(size))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    return assemble_signal(joined, rate, lead_in=0.0, kind="sequence")
