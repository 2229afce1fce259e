"""Kinematic consistency in figures and findings: what mistakes there are, and how well the rest agrees."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from ..finding import Finding, exchanged, map_entry, rows
from .mistake_search import Explanation, plausible, units_mistaken
from .relations import Comparison, compare_all
from .signals import Signals

SCALE = 0.005  # deviation of a slope from one that is reported
GROSS_SCALE = 0.1  # and that is a warning
_STRAIGHT = 0.9995  # correlation above which a slope of half a per cent is informative
_CERTAIN = 2.5  # standard errors; they are wide, because few manoeuvres carry a slope
_SECONDS = 5.0  # of one block of the standard error of a slope
_SCALED = {  # relation -> channels named when the slope is not one
    "phi_rate": ("phi", "p"),
    "theta_rate": ("theta", "q"),
    "psi_rate": ("psi", "r"),
    "climb_rate": ("hdot", "h_baro"),
    "vane": ("alpha_vane",),
}
_COLUMNS = (
    "relation", "title", "units", "disagreement", "limit", "consistent", "moving", "correlation", "slope", "slope_stderr", "offset", "rms"
)  # fmt: skip
_UPWASH = (0.8, 1.35)  # slopes of a vane that are no warning


def kinematic_table(signals: Signals) -> pd.DataFrame:
    """Return how every relation holds.

    Parameters
    ----------
    signals : Signals
        Mistakes undone, sensors at the c.g.

    Returns
    -------
    DataFrame
        ``relation title units disagreement limit consistent moving correlation slope slope_stderr offset rms``; slope of the first side
        over the second with its standard error between blocks of five seconds, offset and rms difference in `units`.
    """
    found = []
    for name, c in compare_all(signals).items():
        slope, stderr = _slope(c, signals.step)
        difference = (c.first - c.second)[c.mask]
        found.append(
            {
                "relation": name, "title": c.relation.title, "units": c.relation.units, "disagreement": c.disagreement,
                "limit": c.relation.limit, "consistent": c.consistent, "moving": c.moving, "correlation": c.correlation,
                "slope": slope, "slope_stderr": stderr, "offset": c.offset, "rms": float(np.std(difference)),
            }
        )  # fmt: skip
    return pd.DataFrame(found, columns=_COLUMNS)


def kinematic_findings(
    explanations: list[Explanation], comparisons: dict[str, Comparison], signals: Signals, record: xr.DataTree
) -> list[Finding]:
    """Return the mistakes found, the relations that none of them resolves, and channels outside what is possible."""
    found = [_mistake(explanation, record) for explanation in explanations]
    for name, c in comparisons.items():
        if not c.consistent:
            text = f"{c.relation.title} do not agree (disagreement {c.disagreement:.2f}), and no single sign, unit or axis resolves it"
            remedy = f"check {', '.join(c.relation.channels(signals))}; see the plot of {name}"
            found.append(Finding("warning", "inconsistent", c.relation.channels(signals), text, remedy, evidence={"relation": name}))
    for name in signals.values:
        found += _outside(name, signals, record)
    return found


def accuracy_findings(table: pd.DataFrame) -> list[Finding]:
    """Return scale errors among channels that agree otherwise, and the upwash of the vane."""
    found = []
    for row in rows(table):
        if row.relation not in _SCALED or not row.consistent:
            continue
        off = abs(row.slope - 1.0)
        if row.relation == "vane":
            found += _vane(row) if row.moving else []
        elif row.correlation > _STRAIGHT and off > SCALE and off > _CERTAIN * row.slope_stderr:
            names = _SCALED[row.relation]
            text = f"{row.title}: the first is {row.slope:.3f} of the second (standard error {row.slope_stderr:.3f})"
            remedy = f"a scale error of {' or '.join(names)}: let the reconstruction find it, or calibrate"
            severity = "warning" if off > GROSS_SCALE else "note"
            found.append(Finding(severity, "scale", names, text, remedy, evidence={"slope": row.slope, "stderr": row.slope_stderr}))
    return found


def _vane(row) -> list[Finding]:
    if row.correlation < 0.9 or not (abs(row.slope - 1.0) > max(0.02, _CERTAIN * row.slope_stderr)):
        return []
    text = (
        f"alpha_vane shows {row.slope:.2f} of the angle that attitude and climb give (standard error {row.slope_stderr:.2f}), "
        f"mean difference {np.degrees(row.offset):+.1f} deg: upwash and offset"
    )
    remedy = "give factor and bias_sigma of the vane in the aircraft file; the reconstruction estimates them"
    severity = "note" if _UPWASH[0] < row.slope < _UPWASH[1] else "warning"
    return [Finding(severity, "scale", ("alpha_vane",), text, remedy, evidence={"slope": row.slope, "offset": row.offset})]


def _mistake(explanation: Explanation, record: xr.DataTree) -> Finding:
    repair = explanation.repair
    corrected = ", ".join(
        f"{name} {before:.2f} to {after:.2f}" for name, before, after in zip(explanation.resolves, explanation.before, explanation.after)
    )
    others = "".join(f"; or {other.mistake}" for other in explanation.instead)
    text = f"{repair.mistake}{others} (disagreements that this resolves: {corrected})"
    changes = dict(zip(explanation.resolves, zip(explanation.before, explanation.after)))
    evidence = {"resolves": changes, "instead": [other.mistake for other in explanation.instead]}
    if repair.kind == "axis":
        remedy = exchanged(record, *repair.channels)
    else:
        remedy = map_entry(record, repair.channels[0], repair.slope, repair.shift)
    return Finding("error", repair.kind, repair.channels, text, remedy, evidence=evidence)


def _outside(name: str, signals: Signals, record: xr.DataTree) -> list[Finding]:
    limits = plausible(name)
    good = signals.good[name] & signals.flying
    if limits is None or not good.any():
        return []
    x = signals[name][good]
    outside = (x < limits[0]) | (x > limits[1])
    if outside.mean() < 0.001:
        return []
    for wrong, right, factor in units_mistaken(name):
        if limits[0] < factor * x.min() and factor * x.max() < limits[1]:
            text = f"{name} is in {wrong} and was taken as {right}: it reaches {np.abs(x).max():.4g} {right}, which is not possible"
            return [Finding("error", "unit", (name,), text, map_entry(record, name, factor))]
    worst = float(x[np.argmax(np.abs(x - np.clip(x, *limits)))])
    text = f"{name} reaches {worst:.4g}; possible are {limits[0]:g} to {limits[1]:g} (SI); {outside.mean():.1%} of the flight lies outside"
    return [Finding("error", "range", (name,), text, "check unit, scale and column of the name map", evidence={"worst": worst})]


def _slope(c: Comparison, step: float) -> tuple[float, float]:
    """Return the slope and its standard error, from the scatter of what blocks of the record add to it."""
    y, x = (side[c.mask] - side[c.mask].mean() for side in (c.first, c.second))
    width = max(round(_SECONDS / step), 1)
    blocks = max(len(y) // width, 1)
    residual = (x * (y - c.slope * x))[: blocks * width]
    sums = residual.reshape(blocks, -1).sum(axis=1)
    return c.slope, float(np.sqrt((sums**2).sum() * blocks / max(blocks - 1, 1)) / max((x**2).sum(), 1e-30))
