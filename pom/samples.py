"""What replays by draws of a model show: the probability that a case passes, the spread of its
ratios, and which term's error makes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

WITHIN = ("pass", "limits_exceeded")
"""Statuses within tolerance; a trim beyond its limits is not drawn anew and is stated by the run itself."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Of the draws, of which the fan consists."""


@dataclass(frozen=True)
class SampledReplay:
    """One model against the flights that draws of the aeroplane, from the posterior of its database
    and of the instruments, give in a case.

    Attributes
    ----------
    seed : int
        Of the draws; the same seed, database, record and number give the same draws.
    database : str
        File and hash of the database with the standard errors.
    status : tuple of str
        Of every draw, one of `pom.result.STATUSES` (draw,).
    decides : array (draw,)
        Ratio that decides: of the alternatives the best, of the groups the worst; NaN for a draw
        that could not be flown or judged. [1]
    ratio : DataFrame (draw, criterion)
        Largest ratio of every criterion that is judged. [1]
    shares : DataFrame
        ``criterion source share``: part of the variance of a criterion's signed ratio that the
        errors of a source make, the largest first; a source is a term (``Cm/basic``) or an
        instrument (``mass``).  Negative where a source takes back what another, correlated one
        makes.  What they lack to 1 is not linear in the errors.
    fan : Dataset (quantile, time)
        Quantiles of the channels of the model over the draws. [SI]
    """

    seed: int
    database: str
    status: tuple[str, ...]
    decides: np.ndarray
    ratio: pd.DataFrame
    shares: pd.DataFrame
    fan: xr.Dataset

    @property
    def count(self) -> int:
        """Number of draws."""
        return len(self.status)

    @property
    def probability(self) -> float:
        """Share of the draws that the model matches within tolerance; one that cannot be flown or
        judged is not.
        """
        return sum(status in WITHIN for status in self.status) / self.count

    @property
    def stderr(self) -> float:
        """Standard error of the probability from the number of draws, by Agresti and Coull's
        interval: not zero at 0 and 1.
        """
        n, p = self.count + 4.0, (self.probability * self.count + 2.0) / (self.count + 4.0)
        return float(np.sqrt(p * (1.0 - p) / n))

    def spread(self, criterion: str = "") -> tuple[float, float, float]:
        """Return the quantiles 5, 50 and 95 % of the ratio of a criterion, of the one that decides
        without a name; NaN without any.
        """
        values = self.ratio[criterion].to_numpy() if criterion else self.decides
        values = values[np.isfinite(values)]
        low, middle, high = (
            np.quantile(values, (QUANTILES[0], 0.5, QUANTILES[-1]))
            if len(values)
            else (np.nan,) * 3
        )
        return float(low), float(middle), float(high)

    def passing(self, criterion: str) -> float:
        """Return the share of the draws whose ratio of a criterion is within the tolerance."""
        return float((self.ratio[criterion] <= 1.0).sum()) / self.count

    def dominant(self, criterion: str, most: int = 3) -> list[tuple[str, float]]:
        """Return the sources with the largest shares of a criterion: (source, share)."""
        rows = self.shares[self.shares["criterion"] == criterion]
        return [
            (str(source), float(share))
            for source, share in zip(rows["source"], rows["share"], strict=True)
            if share > 0.0
        ][:most]

    def numbers(self) -> dict[str, Any]:
        """Return what a report prints of the samples, as plain data."""
        low, middle, high = self.spread()
        return {
            "draws": self.count,
            "seed": self.seed,
            "database": self.database,
            "probability": self.probability,
            "stderr": self.stderr,
            "ratio": {"q05": low, "q50": middle, "q95": high},
            "criteria": {name: self._of(name) for name in map(str, self.ratio.columns)},
        }

    def _of(self, criterion: str) -> dict[str, Any]:
        low, middle, high = self.spread(criterion)
        rows = self.shares[self.shares["criterion"] == criterion]
        shares = dict(zip(map(str, rows["source"]), map(float, rows["share"]), strict=True))
        return {
            "probability": self.passing(criterion),
            "q05": low,
            "q50": middle,
            "q95": high,
            "shares": shares,
        }

    def document(self) -> dict[str, Any]:
        """Return all but the fan as plain data, numbers in full."""
        return {
            "seed": self.seed,
            "database": self.database,
            "status": list(self.status),
            "decides": self.decides.tolist(),
            "ratio": {str(name): column.tolist() for name, column in self.ratio.items()},
            "shares": self.shares.to_dict("list"),
        }

    @classmethod
    def of_document(cls, item: Mapping[str, Any], fan: xr.Dataset) -> SampledReplay:
        """Rebuild samples from `document` and their fan."""
        return cls(
            int(item["seed"]),
            item["database"],
            tuple(item["status"]),
            np.array(item["decides"], float),
            pd.DataFrame({name: np.array(column, float) for name, column in item["ratio"].items()}),
            pd.DataFrame(item["shares"], columns=["criterion", "source", "share"]),
            fan,
        )
