"""Page of one case: header, facts, tables, and the data of its plots."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import pandas as pd

from pom.cases.signatures import signature_rows
from pom.report.case import remarks
from pom.report.case.case_figure import draw_case_figures
from pom.report.case.driving import describe_driving
from pom.report.case.panels import (
    CasePanel,
    make_case_panels,
    make_cross_plots,
)
from pom.report.case.plot_data import plot_data
from pom.report.case.start import (
    calibration_rows,
    condition_rows,
    drift_rows,
    glance_text,
    stated_conditions,
    trim_tables,
)
from pom.report.models.diagnosis import cause_section
from pom.report.presentation.page_templates import page_templates
from pom.report.presentation.quantities import fixed_decimals
from pom.report.presentation.traces import pack_page
from pom.report.presentation.unit_sets import units_in_text
from pom.report.presentation.verdict_text import (
    MODAL,
    Verdict,
    criterion_words,
    reason_text,
    verdict_blocks,
)
from pom.result import PomResult, results_name
from pom.result_notices import run_notices, spread_notice, unchecked_text

# The line code of LR-743 Figs. 18 to 21.  Any further model gets the next free style.
_STYLES = {"datcom": "run-1", "prior": "run-1", "corrected": "run-2", "final": "run-3"}
_SPARE = ("run-4", "run-5", "run-1", "run-2", "run-3")

_OF_ALL = ("document", "chapters")  # names in ``results.nc`` besides the groups of the cases


def run_line_classes(runs: Iterable[str]) -> dict[str, str]:
    """Return the line class of every run, flight first."""
    models = [run for run in runs if run != "flight"]
    reserved = [_STYLES[run] for run in models if run in _STYLES]
    # Free styles first, then all styles again.
    spare = [style for style in _SPARE if style not in reserved] + list(_SPARE) * len(models)
    classes = {"flight": "run-0"}
    for run in models:
        classes[run] = _STYLES.get(run) or spare.pop(0)
    return classes


def case_keys(results: Sequence[PomResult]) -> list[str]:
    """Return a key per case that is valid in an address and as the name of a file.

    The keys differ in more than upper and lower case, since Windows and macOS ignore it in names.
    """
    keys: dict[str, str] = {}
    for result in results:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", result.case.name).strip("-") or "case"
        key, n = stem, 1
        # Keys of equal names get a number.
        while key.lower() in keys or key.lower() in _OF_ALL:
            n += 1
            key = f"{stem}-{n}"
        keys[key.lower()] = key
    return list(keys.values())


def case_page(
    key: str,
    result: PomResult,
    outcome: Sequence[Mapping[str, Any]],
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
    with_figures: bool,
) -> dict[str, Any]:
    """Return the data of the templates for one case.

    Parameters
    ----------
    key : str
    result : PomResult
    outcome : sequence of mapping
        Result of `outcome_rows`.
    provenance : mapping
        Provenance without paths.
    diagnosis : DataFrame or None
        Table of `pom.diagnose`.
    modes : DataFrame
        Table of `pom.judging.mode_table`.
    with_figures : bool
        Draw figures for readers without a script.
    """
    styles = run_line_classes(result.runs)
    panels = make_case_panels(result)
    head, body = plot_data(result, panels, make_cross_plots(result), styles)
    figures = _plain_figures(key, result, panels, styles) if with_figures else []
    name = results_name([result])
    return {
        "key": key,
        "case": result.case,
        "objective": remarks.case_objective(result.case),
        "share": remarks.fraction_text(result.case.fraction),
        "outcomes": outcome,
        "failure": result.failure,
        "hashes": digest_rows(result, provenance),
        "source": remarks.data_source(result),
        "calibration": calibration_rows(result),
        "glance": glance_text(result),
        "conditions": condition_rows(
            result.conditions, result.trim.index, stated_conditions(result)
        ),
        "drive": describe_driving(result),
        "trim": trim_tables(result),
        "drift": drift_rows(result),
        "verdicts": verdict_blocks(result),
        "modes": remarks.mode_blocks(result, modes, styles),
        "probability": remarks.probability_table(result),
        "cause": cause_section(result, diagnosis),
        "notes": remarks.reader_notes(result),
        "rationales": remarks.rationale_rows(result),
        "ticks": remarks.tick_rows(result),
        "results": name,
        "signatures": signature_rows(result.case.signatures, provenance.get("date", ""), name),
        "styles": styles,
        "plain": figures,
        "head": head,
        "body": body,
    }


def _plain_figures(
    key: str, result: PomResult, panels: Sequence[CasePanel], styles: Mapping[str, str]
) -> list[str]:
    """Return the figures of the judged channels, for readers without a script."""
    judged = [panel for panel in panels if panel.kind == "judged"]
    return draw_case_figures(
        f"{key}-plain",
        result.signals["time"].values,
        panels=judged,
        # The inputs as applied have the line of the flight.
        styles={**styles, "applied": "run-0"},
        events=result.case.events,
    )


def outcome_rows(result: PomResult, styles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return status, deciding criterion and worst ratio of every model."""
    rows = []
    for run in result.runs:
        status = result.status(run)
        row = result.deciding_row(run)
        ratio = row.get("worst_ratio", math.nan)
        # A mode is of the whole window, not of an instant.
        instant = math.nan if row.get("measure") in MODAL else row.get("at", math.nan)
        notices = [units_in_text(text) for text in run_notices(result, run)]
        unexplained = spread_notice(result, run)
        if unexplained:
            notices.append(unexplained)
        rows.append(
            {
                "run": run,
                "style": styles[run],
                "status": status,
                "verdict": Verdict.of(status),
                "ratio": ratio,
                "ratio_text": fixed_decimals(ratio, 2),
                "criterion": criterion_words(row.get("criterion", "")),
                "why": "" if math.isfinite(ratio) else reason_text(row.get("remarks", ())),
                "notices": notices,
                "unchecked": unchecked_text(result, run),
                "at": instant,
                "at_text": fixed_decimals(instant, 2),
            }
        )
    return rows


