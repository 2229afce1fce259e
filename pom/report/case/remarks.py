"""Texts next to the verdicts: modes, probability, notes, rationales, ticks, lines of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
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
    QuantityLabel,
    fixed_decimals,
    format_number,
    has_ends,
    measured_text,
    quantity_label,
    short_number,
)
from pom.report.presentation.unit_sets import units_in_text
from pom.report.presentation.verdict_text import (
    MARKS,
    MODAL,
    criterion_words,
    remark_text,
)
from pom.result import PomResult, to_records
from pom.result_notices import spread_notice
from pom.samples import SampledReplay
from pom.tolerances.channels import plain_words
from pom.tolerances.rows import DEMONSTRATION, tolerance_rows


def mode_blocks(
    result: PomResult, modes: pd.DataFrame, styles: dict[str, str]
) -> list[dict[str, Any]]:
    """Return one block per fitted channel and window, with the flight first.

    Parameters
    ----------
    result : PomResult
    modes : DataFrame
        Table of `pom.judging.measures.modal.mode_table`.
    styles : dict of str to str
        Run to the class of its line.
    """
    fits_by_window: dict[tuple[str, float, float], list[dict[Any, Any]]] = {}
    for row in to_records(modes):
        key = (str(row["channel"]), row["window_start"], row["window_stop"])
        fits_by_window.setdefault(key, []).append(row)
    blocks = []
    for (channel, start, stop), fits in fits_by_window.items():
        label = quantity_label(channel)
        blocks.append(
            {
                "label": label,
                "window": f"{fixed_decimals(start, 2)} … {fixed_decimals(stop, 2)}",
                "lags": any(not math.isnan(row["lag"]) for row in fits),
                "rows": [_mode_row(row, label, styles) for row in fits],
            }
        )
    return blocks


def _mode_row(row: dict[Any, Any], label: QuantityLabel, styles: dict[str, str]) -> dict[str, Any]:
    """Return a fitted mode as printed."""
    return {
        "run": row["run"],
        "style": styles[row["run"]],
        "period": fixed_decimals(row["period"], 2),
        "t_half": _half_time_text(row["t_half"]),
        "damping": fixed_decimals(row["damping_ratio"], 4),
        "cycles": fixed_decimals(row["cycles"], 1),
        "amplitude": format_number(float(label.width(row["amplitude"])), 3),
        "residual": format_number(float(label.width(row["residual_rms"])), 2),
        "lag": fixed_decimals(row["lag"], 2),
        "note": row["note"],
    }


def _half_time_text(half_time: float) -> str:
    """Return the time to half amplitude; a negative time is that to double amplitude."""
    if math.isnan(half_time):
        return MISSING
    text = fixed_decimals(abs(half_time), 2)
    return f"{text} to double" if half_time < 0 else text


SOURCES = 4
"""Number of sources of spread that are printed of one criterion."""


def probability_table(result: PomResult) -> list[dict[str, Any]]:
    """Return one block per sampled model: its line, and one row per judged criterion."""
    blocks = []
    for run, samples in result.samples.items():
        block = {
            "run": run,
            "draws": samples.count,
            "seed": samples.seed,
            "database": samples.database,
            "probability": probability_text(samples),
            "ratio": spread_text(samples),
            "unexplained": spread_notice(result, run),
            "rows": [_probability_row(samples, str(name)) for name in samples.ratio.columns],
        }
        blocks.append(block)
    return blocks


def _probability_row(samples: SampledReplay, criterion: str) -> dict[str, str]:
    return {
        "criterion": criterion_words(criterion),
        "probability": fixed_decimals(samples.passing(criterion), 3),
        "ratio": spread_text(samples, criterion),
        "sources": dominant_sources_text(samples, criterion),
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
    texts = []
    for source, share in samples.dominant(criterion, most):
        texts.append(f"{source} {100.0 * share:.0f} %")
    return ", ".join(texts)


# Channels of the line of the drift.
_RATES = ("V_cas", "h", "psi")

IN_MODE_TABLE = ("values", "cycles", "no_mode")
"""Kinds of remarks that only repeat the table of modes."""

_REFERENCES = {
    "engineering": "The reference is an engineering simulator, not a flight; {share} of the "
    "flight tolerance is applied.",
    "footprint": "Footprint: the response of the device itself, kept for later comparison; no "
    "band is drawn and nothing is judged.",
}


@dataclass(frozen=True)
class ReaderNote:
    """A note to the reader: what it concerns, and its texts.

    Attributes
    ----------
    subject : str
        Criteria and models; empty for a note on the case.
    texts : tuple of str
    """

    subject: str
    texts: tuple[str, ...]

    @property
    def heading(self) -> str:
        """What stands before the list of the texts; empty for a single text."""
        return self.subject if len(self.texts) > 1 else ""

    @property
    def line(self) -> str:
        """The note in one line."""
        texts = "; ".join(self.texts)
        return f"{self.subject}: {texts}" if self.subject else texts

    def as_dict(self) -> dict[str, Any]:
        """Return the note for the template of the PDF."""
        return {"heading": self.heading, "line": self.line, "texts": list(self.texts)}


def reader_notes(result: PomResult) -> list[ReaderNote]:
    """Return the notes to the reader in addition to the verdicts, each once."""
    notes = [ReaderNote("", (text,)) for text in _case_notes(result)]
    notes += _row_remarks(result)
    sources = set(result.verdict["provenance"])
    marks = sorted([MARKS[source] for source in ("memory", "partial") if source in sources])
    if marks:
        quoted = "” or “".join(marks)
        text = (
            f"Rows marked “{quoted}” were not read word for word in the regulation; check them "
            f"there first."
        )
        notes.append(ReaderNote("", (text,)))
    # A dictionary keeps the order and drops repeated notes.
    return list(dict.fromkeys(notes))


def _case_notes(result: PomResult) -> list[str]:
    """Return the notes on the case and on its record."""
    case = result.case
    notes = [case.notes] if case.notes else []
    if case.is_demonstration:
        notes.append(f"This case is {DEMONSTRATION}.")
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
            conditions.append(
                f"{quantity_label(name).words or name} {_set_value_text(value, name)}"
            )
        notes.append(f"From the case file, not from the record: {', '.join(conditions)}.")
    for row in result.rows:
        errors = [remark.text for remark in row["remarks"] if remark.kind == "record"]
        notes += map(units_in_text, errors)
    return notes


def case_objective(case: PomCase) -> str:
    """Return the objective of a case.

    It is that of the case file, otherwise the comparison of its row in the tolerance table.
    """
    if case.objective:
        return case.objective
    names = [criterion.name for criterion in case.criteria if criterion.applies]
    judged = ", ".join(dict.fromkeys(map(criterion_words, names)))
    title = _row_title(case)
    if case.is_demonstration:
        return f"{title}: recordings that people judge; no tolerance applies."
    if case.reference == "footprint":
        return f"{title}: {judged} of the device, kept for later comparison."
    reference = "an engineering simulator" if case.reference == "engineering" else "flight"
    return (
        f"{title}: {judged} of the models against {reference}, within the tolerances of {case.id}."
    )


def _row_title(case: PomCase) -> str:
    """Return the title of a case in the tolerance table, or in its file if the table has none."""
    for row in case.table.get("rows", tolerance_rows()):
        if (row["standard"], row["test_id"]) == (case.standard, case.id):
            return row["title"]
    return case.title


def fraction_text(fraction: float) -> str:
    """Return a fraction of the tolerance as printed.

    Examples
    --------
    >>> fraction_text(0.2)
    '20 %'
    """
    return f"{short_number(100.0 * fraction)} %"


def _row_remarks(result: PomResult) -> list[ReaderNote]:
    """Return the remarks of the verdict rows, each once, after the criteria and models it concerns.

    The first notes have the longest time outside of the band, by model.
    """
    # Criteria and models of every remark; longest times outside by model.
    subjects: dict[str, list[tuple[str, str]]] = {}
    outside: dict[str, list[str]] = {}
    for row in result.rows:
        criterion, run = criterion_words(row["criterion"]), row["run"]
        has_mode = row["measure"] in MODAL and row["verdict"] in ("pass", "fail")
        for remark in row["remarks"]:
            if remark.kind == "outside":
                text = f"{criterion} {remark.values['longest']:.2f} s"
                outside.setdefault(run, []).append(text)
            elif remark.kind != "record" and not (has_mode and remark.kind in IN_MODE_TABLE):
                subjects.setdefault(remark_text(remark), []).append((criterion, run))
    notes = []
    for run, texts in outside.items():
        notes.append(ReaderNote(f"{run}, longest run outside", (", ".join(texts),)))
    # Remarks on the same criteria and models share a note.
    texts_by_subject: dict[str, list[str]] = {}
    for text, pairs in subjects.items():
        texts_by_subject.setdefault(_subject_text(pairs, result), []).append(text)
    for subject, texts in texts_by_subject.items():
        notes.append(ReaderNote(subject, tuple(texts)))
    return notes


def _set_value_text(value: float, name: str) -> str:
    """Return a value that a person has set, with its display unit, without trailing zeros."""
    if has_ends(name):
        return measured_text(value, name)
    label = quantity_label(name)
    number = short_number(float(label.shown(value)))
    return f"{number}\N{NO-BREAK SPACE}{label.unit}".rstrip("\N{NO-BREAK SPACE}")


def _subject_text(pairs: Sequence[tuple[str, str]], result: PomResult) -> str:
    """Return the criteria and the models of a remark.

    All models are left out.  All criteria are left out if the remark is on some of the models.
    """
    criteria = list(dict.fromkeys([criterion for criterion, _ in pairs]))
    runs = list(dict.fromkeys([run for _, run in pairs]))
    has_all_criteria = len(criteria) == result.verdict["criterion"].nunique()
    has_all_runs = len(runs) == len(result.runs)
    if has_all_runs:
        return ", ".join(criteria)
    if has_all_criteria:
        return ", ".join(runs)
    return ", ".join([*criteria, *runs])


def rationale_rows(result: PomResult) -> list[tuple[str, str]]:
    """Return the explanations of the case file: (criterion or channel, text)."""
    rows = []
    for name, text in result.case.rationale.items():
        rows.append((criterion_words(name), text))
    return rows


def tick_rows(result: PomResult) -> list[dict[str, Any]]:
    """Return the criteria that an engineer judges, with the ticks of the case file."""
    is_advisory = result.verdict["verdict"] == "advisory"
    advisory = result.verdict.loc[is_advisory, "criterion"]
    rows = []
    for name in dict.fromkeys([*advisory, *result.case.ticks]):
        rows.append({"criterion": criterion_words(name), "tick": result.case.ticks.get(name, "")})
    return rows


def data_source(result: PomResult) -> list[tuple[str, str]]:
    """Return the source of the flight data and their sampling rate: (subject, words)."""
    rows = [(plain_words(key), text) for key, text in result.case.source.items()]
    time = result.signals["time"].values
    rate = (len(time) - 1) / (time[-1] - time[0])
    rows.append(("samples", f"{len(time)} at {short_number(rate, 3)} per second"))
    return rows


def sampled_line(result: PomResult, run: str) -> str:
    """Return the result of the draws of a model in one line.

    It has the probability of a pass, the spread of the ratio, and the sources of the spread of
    the criterion that decides.
    """
    samples, worst = result.samples[run], result.worst(run)
    text = (
        f"probability of a pass {probability_text(samples)} ({samples.count} draws), ratio "
        f"{spread_text(samples)}"
    )
    criterion = "" if worst is None else str(worst["criterion"])
    if criterion not in samples.ratio:
        return text
    sources = dominant_sources_text(samples, criterion, 3)
    return f"{text}; {criterion}: {sources}" if sources else text


def run_notes(result: PomResult, run: str) -> list[str]:
    """Return the lines of a run: ``trim ...``, ``pilot ...``, ``drift ...``.

    There is a line of the pilot for every control that a math pilot moved.
    """
    lines = [_trim_line(result, run), *_pilot_lines(result, run), _drift_line(result, run)]
    return [line for line in lines if line]


def _trim_line(result: PomResult, run: str) -> str:
    """Return the biases of the trim, and the quantities beyond their limits."""
    limits = result_trim_limits(result)
    texts = []
    values = result.trim[run].dropna().to_dict()
    for quantity in (*FOUND, *LEFT):
        if quantity not in values:
            continue
        value, name = values[quantity], quantity.removeprefix("trim.")
        unit = SHOWN_UNITS.get(LIMIT_UNITS[name], LIMIT_UNITS[name])
        text = f"{name} {from_si(value, unit):+.3g}"
        if unit != "1":
            text += f" {unit}"
        limit = limits.get(name)
        if limit is not None and abs(value) > limit.size:
            source = ", of the case file" if limit.demanded else ""
            texts.append(f"{text} (limit {from_si(limit.size, unit):.3g}{source})")
        elif quantity in FOUND and value != 0.0:
            texts.append(text)
    return f"trim   {', '.join(texts)}" if texts else ""


def _pilot_lines(result: PomResult, run: str) -> list[str]:
    table = pilot_activity(result)
    lines = []
    for row in table[table["run"] == run].to_dict("records"):
        unit = lookup(row["control"]).display_units
        mean, rms = from_si(row["mean"], unit), from_si(row["rms"], unit)
        largest = from_si(row["largest"], unit)
        lines.append(
            f"pilot  {row['control']}: mean {mean:+.3g}, rms {rms:.3g}, largest "
            f"{largest:+.3g} {unit} at {row['at']:.1f} s, "
            f"{100.0 * row['at_limit']:.0f} % at its limit; off by {row['held']}; loops "
            f"{row['gains']}"
        )
    return lines


def _drift_line(result: PomResult, run: str) -> str:
    table = drift(result)
    is_printed = (table["run"] == run) & table["channel"].isin(_RATES)
    texts = []
    for row in table[is_printed].to_dict("records"):
        unit = lookup(row["channel"]).display_units
        # The rate is in SI per second.
        texts.append(f"{row['channel']} {from_si(60.0 * row['rate'], unit):+.3g} {unit}/min")
    return f"drift  {', '.join(texts)}" if texts else ""
