"""The models between which terms and parts are swapped: one database that holds the terms of both, compiled once per choice of parts."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock
from typing import Any

import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.errors import SchemaError
from flightmech.simulation.compiler import changed_parameters

from .term_swaps import differing

_FINAL = "_of_final"


@dataclass(frozen=True)
class SwapModels:
    """Two models of one aeroplane, and every mixture of them.

    The scale parameters of the terms, 0 or 1, choose among the terms of one compiled model; parts that differ in constants only, such as a
    leg of the gear, are chosen by their parameters; every choice of other parts, such as the tables of an engine, is a compiled model of
    its own, made once for all cases that fly it, from any thread.

    Attributes
    ----------
    prior, final : DataTree
        The tables of the two databases.
    aircraft : tuple of Aircraft
        A priori and final.
    terms, parts : tuple of str
        What differs.
    constants : dict of str to (dict of str to float, dict of str to float)
        By part that differs in constants only: its parameters a priori and final.
    """

    prior: xr.DataTree
    final: xr.DataTree
    aircraft: tuple[Aircraft, Aircraft]
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    constants: dict[str, tuple[dict[str, float], dict[str, float]]]
    both: xr.DataTree = field(repr=False)
    _sims: dict[frozenset[str], Any] = field(default_factory=dict, repr=False)
    _lock: Any = field(default_factory=Lock, repr=False)

    @classmethod
    def of(cls, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft]) -> SwapModels:
        """Return the mixtures of two databases and of two aircraft, a priori and final."""
        names = tuple(differing(prior, final))
        ours, theirs = ({name: _flown(leaf) for name, leaf in aerodb.terms(db).items()} for db in (prior, final))
        both = ours | {name + _FINAL: theirs[name] for name in names if name in theirs}
        trees = [_tree(attrs, leaves) for attrs, leaves in ((prior.attrs, ours), (final.attrs, theirs), (prior.attrs, both))]
        parts = tuple(different_parts(*aircraft))
        return cls(trees[0], trees[1], aircraft, names, parts, _constants(aircraft, parts), trees[2])

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process without what is compiled, which a process makes for itself."""
        return SwapModels, (self.prior, self.final, self.aircraft, self.terms, self.parts, self.constants, self.both)

    def compiled(self, parts: Collection[str]) -> Any:
        """Return the compiled model with those parts of the final aircraft, from `compiled_parts`.

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

    def compiled_parts(self, names: Collection[str]) -> frozenset[str]:
        """Return the named parts that a compiled model has to hold, since they differ in more than constants."""
        return frozenset(name for name in self.parts if name in names and name not in self.constants)

    def choice(self, names: Collection[str]) -> dict[str, float]:
        """Return the parameters with which the model compiled with `compiled_parts` has the named terms and parts of the final one."""
        prior, final = self._values
        chosen = dict(prior)
        for name in names:
            chosen |= final.get(name, {})
        return chosen

    @cached_property
    def _values(self) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
        """The parameters of the a-priori model, and by name what a term or part of the final one changes of them."""
        prior: dict[str, float] = {}
        final: dict[str, dict[str, float]] = {}
        for name in self.terms:
            one, other = (f"term.{name.replace('/', '.')}{end}" for end in ("", _FINAL))
            prior |= {one: 1.0, other: 0.0}
            final[name] = {one: 0.0, other: 1.0}
        for part, (before, after) in self.constants.items():
            prior |= before
            final[part] = after
        return prior, final


def _constants(aircraft: tuple[Aircraft, Aircraft], parts: Collection[str]) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Return the parameters, a priori and final, of parts that differ in nothing else."""
    found = {}
    for part in parts:
        try:
            swapped = swap_parts(*aircraft, [part])
        except SchemaError:  # it makes no aircraft without other parts
            continue
        if changed := changed_parameters(aircraft[0], swapped):
            found[part] = ({name: one for name, (one, _) in changed.items()}, {name: other for name, (_, other) in changed.items()})
    return found


def _tree(attributes: Mapping[Any, Any], leaves: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return terms by name as a database."""
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attributes), **leaves})


def _flown(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term without what does not fly: standard errors, sources, covariances, the texts of its history."""
    tables = [name for name in ("value", "K1", "K2") if name in leaf]
    return leaf[tables]
