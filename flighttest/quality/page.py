"""The quality of a record as one HTML page that needs nothing else."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import ChoiceLoader, PackageLoader, Template
from markupsafe import Markup

from flightmech.names import lookup
from flightmech.support.atomic_write import write_text
from flightmech.support.svg_chart import stretches
from flightmech.support.templates import environment
from flightmech.units import from_si

from .checks.control_response import SIGNIFICANT
from .plots import chart
from .text import meaningful, shown

if TYPE_CHECKING:
    from .checks.relations import Comparison
    from .result import Quality

_HISTORIES = (
    "h_baro", "V", "alpha_vane", "beta_vane", "phi", "theta", "psi", "p", "q", "r", "ax_imu", "ay_imu", "az_imu",
    "delta_e", "delta_a", "delta_r", "engine1.throttle", "engine1.n1",
)  # fmt: skip
_HERE = "flighttest.quality"
_MINUTE = 60.0  # s
_MISTAKES = ("sign", "unit", "axis", "definition")
_AIR_DATA = ("airspeed", "mach", "mach_pressure", "calibrated", "altitude")  # exact: the table states it all unless they disagree


def template_of(package: str) -> Template:
    """Return the template ``page.html`` of a package; the frame around it is the same for all."""
    return environment(ChoiceLoader([PackageLoader(package, ""), PackageLoader(_HERE, "")])).get_template("page.html")


def style() -> Markup:
    """Return the style sheet of the pages of this package."""
    return Markup(files(_HERE).joinpath("style.css").read_text(encoding="utf-8"))  # our own file


def write_page(quality: Quality, path: str | Path) -> None:
    """Write the quality of a record as one self-contained HTML page; an error leaves no file."""
    write_text(path, page(quality))


def page(quality: Quality) -> str:
    """Return the page as text."""
    template = template_of("flighttest.quality")
    grade = "error" if not quality.usable else "warning" if quality.count("warning") else "good"
    return template.render(
        style=style(),
        facts=quality.facts,
        verdict=quality.verdict,
        grade=grade,
        findings=quality.findings,
        mistakes=any(finding.kind in _MISTAKES for finding in quality.findings),
        histories=[_history(quality, name) for name in _HISTORIES if name in quality.signals],
        kinematics=[_kinematic(row) for row in quality.kinematics.to_dict("records")],
        as_read=[_comparison(quality.as_read[name]) for name in _broken(quality)],
        comparisons=[_comparison(c) for name, c in quality.comparisons.items() if _worth_seeing(name, c)],
        not_checked=quality.not_checked.to_dict("records"),
        delays=quality.delays.to_dict("records"),
        answers=[_answer(row) for row in quality.answers.to_dict("records")],
        excitation=[_excited(row) for row in quality.excitation.to_dict("records")],
        correlation=_matrix(quality),
        channels=[_channel(row) for row in quality.channels.to_dict("records")],
    )


def _history(quality: Quality, name: str) -> dict[str, Any]:
    signals, row = quality.signals, lookup(name)
    spans = [(f.start, f.stop) for f in quality.findings if name in f.channels and f.start is not None and f.stop is not None]
    faulty = _spans(signals.time, ~signals.good[name])
    x = from_si(np.where(signals.good[name] | (signals[name] != 0.0), signals[name], np.nan), row.display_units)
    picture = chart(signals.time, [x], row.display_units, _spans(signals.time, ~signals.flying), [*spans, *faulty], f"{name} over time")
    return {"title": f"{name}: {row.long_name}", "svg": picture}


def _worth_seeing(name: str, c: Comparison) -> bool:
    return not c.consistent or (name not in _AIR_DATA and meaningful(c.moving, c.correlation))


def _broken(quality: Quality) -> list[str]:
    """Return the relations that did not hold as read, the worst first, at most four."""
    broken = [name for name, c in quality.as_read.items() if not c.consistent]
    return sorted(broken, key=lambda name: -quality.as_read[name].disagreement)[:4]


def _comparison(c: Comparison) -> dict[str, Any]:
    """Both sides over the minute in which they move most."""
    units = {"rad": "deg", "rad s-1": "deg/s"}.get(c.relation.units, c.relation.units)
    step = c.time[1] - c.time[0]
    width = min(round(_MINUTE / step), len(c.time))
    y = np.where(c.mask, np.abs(c.second - c.second[c.mask].mean()) + np.abs(c.first - c.first[c.mask].mean()), 0.0)
    energy = np.convolve(y**2, np.ones(width), mode="valid")
    first = int(np.argmax(energy))
    window = slice(first, first + width)
    lines = [from_si(np.where(c.mask, side, np.nan)[window], units) for side in (c.first, c.second)]
    return {"title": c.relation.title, "svg": chart(c.time[window], lines, units, label=c.relation.title)}


def _kinematic(row) -> dict[str, Any]:
    texts = {f"{name}_text": shown(row[name], row["units"]) for name in ("offset", "rms")}
    return {**row, **texts, "meaningful": meaningful(row["moving"], row["correlation"])}


def _answer(row) -> dict[str, Any]:
    significant = abs(row["ratio"]) >= SIGNIFICANT
    right = "as it should be" if row["effect"] < 0.0 else "wrong" if row["sign"] > 0 else "wrong, or another time"
    return {**row, "answer": right if significant else "not seen"}


def _excited(row) -> dict[str, Any]:
    return {**row, "input_deg": np.degrees(row["input"]), "response_deg": np.degrees(row["response"])}


def _matrix(quality: Quality) -> dict[str, Any] | None:
    if quality.correlation.empty:
        return None
    names = [str(name) for name in quality.correlation.columns]
    rows = [{"name": name, "values": values} for name, values in zip(names, quality.correlation.to_numpy().tolist())]
    return {"names": names, "rows": rows}


def _channel(row) -> dict[str, Any]:
    display = lookup(row["channel"]).display_units
    spread = {"degC": "K"}.get(display, display)

    def text(value: float, units: str) -> str:
        return f"{from_si(value, units):.4g}" if np.isfinite(value) else ""

    detail = {"low": text(row["minimum"], display), "high": text(row["maximum"], display), "noise_text": text(row["noise"], spread)}
    return {**row, **detail, "display": display}


def _spans(time: np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    return [(float(time[a]), float(time[b - 1])) for a, b in stretches(mask)]
