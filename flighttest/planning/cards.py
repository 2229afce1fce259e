"""Test cards: one A5 page for every manoeuvre, as PDF, with condition, input, limits, abort criteria, time and fuel."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError

from ..input_design.input_signals import axes_of
from .catalogue import Condition, Manoeuvre
from .pilot import BEHIND
from .plan import Plan, clock_text, shown

_TEMPLATE = Path(__file__).with_suffix(".typ")
_UNDATED = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)  # no clock is read: equal plans give equal bytes
_WIDE, _HIGH, _LEFT = 720.0, 74.0, 90.0  # of the drawing of one axis
_TRIM = {"init.alpha": "alpha", "init.theta": "theta", "delta_e": "delta_e", "delta_a": "delta_a", "delta_r": "delta_r"}
_WORDS = {
    "sideslip": "From trim: rudder slowly to +{a}, hold, back; then to -{a}; {t:g} s each. Heading held with bank, height with elevator.",
    "pull_up_push_down": "From trim: the pitch attitude follows one sine of +-{a} in {t:g} s. Power fixed, wings level.",
    "level_speed": "Level: idle until the airspeed is {a} below trim, full power until it is {a} above, then hold. Height within 50 ft.",
    "device": "From trim: {d} to {a}, wait {t:g} s from the start, and back. Height, speed and heading held.",
}


def card_page(plan: Plan, number: int, name: str) -> bytes:
    """Return the test card of one manoeuvre of a plan as PDF.

    Parameters
    ----------
    plan : Plan
    number : int
        Of the card, from 1.
    name : str
        Of the files of its input.

    Raises
    ------
    SchemaError
        Typst is not installed, or cannot set the card, with its words.
    """
    with TemporaryDirectory() as place:
        return _page(_content(plan, number, name, Path(place)), Path(place))


def _page(content: dict[str, Any], place: Path) -> bytes:
    """Return one card, typeset in the folder that holds its drawing."""
    try:
        import typst
    except ImportError as error:
        raise SchemaError("test cards", ["typst is not installed; pip install it"]) from error
    (place / "card.json").write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
    (place / "card.typ").write_bytes(_TEMPLATE.read_bytes())
    try:
        return typst.compile(str(place / "card.typ"), root=str(place), format="pdf", ignore_system_fonts=True, timestamp=_UNDATED)
    except typst.TypstError as error:
        raise SchemaError("test cards", [f"typst: {error.message}"]) from error


def _content(plan: Plan, number: int, name: str, place: Path) -> dict[str, Any]:
    prediction, item = plan.prediction, plan.items[number - 1]
    candidate, catalogue = prediction.candidates[item], prediction.catalogue
    condition: Condition = next(c for c in catalogue.condition if c.name == item[0])
    start, row = prediction.trims[condition.name], {str(name): x for name, x in plan.order.to_dict("index")[number].items()}
    limits = {**catalogue.limits, **condition.limits}
    signal = candidate.signal
    drawing = ""
    if signal is not None:
        drawing = "input.svg"
        (place / drawing).write_text(_drawing(signal), encoding="utf-8")
    fuel = [f"{x:.1f} kg" if np.isfinite(x) else "-" for x in (row["fuel"], row["fuel_total"])]
    levers = [f"{100.0 * start[key]:.0f} %" for key in start if key.endswith(".throttle") and key.startswith("engine")]
    trim = [[key, shown(key, float(start[source]))] for source, key in _TRIM.items() if source in start]
    return {
        "title": f"Test card {number}: {item[1]}, {item[0]}",
        "programme": catalogue.title,
        "number": str(number),
        "count": str(len(plan.items)),
        "manoeuvre": item[1],
        "condition": item[0],
        "state": [[key, shown(key, value)] for key, value in condition.fixed.items()],
        "trim": trim + ([["power levers", ", ".join(dict.fromkeys(levers))]] if levers else []),
        "instruction": _instruction(candidate.manoeuvre, signal),
        "axes": _axes(signal, name) if signal is not None else [],
        "drawing": drawing,
        "alt": f"Deflections from trim over time of {', '.join(axes_of(signal))}" if signal is not None else "",
        "limits": [
            [key, f"{shown(key, low)} ... {shown(key, high)}", " ... ".join(shown(key, x) for x in candidate.extremes.get(key, ()))]
            for key, (low, high) in limits.items()
        ],
        "binding": candidate.binding,
        "abort": [*catalogue.abort, *candidate.manoeuvre.abort] or ["any limit on this card"],
        "budget": [
            ["time", clock_text(row["time"]), clock_text(row["setup"]), clock_text(row["clock"])],
            ["fuel", fuel[0], "", fuel[1]],
        ],
    }


def _instruction(manoeuvre: Manoeuvre, signal: xr.Dataset | None) -> str:
    if signal is None:
        of = {"sideslip": "delta_r", "pull_up_push_down": "theta", "level_speed": "V"}.get(manoeuvre.kind, manoeuvre.device)
        text = _WORDS[manoeuvre.kind].format(a=shown(of, manoeuvre.amplitude), t=manoeuvre.duration, d=manoeuvre.device)
    else:
        steps = (
            ", ".join(f"{axis} {table.pattern}" for axis, table in manoeuvre.design.axis.items() if table.pattern)
            if manoeuvre.design
            else ""
        )
        held = "all other controls fixed" if not manoeuvre.feedback else "a light hand keeps pitch attitude and bank"
        length = float(signal["time"][-1])
        text = f"From trim: {manoeuvre.kind}{f' ({steps})' if steps else ''} of {length:.0f} s, deflections from trim; {held}."
    return f"{text} Then recover and trim for {max(manoeuvre.setup, BEHIND):.0f} s."


def _axes(signal: xr.Dataset, name: str) -> list[list[str]]:
    rows = []
    for axis in axes_of(signal):
        u = signal[axis].values
        rate = float(np.abs(np.diff(u)).max()) * float(signal.attrs["rate"])
        rows.append([axis, shown(axis, float(np.abs(u).max())), f"{shown(axis, rate)}/s", f"{name}.csv"])
    return rows


def _drawing(signal: xr.Dataset) -> str:
    """Return the input over time, one panel per axis, as SVG."""
    names, time = axes_of(signal), signal["time"].values
    span = float(time[-1])
    tick = next(step for step in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 500.0) if span / step <= 12.0)
    height = _HIGH * len(names) + 26.0
    x = _LEFT + (time / span) * (_WIDE - _LEFT - 8.0)
    body = []
    for at in np.arange(0.0, span + 1e-9, tick):
        place = _LEFT + at / span * (_WIDE - _LEFT - 8.0)
        body.append(f'<line x1="{place:.1f}" x2="{place:.1f}" y1="4" y2="{height - 22:.1f}" stroke="#d0d0d0" stroke-width="0.7"/>')
        body.append(f'<text x="{place:.1f}" y="{height - 8:.1f}" text-anchor="middle">{at:g}{" s" if at == 0.0 else ""}</text>')
    for k, name in enumerate(names):
        u = signal[name].values
        peak, middle = float(np.abs(u).max()) or 1.0, _HIGH * (k + 0.5) + 2.0
        y = middle - u / peak * (0.5 * _HIGH - 7.0)
        points = " ".join(f"{a:.1f},{b:.2f}" for a, b in zip(x, y, strict=True))
        body.append(f'<line x1="{_LEFT}" x2="{_WIDE - 8.0}" y1="{middle:.1f}" y2="{middle:.1f}" stroke="#999999" stroke-width="0.7"/>')
        body.append(f'<polyline points="{points}" fill="none" stroke="#000000" stroke-width="1.6"/>')
        body.append(f'<text x="4" y="{middle - 3:.1f}">{name}</text><text x="4" y="{middle + 15:.1f}">+-{shown(name, peak)}</text>')
    style = 'font-family="Libertinus Serif" font-size="15"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE:g} {height:g}" {style}>{"".join(body)}</svg>'
