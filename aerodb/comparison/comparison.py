"""Two databases side by side: term by term and coefficient by coefficient, over a common grid or
along a flight record.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
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
    neutral_value,
    order_names,
    select_covered_samples,
)
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


class Side(NamedTuple):
    """What one database gives at the samples: values and standard errors, each (samples,)."""

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
        Samples to compare along, a Dataset of a manoeuvre or arrays that broadcast; samples with a
        NaN in a variable that a term needs are left out, beyond a table both follow the rule of the
        leaf, as the simulation does. Without them terms are compared over the union of the nodes of
        both tables, without regressors, and coefficients over the grid of
        `aerodb.comparison.conditions`. [SI]

    Returns
    -------
    DataFrame, index ``term`` (``CL/basic`` ..., then ``CL`` ...)
        ``found_in`` (``both``, ``a``, ``b``; what is missing counts as zero); ``max_difference``,
        signed, and ``rms_difference``, over nodes or samples; the largest difference in standard
        errors: ``max_in_stderr`` of `a` (of `b` where `a` lacks the term), ``max_in_stderr_b`` of
        `b`, ``max_in_stderr_difference`` of the difference, and its root mean square
        ``rms_in_stderr_difference``; where no standard error is stated nothing is counted, NaN
        without any; ``value_a``, ``value_b`` and ``location`` where the largest difference stands;
        ``note``. Along conditions also ``share``, the part of the mean square difference of the
        coefficient that the term makes up, mean(d_i d) / mean(d d): all terms of a coefficient add
        up to 1, a term that compensates others is negative; and ``rms_left``, the rms difference
        that would be left if `a` took this one term from `b`. ``attrs["grid"]`` states the
        conditions of the coefficients.

    Warns
    -----
    AeromatchWarning
        The databases state other axes, reference quantities or moment references: the numbers are
        compared as they stand.

    Notes
    -----
    Standard errors follow `aerodb.update.standard_errors`: node errors with the correlation of a-priori tables, terms independent.  That of
    the difference takes `a` and `b` as independent; where `b` was identified with `a` as its prior, it is too wide.
    """
    _warn_of_references(a, b)
    ours, theirs = terms(a), terms(b)
    names = [*ours, *(n for n in theirs if n not in ours)]
    pairs = {name: (ours.get(name), theirs.get(name)) for name in names}
    rows, grids = _on_nodes(pairs) if conditions is None else _along(pairs, conditions)
    columns = COLUMNS if conditions is None else COLUMNS + ALONG
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=list(columns)).rename_axis("term")
    frame.attrs["grid"] = grids
    return frame


Pair = tuple[xr.Dataset | None, xr.Dataset | None]
Rows = dict[str, list[Any]]


def _on_nodes(pairs: Mapping[str, Pair]) -> tuple[Rows, dict[str, str]]:
    rows = {name: _node_row(*pair) for name, pair in pairs.items()}
    grids: dict[str, str] = {}
    for coefficient, members in _by_coefficient(pairs).items():
        rows[coefficient], words = _grid_row(members)
        grids |= {coefficient: words} if words else {}
    return rows, grids


def _grid_row(members: Mapping[str, Pair]) -> tuple[list[Any], str]:
    """Return the row of a coefficient over its grid, and the grid in words."""
    points = coefficient_points(
        *([leaf for leaf in side if leaf is not None] for side in zip(*members.values()))
    )
    apart = [name for name, values in points.items() if not len(values)]
    if apart:
        return _nothing(_found_in(members), f"no common range of {', '.join(apart)}"), ""
    samples = coefficient_grid(points)
    count = max((len(x) for x in samples.values()), default=1)
    a, b = (_total(side, count) for side in zip(*_contributions(members, samples, count).values()))
    moving = [name for name, values in points.items() if len(values) > 1]
    at_rest = {
        name: neutral_value(name, points[name]) for name in moving if name not in ("mach", "alpha")
    }
    note = "; ".join([f"{count} conditions", *_assumptions(members)])
    return _row(_found_in(members), a, b, _without_rest(samples, moving, at_rest), note), grid_text(
        points
    )


def _along(pairs: Mapping[str, Pair], conditions: Conditions) -> tuple[Rows, dict[str, str]]:
    samples, count, prefix, left_out = select_covered_samples(
        conditions, [leaf for pair in pairs.values() for leaf in pair if leaf is not None]
    )
    conditions_text = f"{count} samples" + (
        f", {left_out} more with NaN left out" if left_out else ""
    )
    rows: Rows = {name: [] for name in pairs}
    for coefficient, members in _by_coefficient(pairs).items():
        parts = _contributions(members, samples, count)
        total_a, total_b = (_total(side, count) for side in zip(*parts.values()))
        whole = total_b.value - total_a.value
        for name, (a, b) in parts.items():
            used = order_names(
                {
                    v
                    for leaf in members[name]
                    if leaf is not None
                    for v in _terms.list_model_variables(leaf)
                }
            )
            row = _row(
                _pair_found_in(members[name]),
                a,
                b,
                condition_text(samples, used, prefix),
                count_samples_beyond(members[name], samples),
            )
            rows[name] = [*row, *_shares(b.value - a.value, whole)]
        axes = order_names(
            {
                axis
                for pair in members.values()
                for leaf in pair
                if leaf is not None
                for axis in leaf_breakpoints(leaf)
            }
        )
        note = "; ".join([conditions_text, *_assumptions(members)])
        rows[coefficient] = [
            *_row(
                _found_in(members), total_a, total_b, condition_text(samples, axes, prefix), note
            ),
            *_shares(whole, whole),
        ]
    return rows, dict.fromkeys(_by_coefficient(pairs), conditions_text)


