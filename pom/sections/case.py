"""What the page of one case shows: header, facts, tables, and the data of its plots."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import pandas as pd

from pom.result import PomResult

from .case_figure import SYMBOLS, figures
from .panels import Panel, description, panels, split_inputs
from .quantities import MISSING, fixed, label, measured, number, percent, pretty_unit, short
from .traces import TIME_STEP, Pack, step_of

WORDS = {"pass": "pass", "fail": "FAIL", "invalid": "invalid", "not_tested": "not tested", "advisory": "advisory"}
# the line code of LR-743 Figs. 18 to 21; any further model takes the next free style
_STYLES = {"datcom": "run-1", "corrected": "run-2", "final": "run-3"}
_SPARE = ("run-4", "run-5", "run-1", "run-2", "run-3")
_ATMOSPHERE = ("h", "h_agl", "h_baro", "p_static", "temperature", "rho", "delta_T", "wind_n", "wind_e", "wind_d", "a_sound")
_SHAPE = ("mass", "x_cg", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "delta_f", "gear", "speedbrake")
_STAGES = {
    "prior": "first model as it is",
    "single": "one term taken from the final model",
    "sequence": "terms taken one after the other, each with all before it",
    "final": "final model",
}
_LEAST_SHOWN = 0.01
_SURFACES = {"recorded": "recorded surface positions drive the model"}
_ENGINE = {"thrust": "recorded thrust drives the model", "throttle": "the recorded lever drives the engine model"}


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


def page(key: str, result: PomResult, provenance: Mapping[str, Any], diagnosis: pd.DataFrame | None) -> dict[str, Any]:
    """Return everything the template ``case.html`` needs for one case."""
    styles = line_styles(result.runs)
    shown = panels(result)
    return {
        "key": key,
        "case": result.case,
        "outcomes": outcomes(result, styles),
        "failure": result.failure,
        "hashes": _hashes(result, provenance),
        "conditions": _conditions(result.conditions),
        "drive": _drive(result),
        "trim": _trim(result.trim),
        "verdicts": _verdict_table(result),
        "diagnosis": _diagnosis(diagnosis),
        "notes": _notes(result),
        "advisory": [c for c in dict.fromkeys(result.verdict.loc[result.verdict["verdict"] == "advisory", "criterion"])],
        "styles": styles,
        "figures": figures(key, result.signals["time"].values, shown, {**styles, "applied": "run-0"}),
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


def words(name: str) -> str:
    """Return a criterion's name as words."""
    return name.replace("_", " ")


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


def _conditions(conditions: Mapping[str, float]) -> list[tuple[str, list[tuple]]]:
    parts: dict[str, list[tuple]] = {"Configuration": [], "Atmosphere": [], "Flight": []}
    for name, value in conditions.items():
        stem = name.rpartition(".")[2]
        part = "Configuration" if stem in _SHAPE else "Atmosphere" if stem in _ATMOSPHERE else "Flight"
        parts[part].append((label(name), measured(value, name)))
    order = {"Configuration": _SHAPE, "Atmosphere": _ATMOSPHERE}
    for part, names in order.items():
        parts[part].sort(key=lambda row: names.index(row[0].name.rpartition(".")[2]))
    return [(part, rows) for part, rows in parts.items() if rows]


