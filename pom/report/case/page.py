"""What the page of one case shows: header, facts, tables, and the data of its plots."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import pandas as pd

from pom.cases.case_file import signature_rows
from pom.report.case import remarks
from pom.report.case import remarks as modal
from pom.report.case import remarks as probability
from pom.report.case import start_and_inputs as initial_conditions
from pom.report.case.case_figure import draw_case_figures
from pom.report.case.panels import (
    CasePanel,
    Cross,
    make_case_panels,
    make_cross_plots,
    panel_description,
)
from pom.report.case.start_and_inputs import describe_driving
from pom.report.models.diagnosis import cause_section
from pom.report.presentation.quantities import QuantityLabel, fixed_decimals
from pom.report.presentation.traces import TIME_STEP, Pack, pack_page, page_templates, step_of
from pom.report.presentation.verdict_text import (
    MODAL,
    Verdict,
    criterion_words,
    reason_text,
    verdict_blocks,
)
from pom.result import (
    PASSED,
    PomResult,
    has_trim_remark,
    is_on_faulty_record,
    results_name,
    run_notices,
)


def plot_data(
    result: PomResult,
    panels: Sequence[CasePanel],
    crosses: Sequence[Cross],
    styles: Mapping[str, str],
) -> tuple[dict[str, Any], bytes]:
    """Return the description of the plots, and the traces it points into."""
    pack = Pack.empty()
    rows = _rows(result)
    head = {
        "time": pack.add(result.signals["time"].values, TIME_STEP),
        "runs": [{"name": run, "style": style} for run, style in styles.items()],
        "events": [[criterion_words(name), at] for name, at in result.case.events.items()],
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
            "words": criterion_words(row["criterion"]),
            "measure": row["measure"],
            "channel": row["channel"],
            "group": row["group"],
            "applies": row["criterion"] in applying,
            "verdict": row["verdict"],
            "exceeds": has_trim_remark(row),
            "faulty": is_on_faulty_record(row),
            "ratio": row["worst_ratio"] if math.isfinite(row["worst_ratio"]) else None,
            "fraction": row["fraction"] if math.isfinite(row["fraction"]) else 1.0,
        }
        for row in result.rows
    ]


def _quantity(shown: QuantityLabel) -> dict[str, str]:
    symbol = ("", "") if shown.is_word else (shown.base, shown.sub)
    return {
        "channel": shown.name,
        "base": symbol[0],
        "sub": symbol[1],
        "words": shown.words,
        "unit": shown.unit,
    }


def _panel(panel: CasePanel, pack: Pack, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    step = step_of(panel.half, panel.limits)
    return {
        **_quantity(panel.label),
        "kind": panel.kind,
        "sign": panel.label.sign,
        "alt": panel_description(panel),
        "limits": [float(f"{edge:.6g}") for edge in panel.scale],
        "span": panel.label.least_span,
        "decimals": _decimals(step),
        "window": panel.window,
        "exits": {
            run: [[round(t, 3) for t in span] for span in found]
            for run, found in panel.exits.items()
            if found
        },
        "verdicts": [
            row for row in rows if row["channel"] == panel.channel and row["measure"] == "trace"
        ]
        if panel.rows
        else [],
        "traces": {run: pack.add(values, step) for run, values in panel.traces.items()},
        "half": None if panel.half is None else pack.add(panel.half, step),
        "fans": {
            f"{run} {k}": pack.add(values, step)
            for run, fan in panel.fans.items()
            for k, values in enumerate(fan)
        },
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


# the line code of LR-743 Figs. 18 to 21; any further model takes the next free style
_STYLES = {"datcom": "run-1", "corrected": "run-2", "final": "run-3"}
_SPARE = ("run-4", "run-5", "run-1", "run-2", "run-3")


_OF_ALL = ("document", "chapters")  # what ``results.nc`` holds next to the groups of the cases


def run_line_classes(runs: Iterable[str]) -> dict[str, str]:
    """Return the line class of every run, flight first."""
    runs = [run for run in runs if run != "flight"]
    taken = [_STYLES[run] for run in runs if run in _STYLES]
    spare = [style for style in _SPARE if style not in taken] + list(_SPARE) * len(runs)
    return {"flight": "run-0", **{run: _STYLES.get(run) or spare.pop(0) for run in runs}}


def case_keys(results: Sequence[PomResult]) -> list[str]:
    """Return a name per case, fit for an address and a file: unique without regard to case, as
    Windows and macOS compare them.
    """
    found: dict[str, str] = {}
    for result in results:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", result.case.name).strip("-") or "case"
        key, n = stem, 1
        while key.lower() in found or key.lower() in _OF_ALL:
            n += 1
            key = f"{stem}-{n}"
        found[key.lower()] = key
    return list(found.values())


def case_page(
    key: str,
    result: PomResult,
    outcome: Sequence[Mapping[str, Any]],
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
    with_figures: bool,
) -> dict[str, Any]:
    """Return everything the templates need for one case; `with_figures` draws those for readers
    without a script.
    """
    styles = run_line_classes(result.runs)
    shown, time = make_case_panels(result), result.signals["time"].values
    lines = {**styles, "applied": "run-0"}
    judged = [panel for panel in shown if panel.kind == "judged"]
    head, body = plot_data(result, shown, make_cross_plots(result), styles)
    return {
        "key": key,
        "case": result.case,
        "objective": remarks.case_objective(result.case),
        "share": remarks.fraction_text(result.case.fraction),
        "outcomes": outcome,
        "failure": result.failure,
        "hashes": digest_rows(result, provenance),
        "source": remarks.data_source(result),
        "calibration": initial_conditions.calibration_rows(result),
        "conditions": initial_conditions.condition_rows(result.conditions, result.trim.index),
        "drive": describe_driving(result),
        "trim": initial_conditions.trim_tables(result),
        "drift": initial_conditions.drift_rows(result),
        "verdicts": verdict_blocks(result),
        "modes": modal.mode_blocks(result, modes, styles),
        "probability": probability.probability_table(result),
        "cause": cause_section(result, diagnosis),
        "notes": remarks.reader_notes(result),
        "rationales": remarks.rationale_rows(result),
        "ticks": remarks.tick_rows(result),
        "results": (name := results_name([result])),
        "signatures": signature_rows(result.case.signatures, provenance.get("date", ""), name),
        "styles": styles,
        "plain": draw_case_figures(f"{key}-plain", time, judged, lines, result.case.events)
        if with_figures
        else [],
        "head": head,
        "body": body,
    }


def outcome_rows(result: PomResult, styles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return status, deciding criterion and worst ratio of every model."""
    rows = []
    applying = {c.name for c in result.case.criteria if c.applies}
    for run in result.runs:
        mine = [row for row in result.rows if row["run"] == run]
        status = result.status(run)
        found = result.worst(run)
        worst = {} if found is None else found
        if (
            status not in PASSED and not worst.get("worst_ratio", 0.0) > 1.0
        ):  # decided without a number, such as by a mode that is not there
            worst = next(
                (row for row in mine if row["verdict"] == status and row["criterion"] in applying),
                worst,
            )
        ratio = worst.get("worst_ratio", math.nan)
        at = math.nan if worst.get("measure") in MODAL else worst.get("at", math.nan)
        rows.append(
            {
                "run": run,
                "style": styles[run],
                "status": status,
                "verdict": Verdict.of(status),
                "ratio": ratio,
                "ratio_text": fixed_decimals(ratio, 2),
                "criterion": criterion_words(worst.get("criterion", "")),
                "why": "" if math.isfinite(ratio) else reason_text(worst.get("remarks", ())),
                "notices": run_notices(result, run),
                "at": at,
                "at_text": fixed_decimals(at, 2),
            }
        )
    return rows


