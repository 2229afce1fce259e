"""Products of tables and variables to term leaves with the names of the vocabulary."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.vocabulary import source_codes, unpack_attributes
from flightmech.aircraft.controls import DEVICE
from flightmech.names import lookup, quantity_attributes
from flightmech.terms import MAX_AXES, MAX_REGRESSORS, SOURCES, make_term

# what a regressor makes of a contribution's name; others keep their own
_WORDS = {
    "delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder", "delta_f": "flap", "delta_t": "tab", "delta_ta": "tab_aileron",
    "delta_tr": "tab_rudder", "delta_s": "spoiler", "delta_d": "differential_tail", "dnz": "load_factor", "CT": "power", "h_agl": "ground",
}  # fmt: skip
_FLOW = {"alpha", "beta", "mach", "h"}
_SPAN = {
    "rad": math.pi,
    "m s-1": 1000.0,
    "m": 1e5,
    "Pa": 1e6,
}  # half width of a table that stands for its variable
_TABLES = 1 + 2  # value, K1, K2


@dataclass(frozen=True)
class CoefficientPart:
    """A part of a coefficient: its sum, the name the file gives it or ``""``, the order of its
    factors, and what is noted about it.
    """

    name: str
    sum: Sum
    order: tuple[str, ...] = ()
    texts: Mapping[str, str | float] = field(default_factory=dict)


def parts_of(
    model: DaveModel, coefficient: str, varID: str, sums: Mapping[str, Sum]
) -> list[CoefficientPart]:
    """Return a coefficient as its parts: the summands that the file names ``CL/flap`` each by
    itself, or one part without a name.
    """
    calculation = model.variables[varID].calculation
    summands = _summands(calculation)
    pattern = re.compile(rf"{coefficient}/([A-Za-z][A-Za-z0-9_]*)")
    found = [pattern.fullmatch(model.variables[name].name) for name in summands]
    if not summands or not all(found):
        return [CoefficientPart("", sums[varID])]
    return [
        CoefficientPart(
            match[1],
            sums[name],
            _factors(model, name, sums),
            unpack_attributes(model.variables[name].description),
        )
        for match, name in zip(found, summands, strict=True)
        if match is not None
    ]


def _summands(calculation: mathml.Expression | None) -> list[str]:
    if isinstance(calculation, mathml.Name):
        return [calculation.varID]
    if isinstance(calculation, mathml.Apply) and calculation.operator == "plus":
        names = [
            argument.varID
            for argument in calculation.arguments
            if isinstance(argument, mathml.Name)
        ]
        return names if len(names) == len(calculation.arguments) else []
    return []


def _factors(model: DaveModel, varID: str, sums: Mapping[str, Sum]) -> tuple[str, ...]:
    """Return the variables that multiply a term, in the order of the file."""
    calculation = model.variables[varID].calculation
    if not isinstance(calculation, mathml.Apply) or calculation.operator != "times":
        return ()
    factors = [
        sums[argument.varID]
        for argument in calculation.arguments
        if isinstance(argument, mathml.Name)
    ]
    powers = [next(iter(factor.products), ((), ()))[1] for factor in factors]
    return tuple(power[0][0] for power in powers if len(power) == 1)


Factors = tuple[list[MultilinearTable], dict[str, int]]
"""Tables of a product, and the powers of its variables."""


Join = Callable[[list[MultilinearTable], Mapping[str, int], float], Iterator[Factors]]


def leaves_from_parts(
    model: DaveModel, coefficient: str, parts: Sequence[CoefficientPart], join: Join | None = None
) -> dict[str, xr.Dataset]:
    """Return the terms of a coefficient by name.

    Parameters
    ----------
    join : callable, optional
        Yields a product that is no term with some of its factors on one table, in the order in
        which to try; without it such a product is refused.

    Raises
    ------
    Inexact
        A product that is no term: more factors than a term has, two tables of one variable, a
        division by a variable.
    """
    leaves: dict[str, xr.Dataset] = {}
    for part in parts:
        products = part.sum.products or {
            ((), ()): 0.0
        }  # a coefficient that is zero is a statement too
        for (grids, powers), factor in products.items():
            leaf = _leaf_or_joined(model, list(grids), dict(powers), factor, part, join)
            name = _unused(
                part.name or _name(leaf), [grid.label for grid in grids], leaves, coefficient
            )
            leaves[f"{coefficient}/{name}"] = leaf
    return leaves


def _leaf_or_joined(
    model: DaveModel,
    grids: list[MultilinearTable],
    powers: dict[str, int],
    factor: float,
    part: CoefficientPart,
    join: Join | None,
) -> xr.Dataset:
    try:
        return _leaf(model, grids, powers, factor, part)
    except Inexact as error:
        reason = error
    for fewer, rest in join(grids, powers, factor) if join is not None else ():
        try:
            return _leaf(model, fewer, rest, factor, part)
        except Inexact as error:
            reason = error
    raise reason


def _leaf(
    model: DaveModel,
    grids: list[MultilinearTable],
    powers: Mapping[str, int],
    factor: float,
    part: CoefficientPart,
) -> xr.Dataset:
    labels = [grid.label for grid in grids if grid.label in model.functions]
    notes = [grid.note for grid in grids if grid.note]
    words = _regressors(powers, part.order)
    tables, words = _tables(grids, words, named=bool(part.name))
    _demand_disjoint(tables)
    outside, tables = unify_rules(tables)
    value, *factors = tables or [MultilinearTable((), np.ones(()))]
    texts = dict(part.texts) if part.name else _texts(model, labels)
    source = str(texts.pop("source", ""))
    leaf = make_term(
        factor * value.values if factor != 1.0 else value.values,
        {axis.variable: axis.points for axis in value.axes},
        words,
        stderr=None if value.stderr is None else abs(factor) * value.stderr,
        outside=outside,
        **{f"K{i}": _array(grid) for i, grid in enumerate(factors, 1)},  # type: ignore[arg-type]
    )
    flags = source_codes(source, value.values.shape) if source else None
    if flags is not None:
        leaf["source"] = (
            leaf["value"].dims,
            flags,
            {"flag_values": "0 1 2", "flag_meanings": " ".join(SOURCES)},
        )
    leaf.attrs |= texts
    if notes:
        leaf.attrs["sampled"] = "; ".join(notes)
    return leaf


def _regressors(powers: Mapping[str, int], order: Sequence[str]) -> list[str]:
    words = []
    for name, power in powers.items():
        if power < 0:
            raise Inexact(f"it divides by {name}")
        words += [name] * power
    return sorted(words, key=lambda word: order.index(word) if word in order else len(order))


def _tables(
    grids: list[MultilinearTable], words: list[str], named: bool
) -> tuple[list[MultilinearTable], list[str]]:
    """Return at most three tables and two regressors for a product: what is too much becomes
    tables, or one table of several.
    """
    if not named:
        grids = _without_scalars(grids)
    taken = {name for grid in grids for name in grid.variables}
    for word in dict.fromkeys(words):
        if len(words) > MAX_REGRESSORS and word not in taken:
            words.remove(word)
            grids = [*grids, _identity(word)]
    if len(words) > MAX_REGRESSORS:
        raise Inexact(
            f"it is a product of {' '.join(words)}; a term has at most {MAX_REGRESSORS} such "
            f"factors"
        )
    _demand_disjoint(grids)
    while len(grids) > _TABLES:
        a, b, *rest = sorted(grids, key=lambda grid: len(grid.axes))
        if len(a.axes) + len(b.axes) > MAX_AXES:
            raise Inexact(f"it multiplies {len(grids)} tables; a term has at most {_TABLES}")
        grids = [
            *rest,
            MultilinearTable(
                (*a.axes, *b.axes), np.multiply.outer(a.values, b.values), None, a.label
            ),
        ]
    for grid in grids:
        if len(grid.axes) > MAX_AXES:
            raise Inexact(
                f"the table {grid.label} has {len(grid.axes)} axes; a term has at most {MAX_AXES}"
            )
    return grids, words


def _without_scalars(grids: list[MultilinearTable]) -> list[MultilinearTable]:
    """Multiply uncertain constants into the first table, or into the first of themselves; standard
    errors to first order.
    """
    tables, scalars = (
        [grid for grid in grids if grid.axes],
        [grid for grid in grids if not grid.axes],
    )
    if not tables:
        tables, scalars = scalars[:1], scalars[1:]
    for scalar in scalars:
        first, c = tables[0], float(scalar.values)
        spread = [np.zeros(()) if grid.stderr is None else grid.stderr for grid in (first, scalar)]
        stderr = np.hypot(c * spread[0], first.values * spread[1])
        tables[0] = MultilinearTable(
            first.axes, c * first.values, stderr, first.label, first.serial
        )
    return tables


def _identity(name: str) -> MultilinearTable:
    """Return the table that gives its variable."""
    span = _SPAN.get(lookup(name).units, 10.0)
    points = np.array([-span, span])
    return MultilinearTable((GridAxis(name, points, True, True),), points.copy())


def _demand_disjoint(grids: Sequence[MultilinearTable]) -> None:
    seen: dict[str, MultilinearTable] = {}
    for grid in grids:
        for name in grid.variables:
            if name in seen:
                raise Inexact(
                    f"it multiplies two tables of {name}, {seen[name].label} and {grid.label}"
                )
            seen[name] = grid


def unify_rules(tables: Sequence[MultilinearTable]) -> tuple[str, list[MultilinearTable]]:
    """Return the rule of the leaf, and its tables so that it holds for all axes: where some go on,
    held ends get a flat piece.
    """
    ends = {
        end
        for grid in tables
        for axis in grid.axes
        if len(axis.points) > 1
        for end in (axis.open_low, axis.open_high)
    }
    if True not in ends:
        return "hold", list(tables)
    if False in ends:
        for index, grid in enumerate(tables):
            for number, axis in enumerate(grid.axes):
                if not (axis.open_low and axis.open_high):
                    grid = grid.opened(number)
            tables = [*tables[:index], grid, *tables[index + 1 :]]
    return "linear", list(tables)


def _array(grid: MultilinearTable) -> xr.DataArray:
    array = xr.DataArray(
        grid.values, {axis.variable: axis.points for axis in grid.axes}, grid.variables
    )
    for name in grid.variables:
        array[name].attrs.update(quantity_attributes(name))
    return array


def _texts(model: DaveModel, labels: Sequence[str]) -> dict[str, str | float]:
    """Return references and comment of a term made from functions of a foreign file."""
    functions = [model.functions[label] for label in labels]
    file = Path(model.file).name
    references = [
        f"{file}, line {f.line}: function {f.name}"
        + _cited(f.provenance.references if f.provenance else ())
        for f in functions
    ]
    comments = [" ".join(f.description.split()) for f in functions if f.description]
    return {"references": "; ".join(references) or file, "comment": "; ".join(comments)}


def _cited(references: Sequence[str]) -> str:
    return f" ({', '.join(references)})" if references else ""


def _name(leaf: xr.Dataset) -> str:
    """Return the contribution that a term without a name is, after its regressors, or else its
    axes.
    """
    words = str(leaf.attrs["regressors"]).split()
    if words:
        return "_".join(_word(word) for word in words)
    axes = [str(axis) for axis in leaf.dims]
    other = [axis for axis in axes if axis not in _FLOW]
    if not axes or (set(axes) & {"alpha", "beta"}):
        return "basic"
    return _word(other[0]) if other else "basic"


def _word(variable: str) -> str:
    """Return what a variable calls a contribution: the word of the field, the name of a device,
    else its own.
    """
    return _WORDS.get(variable, variable.split(".")[1] if variable.startswith(DEVICE) else variable)


def _unused(
    name: str, labels: Sequence[str], leaves: Mapping[str, xr.Dataset], coefficient: str
) -> str:
    """Return the name, or the name with the varID of a table or a number behind it."""
    tails = [
        "",
        *("_" + re.sub("[^A-Za-z0-9_]", "_", label) for label in labels if label),
        *(f"_{i}" for i in range(2, len(leaves) + 3)),
    ]
    return next(name + tail for tail in tails if f"{coefficient}/{name}{tail}" not in leaves)
