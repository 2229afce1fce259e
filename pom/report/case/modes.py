"""The table of modes: period, time to half, damping and cycles of flight and models, by the fits that the verdicts use."""

from __future__ import annotations

from typing import Any

import pandas as pd

from pom.result import PomResult, records

from ..presentation.quantities import MISSING, fixed, label, number


def mode_table(result: PomResult, modes: pd.DataFrame, styles: dict[str, str]) -> list[dict[str, Any]]:
    """Return one block per fitted channel and window, flight first."""
    fitted: dict[tuple[str, float, float], list[dict[Any, Any]]] = {}
    for row in records(modes):
        fitted.setdefault((str(row["channel"]), row["window_start"], row["window_stop"]), []).append(row)
    blocks = []
    for (channel, start, stop), fits in fitted.items():
        shown = label(channel)
        blocks.append(
            {
                "label": shown,
                "window": f"{fixed(start, 2)} … {fixed(stop, 2)}",
                "lags": any(row["lag"] == row["lag"] for row in fits),
                "rows": [_row(row, shown, styles) for row in fits],
            }
        )
    return blocks


def _row(row: dict[Any, Any], shown, styles: dict[str, str]) -> dict[str, Any]:
    half = row["t_half"]
    return {
        "run": row["run"],
        "style": styles[row["run"]],
        "period": fixed(row["period"], 2),
        "t_half": MISSING if half != half else f"{fixed(abs(half), 2)}{' to double' if half < 0 else ''}",
        "damping": fixed(row["damping_ratio"], 4),
        "cycles": fixed(row["cycles"], 1),
        "amplitude": number(float(shown.width(row["amplitude"])), 3),
        "residual": number(float(shown.width(row["residual_rms"])), 2),
        "lag": fixed(row["lag"], 2),
        "note": row["note"],
    }
