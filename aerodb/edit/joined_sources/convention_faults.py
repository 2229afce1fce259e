"""Disagreements of two sources that a unit, a sign or a reference quantity explains.

Two sources of a term that differ by 57.3 are seldom two opinions: one is per degree.  Their mean
would be neither. For each pair of sources, groups of terms are compared with the factors that usual
slips leave: an angle in degrees, a rate reduced by V instead of 2V, the other reference length, the
other sign, the area of one half.

The errors of the sources are partly proportional to the value.  A difference then hardly exceeds
its standard error, whatever the factor: 57 differs from 1 by 1.4 standard errors of 70 %.  So the
values v are compared on a scale on which their standard error is 1, with r and a the proportional
and the constant part of both sources together:

    z = [asinh(r v_2 / (a f)) - asinh(r v_1 / a)] / r

It is (v_2 - v_1)/a for small values, and log(v_2/(f v_1))/r for large ones.  The errors of a source
are common to the nodes of a table.  A term therefore counts as one number, the mean of z^2 over the
nodes where both speak.

Standard errors of rate derivatives are so large that a factor of 2 is within them. Two sources of
one aeroplane agree far better in some rate derivatives, and in their mean: see `_RATE_GROUPS`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from aerodb.edit.joined_sources.source_nodes import SourceNodes
from aerodb.store.grids import node_text
from flightmech.short_text import ShortText
from flightmech.units import DEGREE, FOOT

UNLIKELY_BY_CHANCE = 1e-4
"""Probability of a disagreement below which a blend with a known cause is refused."""

# Probability that two sources have after a correction that leaves no disagreement, and the share of
# the sum of z^2 that may be left otherwise: some standard errors of the guide are too small.
_EXPLAINED, _LEFT = 0.05, 0.2
# Probability below which terms disagree at all, as for a single term.
_UNLIKELY = 0.01
# Least gain of the logarithm of the likelihood by the correction; some fifty are tried.
_LEAST_GAIN = 6.0
# Square of a disagreement that counts on its own. [standard errors^2]
_CLEAR = 9.0
# Least constant error as a share of the smaller table: no estimate is exact where it passes zero.
_LEAST_CONSTANT = 0.1
_LEAST_RATIO = 1e-6  # of the proportional error, for the limit r -> 0

_ANGLES = ("beta", "elevator", "aileron", "rudder", "flap", "spoiler", "differential_tail")
_PITCH_RATES, _LATERAL_RATES = ("qhat", "alphadothat"), ("phat", "rhat")
_RATES = (*_PITCH_RATES, *_LATERAL_RATES)
# Groups of rates that a source reduces alike: the terms in which sources agree best, the largest
# |log(ratio) - log(2)| of each, and the standard deviation of the mean log(ratio).  On the aircraft
# of the calibration the mean of the first three is within 0.22 for two programs (33 pairs) and
# within 0.31 for a program and published values (24 pairs); log(2)/2 is 0.35.
_RATE_GROUPS = (
    (_RATES, ("Cl/phat", "Cn/rhat", "Cm/qhat"), math.inf, 0.18),
    (_LATERAL_RATES, ("Cl/phat", "Cl/rhat", "Cn/rhat"), 0.5, 0.19),
)
_LOG_2 = math.log(2.0)
_BY_V = "rates reduced by V in one, by 2V in the other (full span and half span)"
_SIGNED = ("CL", "CY", "Cl", "Cm", "Cn")  # drag does not change its sign with an angle
# Term in which body and fin cancel: two good estimates may differ by 30. Alone it shows a slip only
# where the ratio is near its factor.
_CANCELLING, _NEAR = "Cn/beta", 1.5
_MOST_TERMS = 3  # terms with their values in a message


@dataclass(frozen=True)
class SourcePair(ShortText):
    """Values of one term by two sources where both speak.

    Attributes
    ----------
    name : str
        Term, such as ``Cn/beta``.
    labels : tuple of str
    first, second : array
        Values at the common nodes. [unit of the term]
    relative, absolute : float
        Proportional and constant standard error of both sources together. [1, unit of the term]
    location : str
        Node of the values of `stated`.
    stated : tuple of float
        Values of the two at the node with the largest value.
    """

    name: str
    labels: tuple[str, str]
    first: np.ndarray
    second: np.ndarray
    relative: float
    absolute: float
    location: str
    stated: tuple[float, float]

    @property
    def coefficient(self) -> str:
        """Coefficient of the term."""
        return self.name.partition("/")[0]

    @property
    def contribution(self) -> str:
        """What the coefficient depends on in the term."""
        return self.name.partition("/")[2]

    def log_ratio(self) -> float:
        """Return log(second / first) of the sizes; NaN if the signs differ."""
        if float(np.sum(self.first * self.second)) <= 0.0:
            return math.nan
        return math.log(float(np.linalg.norm(self.second) / np.linalg.norm(self.first)))

    def mean_square(self, factor: float = 1.0) -> float:
        """Return the mean z^2 of the second source, divided by a factor, against the first."""
        scale = self.relative / self.absolute
        second = np.arcsinh(scale * self.second / factor)
        z = (second - np.arcsinh(scale * self.first)) / self.relative
        return float(np.mean(z**2))


@dataclass(frozen=True)
class ConventionFault(ShortText):
    """A disagreement of two sources with its probable cause.

    Attributes
    ----------
    names : tuple of str
        Terms that it explains.
    labels : tuple of str
    probability : float
        Of the disagreement without it.
    text : str
        Terms, values, cause and remedy.
    """

    names: tuple[str, ...]
    labels: tuple[str, str]
    probability: float
    text: str

    @property
    def is_certain(self) -> bool:
        """Whether a blend is refused."""
        return self.probability < UNLIKELY_BY_CHANCE


@dataclass(frozen=True)
class _Slip:
    """A slip: the factor that it leaves, what it is, and the terms that have it together."""

    factor: float
    cause: str
    contributions: Collection[str] | None = None
    coefficients: Collection[str] = _SIGNED
    patterns: tuple[str, ...] = ()

    def has(self, pair: SourcePair) -> bool:
        if pair.coefficient not in self.coefficients:
            return False
        return self.contributions is None or pair.contribution in self.contributions


def compare_pairs(
    name: str,
    points: Mapping[str, np.ndarray],
    spread: Sequence[SourceNodes],
    speaks: np.ndarray,
) -> list[SourcePair]:
    """Return the values of one term by every two sources where both speak.

    Parameters
    ----------
    name : str
    points : mapping of str to array
        Breakpoints of the common grid.
    spread : sequence of SourceNodes
    speaks : array of bool (sources, nodes)
        From `aerodb.edit.joined_sources.source_nodes.speaking`.
    """
    pairs = []
    for k, m in combinations(range(len(spread)), 2):
        one, other = spread[k], spread[m]
        # Nodes that are zero by definition compare nothing.
        uncertain = (one.variance > 0.0) | (other.variance > 0.0)
        common = speaks[k] & speaks[m] & uncertain
        if not common.any():
            continue
        first, second = one.value[common], other.value[common]
        squares = [float(np.mean(values**2)) for values in (first, second)]
        # A table of zeros has no factor.
        if min(squares) == 0.0:
            continue
        variances = [float(np.mean(nodes.variance[common])) for nodes in (one, other)]
        relative, absolute = joint_errors(squares, variances)
        size = np.where(common, np.abs(one.value) + np.abs(other.value), -1.0)
        node = np.unravel_index(int(np.argmax(size)), size.shape)
        pairs.append(
            SourcePair(
                name,
                (one.table.source.label, other.table.source.label),
                first=first,
                second=second,
                relative=relative,
                absolute=absolute,
                location=node_text(points, list(map(int, node))),
                stated=(float(one.value[node]), float(other.value[node])),
            )
        )
    return pairs


def joint_errors(squares: Sequence[float], variances: Sequence[float]) -> tuple[float, float]:
    """Return the proportional and the constant standard error of two sources together.

    Parameters
    ----------
    squares, variances : sequence of float
        Mean square of the values, not zero, and of the standard errors of each source, (2,).

    Notes
    -----
    The constant part is that of r^2 v^2 + a^2 = s^2 for both.  A table of equal values does not
    show how its error splits, but two sources of different size do.  Without a difference all is
    constant.  The remainder of each source is proportional.
    """
    (v1, v2), (s1, s2) = squares, variances
    # A larger value with a smaller error shows no proportional part.
    slope = max((s2 - s1) / (v2 - v1), 0.0) if v1 != v2 else 0.0
    constant = min(max(s1 - slope * v1, 0.0), s1, s2)
    relative = 0.0
    for square, variance in zip(squares, variances):
        relative += (variance - constant) / square
    least = _LEAST_CONSTANT * math.sqrt(min(squares))
    return max(math.sqrt(relative), _LEAST_RATIO), max(math.sqrt(2.0 * constant), least)


def find_convention_faults(
    pairs: Sequence[SourcePair], cbar: float, b: float, area_ratios: Sequence[float] = ()
) -> list[ConventionFault]:
    """Return the disagreements that a usual slip explains.

    Parameters
    ----------
    pairs : sequence of SourcePair
        Of all terms of several sources.
    cbar, b : float
        Mean chord and span. [m]
    area_ratios : sequence of float
        Further ratios of areas that a source may have mixed up. [1]

    Notes
    -----
    A slip is stated if the terms disagree (probability below 0.01), its correction leaves no
    disagreement or a small share of it, and no other slip makes them more probable. Every term that
    disagrees clearly must come nearer by it. A factor of 2 in all rates is also stated if three of
    their derivatives have it in the mean.
    """
    faults = []
    by_sources: dict[tuple[str, str], list[SourcePair]] = {}
    for pair in pairs:
        by_sources.setdefault(pair.labels, []).append(pair)
    for members in by_sources.values():
        left = members
        while fault := _best_fault(left, _list_slips(cbar, b, area_ratios)):
            faults.append(fault)
            left = [pair for pair in left if pair.name not in fault.names]
        if joint := _find_rates_by_two(left):
            faults.append(joint)
    return faults


def _find_rates_by_two(pairs: Sequence[SourcePair]) -> ConventionFault | None:
    """Return a factor of 2 that the rate derivatives of two sources have together, or None."""
    by_name = {pair.name: pair for pair in pairs}
    for rates, firm, width, spread in _RATE_GROUPS:
        if not by_name.keys() >= set(firm):
            continue
        logs = np.array([by_name[name].log_ratio() for name in firm])
        sign = math.copysign(1.0, float(logs.sum()))
        mean = sign * float(logs.mean())
        # A term of the other sign has no ratio: NaN fails the comparisons.
        if abs(mean - _LOG_2) < 0.5 * _LOG_2 and (np.abs(sign * logs - _LOG_2) < width).all():
            members = [pair for pair in pairs if pair.contribution in rates]
            patterns = tuple(f"*/{name}" for name in rates)
            slip = _Slip(2.0**sign, _BY_V, rates, patterns=patterns)
            return _describe(slip, members, 2.0 * float(scipy.stats.norm.sf(mean / spread)))
    return None


def _list_slips(cbar: float, b: float, area_ratios: Sequence[float]) -> list[_Slip]:
    """Return all slips, each in both directions."""
    slips = []
    for sign in (1.0, -1.0):
        degree, two, lengths = DEGREE**sign, 2.0**sign, (b / cbar) ** sign
        for name in _ANGLES:
            cause = f"per degree in one, per radian in the other (or {name} in another unit)"
            # All terms of an angle, or one of them.
            for coefficients in (_SIGNED, *((one,) for one in _SIGNED)):
                slips.append(_Slip(degree, cause, [name], coefficients, (f"*/{name}",)))
        groups = [[name] for name in _RATES] + [list(_LATERAL_RATES), list(_RATES)]
        for names in groups:
            patterns = tuple(f"*/{name}" for name in names)
            cause = "a rate in degrees in one, in radians in the other"
            slips.append(_Slip(degree, cause, names, patterns=patterns))
            slips.append(_Slip(two, _BY_V, names, patterns=patterns))
        for name in _PITCH_RATES + _LATERAL_RATES:
            cause = "rates reduced by the span in one, by the mean chord in the other"
            slips.append(_Slip(lengths, cause, [name], patterns=(f"*/{name}",)))
        for coefficients in (("Cm",), ("Cl", "Cn")):
            patterns = tuple(f"{name}/*" for name in coefficients)
            cause = "moments divided by the span in one, by the mean chord in the other"
            slips.append(_Slip(lengths, cause, None, coefficients, patterns))
        areas = {two: "the area of one half, or a half model", FOOT ** (2.0 * sign): "ft2 and m2"}
        for ratio in area_ratios:
            areas[ratio**sign] = f"reference areas in the ratio {max(ratio, 1.0 / ratio):.3g}"
        for factor, cause in areas.items():
            slips.append(_Slip(factor, f"coefficients of another reference area: {cause}"))
    for name in _ANGLES:
        cause = f"the positive sense of {name}"
        slips.append(_Slip(-1.0, cause, [name], patterns=(f"*/{name}",)))
    for coefficients in (("CL",), ("CY",), ("Cm",), ("Cl", "Cn")):
        patterns = tuple(f"{name}/*" for name in coefficients)
        cause = f"the positive sense of {' and '.join(coefficients)}"
        slips.append(_Slip(-1.0, cause, None, coefficients, patterns))
    return slips


def _best_fault(pairs: Sequence[SourcePair], slips: Sequence[_Slip]) -> ConventionFault | None:
    """Return the disagreement whose explanation gains most; None without any."""
    best, found = _LEAST_GAIN, None
    for slip in slips:
        members = [pair for pair in pairs if slip.has(pair)]
        # A slip of all coefficients, or of one, is seen in several terms only.
        if not members or (slip.contributions is None and len(members) < 2):
            continue
        if len(members) == 1 and _is_chance(members[0], slip.factor):
            continue
        before = np.array([pair.mean_square() for pair in members])
        after = np.array([pair.mean_square(slip.factor) for pair in members])
        gain = 0.5 * float(before.sum() - after.sum())
        # Each term that disagrees by itself must come nearer.
        is_clear = np.maximum(before, after) > _CLEAR
        if gain <= best or (is_clear & (after > before)).any():
            continue
        probability = float(scipy.stats.chi2.sf(before.sum(), len(members)))
        explained = float(scipy.stats.chi2.sf(after.sum(), len(members)))
        is_explained = explained > _EXPLAINED or after.sum() < _LEFT * before.sum()
        if probability < _UNLIKELY and is_explained:
            best, found = gain, _describe(slip, members, probability)
    return found


def _is_chance(pair: SourcePair, factor: float) -> bool:
    """Return whether the ratio of a cancelling term is not near a factor."""
    if pair.name != _CANCELLING or factor < 0.0:
        return False
    ratio = float(np.linalg.norm(pair.second) / np.linalg.norm(pair.first)) / factor
    return not 1.0 / _NEAR < ratio < _NEAR


def _describe(slip: _Slip, members: Sequence[SourcePair], probability: float) -> ConventionFault:
    """Return a fault in words: terms with both values, the cause, the remedy."""
    # Terms of the largest disagreement come first.
    ordered = sorted(members, key=lambda pair: -pair.mean_square())
    first, second = ordered[0].labels
    stated = []
    for pair in ordered[:_MOST_TERMS]:
        values = f"{first} {pair.stated[0]:.4g}, {second} {pair.stated[1]:.4g}"
        stated.append(f"{pair.name} ({values} at {pair.location})")
    more = len(ordered) - _MOST_TERMS
    others = f" and {more} more" if more > 0 else ""
    relation = f"{second} is {slip.factor:.4g} times {first} within their standard errors"
    if slip.factor < 0.0:
        relation = f"{first} and {second} have opposite signs"
    patterns = slip.patterns if len(ordered) > 1 else (ordered[0].name,)
    remedy = f"leave out {first} or {second}"
    if patterns:
        takes = " ".join(f"--take '{pattern}={first}'" for pattern in patterns)
        remedy = f"take one of them ({takes}; in a project the key take)"
    text = (
        f"{', '.join(stated)}{others}: {relation}; probable cause: {slip.cause}; correct the file "
        f"or what was stated of it (columns, units, controls), or {remedy}"
    )
    names = tuple(pair.name for pair in ordered)
    return ConventionFault(names, (first, second), probability, text)
