"""Test cards of a plan: one A5 page per manoeuvre as PDF.

A card has condition, input, limits, abort criteria, time and fuel.
"""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.flight_programme.input_design.input_signals import axes_of
from flighttest.flight_programme.planning.catalogue import PlannedManoeuvre
from flighttest.flight_programme.planning.pilot import BEHIND
from flighttest.flight_programme.planning.plan import ProgrammePlan, clock_text, format_quantity
from flighttest.flight_programme.planning.prediction import Candidate

_TEMPLATE = Path(__file__).with_name("cards.typ")
# Date of the PDF. The clock is not read, so that equal plans give equal bytes.
_UNDATED = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
# Width of the drawing, height of the panel of one axis, and position of its left end.
_WIDE, _HIGH, _LEFT = 720.0, 74.0, 90.0
# Space right of the panels, and below them for the labels of the time.
_RIGHT, _BELOW = 8.0, 26.0
# Intervals between labels of the time [s], and the largest number of intervals.
_TICKS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 500.0)
_MOST_TICKS = 12.0
# Quantities of the trim on the card, by parameter or input of the model.
_TRIM = {
    "init.alpha": "alpha",
    "init.theta": "theta",
    "delta_e": "delta_e",
    "delta_a": "delta_a",
    "delta_r": "delta_r",
}
# Quantity of the amplitude, by kind; the amplitude of a device is that of its input.
_OF_KIND = {"sideslip": "delta_r", "pull_up_push_down": "theta", "level_speed": "V"}
_OF_KIND["low_pass"] = "theta"
_INSTRUCTIONS = {
    "sideslip": "From trim: rudder slowly to +{a}, hold, back; then to -{a}; {t:g} s each. "
    "Heading held with bank, height with elevator.",
    "pull_up_push_down": "From trim: the pitch attitude follows one sine of +-{a} in {t:g} s. "
    "Power fixed, wings level.",
    "level_speed": "Level: idle until the airspeed is {a} below trim, full power until it is {a} "
    "above, then hold. Height within 50 ft.",
    "device": "From trim: {d} to {a}, wait {t:g} s from the start, and back. Height, speed and "
    "heading held.",
    "low_pass": "Down to {h} over the runway (moment reference point). Level for {t:g} s with "
    "pitch attitude +-{a} at 0.2 Hz. Then climb back. Power for the speed.",
    "landing": "Down the glide path of the trim. Flare from {h} over the runway, power fixed, to "
    "the contact of the wheels; {t:g} s at most.",
}


def card_page(plan: ProgrammePlan, number: int, name: str) -> bytes:
    """Return the test card of one manoeuvre of a plan as PDF.

    Parameters
    ----------
    plan : ProgrammePlan
    number : int
        Number of the card, from 1.
    name : str
        Name of the files of its input.

    Raises
    ------
    SchemaError
        Typst is not installed, or reports an error; its message is included.
    """
    with TemporaryDirectory() as folder:
        content = _card_content(plan, number, name)
        signal = plan.prediction.candidates[plan.items[number - 1]].signal
        if signal is not None:
            (Path(folder) / content["drawing"]).write_text(_draw_input(signal), encoding="utf-8")
        return _typeset_card(content, Path(folder))


def _typeset_card(content: dict[str, Any], folder: Path) -> bytes:
    """Return one card, typeset in the folder of its drawing."""
    # typst is an optional extra
    try:
        import typst
    except ImportError as error:
        raise SchemaError("test cards", ["typst is not installed; pip install it"]) from error
    (folder / "card.json").write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
    (folder / "card.typ").write_bytes(_TEMPLATE.read_bytes())
    try:
        return typst.compile(
            str(folder / "card.typ"),
            root=str(folder),
            format="pdf",
            ignore_system_fonts=True,
            timestamp=_UNDATED,
        )
    except typst.TypstError as error:
        raise SchemaError("test cards", [f"typst: {error.message}"]) from error


def _card_content(plan: ProgrammePlan, number: int, name: str) -> dict[str, Any]:
    """Return the texts of a card, by the keys of the template."""
    prediction, item = plan.prediction, plan.items[number - 1]
    candidate, catalogue = prediction.candidates[item], prediction.catalogue
    # An item is the name of a condition and that of a manoeuvre.
    condition = next(c for c in catalogue.condition if c.name == item[0])
    signal = candidate.signal
    content: dict[str, Any] = {
        "title": f"Test card {number}: {item[1]}, {item[0]}",
        "programme": catalogue.title,
        "number": str(number),
        "count": str(len(plan.items)),
        "manoeuvre": item[1],
        "condition": item[0],
        "state": [[key, format_quantity(key, value)] for key, value in condition.fixed.items()],
        "trim": _trim_rows(prediction.trims[condition.name]),
        "instruction": _instruct_pilot(
            candidate.manoeuvre, signal, height=candidate.manoeuvre.height * plan.prediction.span
        ),
        "axes": [],
        "drawing": "",
        "alt": "",
        "limits": _limit_rows({**catalogue.limits, **condition.limits}, candidate),
        "binding": candidate.binding,
        "abort": [*catalogue.abort, *candidate.manoeuvre.abort] or ["any limit on this card"],
        "budget": _budget_rows(plan, number),
    }
    if signal is not None:
        axes = ", ".join(axes_of(signal))
        content["axes"] = _axis_rows(signal, name)
        content["drawing"] = "input.svg"
        content["alt"] = f"Deflections from trim over time of {axes}"
    return content


