"""Check cases of an exported file: states, what each term gives there, what the coefficients are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.names import lookup
from flightmech.support.input_files.tree_files import CHECKS

from ....store.evaluation import contributions
from ....store.schema import FORCE_AXES, terms
from .. import sample_states
from ..conventions import STORED
from ..document.unit_codes import code_of
from .markup import element

_TOLERANCE = 1e-9  # of the largest contribution: a wrong digit of a table shows, another order of summation does not
_LEAST = 1e-12
SIZES = ("S", "cbar", "b")


@dataclass(frozen=True)
class Case:
    """One check case: inputs and coefficients in SI, contributions by term, tolerance by coefficient."""

    name: str
    inputs: Mapping[str, float]
    internal: Mapping[str, float]
    outputs: Mapping[str, tuple[float, float]]


def totals(db: xr.DataTree) -> list[str]:
    """Return the coefficients of an exported file: those of the database, in its order, then those of its force axes that it has not."""
    return list(dict.fromkeys([*(name.split("/")[0] for name in terms(db)), *FORCE_AXES[str(db.attrs["force_axes"])]]))


def drawn_cases(db: xr.DataTree, count: int, limits: Mapping[str, tuple[float, float]]) -> list[Case]:
    """Return check cases spread over the tables, every second one to 15 % beyond them."""
    leaves = list(terms(db).values())
    inside = sample_states.draw(leaves, count, 0.0, limits)
    beyond = sample_states.draw(leaves, count, sample_states.BEYOND, limits)
    states = {name: np.where(np.arange(count) % 2, beyond[name], inside[name]) for name in inside}
    names = [f"{i + 1:02d} {'inside or beyond' if i % 2 else 'inside'} the tables" for i in range(count)]
    return _cases(db, names, sample_states.with_rates(states, _lengths(db)))


def stored_cases(db: xr.DataTree) -> list[Case]:
    """Return the cases in ``/checks`` that hold all inputs, with the expected values and tolerances that stand there.

    A case that the database does not meet (any more) is left out.
    """
    if CHECKS not in db.children:
        return []
    table = db.children[CHECKS].to_dataset(inherit=False)
    needed = sample_states.needed_inputs(terms(db).values())
    if "case" not in table.dims or not all(name in table and table[name].dims == ("case",) for name in needed):
        return []
    states = {str(name): table[name].values.astype(float) for name in table.data_vars if table[name].dims == ("case",)}
    if any(name in sample_states.REDUCED and not {"V", sample_states.REDUCED[name][0]} <= set(states) for name in needed):
        return []
    names = str(table.attrs.get("names", "")).split("\n")
    if len(names) != table.sizes["case"]:
        names = [str(number) for number in range(1, table.sizes["case"] + 1)]
    made = _cases(db, [STORED + name for name in names], states)
    return [case for i, one in enumerate(made) if (case := _as_stored(one, table, i)) is not None]


def shot_lines(case: Case, term_ids: Mapping[str, str], inputs: Sequence[str]) -> list[str]:
    """Return a staticShot element as lines."""
    given = [line for name in inputs for line in _signal(_labels(name), case.inputs[name])]
    internal = [line for name, value in case.internal.items() for line in _signal({"varID": term_ids[name]}, value)]
    found = [line for name, (value, tolerance) in case.outputs.items() for line in _signal(_labels(name), value, tolerance)]
    inside = [*(element("checkInputs", {}, given) if given else []), *element("internalValues", {}, internal)]
    return element("staticShot", {"name": case.name}, [*inside, *element("checkOutputs", {}, found)])


def _lengths(db: xr.DataTree) -> dict[str, float]:
    return {name: float(db.attrs[name]) for name in ("cbar", "b")}


def _cases(db: xr.DataTree, names: Sequence[str], states: Mapping[str, np.ndarray]) -> list[Case]:
    parts = {c: contributions(db, c, sample_states.with_reduced(states, _lengths(db)), outside="clamp") for c in totals(db)}
    sizes = {name: (float(db.attrs[name]), _tolerance([float(db.attrs[name])])) for name in SIZES}
    whole = np.zeros(len(names))
    cases = []
    for i, name in enumerate(names):
        each = {c: {term: float((whole + value)[i]) for term, value in found.items()} for c, found in parts.items()}
        internal = {f"{c}/{term}": value for c, found in each.items() for term, value in found.items()}
        outputs = sizes | {c: (sum(found.values()), _tolerance(found.values())) for c, found in each.items()}
        cases.append(Case(name, {key: float((whole + value)[i]) for key, value in states.items()}, internal, outputs))
    return cases


def _tolerance(parts: Iterable[float]) -> float:
    return max(_TOLERANCE * max(map(abs, parts), default=0.0), _LEAST)


def _as_stored(case: Case, table: xr.Dataset, index: int) -> Case | None:
    """Return a case with the values of ``/checks``, or None when an input is missing or a value is not met."""
    if not np.isfinite(list(case.inputs.values())).all():
        return None
    outputs = dict(case.outputs)
    for name, (value, tolerance) in case.outputs.items():
        if name not in table:
            continue
        expected = float(table[name].values[index])
        allowed = float(table[f"{name}_tolerance"].values[index]) if f"{name}_tolerance" in table else tolerance
        if not abs(value - expected) <= allowed:
            return None
        outputs[name] = expected, allowed
    return Case(case.name, case.inputs, case.internal, outputs)


def standard_name(quantity: str) -> str:
    """Return the S-119 name of a quantity, or ``""``; that of one engine among several has none."""
    row = lookup(quantity)
    return row.s119 if row.name == quantity else ""


def _labels(quantity: str) -> dict[str, str]:
    return {"signalName": standard_name(quantity) or quantity, "signalUnits": code_of(lookup(quantity).units)}


def _signal(labels: Mapping[str, str], value: float, tolerance: float | None = None) -> list[str]:
    inside = [line for tag, content in labels.items() for line in element(tag, {}, content)]
    inside += element("signalValue", {}, repr(value))
    inside += [] if tolerance is None else element("tol", {}, f"{tolerance:.2g}")
    return element("signal", {}, inside)
