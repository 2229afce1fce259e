"""Orthogonal phase-optimised multisines: all surfaces move at once, each on frequencies of its own.

    u_j = sum over k in K_j of A_k cos(2 pi k t/T + phi_k)        [Morelli2003]

The sets K_j of harmonics of 1/T are disjoint, so over a period the inputs are orthogonal in time and in frequency, whatever the
powers and phases.  They are dealt out in turn, so that every input spans its whole band.

References
----------
.. [Morelli2003] Morelli, Multiple input design for real-time parameter estimation in the frequency domain, IFAC 2003.
.. [Morelli2012] Morelli, Flight test maneuvers for efficient aerodynamic modeling, J. Aircraft 49, 2012.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import lookup

from .input_signals import LEAD_IN, RATE, assembled
from .phase_optimisation import fine_samples, optimise_phases, synthesise

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
        Relative power over frequency [Hz], linear between the points and held beyond; flat when empty.
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
        By quantity: ``delta_e``, ``delta_a_left``, ``throttle`` ...; the order decides who gets the lowest line.
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
        Deflections from trim per axis, zero at both ends of a period [SI]; ``power`` [SI squared] and ``phase`` [rad] of the lines
        (cosines from the start of the period), zero and NaN for lines of other axes.  Attribute ``period``.

    Raises
    ------
    SchemaError
        Every fault: a band without lines, lines used twice, too few samples per cycle, a period of no whole number of samples.
    UnknownName
        An axis that is not in the vocabulary.
    """
    for name in axes:
        lookup(name)
    lines = deal_harmonics(axes, period)
    count = round(period * rate)
    problems = [f"{count / rate:g} s are {count} samples, the period is {period:g} s"] if abs(count - period * rate) > 1e-6 else []
    problems += [
        f"{name} reaches {max(k) / period:g} Hz; {rate:g} samples per second allow {rate / RATE_OVER_BAND:g} Hz"
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
        peak = max(np.abs(synthesise(k, relative, phi, samples)).max() for samples in (count, _FINER * fine_samples(k)))
        scaled = relative * (axis.amplitude / peak) ** 2
        active[name] = synthesise(k, scaled, phi, count)
        at = np.searchsorted(every, k)
        power[row, at], phase[row, at] = scaled, phi
    signal = assembled(active, rate, lead_in, repeats, kind="multisine")
    signal["power"] = ("axis", "harmonic"), power, {"units": "1", "long_name": "mean square of each line, SI squared"}
    signal["phase"] = ("axis", "harmonic"), phase, {"units": "rad", "long_name": "phase of the cosine at the start of a period"}
    frequency = ("harmonic", np.array(every) / period, {"units": "Hz"})
    return signal.assign_coords(axis=list(axes), harmonic=every, frequency=frequency).assign_attrs(period=period, seed=seed)


def deal_harmonics(axes: Mapping[str, InputAxis], period: float) -> dict[str, list[int]]:
    """Return the harmonics of each axis: disjoint, dealt out in turn from the lowest to the highest.

    Where the same n axes may have lines, each gets every n-th: equal spacing, also across excluded bands, allows the lowest peaks
    (1.14 for eight lines, against 1.3 and more for irregular ones).  Lines chosen by hand are kept from the others.

    Raises
    ------
    SchemaError
        A band that is upside down or holds no line that is free, an amplitude that is not positive, a line chosen twice.
    """
    problems = [f"{name}: amplitude {axis.amplitude:g}; it must be positive" for name, axis in axes.items() if not axis.amplitude > 0.0]
    chosen: dict[str, list[int]] = {name: sorted(axis.harmonics) for name, axis in axes.items() if axis.harmonics}
    taken = [n for own in chosen.values() for n in own]
    problems += [f"harmonic {n} is chosen twice; every line belongs to one axis" for n in sorted({n for n in taken if taken.count(n) > 1})]
    problems += [f"harmonic {n} is below {LEAST_HARMONIC}: less than two cycles per period" for n in taken if n < LEAST_HARMONIC]
    allowed = {name: [k for k in _allowed(axis, period) if k not in taken] for name, axis in axes.items() if not axis.harmonics}
    dealt: dict[str, list[int]] = {name: [] for name in allowed}
    lines = sorted(set().union(*allowed.values())) if allowed else []
    for k in lines:
        bidders = [name for name in allowed if k in allowed[name]]
        dealt[bidders[(k - lines[0]) % len(bidders)]].append(k)
    for name, own in dealt.items():
        low, high = axes[name].band
        if not own:
            need = f"lines lie every {1.0 / period:g} Hz from {LEAST_HARMONIC / period:g} Hz on; widen the band or lengthen the period"
            problems.append(f"{name}: no line is free in {low:g} ... {high:g} Hz; {need}")
    if problems or not axes:
        raise SchemaError("multisine", problems or ["no axis"])
    return {name: chosen.get(name) or dealt[name] for name in axes}


def _allowed(axis: InputAxis, period: float) -> list[int]:
    low, high = axis.band
    first, last = max(LEAST_HARMONIC, int(np.ceil(low * period - 1e-9))), int(np.floor(high * period + 1e-9))
    return [k for k in range(first, last + 1) if not any(a - 1e-9 <= k / period <= b + 1e-9 for a, b in axis.exclude)]


def _relative_power(axis: InputAxis, frequency: np.ndarray) -> np.ndarray:
    """Power of the lines, sum one."""
    if not axis.spectrum:
        return np.full(len(frequency), 1.0 / len(frequency))
    points = sorted(axis.spectrum.items())
    power = np.interp(frequency, [f for f, _ in points], [p for _, p in points])
    if not (power > 0.0).all():
        bad = ", ".join(f"{f:g}" for f in frequency[power <= 0.0])
        raise SchemaError("multisine", [f"spectrum without power at {bad} Hz, where lines lie; exclude the band instead"])
    return power / power.sum()
