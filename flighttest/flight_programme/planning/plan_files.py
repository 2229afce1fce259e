"""Test cards: one A5 page for every manoeuvre, as PDF, with condition, input, limits, abort
criteria, time and fuel.
"""

from __future__ import annotations

import datetime
import json
import os
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import ParseError, SchemaError
from flightmech.support.atomic_write import folder_written_atomically, write_text
from flighttest.flight_programme.input_design.input_signals import axes_of
from flighttest.flight_programme.input_design.timetable import save_csv, save_timetable
from flighttest.flight_programme.planning.catalogue import PlannedCondition, PlannedManoeuvre
from flighttest.flight_programme.planning.pilot import BEHIND
from flighttest.flight_programme.planning.plan import ProgrammePlan, clock_text, format_quantity
from flighttest.flight_programme.planning.prediction import Item

_TEMPLATE = Path(__file__).with_name("cards.typ")
_UNDATED = datetime.datetime(
    1970, 1, 1, tzinfo=datetime.UTC
)  # no clock is read: equal plans give equal bytes
_WIDE, _HIGH, _LEFT = 720.0, 74.0, 90.0  # of the drawing of one axis
_TRIM = {
    "init.alpha": "alpha",
    "init.theta": "theta",
    "delta_e": "delta_e",
    "delta_a": "delta_a",
    "delta_r": "delta_r",
}
_WORDS = {
    "sideslip": "From trim: rudder slowly to +{a}, hold, back; then to -{a}; {t:g} s each. "
    "Heading held with bank, height with elevator.",
    "pull_up_push_down": "From trim: the pitch attitude follows one sine of +-{a} in {t:g} s. "
    "Power fixed, wings level.",
    "level_speed": "Level: idle until the airspeed is {a} below trim, full power until it is {a} "
    "above, then hold. Height within 50 ft.",
    "device": "From trim: {d} to {a}, wait {t:g} s from the start, and back. Height, speed and "
    "heading held.",
}


def card_page(plan: ProgrammePlan, number: int, name: str) -> bytes:
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
        return typst.compile(
            str(place / "card.typ"),
            root=str(place),
            format="pdf",
            ignore_system_fonts=True,
            timestamp=_UNDATED,
        )
    except typst.TypstError as error:
        raise SchemaError("test cards", [f"typst: {error.message}"]) from error


def _content(plan: ProgrammePlan, number: int, name: str, place: Path) -> dict[str, Any]:
    prediction, item = plan.prediction, plan.items[number - 1]
    candidate, catalogue = prediction.candidates[item], prediction.catalogue
    condition: PlannedCondition = next(c for c in catalogue.condition if c.name == item[0])
    start, row = (
        prediction.trims[condition.name],
        {str(name): x for name, x in plan.order.to_dict("index")[number].items()},
    )
    limits = {**catalogue.limits, **condition.limits}
    signal = candidate.signal
    drawing = ""
    if signal is not None:
        drawing = "input.svg"
        (place / drawing).write_text(_drawing(signal), encoding="utf-8")
    fuel = [f"{x:.1f} kg" if np.isfinite(x) else "-" for x in (row["fuel"], row["fuel_total"])]
    levers = [
        f"{100.0 * start[key]:.0f} %"
        for key in start
        if key.endswith(".throttle") and key.startswith("engine")
    ]
    trim = [
        [key, format_quantity(key, float(start[source]))]
        for source, key in _TRIM.items()
        if source in start
    ]
    return {
        "title": f"Test card {number}: {item[1]}, {item[0]}",
        "programme": catalogue.title,
        "number": str(number),
        "count": str(len(plan.items)),
        "manoeuvre": item[1],
        "condition": item[0],
        "state": [[key, format_quantity(key, value)] for key, value in condition.fixed.items()],
        "trim": trim + ([["power levers", ", ".join(dict.fromkeys(levers))]] if levers else []),
        "instruction": _instruction(candidate.manoeuvre, signal),
        "axes": _axes(signal, name) if signal is not None else [],
        "drawing": drawing,
        "alt": f"Deflections from trim over time of {', '.join(axes_of(signal))}"
        if signal is not None
        else "",
        "limits": [
            [
                key,
                f"{format_quantity(key, low)} ... {format_quantity(key, high)}",
                " ... ".join(format_quantity(key, x) for x in candidate.extremes.get(key, ())),
            ]
            for key, (low, high) in limits.items()
        ],
        "binding": candidate.binding,
        "abort": [*catalogue.abort, *candidate.manoeuvre.abort] or ["any limit on this card"],
        "budget": [
            ["time", clock_text(row["time"]), clock_text(row["setup"]), clock_text(row["clock"])],
            ["fuel", fuel[0], "", fuel[1]],
        ],
    }


