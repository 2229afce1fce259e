"""Orthogonal multisines: test inputs that move several axes at the same time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import lookup
from flighttest.flight_programme.input_design.input_signals import LEAD_IN, RATE, assemble_signal
from flighttest.flight_programme.input_design.phases import (
    fine_samples,
    optimise_phases,
    synthesise_period,
)

# Lowest harmonic: two full cycles of the slowest line per period.
LEAST_HARMONIC = 2
# Fewest samples per cycle of the fastest line.
RATE_OVER_BAND = 10.0
# Samples for the final peak over samples of the search. The error of the peak between samples is
# then 3e-4.
_FINER = 8
# Rounding of a frequency times a period, in lines.
_ROUNDING = 1e-9
# Attributes of the tables of lines.
_POWER = {"units": "1", "long_name": "mean square of each line, SI squared"}
_PHASE = {"units": "rad", "long_name": "phase of the cosine at the start of a period"}


@dataclass(frozen=True)
class InputAxis:
    """Requested input of one axis of a multisine.

    Parameters
    ----------
    amplitude : float
        Largest deflection from trim. [SI]
    band : (float, float)
        Lowest and highest frequency. [Hz]
    exclude : sequence of (float, float)
        Bands without power: a structural mode, a notch of the autopilot. [Hz]
    spectrum : mapping of float to float
        Relative power over frequency [Hz], linear between the points and constant beyond them;
        flat when empty.
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
        By quantity: ``delta_e``, ``throttle`` ...  The first axis gets the lowest line.
    period : float
        Length T of one period; lines lie at multiples of 1/T. [s]
    rate : float
        Samples per second; a period has a whole number of samples. [Hz]
    lead_in : float
        Quiet time before and after. [s]
    repeats : int
        Periods, joined without a seam.
    seed : int
        Seed of the search for phases.  Other seeds give other signals of the same spectrum.

    Returns
    -------
    Dataset (time,) with (axis, harmonic)
        Deflections from trim per axis, zero at both ends of a period [SI].  ``power`` [SI squared]
        and ``phase`` [rad] of the lines (cosines), zero and NaN for lines of other axes.

    Raises
    ------
    SchemaError
        A band without lines, a line used twice, too few samples per cycle or per period.
    UnknownName
        An axis is not in the vocabulary.
    """
    for name in axes:
        lookup(name)
    lines = deal_harmonics(axes, period)
    count = round(period * rate)
    _check_sampling(lines, period, rate=rate, count=count)
    harmonics = sorted(chain.from_iterable(lines.values()))
    # lines of other axes have zero power and no phase
    power = np.zeros((len(axes), len(harmonics)))
    phase = np.full((len(axes), len(harmonics)), np.nan)
    active = {}
    for row, (name, axis) in enumerate(axes.items()):
        k = np.array(lines[name])
        axis_power, axis_phase = _design_lines(axis, k, period, count=count, seed=seed + row)
        active[name] = synthesise_period(k, axis_power, axis_phase, count)
        columns = np.searchsorted(harmonics, k)
        power[row, columns], phase[row, columns] = axis_power, axis_phase
    signal = assemble_signal(active, rate, lead_in=lead_in, repeats=repeats, kind="multisine")
    signal["power"] = (("axis", "harmonic"), power, _POWER)
    signal["phase"] = (("axis", "harmonic"), phase, _PHASE)
    frequency = ("harmonic", np.array(harmonics) / period, {"units": "Hz"})
    signal = signal.assign_coords(axis=list(axes), harmonic=harmonics, frequency=frequency)
    return signal.assign_attrs(period=period, seed=seed)


def _check_sampling(
    lines: Mapping[str, Sequence[int]], period: float, *, rate: float, count: int
) -> None:
    """Raise SchemaError if the samples do not fit the period or the fastest line."""
    problems = []
    if abs(count - period * rate) > 1e-6:
        problems.append(f"{count / rate:g} s are {count} samples, the period is {period:g} s")
    highest = rate / RATE_OVER_BAND
    for name, k in lines.items():
        if max(k) / period > highest * (1.0 + _ROUNDING):
            problems.append(
                f"{name} reaches {max(k) / period:g} Hz; {rate:g} samples per second allow "
                f"{highest:g} Hz"
            )
    if problems:
        raise SchemaError("multisine", problems)


def _design_lines(
    axis: InputAxis, k: np.ndarray, period: float, *, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return power and phase of the lines of one axis, scaled to its amplitude."""
    relative = _relative_power(axis, k / period)
    phases = optimise_phases(k, relative, seed=seed)
    # the peak of the signal that is played, and of the same signal between its samples
    played = np.abs(synthesise_period(k, relative, phases, count)).max()
    fine = np.abs(synthesise_period(k, relative, phases, _FINER * fine_samples(k))).max()
    return relative * (axis.amplitude / max(played, fine)) ** 2, phases


