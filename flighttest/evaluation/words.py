"""An evaluation as plain text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flightmech.units import from_si

from ..quality.words import report as quality_report

if TYPE_CHECKING:
    from .evaluating import Evaluation

DISPLAY = {"rad": "deg", "rad s-1": "rad/s", "m s-1": "m/s", "s-2": "1/s2 per rad"}


def number(value: float, unit: str, digits: int = 4) -> str:
    """Return an SI value for people, angles in degrees; a dash for what is not there."""
    if not math.isfinite(value):
        return "-"
    return f"{from_si(value, 'deg') if unit == 'rad' else value:.{digits}g}"


def unit_shown(unit: str) -> str:
    """Return the unit that `number` shows."""
    return "" if unit == "1" else DISPLAY.get(unit, unit)


def limits_shown(low: float, high: float, unit: str) -> str:
    """Return the bounds as text."""
    if math.isinf(high):
        return f"at least {number(low, unit)}"
    return f"at most {number(high, unit)}" if math.isinf(low) else f"{number(low, unit)} ... {number(high, unit)}"


def report(evaluation: Evaluation) -> str:
    """Return consistency, stationary lines, coefficients, eigenmotions and bounds as text."""
    e = evaluation
    lines = [e.plan.title, e.verdict, "", quality_report(e.quality), ""]
    for fitted in e.lines:
        head = f"{fitted.line.name}: {fitted.line.y} over {fitted.line.x}, {len(fitted.x)} points"
        lines += [head, *_figures(e, fitted.line.name), ""]
    for fit in e.fits:
        lines += [fit.report(), ""]
    for name, motion in e.motions.items():
        lines += [f"{name}: {motion.report()}", ""]
    for name, text in e.refused.items():
        lines += [f"! {name} not determined: {text}"]
    lines += ["", "bounds:"]
    for row in e.judged.to_dict("records"):
        mark = " " if row["verdict"] == "inside" else "!"
        value = f"{number(row['value'], row['unit'])} ({number(row['stderr'], row['unit'], 2)}) {unit_shown(row['unit'])}".rstrip()
        limits = limits_shown(row["low"], row["high"], row["unit"])
        lines.append(f"{mark} {row['of']:34s} {value:28s} {limits:24s} {row['verdict']:15s} {row['source']}")
    return "\n".join(lines)


def _figures(e: Evaluation, name: str) -> list[str]:
    return [
        f"  {key.rpartition('.')[2]:10s}{number(f.value, f.unit):>10s} ({number(f.stderr, f.unit, 2)}) {unit_shown(f.unit)}".rstrip()
        for key, f in e.figures.items()
        if key.rpartition(".")[0] == name
    ]
