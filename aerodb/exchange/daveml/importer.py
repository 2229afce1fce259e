"""A DAVE-ML aerodynamic model as a database: its build-up equations multiplied out into terms,
exactly, or refused.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import export_checks as sample_states
from aerodb.exchange.daveml import polynomials
from aerodb.exchange.daveml.document.model import DaveModel, DaveReference, DaveVariable, Shot
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.expansion import approximate_variable, expand_variables
from aerodb.exchange.daveml.polynomials import Sum
from aerodb.exchange.daveml.sampler import Sampler
from aerodb.exchange.daveml.terms import CoefficientPart, leaves_from_parts, parts_of
from aerodb.exchange.daveml.vocabulary import (
    COEFFICIENTS,
    STORED,
    WRITER,
    device_of,
    file_unit_conversion,
    quantity_of,
    unpack_attributes,
)
from aerodb.store.evaluation import contributions
from aerodb.store.schema import FORCE_AXES, make_database, terms
from flightmech.errors import AeromatchWarning, SchemaError, UnitError, UnknownName
from flightmech.names import ITEM, VOCABULARY, lookup, quantity_attributes
from flightmech.support.netcdf_trees import CHECKS
from flightmech.terms import list_model_variables

_REFERENCE = ("S", "cbar", "b")
_PLACE = ("x_ref", "y_ref", "z_ref")
_PROOFS = 500  # states at which the database is compared with the model
_SAMPLES = 5000  # the same where functions were sampled
_ATTEMPTS = 4  # times that sampling becomes finer before it is given up
_ROUNDING = 1e-11  # of the sum of the absolute contributions: some hundred roundings


def import_daveml(
    path: str | os.PathLike,
    names: Mapping[str, str] | None = None,
    *,
    S: float | None = None,
    cbar: float | None = None,
    b: float | None = None,
    force_axes: str | None = None,
    without: Collection[str] = (),
    checks: str = "raise",
    sample: float | None = None,
    grid: Mapping[str, Sequence[float]] | None = None,
) -> xr.DataTree:
    """Read the aerodynamic model of a DAVE-ML file as a database.

    Tables become tables and calculations are multiplied out into *table x table x variables*;
    angles become radians, lengths metres, ``p b / 2V`` the reduced rate ``phat``.  Look-ups over
    the absolute value or a limited value of a variable, and tables whose sign follows that of an
    axis, become tables over the variable.  The result equals the model but for rounding; this is
    tried at 500 states, inside the tables and beyond, before it is returned.

    Parameters
    ----------
    path : path
        The file.
    names : mapping of str to str, optional
        Quantity of the vocabulary by varID or name, for variables that do not carry a name of
        S-119: ``{"DEFL": "delta_e"}``.  An S-119 unit in brackets counts instead of the file's:
        ``{"ALPHA_TOT_D": "alpha [deg]"}``.  An angle or pure number without a quantity is an input
        of the model by its varID, ``device.DBFLL.deflection`` or ``device.SPIKE.setting``.
    S, cbar, b : float, optional
        Reference area [m2], chord and span [m] of a file that does not state them.
    force_axes : {"stability", "wind", "body"}, optional
        Axes of the forces; by default those of the coefficients found, lift and drag counting as
        stability axes unless the file states wind axes.
    without : collection of str
        Coefficients to leave out, because they cannot be taken over exactly: ``("CD",)``.
    checks : {"raise", "ignore"}
        What a check case of the file that fails does.
    sample : float, optional
        Largest difference of a coefficient with which functions that are no product of tables may
        be put onto tables; without it such coefficients are refused.  [1]
    grid : mapping of str to sequence of float, optional
        Where they are sampled, by quantity: two numbers, the range, or more, the breakpoints.
        Without an entry the range is that of the tables over the quantity, inside the limits of the
        input, and breakpoints are added until `sample` is kept. [SI]

    Returns
    -------
    DataTree
        Moments about the reference point of the file.  Its check cases stand in ``/checks``, in SI.
        A term with a sampled table states how well in its attribute ``sampled``; the difference of
        each coefficient, measured at 5000 states, stands in the history.

    Raises
    ------
    ParseError, SchemaError
        As `read`; SchemaError also with every variable that cannot be taken over and the reason,
        and when reference quantities are missing or differ.
    UnknownName
        A variable of `names` that the file does not have, or a quantity that the vocabulary does
        not have.

    Warns
    -----
    AeromatchWarning
        Inputs that are no quantity of the vocabulary and became inputs of the model by their varID.
    """
    model, names = _named(read(path, checks), names or {})
    mine = _quantities(model, names)
    geometry = _geometry(model, {"S": S, "cbar": cbar, "b": b})
    inputs = {
        varID: _substitute(model.variables[varID], quantity) for varID, quantity in mine.items()
    }
    sums, reasons = expand_variables(model, inputs, geometry)
    outputs, axes = _coefficients(model, names, force_axes, without)
    source = _ImportedModel(model, mine, outputs, geometry, sums, reasons)
    if sample is None and grid:
        raise ValueError(
            "grid= states where functions are sampled; give sample=, the largest difference "
            "allowed, with it"
        )
    if sample is None:
        leaves, lines = _terms(source, None), list[str]()
        _prove(make_database(leaves, **_root(source, Path(path), axes)), source, {}, 0.0)
    else:
        leaves, lines = _sampled_terms(
            source,
            lambda found: make_database(found, **_root(source, Path(path), axes)),
            sample,
            grid or {},
        )
    root = _root(source, Path(path), axes, _named_inputs(model, mine, names, leaves), lines)
    db, cases = make_database(leaves, **root), _checks(model, mine, outputs, geometry)
    return db if cases is None else xr.DataTree.from_dict({**db.to_dict(), f"/{CHECKS}": cases})


@dataclass(frozen=True)
class _ImportedModel:
    """A model as it is taken over: quantities of inputs and varIDs of coefficients, lengths, exact
    sums and why others are not exact.
    """

    model: DaveModel
    mine: Mapping[str, str]
    outputs: Mapping[str, str]
    geometry: Mapping[str, float]
    sums: Mapping[str, Sum]
    reasons: Mapping[str, str]


def _terms(source: _ImportedModel, sampler: Sampler | None) -> dict[str, xr.Dataset]:
    """Return the terms of all coefficients by name.

    Raises
    ------
    SchemaError
        With every coefficient that is no sum of terms and the reason.
    """
    leaves: dict[str, xr.Dataset] = {}
    problems = []
    for coefficient, varID in source.outputs.items():
        try:
            leaves |= _leaves(source, coefficient, varID, sampler)
        except polynomials.Inexact as error:
            problems.append(
                f"{coefficient}: {varID} ({source.model.variables[varID].name}): {error}"
            )
    if problems:
        ways = (
            ["put them onto tables with sample=", "leave them out with without="]
            if sampler is None
            else ["leave them out with without="]
        )
        way = (
            f"{', '.join(ways)}, or evaluate the model itself with "
            f"aerodb.exchange.daveml.read(path).evaluate"
        )
        raise SchemaError(
            f"{Path(source.model.file).name} holds coefficients that are no exact sum of "
            f"terms; {way}",
            problems,
        )
    return leaves


def _sampled_terms(
    source: _ImportedModel,
    put: Callable[[dict[str, xr.Dataset]], xr.DataTree],
    sample: float,
    grid: Mapping[str, Sequence[float]],
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the terms, sampled more finely until every coefficient keeps the bound, and a line on
    each coefficient that was sampled.
    """
    if not sample > 0.0:
        raise ValueError(
            f"sample is {sample!r}; give the largest difference of a coefficient, such as 1e-4"
        )
    bound = (
        2.0 * sample
    )  # of one function along all axes; what a coefficient makes of it is measured
    for attempt in range(_ATTEMPTS):
        sampler = Sampler(source.model, source.mine, source.sums, bound, grid)
        leaves = _terms(source, sampler)
        gaps = _prove(
            put(leaves), source, sampler.ranges(), np.inf if attempt + 1 < _ATTEMPTS else sample
        )
        worst = max(gaps.values(), default=0.0)
        if worst <= sample:
            break
        bound *= 0.5 * sample / worst
    box = ", ".join(f"{name} {low:.6g} ... {high:.6g}" for name, (low, high) in sampler.box.items())
    text = (
        f"from the file by at most {{:.2g}} at {_SAMPLES} states, allowed {sample:g}; sampled "
        f"over {box} (SI)"
    )
    return leaves, [f"{name} differs {text.format(gap)}" for name, gap in gaps.items()]


