"""Texts next to the verdicts: what the case sets, remarks of rows, rationales, engineers' ticks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from flightmech.names import lookup
from flightmech.units import from_si
from pom.cases.case import PomCase
from pom.cases.resolve import LIMIT_UNITS
from pom.replaying.run_remarks import drift, pilot_activity
from pom.replaying.trim import FOUND, LEFT, SHOWN_UNITS, result_trim_limits
from pom.report.presentation.quantities import (
    MISSING,
    fixed_decimals,
    format_number,
    has_ends,
    measured_text,
    quantity_label,
    short_number,
)
from pom.report.presentation.verdict_text import MARKS, MODAL, criterion_words, remark_text
from pom.result import PomResult, to_records
from pom.samples import SampledReplay
from pom.tolerances.rows import tolerance_rows


def mode_blocks(
    result: PomResult, modes: pd.DataFrame, styles: dict[str, str]
) -> list[dict[str, Any]]:
    """Return one block per fitted channel and window, flight first."""
    fitted: dict[tuple[str, float, float], list[dict[Any, Any]]] = {}
    for row in to_records(modes):
        fitted.setdefault(
            (str(row["channel"]), row["window_start"], row["window_stop"]), []
        ).append(row)
    blocks = []
    for (channel, start, stop), fits in fitted.items():
        shown = quantity_label(channel)
        blocks.append(
            {
                "label": shown,
                "window": f"{fixed_decimals(start, 2)} … {fixed_decimals(stop, 2)}",
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
        "period": fixed_decimals(row["period"], 2),
        "t_half": MISSING
        if half != half
        else f"{fixed_decimals(abs(half), 2)}{' to double' if half < 0 else ''}",
        "damping": fixed_decimals(row["damping_ratio"], 4),
        "cycles": fixed_decimals(row["cycles"], 1),
        "amplitude": format_number(float(shown.width(row["amplitude"])), 3),
        "residual": format_number(float(shown.width(row["residual_rms"])), 2),
        "lag": fixed_decimals(row["lag"], 2),
        "note": row["note"],
    }


SOURCES = 4
"""Printed of one criterion."""


def probability_table(result: PomResult) -> list[dict[str, Any]]:
    """Return one block per sampled model: its line, and one row per criterion that is judged."""
    return [_block(run, samples) for run, samples in result.samples.items()]


def _block(run: str, samples: SampledReplay) -> dict[str, Any]:
    return {
        "run": run,
        "draws": samples.count,
        "seed": samples.seed,
        "database": samples.database,
        "probability": probability_text(samples),
        "ratio": spread_text(samples),
        "rows": [
            {
                "criterion": criterion_words(name),
                "probability": fixed_decimals(samples.passing(name), 3),
                "ratio": spread_text(samples, name),
                "sources": dominant_sources_text(samples, name),
            }
            for name in map(str, samples.ratio.columns)
        ],
    }


def probability_text(samples: SampledReplay) -> str:
    """Return the probability of a pass with its standard error from the number of draws."""
    return f"{fixed_decimals(samples.probability, 3)} ± {fixed_decimals(samples.stderr, 3)}"


def spread_text(samples: SampledReplay, criterion: str = "") -> str:
    """Return the median of the ratio and its quantiles 5 and 95 %."""
    low, middle, high = samples.spread(criterion)
    return f"{fixed_decimals(middle, 2)} ({fixed_decimals(low, 2)} … {fixed_decimals(high, 2)})"


def dominant_sources_text(samples: SampledReplay, criterion: str, most: int = SOURCES) -> str:
    """Return the terms and instruments whose errors make most of the spread, with their shares."""
    return ", ".join(
        f"{source} {100.0 * share:.0f} %" for source, share in samples.dominant(criterion, most)
    )


IN_MODE_TABLE = ("values", "cycles", "no_mode")
"""Kinds of remarks that only repeat what stands in the table of modes."""

_REFERENCES = {
    "engineering": "The reference is an engineering simulator, not a flight; {share} of the "
    "flight tolerance is applied.",
    "footprint": "Footprint: the response of the device itself, kept for later comparison; no "
    "band is drawn and nothing is judged.",
}


def reader_notes(result: PomResult) -> list[str]:
    """Return the notes to the reader in addition to the verdicts, each once."""
    case = result.case
    notes = [case.notes] if case.notes else []
    if case.reference in _REFERENCES:
        notes.append(_REFERENCES[case.reference].format(share=fraction_text(case.fraction)))
    elif case.fraction != 1.0:
        notes.append(
            f"{fraction_text(case.fraction)} of the tolerance is applied, as the case file states."
        )
    if case.shortened:
        notes.append(f"The window is shorter than the table requires: {case.shortened}.")
    if case.conditions:
        conditions = []
        for name, value in case.conditions.items():
            conditions.append(f"{quantity_label(name).words or name} {_given(value, name)}")
        notes.append(f"From the case file, not from the record: {', '.join(conditions)}.")
    for row in result.rows:
        notes += [remark.text for remark in row["remarks"] if remark.kind == "record"]
    notes += _of_rows(result)
    marks = sorted({MARKS[p] for p in result.verdict["provenance"] if p in ("memory", "partial")})
    if marks:
        notes.append(
            f"Rows marked “{'” or “'.join(marks)}” were not read word for word in the "
            f"regulation; check them there first."
        )
    # A dictionary keeps the order and drops repeated notes.
    return list(dict.fromkeys(notes))


def case_objective(case: PomCase) -> str:
    """Return the objective of a case: that of the case file, else what its entry of the tolerance
    table compares.
    """
    if case.objective:
        return case.objective
    judged = ", ".join(
        dict.fromkeys(
            criterion_words(criterion.name) for criterion in case.criteria if criterion.applies
        )
    )
    title = next(
        (
            row["title"]
            for row in tolerance_rows()
            if (row["standard"], row["test_id"]) == (case.standard, case.id)
        ),
        case.title,
    )
    if case.reference == "footprint":
        return f"{title}: {judged} of the device, kept for later comparison."
    other = "an engineering simulator" if case.reference == "engineering" else "flight"
    return f"{title}: {judged} of the models against {other}, within the tolerances of {case.id}."


def fraction_text(fraction: float) -> str:
    """Return a fraction of the tolerance as printed.

    Examples
    --------
    >>> fraction_text(0.2)
    '20 %'
    """
    return f"{short_number(100.0 * fraction)} %"


def _of_rows(result: PomResult) -> list[str]:
    """Return the remarks of the verdict rows, each once, behind the criteria and models it is
    about.
    """
    places: dict[str, list[tuple[str, str]]] = {}
    longest: dict[str, list[str]] = {}
    for row in result.rows:
        fitted = row["measure"] in MODAL and row["verdict"] in ("pass", "fail")
        for remark in row["remarks"]:
            if remark.kind == "outside":
                longest.setdefault(row["run"], []).append(
                    f"{criterion_words(row['criterion'])} {remark.values['longest']:.2f} s"
                )
            elif remark.kind != "record" and not (fitted and remark.kind in IN_MODE_TABLE):
                places.setdefault(remark_text(remark), []).append(
                    (criterion_words(row["criterion"]), row["run"])
                )
    found: dict[str, list[str]] = {}
    for text, where in places.items():
        found.setdefault(_where(where, result), []).append(text)
    spans = [f"{run}, longest run outside: {', '.join(texts)}" for run, texts in longest.items()]
    return [*spans, *(f"{where}: {'; '.join(texts)}" for where, texts in found.items())]


def _given(value: float, name: str) -> str:
    """Return a value as somebody set it, without trailing zeros."""
    shown = quantity_label(name)
    if has_ends(name):
        return measured_text(value, name)
    return f"{short_number(float(shown.shown(value)))}\N{NO-BREAK SPACE}{shown.unit}".rstrip(
        "\N{NO-BREAK SPACE}"
    )


def _where(found: Sequence[tuple[str, str]], result: PomResult) -> str:
    """Return what a remark is about: criteria and models, each left out when it is all of them."""
    criteria, runs = (
        list(dict.fromkeys(c for c, _ in found)),
        list(dict.fromkeys(r for _, r in found)),
    )
    every = len(criteria) == result.verdict["criterion"].nunique() and len(runs) < len(result.runs)
    parts = ([] if every else criteria) + ([] if len(runs) == len(result.runs) else runs)
    return ", ".join(parts or criteria)


def rationale_rows(result: PomResult) -> list[tuple[str, str]]:
    """Return how the case file explains criteria or channels: (what, why)."""
    return [
        (quantity_label(name).words or criterion_words(name), why)
        for name, why in result.case.rationale.items()
    ]


def tick_rows(result: PomResult) -> list[dict[str, Any]]:
    """Return the criteria that an engineer judges, with the tick of the case file where there is
    one.
    """
    wanted = result.verdict.loc[result.verdict["verdict"] == "advisory", "criterion"]
    names = dict.fromkeys([*wanted, *result.case.ticks])
    return [
        {"criterion": criterion_words(name), "tick": result.case.ticks.get(name, "")}
        for name in names
    ]


def data_source(result: PomResult) -> list[tuple[str, str]]:
    """Return where the flight data come from, and how fast they were sampled: (what, words)."""
    time = result.signals["time"].values
    rate = (len(time) - 1) / (time[-1] - time[0])
    return [
        *((criterion_words(key), text) for key, text in result.case.source.items()),
        ("samples", f"{len(time)} at {short_number(rate, 3)} per second"),
    ]


_RATES = ("V_cas", "h", "psi")


def sampled_line(result: PomResult, run: str) -> str:
    """Return what the draws of a model show of a case, in one line: probability, spread, and what
    makes that of the deciding criterion.
    """
    samples, worst = result.samples[run], result.worst(run)
    decides = str(worst["criterion"]) if worst is not None else ""
    made = dominant_sources_text(samples, decides, 3) if decides in samples.ratio else ""
    text = (
        f"probability of a pass {probability_text(samples)} ({samples.count} draws), ratio "
        f"{spread_text(samples)}"
    )
    return f"{text}; {decides}: {made}" if made else text


def run_notes(result: PomResult, run: str) -> list[str]:
    """Return the lines of a run: ``trim ...``, ``pilot ...`` for every control that a math pilot
    moved, ``drift ...``.
    """
    return [
        line for line in (_trim(result, run), *_pilot(result, run), _drift(result, run)) if line
    ]


def _trim(result: PomResult, run: str) -> str:
    limits = result_trim_limits(result)
    words = []
    trim = result.trim[run].dropna().to_dict()
    for quantity in (name for name in (*FOUND, *LEFT) if name in trim):
        value = trim[quantity]
        name = quantity.removeprefix("trim.")
        unit = SHOWN_UNITS.get(LIMIT_UNITS[name], LIMIT_UNITS[name])
        text = f"{name} {from_si(value, unit):+.3g}{'' if unit == '1' else f' {unit}'}"
        if name in limits and abs(value) > limits[name].size:
            words.append(
                f"{text} (limit "
                f"{from_si(limits[name].size, unit):.3g}{', of the case file' if limits[name].demanded else ''})"
            )
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
            f"pilot  {row['control']}: mean {mean:+.3g}, rms {rms:.3g}, largest "
            f"{largest:+.3g} {unit} at {row['at']:.1f} s, "
            f"{100.0 * row['at_limit']:.0f} % at its limit; off by {row['held']}; loops "
            f"{row['gains']}"
        )
    return lines


def _drift(result: PomResult, run: str) -> str:
    rows = drift(result)
    words = []
    for row in rows[(rows["run"] == run) & rows["channel"].isin(_RATES)].to_dict("records"):
        unit = lookup(row["channel"]).display_units
        words.append(f"{row['channel']} {from_si(60.0 * row['rate'], unit):+.3g} {unit}/min")
    return f"drift  {', '.join(words)}" if words else ""