def provenance_of(result: PomResult, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of the provenance of a report that the page of one case shows.

    A change of another part does not change the page.
    """
    record = PurePath(result.case.record).name
    inputs = {}
    for file, digest in provenance.get("inputs", {}).items():
        if PurePath(file).name == record:
            inputs[file] = digest
    models = {}
    for run, model in provenance.get("models", {}).items():
        if run in result.runs:
            models[run] = model
    return {
        "date": provenance.get("date", ""),
        "units": provenance.get("units", ""),
        "versions": provenance.get("versions", {}),
        "inputs": inputs,
        "models": models,
    }


def digest_rows(result: PomResult, provenance: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (what, file, SHA-256) of the record and of every model."""
    inputs = provenance.get("inputs", {})
    record = PurePath(result.case.record).name
    # If several inputs have the name of the record, its digest is not known.
    digests = [digest for file, digest in inputs.items() if PurePath(file).name == record]
    rows = [("flight record", record, digests[0] if len(digests) == 1 else "")]
    for run in result.runs:
        stated = str(result.signals.attrs.get(f"model.{run}", ""))
        model = provenance.get("models", {}).get(run) or _parse_model(stated)
        rows.append((f"model {run}", model.get("file", ""), model.get("sha256", "")))
    return rows


def _parse_model(text: str) -> dict[str, str]:
    """Return file and hash from a text of `pom.replay`: ``final.fmu, FMI 2.0, sha256 ...``."""
    file, _, details = text.partition(", ")
    return {"file": file, "sha256": details.partition("sha256 ")[2]}


# Cases of a report that has figures for readers without a script, 10 kB a case.  A longer report is
# not read in that way.
MOST_WITH_FIGURES = 30


@dataclass(frozen=True)
class CommonHeading:
    """Data that the pages of all cases share.

    Title and revision are not among them: ``report.html`` adds both when it shows a page, so that
    a new title does not require new pages.

    Attributes
    ----------
    count : int
        Number of cases.
    provenance : mapping
        Provenance without paths.
    with_databases : bool
        The report compares databases, so that terms have links to their tables.
    """

    count: int
    provenance: Mapping[str, Any]
    with_databases: bool


@dataclass(frozen=True)
class PackedPage:
    """Page of one case, with its data for the overview.

    Attributes
    ----------
    key : str
        Name of the case in addresses and files.
    outcome : list of dict
        Result of `outcome_rows`.
    brief : str
        HTML for readers without a script.
    parcel : str
        Page and traces, packed by `pom.report.presentation.traces.pack_page`.
    """

    key: str
    outcome: list[dict[str, Any]]
    brief: str
    parcel: str

    @property
    def fail(self) -> bool:
        """Whether a model failed, or passed with limits exceeded."""
        statuses = {cell["status"] for cell in self.outcome}
        return bool(statuses & {"fail", "limits_exceeded", "record_error", "leak", "not_driven"})


def packed_page(
    position: int,
    key: str,
    result: PomResult,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
) -> PackedPage:
    """Return the packed page of one case.

    Parameters
    ----------
    position : int
        Number of the case in the report, from one.
    key : str
    result : PomResult
    heading : CommonHeading
    diagnosis : DataFrame or None
        Table of `pom.diagnose`.
    modes : DataFrame
        Table of `pom.judging.mode_table`.
    """
    provenance = heading.provenance
    outcome = outcome_rows(result, run_line_classes(result.runs))
    page = case_page(
        key,
        result,
        outcome=outcome,
        provenance=provenance,
        diagnosis=diagnosis,
        modes=modes,
        with_figures=heading.count <= MOST_WITH_FIGURES,
    )
    context = {
        "count": heading.count,
        "origin": {
            "date": provenance.get("date", ""),
            "versions": sorted(provenance.get("versions", {}).items()),
        },
        "models": heading.with_databases,
        "page": {**page, "position": position},
    }
    templates = page_templates()
    article = templates.get_template("case.html").render(context)
    brief = templates.get_template("brief.html").render(context)
    return PackedPage(
        key, outcome, brief=brief, parcel=pack_page({**page["head"], "page": article}, page["body"])
    )
