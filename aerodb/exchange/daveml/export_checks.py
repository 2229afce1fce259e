"""Check cases of an exported file: states, what each term gives there, what the coefficients are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import xarray as xr

from aerodb.exchange.daveml.document.units import code_of
from aerodb.exchange.daveml.vocabulary import REDUCED, STORED, replace_illegal_characters
from aerodb.store.evaluation import contributions
from aerodb.store.schema import FORCE_AXES, terms
from flightmech.names import lookup
from flightmech.support.netcdf_trees import CHECKS
from flightmech.terms import list_model_variables

_STEP = "  "
_ROW = 8  # numbers in a line


def element_lines(
    tag: str, attributes: Mapping[str, str] | None = None, inside: Sequence[str] | str | None = None
) -> list[str]:
    """Return an element as lines; `inside` is its text, or the lines of its children."""
    head = tag + "".join(
        f" {key}={quoteattr(replace_illegal_characters(text))}"
        for key, text in (attributes or {}).items()
        if text != ""
    )
    if inside is None or len(inside) == 0:
        return [f"<{head}/>"]
    if isinstance(inside, str):
        return [f"<{head}>{escape(replace_illegal_characters(inside))}</{tag}>"]
    return [f"<{head}>", *(_STEP + line for line in inside), f"</{tag}>"]


def text_element_lines(tag: str, content: str) -> list[str]:
    """Return an element of several lines of text, each at the margin; nothing for no text."""
    return (
        [f"<{tag}>", *escape(replace_illegal_characters(content)).split("\n"), f"</{tag}>"]
        if content.strip()
        else []
    )


def number_lines(values: np.ndarray) -> list[str]:
    """Return an array as lines of comma-separated numbers in C order, a new line for each row;
    every number is exact.
    """
    rows = values.reshape(-1, values.shape[-1] if values.ndim else 1).tolist()
    lines = [row[i : i + _ROW] for row in rows for i in range(0, len(row), _ROW)]
    return [
        ", ".join(map(repr, line)) + ("," if i + 1 < len(lines) else "")
        for i, line in enumerate(lines)
    ]


Limits = Mapping[str, tuple[float, float]]
SEED = 119  # of S-119
BEYOND = 0.15  # of the range of a table, on either side
_AIRSPEED = (30.0, 250.0)  # m/s
_RANGES = {  # of what no table covers, by name, then by unit
    "phat": (-0.06, 0.06), "qhat": (-0.01, 0.01), "rhat": (-0.04, 0.04), "alphadothat": (-0.01, 0.01), "betadothat": (-0.02, 0.02),
    "p": (-1.5, 1.5), "q": (-0.4, 0.4), "r": (-0.4, 0.4), "gear": (0.0, 1.0), "speedbrake": (0.0, 1.0), "mach": (0.1, 0.8),
    "CT": (0.0, 0.2), "x_cg": (0.1, 0.4), "V": _AIRSPEED,
    "rad": (-0.3, 0.3), "m": (-1.0, 1.0), "Pa": (500.0, 20000.0), "m s-1": (-10.0, 10.0), "rad s-1": (-0.5, 0.5),
}  # fmt: skip


def required_variables(leaves: Iterable[xr.Dataset]) -> list[str]:
    """Return the model variables of the terms, by name."""
    return sorted(set().union(*(list_model_variables(leaf) for leaf in leaves)))


def variable_ranges(leaves: Iterable[xr.Dataset], limits: Limits) -> dict[str, tuple[float, float]]:
    """Return the range (low, high) of each variable: of the control, of the tables that have it as
    an axis, or a usual one. [SI]
    """
    leaves = list(leaves)
    found: dict[str, tuple[float, float]] = {}
    for name in required_variables(leaves):
        tables = [
            leaf[name].values for leaf in leaves if name in leaf.dims and leaf.sizes[name] > 1
        ]
        row = lookup(name)
        if name in limits:
            found[name] = limits[name]
        elif tables:
            found[name] = (
                float(max(points[0] for points in tables)),
                float(min(points[-1] for points in tables)),
            )
        else:
            found[name] = _RANGES.get(row.name, _RANGES.get(row.units, (-1.0, 1.0)))
        low, high = found[name]
        if low >= high and tables:  # tables that do not overlap: over all of them
            found[name] = (
                float(min(points[0] for points in tables)),
                float(max(points[-1] for points in tables)),
            )
    return found


def typical_size(name: str) -> float:
    """Return the usual largest size of a variable. [SI]"""
    row = lookup(name)
    return max(map(abs, _RANGES.get(row.name, _RANGES.get(row.units, (-1.0, 1.0)))))


def draw_check_states(
    leaves: Iterable[xr.Dataset], count: int, beyond: float, limits: Limits | None = None
) -> dict[str, np.ndarray]:
    """Return states (count,) by variable, a Latin hypercube over the ranges extended by a share of
    them. [SI]
    """
    random = np.random.default_rng(SEED)
    states = {}
    for name, (low, high) in variable_ranges(leaves, limits or {}).items():
        places = (random.permutation(count) + random.random(count)) / count
        margin = beyond * (high - low)
        states[name] = low - margin + places * (high - low + 2.0 * margin)
    return states


def with_rates(
    states: Mapping[str, np.ndarray], lengths: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the states with true airspeed and the rates that the reduced rates stand for."""
    count = len(next(iter(states.values()), np.zeros(1)))
    random = np.random.default_rng(SEED + 1)
    V = states.get("V", random.uniform(*_AIRSPEED, count))
    found = {**states, "V": V}
    for name, (rate, length) in REDUCED.items():
        if name in states:
            found[rate] = 2.0 * V / lengths[length] * states[name]
    return found


