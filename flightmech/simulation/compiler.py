"""Aircraft and tree of terms to one immutable block that the kernel flies; the same two give the
same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, read_aircraft, reference_in
from flightmech.build_up import COEFFICIENTS, evaluation_levels, term_level, used_coefficients
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import lookup
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
from flightmech.simulation.model_block import FORCES, MOMENTS, Packer, Term, list_table_axes
from flightmech.simulation.submodels.devices import with_devices
from flightmech.support.hdf5_seal import demand_self_contained, read_if_sealed
from flightmech.support.input_files import file_kind
from flightmech.support.netcdf_trees import GROUPS, read_netcdf_tree
from flightmech.terms import (
    SOURCES,
    check_term,
    list_model_variables,
    list_regressors,
    power_factor,
)
from flightmech.units import from_si

IMPLICIT = ("alphadothat", "betadothat", "dnz")
_AGREE = 1e-6  # relative: what a unit conversion and a netCDF round trip may change
_NEAR = 1e-4  # of the chord: two places of the moment reference that count as one
_ONE = "of which only one can be solved for in a term"
_HINGES = ("Ch_e", "Ch_a", "Ch_r")


@dataclass(frozen=True)
class SimModel:
    """A compiled simulation model.

    Parameters
    ----------
    block : bytes
        What the kernel loads; ``resources/model.bin`` of an FMU.
    """

    block: bytes = field(repr=False)

    @cached_property
    def model(self) -> KernelModel:
        """The block loaded into the kernel."""
        return KernelModel(self.block)

    def entries(self, kind: int) -> tuple[CatalogueEntry, ...]:
        """Return names, units, descriptions, start values and ranges of one kind
        (`flightmech.simulation.kernel`: INPUT ... AXIS).
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
        """Names of the table axes; a name appears once per set of breakpoints."""
        return _names(self.entries(AXIS))

    @property
    def title(self) -> str:
        """Name of the aircraft."""
        return self.model.title

    @property
    def meta(self) -> dict[str, Any]:
        """Provenance: force axes, attributes of the database; range, sources and remarks of each
        term.
        """
        return json.loads(self.model.meta)

    def __getstate__(self) -> dict[str, bytes]:
        return {"block": self.block}

    def __setstate__(self, state: dict[str, bytes]) -> None:
        object.__setattr__(self, "block", state["block"])


def compile(aircraft: Aircraft, db: xr.DataTree) -> SimModel:
    """Compile an aircraft and its database to a simulation model.

    Parameters
    ----------
    aircraft : Aircraft
        Geometry, mass, engines, limits.
    db : DataTree
        Terms at ``/<coefficient>/<contribution>``, as in `flightmech.terms`; root attribute
        ``force_axes``.

    Raises
    ------
    SchemaError
        With all problems: faults of a term, an axis or regressor that the simulation does not know,
        a geometry that differs from the aircraft's.
    """
    aircraft = with_devices(
        aircraft, {name for leaf in _leaves(db) for name in list_model_variables(leaf)}
    )
    found = _collect(aircraft, db)
    problems = _root_problems(aircraft, db)
    known = catalogue.stages_by_name(VARIABLE, submodels.submodel_items(aircraft))
    problems += [
        text for term in found for text in _leaf_problems(term.name, term.leaf, term.stage, known)
    ]
    if not problems:
        found, problems = _in_order(found, _force_axes(db))
    if problems:
        raise SchemaError(f"model of {aircraft.name}", problems)
    block = Packer(aircraft, found, _force_axes(db), _meta(db, found)).pack()
    KernelModel(block)  # the kernel accepts it, or states why not
    return SimModel(block)


_LARGEST = 1e16  # of a parameter that is set, as in prepare.c of the kernel


def changed_parameters(one: Aircraft, other: Aircraft) -> dict[str, tuple[float, float]] | None:
    """Return the parameters whose start values make the model of `other` of that of `one`, and
    back, with any database.

    Parameters
    ----------
    one, other : Aircraft

    Returns
    -------
    dict of str to (float, float), or None
        Name to start values in the models of both; empty for equal models.  None where more than
        start values differs: tables, names, ranges, geometry; or where one states that there is no
        limit, which cannot be set. [SI]
    """
    geometry = [(a.S, a.cbar, a.b, a.x_ref_mac, a.name) for a in (one, other)]
    names = [
        [
            catalogue.input_rows(a),
            catalogue.output_rows(a),
            catalogue.state_rows(a),
            submodels.submodel_items(a),
        ]
        for a in (one, other)
    ]
    rows = [catalogue.parameter_rows(a, (), {}) for a in (one, other)]
    ranges = [[row._replace(value=0.0) for row in found] for found in rows]
    tables = [list(submodels.submodel_terms(a)) for a in (one, other)]
    if (
        geometry[0] != geometry[1]
        or names[0] != names[1]
        or ranges[0] != ranges[1]
        or len(tables[0]) != len(tables[1])
    ):
        return None
    if not all(a[:2] == b[:2] and a[2].identical(b[2]) for a, b in zip(*tables, strict=True)):
        return None
    changed = {
        before.name: (before.value, after.value)
        for before, after in zip(*rows, strict=True)
        if before.value != after.value
    }
    return (
        changed
        if all(abs(value) <= _LARGEST for values in changed.values() for value in values)
        else None
    )