def _named(model: DaveModel, names: Mapping[str, str]) -> tuple[DaveModel, dict[str, str]]:
    """Return the model with the units that the names carry, and the quantities by varID."""
    quantities, variables = {}, dict(model.variables)
    for key, text in names.items():
        name, _, unit = text.partition("[")
        variable = model.find(key)
        lookup(name.strip())  # raises for a name that there is not
        quantities[variable.varID] = name.strip()
        if unit:
            variables[variable.varID] = replace(variable, units=unit.strip(" ]"))
    return replace(model, variables=variables), quantities


def _quantities(model: DaveModel, names: Mapping[str, str]) -> dict[str, str]:
    """Return the quantity of each input, by varID."""
    found: dict[str, str] = {}
    for varID in model.inputs:
        variable = model.variables[varID]
        quantity = names.get(varID) or quantity_of(variable) or device_of(variable)
        if quantity and quantity in found.values():
            other = next(key for key, item in found.items() if item == quantity)
            raise SchemaError(
                model.file,
                [f"the inputs {other} and {varID} are both {quantity}; state which with names="],
            )
        if quantity:
            found[varID] = quantity
    return found


def _substitute(variable: DaveVariable, quantity: str) -> Sum:
    factor, offset = file_unit_conversion(variable, quantity)
    return polynomials.make_variable_sum(quantity, factor, offset)


