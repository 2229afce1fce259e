"""Two models of one aeroplane, and all mixtures of their terms and parts."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import Any

import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.errors import SchemaError
from flightmech.simulation.compiler import changed_parameters
from flightmech.support.kept_stages.content_hashes import content_hash
from pom.diagnosis.term_swaps import contribution_rules, differing_terms

_FINAL = "_of_final"  # suffix of a final term in the database that holds both models


@dataclass(frozen=True)
class SwapModels:
    """Two models of one aeroplane, and every mixture of them.

    Terms are swapped in one compiled model: their scale parameters are 0 or 1. Parts that differ
    only in constants, for example a leg of the gear, are swapped by these parameters. Each choice
    of other parts, for example the tables of an engine, needs a compiled model. It is compiled
    once for all cases. The methods may be called from any thread.

    Attributes
    ----------
    prior, final : DataTree
        The tables of the two databases.
    aircraft : tuple of Aircraft
        A priori and final.
    terms, parts : tuple of str
        Names that differ.
    constants : dict of str to (dict of str to float, dict of str to float)
        By part that differs in constants only: its parameters a priori and final.
    both : DataTree
        Terms of `prior`, and the final version of each term in `terms`.
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
    def of(
        cls, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft]
    ) -> SwapModels:
        """Return the mixtures of two databases and of two aircraft, a priori and final."""
        # Both versions of a term that differs are terms of one database.
        names = tuple(differing_terms(prior, final))
        prior_terms, final_terms = _tables_by_term(prior), _tables_by_term(final)
        both = dict(prior_terms)
        for name in names:
            if name in final_terms:
                both[name + _FINAL] = final_terms[name]
        parts = tuple(different_parts(*aircraft))
        return cls(
            prior=_make_database(prior.attrs, prior_terms),
            final=_make_database(final.attrs, final_terms),
            aircraft=aircraft,
            terms=names,
            parts=parts,
            constants=_changed_constants(aircraft, parts),
            both=_make_database(prior.attrs, both),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without compiled models; another process compiles them again."""
        return SwapModels, (
            self.prior,
            self.final,
            self.aircraft,
            self.terms,
            self.parts,
            self.constants,
            self.both,
        )

    def compiled(self, parts: Collection[str]) -> Any:
        """Return the compiled model with the given final parts, from `compiled_parts`.

        Raises
        ------
        SchemaError
            The parts do not give a valid aircraft, for example tables of two engines that do not
            fit together.
        """
        chosen = frozenset(parts)
        # One compilation at a time: the cases that need this model wait for it. An error is stored
        # as well, so that every thread raises it without a second compilation.
        with self._lock:
            if chosen not in self._sims:
                names = [name for name in self.parts if name in chosen]
                try:
                    aircraft = swap_parts(*self.aircraft, names)
                    self._sims[chosen] = flightmech.compile(aircraft, self.both)
                except SchemaError as error:
                    self._sims[chosen] = error
        sim = self._sims[chosen]
        if isinstance(sim, SchemaError):
            raise sim
        return sim

    def compiled_parts(self, names: Collection[str]) -> frozenset[str]:
        """Return the named parts that need a compiled model: they differ in more than constants."""
        compiled = set()
        for name in self.parts:
            if name in names and name not in self.constants:
                compiled.add(name)
        return frozenset(compiled)

    def choice(self, names: Collection[str]) -> dict[str, float]:
        """Return the parameters that select the named final terms and parts.

        They apply to the model compiled with `compiled_parts`.
        """
        # Without names, the parameters are those of the a-priori model.
        prior, final = self._parameters
        chosen = dict(prior)
        for name in names:
            chosen |= final.get(name, {})
        return chosen

    @cached_property
    def content(self) -> dict[str, str]:
        """Hashes of the content of final terms and parts, by name.

        The empty name has the hash of what all mixtures share: the form of all terms, and the
        names that differ.
        """
        leaves = aerodb.terms(self.final)
        hashes = {name: content_hash(name, leaves.get(name)) for name in self.terms}
        for name in self.parts:
            hashes[name] = content_hash(name, self._simulated_part(name))
        # The form of a term: its axes, and the rules of its contribution.
        forms = {}
        for name, leaf in aerodb.terms(self.both).items():
            axes = {str(axis): leaf[axis].values for axis in leaf.dims}
            forms[name] = (axes, contribution_rules(leaf))
        hashes[""] = content_hash(forms, self.terms, self.parts, sorted(self.constants))
        return hashes

    def _simulated_part(self, name: str) -> Any:
        """Return the data that simulate a final part: its constants, or an aircraft with it.

        The aircraft is the a-priori one with this part. If that is not valid, it is the final one.
        """
        if name in self.constants:
            return self.constants[name]
        try:
            aircraft = swap_parts(*self.aircraft, [name])
        except SchemaError:
            aircraft = self.aircraft[1]
        return replace(aircraft, history="")

    @cached_property
    def _parameters(self) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
        """Parameters of the a-priori model, and the changes of each final term or part."""
        prior: dict[str, float] = {}
        final: dict[str, dict[str, float]] = {}
        # A swapped term has scale 0 for its a-priori table and scale 1 for its final table.
        for name in self.terms:
            prior_scale = f"term.{name.replace('/', '.')}"
            final_scale = prior_scale + _FINAL
            prior |= {prior_scale: 1.0, final_scale: 0.0}
            final[name] = {prior_scale: 0.0, final_scale: 1.0}
        for part, (prior_constants, final_constants) in self.constants.items():
            prior |= prior_constants
            final[part] = final_constants
        return prior, final


def _changed_constants(
    aircraft: tuple[Aircraft, Aircraft], parts: Collection[str]
) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Return the a-priori and final parameters of parts that differ only in constants."""
    constants = {}
    for part in parts:
        try:
            swapped = swap_parts(*aircraft, [part])
        except SchemaError:
            # The part is valid only together with other final parts.
            continue
        changed = changed_parameters(aircraft[0], swapped)
        if changed:
            prior_values, final_values = {}, {}
            for name, (prior, final) in changed.items():
                prior_values[name], final_values[name] = prior, final
            constants[part] = (prior_values, final_values)
    return constants


def _make_database(attributes: Mapping[Any, Any], leaves: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return terms by name as a database."""
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attributes), **leaves})


def _tables_by_term(db: xr.DataTree) -> dict[str, xr.Dataset]:
    """Return the tables of all terms, without standard errors, sources, covariances and history."""
    tables = {}
    for name, leaf in aerodb.terms(db).items():
        simulated = [table for table in ("value", "K1", "K2") if table in leaf]
        tables[name] = leaf[simulated]
    return tables