def _trim_rows(start: dict[str, float]) -> list[list[str]]:
    """Return the quantities of the trim, and the levers in per cent."""
    rows = []
    for source, name in _TRIM.items():
        if source in start:
            rows.append([name, format_quantity(name, float(start[source]))])
    levers = []
    for key, value in start.items():
        if key.endswith(".throttle") and key.startswith("engine"):
            levers.append(f"{100.0 * value:.0f} %")
    if levers:
        # engines with equal levers share one entry
        rows.append(["power levers", ", ".join(dict.fromkeys(levers))])
    return rows


def _limit_rows(limits: dict[str, tuple[float, float]], candidate: Candidate) -> list[list[str]]:
    """Return each limit with the predicted extremes."""
    rows = []
    for name, (low, high) in limits.items():
        allowed = f"{format_quantity(name, low)} ... {format_quantity(name, high)}"
        extremes = candidate.extremes.get(name, ())
        predicted = " ... ".join(format_quantity(name, x) for x in extremes)
        rows.append([name, allowed, predicted])
    return rows


def _budget_rows(plan: ProgrammePlan, number: int) -> list[list[str]]:
    """Return time and fuel of a card, and their sums up to the card."""
    row = {str(name): x for name, x in plan.order.to_dict("index")[number].items()}
    fuel = ["-", "-"]
    for k, key in enumerate(("fuel", "fuel_total")):
        if np.isfinite(row[key]):
            fuel[k] = f"{row[key]:.1f} kg"
    return [
        ["time", clock_text(row["time"]), clock_text(row["setup"]), clock_text(row["clock"])],
        ["fuel", fuel[0], "", fuel[1]],
    ]


def _instruct_pilot(
    manoeuvre: PlannedManoeuvre, signal: xr.Dataset | None, *, height: float
) -> str:
    """Return the instruction of a card; the height is that of a low pass or of a flare. [m]"""
    recovery = f"Then recover and trim for {max(manoeuvre.setup, BEHIND):.0f} s."
    if signal is None:
        quantity = _OF_KIND.get(manoeuvre.kind, manoeuvre.device)
        amplitude = ""
        if quantity:
            amplitude = format_quantity(quantity, manoeuvre.amplitude)
        text = _INSTRUCTIONS[manoeuvre.kind].format(
            a=amplitude,
            h=format_quantity("h_agl", height),
            t=manoeuvre.duration,
            d=manoeuvre.device,
        )
        return f"{text} {recovery}"
    patterns = []
    if manoeuvre.design is not None:
        for axis, table in manoeuvre.design.axis.items():
            if table.pattern:
                patterns.append(f"{axis} {table.pattern}")
    kind: str = manoeuvre.kind
    if patterns:
        kind = f"{kind} ({', '.join(patterns)})"
    controls = "all other controls fixed"
    if manoeuvre.feedback:
        controls = "a light hand keeps pitch attitude and bank"
    length = float(signal["time"][-1])
    return f"From trim: {kind} of {length:.0f} s, deflections from trim; {controls}. {recovery}"


def _axis_rows(signal: xr.Dataset, name: str) -> list[list[str]]:
    """Return peak, rate and file of each axis."""
    rows = []
    for axis in axes_of(signal):
        u = signal[axis].values
        peak = format_quantity(axis, float(np.abs(u).max()))
        rate = float(np.abs(np.diff(u)).max()) * float(signal.attrs["rate"])
        rows.append([axis, peak, f"{format_quantity(axis, rate)}/s", f"{name}.csv"])
    return rows


def _draw_input(signal: xr.Dataset) -> str:
    """Return the input over time, one panel per axis, as SVG."""
    names, time = axes_of(signal), signal["time"].values
    span = float(time[-1])
    height = _HIGH * len(names) + _BELOW
    x = _LEFT + (time / span) * (_WIDE - _LEFT - _RIGHT)
    elements = _draw_time_axis(span, height)
    for k, name in enumerate(names):
        elements += _draw_panel(name, x, signal[name].values, middle=_HIGH * (k + 0.5) + 2.0)
    style = 'font-family="Libertinus Serif" font-size="15"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE:g} {height:g}" '
        f"{style}>{''.join(elements)}</svg>"
    )


def _draw_time_axis(span: float, height: float) -> list[str]:
    """Return the vertical lines and the labels of the time."""
    tick = next(step for step in _TICKS if span / step <= _MOST_TICKS)
    elements = []
    for time in np.arange(0.0, span + 1e-9, tick):
        x = _LEFT + time / span * (_WIDE - _LEFT - _RIGHT)
        # the first label has the unit
        unit = " s" if time == 0.0 else ""
        elements.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="4" y2="{height - 22:.1f}" '
            f'stroke="#d0d0d0" stroke-width="0.7"/>'
        )
        elements.append(
            f'<text x="{x:.1f}" y="{height - 8:.1f}" text-anchor="middle">{time:g}{unit}</text>'
        )
    return elements


def _draw_panel(name: str, x: np.ndarray, u: np.ndarray, *, middle: float) -> list[str]:
    """Return zero line, curve and labels of one axis around a height."""
    # an axis without movement has a panel too
    peak = float(np.abs(u).max()) or 1.0
    y = middle - u / peak * (0.5 * _HIGH - 7.0)
    points = " ".join(f"{a:.1f},{b:.2f}" for a, b in zip(x, y, strict=True))
    return [
        f'<line x1="{_LEFT}" x2="{_WIDE - _RIGHT}" y1="{middle:.1f}" y2="{middle:.1f}" '
        f'stroke="#999999" stroke-width="0.7"/>',
        f'<polyline points="{points}" fill="none" stroke="#000000" stroke-width="1.6"/>',
        f'<text x="4" y="{middle - 3:.1f}">{name}</text><text x="4" '
        f'y="{middle + 15:.1f}">+-{format_quantity(name, peak)}</text>',
    ]
