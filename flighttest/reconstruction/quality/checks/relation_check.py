"""Classes of a relation between channels, and of its check on a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from flightmech.support.arrays import rms
from flighttest.reconstruction.quality.checks.formed_channels import source_channels
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible

_TINY = 1e-12
_LATE = 0.2  # s, of delay between the sides that is not a disagreement; other checks find delays
_SHORTEST, _PERIODS = 4.0, 3.0  # s; periods of the cut-off: shorter stretches prove nothing
_MEAN = 0.25  # periods of the cut-off over which a side is averaged before the low-pass
# multiple of the tolerance below which both sides are too small to disagree
_SMALL = 4.0


@dataclass(frozen=True)
class Relation:
    """Two ways to compute one quantity.

    Attributes
    ----------
    name, title : str
        Key, and both sides in words.
    needs : tuple of str
        Channels that the relation requires.
    sides : callable
        Signals -> (first side, second side).
    units : str
        SI unit of both sides.
    cutoff : float
        Frequency below which both sides are compared. [Hz]
    tolerance : float
        Rms difference that noise, changes of wind and neglected effects account for. [units]
    level : bool
        Whether the level counts, or changes only.
    limit : float
        Disagreement above which something is wrong. [1]
    optional : tuple of str
        Channels that the relation uses if the record holds them.
    formed : tuple of str
        Members of `needs` that may be formed from other channels if they are not recorded
        (`formed_channels`).
    """

    name: str
    title: str
    needs: tuple[str, ...]
    sides: Callable[[ResampledChannels], tuple[np.ndarray, np.ndarray]]
    units: str
    cutoff: float
    tolerance: float
    level: bool = False
    limit: float = 0.3
    optional: tuple[str, ...] = ()
    formed: tuple[str, ...] = ("V",)

    def channels(self, signals: ResampledChannels) -> tuple[str, ...]:
        """Return the recorded channels that the relation rests on."""
        names: list[str] = []
        for need in self.needs:
            names.extend(self._sources(need, signals))
        names.extend(name for name in self.optional if name in signals)
        # each channel once, in the order of its first use
        return tuple(dict.fromkeys(names))

    def missing(self, signals: ResampledChannels) -> tuple[str, ...]:
        """Return the members of `needs` that are neither recorded nor formed from others."""
        return tuple(need for need in self.needs if not self._sources(need, signals))

    def compare(self, signals: ResampledChannels) -> RelationCheck | None:
        """Return both sides and their disagreement.

        The result is None if a channel is missing, or if too little of the flight is usable.
        """
        if self.missing(signals):
            return None
        mask = self.mask(signals)
        if mask.sum() * signals.step < self.shortest:
            return None
        first, second = self.sides(signals.completed(self.formed))
        first, second = self._filter_side(first, signals), self._filter_side(second, signals)
        y, x = self.masked_side(first, mask), self.masked_side(second, mask)
        size = rms(y) + rms(x)
        # a delay shifts a side by its rate times the delay; the slower side is the weaker bound
        slowest_rate = min(_rms_rate(first, signals, mask), _rms_rate(second, signals, mask))
        allowed = np.hypot(self.tolerance, _LATE * slowest_rate)
        excess = float(np.sqrt(max(rms(y - x) ** 2 - allowed**2, 0.0)))
        return RelationCheck(
            self,
            signals.time,
            first=first,
            second=second,
            mask=mask,
            disagreement=excess / max(size, _SMALL * self.tolerance),
            raw=rms(y - x) / max(size, _TINY),
            moving=size > _SMALL * self.tolerance,
        )

    def mask(self, signals: ResampledChannels) -> np.ndarray:
        """Return the samples that count: all channels valid, in flight, away from filter ends."""
        mask = signals.mask(self.channels(signals))
        edge = round(0.5 / (self.cutoff * signals.step))
        mask[:edge] = mask[len(mask) - edge :] = False
        return mask

    def masked_side(self, side: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Return the samples of a side that count, without their mean if the level does not."""
        mean = 0.0
        if not self.level:
            mean = side[mask].mean()
        return side[mask] - mean

    @property
    def shortest(self) -> float:
        """Time in flight below which the relation proves nothing. [s]"""
        return max(_SHORTEST, _PERIODS / self.cutoff)

    def _filter_side(self, side: np.ndarray, signals: ResampledChannels) -> np.ndarray:
        finite = np.nan_to_num(side, nan=0.0, posinf=0.0, neginf=0.0)
        # The low-pass extends a side about its last sample, whose noise a derivative makes large;
        # a mean around each sample removes it before, from both sides alike.  The mean of what it
        # removed is added: the mean alone takes a tenth of a motion at the cut-off, now it is 1 %.
        span = round(_MEAN / (self.cutoff * signals.step))
        if span > 1:
            mean = uniform_filter1d(finite, span, mode="mirror")
            finite = mean + uniform_filter1d(finite - mean, span, mode="mirror")
        return lowpass_if_possible(finite, signals.step, self.cutoff)

    def _sources(self, need: str, signals: ResampledChannels) -> tuple[str, ...]:
        if need in signals:
            return (need,)
        if need in self.formed:
            return source_channels(need, signals.values)
        return ()


@dataclass(frozen=True)
class RelationCheck:
    """Both sides of a relation for a record.

    `disagreement` is rms(difference beyond the tolerance)/(rms + rms): 0 equal, 0.7 unrelated, 1
    opposite.  Two sides that are small against the tolerance agree.  `raw` is the same without
    tolerance.  `moving` shows whether the sides exceed the tolerance.
    """

    relation: Relation
    time: np.ndarray
    first: np.ndarray
    second: np.ndarray
    mask: np.ndarray
    disagreement: float
    raw: float
    moving: bool

    @property
    def consistent(self) -> bool:
        """Whether the disagreement is below the limit of the relation."""
        return self.disagreement <= self.relation.limit

    @property
    def has_signal(self) -> bool:
        """Whether both sides move by more than the tolerance.

        A side that wanders against a constant one determines neither a factor nor a sign.
        """
        first = rms(self.relation.masked_side(self.first, self.mask))
        second = rms(self.relation.masked_side(self.second, self.mask))
        return min(first, second) > self.relation.tolerance

    @property
    def varies(self) -> bool:
        """Whether a side changes by more than the tolerance.

        Smaller changes may be those of wind and neglected sideslip: their slope proves nothing.
        """
        sides = (self.first[self.mask], self.second[self.mask])
        return max(float(np.std(side)) for side in sides) > self.relation.tolerance

    @property
    def offset(self) -> float:
        """Mean of first minus second. [units]"""
        return float((self.first - self.second)[self.mask].mean())

    @property
    def slope(self) -> float:
        """Slope of the first side over the second, with equal relative errors in both.

        It is the ratio of the standard deviations, with the sign of the correlation.
        """
        return float(
            np.sign(self.correlation)
            * np.std(self.first[self.mask])
            / max(np.std(self.second[self.mask]), _TINY)
        )

    @property
    def correlation(self) -> float:
        """Correlation of the changes."""
        y = self.first[self.mask] - self.first[self.mask].mean()
        x = self.second[self.mask] - self.second[self.mask].mean()
        return float((y * x).mean() / max(rms(y) * rms(x), _TINY))


def _rms_rate(side: np.ndarray, signals: ResampledChannels, mask: np.ndarray) -> float:
    return rms(np.gradient(side, signals.step)[mask])
