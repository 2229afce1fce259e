"""Which single mistake of sign, unit, axis or definition explains the relations that do not hold.

Every mistake a name map can make is tried on every channel of the broken relations: undone, it must
resolve them without breaking others. The best one is taken, and the search goes on with the
corrected record until nothing is left to explain.  A mistake that two channels explain equally well
is reported with both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightmech.names import lookup
from flightmech.units import DEGREE, FOOT, G0, KNOT, POUND_FORCE
from flighttest.reconstruction.quality.checks.relations import (
    RELATIONS,
    Relation,
    RelationCheck,
    compare_all,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels

GAIN = 0.25  # disagreement that a mistake must explain, summed over relations
NEAR = 0.1  # mistakes that explain almost as much are compared more closely, without tolerances
# and cannot be distinguished when what they leave differs by less than this power of e, all
# relations together
TIE = 0.3
_EXACT = 0.005  # disagreement of numbers that were only rounded
_MOST = 6  # mistakes in one record
PSF = POUND_FORCE / FOOT**2


@dataclass(frozen=True)
class Repair:
    """One mistake undone.

    Attributes
    ----------
    kind : str
        ``sign``, ``unit``, ``axis`` or ``definition``.
    channels : tuple of str
        The channel, or the two that change places.
    mistake : str
        What was wrong, in words.
    slope, shift : float
        The channel as it should be is slope * recorded + shift; not used where two change places.
        [1, SI]
    """

    kind: str
    channels: tuple[str, ...]
    mistake: str
    slope: float = 1.0
    shift: float = 0.0

    def apply(self, signals: ResampledChannels) -> ResampledChannels:
        """Return the signals with the mistake undone."""
        if len(self.channels) == 2:
            one, other = self.channels
            return signals.with_values({one: signals[other], other: signals[one]})
        (name,) = self.channels
        return signals.with_values({name: self.slope * signals[name] + self.shift})


@dataclass(frozen=True)
class Explanation:
    """A repair, the relations it resolves, and others that would do as well."""

    repair: Repair
    resolves: tuple[str, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    instead: tuple[Repair, ...]


def find_mistakes(
    signals: ResampledChannels,
) -> tuple[list[Explanation], ResampledChannels, dict[str, RelationCheck]]:
    """Return the mistakes found, the signals without them, and what all relations give then.

    Parameters
    ----------
    signals : Signals
        Channels of a record.

    Returns
    -------
    explanations : list of Explanation
    signals : Signals
    comparisons : dict of Comparison
        By name of the relation.
    """
    found: list[Explanation] = []
    state = _costs(signals)
    while _broken(state) and len(found) < _MOST:
        best = _best(signals, state)
        if best is None:
            break
        found.append(best)
        signals = best.repair.apply(signals)
        state = _costs(signals)
    return found, signals, compare_all(signals)


def total_disagreement(signals: ResampledChannels) -> float:
    """Return the disagreement of all relations that do not hold, and what lies outside the
    plausible ranges.
    """
    state = _costs(signals)
    return sum(state[name] for name in _broken(state))


def plausible_range(name: str) -> tuple[float, float] | None:
    """Return the range that a channel keeps to in any aeroplane, SI; None where there is none."""
    return _RANGES.get(name) or (_SURFACE if name.startswith("delta_") else None)


def units_mistaken(name: str) -> tuple[tuple[str, str, float], ...]:
    """Return what a channel may be in, what it was taken as, and the factor that corrects it."""
    return _UNITS.get(lookup(name).units, ())


_RIGHT, _SURFACE = (-1.6, 1.6), (-1.4, 1.4)
_FORCE, _SPEED = (-150.0, 150.0), (-30.0, 700.0)
_RANGES: dict[str, tuple[float, float]] = {
    **{name: _RIGHT for name in ("theta", "alpha_vane", "beta_vane", "alpha", "beta")},
    "phi": (-3.2, 3.2), "psi": (-40.0, 40.0),
    **{name: (-12.0, 12.0) for name in ("p", "q", "r")},
    **{name: _FORCE for name in ("ax_imu", "ay_imu", "az_imu", "ax", "ay", "az")},
    **{name: _SPEED for name in ("V", "V_cas", "V_eas")},
    **{name: (-700.0, 700.0) for name in ("vn", "ve", "vd")},
    "hdot": (-200.0, 200.0), "mach": (-0.1, 3.0), "h_baro": (-600.0, 25000.0), "h_gps": (-600.0, 25000.0),
    "p_static": (2000.0, 110000.0), "q_c": (-2000.0, 150000.0), "temperature": (170.0, 340.0), "mass": (0.01, 1e6),
}  # fmt: skip


def _costs(signals: ResampledChannels) -> dict[str, float]:
    """Return the disagreement of every relation, and what lies outside the plausible ranges as
    ``range.<channel>``.
    """
    found = {}
    for relation in RELATIONS:
        comparison = relation.compare(signals)
        if comparison is not None:
            found[relation.name] = _cost(comparison)
    for name in signals.values:
        found.update(_range_cost(signals, name))
    return found


def _cost(comparison: RelationCheck) -> float:
    """Disagreement beyond the limit counts; what is below it is noise."""
    return comparison.disagreement if not comparison.consistent else 0.5 * comparison.disagreement


def _range_cost(signals: ResampledChannels, name: str) -> dict[str, float]:
    limits = plausible_range(name)
    good = signals.good[name] & signals.flying
    if limits is None or not good.any():
        return {}
    x = signals[name][good]
    outside = float(np.mean((x < limits[0]) | (x > limits[1])))
    return {f"range.{name}": min(1.0, 2.0 * outside)} if outside > 0.02 else {f"range.{name}": 0.0}


def _broken(state: dict[str, float]) -> list[str]:
    limits = {relation.name: relation.limit for relation in RELATIONS}
    return [name for name, cost in state.items() if cost > limits.get(name, 0.0)]


def _best(signals: ResampledChannels, state: dict[str, float]) -> Explanation | None:
    suspects = {name for relation in _broken(state) for name in _members(relation, signals)}
    tried = [(repair, _change(signals, state, repair)) for repair in _repairs(signals, suspects)]
    gains = [
        (sum(before - after for before, after in change.values()), repair, change)
        for repair, change in tried
    ]
    most = max((gain for gain, _, _ in gains), default=0.0)
    if most < GAIN:
        return None
    near = [(repair, change) for gain, repair, change in gains if gain > most - NEAR]
    left = _left([repair for repair, _ in near], signals)
    order = np.argsort(left, kind="stable")
    repair, change = near[order[0]]
    ties = tuple(near[i][0] for i in order[1:] if left[i] - left[order[0]] < TIE)
    corrected = {name: pair for name, pair in change.items() if pair[0] - pair[1] > 0.1}
    before, after = (tuple(pair[i] for pair in corrected.values()) for i in (0, 1))
    return Explanation(repair, tuple(corrected), before, after, ties)


def _left(repairs: list[Repair], signals: ResampledChannels) -> list[float]:
    """Return the log of what each repair leaves of disagreement, without tolerances, over the
    relations that any of them touches.
    """
    if len(repairs) == 1:
        return [0.0]
    touched = {name for repair in repairs for name in repair.channels}
    relations = [relation for relation in RELATIONS if touched & set(relation.channels(signals))]
    repaired = [repair.apply(signals) for repair in repairs]
    compared = [[relation.compare(state) for relation in relations] for state in repaired]
    return [
        sum(math.log(found.raw + _EXACT) for found in row if found is not None) for row in compared
    ]


def _change(
    signals: ResampledChannels, state: dict[str, float], repair: Repair
) -> dict[str, tuple[float, float]]:
    """Return the costs before and after a repair, of all that reads its channels."""
    repaired = repair.apply(signals)
    found = {}
    for relation in RELATIONS:
        if relation.name in state and set(repair.channels) & set(relation.channels(signals)):
            found[relation.name] = (
                state[relation.name],
                _cost_after(repair, relation.compare(repaired), state[relation.name]),
            )
    for name in repair.channels:
        after = _range_cost(repaired, name)
        found.update({key: (state.get(key, 0.0), value) for key, value in after.items()})
    return found


def _cost_after(repair: Repair, comparison: RelationCheck | None, before: float) -> float:
    """Return the cost after a repair; a unit that only makes a wandering channel small while the
    other side rests explains nothing.
    """
    if comparison is None:
        return before
    after = _cost(comparison)
    return after if repair.kind != "unit" or after > before or comparison.has_signal else before


def _members(relation: str, signals: ResampledChannels) -> tuple[str, ...]:
    if relation.startswith("range."):
        return (relation.removeprefix("range."),)
    return _BY_NAME[relation].channels(signals)


_BY_NAME: dict[str, Relation] = {relation.name: relation for relation in RELATIONS}
_SWAPS = (
    ("p", "q"), ("p", "r"), ("q", "r"), ("phi", "theta"), ("ax_imu", "ay_imu"), ("ax_imu", "az_imu"), ("ay_imu", "az_imu"),
    ("vn", "ve"), ("vn", "vd"), ("ve", "vd"), ("alpha_vane", "beta_vane"),
)  # fmt: skip
_UNITS: dict[str, tuple[tuple[str, str, float], ...]] = {
    "rad": (("deg", "rad", DEGREE),),
    "rad s-1": (("deg/s", "rad/s", DEGREE),),
    "m s-2": (("g", "m/s2", G0), ("ft/s2", "m/s2", FOOT)),
    "m s-1": (
        ("kt", "m/s", KNOT),
        ("ft/s", "m/s", FOOT),
        ("km/h", "m/s", 1.0 / 3.6),
        ("ft/min", "m/s", FOOT / 60.0),
    ),
    "m": (("ft", "m", FOOT),),
    "Pa": (("hPa", "Pa", 100.0), ("kPa", "Pa", 1000.0), ("psf", "Pa", PSF)),
}


def _repairs(signals: ResampledChannels, suspects: set[str]) -> Iterator[Repair]:
    for name in sorted(suspects):
        yield from _of_one(name)
    for one, other in _SWAPS:
        if one in signals and other in signals and suspects & {one, other}:
            yield Repair("axis", (one, other), f"{one} and {other} stand in each other's place")


def _of_one(name: str) -> Iterator[Repair]:
    one, units = (name,), lookup(name).units
    if units not in ("Pa", "K"):
        yield Repair("sign", one, f"{name} has the wrong sign", -1.0)
    if name == "az_imu":
        yield from _load_factors(name)
    for wrong, right, factor in units_mistaken(name):
        yield Repair("unit", one, f"{name} is in {wrong} and was taken as {right}", factor)
        yield Repair("unit", one, f"{name} is in {right} and was taken as {wrong}", 1.0 / factor)
    if units == "K":
        yield Repair("unit", one, f"{name} is in degC and was taken as K", 1.0, 273.15)
        yield Repair("unit", one, f"{name} is in K and was taken as degC", 1.0, -273.15)


def _load_factors(name: str) -> Iterator[Repair]:
    """What recorders call normal acceleration."""
    one = (name,)
    yield Repair(
        "definition",
        one,
        f"{name} is the load factor minus one, positive up, not the specific force",
        -1.0,
        -G0,
    )
    text = f"{name} is the acceleration without gravity, positive down, not the specific force"
    yield Repair("definition", one, text, 1.0, -G0)
    text = f"{name} is the load factor minus one in g, positive up, taken as m/s2"
    yield Repair("definition", one, text, -G0, -G0)
    text = f"{name} is the load factor in g, positive up, taken as m/s2"
    yield Repair("definition", one, text, -G0)
