"""Inputs for one axis at a time, for hands or for a computer: doublet, 1-2-1, 3-2-1-1 and other multisteps, frequency sweep.

The power of a multistep lies about one value of omega dt, dt being the length of its unit step, so dt follows from the mode that
is to be excited.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup

from .input_signals import LEAD_IN, RATE, assembled

PATTERNS = {"doublet": (1, 1), "1-2-1": (1, 2, 1), "3-2-1-1": (3, 2, 1, 1)}
# omega dt at which the mode should lie: the peak of the spectrum; upper middle of the band for 3-2-1-1, whose band is broad
PLACE = {"doublet": 2.3, "1-2-1": 1.75, "3-2-1-1": 1.6}


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
        Height of the steps; the sign is that of the first. [SI]
    step : float
        Length of the unit step; `unit_step` finds it. [s]
    widths : sequence of float
        Lengths in unit steps: ``PATTERNS["doublet"]`` ...
    rate, lead_in : float
        Samples per second [Hz]; quiet stretch before and after [s].
    rise : float
        Length of the ramp of every edge, centred on it; 0 is one sample. [s]
    free : float
        Quiet stretch after the last step that still counts as moving: the free response. [s]

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    SchemaError
        Steps shorter than two samples or than the ramp.
    """
    lookup(axis)
    edges = np.cumsum([0.0, *(np.asarray(widths, float) * step)])
    shortest, ramp = float(np.diff(edges).min()), max(rise, 1.0 / rate)
    if not shortest >= max(2.0 / rate, ramp):
        raise SchemaError("multistep", [f"the shortest step takes {shortest:g} s; at {rate:g} Hz and a rise of {ramp:g} s it is too short"])
    signs = np.array([0.0, *(1.0 if k % 2 == 0 else -1.0 for k in range(len(widths))), 0.0])
    start = ramp / 2.0
    time = np.arange(int(np.ceil((edges[-1] + ramp + free) * rate)) + 1) / rate
    jumps = np.diff(signs)[:, None] * np.clip((time - (edges[:, None] + start - ramp / 2.0)) / ramp, 0.0, 1.0)
    return assembled({axis: amplitude * jumps.sum(axis=0)}, rate, lead_in, kind="multistep")


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
        Time from the first to the last frequency; four cycles of the first fit in, at least. [s]
    rate, lead_in : float
        Samples per second [Hz]; quiet stretch before and after [s].
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
        A band upside down, too few samples per cycle, too short a duration.
    """
    lookup(axis)
    if law not in ("logarithmic", "linear"):
        raise ValueError(f"law is {law!r}; allowed: logarithmic, linear")
    low, high = band
    problems = [] if 0.0 < low < high <= rate / 10.0 else [f"band {low:g} ... {high:g} Hz; allowed: rising, up to {rate / 10.0:g} Hz"]
    if low > 0.0 and duration < 4.0 / low:
        problems.append(f"{duration:g} s hold {duration * low:.1f} cycles of {low:g} Hz; give at least {4.0 / low:g} s")
    if problems:
        raise SchemaError("sweep", problems)
    s = np.arange(round(duration * rate) + 1) / (duration * rate)
    if law == "linear":
        cycles = duration * (low * s + (high - low) * s**2 / 2.0)
    else:
        growth = np.log(high / low)
        cycles = duration * low * np.expm1(growth * s) / growth
    envelope = np.clip(np.minimum(s, 1.0 - s) / fade, 0.0, 1.0) if fade > 0.0 else np.ones_like(s)
    return assembled({axis: amplitude * envelope * np.sin(2.0 * np.pi * cycles)}, rate, lead_in, kind="sweep")


def in_sequence(signals: Sequence[xr.Dataset], pause: float = 0.0) -> xr.Dataset:
    """Return several test inputs one after the other, as one: rudder, then aileron.

    Parameters
    ----------
    signals : sequence of Dataset (time,)
        All of one rate; axes that one of them lacks rest meanwhile.
    pause : float
        Additional quiet stretch between them. [s]

    Raises
    ------
    SchemaError
        Different rates, or none.
    """
    rates = {float(one.attrs["rate"]) for one in signals}
    if len(rates) != 1:
        raise SchemaError("test inputs in sequence", [f"rates {', '.join(f'{r:g}' for r in sorted(rates)) or 'none'}; give one rate"])
    if len(signals) == 1:
        return signals[0]
    rate = rates.pop()
    names = list(dict.fromkeys(str(name) for one in signals for name, item in one.data_vars.items() if item.dims == ("time",)))
    gap = np.zeros(round(pause * rate))
    columns: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for number, one in enumerate(signals):
        size = one.sizes["time"] - 1
        for name in names:
            columns[name] += [*([gap] if number else []), one[name].values[:size] if name in one else np.zeros(size)]
    return assembled({name: np.concatenate(parts) for name, parts in columns.items()}, rate, 0.0, kind="sequence")
