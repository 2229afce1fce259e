"""Comparison of two databases by term and by coefficient.

It is over a common grid or along a flight record.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.comparison.conditions import (
    Conditions,
    Place,
    coefficient_grid,
    coefficient_points,
    condition_text,
    count_samples_beyond,
    grid_text,
    leaf_breakpoints,
    merge_leaf_breakpoints,
    mesh_samples,
    names_at_zero,
    order_names,
    select_covered_samples,
)
from aerodb.store.grids import neutral_value
from aerodb.store.overview import display_text
from aerodb.store.schema import terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning
from flightmech.support.arrays import rms

COLUMNS = (
    "found_in",
    "max_difference",
    "rms_difference",
    "max_in_stderr",
    "max_in_stderr_b",
    "max_in_stderr_difference",
    "rms_in_stderr_difference",
    "value_a",
    "value_b",
    "location",
    "note",
)
ALONG = ("share", "rms_left")
_ROOT = ("force_axes", "S", "cbar", "b", "x_ref", "y_ref", "z_ref")
_NUMBERS = 8  # columns of numbers of a row without a comparison
_EQUAL = 1e-9  # relative difference of two equal differences


class Side(NamedTuple):
    """Values and standard errors of one database at the samples, each (samples,)."""

    value: np.ndarray
    stderr: np.ndarray

    def plus(self, other: Side) -> Side:
        """Return the sum of two independent contributions."""
        return Side(self.value + other.value, np.hypot(self.stderr, other.stderr))


def compare(a: xr.DataTree, b: xr.DataTree, conditions: Conditions | None = None) -> pd.DataFrame:
    """Return the differences b - a of two databases, one row per term and then one per coefficient.

    Parameters
    ----------
    a, b : DataTree
        The databases.
    conditions : mapping of str to array, optional
        Samples of the comparison: a Dataset of a manoeuvre or arrays that broadcast. [SI]
        Samples with a NaN in a required variable are left out.  Beyond a table both databases
        follow the rule of the leaf, as the simulation does.  Without conditions, terms are compared
        over the union of the nodes of both tables, without regressors.  Coefficients are compared
        over the grid of `aerodb.comparison.conditions`.

    Returns
    -------
    DataFrame, index ``term`` (``CL/basic`` ..., then ``CL`` ...)
        ``found_in`` (``both``, ``a``, ``b``); a missing term counts as zero.  ``max_difference``,
        signed, and ``rms_difference``, over nodes or samples.  Largest difference in standard
        errors: ``max_in_stderr`` of `a` (of `b` if `a` lacks the term), ``max_in_stderr_b`` of `b`,
        ``max_in_stderr_difference`` of the difference, and its root mean square
        ``rms_in_stderr_difference``.  Nodes without a standard error do not count; the column is
        NaN without any.  ``value_a``, ``value_b`` and ``location`` of the largest difference;
        ``note``, which also names another rule ``outside`` and, of equal values, other standard
        errors.  Along conditions also ``share`` and ``rms_left``.  ``share`` is the part of the
        term in the mean square difference of the coefficient, mean(d_i d) / mean(d d).  The shares
        of a coefficient add up to 1, and that of a compensating term is negative.  ``rms_left`` is
        the rms difference after `a` has this term from `b`.  ``attrs["grid"]`` states the
        conditions of the coefficients.

    Warns
    -----
    AeromatchWarning
        The databases have different axes, reference quantities or moment reference points; their
        numbers are compared without conversion.

    Notes
    -----
    Standard errors follow `aerodb.update.standard_errors`: node errors with the correlation of
    a-priori tables, terms independent.  That of the difference treats `a` and `b` as independent.
    If `b` was identified with `a` as its prior, it is too large.
    """
    _warn_of_references(a, b)
    ours, theirs = terms(a), terms(b)
    # Terms of the first database, then those that only the second has.
    pairs = {}
    for name in dict.fromkeys([*ours, *theirs]):
        pairs[name] = ours.get(name), theirs.get(name)
    columns: tuple[str, ...] = COLUMNS
    if conditions is None:
        rows, grids = _compare_on_nodes(pairs)
    else:
        columns = COLUMNS + ALONG
        rows, grids = _compare_along(pairs, conditions)
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(columns))
    table = table.rename_axis("term")
    table.attrs["grid"] = grids
    return table


Pair = tuple[xr.Dataset | None, xr.Dataset | None]
Rows = dict[str, list[Any]]


def _compare_on_nodes(pairs: Mapping[str, Pair]) -> tuple[Rows, dict[str, str]]:
    """Return the rows of terms over their nodes and of coefficients over their grids."""
    rows = {name: _node_row(*pair) for name, pair in pairs.items()}
    grids: dict[str, str] = {}
    for coefficient, members in _by_coefficient(pairs).items():
        rows[coefficient], text = _grid_row(members)
        if text:
            grids[coefficient] = text
    return rows, grids


def _grid_row(members: Mapping[str, Pair]) -> tuple[list[Any], str]:
    """Return the row of a coefficient over its grid, and the grid as text."""
    # The grid depends on the tables of both databases.
    ours, theirs = zip(*members.values())
    points = coefficient_points(_present(ours), _present(theirs))
    without_range = [name for name, values in points.items() if not len(values)]
    if without_range:
        note = f"no common range of {', '.join(without_range)}"
        return _empty_row(_coefficient_found_in(members), note), ""
    samples = coefficient_grid(points)
    count = max((len(x) for x in samples.values()), default=1)
    a, b = _total_sides(_contributions(members, samples, count), count)
    varied = [name for name, values in points.items() if len(values) > 1]
    # A location names Mach number and incidence, and the variable that is varied.
    neutral = {}
    for name in varied:
        if name not in ("mach", "alpha"):
            neutral[name] = neutral_value(name, points[name])
    notes = [f"{count} conditions", names_at_zero(points), *_missing_errors(members)]
    note = "; ".join(filter(None, notes))
    location = _deflected_text(samples, varied, neutral)
    row = _difference_row(_coefficient_found_in(members), a, b, location=location, note=note)
    return row, grid_text(points)


def _compare_along(
    pairs: Mapping[str, Pair], conditions: Conditions
) -> tuple[Rows, dict[str, str]]:
    """Return the rows of terms and coefficients at given conditions."""
    leaves: list[xr.Dataset] = []
    for pair in pairs.values():
        leaves += _present(pair)
    samples, count, prefix, left_out = select_covered_samples(conditions, leaves)
    conditions_text = f"{count} samples"
    if left_out:
        conditions_text = f"{conditions_text}, {left_out} more with NaN left out"
    # Keys in the order of the terms; the rows follow below.
    rows: Rows = {name: [] for name in pairs}
    groups = _by_coefficient(pairs)
    for coefficient, members in groups.items():
        parts = _contributions(members, samples, count)
        total_a, total_b = _total_sides(parts, count)
        total_difference = total_b.value - total_a.value
        axes: set[str] = set()
        for name, (a, b) in parts.items():
            variables: set[str] = set()
            for leaf in _present(members[name]):
                variables.update(_terms.list_model_variables(leaf))
                axes.update(leaf_breakpoints(leaf))
            notes = [
                count_samples_beyond(members[name], samples),
                describe_hidden_differences(members[name], a, b),
            ]
            row = _difference_row(
                _pair_found_in(members[name]),
                a,
                b,
                location=condition_text(samples, order_names(variables), prefix),
                note="; ".join(filter(None, notes)),
            )
            rows[name] = [*row, *_shares(b.value - a.value, total_difference)]
        row = _difference_row(
            _coefficient_found_in(members),
            total_a,
            total_b,
            location=condition_text(samples, order_names(axes), prefix),
            note="; ".join([conditions_text, *_missing_errors(members)]),
        )
        rows[coefficient] = [*row, *_shares(total_difference, total_difference)]
    return rows, dict.fromkeys(groups, conditions_text)


def _present(leaves: Iterable[xr.Dataset | None]) -> list[xr.Dataset]:
    """Return the leaves that exist."""
    return [leaf for leaf in leaves if leaf is not None]


def _shares(difference: np.ndarray, total: np.ndarray) -> tuple[float, float]:
    """Return the share of a term in the mean square difference, and the rms without the term."""
    # Without any difference no term has a share.
    share = np.nan
    if total.any():
        share = float(np.mean(difference * total) / np.mean(total**2))
    return share, rms(total - difference)


def _by_coefficient(pairs: Mapping[str, Pair]) -> dict[str, dict[str, Pair]]:
    """Return the pairs of terms grouped by coefficient."""
    groups: dict[str, dict[str, Pair]] = {}
    for name, pair in pairs.items():
        groups.setdefault(name.split("/")[0], {})[name] = pair
    return groups


def _node_row(ours: xr.Dataset | None, theirs: xr.Dataset | None) -> list[Any]:
    """Return the row of a term over the union of the nodes of both tables, without regressors."""
    tables = []
    for leaf in (ours, theirs):
        if leaf is not None:
            leaf = _terms.without_multipliers(leaf)
        tables.append(leaf)
    # Tables with different regressors have different units.
    if ours is not None and theirs is not None:
        regressors_a, regressors_b = _list_regressors(ours), _list_regressors(theirs)
        if regressors_a != regressors_b:
            note = f"regressors differ: {regressors_a} in a, {regressors_b} in b"
            return _empty_row("both", note)
    points = merge_leaf_breakpoints(_present((ours, theirs)))
    samples = mesh_samples(points)
    count = int(np.prod([len(values) for values in points.values()]))
    a, b = (term_contribution(table, samples, count) for table in tables)
    found_in = _pair_found_in((ours, theirs))
    note = describe_hidden_differences((ours, theirs), a, b)
    return _difference_row(found_in, a, b, location=condition_text(samples, points), note=note)


_HIDDEN = ("the rule outside is ", "the standard errors differ, ")


def has_hidden_difference(note: str) -> bool:
    """Return whether a note of `compare` states a difference that equal values do not show."""
    return any(text in note for text in _HIDDEN)


def describe_hidden_differences(pair: Pair, a: Side, b: Side) -> str:
    """Return in words how two tables differ where their values do not: beyond them, in errors.

    Standard errors are named only where all values are equal; otherwise the ratios show them.

    Parameters
    ----------
    pair : (Dataset or None, Dataset or None)
        Tables of one term in both databases.
    a, b : Side
        Their values and standard errors at the compared nodes or samples.
    """
    texts: list[str] = []
    if len(_present(pair)) < 2:
        return ""
    rules = [str(leaf.attrs.get("outside", "hold")) for leaf in _present(pair)]
    if rules[0] != rules[1]:
        texts.append(f"{_HIDDEN[0]}{rules[0]!r} in a, {rules[1]!r} in b")
    if np.array_equal(a.value, b.value) and not np.allclose(a.stderr, b.stderr, atol=0.0):
        shown = [
            f"{float(side.stderr.max()):.3g} in {label}" for side, label in ((a, "a"), (b, "b"))
        ]
        texts.append(f"{_HIDDEN[1]}the largest is {shown[0]}, {shown[1]}")
    return "; ".join(texts)


def _list_regressors(leaf: xr.Dataset) -> str:
    """Return the multipliers of a table as text."""
    return " ".join(_terms.list_multipliers(leaf)) or "none"


def term_contribution(
    leaf: xr.Dataset | None, samples: Mapping[str, np.ndarray], count: int
) -> Side:
    """Return the contribution of a term at the samples; zero for a missing term."""
    if leaf is None:
        return Side(np.zeros(count), np.zeros(count))
    B = _terms.basis(leaf, samples, "clamp")
    value, stderr = B @ leaf["value"].values.ravel(), standard_errors(B, leaf)
    # A term without variables has one row.
    return Side(np.broadcast_to(value, (count,)), np.broadcast_to(stderr, (count,)))


def _contributions(
    members: Mapping[str, Pair], samples: Mapping[str, np.ndarray], count: int
) -> dict[str, tuple[Side, Side]]:
    """Return the contributions of the terms of a coefficient in both databases."""
    parts = {}
    for name, (ours, theirs) in members.items():
        a = term_contribution(ours, samples, count)
        parts[name] = a, term_contribution(theirs, samples, count)
    return parts


def _total_sides(parts: Mapping[str, tuple[Side, Side]], count: int) -> tuple[Side, Side]:
    """Return the sums of all contributions in both databases."""
    zero = Side(np.zeros(count), np.zeros(count))
    total_a, total_b = zero, zero
    for a, b in parts.values():
        total_a, total_b = total_a.plus(a), total_b.plus(b)
    return total_a, total_b


def _difference_row(found_in: str, a: Side, b: Side, *, location: Place, note: str) -> list[Any]:
    """Return a row of the comparison, in the order of `COLUMNS`."""
    d = b.value - a.value
    size = np.abs(d)
    # The first of equal differences, whatever their rounding.
    worst = int(np.argmax(size >= size.max() * (1.0 - _EQUAL)))
    own_stderr = a.stderr
    if found_in == "b":
        own_stderr = b.stderr
    # Standard errors of both databases are independent.
    in_difference = _in_stderr(d, np.hypot(a.stderr, b.stderr))
    rms_in_stderr, text = np.nan, ""
    if len(in_difference):
        rms_in_stderr = rms(in_difference)
    if d[worst]:
        text = location(worst)
    return [
        found_in,
        float(d[worst]),
        rms(d),
        _largest_size(_in_stderr(d, own_stderr)),
        _largest_size(_in_stderr(d, b.stderr)),
        _largest_size(in_difference),
        rms_in_stderr,
        float(a.value[worst]),
        float(b.value[worst]),
        text,
        note,
    ]


def _empty_row(found_in: str, note: str) -> list[Any]:
    """Return a row without a comparison."""
    return [found_in, *[np.nan] * _NUMBERS, "", note]


def _in_stderr(d: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Return differences in standard errors, of those with a standard error."""
    uncertain = stderr > 0
    return d[uncertain] / stderr[uncertain]