def _shares(own: np.ndarray, whole: np.ndarray) -> tuple[float, float]:
    """Return the share of one term in the mean square difference of its coefficient, and the rms
    that is left without it.
    """
    share = float(np.mean(own * whole) / np.mean(whole**2)) if whole.any() else np.nan
    return share, rms(whole - own)


def _by_coefficient(pairs: Mapping[str, Pair]) -> dict[str, dict[str, Pair]]:
    found: dict[str, dict[str, Pair]] = {}
    for name, pair in pairs.items():
        found.setdefault(name.split("/")[0], {})[name] = pair
    return found


def _node_row(ours: xr.Dataset | None, theirs: xr.Dataset | None) -> list[Any]:
    if (
        ours is not None
        and theirs is not None
        and _terms.list_multipliers(ours) != _terms.list_multipliers(theirs)
    ):
        here, there = (" ".join(_terms.list_multipliers(leaf)) or "none" for leaf in (ours, theirs))
        return _nothing("both", f"regressors differ: {here} in a, {there} in b")
    points = merge_leaf_breakpoints(leaf for leaf in (ours, theirs) if leaf is not None)
    samples = mesh_samples(points)
    count = int(np.prod([len(p) for p in points.values()]))
    a, b = (
        term_contribution(
            leaf if leaf is None else _terms.without_multipliers(leaf), samples, count
        )
        for leaf in (ours, theirs)
    )
    return _row(_pair_found_in((ours, theirs)), a, b, condition_text(samples, points), "")


def term_contribution(
    leaf: xr.Dataset | None, samples: Mapping[str, np.ndarray], count: int
) -> Side:
    """Return what a term gives at the samples; nothing for a term that is missing."""
    if leaf is None:
        return Side(np.zeros(count), np.zeros(count))
    B = _terms.basis(leaf, samples, "clamp")
    return Side(
        *(
            np.broadcast_to(x, (count,))
            for x in (B @ leaf["value"].values.ravel(), standard_errors(B, leaf))
        )
    )


def _contributions(
    members: Mapping[str, Pair], samples: Mapping[str, np.ndarray], count: int
) -> dict[str, tuple[Side, Side]]:
    return {
        name: (term_contribution(ours, samples, count), term_contribution(theirs, samples, count))
        for name, (ours, theirs) in members.items()
    }


def _total(parts: Sequence[Side], count: int) -> Side:
    total = Side(np.zeros(count), np.zeros(count))
    for part in parts:
        total = total.plus(part)
    return total


def _row(found_in: str, a: Side, b: Side, place: Place, note: str) -> list[Any]:
    d = b.value - a.value
    size = np.abs(d)
    worst = int(
        np.argmax(size >= size.max() * (1.0 - 1e-9))
    )  # the first of equal ones, whatever the rounding
    of_both = np.hypot(a.stderr, b.stderr)
    ratios = [
        _ratios(d, b.stderr if found_in == "b" else a.stderr),
        _ratios(d, b.stderr),
        _ratios(d, of_both),
    ]
    largest = [float(np.abs(r).max()) if len(r) else np.nan for r in ratios]
    in_rms = rms(ratios[2]) if len(ratios[2]) else np.nan
    where = place(worst) if d[worst] else ""
    return [
        found_in,
        float(d[worst]),
        rms(d),
        *largest,
        in_rms,
        float(a.value[worst]),
        float(b.value[worst]),
        where,
        note,
    ]


def _nothing(found_in: str, note: str) -> list[Any]:
    return [found_in, *[np.nan] * 8, "", note]


def _ratios(d: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    known = stderr > 0
    return d[known] / stderr[known]


def _pair_found_in(pair: Pair) -> str:
    return "b" if pair[0] is None else "a" if pair[1] is None else "both"


def _found_in(members: Mapping[str, Pair]) -> str:
    found = {_pair_found_in(pair) for pair in members.values()}
    return found.pop() if len(found) == 1 else "both"


def _assumptions(members: Mapping[str, Pair]) -> list[str]:
    """Return a text for each database in which terms state no standard error."""
    texts = []
    for side, leaves in zip("ab", zip(*members.values())):
        count = sum(leaf is not None and "stderr" not in leaf for leaf in leaves)
        if count:
            texts.append(f"{count} term{'s' if count > 1 else ''} of {side} without standard error")
    return texts


def _without_rest(
    samples: Mapping[str, np.ndarray], names: Sequence[str], at_rest: Mapping[str, float]
) -> Place:
    def at(i: int) -> str:
        shown = [n for n in names if n not in at_rest or samples[n][i] != at_rest[n]]
        return ", ".join(f"{name} {display_text(name, samples[name][i])}" for name in shown)

    return at


def _warn_of_references(a: xr.DataTree, b: xr.DataTree) -> None:
    apart = [
        f"{key} {a.attrs.get(key)} in a, {b.attrs.get(key)} in b"
        for key in _ROOT
        if not _same(a.attrs.get(key), b.attrs.get(key))
    ]
    if apart:
        text = (
            f"the databases do not refer to the same: {'; '.join(apart)}; the numbers are "
            f"compared as they stand"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def _same(here: Any, there: Any) -> bool:
    return (
        here == there
        if isinstance(here, str) or here is None or there is None
        else bool(np.isclose(here, there, rtol=1e-6, atol=1e-6))
    )
