"""Check cases of an exported DAVE-ML file: states, contributions of the terms, coefficients."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import xarray as xr

from aerodb.exchange.daveml.document.units import code_of
from aerodb.exchange.daveml.vocabulary import STORED, replace_illegal_characters
from aerodb.store.evaluation import contributions
from aerodb.store.schema import FORCE_AXES, terms
from flightmech.errors import AeromatchWarning
from flightmech.names import REDUCED_RATES, lookup
from flightmech.support.array_files.netcdf_trees import CHECKS
from flightmech.terms import list_model_variables

_STEP = "  "  # indentation of the children of an element
_ROW = 8  # numbers in a line


def element_lines(
    tag: str, attributes: Mapping[str, str] | None = None, inside: Sequence[str] | str | None = None
) -> list[str]:
    """Return an element as lines; `inside` is its text, or the lines of its children."""
    head = tag
    for key, text in (attributes or {}).items():
        if text != "":
            head += f" {key}={quoteattr(replace_illegal_characters(text))}"
    if inside is None or len(inside) == 0:
        return [f"<{head}/>"]
    if isinstance(inside, str):
        return [f"<{head}>{escape(replace_illegal_characters(inside))}</{tag}>"]
    return [f"<{head}>", *(_STEP + line for line in inside), f"</{tag}>"]


def text_element_lines(tag: str, content: str) -> list[str]:
    """Return an element with lines of text at the margin, or no line for an empty text."""
    if not content.strip():
        return []
    return [f"<{tag}>", *escape(replace_illegal_characters(content)).split("\n"), f"</{tag}>"]


def number_lines(values: np.ndarray) -> list[str]:
    """Return an array as lines of exact, comma-separated numbers in C order, row by row."""
    rows = values.reshape(-1, values.shape[-1] if values.ndim else 1).tolist()
    lines = []
    for row in rows:
        for start in range(0, len(row), _ROW):
            lines.append(", ".join(map(repr, row[start : start + _ROW])))
    return [f"{line}," for line in lines[:-1]] + lines[-1:]


Limits = Mapping[str, tuple[float, float]]
SEED = 119  # of S-119
BEYOND = 0.15  # share of the range of a table by which states lie beyond it, on either side
_AIRSPEED = (30.0, 250.0)  # m/s
# Ranges of variables that are not an axis of any table, by name, then by unit. [SI]
_RANGES = {
    "phat": (-0.06, 0.06), "qhat": (-0.01, 0.01), "rhat": (-0.04, 0.04),
    "alphadothat": (-0.01, 0.01), "betadothat": (-0.02, 0.02),
    "p": (-1.5, 1.5), "q": (-0.4, 0.4), "r": (-0.4, 0.4), "gear": (0.0, 1.0),
    "speedbrake": (0.0, 1.0), "mach": (0.1, 0.8),
    "CT": (0.0, 0.2), "x_cg": (0.1, 0.4), "V": _AIRSPEED,
    "rad": (-0.3, 0.3), "m": (-1.0, 1.0), "Pa": (500.0, 20000.0), "m s-1": (-10.0, 10.0),
    "rad s-1": (-0.5, 0.5),
}  # fmt: skip
_OTHER_RANGE = (-1.0, 1.0)


def required_variables(leaves: Iterable[xr.Dataset]) -> list[str]:
    """Return the model variables of the terms, by name."""
    return sorted(set().union(*(list_model_variables(leaf) for leaf in leaves)))


def variable_ranges(leaves: Iterable[xr.Dataset], limits: Limits) -> dict[str, tuple[float, float]]:
    """Return the range (low, high) of each variable of the terms. [SI]

    It is the range of the control in `limits`, or the range that all tables over the variable have
    in common, or a usual range.
    """
    leaves = list(leaves)
    ranges: dict[str, tuple[float, float]] = {}
    for name in required_variables(leaves):
        ends = []
        for leaf in leaves:
            if name in leaf.dims and leaf.sizes[name] > 1:
                points = leaf[name].values
                ends.append((float(points[0]), float(points[-1])))
        if name in limits:
            ranges[name] = limits[name]
        elif ends:
            ranges[name] = max(low for low, _ in ends), min(high for _, high in ends)
        else:
            ranges[name] = _usual_range(name)
        low, high = ranges[name]
        # Tables without a common range: the range of all tables together.
        if low >= high and ends:
            ranges[name] = min(low for low, _ in ends), max(high for _, high in ends)
    return ranges


def _usual_range(name: str) -> tuple[float, float]:
    row = lookup(name)
    return _RANGES.get(row.name, _RANGES.get(row.units, _OTHER_RANGE))


def typical_size(name: str) -> float:
    """Return the usual largest size of a variable. [SI]"""
    return max(map(abs, _usual_range(name)))


def draw_check_states(
    leaves: Iterable[xr.Dataset], count: int, beyond: float, limits: Limits | None = None
) -> dict[str, np.ndarray]:
    """Return states (count,) by variable, a Latin hypercube over the ranges of the terms. [SI]

    `beyond` is the share of each range by which the hypercube is wider on either side.
    """
    random = np.random.default_rng(SEED)
    states = {}
    for name, (low, high) in variable_ranges(leaves, limits or {}).items():
        # One state in each of `count` equal intervals, in random order.
        shares = (random.permutation(count) + random.random(count)) / count
        margin = beyond * (high - low)
        states[name] = low - margin + shares * (high - low + 2.0 * margin)
    return states


def with_rates(
    states: Mapping[str, np.ndarray], lengths: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the states with true airspeed and the rates that belong to the reduced rates."""
    count = len(next(iter(states.values()), np.zeros(1)))
    random = np.random.default_rng(SEED + 1)
    V = states.get("V", random.uniform(*_AIRSPEED, count))
    completed = {**states, "V": V}
    # rate = 2 V / length * reduced rate
    for name, (rate, length) in REDUCED_RATES.items():
        if name in states:
            completed[rate] = 2.0 * V / lengths[length] * states[name]
    return completed


