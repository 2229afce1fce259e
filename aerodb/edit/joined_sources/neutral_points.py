"""Neutral points of the sources of a blend, which show a wrong moment centre.

A moment centre that is wrong by d chords adds CL_alpha d to Cm_alpha.  The standard error of
Cm_alpha of an estimate is as large as 0.1 to 0.2 chord, so that 0.3 chord between two sources can
stay within the errors.  Programs agree better on the neutral point itself: on the eleven aircraft
of the calibration (`data/calibration/estimates.csv`) that of OptVL lies 0.09 chord (standard
deviation 0.07, -0.03 to 0.21) behind that of Digital DATCOM.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import xarray as xr

from aerodb.edit.joined_sources.prior_sources import PriorSource
from aerodb.store.grids import value_breakpoints
from aerodb.store.schema import terms
from flightmech.names import ATTACHED_FLOW
from flightmech.terms import evaluate_term, list_multipliers
from flightmech.units import DEGREE

# Distance of two neutral points from which on a moment centre is doubted. [chords]
MOST_APART = 0.2
_LIFT, _MOMENT = "CL/basic", "Cm/basic"
_ATTACHED = (-2.0 * DEGREE, 6.0 * DEGREE)
_SHORTEST = 2.0 * DEGREE  # range of alpha that gives a slope
_SAMPLES = 9
_LEAST_SLOPE = 1.0  # of the lift, per rad


def compare_neutral_points(by_term: Mapping[str, Sequence[PriorSource]]) -> list[str]:
    """Return a sentence on every two sources whose neutral points are far from each other.

    Parameters
    ----------
    by_term : mapping of str to sequence of PriorSource
        Sources of every term, which refer to one point.  A source without lift and pitching moment
        takes no part, nor does any if the pitching moment is taken from one.
    """
    members = [source for source in by_term.get(_MOMENT, ()) if _has_basic(source)]
    texts = []
    for one, other in combinations(members, 2):
        condition = _common_condition(one, other)
        if condition is None:
            continue
        places = [_neutral_point(source, condition) for source in (one, other)]
        distance = abs(places[1] - places[0])
        # a source without lift has no neutral point: NaN fails the comparison
        if not distance > MOST_APART:
            continue
        low, high = np.degrees(condition["alpha"][[0, -1]])
        texts.append(
            f"Cm/basic: the neutral point lies {places[0]:.2f} chords behind the moment reference "
            f"point by {one.label} and {places[1]:.2f} by {other.label} (alpha {low:.0f} to "
            f"{high:.0f} deg), {distance:.2f} apart; two estimates of one aeroplane are usually "
            f"within {MOST_APART:g}: compare the moment centres that both files state (XCG of the "
            f"cards, Xref of the file, --x-ref), or take Cm/* and Cn/* from one of them"
        )
    return texts


def _has_basic(source: PriorSource) -> bool:
    """Return whether lift and pitching moment are tables over alpha."""
    leaves = terms(source.database)
    for name in (_LIFT, _MOMENT):
        leaf = leaves.get(name)
        if leaf is None or "alpha" not in leaf["value"].dims or list_multipliers(leaf):
            return False
    return True


def _common_condition(one: PriorSource, other: PriorSource) -> dict[str, np.ndarray] | None:
    """Return angles of attack and a Mach number that both sources have; None without a range."""
    tables: list[xr.Dataset] = []
    for source in (one, other):
        tables += [terms(source.database)[name] for name in (_LIFT, _MOMENT)]
    points = [value_breakpoints(leaf) for leaf in tables]
    low = max(_ATTACHED[0], *(axes["alpha"][0] for axes in points))
    high = min(_ATTACHED[1], *(axes["alpha"][-1] for axes in points))
    if high - low < _SHORTEST:
        return None
    alpha = np.linspace(low, high, _SAMPLES)
    # the lowest Mach number of all: tables that begin above it hold their first value
    machs = [float(axes["mach"][0]) for axes in points if "mach" in axes]
    return {"alpha": alpha, "mach": np.full(_SAMPLES, max(machs, default=0.0))}


def _neutral_point(source: PriorSource, condition: Mapping[str, np.ndarray]) -> float:
    """Return the neutral point behind the moment reference point, -Cm_alpha / CL_alpha. [chords]"""
    slopes = []
    for name in (_LIFT, _MOMENT):
        leaf = terms(source.database)[name]
        state = dict(condition)
        for axis, points in value_breakpoints(leaf).items():
            # at rest, or the value in range nearest to it
            rest = np.clip(ATTACHED_FLOW.get(axis, 0.0), points[0], points[-1])
            state.setdefault(axis, np.full(_SAMPLES, float(rest)))
        curve = np.asarray(evaluate_term(leaf, state, "clamp"), float)
        slopes.append(float(np.polyfit(condition["alpha"], curve, 1)[0]))
    lift, moment = slopes
    return -moment / lift if lift > _LEAST_SLOPE else float("nan")
