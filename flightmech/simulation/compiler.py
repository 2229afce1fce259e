"""Compiler of an aircraft and its database to one immutable block for the kernel.

The same aircraft and the same database give the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.build_up import evaluation_levels, term_level
from flightmech.envelope.envelope import Envelope, make_envelope, unpack_envelope
from flightmech.errors import ParseError, SchemaError
from flightmech.flown_states import FLOWN_STATES
from flightmech.names import lookup, unit_suffix
from flightmech.simulation import catalogue, submodels
from flightmech.simulation.kernel import (
    AXIS,
    INPUT,
    OUTPUT,
    PARAMETER,
    STATE,
    TARGET,
    TERM,
    VARIABLE,
    CatalogueEntry,
    KernelModel,
)
from flightmech.simulation.model_block import (
    FORCES,
    MOMENTS,
    Packer,
    Term,
    envelope_section,
    list_table_axes,
)
from flightmech.simulation.model_checks import HINGES, check_leaf, check_root, get_force_axes
from flightmech.simulation.submodels.devices import with_devices
from flightmech.support.array_files.netcdf_trees import GROUPS, read_netcdf_tree
from flightmech.support.file_kinds import file_kind
from flightmech.support.hdf5_seal import demand_self_contained, read_if_sealed
from flightmech.terms import SOURCES, list_model_variables, power_factor
from flightmech.units import from_si

if TYPE_CHECKING:
    import pandas as pd

# Names of inputs in the text of a model.
_SHOWN = 8
# Largest value that a parameter can be set to, as in prepare.c of the kernel.
_LARGEST_PARAMETER = 1e16


@dataclass(frozen=True)
class SimModel:
    """A compiled simulation model.

    Parameters
    ----------
    block : bytes
        The block for the kernel. It is also ``resources/model.bin`` of an FMU.
    """

    block: bytes = field(repr=False)

    def __repr__(self) -> str:
        """Return title, inputs, and numbers of parameters, outputs and terms as text."""
        inputs = ", ".join(self.inputs[:_SHOWN])
        if len(self.inputs) > _SHOWN:
            inputs += ", ..."
        targets: dict[str, int] = {}
        for term in self.terms:
            name = term.partition("/")[0]
            targets[name] = targets.get(name, 0) + 1
        terms = ", ".join(f"{name} {count}" for name, count in targets.items())
        return (
            f"<SimModel {self.title!r}: {len(self.states)} states, {len(self.parameters)} "
            f"parameters, {len(self.outputs)} outputs\n"
            f"  inputs  {len(self.inputs)}: {inputs}\n"
            f"  terms   {len(self.terms)}: {terms}>"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return inputs, outputs, parameters and states as a table.

        Returns
        -------
        DataFrame
            ``kind name units description value low high``; `value` is the start value. [SI]
        """
        import pandas as pd  # models are compiled without it

        kinds = {"input": INPUT, "output": OUTPUT, "parameter": PARAMETER, "state": STATE}
        rows = []
        for kind, number in kinds.items():
            for entry in self.entries(number):
                rows.append({"kind": kind, **entry._asdict()})
        columns = ["kind", "name", "units", "description", "value", "low", "high"]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def model(self) -> KernelModel:
        """The block loaded into the kernel."""
        return KernelModel(self.block)

    def entries(self, kind: int) -> tuple[CatalogueEntry, ...]:
        """Return names, units, descriptions, start values and ranges of one kind.

        The kinds are INPUT ... AXIS of `flightmech.simulation.kernel`.
        """
        return self.model.entries(kind)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the kernel."""
        return _names(self.entries(INPUT))

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return _names(self.entries(OUTPUT))

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return _names(self.entries(PARAMETER))

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the continuous states."""
        return _names(self.entries(STATE))

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms, ``CL/basic`` and so on, in the order of their evaluation."""
        return _names(self.entries(TERM))

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Names of the model variables that the tables and terms use."""
        return _names(self.entries(VARIABLE))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the table axes. A name appears once per set of breakpoints."""
        return _names(self.entries(AXIS))

    @cached_property
    def envelope(self) -> Envelope | None:
        """The validity envelope; None for a model without one."""
        return unpack_envelope(envelope_section(self.block), self.variables)

    @property
    def title(self) -> str:
        """Name of the aircraft."""
        return self.model.title

    @property
    def meta(self) -> dict[str, Any]:
        """Provenance: force axes, attributes of the database, and the texts of each term."""
        return json.loads(self.model.meta)

    def __getstate__(self) -> dict[str, bytes]:
        return {"block": self.block}

    def __setstate__(self, state: dict[str, bytes]) -> None:
        object.__setattr__(self, "block", state["block"])


def compile(aircraft: Aircraft, db: xr.DataTree, envelope: Envelope | None = None) -> SimModel:
    """Compile an aircraft and its database to a simulation model.

    Parameters
    ----------
    aircraft : Aircraft
        Geometry, mass, engines, limits.
    db : DataTree
        Terms at ``/<coefficient>/<contribution>``, as in `flightmech.terms`; root attribute
        ``force_axes``.
    envelope : Envelope, optional
        Validity envelope of the database (`flightmech.envelope.envelope.make_envelope`).  The model
        has the outputs ``envelope.region`` and ``envelope.axis`` then.

    Raises
    ------
    SchemaError
        With all problems: faults of a term, an axis or regressor that is not a model variable, a
        geometry that differs from that of the aircraft.
    """
    names: set[str] = set()
    for leaf in _list_leaves(db):
        names |= list_model_variables(leaf)
    # a control that only the tables use becomes an input of its own
    aircraft = with_devices(aircraft, names)
    terms = _collect_terms(aircraft, db)
    problems = check_root(aircraft, db)
    stages = catalogue.stages_by_name(VARIABLE, submodels.submodel_items(aircraft))
    for term in terms:
        problems += check_leaf(term.name, term.leaf, term.stage, stages=stages)
    if not problems:
        terms, problems = _assign_levels(terms, get_force_axes(db))
    if problems:
        raise SchemaError(f"model of {aircraft.name}", problems)
    packer = Packer(
        aircraft,
        terms,
        force_axes=get_force_axes(db),
        meta=_describe_model(db, terms),
        envelope=envelope,
    )
    block = packer.pack()
    KernelModel(block)  # raises if the kernel does not accept the block
    return SimModel(block)


def changed_parameters(first: Aircraft, second: Aircraft) -> dict[str, tuple[float, float]] | None:
    """Return the start values that differ between the models of two aircraft, with any database.

    Parameters
    ----------
    first, second : Aircraft

    Returns
    -------
    dict of str to (float, float), or None
        Name to start values in the models of both; empty for equal models.  None if more than
        start values differs: tables, names, ranges, geometry.  None also if one aircraft has no
        limit where the other has one, since such a value cannot be set. [SI]
    """
    if not _have_equal_structure(first, second):
        return None
    changes = {}
    rows = zip(_default_parameters(first), _default_parameters(second), strict=True)
    for before, after in rows:
        if before.value == after.value:
            continue
        # values beyond this magnitude mean that there is no limit
        settable = [abs(row.value) <= _LARGEST_PARAMETER for row in (before, after)]
        if not all(settable):
            return None
        changes[before.name] = before.value, after.value
    return changes


def _have_equal_structure(first: Aircraft, second: Aircraft) -> bool:
    """Return whether the models of two aircraft differ in start values only."""
    for attribute in ("S", "cbar", "b", "x_ref_mac", "name"):
        if getattr(first, attribute) != getattr(second, attribute):
            return False
    for list_rows in (
        catalogue.input_rows,
        catalogue.output_rows,
        catalogue.state_rows,
        submodels.submodel_items,
    ):
        if list_rows(first) != list_rows(second):
            return False
    # ranges, units and names of the parameters, whatever their values are
    first_rows = [row._replace(value=0.0) for row in _default_parameters(first)]
    second_rows = [row._replace(value=0.0) for row in _default_parameters(second)]
    return first_rows == second_rows and _have_equal_tables(first, second)


def _have_equal_tables(first: Aircraft, second: Aircraft) -> bool:
    """Return whether the submodels of two aircraft have identical tables."""
    first_terms = list(submodels.submodel_terms(first))
    second_terms = list(submodels.submodel_terms(second))
    if len(first_terms) != len(second_terms):
        return False
    pairs = zip(first_terms, second_terms, strict=True)
    return all(before[:2] == after[:2] and before[2].identical(after[2]) for before, after in pairs)


def _default_parameters(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the parameters of a model without a database."""
    return catalogue.parameter_rows(aircraft, (), {})