def _geometry(model: DaveModel, given: Mapping[str, float | None]) -> dict[str, float]:
    """Return S, cbar, b in SI, from the constants of the file or the caller; they must not
    contradict each other.
    """
    found: dict[str, float] = {}
    for variable in model.variables.values():
        quantity = variable.name if variable.name in _PLACE else quantity_of(variable)
        if (
            quantity in (*_REFERENCE, *_PLACE)
            and variable.initial is not None
            and variable.varID not in model.functions
        ):
            factor, offset = file_unit_conversion(
                variable, "cbar" if quantity in _PLACE else quantity
            )
            found[quantity] = (variable.initial - offset) / factor
    problems = []
    for quantity, value in given.items():
        if (
            value is not None
            and quantity in found
            and not np.isclose(value, found[quantity], rtol=1e-6)
        ):
            problems.append(
                f"{quantity} is {found[quantity]:.9g} in the file and {value:.9g} in the "
                f"call; leave it out"
            )
        if value is not None:
            found.setdefault(quantity, value)
    problems += [
        f"the file does not state {quantity}; pass {quantity}="
        for quantity in _REFERENCE
        if quantity not in found
    ]
    if problems:
        raise SchemaError(f"reference quantities of {model.file}", problems)
    return found


def _coefficients(
    model: DaveModel, names: Mapping[str, str], axes: str | None, without: Collection[str]
) -> tuple[dict[str, str], str]:
    """Return the varID of each coefficient that the file gives, and the axes of its forces."""
    found: dict[str, str] = {}
    for varID in model.outputs:
        quantity = names.get(varID) or quantity_of(model.variables[varID])
        if quantity not in COEFFICIENTS:
            continue
        if quantity in found:
            raise SchemaError(
                model.file,
                [
                    f"the outputs {found[quantity]} and {varID} are both {quantity}; state "
                    f"which with names="
                ],
            )
        found[quantity] = varID
    if axes is None:
        axes = _axes_of(model, found)
    if axes not in FORCE_AXES:
        raise ValueError(f"force_axes is {axes!r}; allowed: {', '.join(FORCE_AXES)}")
    for name in without:
        if name not in COEFFICIENTS:
            raise UnknownName(name, COEFFICIENTS, "coefficient")
    kept = {name: varID for name, varID in found.items() if name not in without}
    kept = {
        name: varID
        for name, varID in kept.items()
        if name in FORCE_AXES[axes] or name.startswith("Ch_")
    }
    if model.header.version.startswith(
        WRITER
    ):  # we write all totals, also of coefficients that have no term
        kept = {
            name: varID
            for name, varID in kept.items()
            if model.variables[varID].calculation is not None
        }
    if not kept:
        given = ", ".join(f"{varID} ({model.variables[varID].name})" for varID in model.outputs)
        raise SchemaError(
            model.file,
            [
                f"no output is a coefficient: {given}; state which with "
                f"names={{'{model.outputs[0]}': 'CL'}}, say"
            ],
        )
    return kept, axes


def _axes_of(model: DaveModel, found: Mapping[str, str]) -> str:
    body, other = (
        [name for name in ("CX", "CZ") if name in found],
        [name for name in ("CL", "CD") if name in found],
    )
    if body and other:
        raise SchemaError(
            model.file,
            [f"gives both {' '.join(body)} and {' '.join(other)}; choose with force_axes="],
        )
    if body:
        return "body"
    axis_systems = " ".join(model.variables[found[name]].axis_system.lower() for name in other)
    return "wind" if "wind" in axis_systems else "stability"


