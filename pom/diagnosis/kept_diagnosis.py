"""The stored diagnosis of one case, and its bench, which is made only for new runs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from threading import Lock

import pandas as pd

from pom.diagnosis.swap_judgement import Judged, nearest_choice
from pom.diagnosis.swap_runs import SwapBench

Known = dict[frozenset[str], Judged]
"""Judgements of a bench, by choice of terms and parts."""


@dataclass(frozen=True)
class Diagnosed:
    """The stored part of the diagnosis of a case.

    Attributes
    ----------
    table : DataFrame
        Of `diagnose_bench`.
    names : tuple of str
        All terms and parts that can be swapped.
    idle : dict of str to float
        As `SwapBench.idle`.
    known : dict of frozenset of str to Judged
    contents : dict of str to frozenset of str
        As `SwapBench.contents`.
    step : float or None
        As `SwapBench.step`, so that another bench of the case does not search it again.
    """

    table: pd.DataFrame
    names: tuple[str, ...]
    idle: dict[str, float]
    known: Known
    contents: dict[str, frozenset[str]] = field(default_factory=dict)
    step: float | None = None

    @classmethod
    def of(cls, bench: SwapBench, table: pd.DataFrame) -> Diagnosed:
        """Return the stored part of a bench and its table."""
        return cls(
            table=table,
            names=bench.names,
            idle=dict(bench.idle),
            known=dict(bench.known),
            contents=dict(bench.contents),
            step=bench.step,
        )

    def by_content(self) -> dict[str, Judged]:
        """Return the judgements by their content, for a job with another final model."""
        return {content: self.known[choice] for content, choice in self.contents.items()}


class LateBench:
    """A bench that is made when a choice without a judgement is requested.

    A judgement depends only on the case, the models and the choice. A stored judgement is therefore
    equal to that of a new run.

    Parameters
    ----------
    diagnosed : Diagnosed
    known : dict
        Judgements of earlier jobs.
    make : callable
        Returns the bench.
    """

    def __init__(self, diagnosed: Diagnosed, known: Known, make: Callable[[], SwapBench]) -> None:
        self.names, self.idle = diagnosed.names, diagnosed.idle
        self.known: Known = {**known, **diagnosed.known}
        self._make = make
        self._bench: SwapBench | None = None
        self._lock = Lock()

    @property
    def whole(self) -> SwapBench:
        """The bench with all known judgements. It is made on first use."""
        # Threads may need the bench of one case at the same time.
        with self._lock:
            if self._bench is None:
                bench = self._make()
                bench.idle = dict(self.idle)
                bench.known.update(self.known)
                self._bench = bench
            return self._bench

    def judged(self, choices: Iterable[Collection[str]], exact: bool = False) -> list[Judged]:
        """Return the judgement of every choice, as `SwapBench.judged`."""
        if exact:
            keys = [frozenset(choice) for choice in choices]
        else:
            keys = [nearest_choice(choice, self.idle) for choice in choices]
        # Only new choices are flown; the bench then has all judgements.
        if any(key not in self.known for key in keys):
            self.whole.judged(keys, exact=True)
            self.known.update(self.whole.known)
        return [self.known[key] for key in keys]
