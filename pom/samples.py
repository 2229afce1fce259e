"""Replays of a case by draws of a model: probability of a pass, spread of the ratios, sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.short_text import ShortText

WITHIN = ("pass", "limits_exceeded")
"""Statuses within tolerance.

A trim beyond its limits counts as within: the draws do not change it, and the run itself reports
it.
"""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of the draws in the fan."""

# Agresti and Coull's interval at 95 % adds two passes and two failures (z^2 = 1.96^2, about 4).
_ADDED_DRAWS, _ADDED_PASSES = 4.0, 2.0
_ROUNDING = 0.005  # of a ratio: a smaller excess is not visible in two decimals


@dataclass(frozen=True)
class SampledReplay(ShortText):
    """Replays of one case by draws from the posterior of a database and of the instruments.

    Attributes
    ----------
    seed : int
        Seed of the draws.  The same seed, database, record and number give the same draws.
    database : str
        File and hash of the database with the standard errors.
    status : tuple of str
        Status of every draw, one of `pom.status.STATUSES` (draw,).
    decides : array (draw,)
        Ratio that decides: of the alternatives the best, of the groups the worst.  NaN for a draw
        without a replay or a verdict, or that fails without a ratio above 1. [1]
    ratio : DataFrame (draw, criterion)
        Largest ratio of every judged criterion.  NaN where it fails for another reason, such as
        a motion that grows where the other decays. [1]
    shares : DataFrame
        ``criterion source share``: part of the variance of the signed ratio of a criterion that
        the errors of a source explain, in descending order.  A source is a term (``Cm/basic``) or
        an instrument (``mass``).  A share is negative where a source cancels the effect of a
        correlated source.  The rest to 1 is not linear in the errors.
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
        """Share of the draws within tolerance.

        A draw without a replay or a verdict counts as outside.
        """
        return sum(status in WITHIN for status in self.status) / self.count

    @property
    def stderr(self) -> float:
        """Standard error of the probability from the number of draws.

        By Agresti and Coull's interval, so that it is not zero at 0 and 1.
        """
        n = self.count + _ADDED_DRAWS
        p = (self.probability * self.count + _ADDED_PASSES) / n
        return float(np.sqrt(p * (1.0 - p) / n))

    def spread(self, criterion: str = "") -> tuple[float, float, float]:
        """Return the quantiles 5, 50 and 95 % of the ratio of a criterion.

        Without a name: of the ratio that decides.  NaN if no draw has a ratio.
        """
        values = self.decides
        if criterion:
            values = self.ratio[criterion].to_numpy()
        values = values[np.isfinite(values)]
        if not len(values):
            return np.nan, np.nan, np.nan
        low, middle, high = np.quantile(values, (QUANTILES[0], 0.5, QUANTILES[-1]))
        return float(low), float(middle), float(high)

    def unexplained(self, ratios: Mapping[str, float], deciding: str) -> str:
        """Return that the flight lies outside the spread of the draws; empty if it does not.

        The probability counts draws that take the place of the aeroplane. It is not that of the
        flight if the flight is farther from the model than the draws are.

        Parameters
        ----------
        ratios : mapping of str to float
            Ratio of the model to the flight, by criterion. [1]
        deciding : str
            The criterion that decides. Its ratio is compared with the 95 % quantile of the draws,
            that of another one with all draws, because one of twenty criteria is above its 95 %
            quantile by chance.
        """
        outside = []
        for criterion, ratio in ratios.items():
            drawn = criterion if criterion in self.ratio else ""
            if drawn != criterion and criterion != deciding:
                continue
            low, _, high = self.spread(drawn)
            limit = high
            if criterion != deciding:
                limit = float(np.fmax.reduce(self.ratio[criterion].to_numpy(float)))
            # The comparison is false for NaN: nothing to compare.
            if ratio - limit > _ROUNDING:
                outside.append(f"{criterion} {ratio:.2f} ({low:.2f} to {high:.2f})")
        if not outside:
            return ""
        return (
            f"the spread of the model does not explain the flight, whose ratio is outside the 5 to "
            f"95 % band of the draws: {', '.join(outside)}; the probability of a pass holds for "
            f"aeroplanes like the draws, and not for this flight"
        )

    def passing(self, criterion: str) -> float:
        """Return the share of the draws whose ratio of a criterion is within the tolerance."""
        return float((self.ratio[criterion] <= 1.0).sum()) / self.count

    def dominant(self, criterion: str, most: int = 3) -> list[tuple[str, float]]:
        """Return the sources with the largest shares of a criterion: (source, share)."""
        shares = self._shares_of(criterion)
        # a negative share reduces the variance
        return [(source, share) for source, share in shares.items() if share > 0.0][:most]

    def _shares_of(self, criterion: str) -> dict[str, float]:
        rows = self.shares[self.shares["criterion"] == criterion]
        return dict(zip(map(str, rows["source"]), map(float, rows["share"]), strict=True))

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that a report prints, as plain data."""
        low, middle, high = self.spread()
        return {
            "draws": self.count,
            "seed": self.seed,
            "database": self.database,
            "probability": self.probability,
            "stderr": self.stderr,
            "ratio": {"q05": low, "q50": middle, "q95": high},
            "criteria": {
                name: self._criterion_numbers(name) for name in map(str, self.ratio.columns)
            },
        }

    def _criterion_numbers(self, criterion: str) -> dict[str, Any]:
        low, middle, high = self.spread(criterion)
        return {
            "probability": self.passing(criterion),
            "q05": low,
            "q50": middle,
            "q95": high,
            "shares": self._shares_of(criterion),
        }

    def document(self) -> dict[str, Any]:
        """Return the samples without the fan as plain data, numbers with all their digits."""
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
        ratio = {name: np.array(column, float) for name, column in item["ratio"].items()}
        return cls(
            seed=int(item["seed"]),
            database=item["database"],
            status=tuple(item["status"]),
            decides=np.array(item["decides"], float),
            ratio=pd.DataFrame(ratio),
            # the columns are named, since a document without shares has an empty table
            shares=pd.DataFrame(item["shares"], columns=["criterion", "source", "share"]),
            fan=fan,
        )
