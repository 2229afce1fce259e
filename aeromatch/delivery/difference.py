"""What changed between two deliveries: terms, parts of the aircraft, cases, verdicts, formats, in numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import aerodb
import flightmech
import pom
from flightmech.aircraft.parts import different_parts
from pom.result import status_text

from .verification import read_manifest


def package_difference(one: Path, other: Path, model: str = "final", other_model: str | None = None) -> dict[str, Any]:
    """Return what changed from one package to another, or from one model to another of the same.

    Parameters
    ----------
    one, other : Path
        Folders of packages.
    model, other_model : str
        ``datcom``, ``corrected`` or ``final``; the second is the first unless given.

    Returns
    -------
    dict
        ``terms`` and ``coefficients`` (name; state ``added``, ``deleted`` or ``changed``; value before and after where they differ most,
        and where that is; rms difference; largest in standard errors of both), ``parts``, ``cases`` (verdict and worst ratio before and
        after), ``files`` that were added, deleted or changed.
    """
    second = other_model or model
    before, after = aerodb.open(one / f"database/{model}.nc"), aerodb.open(other / f"database/{second}.nc")
    aircraft = [flightmech.read_aircraft(folder / f"aircraft/{name}.toml") for folder, name in ((one, model), (other, second))]
    rows = _differences(before, after)
    return {
        "models": [model, second],
        "terms": [row for row in rows if "/" in row["name"]],
        "coefficients": [row for row in rows if "/" not in row["name"]],
        "parts": different_parts(*aircraft),
        "cases": _cases(one, model, other, second),
        "files": _files(one, other) if one != other else [],
    }


def _differences(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return what differs of terms and coefficients, from `aerodb.compare`."""
    states = {"a": "deleted", "b": "added", "both": "changed"}
    rows = []
    for row in aerodb.compare(before, after).reset_index().to_dict("records"):
        if row["found_in"] == "both" and not row["max_difference"]:
            continue
        rows.append(
            {
                "name": row["term"],
                "state": states[row["found_in"]],
                "before": row["value_a"],
                "after": row["value_b"],
                "where": row["location"],
                "largest": row["max_difference"],
                "rms": row["rms_difference"],
                "in_standard_errors": row["max_in_stderr_difference"],
            }
        )
    return rows


def _cases(one: Path, model: str, other: Path, second: str) -> list[dict[str, Any]]:
    old, new = ({r.case.name: r for r in pom.read_archive(folder / "report").results} for folder in (one, other))
    rows = []
    for name in dict.fromkeys([*old, *new]):
        sides = [(found[name], run) if name in found and run in found[name].runs else None for found, run in ((old, model), (new, second))]
        states = ["" if side is None else status_text(side[0].status(side[1])) for side in sides]
        worst = [None if side is None else (side[0].worst(side[1]) or {}).get("worst_ratio") for side in sides]
        case = (new[name] if name in new else old[name]).case
        rows.append(
            {"row": case.id, "case": case.title, "before": states[0], "after": states[1], "worst_before": worst[0], "worst_after": worst[1]}
        )
    return rows


def _files(one: Path, other: Path) -> list[dict[str, str]]:
    old, new = (read_manifest(folder)["files"] for folder in (one, other))
    states = {
        name: "deleted" if name not in new else "added" if name not in old else "changed"
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    }
    return [{"file": name, "state": state} for name, state in states.items()]