def _names(entries: tuple[CatalogueEntry, ...]) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries)


def _list_leaves(db: xr.DataTree) -> Iterator[xr.Dataset]:
    """Return the terms of all coefficients."""
    for coefficient in db.children.values():
        if coefficient.name in GROUPS:
            continue
        for node in coefficient.children.values():
            if "value" in node:
                yield node.dataset


def _collect_terms(aircraft: Aircraft, db: xr.DataTree) -> list[Term]:
    """Return all terms in the order of their evaluation."""
    items = submodels.submodel_items(aircraft)
    stages = catalogue.stages_by_name(TARGET, items)
    numbers = {}
    for number, name in enumerate(catalogue.expand_names(TARGET, items)):
        numbers[name] = number
    terms = []
    for target, name, leaf in submodels.submodel_terms(aircraft):
        terms.append(Term(stages[target], numbers[target], name, leaf=leaf))
    # The kernel has one target per force, with the name it has in stability axes.
    forces = FORCES.get(get_force_axes(db), FORCES["stability"])
    targets = (*FORCES["stability"], *MOMENTS, *HINGES)
    for target, coefficient in zip(targets, (*forces, *MOMENTS, *HINGES), strict=True):
        if coefficient not in db.children:
            continue
        for contribution in sorted(db[coefficient].children):
            leaf = db[coefficient][contribution].to_dataset()
            name = f"{coefficient}/{contribution}"
            terms.append(Term(stages[target], numbers[target], name, leaf=leaf))
    # sorted is stable: terms of one target keep their order
    return sorted(terms, key=lambda term: term[:2])