def _leaves(
    source: _ImportedModel, coefficient: str, varID: str, sampler: Sampler | None
) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient by name."""
    model, sums = source.model, source.sums if sampler is None else sampler.sums
    factor, offset = file_unit_conversion(model.variables[varID], coefficient)
    if sampler is not None:
        approximate_variable(sampler, varID, source.reasons, source.geometry)
    if varID not in sums:
        raise polynomials.Inexact(source.reasons[varID])
    parts = parts_of(model, coefficient, varID, sums)
    if factor != 1.0 or offset != 0.0:
        parts = [
            CoefficientPart(
                part.name, polynomials.scale_sum(part.sum, 1.0 / factor), part.order, part.texts
            )
            for part in parts
        ]
    return leaves_from_parts(model, coefficient, parts, None if sampler is None else sampler.joined)


def _named_inputs(
    model: DaveModel,
    mine: Mapping[str, str],
    names: Mapping[str, str],
    leaves: Mapping[str, xr.Dataset],
) -> str:
    """Return which inputs the terms use under a name that nobody gave them, as a remark; empty when
    there are none.
    """
    used = set().union(*(list_model_variables(leaf) for leaf in leaves.values()))
    unnamed = {
        v: name
        for v, name in mine.items()
        if name in used and v not in names and not quantity_of(model.variables[v])
    }
    found = [f"{varID} is {name}" for varID, name in unnamed.items()]
    if not found:
        return ""
    text = f"inputs that are no quantity of the vocabulary: {', '.join(found)}"
    warnings.warn(
        f"{text}; give a quantity with names= if one of them is meant",
        AeromatchWarning,
        stacklevel=3,
    )
    return text


def _root(
    source: _ImportedModel, path: Path, axes: str, remark: str = "", lines: Sequence[str] = ()
) -> dict[str, str | float]:
    model, header = source.model, source.model.header
    missing = [name for name in FORCE_AXES[axes] if name not in source.outputs]
    attributes: dict[str, str | float] = {
        "title": header.name or path.stem,
        "aircraft": header.name or path.stem,
        "source": f"DAVE-ML file {path.name}",
        "references": "; ".join(_cited(reference) for reference in header.references),
        "comment": "\n".join(filter(None, [header.description, *_remarks(model), remark])),
        "absent": " ".join(f"{name}/basic" for name in missing),
    }
    if header.version.startswith(WRITER):
        attributes = unpack_attributes(header.description)
    values = model.check()
    line = (
        f"import_daveml: {path.name}, version {header.version or 'unnamed'}, "
        f"{len(model.shots)} check cases with {len(values)} values, "
    )
    line += "all met" if values["passed"].all() else f"{int((~values['passed']).sum())} NOT met"
    history = (
        [m.description for m in header.modifications]
        if header.version.startswith(WRITER)
        else _modifications(model)
    )
    attributes["history"] = "\n".join(filter(None, [*history, line, *lines]))
    return {**attributes, **dict.fromkeys(_PLACE, 0.0), **source.geometry, "force_axes": axes}


def _cited(reference: DaveReference) -> str:
    parts = (reference.author, reference.title, reference.accession, reference.date)
    return ", ".join(part.replace(";", ",") for part in parts if part)


def _modifications(model: DaveModel) -> list[str]:
    return [
        " ".join(f"{m.date} modification {m.modID}: {m.description}".split())
        for m in model.header.modifications
    ]


def _remarks(model: DaveModel) -> list[str]:
    """Return what a reader of the database should know of the file."""
    limited = [
        f"{v.varID} is limited to {v.low:g} ... {v.high:g} {v.units} in the file; the "
        f"reduced rates of the database have no such limit"
        for v in model.variables.values()
        if quantity_of(v) == "V" and v.varID in model.inputs and np.isfinite((v.low, v.high)).any()
    ]
    return [*limited, *model.notes]


def _file_inputs(
    model: DaveModel, mine: Mapping[str, str], states: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return states in the variables and units of the file."""
    found = {}
    for varID, quantity in mine.items():
        if quantity in states:
            factor, offset = file_unit_conversion(model.variables[varID], quantity)
            found[varID] = factor * states[quantity] + offset
    return found


