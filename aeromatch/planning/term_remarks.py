"""Remarks on the terms that a project opens, and that no manoeuvre of its fits can identify.

Such a term keeps its zero and its wide standard error, and the database shows it as any other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import xarray as xr

from aeromatch.project.project import Project
from flightmech.aircraft.controls import ICE
from flightmech.names import value_text
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of

Range = tuple[float, float]
RANGED = (
    *("alpha", "beta", "mach", "h", "h_agl", "V"),
    *("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake"),
    ICE,
)
"""Axes of tables whose flown range a look at a record notes."""
_STEERED = ("alpha", "beta", "phat", "qhat", "rhat", "delta_e", "delta_a", "delta_r", "CT")
"""Regressors that act only through a regression on them.

A device such as the gear acts through the constant of a fit, too, when it is out.
"""
_LEAST_SHARE = 0.4
"""Part of a table that manoeuvres fly, below which its unflown nodes are named."""
_AT_REST = 1e-6
"""Part of the length of a table below which its axis does not move."""


def flown_ranges(states: xr.Dataset, samples: np.ndarray) -> dict[str, Range]:
    """Return least and largest value of the axes of tables over some samples. [SI]"""
    unknown = str(states.attrs.get("unknown", "")).split()
    ranges = {}
    for name in RANGED:
        if name not in states or name in unknown or states[name].dims != ("time",):
            continue
        values = states.variables[name].values[samples]
        values = values[np.isfinite(values)]
        if values.size:
            ranges[name] = (float(values.min()), float(values.max()))
    return ranges


def term_remarks(project: Project, flown: Mapping[str, Mapping[str, Range]]) -> Iterator[str]:
    """Yield the opened terms whose regressors no fit has, and axes that no manoeuvre flies.

    Parameters
    ----------
    project : Project
    flown : mapping of str to mapping of str to (float, float)
        Ranges of the axes by position of a fit, such as ``fit 'pitch'``, over all its windows. [SI]
    """
    for path, term in project.terms.items():
        coefficient = path.partition("/")[0]
        fits = _fits_of(project, coefficient)
        if not fits:
            # the report of the terms states it
            continue
        variables: set[str] = set().union(*fits.values())
        absent = [name for name in term.regressors if name in _STEERED and name not in variables]
        if absent:
            fitted = " ".join(sorted(variables)) or "a constant only"
            yield (
                f"term {path}: no fit of {coefficient} has its regressor {' '.join(absent)}, so "
                f"nothing identifies it and it stays zero; the fits have {fitted}: correct "
                f"regressors of the term, write {coefficient} = ... + {absent[0]} into a fit whose "
                f"manoeuvres move it, or leave it so as a judged uncertainty"
            )
        leaf = term.leaf()
        ranges = [flown[position] for position in fits if position in flown]
        for axis in leaf.dims:
            points = leaf[axis].values.astype(float)
            yield from _unflown_nodes(path, str(axis), points, ranges)


def _fits_of(project: Project, coefficient: str) -> dict[str, set[str]]:
    """Return the variables of the models of a coefficient, by position of the fit."""
    fits: dict[str, set[str]] = {}
    for fit in project.fit:
        for text in fit.models:
            model = RegressionModel.parse(text)
            if model.coefficient != coefficient:
                continue
            names = fits.setdefault(f"fit {fit.name!r}", set())
            for term in model.terms:
                names.update(map(variable_of, term_powers(term)))
    return fits


def _unflown_nodes(
    path: str, axis: str, points: np.ndarray, ranges: list[Mapping[str, Range]]
) -> Iterator[str]:
    """Yield the nodes of an axis with no flown sample in a cell next to them."""
    known = [item[axis] for item in ranges if axis in item]
    if len(known) < len(ranges) or not known or len(points) < 2:
        return
    low, high = min(item[0] for item in known), max(item[1] for item in known)
    shown = f"{value_text(axis, low)} to {value_text(axis, high)}"
    way_out = "add a manoeuvre there, or leave the axis or these nodes out"
    if high - low <= _AT_REST * (points[-1] - points[0]):
        yield (
            f"term {path}: its axis {axis} stays at {value_text(axis, low)} in all manoeuvres of "
            f"its fits, so that nothing identifies the difference of its nodes; {way_out}"
        )
        return
    below, above = np.r_[-np.inf, points[:-1]], np.r_[points[1:], np.inf]
    is_flown = (high > below) & (low < above)
    # a table that ends a little beyond the flown range is usual
    shared = min(high, points[-1]) - max(low, points[0])
    if not is_flown.all() and shared < _LEAST_SHARE * (points[-1] - points[0]):
        nodes = ", ".join(value_text(axis, float(x)) for x in points[~is_flown])
        yield (
            f"term {path}: the manoeuvres of its fits fly {axis} {shown}, and nothing identifies "
            f"its nodes at {nodes}; {way_out}"
        )


def joined_ranges(
    looks: Iterable[Mapping[str, Mapping[str, Range]]],
) -> dict[str, dict[str, Range]]:
    """Return the flown ranges of the axes by fit, over all records of the fit. [SI]"""
    joined: dict[str, dict[str, Range]] = {}
    for look in looks:
        for position, ranges in look.items():
            known = joined.setdefault(position, {})
            for name, (low, high) in ranges.items():
                before = known.get(name, (low, high))
                known[name] = (min(low, before[0]), max(high, before[1]))
    return joined
