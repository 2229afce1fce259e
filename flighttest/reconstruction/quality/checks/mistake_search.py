"""Search for the single mistakes that explain the relations that do not hold.

The mistakes are those a name map can make: sign, unit, axis or definition.  Each is tried on every
channel of the broken relations: its correction must resolve them and break no other relation.  The
best repair is applied, and the search continues with the corrected record until nothing remains to
explain.  If two channels explain a mistake equally well, the result names both.

A recorder that counts an angle the other way counts its rate the other way too.  A sensor of other
body axes, such as forward, left and up, has all signs of two axes reversed.  Such channels agree
with each other, and are tried as one mistake.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from flightmech.names import lookup
from flightmech.units import DEGREE, FOOT, G0, KNOT, POUND_FORCE
from flighttest.reconstruction.quality.checks.relation_check import Relation, RelationCheck
from flighttest.reconstruction.quality.checks.relations import RELATIONS, compare_all
from flighttest.reconstruction.quality.checks.signals import ResampledChannels

GAIN = 0.25  # disagreement that a mistake must explain, summed over relations
NEAR = 0.1  # difference of gain below which repairs are compared again, without tolerances
# repairs are not distinguished if the logarithms of the disagreements that remain, summed over the
# relations, differ by less
TIE = 0.3
_EXACT = 0.005  # disagreement of numbers that were only rounded
_MOST = 6  # mistakes in one record
_RESOLVED = 0.1  # decrease above which a disagreement counts as resolved
_FEW_OUTSIDE = 0.02  # share of samples outside the plausible range that spikes account for
PSF = POUND_FORCE / FOOT**2

Costs = dict[str, float]  # disagreement by relation, share outside the range by ``range.<channel>``
Change = dict[str, tuple[float, float]]  # costs before and after a repair


@dataclass(frozen=True)
class Repair:
    """Correction of one mistake.

    Attributes
    ----------
    kind : str
        ``sign``, ``unit``, ``axis`` or ``definition``.
    channels : tuple of str
        The channel, the two channels that are exchanged, or the channels of one wrong sense.
    mistake : str
        What was wrong, in words.
    slope, shift : float
        The correct channel is slope * recorded + shift; not used if two channels are exchanged.
        [1, SI]
    """

    kind: str
    channels: tuple[str, ...]
    mistake: str
    slope: float = 1.0
    shift: float = 0.0

    @property
    def reverses_several(self) -> bool:
        """Whether the signs of several channels are corrected together."""
        return self.kind == "sign" and len(self.channels) > 1

    def apply(self, signals: ResampledChannels) -> ResampledChannels:
        """Return the signals without the mistake."""
        if self.kind == "axis":
            first, second = self.channels
            return signals.with_values({first: signals[second], second: signals[first]})
        changed = {}
        for name in self.channels:
            changed[name] = self.slope * signals[name] + self.shift
        return signals.with_values(changed)


@dataclass(frozen=True)
class Explanation:
    """A repair, the relations it resolves, and the repairs that explain as much."""

    repair: Repair
    resolves: tuple[str, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    instead: tuple[Repair, ...]


def find_mistakes(
    signals: ResampledChannels,
) -> tuple[list[Explanation], ResampledChannels, dict[str, RelationCheck]]:
    """Return the mistakes, the signals without them, and the checks of these signals.

    Parameters
    ----------
    signals : ResampledChannels
        Channels of a record.

    Returns
    -------
    explanations : list of Explanation
    signals : ResampledChannels
    checks : dict of RelationCheck
        By name of the relation.
    """
    explanations: list[Explanation] = []
    costs = _all_costs(signals)
    while _broken_names(costs) and len(explanations) < _MOST:
        explanation = _best_explanation(signals, costs)
        if explanation is None:
            break
        explanations.append(explanation)
        signals = explanation.repair.apply(signals)
        costs = _all_costs(signals)
    return _add_mirror_image(explanations, signals), signals, compare_all(signals)


def total_disagreement(signals: ResampledChannels) -> float:
    """Return the sum of the costs of broken relations and of implausible channels."""
    costs = _all_costs(signals)
    return sum(costs[name] for name in _broken_names(costs))


def plausible_range(name: str) -> tuple[float, float] | None:
    """Return the plausible range of a channel in any aeroplane, SI; None without a range."""
    limits = _RANGES.get(name)
    if limits is None and name.startswith("delta_"):
        return _SURFACE
    return limits


def units_mistaken(name: str) -> tuple[tuple[str, str, float], ...]:
    """Return the unit, the unit assumed by mistake and the correction factor, of each mistake."""
    return _UNITS.get(lookup(name).units, ())


def _add_mirror_image(
    explanations: list[Explanation], signals: ResampledChannels
) -> list[Explanation]:
    """Return the explanations, with all other lateral channels as an alternative.

    A flight seen in a mirror obeys the same relations. So wrong signs of some lateral channels
    cannot be distinguished from wrong signs of all the others. One or two signs are more likely
    than many; if about as many are left, the alternative is named.
    """
    wrong: set[str] = set()
    for explanation in explanations:
        if explanation.repair.kind == "sign":
            wrong.update(set(explanation.repair.channels) & set(_LATERAL))
    others = tuple(name for name in _LATERAL if name in signals and name not in wrong)
    if len(wrong) < 2 or not others or len(others) > len(wrong) + 1:
        return explanations
    text = f"{', '.join(others)} have the wrong sign together, as in a mirror"
    mirrored = Repair("sign", others, text, slope=-1.0)
    completed = []
    for explanation in explanations:
        if set(explanation.repair.channels) <= wrong:
            instead = (*explanation.instead, mirrored)
            explanation = replace(explanation, instead=instead)
        completed.append(explanation)
    return completed


_SURFACE = (-1.4, 1.4)
_RANGES: dict[str, tuple[float, float]] = {
    "phi": (-3.2, 3.2),
    "psi": (-40.0, 40.0),
    "hdot": (-200.0, 200.0),
    "mach": (-0.1, 3.0),
    "h_baro": (-600.0, 25000.0),
    "h_gps": (-600.0, 25000.0),
    "p_static": (2000.0, 110000.0),
    "q_c": (-2000.0, 150000.0),
    "temperature": (170.0, 340.0),
    "mass": (0.01, 1e6),
}
_RANGES |= dict.fromkeys(("theta", "alpha_vane", "beta_vane", "alpha", "beta"), (-1.6, 1.6))
_RANGES |= dict.fromkeys(("p", "q", "r"), (-12.0, 12.0))
_RANGES |= dict.fromkeys(("ax_imu", "ay_imu", "az_imu", "ax", "ay", "az"), (-150.0, 150.0))
_RANGES |= dict.fromkeys(("V", "V_cas", "V_eas"), (-30.0, 700.0))
_RANGES |= dict.fromkeys(("vn", "ve", "vd"), (-700.0, 700.0))


def _all_costs(signals: ResampledChannels) -> Costs:
    """Return the costs of all relations, and of the plausible ranges of all channels."""
    costs = {}
    for relation in RELATIONS:
        check = relation.compare(signals)
        if check is not None:
            costs[relation.name] = _cost_of_check(check)
    for name in signals.values:
        costs.update(_cost_of_range(signals, name))
    return costs


def _cost_of_check(check: RelationCheck) -> float:
    """Return the disagreement, halved below the limit, where it may be noise."""
    if check.consistent:
        return 0.5 * check.disagreement
    return check.disagreement


def _cost_of_range(signals: ResampledChannels, name: str) -> Costs:
    """Return twice the share of samples outside the plausible range, at most one."""
    limits = plausible_range(name)
    valid = signals.good[name] & signals.flying
    if limits is None or not valid.any():
        return {}
    x = signals[name][valid]
    outside = float(np.mean((x < limits[0]) | (x > limits[1])))
    if outside > _FEW_OUTSIDE:
        return {f"range.{name}": min(1.0, 2.0 * outside)}
    return {f"range.{name}": 0.0}


def _broken_names(costs: Costs) -> list[str]:
    """Return the names whose cost exceeds the limit; the limit of a range is zero."""
    limits = {relation.name: relation.limit for relation in RELATIONS}
    return [name for name, cost in costs.items() if cost > limits.get(name, 0.0)]


def _best_explanation(signals: ResampledChannels, costs: Costs) -> Explanation | None:
    """Return the repair that explains most; None if no repair explains enough."""
    suspects: set[str] = set()
    for name in _broken_names(costs):
        suspects.update(_channels_of_cost(name, signals))
    repairs = list(_possible_repairs(signals, suspects))
    changes = [_change_of_costs(signals, costs, repair) for repair in repairs]
    gains = []
    for change in changes:
        gains.append(sum(before - after for before, after in change.values()))
    most = max(gains, default=0.0)
    if most < GAIN:
        return None

    # tolerances hide small differences, so repairs of nearly the same gain are compared without
    near = [i for i, gain in enumerate(gains) if gain > most - NEAR]
    compared = [repairs[i] for i in near]
    remainders = _log_remainders(compared, signals)
    order = np.argsort(remainders, kind="stable")
    ranked = [i for i in order if not _claims_too_much(i, compared, remainders)]
    best, runners_up = ranked[0], ranked[1:]
    # Two signs are a stronger claim than one: what lies below the tolerances does not decide for
    # them, because the bias of a gyro shows as much.
    has_several = repairs[near[best]].reverses_several
    ties = []
    for i in runners_up:
        if remainders[i] - remainders[best] < TIE or (
            has_several and not repairs[near[i]].reverses_several
        ):
            ties.append(near[i])
    resolved: Change = {}
    for name, (before, after) in changes[near[best]].items():
        if before - after > _RESOLVED:
            resolved[name] = before, after
    return Explanation(
        repairs[near[best]],
        tuple(resolved),
        before=tuple(before for before, _ in resolved.values()),
        after=tuple(after for _, after in resolved.values()),
        instead=tuple(repairs[i] for i in ties),
    )


def _claims_too_much(i: int, repairs: list[Repair], remainders: list[float]) -> bool:
    """Return whether a part of the signs of a repair explains as much as all of them."""
    channels, limit = set(repairs[i].channels), remainders[i] + TIE
    parts = [k for k, other in enumerate(repairs) if set(other.channels) < channels]
    return len(channels) > 2 and any(remainders[k] < limit for k in parts)


def _log_remainders(repairs: list[Repair], signals: ResampledChannels) -> list[float]:
    """Return the summed logarithms of the disagreements without tolerances after each repair.

    All repairs are judged by the relations that any of them affects.
    """
    if len(repairs) == 1:
        return [0.0]
    affected: set[str] = set()
    for repair in repairs:
        affected.update(repair.channels)
    relations = [relation for relation in RELATIONS if affected & set(relation.channels(signals))]
    return [_log_remainder(relations, repair.apply(signals)) for repair in repairs]


def _log_remainder(relations: list[Relation], signals: ResampledChannels) -> float:
    checks = [relation.compare(signals) for relation in relations]
    return sum(math.log(check.raw + _EXACT) for check in checks if check is not None)


def _change_of_costs(signals: ResampledChannels, costs: Costs, repair: Repair) -> Change:
    """Return the costs before and after a repair of everything that reads its channels."""
    repaired = repair.apply(signals)
    changes: Change = {}
    for relation in RELATIONS:
        name = relation.name
        if name in costs and set(repair.channels) & set(relation.channels(signals)):
            check = relation.compare(repaired)
            changes[name] = costs[name], _cost_after(repair, check, before=costs[name])
    for channel in repair.channels:
        for name, after in _cost_of_range(repaired, channel).items():
            changes[name] = costs.get(name, 0.0), after
    return changes


def _cost_after(repair: Repair, check: RelationCheck | None, before: float) -> float:
    """Return the cost of a relation after a repair.

    A change of unit that only makes a wandering channel small explains nothing if the other side
    is at rest.
    """
    if check is None:
        return before
    after = _cost_of_check(check)
    if repair.kind == "unit" and after <= before and not check.has_signal:
        return before
    return after


def _channels_of_cost(name: str, signals: ResampledChannels) -> tuple[str, ...]:
    if name.startswith("range."):
        return (name.removeprefix("range."),)
    return _BY_NAME[name].channels(signals)


# channels whose signs a mirror image of a flight reverses
_LATERAL = ("phi", "p", "psi", "r", "ve", "ay_imu", "beta_vane")
# channels of one source, whose signs are wrong together, and what is wrong with them
_SENSES = (
    (("phi", "p"), "they count to the left"),
    (("theta", "q"), "they count nose down"),
    (("psi", "r"), "they count to the left"),
    (("phi", "p", "psi", "r"), "they count to the left"),
    (("q", "r", "ay_imu", "az_imu"), "they are of axes forward, left, up"),
    (("theta", "q", "psi", "r", "ay_imu", "az_imu"), "they are of axes forward, left, up"),
    (("p", "r", "ax_imu", "az_imu"), "they are of axes aft, right, up"),
)
_BY_NAME: dict[str, Relation] = {relation.name: relation for relation in RELATIONS}
# axes that a name map may exchange
_SWAPS = (
    ("p", "q"),
    ("p", "r"),
    ("q", "r"),
    ("phi", "theta"),
    ("ax_imu", "ay_imu"),
    ("ax_imu", "az_imu"),
    ("ay_imu", "az_imu"),
    ("vn", "ve"),
    ("vn", "vd"),
    ("ve", "vd"),
    ("alpha_vane", "beta_vane"),
)
# SI unit -> (unit of the file, unit it was taken as, factor)
_UNITS: dict[str, tuple[tuple[str, str, float], ...]] = {
    "rad": (("deg", "rad", DEGREE),),
    "rad s-1": (("deg/s", "rad/s", DEGREE),),
    "m s-2": (("g", "m/s2", G0), ("ft/s2", "m/s2", FOOT)),
    "m s-1": (
        ("kt", "m/s", KNOT),
        ("mph", "m/s", 1609.344 / 3600.0),
        ("ft/s", "m/s", FOOT),
        ("km/h", "m/s", 1.0 / 3.6),
        ("ft/min", "m/s", FOOT / 60.0),
    ),
    "m": (("ft", "m", FOOT),),
    "Pa": (("hPa", "Pa", 100.0), ("kPa", "Pa", 1000.0), ("psf", "Pa", PSF)),
}


def _possible_repairs(signals: ResampledChannels, suspects: set[str]) -> Iterator[Repair]:
    """Yield the repairs of single channels, then senses of rotation and exchanges of two axes."""
    for name in sorted(suspects):
        yield from _repairs_of_channel(name)
    for channels, meaning in _SENSES:
        if suspects & set(channels) and all(name in signals for name in channels):
            listed = f"{', '.join(channels[:-1])} and {channels[-1]}"
            text = f"{listed} have the wrong sign together: {meaning}"
            yield Repair("sign", channels, text, slope=-1.0)
    for first, second in _SWAPS:
        if first in signals and second in signals and suspects & {first, second}:
            text = f"{first} and {second} are exchanged"
            yield Repair("axis", (first, second), text)


def _repairs_of_channel(name: str) -> Iterator[Repair]:
    channels, units = (name,), lookup(name).units
    # pressures and temperatures are positive in any sensor
    if units not in ("Pa", "K"):
        yield Repair("sign", channels, f"{name} has the wrong sign", slope=-1.0)
    if name == "az_imu":
        yield from _repairs_of_load_factor(name)
    for wrong, right, factor in units_mistaken(name):
        text = f"{name} is in {wrong} and was taken as {right}"
        yield Repair("unit", channels, text, slope=factor)
        text = f"{name} is in {right} and was taken as {wrong}"
        yield Repair("unit", channels, text, slope=1.0 / factor)
    if units == "K":
        text = f"{name} is in degC and was taken as K"
        yield Repair("unit", channels, text, shift=273.15)
        text = f"{name} is in K and was taken as degC"
        yield Repair("unit", channels, text, shift=-273.15)


def _repairs_of_load_factor(name: str) -> Iterator[Repair]:
    """Yield the other definitions of normal acceleration that recorders use."""
    # the specific force az is -g0 times the load factor n, which is one in level flight
    text = f"{name} is the load factor minus one, positive up, not the specific force"
    yield Repair("definition", (name,), text, slope=-1.0, shift=-G0)
    text = f"{name} is the acceleration without gravity, positive down, not the specific force"
    yield Repair("definition", (name,), text, slope=1.0, shift=-G0)
    text = f"{name} is the load factor minus one in g, positive up, taken as m/s2"
    yield Repair("definition", (name,), text, slope=-G0, shift=-G0)
    text = f"{name} is the load factor in g, positive up, taken as m/s2"
    yield Repair("definition", (name,), text, slope=-G0)
