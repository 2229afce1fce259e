"""The models between which terms and parts are swapped: one database that holds the terms of both, compiled once per choice of parts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.errors import SchemaError

from .term_swaps import differing

_FINAL = "_of_final"


@dataclass(frozen=True)
class SwapModels:
    """Two models of one aeroplane, and every mixture of them.

    The scale parameters of the terms, 0 or 1, choose among the terms of one compiled model; every choice of parts is a compiled
    model of its own, made once for all cases that fly it, from any thread.

    Attributes
    ----------
    prior, final : DataTree
        The two databases.
    aircraft : tuple of Aircraft
        A priori and final.
    terms, parts : tuple of str
        What differs.
    """

    prior: xr.DataTree
    final: xr.DataTree
    aircraft: tuple[Aircraft, Aircraft]
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    both: xr.DataTree = field(repr=False)
    _sims: dict[frozenset[str], Any] = field(default_factory=dict, repr=False)
    _lock: Any = field(default_factory=Lock, repr=False)

    @classmethod
    def of(cls, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft]) -> SwapModels:
        """Return the mixtures of two databases and of two aircraft, a priori and final."""
        names, theirs = tuple(differing(prior, final)), aerodb.terms(final)
        leaves = aerodb.terms(prior) | {name + _FINAL: theirs[name] for name in names if name in theirs}
        both = xr.DataTree(xr.Dataset(attrs=prior.attrs))
        for name, leaf in leaves.items():
            both[name] = xr.DataTree(_flown(leaf))
        return cls(prior, final, aircraft, names, tuple(different_parts(*aircraft)), both)

    def compiled(self, parts: Collection[str]) -> Any:
        """Return the compiled model with those parts of the final aircraft.

        Raises
        ------
        SchemaError
            The parts make no aircraft, as tables of two engines that make no deck together.
        """
        chosen = frozenset(parts)
        with self._lock:
            if chosen not in self._sims:
                names = [name for name in self.parts if name in chosen]
                try:
                    self._sims[chosen] = flightmech.compile(swap_parts(*self.aircraft, names), self.both)
                except SchemaError as error:
                    self._sims[chosen] = error
        found = self._sims[chosen]
        if isinstance(found, SchemaError):
            raise found
        return found

    def scales(self, names: Collection[str]) -> dict[str, float]:
        """Return the scale parameters with which the compiled model has the named terms of the final database."""
        scales = {}
        for name in self.terms:
            scales[f"term.{name.replace('/', '.')}"] = 0.0 if name in names else 1.0
            scales[f"term.{name.replace('/', '.')}{_FINAL}"] = 1.0 if name in names else 0.0
        return scales


def _flown(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term without what does not fly: standard errors, sources, covariances, the texts of its history."""
    tables = [name for name in ("value", "K1", "K2") if name in leaf]
    return leaf[tables]