def _names(entries: tuple[CatalogueEntry, ...]) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries)


def _force_axes(db: xr.DataTree) -> str:
    return str(db.attrs.get("force_axes", "stability"))


def _leaves(db: xr.DataTree) -> Iterator[xr.Dataset]:
    """Return the terms of all coefficients."""
    for coefficient in db.children.values():
        if coefficient.name not in GROUPS:
            yield from (node.dataset for node in coefficient.children.values() if "value" in node)


def _collect(aircraft: Aircraft, db: xr.DataTree) -> list[Term]:
    """Return all terms in the order of their evaluation."""
    items = submodels.submodel_items(aircraft)
    stage, number = (
        catalogue.stages_by_name(TARGET, items),
        {name: i for i, name in enumerate(catalogue.expand_names(TARGET, items))},
    )
    forces = FORCES.get(_force_axes(db), FORCES["stability"])
    found = [
        Term(stage[target], number[target], name, leaf)
        for target, name, leaf in submodels.submodel_terms(aircraft)
    ]
    for target, coefficient in zip(
        (*FORCES["stability"], *MOMENTS, *_HINGES), (*forces, *MOMENTS, *_HINGES), strict=True
    ):
        if coefficient in db.children:
            for contribution in sorted(db[coefficient].children):
                leaf = db[coefficient][contribution].to_dataset()
                found.append(
                    Term(stage[target], number[target], f"{coefficient}/{contribution}", leaf)
                )
    return sorted(found, key=lambda term: term[:2])


def _in_order(found: list[Term], force_axes: str) -> tuple[list[Term], list[str]]:
    """Return the terms with their levels, and the loops among coefficients."""
    of, problems = evaluation_levels({term.name: term.leaf for term in found}, force_axes)
    return [term._replace(level=term_level(term.leaf, of, force_axes)) for term in found], problems


def _root_problems(aircraft: Aircraft, db: xr.DataTree) -> list[str]:
    problems = []
    axes = _force_axes(db)
    if axes not in FORCES:
        problems.append(f"attribute force_axes is {axes!r}; allowed: {', '.join(FORCES)}")
        axes = "stability"
    for name in map(str, db.children):
        if name not in (*FORCES[axes], *MOMENTS, *_HINGES, *GROUPS):
            allowed = ", ".join((*FORCES[axes], *MOMENTS))
            problems.append(
                f"/{name} is no coefficient; with force_axes {axes} there are {allowed}"
            )
    problems += [
        f"/{path} holds a table; a term lies at /<coefficient>/<contribution>, this one "
        f"would not fly"
        for path in _astray(db)
    ]
    for name in ("S", "cbar", "b"):
        if name in db.attrs and not np.isclose(
            float(db.attrs[name]), getattr(aircraft, name), rtol=_AGREE, atol=0.0
        ):
            problems.append(
                f"{name} is {float(db.attrs[name]):.8g} in the database and "
                f"{getattr(aircraft, name):.8g} in the aircraft; they must agree"
            )
    for name, own in zip(
        ("x_ref", "y_ref", "z_ref"), reference_in(aircraft, db.attrs), strict=True
    ):
        if name in db.attrs and not np.isclose(
            float(db.attrs[name]), own, rtol=_AGREE, atol=1e-4 * aircraft.cbar
        ):
            problems.append(
                f"{name} is {float(db.attrs[name]):.6g} m in the database and {own:.6g} m in "
                f"the aircraft; move the moment reference"
            )
    return problems


def _astray(db: xr.DataTree) -> Iterator[str]:
    for path, node in db.subtree_with_keys:
        if path.count("/") != 1 and path.split("/")[0] not in GROUPS and node.data_vars:
            yield path


