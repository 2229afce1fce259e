"""Texts of verdicts: words, symbols, and the rows of the table of tolerances."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pom.report.presentation.quantities import (
    MINUS,
    MISSING,
    SYMBOLS,
    fixed_decimals,
    format_number,
    percent_text,
    pretty_unit,
    quantity_label,
)
from pom.result import PomResult
from pom.tolerances.bands import ALLOWED, RowRemark

WORDS = {
    "pass": "pass",
    "limits_exceeded": "pass with limits exceeded",
    "record_error": "pass on a record with errors",
    "fail": "FAIL",
    "invalid": "invalid",
    "not_tested": "not tested",
    "advisory": "advisory",
}
# Source of a row that was not read word for word in the regulation.
MARKS = {"memory": "from memory", "partial": "read in part", "case file": "case file"}
MODAL = ("period", "t_half", "damping_ratio", "peak_lag")
_MEASURES = {
    "trace": "time history",
    "steady": "steady state",
    "end_value": "at the end of the window",
    "t_half": "fitted mode",
    "period": "fitted mode",
    "damping_ratio": "fitted mode",
    "peak_lag": "phase of the fitted mode",
    "response_initial": "time to 10 % of the change",
    "response_total": "time to 90 % of the change",
    "trend": "correct trend",
}


@dataclass(frozen=True)
class Verdict:
    """A verdict as written: word, symbol, class of its colour."""

    word: str
    symbol: str
    css: str

    @classmethod
    def of(cls, verdict: str) -> Verdict:
        """Return how `verdict` is written."""
        return cls(WORDS[verdict], SYMBOLS[verdict], f"is-{verdict}")


def criterion_words(name: str) -> str:
    """Return a criterion's name as words."""
    return name.replace("_", " ")


def remark_text(remark: RowRemark) -> str:
    """Return a remark as printed; one on the trim is named as in the table of the trim.

    Examples
    --------
    >>> remark_text(RowRemark("trim", "trim.delta_e -3.44 deg is beyond 2 deg", "delta_e", {"found": -3.44, "limit": 2.0}, "deg"))
    'elevator deflection biased by the trim: −3.44 deg, beyond 2 deg'
    """
    if remark.kind not in ("trim", "trim_allowed"):
        return remark.text
    name, unit = remark.quantity, "" if remark.unit == "1" else f" {remark.unit}"
    what = (
        quantity_label(f"trim.{name}").words
        if name.endswith("_dot")
        else f"{quantity_label(name).words or name} biased by the trim"
    )
    found, limit = remark.values["found"], remark.values["limit"]
    allowed = "".join(remark.text.partition(ALLOWED)[1:])
    return (
        f"{what}: {MINUS if found < 0.0 else '+'}{_three_digits(abs(found))}{unit}, beyond "
        f"{_three_digits(limit)}{unit}{allowed}"
    )


def _three_digits(value: float) -> str:
    """Return a number to three digits, without powers of ten."""
    text = f"{value:.3g}"
    return format_number(float(text)) if "e" in text else text


def reason_text(remarks: Sequence[RowRemark]) -> str:
    """Return why a row is not judged, or fails without a number: its first remark that is not of
    the values alone.

    Examples
    --------
    >>> reason_text([RowRemark("values", "flight 2.84 s"), RowRemark("no_mode", "the model: no oscillation stands out")])
    'the model: no oscillation stands out'
    """
    return next(
        (criterion_words(remark_text(remark)) for remark in remarks if remark.kind != "values"), ""
    )


def verdict_blocks(result: PomResult) -> dict[str, Any]:
    """Return one block per criterion with one row per model; alternatives of one group follow each
    other.
    """
    records: list[dict[Hashable, Any]] = [{**row, "index": i} for i, row in enumerate(result.rows)]
    applying = {c.name: c.group for c in result.case.criteria if c.applies}
    groups = list(dict.fromkeys(row["group"] for row in records))
    names = sorted(
        dict.fromkeys((row["group"], row["criterion"]) for row in records),
        key=lambda pair: groups.index(pair[0]),
    )
    blocks: list[dict[str, Any]] = []
    for group, name in names:
        rows = [row for row in records if row["criterion"] == name]
        first = next((row for row in rows if math.isfinite(row["width"])), rows[0])
        joint = list(applying.values()).count(group) > 1 and name in applying
        again = joint and any(block["group"] == group and block["joint"] for block in blocks)
        blocks.append(
            {
                "criterion": criterion_words(name),
                "group": group,
                "joint": "" if not joint else "or" if again else "either",
                "label": quantity_label(first["channel"]) if first["channel"] else None,
                "measure": _MEASURES.get(first["measure"], criterion_words(first["measure"])),
                "printed": first["tolerance_text"],
                "applied": first["applied_text"] or _applied(result, first),
                "window": f"{fixed_decimals(first['window_start'], 2)} … "
                f"{fixed_decimals(first['window_stop'], 2)}",
                "mark": MARKS.get(first["provenance"], ""),
                "rows": [_verdict_row(row) for row in rows],
                "left_out": "" if name in applying else reason_text(rows[0]["remarks"]),
            }
        )
    judged = [block for block in blocks if not block["left_out"]]
    left_out = [block for block in blocks if block["left_out"]]
    # The columns of the values are shown if one row has a value.
    has_values = False
    for block in judged:
        has_values = has_values or any(row["has_value"] for row in block["rows"])
    return {"blocks": judged, "left_out": left_out, "values": has_values}


def _verdict_row(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    # A mode is of the whole window, not of an instant.
    instant = math.nan if row["measure"] in MODAL else float(row["at"])
    return {
        "index": row["index"],
        "run": row["run"],
        "has_value": math.isfinite(row["flight_value"]),
        "flight": _sized(row["flight_value"], row),
        "model": _sized(row["model_value"], row),
        "worst": _sized(row["worst"], row, with_unit=True),
        "at": instant,
        "at_text": fixed_decimals(instant, 2),
        "ratio": fixed_decimals(row["worst_ratio"], 2),
        "inside": percent_text(row["inside"]),
        "exit": float(row["first_exit"]),
        "exit_text": fixed_decimals(row["first_exit"], 2),
        "verdict": Verdict.of(row["verdict"]),
    }


def _sized(value: float, row: Mapping[Hashable, Any], with_unit: bool = False) -> str:
    """Return a number in the unit of the table, with decimals to a hundredth of the tolerance."""
    if not math.isfinite(value):
        return MISSING
    resolved = math.isfinite(row["width"]) and row["width"] > 0.0
    text = (
        fixed_decimals(value, max(0, math.ceil(2.0 - math.log10(row["width"]))))
        if resolved
        else format_number(value)
    )
    return f"{text} {pretty_unit(row['unit'])}".strip() if with_unit else text


def _applied(result: PomResult, row: Mapping[Hashable, Any]) -> str:
    """Return the half width as applied; a width that follows the flight value shows its range."""
    if not math.isfinite(row["width"]):
        return MISSING
    unit = pretty_unit(row["unit"])
    text = format_number(row["width"])
    if row["channel"] in result.tolerance and row["measure"] == "trace":
        half = result.tolerance[row["channel"]].values
        half = half[np.isfinite(half) & (half > 0)]
        if len(half) and half.max() > 1.005 * half.min():
            text += f" … {format_number(row['width'] * half.max() / half.min())}"
    return f"± {text} {unit}".strip()
