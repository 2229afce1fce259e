"""Texts of verdicts: words, symbols, and the rows of the table of tolerances."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pom.judging.departures import printed_texts
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
from pom.report.presentation.unit_sets import units_in_text
from pom.result import PomResult
from pom.tolerances.bands import ALLOWED, RowRemark
from pom.tolerances.channels import plain_words

WORDS = {
    "pass": "pass",
    "pass_with_departures": "pass with departures",
    "limits_exceeded": "pass with limits exceeded",
    "record_error": "pass on a record with errors",
    "leak": "LEAK: the record identified the model",
    "not_driven": "NOT DRIVEN by the inputs",
    "demonstration": "shown, no tolerance",
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
    "demonstration": "demonstration",
    "vibration": "peaks of the spectrum",
}


@dataclass(frozen=True)
class Verdict:
    """Printed form of a verdict: word, symbol, class of its colour."""

    word: str
    symbol: str
    css: str

    @classmethod
    def of(cls, verdict: str) -> Verdict:
        """Return the printed form of a verdict."""
        return cls(WORDS[verdict], SYMBOLS[verdict], f"is-{verdict}")


def criterion_words(name: str) -> str:
    """Return a criterion's name as words; a symbol has the words of its signal.

    Examples
    --------
    >>> criterion_words("r"), criterion_words("angle_of_attack")
    ('body yaw rate', 'angle of attack')
    """
    label = quantity_label(name)
    return label.words if label.words and not label.is_word else plain_words(name)


def remark_text(remark: RowRemark) -> str:
    """Return a remark as printed; a remark on the trim has the words of the table of the trim.

    Examples
    --------
    >>> values = {"found": -3.44, "limit": 2.0}
    >>> text = "trim.delta_e -3.44 deg is beyond 2 deg"
    >>> remark_text(RowRemark("trim", text, "delta_e", values, "deg"))
    'elevator deflection biased by the trim: −3.44 deg, beyond 2 deg'
    """
    if remark.kind not in ("trim", "trim_allowed"):
        # a note of the tolerance table stays as printed
        return remark.text if remark.kind == "row" else units_in_text(remark.text)
    name, unit = remark.quantity, "" if remark.unit == "1" else f" {remark.unit}"
    if name.endswith("_dot"):
        quantity = quantity_label(f"trim.{name}").words
    else:
        quantity = f"{quantity_label(name).words or name} biased by the trim"
    value, limit = remark.values["found"], _three_digits(remark.values["limit"])
    sign = MINUS if value < 0.0 else "+"
    # The text of the remark ends with the words of a limit that the case file allows.
    allowed = "".join(remark.text.partition(ALLOWED)[1:])
    text = f"{quantity}: {sign}{_three_digits(abs(value))}{unit}, beyond {limit}{unit}{allowed}"
    return units_in_text(text)


def _three_digits(value: float) -> str:
    """Return a number to three digits, without powers of ten."""
    text = f"{value:.3g}"
    return format_number(float(text)) if "e" in text else text


def reason_text(remarks: Sequence[RowRemark]) -> str:
    """Return why a row is not judged, or why it fails without a number.

    It is the first remark that is not on values alone; empty without such a remark.

    Examples
    --------
    >>> values = RowRemark("values", "flight 2.84 s")
    >>> reason_text([values, RowRemark("no_mode", "the model: no oscillation stands out")])
    'the model: no oscillation stands out'
    """
    for remark in remarks:
        if remark.kind != "values":
            return plain_words(remark_text(remark))
    return ""


def verdict_blocks(result: PomResult) -> dict[str, Any]:
    """Return one block per criterion with one row per model.

    Alternatives of one group follow each other.

    Returns
    -------
    dict
        ``blocks`` of judged criteria, criteria that are ``left_out``, and whether a row has
        ``values``.
    """
    group_by_name = {c.name: c.group for c in result.case.criteria if c.applies}
    # Number of criteria of every group that apply; several of them are alternatives.
    group_sizes = Counter(group_by_name.values())
    rows_by_criterion = _group_rows(result)
    printed = printed_texts(result.case)
    judged: list[dict[str, Any]] = []
    left_out: list[dict[str, Any]] = []
    has_values = False
    begun_groups = set()
    for (group, name), rows in rows_by_criterion.items():
        block = _verdict_block(result, name, rows)
        if name in printed:
            # the printed row stands next to the one that the case file applies
            own = f"{block['printed']} by the case file"
            block["printed"] = printed[name] or "number not read"
            block["applied"] = f"{own}: {block['applied']}"
        block["group"] = group
        if name not in group_by_name:
            block["left_out"] = reason_text(rows[0]["remarks"])
        elif group_sizes[group] > 1:
            block["joint"] = "or" if group in begun_groups else "either"
            begun_groups.add(group)
        if block["left_out"]:
            left_out.append(block)
            continue
        judged.append(block)
        # The columns of the values are printed if one row has a value.
        has_values = has_values or any(row["has_value"] for row in block["rows"])
    return {"blocks": judged, "left_out": left_out, "values": has_values}


def _group_rows(
    result: PomResult,
) -> dict[tuple[str, str], list[dict[Hashable, Any]]]:
    """Return the verdict rows by group and criterion, with the groups in order of appearance."""
    rows_by_criterion: dict[tuple[str, str], list[dict[Hashable, Any]]] = {}
    for i, row in enumerate(result.rows):
        key = (row["group"], row["criterion"])
        rows_by_criterion.setdefault(key, []).append({**row, "index": i})
    # Criteria of a group may be apart in the table of verdicts.
    groups = list(dict.fromkeys([group for group, _ in rows_by_criterion]))
    keys = sorted(rows_by_criterion, key=lambda key: groups.index(key[0]))
    return {key: rows_by_criterion[key] for key in keys}


def _verdict_block(
    result: PomResult, name: str, rows: Sequence[Mapping[Hashable, Any]]
) -> dict[str, Any]:
    """Return the block of one criterion; its tolerance is that of the first row with a width."""
    first = rows[0]
    for row in rows:
        if math.isfinite(row["width"]):
            first = row
            break
    start, stop = first["window_start"], first["window_stop"]
    return {
        "criterion": criterion_words(name),
        "joint": "",
        "label": quantity_label(first["channel"]) if first["channel"] else None,
        "measure": _MEASURES.get(first["measure"], plain_words(first["measure"])),
        "printed": first["tolerance_text"],
        "applied": first["applied_text"] or _applied_text(result, first),
        "window": f"{fixed_decimals(start, 2)} … {fixed_decimals(stop, 2)}",
        "mark": MARKS.get(first["provenance"], ""),
        "rows": [_verdict_row(row) for row in rows],
        "left_out": "",
    }


def _verdict_row(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    # A mode is of the whole window, not of an instant.
    instant = math.nan if row["measure"] in MODAL else float(row["at"])
    return {
        "index": row["index"],
        "run": row["run"],
        "has_value": math.isfinite(row["flight_value"]),
        "flight": _value_text(row["flight_value"], row),
        "model": _value_text(row["model_value"], row),
        "worst": _value_text(row["worst"], row, with_unit=True),
        "at": instant,
        "at_text": fixed_decimals(instant, 2),
        "ratio": fixed_decimals(row["worst_ratio"], 2),
        "inside": percent_text(row["inside"]),
        "exit": float(row["first_exit"]),
        "exit_text": fixed_decimals(row["first_exit"], 2),
        "verdict": Verdict.of(row["verdict"]),
    }


def _value_text(value: float, row: Mapping[Hashable, Any], with_unit: bool = False) -> str:
    """Return a number in the unit of the table, with decimals to a hundredth of the tolerance."""
    if not math.isfinite(value):
        return MISSING
    width = row["width"]
    if math.isfinite(width) and width > 0.0:
        text = fixed_decimals(value, max(0, math.ceil(2.0 - math.log10(width))))
    else:
        text = format_number(value)
    return f"{text} {pretty_unit(row['unit'])}".strip() if with_unit else text


def _applied_text(result: PomResult, row: Mapping[Hashable, Any]) -> str:
    """Return the half width as applied; a width that depends on the flight value as a range."""
    if not math.isfinite(row["width"]):
        return MISSING
    text = format_number(row["width"])
    if row["channel"] in result.tolerance and row["measure"] == "trace":
        half = result.tolerance[row["channel"]].values
        half = half[np.isfinite(half) & (half > 0)]
        # The width of the row is the smallest one.  Rounding errors are not a range.
        if len(half) and half.max() > 1.005 * half.min():
            text += f" … {format_number(row['width'] * half.max() / half.min())}"
    return f"± {text} {pretty_unit(row['unit'])}".strip()
