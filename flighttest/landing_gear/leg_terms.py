"""Which terms the force of a leg needs: spring and damper of either kind, linear regression on reconstructed loads."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..uncertainty.coloured_residuals import coloured
from .explicit import GroundRun
from .wheels import WheelGroup

LEG_TERMS = ("stiffness", "stiffness_square", "damping", "orifice", "damping_outwards")
_FIRST, _FURTHER = 3.0, 5.0  # standard errors from zero of the first damper, and of every further term


def select_leg_terms(runs: Sequence[GroundRun], group: WheelGroup) -> list[str]:
    """Return the terms of a leg, the most significant added first.

    Parameters
    ----------
    runs : sequence of GroundRun
    group : WheelGroup

    Returns
    -------
    list of str
        Of `LEG_TERMS`; a spring always.

    Notes
    -----
    Errors of lift and pitching moment are fitted along, so that a spring does not take up what grows with speed.  A
    damper of either kind counts when it is positive.
    """
    parts = [part for run in runs for part in _columns(run, group)]
    columns = {term: np.concatenate([part[term] for part in parts]) for term in (*LEG_TERMS, "lift", "pitching", "load")}
    edges = np.cumsum([0, *(len(part["load"]) for part in parts)])
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    steps = [run.interval for run in runs for _ in group.names]
    always = [name for name in ("lift", "pitching") if columns[name].any()]
    chosen = ["stiffness"]
    while True:
        t = {term: _t(columns, [*always, *chosen, term], pieces, steps) for term in LEG_TERMS if term not in chosen}
        damped = {"damping", "orifice"} & set(chosen)
        allowed = {term: value for term, value in t.items() if term != "damping_outwards" or damped}
        best = max(allowed, key=lambda term: allowed[term], default="")
        needed = _FIRST if best in ("damping", "orifice") and not damped else _FURTHER
        if not best or allowed[best] < needed:
            return chosen
        chosen.append(best)


def _t(columns, names: list[str], pieces, steps) -> float:
    """Standard errors from zero of the last column; of a damper only above zero."""
    if not columns[names[-1]].any():
        return 0.0
    X = np.column_stack([columns[name] for name in names])
    size = np.linalg.norm(X, axis=0)
    p, *_ = np.linalg.lstsq(X / size, columns["load"], rcond=None)
    v = columns["load"] - X / size @ p
    t = float(p[-1] / np.sqrt(coloured(X / size, v, pieces, steps).covariance[-1, -1]))
    return t if names[-1] in ("damping", "orifice") else abs(t)


def _columns(run: GroundRun, group: WheelGroup) -> list[dict[str, np.ndarray]]:
    """Regressors of every leg of a group; the samples in which it carries."""
    found = []
    for name in group.names:
        k = run.wheels.index(name)
        use = np.isfinite(run.measured[:, k]) & (run.measured[:, k] != 0.0)
        s, rate = run.fields["compression"][use, k], run.fields["rate"][use, k]
        change = {source: run.fields["change"][use, k, run.sources.index(source)] for source in ("lift", "pitching")}
        terms = (s, s**2, rate, rate * np.abs(rate), np.minimum(rate, 0.0))
        found.append({**dict(zip(LEG_TERMS, terms)), **change, "load": run.measured[use, k]})
    return found