def _leaf_problems(name: str, leaf: xr.Dataset, stage: int, known: Mapping[str, int]) -> list[str]:
    problems = check_term(leaf)
    if problems:
        return [f"{name}: {text}" for text in problems]
    problems += [
        f"{name}: {text}"
        for axis in list_table_axes(leaf)
        for text in _axis_problems(axis, known, stage)
    ]
    words, factor = list_regressors(leaf), power_factor(leaf)
    problems += [
        f"{name}: regressor: {text}"
        for word in words
        for text in _variable_problems(word, known, stage)
    ]
    if factor:
        problems += [
            f"{name}: power: {text}" for text in _axis_problems(factor.variable, known, stage)
        ]
    if used_coefficients(leaf) and words and set(words) & set(IMPLICIT):
        problems.append(
            f"{name}: depends on {', '.join(sorted(used_coefficients(leaf)))} and on "
            f"{', '.join(sorted(set(words) & set(IMPLICIT)))}, {_ONE}"
        )
    if sum(word in IMPLICIT for word in words) > 1:
        problems.append(
            f"{name}: regressors {' '.join(words)}: only one of {', '.join(IMPLICIT)} can be "
            f"solved for in a term"
        )
    return problems


def _axis_problems(axis: str, known: Mapping[str, int], stage: int) -> list[str]:
    if axis in IMPLICIT:
        return [f"{axis} cannot be an axis, the simulation solves for it; make it a regressor"]
    return [f"axis: {text}" for text in _variable_problems(axis, known, stage)]


def _variable_problems(name: str, known: Mapping[str, int], stage: int) -> list[str]:
    if name not in known:
        hint = (
            "write engine1.throttle or engine1.thrust for one engine"
            if name in ("throttle", "thrust")
            else ""
        )
        return [str(UnknownName(name, list(known), "model variable of the simulation", hint))]
    if name in COEFFICIENTS and stage > known[name]:
        return [f"only terms of {', '.join(COEFFICIENTS)} can depend on {name}"]
    if known[name] > stage and not (name in COEFFICIENTS and stage == known[name] - 1):
        return [f"{name} is found only after this table is evaluated; it cannot depend on it"]
    return []


def _meta(db: xr.DataTree, terms: list[Term]) -> str:
    # numbers read from a file are NumPy's own
    attributes = {
        key: item.item() if isinstance(item, np.generic) else item for key, item in db.attrs.items()
    }
    plain = {key: item for key, item in attributes.items() if isinstance(item, str | int | float)}
    texts = {t.name: _texts(t.leaf) for t in terms}
    return json.dumps(
        {"database": plain, "force_axes": _force_axes(db), "terms": texts},
        sort_keys=True,
        ensure_ascii=False,
    )


def _texts(leaf: xr.Dataset) -> dict[str, str]:
    """Return what a reader of the model should know of a term."""
    found = {
        "axes": ", ".join(_extent(leaf, axis) for axis in list_table_axes(leaf)),
        "source": _sources(leaf),
    }
    found |= {key: str(leaf.attrs.get(key, "")) for key in ("regressors", "references", "comment")}
    found["power"] = str(power_factor(leaf) or "")
    return {key: text for key, text in found.items() if text}


def _extent(leaf: xr.Dataset, axis: str) -> str:
    """Return range, display unit and number of the breakpoints: ``alpha -8 ... 20 deg (19)``."""
    points, unit = leaf.variables[axis].values, lookup(axis).display_units
    ends = " ... ".join(
        f"{from_si(float(x), unit):.4g}" for x in dict.fromkeys((points[0], points[-1]))
    )
    return f"{axis} {ends}{'' if unit == '1' else ' ' + unit} ({len(points)})"


def _sources(leaf: xr.Dataset) -> str:
    """Return how many nodes come from where: ``datcom 30, flight 6``."""
    if "source" not in leaf:
        return ""
    counts = {
        word: int((leaf.variables["source"].values == flag).sum())
        for flag, word in enumerate(SOURCES)
    }
    return ", ".join(f"{word} {count}" for word, count in counts.items() if count)


def compile_files(aircraft: str, database: str) -> SimModel:
    """Return the model of an aircraft file (TOML) and a database file (netCDF)."""

    compile_model = compile

    return compile_model(read_aircraft(aircraft), _open(database))


def _open(database: str) -> xr.DataTree:
    """Return the tree of a database file; `aerodb`, which writes it, stands to the right of this
    package.
    """

    demand_self_contained(database)
    read_if_sealed(Path(database), "a database; build or copy it again")
    try:
        tree, problems = read_netcdf_tree(Path(database))
    except SchemaError as error:
        raise SchemaError(database, error.problems) from None
    except (
        Exception
    ) as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(
            database,
            0,
            file_kind(database),
            "an aero database, netCDF-4 as `aeromatch db build` writes it",
        ) from error
    if problems:
        raise SchemaError(database, problems)
    return tree