def _largest_size(ratios: np.ndarray) -> float:
    """Return the largest magnitude, NaN without any."""
    if not len(ratios):
        return np.nan
    return float(np.abs(ratios).max())


def _pair_found_in(pair: Pair) -> str:
    """Return which databases have a term: ``a``, ``b`` or ``both``."""
    ours, theirs = pair
    if ours is None:
        return "b"
    if theirs is None:
        return "a"
    return "both"


def _coefficient_found_in(members: Mapping[str, Pair]) -> str:
    """Return which databases have terms of a coefficient: ``a``, ``b`` or ``both``."""
    places = {_pair_found_in(pair) for pair in members.values()}
    if len(places) > 1:
        return "both"
    return places.pop()


def _missing_errors(members: Mapping[str, Pair]) -> list[str]:
    """Return a text for each database with terms without a standard error."""
    texts = []
    for side, leaves in zip("ab", zip(*members.values())):
        count = sum("stderr" not in leaf for leaf in _present(leaves))
        plural = ""
        if count > 1:
            plural = "s"
        if count:
            texts.append(f"{count} term{plural} of {side} without standard error")
    return texts


def _deflected_text(
    samples: Mapping[str, np.ndarray], names: Sequence[str], neutral: Mapping[str, float]
) -> Place:
    """Return a function that gives the condition of a sample without neutral variables."""

    def describe(i: int) -> str:
        texts = []
        for name in names:
            value = samples[name][i]
            if name not in neutral or value != neutral[name]:
                texts.append(f"{name} {display_text(name, value)}")
        return ", ".join(texts)

    return describe


def _warn_of_references(a: xr.DataTree, b: xr.DataTree) -> None:
    """Warn of reference quantities and axes that differ."""
    differences = []
    for key in _ROOT:
        item_a, item_b = a.attrs.get(key), b.attrs.get(key)
        if not _is_same(item_a, item_b):
            differences.append(f"{key} {item_a} in a, {item_b} in b")
    if differences:
        text = (
            f"the databases do not refer to the same: {'; '.join(differences)}; the numbers are "
            f"compared as they stand"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def _is_same(first: Any, second: Any) -> bool:
    """Return whether two root attributes are equal, numbers within rounding."""
    if isinstance(first, str) or first is None or second is None:
        return first == second
    return bool(np.isclose(first, second, rtol=1e-6, atol=1e-6))