def provenance_of(result: PomResult, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page of one case shows of the provenance of a report: a change elsewhere
    leaves it as it is.
    """
    record = PurePath(result.case.record).name
    return {
        "date": provenance.get("date", ""),
        "versions": provenance.get("versions", {}),
        "inputs": {
            file: digest
            for file, digest in provenance.get("inputs", {}).items()
            if PurePath(file).name == record
        },
        "models": {
            run: model for run, model in provenance.get("models", {}).items() if run in result.runs
        },
    }


def digest_rows(result: PomResult, provenance: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (what, file, SHA-256) of the record and of every model."""
    inputs = provenance.get("inputs", {})
    record = PurePath(result.case.record).name
    known = [digest for file, digest in inputs.items() if PurePath(file).name == record]
    rows = [("flight record", record, known[0] if len(known) == 1 else "")]
    for run in result.runs:
        model = provenance.get("models", {}).get(run) or _flown(
            str(result.signals.attrs.get(f"model.{run}", ""))
        )
        rows.append((f"model {run}", model.get("file", ""), model.get("sha256", "")))
    return rows


def _flown(text: str) -> dict[str, str]:
    """Return file and hash of what `pom.replay` states of a model: ``final.fmu, FMI 2.0, sha256
    ...``.
    """
    file, _, rest = text.partition(", ")
    return {"file": file, "sha256": rest.partition("sha256 ")[2]}


# figures for readers without a script take 10 kB a case: only a report that is short enough to be
# read that way has them
MOST_WITH_FIGURES = 30


@dataclass(frozen=True)
class CommonHeading:
    """What the pages of all cases share.

    Attributes
    ----------
    title, revision : str
        Of the report.
    count : int
        Of the cases.
    provenance : mapping
        As `pom.write_report` takes it.
    with_databases : bool
        The report compares databases: terms lead to their tables.
    """

    title: str
    revision: str
    count: int
    provenance: Mapping[str, Any]
    with_databases: bool


@dataclass(frozen=True)
class PackedPage:
    """The page of one case, and what the overview shows of it.

    Attributes
    ----------
    key : str
        Its name in addresses and files.
    outcome : list of dict
        Of `outcomes`.
    brief : str
        HTML for readers without a script.
    parcel : str
        Page and traces, of `presentation.traces.pack_page`.
    """

    key: str
    outcome: list[dict[str, Any]]
    brief: str
    parcel: str

    @property
    def fail(self) -> bool:
        """Whether a model failed, or passed with limits exceeded."""
        return any(
            cell["status"] in ("fail", "limits_exceeded", "record_error") for cell in self.outcome
        )


def packed_page(
    position: int,
    key: str,
    result: PomResult,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
) -> PackedPage:
    """Return the page of the case at `position`, counted from one; `modes` is its table of modes."""
    made_from = heading.provenance
    outcome = outcome_rows(result, run_line_classes(result.runs))
    page = case_page(
        key,
        result,
        outcome,
        made_from,
        diagnosis,
        modes,
        with_figures=heading.count <= MOST_WITH_FIGURES,
    )
    context = {
        "title": heading.title,
        "revision": heading.revision,
        "count": heading.count,
        "origin": {
            "date": made_from.get("date", ""),
            "versions": sorted(made_from.get("versions", {}).items()),
        },
        "models": heading.with_databases,
        "page": {**page, "position": position},
    }
    whole, brief = (
        page_templates().get_template(name).render(context) for name in ("case.html", "brief.html")
    )
    return PackedPage(key, outcome, brief, pack_page({**page["head"], "page": whole}, page["body"]))
