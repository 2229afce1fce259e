"""Judgement of one choice of swapped terms, comparison of judgements, and the table of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# [half widths] No mismatch counts more. A criterion without a number, for example of a mode that
# the model does not have, counts as much.
CEILING = 10.0
# [half widths] If the mismatches of the two models differ by less, shares of the gap have no
# meaning. That holds for the total and for every criterion.
LEAST_GAP = 0.05
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


class DiagnosisRows:
    """Rows of a diagnosis, and the gaps between the two models.

    The first element of every array is the total mismatch. The criteria follow.
    """

    def __init__(self, start: Judged, end: Judged):
        self.rows: list[dict[str, Any]] = []
        self.criteria = list(start.mismatch)
        self.start, self.end = start.counted(self.criteria), end.counted(self.criteria)
        self.gap = start.total - end.total
        self._nan = np.full(len(self.criteria) + 1, np.nan)

    @property
    def has_gap(self) -> bool:
        """Whether the final model is better by so much that shares of the gap have a meaning."""
        return bool(self.gap >= LEAST_GAP)

    def explained(self, change: np.ndarray) -> np.ndarray:
        """Return changes of the mismatches as shares of their gaps; NaN without a gap."""
        gap = self.start - self.end
        gap[1:][gap[1:] < LEAST_GAP] = np.nan
        gap[0] = np.nan
        if self.has_gap:
            gap[0] = self.gap
        return change / gap

    def add(
        self,
        stage: str,
        term: str,
        judged: Judged,
        interaction: float = np.nan,
        correlation: float = np.nan,
        bound: float = np.nan,
    ) -> None:
        """Append a row of a judged choice."""
        mismatch = [judged.mismatch.get(name, np.nan) for name in self.criteria]
        ratio = [judged.ratio.get(name, np.nan) for name in self.criteria]
        self._append(
            {"stage": stage, "term": term, "verdict": judged.verdict},
            explained=self.explained(self.start - judged.counted(self.criteria)),
            mismatch=[judged.total, *mismatch],
            ratio=ratio,
            interaction=interaction,
            correlation=correlation,
            bound=bound,
        )

    def add_idle(self, term: str, bound: float) -> None:
        """Append a term that was not flown alone, with the bound of its effect."""
        self._append({"stage": "idle", "term": term, "verdict": "not_tested"}, bound=bound)

    def add_share(
        self,
        term: str,
        change: np.ndarray,
        stderr: np.ndarray,
        level: np.ndarray,
        opposed: tuple[str, float],
    ) -> None:
        """Append a Shapley share.

        Parameters
        ----------
        term : str
        change, stderr : array (1 + criterion,)
            Changes of the mismatches, and their standard errors. [half widths]
        level : array (1 + criterion,)
            Mismatches after this share and those before it. [half widths]
        opposed : (str, float)
            The player whose effect opposes it most, and the correlation; empty text without one.
        """
        partner, correlation = opposed
        self._append(
            {"stage": "share", "term": term, "partner": partner, "verdict": "not_tested"},
            correlation=correlation,
            explained=self.explained(-change),
            stderr=np.abs(self.explained(stderr)),
            mismatch=level.tolist(),
        )

    def _append(
        self,
        labels: Mapping[str, str],
        *,
        explained: Sequence[float] | np.ndarray | None = None,
        stderr: Sequence[float] | np.ndarray | None = None,
        mismatch: Sequence[float] | None = None,
        ratio: Sequence[float] | None = None,
        interaction: float = np.nan,
        correlation: float = np.nan,
        bound: float = np.nan,
    ) -> None:
        """Append a row; numbers that are not given are NaN."""
        if explained is None:
            explained = self._nan
        if stderr is None:
            stderr = self._nan
        if mismatch is None:
            mismatch = self._nan.tolist()
        if ratio is None:
            ratio = self._nan[1:].tolist()
        # The order of the keys is that of the columns.
        row = {
            "stage": labels["stage"],
            "term": labels["term"],
            "explained": explained[0],
            "stderr": stderr[0],
            "interaction": interaction,
            "correlation": correlation,
            "partner": labels.get("partner", ""),
            "bound": bound,
            "verdict": labels["verdict"],
            "mismatch": mismatch[0],
        }
        for k, name in enumerate(self.criteria):
            row |= {f"{name} mismatch": mismatch[k + 1], f"{name} ratio": ratio[k]}
            row |= {f"{name} explained": explained[k + 1], f"{name} stderr": stderr[k + 1]}
        self.rows.append(row)