def _prove(
    db: xr.DataTree, source: _ImportedModel, box: Mapping[str, tuple[float, float]], sample: float
) -> dict[str, float]:
    """Compare the database with the model at states inside and beyond its tables; where functions
    were sampled, inside their range.

    Returns
    -------
    dict of str to float
        Largest difference of the coefficients that have sampled tables.

    Raises
    ------
    SchemaError
        A coefficient that differs by more than rounding, or by more than `sample` where it has
        sampled tables.
    """
    model, mine = source.model, source.mine
    count = _SAMPLES if box else _PROOFS
    drawn = sample_states.draw_check_states(
        terms(db).values(), count, 0.0 if box else sample_states.BEYOND, box
    )
    states = sample_states.with_rates(drawn, source.geometry)
    for quantity in mine.values():
        states.setdefault(quantity, np.zeros(count))
    found = model.evaluate(
        _file_inputs(model, mine, states) | {v: 0.0 for v in model.inputs if v not in mine}
    )
    sampled = {name.split("/")[0] for name, leaf in terms(db).items() if "sampled" in leaf.attrs}
    problems, gaps = [], {}
    for coefficient, varID in source.outputs.items():
        factor, offset = file_unit_conversion(model.variables[varID], coefficient)
        parts = contributions(db, coefficient, states, outside="clamp")
        total, size = (
            sum(parts.values(), np.zeros(count)),
            sum(map(np.abs, parts.values()), np.zeros(count)),
        )
        gap = np.abs(total - (found[varID] - offset) / factor)
        allowed = _ROUNDING * np.maximum(size, 1e-3)
        if coefficient in sampled:
            gaps[coefficient] = float(gap.max())
            allowed = np.maximum(allowed, sample)
        if not (gap <= allowed).all():
            at = int(np.nanargmax(gap - allowed))
            place = ", ".join(f"{name} {states[name][at]:.6g}" for name in sorted(drawn))
            problems.append(f"{coefficient} differs from {varID} by {gap[at]:.3g} at {place}")
    if problems and sampled:
        raise SchemaError(
            f"{model.file}: sample={sample:g} is not kept; give more breakpoints with grid=, "
            f"or a larger sample",
            problems,
        )
    if problems:
        raise SchemaError(f"{model.file}: the terms do not give the model back", problems)
    return gaps


def _checks(
    model: DaveModel,
    mine: Mapping[str, str],
    outputs: Mapping[str, str],
    geometry: Mapping[str, float],
) -> xr.Dataset | None:
    """Return the check cases as a Dataset over ``case``: inputs and expected coefficients in SI,
    with their tolerances.

    Their names are the lines of the attribute ``names``.
    """
    shots = [shot for shot in model.shots if _is_known(model, shot)]
    if model.header.version.startswith(
        WRITER
    ):  # the other ones of our files were drawn, and are drawn again
        shots = [
            replace(shot, name=shot.name.removeprefix(STORED))
            for shot in shots
            if shot.name.startswith(STORED)
        ]
    if not shots:
        return None
    back = {varID: quantity for quantity, varID in outputs.items()}
    rows = [_case(model, shot, mine, back) for shot in shots]
    keys = dict.fromkeys(key for row in rows for key in row)
    columns = {key: np.array([row.get(key, np.nan) for row in rows]) for key in keys}
    columns = sample_states.with_reduced(columns, geometry)
    cases = xr.Dataset(
        {key: ("case", column) for key, column in columns.items()},
        {"case": np.arange(1, len(shots) + 1)},
    )
    for key in columns:
        if ITEM.sub("", key) in VOCABULARY:
            cases[key].attrs.update(quantity_attributes(key))
    names = "\n".join(
        " ".join(shot.name.split()) for shot in shots
    )  # arrays of a database file are numbers
    cases.attrs = {"source": f"check data of {Path(model.file).name}", "names": names}
    return cases


def _is_known(model: DaveModel, shot: Shot) -> bool:
    """Whether the file has the variables of a check case, in units that can be converted; one that
    has not was ignored on demand.
    """
    try:
        return all(model.converted(signal) for signal in (*shot.inputs, *shot.outputs))
    except (UnknownName, UnitError):
        return False


def _case(
    model: DaveModel, shot: Shot, mine: Mapping[str, str], back: Mapping[str, str]
) -> dict[str, float]:
    row: dict[str, float] = {}
    initial = {v: model.variables[v].initial for v in mine}
    given = {model.signal(signal).varID: model.converted(signal).value for signal in shot.inputs}
    for varID, value in {**{v: i for v, i in initial.items() if i is not None}, **given}.items():
        if varID in mine:
            factor, offset = file_unit_conversion(model.variables[varID], mine[varID])
            row[mine[varID]] = (value - offset) / factor
    for signal in shot.outputs:
        variable = model.signal(signal)
        quantity = back.get(variable.varID)
        if quantity is not None:
            due, (factor, offset) = (
                model.converted(signal),
                file_unit_conversion(variable, quantity),
            )
            row[quantity] = (due.value - offset) / factor
            row[f"{quantity}_tolerance"] = abs(due.tolerance / factor)
    return row
