"""What the page of one case shows: header, facts, tables, and the data of its plots."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
import pandas as pd

from pom.result import PomResult

from . import modal, start
from .case_figure import SYMBOLS, figures
from .cause import cause
from .panels import Panel, description, panels, split_inputs
from .quantities import MINUS, fixed, label, measured, plainly, short
from .traces import TIME_STEP, Pack, compressed, step_of
from .verdicts import MARKS, MODAL, WORDS, Verdict, verdict_table, words

# the line code of LR-743 Figs. 18 to 21; any further model takes the next free style
_STYLES = {"datcom": "run-1", "corrected": "run-2", "final": "run-3"}
_SPARE = ("run-4", "run-5", "run-1", "run-2", "run-3")
_SURFACES = {"recorded": "recorded surface positions drive the model"}
_ENGINE = {
    "thrust": "recorded thrust drives the model",
    "n1": "the recorded fan speed drives the engine model",
    "throttle": "the recorded lever drives the engine model",
}
_START = {
    True: "trimmed to the flight state; what is left stands below",
    False: "flight state, not trimmed",
    "ground": "on its wheels at the recorded speed; height and attitude from the landing gear",
}


def line_styles(runs: Iterable[str]) -> dict[str, str]:
    """Return the line class of every run, flight first."""
    runs = [run for run in runs if run != "flight"]
    taken = [_STYLES[run] for run in runs if run in _STYLES]
    spare = [style for style in _SPARE if style not in taken] + list(_SPARE) * len(runs)
    return {"flight": "run-0", **{run: _STYLES.get(run) or spare.pop(0) for run in runs}}


def keys(results: Sequence[PomResult]) -> list[str]:
    """Return a unique name per case, fit for an address."""
    found: list[str] = []
    for result in results:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", result.case.name).strip("-") or "case"
        key, n = stem, 1
        while key in found:
            n += 1
            key = f"{stem}-{n}"
        found.append(key)
    return found


def page(key: str, result: PomResult, provenance: Mapping[str, Any], diagnosis: pd.DataFrame | None, modes: pd.DataFrame) -> dict[str, Any]:
    """Return everything the template ``case.html`` needs for one case."""
    styles = line_styles(result.runs)
    shown, time, events = panels(result), result.signals["time"].values, result.case.events
    lines = {**styles, "applied": "run-0"}
    return {
        "key": key,
        "case": result.case,
        "outcomes": outcomes(result, styles),
        "failure": result.failure,
        "hashes": _hashes(result, provenance),
        "conditions": start.conditions(result.conditions, result.trim.index),
        "drive": _drive(result),
        "trim": start.trim(result.trim),
        "verdicts": verdict_table(result),
        "modes": modal.table(result, modes, styles),
        "cause": cause(result, diagnosis),
        "notes": _notes(result),
        "advisory": [c for c in dict.fromkeys(result.verdict.loc[result.verdict["verdict"] == "advisory", "criterion"])],
        "styles": styles,
        "figures": compressed("".join(f"<figure>{figure}</figure>" for figure in figures(key, time, shown, lines, events))),
        "plain": figures(f"{key}-plain", time, [panel for panel in shown if panel.kind == "judged"], lines, events),
        "data": _data(result, shown, styles),
    }


def outcomes(result: PomResult, styles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return status, deciding criterion and worst ratio of every model."""
    rows = []
    for run in result.runs:
        found = result.worst(run)
        worst = {} if found is None else found.to_dict()
        ratio, at = worst.get("worst_ratio", math.nan), worst.get("at", math.nan)
        rows.append(
            {
                "run": run,
                "style": styles[run],
                "status": result.status(run),
                "verdict": Verdict.of(result.status(run)),
                "ratio": ratio,
                "ratio_text": fixed(ratio, 2),
                "criterion": words(worst.get("criterion", "")),
                "at": at,
                "at_text": fixed(at, 2),
            }
        )
    return rows


