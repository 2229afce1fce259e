"""What changed between two deliveries: terms, parts of the aircraft, cases, verdicts, formats, in numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import aerodb
import flightmech
import pom
from flightmech.aircraft.parts import different_parts
from flightmech.errors import AeromatchError
from flightmech.units import from_si
from pom.result import status_text

from .flown_checks import conditions_of
from .verification import read_manifest

_FELT = {
    "V_stall": ("stall speed, true, power off", "kt"),
    "static_margin_fixed": ("static margin, controls held, chords", ""),
    "elevator_per_g": ("elevator per g in a pull-up", "deg"),
    "stick_force_per_g": ("stick force per g in a pull-up", "lbf"),
    "delta_r_per_beta": ("rudder over sideslip, straight flight", ""),
    "phi_per_beta": ("bank over sideslip, straight flight", ""),
    "roll_rate_peak": ("highest roll rate at full aileron", "deg/s"),
    "L_D_max": ("best lift over drag, power off", ""),
    "climb_rate_max": ("best rate of climb", "ft/min"),
}
"""What a pilot feels, of `flightmech.characteristics`: words and unit."""
_MODES = ("short period", "phugoid", "Dutch roll", "roll", "spiral")
_OF_MODES = {
    "period": ("period", "s"),
    "damping_ratio": ("damping ratio", ""),
    "t_half": ("time to half amplitude", "s"),
    "t_double": ("time to double amplitude", "s"),
}


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
        after), ``files`` that were added, deleted or changed; ``felt``: what a pilot feels of it, trimmed at the ``condition`` of the
        cleanest validation flight (words, unit, before, after).
    """
    second = other_model or model
    before, after = aerodb.open(one / f"database/{model}.nc"), aerodb.open(other / f"database/{second}.nc")
    aircraft = [flightmech.read_aircraft(folder / f"aircraft/{name}.toml") for folder, name in ((one, model), (other, second))]
    rows, condition = _differences(before, after), _condition(other)
    return {
        "models": [model, second],
        "condition": condition,
        "felt": _felt(*(_characteristics(craft, db, condition) for craft, db in zip(aircraft, (before, after), strict=True))),
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
                "note": str(row["note"] or ""),
            }
        )
    return rows


def _condition(package: Path) -> dict[str, float]:
    """Return speed, height, mass and configuration of the validation flight with the least flaps and gear; empty where none is trimmed."""
    flights = conditions_of(pom.read_archive(package / "report").results).values()
    found = min(flights, key=lambda at: (at.get("delta_f", 0.0), at.get("gear", 0.0)), default={})
    return {name: found[name] for name in ("V", "h", "mass", "delta_f", "gear") if name in found}


def _characteristics(aircraft: Any, db: Any, condition: dict[str, float]) -> Any:
    try:
        return flightmech.characteristics(aircraft, db, condition) if condition else None
    except AeromatchError:  # no steady flight of one of the two: there is nothing to compare
        return None


def _felt(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return the rows of `_FELT` and of the eigenmotions that both models have, in the units of the field."""
    if before is None or after is None:
        return []
    rows = []
    for name, (words, unit) in _FELT.items():
        values = [value for found in (before, after) if (value := _value(found.table, name)) is not None]
        if len(values) == 2:
            shown = [float(from_si(value, unit)) if unit else value for value in values]
            rows.append({"words": words, "unit": unit, "before": shown[0], "after": shown[1]})
    for mode in _MODES:
        sides = [found.modes[found.modes["mode"] == mode] for found in (before, after)]
        for column, (words, unit) in _OF_MODES.items() if all(len(side) == 1 for side in sides) else ():
            shown = [float(side[column].iloc[0]) for side in sides]
            periodic = any(np.isfinite(side["period"].iloc[0]) for side in sides)
            if np.isfinite(shown).any() and (periodic or column != "damping_ratio"):
                rows.append({"words": f"{mode}: {words}", "unit": unit, "before": shown[0], "after": shown[1]})
    return rows


def _value(characteristics: Any, name: str) -> float | None:
    if name not in characteristics.index or characteristics.loc[name, "absent"]:
        return None
    return float(characteristics.loc[name, "value"])


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