def deal_harmonics(axes: Mapping[str, InputAxis], period: float) -> dict[str, list[int]]:
    """Return the harmonics of each axis: disjoint, assigned in turn from the lowest on.

    If the same n axes may have lines, each gets every n-th line. Equal spacing, also across
    excluded bands, allows the lowest peaks (1.14 for eight lines, against 1.3 and more for
    irregular lines). Lines chosen by hand are not assigned to other axes.

    Raises
    ------
    SchemaError
        A band is upside down or has no free line, an amplitude is not positive, or a line is chosen
        twice.
    """
    problems = []
    for name, axis in axes.items():
        if not axis.amplitude > 0.0:
            problems.append(f"{name}: amplitude {axis.amplitude:g}; it must be positive")
    chosen = {name: sorted(axis.harmonics) for name, axis in axes.items() if axis.harmonics}
    by_hand = list(chain.from_iterable(chosen.values()))
    problems += _check_chosen(by_hand)
    assigned = _assign_in_turn(axes, period, by_hand=by_hand)
    for name, harmonics in assigned.items():
        low, high = axes[name].band
        if not harmonics:
            problems.append(
                f"{name}: no line is free in {low:g} ... {high:g} Hz; lines lie every "
                f"{1.0 / period:g} Hz from {LEAST_HARMONIC / period:g} Hz on; widen the band or "
                "lengthen the period"
            )
    if problems or not axes:
        raise SchemaError("multisine", problems or ["no axis; give at least one"])
    return {name: chosen.get(name) or assigned[name] for name in axes}


def _check_chosen(by_hand: Sequence[int]) -> list[str]:
    """Return the faults of harmonics that are chosen by hand."""
    problems = []
    for n in sorted(set(by_hand)):
        if by_hand.count(n) > 1:
            problems.append(f"harmonic {n} is chosen twice; every line belongs to one axis")
    for n in by_hand:
        if n < LEAST_HARMONIC:
            problems.append(
                f"harmonic {n} is below {LEAST_HARMONIC}: less than two cycles per period"
            )
    return problems


def _assign_in_turn(
    axes: Mapping[str, InputAxis], period: float, *, by_hand: Sequence[int]
) -> dict[str, list[int]]:
    """Return the harmonics of the axes without a choice by hand."""
    allowed: dict[str, list[int]] = {}
    for name, axis in axes.items():
        if not axis.harmonics:
            allowed[name] = [k for k in _harmonics_in_band(axis, period) if k not in by_hand]
    assigned: dict[str, list[int]] = {name: [] for name in allowed}
    lines = sorted(set().union(*allowed.values()))
    for k in lines:
        # the distance to the first line, not the count of lines, decides whose turn it is: the
        # spacing of an axis then stays equal across an excluded band
        bidders = [name for name in allowed if k in allowed[name]]
        assigned[bidders[(k - lines[0]) % len(bidders)]].append(k)
    return assigned


def _harmonics_in_band(axis: InputAxis, period: float) -> list[int]:
    """Return the harmonics inside the band and outside the excluded bands of an axis."""
    low, high = axis.band
    first = max(LEAST_HARMONIC, int(np.ceil(low * period - _ROUNDING)))
    last = int(np.floor(high * period + _ROUNDING))
    harmonics = []
    for k in range(first, last + 1):
        frequency = k / period
        if not any(a - _ROUNDING <= frequency <= b + _ROUNDING for a, b in axis.exclude):
            harmonics.append(k)
    return harmonics


def _relative_power(axis: InputAxis, frequency: np.ndarray) -> np.ndarray:
    """Return the power of the lines, with the sum one."""
    if not axis.spectrum:
        return np.full(len(frequency), 1.0 / len(frequency))
    frequencies = sorted(axis.spectrum)
    power = np.interp(frequency, frequencies, [axis.spectrum[f] for f in frequencies])
    if not (power > 0.0).all():
        powerless = ", ".join(f"{f:g}" for f in frequency[power <= 0.0])
        problem = (
            f"spectrum without power at {powerless} Hz, where lines lie; exclude the band instead"
        )
        raise SchemaError("multisine", [problem])
    return power / power.sum()
