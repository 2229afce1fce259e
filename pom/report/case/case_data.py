"""What the script needs to draw a case: panels, cross plots and verdict rows, with their traces in one block of bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pom.result import PomResult, exceeds, is_on_faulty_record

from ..presentation.quantities import Label
from ..presentation.traces import TIME_STEP, Pack, step_of
from ..presentation.verdict_text import words
from .cross_plots import Cross
from .panels import Panel, description


def data(result: PomResult, panels: Sequence[Panel], crosses: Sequence[Cross], styles: Mapping[str, str]) -> tuple[dict[str, Any], bytes]:
    """Return the description of the plots, and the traces it points into."""
    pack = Pack.empty()
    rows = _rows(result)
    head = {
        "time": pack.add(result.signals["time"].values, TIME_STEP),
        "runs": [{"name": run, "style": style} for run, style in styles.items()],
        "events": [[words(name), at] for name, at in result.case.events.items()],
        "fraction": result.case.fraction,
        "rows": rows,
        "panels": [_panel(panel, pack, rows) for panel in panels],
        "crosses": [_cross(cross, pack, rows) for cross in crosses],
    }
    return head, bytes(pack.body)


def _rows(result: PomResult) -> list[dict[str, Any]]:
    """Return the verdict rows as the script needs them to show another share of the tolerance."""
    applying = {c.name for c in result.case.criteria if c.applies}
    return [
        {
            "run": row["run"],
            "criterion": row["criterion"],
            "words": words(row["criterion"]),
            "measure": row["measure"],
            "channel": row["channel"],
            "group": row["group"],
            "applies": row["criterion"] in applying,
            "verdict": row["verdict"],
            "exceeds": exceeds(row),
            "faulty": is_on_faulty_record(row),
            "ratio": row["worst_ratio"] if math.isfinite(row["worst_ratio"]) else None,
            "fraction": row["fraction"] if math.isfinite(row["fraction"]) else 1.0,
        }
        for row in result.rows
    ]


def _quantity(shown: Label) -> dict[str, str]:
    symbol = ("", "") if shown.is_word else (shown.base, shown.sub)
    return {"channel": shown.name, "base": symbol[0], "sub": symbol[1], "words": shown.words, "unit": shown.unit}


def _panel(panel: Panel, pack: Pack, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    step = step_of(panel.half, panel.limits)
    return {
        **_quantity(panel.label),
        "kind": panel.kind,
        "sign": panel.label.sign,
        "alt": description(panel),
        "limits": [float(f"{edge:.6g}") for edge in panel.scale],
        "span": panel.label.least_span,
        "decimals": _decimals(step),
        "window": panel.window,
        "exits": {run: [[round(t, 3) for t in span] for span in found] for run, found in panel.exits.items() if found},
        "verdicts": [row for row in rows if row["channel"] == panel.channel and row["measure"] == "trace"] if panel.rows else [],
        "traces": {run: pack.add(values, step) for run, values in panel.traces.items()},
        "half": None if panel.half is None else pack.add(panel.half, step),
        "fans": {f"{run} {k}": pack.add(values, step) for run, fan in panel.fans.items() for k, values in enumerate(fan)},
    }


def _decimals(step: float) -> int:
    return max(0, math.ceil(-math.log10(step * 5)))


def _cross(cross: Cross, pack: Pack, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    x_step, y_step = cross.steps
    return {
        "abscissa": _quantity(cross.abscissa),
        "ordinate": _quantity(cross.ordinate),
        "alt": cross.words,
        "verdicts": [row for row in rows if row["criterion"] in cross.criteria],
        "x": {run: pack.add(values, x_step) for run, values in cross.x.items()},
        "y": {run: pack.add(values, y_step) for run, values in cross.y.items()},
        "half": pack.add(cross.half, y_step),
    }