def _hashes(result: PomResult, provenance: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (what, file, SHA-256) of the record and of every model."""
    inputs = provenance.get("inputs", {})
    record = PurePath(result.case.record).name
    known = [digest for file, digest in inputs.items() if PurePath(file).name == record]
    rows = [("flight record", record, known[0] if len(known) == 1 else "")]
    for run in result.runs:
        model = provenance.get("models", {}).get(run) or _flown(str(result.signals.attrs.get(f"model.{run}", "")))
        rows.append((f"model {run}", model.get("file", ""), model.get("sha256", "")))
    return rows


def _flown(text: str) -> dict[str, str]:
    """Return file and hash of what `pom.replay` says of a model: ``final.fmu, FMI 2.0, sha256 ...``."""
    file, _, rest = text.partition(", ")
    return {"file": file, "sha256": rest.partition("sha256 ")[2]}


def _drive(result: PomResult) -> dict[str, Any]:
    drive = result.case.drive
    moving, still = split_inputs(result)
    how = [
        ("surfaces", _SURFACES.get(drive.surfaces, drive.surfaces)),
        ("engine", _ENGINE.get(drive.engine, drive.engine)),
        ("start", _START[drive.trim]),
        ("feedback", "none: open loop, nothing corrects the model during the run"),
    ]
    inputs = [(label(name), "as recorded, plotted") for name in moving]
    inputs += [(label(name), _steady(result, name)) for name in still]
    return {"how": how, "inputs": inputs}


def _steady(result: PomResult, name: str) -> str:
    """Return an input that does not move: its mean, and how far the record strays from it."""
    values = result.inputs[name].values
    mean, stray = float(values.mean()), float(np.abs(values - values.mean()).max())
    if stray < 1e-9 * max(1.0, abs(mean)):
        return f"{measured(mean, name)} held"
    shown = label(name)
    if shown.is_word:
        return f"{measured(mean, name)}, as recorded"
    value = f"{plainly(float(shown.shown(mean)), shown.unit)} ±\N{NO-BREAK SPACE}{short(float(shown.width(stray)), 2)}"
    return f"{value} {shown.unit}".strip() + ", as recorded"


def _notes(result: PomResult) -> list[str]:
    """Return what the reader must know beside the verdicts: what the case sets, remarks of rows."""
    places: dict[str, list[tuple[str, str]]] = {}
    for row in result.verdict.to_dict("records"):
        if row["measure"] in MODAL and row["verdict"] in ("pass", "fail"):
            row["note"] = "; ".join(piece for piece in row["note"].split("; ") if not _in_mode_table(piece))
        for piece in _BIAS.sub(_bias_words, row["note"]).split("; ") if row["note"] not in ("", "nan") else []:
            places.setdefault(piece, []).append((words(row["criterion"]), row["run"]))
    notes = [f"The window is shorter than the table asks: {result.case.shortened}."] if result.case.shortened else []
    if result.case.conditions:
        given = ", ".join(f"{label(name).words or name} {_given(value, name)}" for name, value in result.case.conditions.items())
        notes.append(f"From the case file, not from the record: {given}.")
    notes += [f"{_where(found, result)}: {piece}" for piece, found in places.items()]
    marks = sorted({MARKS[p] for p in result.verdict["provenance"] if p in ("memory", "partial")})
    if marks:
        notes.append(f"Rows marked “{'” or “'.join(marks)}” were not read word for word in the regulation; check them there first.")
    return list(dict.fromkeys(notes))


def _given(value: float, name: str) -> str:
    """Return a value as somebody set it, without trailing zeros."""
    shown = label(name)
    return (
        measured(value, name)
        if shown.is_word
        else f"{short(float(shown.shown(value)))}\N{NO-BREAK SPACE}{shown.unit}".rstrip("\N{NO-BREAK SPACE}")
    )


_BIAS = re.compile(r"trim\.(\w+) ([+-])([\d.]+) deg is beyond")


def _bias_words(found: re.Match[str]) -> str:
    """Return the remark of a replay on a bias in the words of the table of the trim."""
    name, sign, size = found.groups()
    return f"{label(name).words} biased by {sign.replace('-', MINUS)}{size} deg, beyond"


def _in_mode_table(piece: str) -> bool:
    """Whether a remark only repeats numbers that stand in the table of modes."""
    return re.match(r"flight (zeta )?-?[\d.]+|[\d.]+ cycles$|the model: ", piece) is not None


def _where(found: Sequence[tuple[str, str]], result: PomResult) -> str:
    """Return what a note speaks of: criteria and models, each left out when it is all of them."""
    criteria, runs = list(dict.fromkeys(c for c, _ in found)), list(dict.fromkeys(r for _, r in found))
    every = len(criteria) == result.verdict["criterion"].nunique() and len(runs) < len(result.runs)
    parts = ([] if every else criteria) + ([] if len(runs) == len(result.runs) else runs)
    return ", ".join(parts or criteria)


def _data(result: PomResult, shown: Sequence[Panel], styles: Mapping[str, str]) -> dict[str, Any]:
    """Return what the script needs to draw the case: panels, runs, and the compressed traces."""
    pack = Pack.empty()
    time = result.signals["time"].values
    head: dict[str, Any] = {
        "time": pack.add(time, TIME_STEP),
        "runs": [{"name": run, "style": style} for run, style in styles.items()],
        "events": [[words(name), at] for name, at in result.case.events.items()],
        "panels": [],
    }
    for panel in shown:
        step = step_of(panel.half, panel.limits)
        head["panels"].append(
            {
                "kind": panel.kind,
                "channel": panel.channel,
                "base": "" if panel.label.is_word else panel.label.base,
                "sub": panel.label.sub,
                "words": panel.label.words,
                "unit": panel.label.unit,
                "sign": panel.label.sign,
                "alt": description(panel),
                "limits": [float(f"{edge:.6g}") for edge in panel.limits],
                "span": panel.label.least_span,
                "decimals": max(0, math.ceil(-math.log10(step * 5))),
                "window": panel.window,
                "exits": {run: [[round(t, 3) for t in span] for span in found] for run, found in panel.exits.items() if found},
                "verdicts": _panel_verdicts(panel),
                "traces": {run: pack.add(values, step) for run, values in panel.traces.items()},
                "half": None if panel.half is None else pack.add(panel.half, step),
            }
        )
    return {"head": head, "pack": pack.text()}


def _panel_verdicts(panel: Panel) -> list[dict[str, str]]:
    rows = [row for row in panel.rows if row["measure"] == "trace"]
    return [
        {
            "run": row["run"],
            "symbol": SYMBOLS[row["verdict"]],
            "ratio": fixed(row["worst_ratio"], 2) if math.isfinite(row["worst_ratio"]) else WORDS[row["verdict"]],
            "css": f"is-{row['verdict']}",
        }
        for row in rows
    ]
