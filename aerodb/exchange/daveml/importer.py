"""Import of a DAVE-ML aerodynamic model: build-up equations to terms of a database."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Unpack

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import polynomials
from aerodb.exchange.daveml.approximation import approximate_variable
from aerodb.exchange.daveml.document.elements import DaveReference
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.expansion import expand_variables
from aerodb.exchange.daveml.import_checks import (
    SAMPLED_STATES,
    compare_with_model,
    convert_check_cases,
)
from aerodb.exchange.daveml.imported_model import (
    REFERENCE_LENGTHS,
    REFERENCE_POINT,
    ImportedModel,
    StatedLengths,
    apply_user_names,
    fix_inputs,
    identify_coefficients,
    identify_inputs,
    input_sums,
    is_own_file,
    read_reference_quantities,
)
from aerodb.exchange.daveml.sampler import Sampler
from aerodb.exchange.daveml.terms import CoefficientPart, leaves_from_parts, parts_of
from aerodb.exchange.daveml.vocabulary import file_unit_conversion, quantity_of, unpack_attributes
from aerodb.exchange.spelling import spell
from aerodb.store.schema import FORCE_AXES, make_database
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.support.array_files.netcdf_trees import CHECKS
from flightmech.terms import list_model_variables

_ATTEMPTS = 4  # refinements of the sampling before the import fails


def import_daveml(
    path: str | os.PathLike[str],
    names: Mapping[str, str] | None = None,
    *,
    at: Mapping[str, float] | None = None,
    force_axes: str | None = None,
    without: Collection[str] = (),
    checks: str = "raise",
    sample: float | None = None,
    grid: Mapping[str, Sequence[float]] | None = None,
    **reference: Unpack[StatedLengths],
) -> xr.DataTree:
    """Read the aerodynamic model of a DAVE-ML file as a database.

    Tables become tables, and calculations are multiplied out into *table x table x variables*.
    Angles become radians, lengths metres, ``p b / 2V`` the reduced rate ``phat``.  A look-up over
    the absolute value or a limited value of a variable becomes a table over the variable.  So does
    a table whose sign follows the sign of an axis.  The result equals the model except for
    rounding.  It is compared with the model at 500 states, inside the tables and beyond, before it
    is returned.

    Parameters
    ----------
    path : path
        The file.
    names : mapping of str to str, optional
        Quantity of the vocabulary by varID or name, for variables without a name of S-119:
        ``{"DEFL": "delta_e"}``.  An S-119 unit in brackets replaces the unit of the file:
        ``{"ALPHA_TOT_D": "alpha [deg]"}``.  An angle or pure number without a quantity is an input
        of the model by its varID, ``device.DBFLL.deflection`` or ``device.SPIKE.setting``.
    at : mapping of str to float, optional
        Inputs that are fixed, by varID or name: ``{"H_RWY": 1000.0}``.  The history states them.
        [unit of the file]
    force_axes : {"stability", "wind", "body"}, optional
        Axes of the forces.  By default they follow from the coefficients of the file.  Lift and
        drag are in stability axes unless the file states wind axes.
    without : collection of str
        Coefficients to leave out, because they have no exact terms: ``("CD",)``.
    checks : {"raise", "ignore"}
        Action on a check case of the file that fails.
    sample : float, optional
        Largest difference of a coefficient if functions that are not a product of tables are
        sampled on tables.  Without it such coefficients are refused.  [1]
    grid : mapping of str to sequence of float, optional
        Sampling points by quantity: two numbers, the range, or more, the breakpoints.  Without an
        entry the range is that of the tables over the quantity, inside the limits of the input,
        and breakpoints are added until the difference is at most `sample`. [SI]
    S, cbar, b : float, optional
        Reference area [m2], chord and span [m] of a file that does not state them.

    Returns
    -------
    DataTree
        Moments about the reference point of the file.  ``/checks`` holds its check cases in SI.
        The attribute ``sampled`` of a term states the accuracy of a sampled table.  The history
        states the difference of each coefficient at 5000 states.

    Raises
    ------
    ParseError, SchemaError
        As `read`.  SchemaError also lists every variable that has no exact terms with the reason,
        and reference quantities that are missing or differ.
    UnknownName
        A variable of `names` that the file does not have, a quantity that the vocabulary does not
        have, or another keyword than S, cbar and b.

    Warns
    -----
    AeromatchWarning
        Inputs are not in the vocabulary and became inputs of the model by their varID.
    """
    # Identify inputs, reference quantities and coefficients, and multiply the calculations out.
    for name in reference:
        if name not in REFERENCE_LENGTHS:
            raise UnknownName(name, REFERENCE_LENGTHS, "keyword of import_daveml")
    path = Path(path)
    model, names = apply_user_names(read(path, checks), names or {})
    model, fixed = fix_inputs(model, at or {})
    quantities = identify_inputs(model, names)
    geometry = read_reference_quantities(model, reference)
    sums, reasons = expand_variables(model, input_sums(model, quantities), geometry)
    outputs, axes = identify_coefficients(model, names, force_axes, without)
    source = ImportedModel(model, quantities, outputs, geometry, sums=sums, reasons=reasons)
    if sample is None and grid:
        raise ValueError(
            "grid= states where functions are sampled; give sample=, the largest difference "
            "allowed, with it"
        )

    def make_tree(leaves: dict[str, xr.Dataset]) -> xr.DataTree:
        return make_database(leaves, **_root_attributes(source, path, axes))

    if sample is None:
        leaves, history = _build_terms(source, None), list[str]()
        compare_with_model(make_tree(leaves), source, {}, 0.0)
    else:
        leaves, history = _sample_terms(source, make_tree, sample, grid or {})
    if fixed:
        history.insert(0, f"inputs that are fixed: {fixed}")
    # The attributes need the terms: they list unnamed inputs and the accuracy of the sampling.
    remark = _warn_unnamed_inputs(model, quantities, names, leaves)
    root = _root_attributes(source, path, axes, remark=remark, history=history)
    db = make_database(leaves, **root)
    cases = convert_check_cases(source)
    if cases is None:
        return db
    return xr.DataTree.from_dict({**db.to_dict(), f"/{CHECKS}": cases})


def _build_terms(source: ImportedModel, sampler: Sampler | None) -> dict[str, xr.Dataset]:
    """Return the terms of all coefficients by name, or raise with every inexact coefficient."""
    leaves: dict[str, xr.Dataset] = {}
    problems = []
    for coefficient, varID in source.outputs.items():
        try:
            leaves |= _coefficient_terms(source, coefficient, varID, sampler)
        except polynomials.Inexact as error:
            name = source.model.variables[varID].name
            problems.append(f"{coefficient}: {varID} ({name}): {error}")
    if problems:
        remedy = (
            f"leave them out with {spell('without=', '--without')}, or evaluate the model itself "
            f"with aerodb.exchange.daveml.read(path).evaluate"
        )
        if sampler is None:
            remedy = f"put them onto tables with {spell('sample=', '--sample')}, {remedy}"
        raise SchemaError(
            f"{Path(source.model.file).name} holds coefficients that are not an exact sum of "
            f"terms; {remedy}",
            problems,
        )
    return leaves


def _sample_terms(
    source: ImportedModel,
    make_tree: Callable[[dict[str, xr.Dataset]], xr.DataTree],
    sample: float,
    grid: Mapping[str, Sequence[float]],
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the terms with sampled tables, and a line of history for each sampled coefficient."""
    if not sample > 0.0:
        raise ValueError(
            f"sample is {sample!r}; give the largest difference of a coefficient, such as 1e-4"
        )
    # The bound applies to one function along all its axes. The difference of a coefficient is
    # measured, and the bound is reduced until the difference is at most `sample`.
    bound = 2.0 * sample
    for attempt in range(_ATTEMPTS):
        sampler = Sampler(source.model, source.quantities, source.sums, bound, grid=grid)
        leaves = _build_terms(source, sampler)
        # Only the last attempt raises if the difference is too large.
        allowed = np.inf if attempt + 1 < _ATTEMPTS else sample
        differences = compare_with_model(make_tree(leaves), source, sampler.ranges(), allowed)
        worst = max(differences.values(), default=0.0)
        if worst <= sample:
            break
        # The difference grows with the bound. The factor 0.5 is a margin.
        bound *= 0.5 * sample / worst
    box = ", ".join(f"{name} {low:.6g} ... {high:.6g}" for name, (low, high) in sampler.box.items())
    history = []
    for name, difference in differences.items():
        history.append(
            f"{name} differs from the file by at most {difference:.2g} at {SAMPLED_STATES} states, "
            f"allowed {sample:g}; sampled over {box} (SI)"
        )
    return leaves, history


