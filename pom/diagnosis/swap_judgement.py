"""Judgement of one choice of swapped terms, and comparison of two judgements."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

# [half widths] No mismatch counts more. A criterion without a number, for example of a mode that
# the model does not have, counts as much.
CEILING = 10.0
# Statuses of a model within tolerance. With the second one, its trim exceeds the usual limits.
MATCHED = ("pass", "limits_exceeded")


@dataclass(frozen=True)
class Judged:
    """Effect of a choice of final terms and parts on the a-priori model.

    Attributes
    ----------
    verdict : str
        Status of the case.
    mismatch, ratio : dict of str to float
        By judged criterion: rms of difference over half width of a time history, the ratio itself
        of a scalar; largest ratio. [1]
    total : float
        Root mean square of the mismatches of the groups, of each group the best alternative. [1]
    moved : float
        How far the judged outputs are from those of the a-priori model: largest rms of a channel
        over that of its mismatch (a-priori model less flight, or less final model, the larger), or
        a tenth of a trim over its limit; infinite for a run that failed. [1]
    change : dict of str to float
        By judged output: rms of its difference from that of the a-priori model, of which `moved` is
        made; empty for a run that failed. [SI]
    """

    verdict: str
    mismatch: dict[str, float]
    ratio: dict[str, float]
    total: float
    moved: float = np.inf
    change: dict[str, float] = field(default_factory=dict, repr=False)

    @property
    def matched(self) -> bool:
        """Whether the case is within tolerance, whatever its trim."""
        return self.verdict in MATCHED

    def counted(self, criteria: Iterable[str]) -> np.ndarray:
        """Return the mismatches, limited to `CEILING` (1 + criterion,); the total comes first."""
        mismatches = [self.total]
        for name in criteria:
            mismatches.append(self.mismatch.get(name, CEILING))
        return np.array([np.fmin(mismatch, CEILING) for mismatch in mismatches])

    def agrees_with(self, other: Judged, tolerance: float) -> bool:
        """Whether verdicts are equal, and numbers within an absolute or relative tolerance."""
        return (
            self.verdict == other.verdict
            and _are_close(self.mismatch, other.mismatch, tolerance)
            and _are_close(self.ratio, other.ratio, tolerance)
        )


def _are_close(first: dict[str, float], second: dict[str, float], tolerance: float) -> bool:
    """Whether two mappings have the same names and close values."""
    if first.keys() != second.keys():
        return False
    return np.allclose(
        [*first.values()], [*second.values()], rtol=tolerance, atol=tolerance, equal_nan=True
    )


def effect_products(
    first: Judged, second: Judged, both: Judged, sizes: Mapping[str, float]
) -> np.ndarray:
    """Return the sums of squares and products of the effects of two swaps (3,).

    With small changes x and y of an output by two swaps, the change by both is x + y. The mean
    product of x and y then follows from the three rms values: 2 xy = |x + y|^2 - |x|^2 - |y|^2.

    Parameters
    ----------
    first, second, both : Judged
        Each swap alone, and both together.
    sizes : mapping of str to float
        Scale of each output. [SI]

    Returns
    -------
    array (3,)
        Over all outputs with a scale: sum of the squares of the first effect, of the second, and
        of the products. Zero for a run that failed. [1]
    """
    sums = np.zeros(3)
    for name, size in sizes.items():
        if not size > 0.0:
            continue
        x, y, z = [judged.change.get(name, np.nan) / size for judged in (first, second, both)]
        products = np.array([x**2, y**2, 0.5 * (z**2 - x**2 - y**2)])
        if np.isfinite(products).all():
            sums += products
    return sums


def effect_correlation(products: np.ndarray) -> float:
    """Return the correlation of two effects from the sums of `effect_products`; NaN without any."""
    scale = np.sqrt(products[0] * products[1])
    if not scale > 0.0:
        return np.nan
    # Beyond 1 the effects do not add up as they would for small changes.
    return float(np.clip(products[2] / scale, -1.0, 1.0))


def nearest_choice(choice: Collection[str], idle: Collection[str]) -> frozenset[str]:
    """Return the choice with all idle terms, or with none of them.

    All idle terms are swapped if `choice` swaps more than half of them.
    """
    active = frozenset(choice).difference(idle)
    swapped = frozenset(choice).intersection(idle)
    if 2 * len(swapped) > len(idle):
        return active | frozenset(idle)
    return active
