"""Inputs for one axis at a time, for hands or for a computer: doublet, 1-2-1, 3-2-1-1 and other
multisteps, frequency sweep.

The power of a multistep lies about one value of omega dt, dt being the length of its unit step, so
dt follows from the mode that is to be excited.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flighttest.flight_programme.input_design.input_signals import (
    LEAD_IN,
    RATE,
    assemble_signal,
    fine_samples,
    optimise_phases,
    synthesise_period,
)

LEAST_HARMONIC = 2  # two full cycles of the slowest line per period
RATE_OVER_BAND = 10.0  # samples per cycle of the fastest line, at least
_FINER = 8  # than the samples of the search: the peak between samples is then seen to 3e-4


@dataclass(frozen=True)
class InputAxis:
    """What one input of a multisine is to be.

    Parameters
    ----------
    amplitude : float
        Largest deflection from trim. [SI]
    band : (float, float)
        Lowest and highest frequency. [Hz]
    exclude : sequence of (float, float)
        Bands without power: a structural mode, a notch of the autopilot. [Hz]
    spectrum : mapping of float to float
        Relative power over frequency [Hz], linear between the points and held beyond; flat when
        empty.
    harmonics : sequence of int
        Lines, in cycles per period, when they are chosen by hand.
    """

    amplitude: float
    band: tuple[float, float]
    exclude: Sequence[tuple[float, float]] = ()
    spectrum: Mapping[float, float] = field(default_factory=dict)
    harmonics: Sequence[int] = ()


def multisine(
    axes: Mapping[str, InputAxis],
    period: float,
    rate: float = RATE,
    lead_in: float = LEAD_IN,
    repeats: int = 1,
    seed: int = 0,
) -> xr.Dataset:
    """Design an orthogonal multisine for one or several axes.

    Parameters
    ----------
    axes : mapping of str to InputAxis
        By quantity: ``delta_e``, ``delta_a_left``, ``throttle`` ...; the order decides who gets the
        lowest line.
    period : float
        Length T of one period; lines lie at multiples of 1/T. [s]
    rate : float
        Samples per second, of which a period holds a whole number. [Hz]
    lead_in : float
        Quiet stretch before and after. [s]
    repeats : int
        Periods, joined without a seam.
    seed : int
        Of the search for phases: other seeds give other signals of the same spectrum.

    Returns
    -------
    Dataset (time,) with (axis, harmonic)
        Deflections from trim per axis, zero at both ends of a period [SI]; ``power`` [SI squared]
        and ``phase`` [rad] of the lines (cosines from the start of the period), zero and NaN for
        lines of other axes.  Attribute ``period``.

    Raises
    ------
    SchemaError
        Every fault: a band without lines, lines used twice, too few samples per cycle, a period of
        no whole number of samples.
    UnknownName
        An axis that is not in the vocabulary.
    """
    for name in axes:
        lookup(name)
    lines = deal_harmonics(axes, period)
    count = round(period * rate)
    problems = (
        [f"{count / rate:g} s are {count} samples, the period is {period:g} s"]
        if abs(count - period * rate) > 1e-6
        else []
    )
    problems += [
        f"{name} reaches {max(k) / period:g} Hz; {rate:g} samples per second allow "
        f"{rate / RATE_OVER_BAND:g} Hz"
        for name, k in lines.items()
        if max(k) / period > rate / RATE_OVER_BAND * (1.0 + 1e-9)
    ]
    if problems:
        raise SchemaError("multisine", problems)
    every = sorted(k for chosen in lines.values() for k in chosen)
    power, phase = np.zeros((len(axes), len(every))), np.full((len(axes), len(every)), np.nan)
    active = {}
    for row, (name, axis) in enumerate(axes.items()):
        k = np.array(lines[name])
        relative = _relative_power(axis, k / period)
        phi = optimise_phases(k, relative, seed + row)
        peak = max(
            np.abs(synthesise_period(k, relative, phi, samples)).max()
            for samples in (count, _FINER * fine_samples(k))
        )
        scaled = relative * (axis.amplitude / peak) ** 2
        active[name] = synthesise_period(k, scaled, phi, count)
        at = np.searchsorted(every, k)
        power[row, at], phase[row, at] = scaled, phi
    signal = assemble_signal(active, rate, lead_in, repeats, kind="multisine")
    signal["power"] = (
        ("axis", "harmonic"),
        power,
        {"units": "1", "long_name": "mean square of each line, SI squared"},
    )
    signal["phase"] = (
        ("axis", "harmonic"),
        phase,
        {"units": "rad", "long_name": "phase of the cosine at the start of a period"},
    )
    frequency = ("harmonic", np.array(every) / period, {"units": "Hz"})
    return signal.assign_coords(axis=list(axes), harmonic=every, frequency=frequency).assign_attrs(
        period=period, seed=seed
    )


def deal_harmonics(axes: Mapping[str, InputAxis], period: float) -> dict[str, list[int]]:
    """Return the harmonics of each axis: disjoint, dealt out in turn from the lowest to the
    highest.

    Where the same n axes may have lines, each gets every n-th: equal spacing, also across excluded
    bands, allows the lowest peaks (1.14 for eight lines, against 1.3 and more for irregular ones).
    Lines chosen by hand are kept from the others.

    Raises
    ------
    SchemaError
        A band that is upside down or holds no line that is free, an amplitude that is not positive,
        a line chosen twice.
    """
    problems = [
        f"{name}: amplitude {axis.amplitude:g}; it must be positive"
        for name, axis in axes.items()
        if not axis.amplitude > 0.0
    ]
    chosen: dict[str, list[int]] = {
        name: sorted(axis.harmonics) for name, axis in axes.items() if axis.harmonics
    }
    taken = [n for own in chosen.values() for n in own]
    problems += [
        f"harmonic {n} is chosen twice; every line belongs to one axis"
        for n in sorted({n for n in taken if taken.count(n) > 1})
    ]
    problems += [
        f"harmonic {n} is below {LEAST_HARMONIC}: less than two cycles per period"
        for n in taken
        if n < LEAST_HARMONIC
    ]
    allowed = {
        name: [k for k in _allowed(axis, period) if k not in taken]
        for name, axis in axes.items()
        if not axis.harmonics
    }
    dealt: dict[str, list[int]] = {name: [] for name in allowed}
    lines = sorted(set().union(*allowed.values())) if allowed else []
    for k in lines:
        bidders = [name for name in allowed if k in allowed[name]]
        dealt[bidders[(k - lines[0]) % len(bidders)]].append(k)
    for name, own in dealt.items():
        low, high = axes[name].band
        if not own:
            need = (
                f"lines lie every {1.0 / period:g} Hz from {LEAST_HARMONIC / period:g} Hz on; "
                f"widen the band or lengthen the period"
            )
            problems.append(f"{name}: no line is free in {low:g} ... {high:g} Hz; {need}")
    if problems or not axes:
        raise SchemaError("multisine", problems or ["no axis"])
    return {name: chosen.get(name) or dealt[name] for name in axes}


def _allowed(axis: InputAxis, period: float) -> list[int]:
    low, high = axis.band
    first, last = (
        max(LEAST_HARMONIC, int(np.ceil(low * period - 1e-9))),
        int(np.floor(high * period + 1e-9)),
    )
    return [
        k
        for k in range(first, last + 1)
        if not any(a - 1e-9 <= k / period <= b + 1e-9 for a, b in axis.exclude)
    ]


def _relative_power(axis: InputAxis, frequency: np.ndarray) -> np.ndarray:
    """Power of the lines, sum one."""
    if not axis.spectrum:
        return np.full(len(frequency), 1.0 / len(frequency))
    points = sorted(axis.spectrum.items())
    power = np.interp(frequency, [f for f, _ in points], [p for _, p in points])
    if not (power > 0.0).all():
        bad = ", ".join(f"{f:g}" for f in frequency[power <= 0.0])
        raise SchemaError(
            "multisine",
            [f"spectrum without power at {bad} Hz, where lines lie; exclude the band instead"],
        )
    return power / power.sum()


PATTERNS = {"doublet": (1, 1), "1-2-1": (1, 2, 1), "3-2-1-1": (3, 2, 1, 1)}
# omega dt at which the mode should lie: the peak of the spectrum; upper middle of the band for
# 3-2-1-1, whose band is broad
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
        raise SchemaError(
            "multistep",
            [
                f"the shortest step takes {shortest:g} s; at {rate:g} Hz and a rise of "
                f"{ramp:g} s it is too short"
            ],
        )
    signs = np.array([0.0, *(1.0 if k % 2 == 0 else -1.0 for k in range(len(widths))), 0.0])
    start = ramp / 2.0
    time = np.arange(int(np.ceil((edges[-1] + ramp + free) * rate)) + 1) / rate
    jumps = np.diff(signs)[:, None] * np.clip(
        (time - (edges[:, None] + start - ramp / 2.0)) / ramp, 0.0, 1.0
    )
    return assemble_signal({axis: amplitude * jumps.sum(axis=0)}, rate, lead_in, kind="multistep")


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
    problems = (
        []
        if 0.0 < low < high <= rate / 10.0
        else [f"band {low:g} ... {high:g} Hz; allowed: rising, up to {rate / 10.0:g} Hz"]
    )
    if low > 0.0 and duration < 4.0 / low:
        problems.append(
            f"{duration:g} s hold {duration * low:.1f} cycles of {low:g} Hz; give at least "
            f"{4.0 / low:g} s"
        )
    if problems:
        raise SchemaError("sweep", problems)
    s = np.arange(round(duration * rate) + 1) / (duration * rate)
    if law == "linear":
        cycles = duration * (low * s + (high - low) * s**2 / 2.0)
    else:
        growth = np.log(high / low)
        cycles = duration * low * np.expm1(growth * s) / growth
    envelope = np.clip(np.minimum(s, 1.0 - s) / fade, 0.0, 1.0) if fade > 0.0 else np.ones_like(s)
    return assemble_signal(
        {axis: amplitude * envelope * np.sin(2.0 * np.pi * cycles)}, rate, lead_in, kind="sweep"
    )


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
        raise SchemaError(
            "test inputs in sequence",
            [f"rates {', '.join(f'{r:g}' for r in sorted(rates)) or 'none'}; give one rate"],
        )
    if len(signals) == 1:
        return signals[0]
    rate = rates.pop()
    names = list(
        dict.fromkeys(
            str(name)
            for one in signals
            for name, item in one.data_vars.items()
            if item.dims == ("time",)
        )
    )
    gap = np.zeros(round(pause * rate))
    columns: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for number, one in enumerate(signals):
        size = one.sizes["time"] - 1
        for name in names:
            columns[name] += [
                *([gap] if number else []),
                one[name].values[:size] if name in one else np.zeros(size),
            ]
    return assemble_signal(
        {name: np.concatenate(parts) for name, parts in columns.items()}, rate, 0.0, kind="sequence"
    )