def _assign_levels(terms: list[Term], force_axes: str) -> tuple[list[Term], list[str]]:
    """Return the terms with their levels, and the loops among coefficients as problems."""
    leaves = {term.name: term.leaf for term in terms}
    levels, problems = evaluation_levels(leaves, force_axes)
    with_levels = []
    for term in terms:
        with_levels.append(term._replace(level=term_level(term.leaf, levels, force_axes)))
    return with_levels, problems


def _describe_model(db: xr.DataTree, terms: list[Term]) -> str:
    """Return the provenance of a model as JSON text."""
    attributes = {}
    for key, item in db.attrs.items():
        if key == FLOWN_STATES:
            # the region tables of the model have been made of them
            continue
        if isinstance(item, np.generic):  # a number from a file
            item = item.item()
        if isinstance(item, str | int | float):
            attributes[key] = item
    texts = {term.name: _describe_term(term.leaf) for term in terms}
    return json.dumps(
        {"database": attributes, "force_axes": get_force_axes(db), "terms": texts},
        sort_keys=True,
        ensure_ascii=False,
    )


def _describe_term(leaf: xr.Dataset) -> dict[str, str]:
    """Return axes, sources and remarks of a term, without empty texts."""
    texts = {
        "axes": ", ".join(_describe_axis(leaf, axis) for axis in list_table_axes(leaf)),
        "source": _count_sources(leaf),
        "power": str(power_factor(leaf) or ""),
    }
    for key in ("regressors", "references", "comment"):
        texts[key] = str(leaf.attrs.get(key, ""))
    return {key: text for key, text in texts.items() if text}


def _describe_axis(leaf: xr.Dataset, axis: str) -> str:
    """Return range, display unit and number of the breakpoints: ``alpha -8 ... 20 deg (19)``."""
    points, unit = leaf.variables[axis].values, lookup(axis).display_units
    text = f"{axis} {from_si(float(points[0]), unit):.4g}"
    if points[-1] != points[0]:
        text += f" ... {from_si(float(points[-1]), unit):.4g}"
    return f"{text}{unit_suffix(unit)} ({len(points)})"


def _count_sources(leaf: xr.Dataset) -> str:
    """Return the number of nodes from each source: ``datcom 30, flight 6``."""
    if "source" not in leaf:
        return ""
    texts = []
    for flag, source in enumerate(SOURCES):
        count = int((leaf.variables["source"].values == flag).sum())
        if count:
            texts.append(f"{source} {count}")
    return ", ".join(texts)


def compile_files(aircraft: str, database: str) -> SimModel:
    """Return the model of an aircraft file (TOML) and a database file (netCDF)."""
    return compile_with_envelope(read_aircraft(aircraft), _open_database(database))


def compile_with_envelope(aircraft: Aircraft, db: xr.DataTree) -> SimModel:
    """Return the model with its validity envelope, if the database keeps its flown states."""
    envelope = make_envelope(db) if db.attrs.get(FLOWN_STATES) else None
    return compile(aircraft, db, envelope)


def _open_database(database: str) -> xr.DataTree:
    """Return the tree of a database file.

    `aerodb`, which writes the file, comes after this package, so that it cannot be imported.
    """
    demand_self_contained(database)
    read_if_sealed(Path(database), "a database; build or copy it again")
    try:
        tree, problems = read_netcdf_tree(Path(database))
    except SchemaError as error:
        raise SchemaError(database, error.problems) from None
    # for a damaged file HDF5 raises OSError, KeyError, RuntimeError, ValueError ...
    except Exception as error:
        raise ParseError(
            database,
            0,
            file_kind(database),
            expected="an aero database, netCDF-4 as `aeromatch db build` writes it",
        ) from error
    if problems:
        raise SchemaError(database, problems)
    return tree