def with_reduced(
    states: Mapping[str, np.ndarray], lengths: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the states with the reduced rates that rates and true airspeed make."""
    made = {
        name: states[rate] * lengths[length] / (2.0 * states["V"])
        for name, (rate, length) in REDUCED.items()
        if rate in states and "V" in states and length in lengths
    }
    return {**states, **made}


# of the largest contribution: a wrong digit of a table shows, another order of summation does not
_TOLERANCE = 1e-9
_LEAST = 1e-12
SIZES = ("S", "cbar", "b")


@dataclass(frozen=True)
class CheckShot:
    """One check case: inputs and coefficients in SI, contributions by term, tolerance by
    coefficient.
    """

    name: str
    inputs: Mapping[str, float]
    internal: Mapping[str, float]
    outputs: Mapping[str, tuple[float, float]]


def exported_coefficients(db: xr.DataTree) -> list[str]:
    """Return the coefficients of an exported file: those of the database, in its order, then those
    of its force axes that it has not.
    """
    return list(
        dict.fromkeys(
            [*(name.split("/")[0] for name in terms(db)), *FORCE_AXES[str(db.attrs["force_axes"])]]
        )
    )


def draw_check_cases(
    db: xr.DataTree, count: int, limits: Mapping[str, tuple[float, float]]
) -> list[CheckShot]:
    """Return check cases spread over the tables, every second one to 15 % beyond them."""
    leaves = list(terms(db).values())
    inside = draw_check_states(leaves, count, 0.0, limits)
    beyond = draw_check_states(leaves, count, BEYOND, limits)
    states = {name: np.where(np.arange(count) % 2, beyond[name], inside[name]) for name in inside}
    names = [
        f"{i + 1:02d} {'inside or beyond' if i % 2 else 'inside'} the tables" for i in range(count)
    ]
    return _cases(db, names, with_rates(states, _lengths(db)))


def read_stored_cases(db: xr.DataTree) -> list[CheckShot]:
    """Return the cases in ``/checks`` that hold all inputs, with the expected values and tolerances
    that stand there.

    A case that the database does not meet (any more) is left out.
    """
    if CHECKS not in db.children:
        return []
    table = db.children[CHECKS].to_dataset(inherit=False)
    needed = required_variables(terms(db).values())
    if "case" not in table.dims or not all(
        name in table and table[name].dims == ("case",) for name in needed
    ):
        return []
    states = {
        str(name): table[name].values.astype(float)
        for name in table.data_vars
        if table[name].dims == ("case",)
    }
    if any(name in REDUCED and not {"V", REDUCED[name][0]} <= set(states) for name in needed):
        return []
    names = str(table.attrs.get("names", "")).split("\n")
    if len(names) != table.sizes["case"]:
        names = [str(number) for number in range(1, table.sizes["case"] + 1)]
    made = _cases(db, [STORED + name for name in names], states)
    return [case for i, one in enumerate(made) if (case := _as_stored(one, table, i)) is not None]


def shot_lines(case: CheckShot, term_ids: Mapping[str, str], inputs: Sequence[str]) -> list[str]:
    """Return a staticShot element as lines."""
    given = [line for name in inputs for line in _signal(_labels(name), case.inputs[name])]
    internal = [
        line
        for name, value in case.internal.items()
        for line in _signal({"varID": term_ids[name]}, value)
    ]
    found = [
        line
        for name, (value, tolerance) in case.outputs.items()
        for line in _signal(_labels(name), value, tolerance)
    ]
    inside = [
        *(element_lines("checkInputs", {}, given) if given else []),
        *element_lines("internalValues", {}, internal),
    ]
    return element_lines(
        "staticShot", {"name": case.name}, [*inside, *element_lines("checkOutputs", {}, found)]
    )


def _lengths(db: xr.DataTree) -> dict[str, float]:
    return {name: float(db.attrs[name]) for name in ("cbar", "b")}


def _cases(
    db: xr.DataTree, names: Sequence[str], states: Mapping[str, np.ndarray]
) -> list[CheckShot]:
    parts = {
        c: contributions(db, c, with_reduced(states, _lengths(db)), outside="clamp")
        for c in exported_coefficients(db)
    }
    sizes = {name: (float(db.attrs[name]), _tolerance([float(db.attrs[name])])) for name in SIZES}
    whole = np.zeros(len(names))
    cases = []
    for i, name in enumerate(names):
        each = {
            c: {term: float((whole + value)[i]) for term, value in found.items()}
            for c, found in parts.items()
        }
        internal = {
            f"{c}/{term}": value for c, found in each.items() for term, value in found.items()
        }
        outputs = sizes | {
            c: (sum(found.values()), _tolerance(found.values())) for c, found in each.items()
        }
        cases.append(
            CheckShot(
                name,
                {key: float((whole + value)[i]) for key, value in states.items()},
                internal,
                outputs,
            )
        )
    return cases


def _tolerance(parts: Iterable[float]) -> float:
    return max(_TOLERANCE * max(map(abs, parts), default=0.0), _LEAST)


def _as_stored(case: CheckShot, table: xr.Dataset, index: int) -> CheckShot | None:
    """Return a case with the values of ``/checks``, or None when an input is missing or a value is
    not met.
    """
    if not np.isfinite(list(case.inputs.values())).all():
        return None
    outputs = dict(case.outputs)
    for name, (value, tolerance) in case.outputs.items():
        if name not in table:
            continue
        expected = float(table[name].values[index])
        allowed = (
            float(table[f"{name}_tolerance"].values[index])
            if f"{name}_tolerance" in table
            else tolerance
        )
        if not abs(value - expected) <= allowed:
            return None
        outputs[name] = expected, allowed
    return CheckShot(case.name, case.inputs, case.internal, outputs)


def standard_name(quantity: str) -> str:
    """Return the S-119 name of a quantity, or ``""``; that of one engine among several has none."""
    row = lookup(quantity)
    return row.s119 if row.name == quantity else ""


def _labels(quantity: str) -> dict[str, str]:
    return {
        "signalName": standard_name(quantity) or quantity,
        "signalUnits": code_of(lookup(quantity).units),
    }


def _signal(labels: Mapping[str, str], value: float, tolerance: float | None = None) -> list[str]:
    inside = [line for tag, content in labels.items() for line in element_lines(tag, {}, content)]
    inside += element_lines("signalValue", {}, repr(value))
    inside += [] if tolerance is None else element_lines("tol", {}, f"{tolerance:.2g}")
    return element_lines("signal", {}, inside)
