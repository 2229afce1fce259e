"""The diagnosis of one case as a stage that is kept, and its bench, which is made again only where
something new has to be flown.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from threading import Lock

import pandas as pd

from pom.diagnosis.swap_judgement import Judged, nearest_choice
from pom.diagnosis.swap_runs import SwapBench

Known = dict[frozenset[str], Judged]
"""What a bench has flown: judgement by choice of terms and parts."""


@dataclass(frozen=True)
class Diagnosed:
    """What is kept of the diagnosis of a case.

    Attributes
    ----------
    table : DataFrame
        Of `ranked`.
    names : tuple of str
        Everything that can be swapped.
    idle : dict of str to float
        As `SwapBench.idle`.
    known : dict of frozenset of str to Judged
    contents : dict of str to frozenset of str
        As `SwapBench.contents`.
    step : float or None
        As `SwapBench.step`: who makes the bench again need not look for it.
    """

    table: pd.DataFrame
    names: tuple[str, ...]
    idle: dict[str, float]
    known: Known
    contents: dict[str, frozenset[str]] = field(default_factory=dict)
    step: float | None = None

    @classmethod
    def of(cls, bench: SwapBench, table: pd.DataFrame) -> Diagnosed:
        """Return what is kept of a bench and its table."""
        known, contents = dict(bench.known), dict(bench.contents)
        return cls(table, bench.names, dict(bench.idle), known, contents, bench.step)

    def by_content(self) -> dict[str, Judged]:
        """Return what was flown by its content, for a job with another final model."""
        return {content: self.known[choice] for content, choice in self.contents.items()}


class LateBench:
    """A bench whose judgements are known, and which is made only for others.

    A judgement depends on nothing but the case, the models and the choice, so that one kept is as
    good as one flown.

    Parameters
    ----------
    diagnosed : Diagnosed
    known : dict
        Judgements of earlier jobs.
    make : callable
        Gives the bench.
    """

    def __init__(self, diagnosed: Diagnosed, known: Known, make: Callable[[], SwapBench]) -> None:
        self.names, self.idle = diagnosed.names, diagnosed.idle
        self.known: Known = {**known, **diagnosed.known}
        self._make, self._made, self._lock = make, list[SwapBench](), Lock()

    @property
    def whole(self) -> SwapBench:
        """The bench itself, made now."""
        with self._lock:
            if not self._made:
                bench = self._make()
                bench.idle = dict(self.idle)
                bench.known.update(self.known)
                self._made.append(bench)
        return self._made[0]

    def judged(self, choices: Iterable[Collection[str]], exact: bool = False) -> list[Judged]:
        """Return the judgement of every choice, as `SwapBench.judged`."""
        keys = [frozenset(c) if exact else nearest_choice(c, self.idle) for c in choices]
        if not all(key in self.known for key in keys):
            self.whole.judged(keys, exact=True)
            self.known.update(self.whole.known)
        return [self.known[key] for key in keys]
