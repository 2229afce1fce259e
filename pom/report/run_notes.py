"""What a reader wants to know of a run in addition to its verdict, in lines of text: trim, math pilot, drift."""

from __future__ import annotations

from flightmech.names import lookup
from flightmech.units import from_si

from ..cases.resolve import LIMIT_UNITS
from ..replaying.offsets import drift
from ..replaying.piloting import pilot_activity
from ..replaying.trim_state import FOUND, LEFT, SHOWN_UNITS, limits_of
from ..result import PomResult
from .case.probability import probability, sources, spread

_RATES = ("V_cas", "h", "psi")


def sampled_line(result: PomResult, run: str) -> str:
    """Return what the draws of a model show of a case, in one line: probability, spread, and what makes that of the deciding criterion."""
    samples, worst = result.samples[run], result.worst(run)
    decides = str(worst["criterion"]) if worst is not None else ""
    made = sources(samples, decides, 3) if decides in samples.ratio else ""
    text = f"probability of a pass {probability(samples)} ({samples.count} draws), ratio {spread(samples)}"
    return f"{text}; {decides}: {made}" if made else text


def run_notes(result: PomResult, run: str) -> list[str]:
    """Return the lines of a run: ``trim ...``, ``pilot ...`` for every control that a math pilot moved, ``drift ...``."""
    return [line for line in (_trim(result, run), *_pilot(result, run), _drift(result, run)) if line]


def _trim(result: PomResult, run: str) -> str:
    limits = limits_of(result)
    words = []
    trim = result.trim[run].dropna().to_dict()
    for quantity in (name for name in (*FOUND, *LEFT) if name in trim):
        value = trim[quantity]
        name = quantity.removeprefix("trim.")
        unit = SHOWN_UNITS.get(LIMIT_UNITS[name], LIMIT_UNITS[name])
        text = f"{name} {from_si(value, unit):+.3g}{'' if unit == '1' else f' {unit}'}"
        if name in limits and abs(value) > limits[name].size:
            words.append(f"{text} (limit {from_si(limits[name].size, unit):.3g}{', of the case file' if limits[name].demanded else ''})")
        elif quantity in FOUND and value != 0.0:
            words.append(text)
    return f"trim   {', '.join(words)}" if words else ""


def _pilot(result: PomResult, run: str) -> list[str]:
    rows = pilot_activity(result)
    lines = []
    for row in rows[rows["run"] == run].to_dict("records"):
        unit = lookup(row["control"]).display_units
        mean, rms, largest = (from_si(row[key], unit) for key in ("mean", "rms", "largest"))
        lines.append(
            f"pilot  {row['control']}: mean {mean:+.3g}, rms {rms:.3g}, largest {largest:+.3g} {unit} at {row['at']:.1f} s, "
            f"{100.0 * row['at_limit']:.0f} % at its limit; off by {row['held']}; loops {row['gains']}"
        )
    return lines


def _drift(result: PomResult, run: str) -> str:
    rows = drift(result)
    words = []
    for row in rows[(rows["run"] == run) & rows["channel"].isin(_RATES)].to_dict("records"):
        unit = lookup(row["channel"]).display_units
        words.append(f"{row['channel']} {from_si(60.0 * row['rate'], unit):+.3g} {unit}/min")
    return f"drift  {', '.join(words)}" if words else ""