def _instruction(manoeuvre: PlannedManoeuvre, signal: xr.Dataset | None) -> str:
    if signal is None:
        of = {"sideslip": "delta_r", "pull_up_push_down": "theta", "level_speed": "V"}.get(
            manoeuvre.kind, manoeuvre.device
        )
        text = _WORDS[manoeuvre.kind].format(
            a=format_quantity(of, manoeuvre.amplitude), t=manoeuvre.duration, d=manoeuvre.device
        )
    else:
        steps = (
            ", ".join(
                f"{axis} {table.pattern}"
                for axis, table in manoeuvre.design.axis.items()
                if table.pattern
            )
            if manoeuvre.design
            else ""
        )
        held = (
            "all other controls fixed"
            if not manoeuvre.feedback
            else "a light hand keeps pitch attitude and bank"
        )
        length = float(signal["time"][-1])
        text = (
            f"From trim: {manoeuvre.kind}{f' ({steps})' if steps else ''} of {length:.0f} s, "
            f"deflections from trim; {held}."
        )
    return f"{text} Then recover and trim for {max(manoeuvre.setup, BEHIND):.0f} s."


def _axes(signal: xr.Dataset, name: str) -> list[list[str]]:
    rows = []
    for axis in axes_of(signal):
        u = signal[axis].values
        rate = float(np.abs(np.diff(u)).max()) * float(signal.attrs["rate"])
        rows.append(
            [
                axis,
                format_quantity(axis, float(np.abs(u).max())),
                f"{format_quantity(axis, rate)}/s",
                f"{name}.csv",
            ]
        )
    return rows


def _drawing(signal: xr.Dataset) -> str:
    """Return the input over time, one panel per axis, as SVG."""
    names, time = axes_of(signal), signal["time"].values
    span = float(time[-1])
    tick = next(
        step for step in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 500.0) if span / step <= 12.0
    )
    height = _HIGH * len(names) + 26.0
    x = _LEFT + (time / span) * (_WIDE - _LEFT - 8.0)
    body = []
    for at in np.arange(0.0, span + 1e-9, tick):
        place = _LEFT + at / span * (_WIDE - _LEFT - 8.0)
        body.append(
            f'<line x1="{place:.1f}" x2="{place:.1f}" y1="4" y2="{height - 22:.1f}" '
            f'stroke="#d0d0d0" stroke-width="0.7"/>'
        )
        body.append(
            f'<text x="{place:.1f}" y="{height - 8:.1f}" '
            f'text-anchor="middle">{at:g}{" s" if at == 0.0 else ""}</text>'
        )
    for k, name in enumerate(names):
        u = signal[name].values
        peak, middle = float(np.abs(u).max()) or 1.0, _HIGH * (k + 0.5) + 2.0
        y = middle - u / peak * (0.5 * _HIGH - 7.0)
        points = " ".join(f"{a:.1f},{b:.2f}" for a, b in zip(x, y, strict=True))
        body.append(
            f'<line x1="{_LEFT}" x2="{_WIDE - 8.0}" y1="{middle:.1f}" y2="{middle:.1f}" '
            f'stroke="#999999" stroke-width="0.7"/>'
        )
        body.append(
            f'<polyline points="{points}" fill="none" stroke="#000000" stroke-width="1.6"/>'
        )
        body.append(
            f'<text x="4" y="{middle - 3:.1f}">{name}</text><text x="4" '
            f'y="{middle + 15:.1f}">+-{format_quantity(name, peak)}</text>'
        )
    style = 'font-family="Libertinus Serif" font-size="15"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE:g} {height:g}" '
        f"{style}>{''.join(body)}</svg>"
    )