def _drive(result: PomResult) -> dict[str, Any]:
    drive = result.case.drive
    moving, still = split_inputs(result)
    how = [
        ("surfaces", _SURFACES.get(drive.surfaces, drive.surfaces)),
        ("engine", _ENGINE.get(drive.engine, drive.engine)),
        ("start", "trimmed to the flight state; what is left stands below" if drive.trim else "flight state, not trimmed"),
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
    value = f"{short(float(shown.shown(mean)), 3)} ±\N{NO-BREAK SPACE}{short(float(shown.width(stray)), 2)}"
    return f"{value} {shown.unit}".strip() + ", as recorded"


def _trim(trim: pd.DataFrame) -> dict[str, Any]:
    rows = []
    for quantity, values in trim.iterrows():
        shown = label(str(quantity))
        left = shown.name.startswith("trim.") and shown.name.endswith("_dot")
        rows.append((shown, [fixed(v, 4) if left else number(v, _digits(v)) for v in shown.shown(values.to_numpy(float))]))
    return {"columns": list(map(str, trim.columns)), "rows": rows}


def _digits(value: float) -> int:
    """Return the significant digits that keep a speed or a height to a tenth."""
    return 3 if abs(value) < 100 else 4 if abs(value) < 1000 else 5


def _verdict_table(result: PomResult) -> list[dict[str, Any]]:
    """Return one block per criterion with one row per model; alternatives of one group follow each other."""
    records = result.verdict.to_dict("records")
    applying = {c.name: c.group for c in result.case.criteria if c.applies}
    groups = list(dict.fromkeys(row["group"] for row in records))
    names = sorted(dict.fromkeys((row["group"], row["criterion"]) for row in records), key=lambda pair: groups.index(pair[0]))
    blocks, begun = [], set()
    for group, name in names:
        rows = [row for row in records if (row["group"], row["criterion"]) == (group, name)]
        joint = ""
        if name in applying and list(applying.values()).count(group) > 1:
            joint = "or" if group in begun else "either"
            begun.add(group)
        first = rows[0]
        blocks.append(
            {
                "criterion": words(name),
                "joint": joint,
                "label": label(first["channel"]) if first["channel"] not in ("", "nan") else None,
                "measure": words(first["measure"]),
                "printed": first["tolerance_text"],
                "applied": _applied(result, first),
                "window": f"{fixed(first['window_start'], 2)} … {fixed(first['window_stop'], 2)}",
                "provenance": first["provenance"],
                "rows": [_verdict_row(row) for row in rows],
            }
        )
    return blocks


def _verdict_row(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    unit = pretty_unit(row["unit"])
    return {
        "run": row["run"],
        "worst": f"{number(row['worst'])} {unit}".strip() if math.isfinite(row["worst"]) else MISSING,
        "at": float(row["at"]),
        "at_text": fixed(row["at"], 2),
        "ratio": fixed(row["worst_ratio"], 2),
        "inside": percent(row["inside"]),
        "exit": float(row["first_exit"]),
        "exit_text": fixed(row["first_exit"], 2),
        "verdict": Verdict.of(row["verdict"]),
    }


def _applied(result: PomResult, row: Mapping[Hashable, Any]) -> str:
    """Return the half width as applied; a width that follows the flight value shows its range."""
    if not math.isfinite(row["width"]):
        return MISSING
    unit = pretty_unit(row["unit"])
    text = number(row["width"])
    if row["channel"] in result.tolerance and row["measure"] == "trace":
        half = result.tolerance[row["channel"]].values
        half = half[np.isfinite(half) & (half > 0)]
        if len(half) and half.max() > 1.005 * half.min():
            text += f" … {number(row['width'] * half.max() / half.min())}"
    return f"± {text} {unit}".strip()


def _diagnosis(table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Return the term-swap table of `pom.diagnose` in its four stages; terms that close next to nothing are counted only."""
    if table is None or table.empty:
        return None
    criteria = [str(c).removesuffix(" ratio") for c in table.columns if str(c).endswith(" ratio")]
    stages = []
    for stage, title in _STAGES.items():
        rows = table[table["stage"] == stage].to_dict("records")
        kept = [row for row in rows if stage != "single" or not abs(row["closes"]) < _LEAST_SHOWN]
        stages.append({"title": title, "rows": [_swap(row, criteria) for row in kept], "hidden": len(rows) - len(kept)})
    return {"criteria": [words(c) for c in criteria], "stages": [stage for stage in stages if stage["rows"] or stage["hidden"]]}


def _swap(row: Mapping[Hashable, Any], criteria: Sequence[str]) -> dict[str, Any]:
    cells = [(fixed(row[f"{c} miss"], 2), fixed(row[f"{c} ratio"], 2)) for c in criteria]
    closes = MISSING if not math.isfinite(row["closes"]) else f"{fixed(100 * row['closes'], 0)} %"
    return {"term": row["term"], "closes": closes, "verdict": Verdict.of(row["verdict"]), "cells": cells}


def _notes(result: PomResult) -> list[str]:
    """Return what the reader must know beside the verdicts: what the case sets, remarks of rows."""
    places: dict[str, list[tuple[str, str]]] = {}
    for row in result.verdict.to_dict("records"):
        for piece in row["note"].split("; ") if row["note"] not in ("", "nan") else []:
            places.setdefault(piece, []).append((words(row["criterion"]), row["run"]))
    notes = [f"The window is shorter than the table asks: {result.case.shortened}."] if result.case.shortened else []
    if result.case.conditions:
        given = ", ".join(f"{label(name).words or name} {measured(value, name)}" for name, value in result.case.conditions.items())
        notes.append(f"From the case file, not from the record: {given}.")
    notes += [f"{_where(found, result)}: {piece}" for piece, found in places.items()]
    if (result.verdict["provenance"] == "memory").any():
        notes.append("Rows marked “memory” were not read in the regulation; check them there before a certification use.")
    return list(dict.fromkeys(notes))


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
        "panels": [],
    }
    for panel in shown:
        step = step_of(panel.half, list(panel.traces.values()))
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
                "limits": panel.limits,
                "span": panel.label.least_span,
                "decimals": max(0, math.ceil(-math.log10(step * 5))),
                "window": panel.window,
                "exits": panel.exits,
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
