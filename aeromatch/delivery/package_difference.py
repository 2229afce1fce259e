"""Differences between two data packages, or between two models of one package."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import aerodb
import flightmech
import pom
from aerodb.comparison.comparison import has_hidden_difference
from aeromatch.delivery.flown_checks import flight_conditions_of
from aeromatch.delivery.package_files import read_package_manifest
from flightmech.aircraft.parts import different_parts
from flightmech.errors import AeromatchError
from flightmech.units import from_si
from pom.result import PomResult
from pom.status import status_text

_HANDLING = {
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
"""Handling qualities and performance of `flightmech.characteristics`: words and unit."""
_MODES = ("short period", "phugoid", "Dutch roll", "roll", "spiral")
_MODE_COLUMNS = {
    "period": ("period", "s"),
    "damping_ratio": ("damping ratio", ""),
    "t_half": ("time to half amplitude", "s"),
    "t_double": ("time to double amplitude", "s"),
}


def package_difference(
    one: Path, other: Path, model: str = "final", other_model: str | None = None
) -> dict[str, Any]:
    """Return the differences of one package from another, or of two models of one package.

    Parameters
    ----------
    one, other : Path
        Folders of packages.
    model, other_model : str
        ``datcom``, ``corrected`` or ``final``. The default of the second is the first.

    Returns
    -------
    dict
        ``terms`` and ``coefficients`` (name; state ``added``, ``deleted`` or ``changed``; value
        before and after at the largest difference, and its location; rms difference; largest
        difference in standard errors of both), ``parts``, ``cases`` (verdict and worst ratio
        before and after), ``files`` that were added, deleted or changed; ``felt``: handling
        qualities and performance, trimmed at the ``condition`` of the cleanest validation flight
        (words, unit, before, after).
    """
    second = other_model or model
    before = aerodb.open(one / f"database/{model}.nc")
    after = aerodb.open(other / f"database/{second}.nc")
    old_aircraft = flightmech.read_aircraft(one / f"aircraft/{model}.toml")
    new_aircraft = flightmech.read_aircraft(other / f"aircraft/{second}.toml")
    rows = _term_rows(before, after)
    condition = _trim_condition(other)
    # Two models of one package have the same files.
    files = [] if one == other else _file_rows(one, other)
    return {
        "models": [model, second],
        "condition": condition,
        "felt": _handling_rows(
            _characteristics(old_aircraft, before, condition),
            _characteristics(new_aircraft, after, condition),
        ),
        "terms": [row for row in rows if "/" in row["name"]],
        "coefficients": [row for row in rows if "/" not in row["name"]],
        "parts": different_parts(old_aircraft, new_aircraft),
        "cases": _case_rows(one, model, other=other, other_model=second),
        "files": files,
    }


def _term_rows(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return the differences of terms and coefficients, from `aerodb.compare`."""
    states = {"a": "deleted", "b": "added", "both": "changed"}
    rows = []
    for row in aerodb.compare(before, after).reset_index().to_dict("records"):
        note = str(row["note"] or "")
        is_equal = row["found_in"] == "both" and not row["max_difference"]
        if is_equal and not has_hidden_difference(note):
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
                "note": note,
            }
        )
    return rows


def _trim_condition(package: Path) -> dict[str, float]:
    """Return speed, height, mass and configuration of the cleanest validation flight.

    This is the flight with the least flaps and gear. The result is empty without a trimmed flight.
    """
    flights = flight_conditions_of(pom.read_archive(package / "report").results).values()
    cleanest: dict[str, float] = min(flights, key=_configuration, default={})
    names = ("V", "h", "mass", "delta_f", "gear")
    return {name: cleanest[name] for name in names if name in cleanest}


def _configuration(condition: dict[str, float]) -> tuple[float, float]:
    return condition.get("delta_f", 0.0), condition.get("gear", 0.0)


def _characteristics(aircraft: Any, db: Any, condition: dict[str, float]) -> Any:
    """Return the characteristics of a model, or None if it has no steady flight there."""
    if not condition:
        return None
    try:
        return flightmech.characteristics(aircraft, db, condition)
    except AeromatchError:
        return None


def _handling_rows(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return the rows of `_HANDLING` and of the eigenmotions that both models have."""
    if before is None or after is None:
        return []
    rows: list[dict[str, Any]] = []
    for name, (words, unit) in _HANDLING.items():
        old, new = _value(before.table, name), _value(after.table, name)
        if old is None or new is None:
            continue
        if unit:
            old, new = float(from_si(old, unit)), float(from_si(new, unit))
        rows.append({"words": words, "unit": unit, "before": old, "after": new})
    for mode in _MODES:
        old_modes = before.modes[before.modes["mode"] == mode]
        new_modes = after.modes[after.modes["mode"] == mode]
        # A mode that is split or absent has no counterpart.
        if len(old_modes) == 1 and len(new_modes) == 1:
            rows += _mode_rows(mode, old_modes.iloc[0], new_modes.iloc[0])
    return rows


def _mode_rows(mode: str, before: pd.Series, after: pd.Series) -> list[dict[str, Any]]:
    is_periodic = np.isfinite(before["period"]) or np.isfinite(after["period"])
    rows = []
    for column, (words, unit) in _MODE_COLUMNS.items():
        old, new = float(before[column]), float(after[column])
        # A damping ratio describes a periodic motion only.
        if column == "damping_ratio" and not is_periodic:
            continue
        if np.isfinite(old) or np.isfinite(new):
            rows.append({"words": f"{mode}: {words}", "unit": unit, "before": old, "after": new})
    return rows


def _value(characteristics: Any, name: str) -> float | None:
    if name not in characteristics.index or characteristics.loc[name, "absent"]:
        return None
    return float(characteristics.loc[name, "value"])


def _case_rows(one: Path, model: str, other: Path, other_model: str) -> list[dict[str, Any]]:
    """Return verdict and worst ratio of every case in both packages."""
    old, new = _results_by_case(one), _results_by_case(other)
    rows = []
    for name in old | new:
        result_before, result_after = old.get(name), new.get(name)
        result = result_after or result_before
        assert result is not None
        status_before, worst_before = _verdict(result_before, model)
        status_after, worst_after = _verdict(result_after, other_model)
        rows.append(
            {
                "row": result.case.id,
                "case": result.case.title,
                "before": status_before,
                "after": status_after,
                "worst_before": worst_before,
                "worst_after": worst_after,
            }
        )
    return rows


def _results_by_case(package: Path) -> dict[str, PomResult]:
    results = pom.read_archive(package / "report").results
    return {result.case.name: result for result in results}


def _verdict(result: PomResult | None, run: str) -> tuple[str, float | None]:
    """Return verdict and worst ratio of a run; an empty verdict if it was not replayed."""
    if result is None or run not in result.runs:
        return "", None
    ratio = result.deciding_row(run).get("worst_ratio", math.nan)
    return status_text(result.status(run)), ratio if math.isfinite(ratio) else None


def _file_rows(one: Path, other: Path) -> list[dict[str, str]]:
    old, new = (read_package_manifest(folder)["files"] for folder in (one, other))
    rows = []
    for name in sorted({*old, *new}):
        if old.get(name) == new.get(name):
            continue
        state = "changed"
        if name not in new:
            state = "deleted"
        elif name not in old:
            state = "added"
        rows.append({"file": name, "state": state})
    return rows
