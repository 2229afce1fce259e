"""Options of a match outside its project file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class MatchOptions:
    """Replay of the cases of a match, and comparison of its tables.

    Attributes
    ----------
    scheduler : str or None
        Address of a dask.distributed cluster (`pom.replay_all`), whose workers reconstruct, form
        coefficients, fit, diagnose, replay, sample and draw.
    resume : Path or None
        Folder of the stored flights of `pom.replay_all`.
    samples, seed : int
        Number and seed of the draws of the final model (`pom.replay_sampled`).
    compare_tables : bool
        Whether the tables are made by all methods and compared node by node, in
        ``tables_compared.csv``.
    """

    scheduler: str | None = None
    resume: Path | None = None
    samples: int = 0
    seed: int = 0
    compare_tables: bool = False

    def decisive(self) -> dict[str, Any]:
        """Return the options that change the bytes of the output."""
        return {"samples": self.samples, "seed": self.seed, "compare": self.compare_tables}