def with_reduced(
    states: Mapping[str, np.ndarray], lengths: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the states with the reduced rates that follow from rates and true airspeed."""
    completed = dict(states)
    for name, (rate, length) in REDUCED_RATES.items():
        if rate in states and "V" in states and length in lengths:
            completed[name] = states[rate] * lengths[length] / (2.0 * states["V"])
    return completed


# Tolerance relative to the largest contribution. A wrong digit of a table exceeds it, the rounding
# of another order of summation does not.
_TOLERANCE = 1e-9
_LEAST_TOLERANCE = 1e-12
SIZES = ("S", "cbar", "b")


@dataclass(frozen=True)
class CheckShot:
    """One check case.

    Parameters
    ----------
    name : str
        Name of the case.
    inputs : mapping of str to float
        Inputs by quantity. [SI]
    internal : mapping of str to float
        Contributions by term. [1]
    outputs : mapping of str to (float, float)
        Value and tolerance of each coefficient and reference size. [SI]
    """

    name: str
    inputs: Mapping[str, float]
    internal: Mapping[str, float]
    outputs: Mapping[str, tuple[float, float]]


def exported_coefficients(db: xr.DataTree) -> list[str]:
    """Return the coefficients of the database, then the missing ones of its force axes."""
    names = [name.split("/")[0] for name in terms(db)]
    names += FORCE_AXES[str(db.attrs["force_axes"])]
    return list(dict.fromkeys(names))


def draw_check_cases(
    db: xr.DataTree, count: int, limits: Mapping[str, tuple[float, float]]
) -> list[CheckShot]:
    """Return check cases spread over the tables, every second one to 15 % beyond them."""
    leaves = list(terms(db).values())
    inside = draw_check_states(leaves, count, 0.0, limits)
    beyond = draw_check_states(leaves, count, BEYOND, limits)
    is_beyond = np.arange(count) % 2
    states = {name: np.where(is_beyond, beyond[name], inside[name]) for name in inside}
    names = []
    for i in range(count):
        region = "inside or beyond" if is_beyond[i] else "inside"
        names.append(f"{i + 1:02d} {region} the tables")
    return _evaluate_cases(db, names, with_rates(states, _reference_lengths(db)))


def read_stored_cases(db: xr.DataTree) -> list[CheckShot]:
    """Return the cases of ``/checks`` with all inputs, with their expected values and tolerances.

    An expected value of NaN is not stated, so its case is written without it.

    Warns
    -----
    AeromatchWarning
        Cases that are left out: an input is missing, or the database does not meet the expected
        values.
    """
    if CHECKS not in db.children:
        return []
    table = db.children[CHECKS].to_dataset(inherit=False)
    required = required_variables(terms(db).values())
    if "case" not in table.dims:
        return []
    for name in required:
        if name not in table or table[name].dims != ("case",):
            return []
    states = {}
    for variable in table.data_vars:
        if table[variable].dims == ("case",):
            states[str(variable)] = table[variable].values.astype(float)
    # A reduced rate is written as rate and airspeed, so these must be stored with it.
    needed = set(required)
    for name in required:
        if name in REDUCED_RATES:
            needed |= {"V", REDUCED_RATES[name][0]}
    if not needed <= set(states):
        return []
    names = str(table.attrs.get("names", "")).split("\n")
    if len(names) != table.sizes["case"]:
        names = [str(number) for number in range(1, table.sizes["case"] + 1)]
    cases, without_input, not_met = [], [], []
    computed = _evaluate_cases(db, [STORED + name for name in names], states)
    for index, (name, case) in enumerate(zip(names, computed, strict=True)):
        if not all(np.isfinite(case.inputs[key]) for key in needed):
            without_input.append(name)
            continue
        stored = _with_stored_values(case, table, index)
        if stored is None:
            not_met.append(name)
        else:
            cases.append(stored)
    _warn_of_left_out(without_input, "an input is not a number")
    _warn_of_left_out(not_met, "the database does not meet their expected values")
    return cases


def _warn_of_left_out(names: Sequence[str], reason: str) -> None:
    if names:
        warnings.warn(
            f"DAVE-ML file: check cases of {CHECKS} left out because {reason}: {', '.join(names)}",
            AeromatchWarning,
            stacklevel=4,
        )


def shot_lines(case: CheckShot, term_ids: Mapping[str, str], inputs: Sequence[str]) -> list[str]:
    """Return a staticShot element as lines."""
    input_lines: list[str] = []
    for name in inputs:
        input_lines += _signal_lines(_signal_labels(name), case.inputs[name])
    internal_lines: list[str] = []
    for name, value in case.internal.items():
        internal_lines += _signal_lines({"varID": term_ids[name]}, value)
    output_lines: list[str] = []
    for name, (value, tolerance) in case.outputs.items():
        output_lines += _signal_lines(_signal_labels(name), value, tolerance)

    inside = []
    if input_lines:
        inside += element_lines("checkInputs", {}, input_lines)
    inside += element_lines("internalValues", {}, internal_lines)
    inside += element_lines("checkOutputs", {}, output_lines)
    return element_lines("staticShot", {"name": case.name}, inside)


def _reference_lengths(db: xr.DataTree) -> dict[str, float]:
    return {name: float(db.attrs[name]) for name in ("cbar", "b")}


def _evaluate_cases(
    db: xr.DataTree, names: Sequence[str], states: Mapping[str, np.ndarray]
) -> list[CheckShot]:
    """Return a check case with the values of the database for each state."""
    reduced_states = with_reduced(states, _reference_lengths(db))
    # The sum with zeros gives a value per case also for a term without variables.
    zeros = np.zeros(len(names))
    parts: dict[str, dict[str, np.ndarray]] = {}
    for coefficient in exported_coefficients(db):
        by_term = contributions(db, coefficient, reduced_states, outside="clamp")
        parts[coefficient] = {term: zeros + value for term, value in by_term.items()}
    inputs = {name: zeros + value for name, value in states.items()}
    sizes = {}
    for name in SIZES:
        size = float(db.attrs[name])
        sizes[name] = (size, _tolerance([size]))

    cases = []
    for i, name in enumerate(names):
        internal, outputs = {}, dict(sizes)
        for coefficient, by_term in parts.items():
            values = {term: float(value[i]) for term, value in by_term.items()}
            for term, value in values.items():
                internal[f"{coefficient}/{term}"] = value
            outputs[coefficient] = (sum(values.values()), _tolerance(values.values()))
        case_inputs = {key: float(value[i]) for key, value in inputs.items()}
        cases.append(CheckShot(name, case_inputs, internal, outputs))
    return cases


def _tolerance(parts: Iterable[float]) -> float:
    return max(_TOLERANCE * max(map(abs, parts), default=0.0), _LEAST_TOLERANCE)


def _with_stored_values(case: CheckShot, table: xr.Dataset, index: int) -> CheckShot | None:
    """Return a case with the values of ``/checks``, or None if it fails."""
    outputs = dict(case.outputs)
    for name, (value, tolerance) in case.outputs.items():
        if name not in table:
            continue
        expected = float(table[name].values[index])
        if np.isnan(expected):
            # The case does not state this value.
            del outputs[name]
            continue
        if f"{name}_tolerance" in table:
            tolerance = float(table[f"{name}_tolerance"].values[index])
        # The comparison is negated so that a NaN fails.
        if not abs(value - expected) <= tolerance:
            return None
        outputs[name] = expected, tolerance
    return CheckShot(case.name, case.inputs, case.internal, outputs)


def standard_name(quantity: str) -> str:
    """Return the S-119 name of a quantity, or ``""``; a quantity of one engine has none."""
    row = lookup(quantity)
    return row.s119 if row.name == quantity else ""


def _signal_labels(quantity: str) -> dict[str, str]:
    return {
        "signalName": standard_name(quantity) or quantity,
        "signalUnits": code_of(lookup(quantity).units),
    }


def _signal_lines(
    labels: Mapping[str, str], value: float, tolerance: float | None = None
) -> list[str]:
    inside: list[str] = []
    for tag, content in labels.items():
        inside += element_lines(tag, {}, content)
    inside += element_lines("signalValue", {}, repr(value))
    if tolerance is not None:
        inside += element_lines("tol", {}, f"{tolerance:.2g}")
    return element_lines("signal", {}, inside)
