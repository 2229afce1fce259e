"""Data of the plots of a case, for the script of the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from pom.report.case.panels import (
    CasePanel,
    Cross,
    panel_description,
)
from pom.report.presentation.quantities import QuantityLabel
from pom.report.presentation.traces import TIME_STEP, Pack, least_step, step_of
from pom.report.presentation.verdict_text import (
    criterion_words,
)
from pom.result import PomResult
from pom.status import has_departure, has_remark, has_trim_remark, is_on_faulty_record
from pom.tolerances.channels import plain_words


def plot_data(
    result: PomResult,
    panels: Sequence[CasePanel],
    crosses: Sequence[Cross],
    styles: Mapping[str, str],
) -> tuple[dict[str, Any], bytes]:
    """Return the description of the plots, and the packed traces that it refers to.

    Parameters
    ----------
    result : PomResult
    panels : sequence of CasePanel
    crosses : sequence of Cross
    styles : mapping of str to str
        Run to the class of its line.
    """
    pack = Pack.empty()
    rows = _verdict_rows(result)
    events = result.case.events.items()
    # The entries are evaluated in this order, which is that of the traces in the pack.
    head = {
        "time": pack.add(result.signals["time"].values, TIME_STEP),
        "runs": [{"name": run, "style": style} for run, style in styles.items()],
        "events": [[plain_words(name), instant] for name, instant in events],
        "fraction": result.case.fraction,
        "rows": rows,
        "panels": [_pack_panel(panel, pack, rows) for panel in panels],
        "crosses": [_pack_cross(cross, pack, rows) for cross in crosses],
    }
    return head, bytes(pack.body)


def _verdict_rows(result: PomResult) -> list[dict[str, Any]]:
    """Return the verdict rows, for a script that shows another share of the tolerance."""
    applying = {criterion.name for criterion in result.case.criteria if criterion.applies}
    rows = []
    for row in result.rows:
        ratio, fraction = row["worst_ratio"], row["fraction"]
        # JSON holds neither NaN nor infinity.
        rows.append(
            {
                "run": row["run"],
                "criterion": row["criterion"],
                "words": criterion_words(row["criterion"]),
                "measure": row["measure"],
                "channel": row["channel"],
                "group": row["group"],
                "applies": row["criterion"] in applying,
                "verdict": row["verdict"],
                "exceeds": has_trim_remark(row),
                "faulty": is_on_faulty_record(row),
                "refused": _refusal(row),
                "departs": has_departure(row),
                "ratio": ratio if math.isfinite(ratio) else None,
                "fraction": fraction if math.isfinite(fraction) else 1.0,
            }
        )
    return rows


def _refusal(row: Mapping[Any, Any]) -> str:
    """Return the status that takes a pass from a row at any share of the tolerance; or empty."""
    for status in ("not_driven", "leak"):
        if has_remark(row, status):
            return status
    return ""


def _describe_quantity(label: QuantityLabel) -> dict[str, str]:
    return {
        "channel": label.name,
        "base": "" if label.is_word else label.base,
        "sub": "" if label.is_word else label.sub,
        "words": label.words,
        "unit": label.unit,
    }


def _pack_panel(panel: CasePanel, pack: Pack, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the description of a panel, with its traces in `pack`."""
    drawn = [*panel.traces.values(), *chain.from_iterable(panel.fans.values())]
    if panel.half is not None:
        drawn.append(panel.half)
    # the tolerance can be any small part of a reading that is wrong
    step = max(step_of(panel.half, panel.limits), least_step(drawn))
    exits = {}
    for run, spans in panel.exits.items():
        if spans:
            exits[run] = [[round(start, 3), round(stop, 3)] for start, stop in spans]
    verdicts = []
    if panel.rows:
        for row in rows:
            if row["channel"] == panel.channel and row["measure"] == "trace":
                verdicts.append(row)
    # Order of the pack: traces, half width, quantiles.
    traces = {run: pack.add(values, step) for run, values in panel.traces.items()}
    half = None if panel.half is None else pack.add(panel.half, step)
    fans = {}
    for run, quantiles in panel.fans.items():
        for k, values in enumerate(quantiles):
            fans[f"{run} {k}"] = pack.add(values, step)
    return {
        **_describe_quantity(panel.label),
        "kind": panel.kind,
        "sign": panel.label.sign,
        "alt": panel_description(panel),
        "limits": [float(f"{edge:.6g}") for edge in panel.scale],
        "span": panel.label.least_span,
        "decimals": _decimals(step),
        "window": panel.window,
        "exits": exits,
        "verdicts": verdicts,
        "traces": traces,
        "half": half,
        "fans": fans,
        "values": [list(mark) for mark in panel.values],
        "mode": None if panel.mode is None else panel.mode._asdict(),
    }


def _decimals(step: float) -> int:
    return max(0, math.ceil(-math.log10(step * 5)))


def _pack_cross(cross: Cross, pack: Pack, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the description of a cross plot, with its traces in `pack`."""
    x_step, y_step = cross.steps
    return {
        "abscissa": _describe_quantity(cross.abscissa),
        "ordinate": _describe_quantity(cross.ordinate),
        "alt": cross.words,
        "verdicts": [row for row in rows if row["criterion"] in cross.criteria],
        "x": {run: pack.add(values, x_step) for run, values in cross.x.items()},
        "y": {run: pack.add(values, y_step) for run, values in cross.y.items()},
        "half": pack.add(cross.half, y_step),
    }