def _coefficient_terms(
    source: ImportedModel, coefficient: str, varID: str, sampler: Sampler | None
) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient by name."""
    model, sums, join = source.model, source.sums, None
    factor, offset = file_unit_conversion(model.variables[varID], coefficient)
    if sampler is not None:
        approximate_variable(sampler, varID, source.reasons, lengths=source.geometry)
        sums, join = sampler.sums, sampler.joined
    # Without sampling only exact sums are accepted.
    if varID not in sums:
        raise polynomials.Inexact(source.reasons[varID])
    parts = parts_of(model, coefficient, varID, sums)
    if factor != 1.0 or offset != 0.0:
        # The output is in the unit or the sense of the file. The terms are in SI.
        scaled_parts = []
        for part in parts:
            scaled = polynomials.scale_sum(part.sum, 1.0 / factor)
            scaled_parts.append(CoefficientPart(part.name, scaled, part.order, part.texts))
        parts = scaled_parts
    return leaves_from_parts(model, coefficient, parts, join)


def _warn_unnamed_inputs(
    model: DaveModel,
    quantities: Mapping[str, str],
    names: Mapping[str, str],
    leaves: Mapping[str, xr.Dataset],
) -> str:
    """Warn of inputs without a quantity; return the warning as a remark, or ``""``."""
    # An input that no term uses needs no quantity.
    used = set().union(*(list_model_variables(leaf) for leaf in leaves.values()))
    unnamed = []
    for varID, name in quantities.items():
        if name in used and varID not in names and not quantity_of(model.variables[varID]):
            unnamed.append(f"{varID} is {name}")
    if not unnamed:
        return ""
    text = f"inputs that are not a quantity of the vocabulary: {', '.join(unnamed)}"
    warnings.warn(
        f"{text}; give a quantity with {spell('names=', '--names')} if one of them is meant",
        AeromatchWarning,
        stacklevel=3,
    )
    return text


def _root_attributes(
    source: ImportedModel,
    path: Path,
    axes: str,
    *,
    remark: str = "",
    history: Sequence[str] = (),
) -> dict[str, str | float]:
    """Return the attributes of the root of the database."""
    model, header = source.model, source.model.header
    if is_own_file(model):
        # The description of an exported file holds the attributes of the original database.
        attributes = unpack_attributes(header.description)
        modifications = [entry.description for entry in header.modifications]
    else:
        attributes = _attributes_of_header(source, path, axes, remark)
        modifications = _modification_lines(model)
    line = _import_line(model, path)
    attributes["history"] = "\n".join(filter(None, [*modifications, line, *history]))
    return {
        **attributes,
        **dict.fromkeys(REFERENCE_POINT, 0.0),
        **source.geometry,
        "force_axes": axes,
    }


def _attributes_of_header(
    source: ImportedModel, path: Path, axes: str, remark: str
) -> dict[str, str | float]:
    """Return title, source, references and comment from the header of the file."""
    model, header = source.model, source.model.header
    # A coefficient of the force axes without terms is declared absent.
    missing = [name for name in FORCE_AXES[axes] if name not in source.outputs]
    return {
        "title": header.name or path.stem,
        "aircraft": header.name or path.stem,
        "source": f"DAVE-ML file {path.name}",
        "references": "; ".join(_cite_reference(reference) for reference in header.references),
        "comment": "\n".join(filter(None, [header.description, *_remarks(model), remark])),
        "absent": " ".join(f"{name}/basic" for name in missing),
    }


def _import_line(model: DaveModel, path: Path) -> str:
    """Return the line of history that states the file and the result of its check cases."""
    values = model.check()
    result = "all met"
    if not values["passed"].all():
        result = f"{int((~values['passed']).sum())} NOT met"
    return (
        f"import_daveml: {path.name}, version {model.header.version or 'unnamed'}, "
        f"{len(model.shots)} check cases with {len(values)} values, {result}"
    )


def _cite_reference(reference: DaveReference) -> str:
    # A semicolon separates the references, so a part must not contain one.
    parts = (reference.author, reference.title, reference.accession, reference.date)
    return ", ".join(part.replace(";", ",") for part in parts if part)


def _modification_lines(model: DaveModel) -> list[str]:
    lines = []
    for entry in model.header.modifications:
        text = f"{entry.date} modification {entry.modID}: {entry.description}"
        lines.append(" ".join(text.split()))
    return lines


def _remarks(model: DaveModel) -> list[str]:
    """Return the remarks on the file for the reader of the database."""
    remarks = []
    for variable in model.variables.values():
        is_limited = np.isfinite((variable.low, variable.high)).any()
        if quantity_of(variable) == "V" and variable.varID in model.inputs and is_limited:
            remarks.append(
                f"{variable.varID} is limited to {variable.low:g} ... {variable.high:g} "
                f"{variable.units} in the file; the reduced rates of the database have no such "
                f"limit"
            )
    return [*remarks, *model.notes]