_OURS = ("order.csv", "nodes.csv", "expected.csv", "plan.txt", "inputs", "cards")


def save_plan(plan: ProgrammePlan, folder: str | os.PathLike) -> list[Path]:
    """Write a plan into a folder; what an earlier plan wrote there is replaced, other files stay.

    Parameters
    ----------
    plan : Plan
    folder : path
        Gets ``order.csv``, ``nodes.csv`` (the wanted ones), ``expected.csv`` (all nodes),
        ``plan.txt``, ``inputs/`` with a CSV file and a time table for every test input, and
        ``cards/`` with a PDF page for every manoeuvre.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    SchemaError
        Typst is not installed, or cannot set a card, with its words.
    """
    with folder_written_atomically(Path(folder), _OURS.__contains__) as part:
        plan.order.to_csv(part / "order.csv", float_format="%.6g")
        plan.nodes.to_csv(part / "nodes.csv", index=False, float_format="%.6g")
        expected_table(plan).to_csv(part / "expected.csv", index=False, float_format="%.6g")
        write_text(part / "plan.txt", plan.report() + "\n")
        (part / "inputs").mkdir()
        for number, item in enumerate(plan.items, 1):
            signal = plan.prediction.candidates[item].signal
            if signal is not None:
                save_csv(signal, part / "inputs" / f"{card_name(number, item)}.csv")
                moving = signal.drop_vars(
                    [
                        name
                        for name in signal.data_vars
                        if signal[name].dims == ("time",) and not signal[name].any()
                    ]
                )
                save_timetable(
                    moving, part / "inputs" / f"{card_name(number, item)}.table", ", ".join(item)
                )
        (part / "cards").mkdir()
        for number, item in enumerate(plan.items, 1):
            name = card_name(number, item)
            (part / "cards" / f"{name}.pdf").write_bytes(card_page(plan, number, name))
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())


def read_order(folder: str | os.PathLike) -> list[Item]:
    """Return condition and manoeuvre of the cards of a plan from its folder.

    Raises
    ------
    ParseError
        The folder holds no ``order.csv`` with columns ``condition`` and ``manoeuvre``.
    """
    file = Path(folder) / "order.csv"
    try:
        table = pd.read_csv(file, dtype=str)
        return list(zip(table["condition"], table["manoeuvre"], strict=True))
    except (OSError, ValueError, KeyError) as error:
        raise ParseError(
            str(file), 0, str(error), "the order of a plan as `aeromatch flight plan` writes it"
        ) from error


def card_name(number: int, item: Item) -> str:
    """Return the name of the files of a card, such as ``03_clean-cruise_multisine``."""
    return "_".join(
        [
            f"{number:02d}",
            *(re.sub(r"[^0-9A-Za-z]+", "-", part).strip("-").lower() for part in item),
        ]
    )


def expected_table(plan: ProgrammePlan) -> pd.DataFrame:
    """Return the expected standard errors of all nodes: ``term``, its axes as text, ``expected``."""
    rows = []
    for name, stderr in plan.expected.items():
        for place, value in np.ndenumerate(stderr):
            if np.isfinite(value):
                rows.append({"term": name, "place": " ".join(map(str, place)), "expected": value})
    return pd.DataFrame(rows, columns=["term", "place", "expected"])
