"""Plane polars of XFLR5 and flow5, and their stability logs.

- A plane polar has totals over angle of attack or sideslip, with the profile drag of its foils. It
  states neither reference quantities nor Mach number.
- Its moments are about the wind axes aft, right and up, so Cl and Cn have the opposite sign of
  those of flight dynamics, and Cm the same. Positive sideslip is nose left, as in flight dynamics.
  flow5 changed the sign of the sideslip in version 7.24, which its files do not state.
- Rows of a stability polar (type 7) are trimmed with a control that the file does not print.

Source: exports of xflr5 6.44; the source code of XFLR5 (``PanelAnalysis``, moments along
``WindDirection``, ``rotateGeomZ``) and of flow5 (``PlanePolar::exportToString``, ``AeroForces``,
``objects::windDirection``), and one public export of flow5, type 1.  Some exports of flow5 7.57
have the first row at the end of the heading.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aerodb.estimators.coefficient_set import CoefficientSet, make_numbers
from aerodb.estimators.programs.xflr5_log import is_stability_log, read_stability_log
from flightmech.errors import ParseError
from flightmech.support.input_files import WESTERN, read_text
from flightmech.units import DEGREE

_EXPECTED = "a plane polar or a stability log of XFLR5 or flow5"
_FOIL = ("Calculated polar for:", "Top Xtr", "Top_Xtr")
_UNITS = re.compile(r"\([^)]*\)")
# First columns of flow5 in their order.
_FLOW5: tuple[str, ...] = (
    *("Ctrl", "α", "β", "φ", "CL", "CD", "CD_viscous", "CD_induced", "CY", "Cm"),
    *("Cm_viscous", "Cm_pressure", "Cl", "Cn"),
)
# Columns of versions before 6 by their later names; GCm is about the centre of gravity.
_OLD_NAMES = {"ICd": "CDi", "PCd": "CDv", "TCd": "CD", "GCm": "Cm"}
_OLD_NAMES |= {"Rm": "Cl", "GRm": "Cl", "Ym": "Cn", "GYm": "Cn"}
_NUMBER = re.compile(r"[-+]?(?:\d[\d.]*(?:[eE][-+]?\d+)?|nan|inf)", re.IGNORECASE)
_RULE = re.compile(r"[\s_-]*$")
_COMMON = {"CL": "CL", "CD": "CD", "CY": "CY", "Cl": "Cl", "Cm": "Cm", "Cn": "Cn"}
_AFT_AND_UP = ("Cl", "Cn")  # moments about axes aft and up
_STABILITY_POLAR = re.compile(r"^(?:Wing p|P)olar name\s*:\s*T7\b", re.MULTILINE)
_MOST_LIFT = 10.0  # a larger lift coefficient is a run that did not converge
_TRIMMED = 1e-4  # rows whose pitching moments are all smaller are trimmed
_NO_REFERENCE = (
    "the polar states no reference quantities: Cm, Cl and Cn are about the centre of gravity of "
    "its definition"
)
_WIND_AXES = (
    "moments at a sideslip are about the wind axes: Cm cbar/b sin(beta) in Cl is not taken out"
)


def is_xflr5(text: str) -> bool:
    """Return whether a text is a plane polar or a log, or a foil polar, of XFLR5 or flow5."""
    return is_stability_log(text) or _heading(text.splitlines()) is not None or is_foil_polar(text)


def is_foil_polar(text: str) -> bool:
    """Return whether a text is a polar of a foil section, which has no aeroplane."""
    return any(mark in text[:3000] for mark in _FOIL)


def read_xflr5(path: str | Path) -> CoefficientSet:
    """Return the numbers of a plane polar or of a stability log.

    Parameters
    ----------
    path : str or Path
        A polar as text or CSV, or a log as text or RTF.

    Raises
    ------
    ParseError
        The file is a polar of a foil section or of a stability analysis, is damaged, or a lift
        coefficient is that of a run which did not converge.
    """
    file = Path(path)
    text = read_text(file, _EXPECTED, otherwise=WESTERN)
    if is_foil_polar(text):
        raise ParseError(
            str(file),
            1,
            "a polar of a foil section (2D)",
            f"{_EXPECTED}; coefficients of a section are not those of an aeroplane",
        )
    if is_stability_log(text):
        return read_stability_log(file, text)
    lines = text.split("\n")
    heading = _heading(lines)
    if heading is None:
        raise ParseError(str(file), 1, repr(text[:60]), _EXPECTED)
    return _read_polar(file, text, lines, heading)


def _heading(lines: Sequence[str]) -> tuple[int, list[str], str] | None:
    """Return position, columns and program of the heading of a plane polar; None without one."""
    for position, line in enumerate(lines[:60]):
        words = _UNITS.sub("", line).replace(",", " ").split()
        if words[:1] == ["alpha"] and "ICd" in words:
            words = [_OLD_NAMES.get(word, word) for word in words]
        if words[:1] == ["alpha"] and {"CL", "CDi", "CDv", "CD", "Cm"} <= set(words):
            return position, words, "XFLR5"
        if tuple(words[: len(_FLOW5)]) == _FLOW5:
            # Later headings have blanks in their names and are not used.
            return position, list(_FLOW5), "flow5"
    return None


def _read_polar(
    file: Path, text: str, lines: Sequence[str], heading: tuple[int, list[str], str]
) -> CoefficientSet:
    """Return the totals of a plane polar."""
    position, columns, program = heading
    if _STABILITY_POLAR.search(text):
        _refuse_trimmed(file, "a polar of type 7 (stability analysis)")
    rows: list[dict[str, Any]] = []
    has_friction = False
    is_lateral = False
    moments = []
    angles = set()
    rest = _row_in_heading(lines[position]) if program == "flow5" else ""
    for number, line in enumerate([rest, *lines[position + 1 :]], position + 1):
        words = line.replace(",", " ").split()
        if _RULE.match(line):
            continue
        values = _read_row(file, number, words, columns, program)
        condition = _condition(file, number, values, program)
        has_friction |= values[_friction(columns)] != 0.0
        is_lateral |= condition["beta"] != 0.0
        moments.append(values["Cm"])
        angles.add(condition["alpha"])
        for coefficient, value in _turn_to_flight_dynamics(values, condition["beta"]).items():
            rows.append(condition | {"coefficient": coefficient, "value": value})
    if not rows:
        raise ParseError(str(file), position + 1, "a heading without a row", "a computed polar")
    if len(angles) > 1 and max(abs(moment) for moment in moments) < _TRIMMED:
        _refuse_trimmed(file, "rows without a pitching moment at all angles of attack")
    remarks = [_NO_REFERENCE]
    if is_lateral:
        remarks.append(_WIND_AXES)
    return CoefficientSet(
        program,
        (file.name,),
        force_axes="stability",
        moment_axes="stability",
        control_axes="stability",
        reference=None,
        controls=(),
        numbers=make_numbers(rows, ()),
        remarks=tuple(remarks),
        inviscid=not has_friction,
    )


def _row_in_heading(line: str) -> str:
    """Return the numbers at the end of a heading of flow5, which are its first row."""
    words = _UNITS.sub("", line).replace(",", " ").split()
    count = 0
    for word in reversed(words):
        if not _NUMBER.fullmatch(word):
            break
        count += 1
    return " ".join(words[len(words) - count :])


def _refuse_trimmed(file: Path, found: str) -> None:
    raise ParseError(
        str(file),
        0,
        found,
        "a polar over angle of attack or sideslip with fixed controls (type 1, 2 or 5): a trimmed "
        "polar does not print the deflections; its log has derivatives",
    )


def _friction(columns: Sequence[str]) -> str:
    return "CDv" if "CDv" in columns else "CD_viscous"


def _read_row(
    file: Path, line: int, words: Sequence[str], columns: Sequence[str], program: str
) -> dict[str, float]:
    """Return the numbers of a row by the name of their column."""
    is_complete = len(words) == len(columns)
    if program == "flow5":
        is_complete = len(words) >= len(columns)
    if not is_complete:
        raise ParseError(
            str(file), line, f"{len(words)} numbers", f"{len(columns)}, as the heading has"
        )
    values = {}
    for name, word in zip(columns, words):
        try:
            values[name] = float(word)
        except ValueError:
            values[name] = float("nan")
        if not np.isfinite(values[name]):
            raise ParseError(str(file), line, f"{name} {word!r}", "a number; the run has failed")
    if abs(values["CL"]) > _MOST_LIFT:
        raise ParseError(
            str(file),
            line,
            f"CL = {values['CL']:g}",
            f"at most {_MOST_LIFT:g}; the run has not converged, or the reference area is wrong",
        )
    return values


def _condition(file: Path, line: int, values: Mapping[str, float], program: str) -> dict[str, Any]:
    """Return the flight condition of a row. [rad]"""
    alpha = values["α"] if program == "flow5" else values["alpha"]
    beta = values["β"] if program == "flow5" else values.get("Beta", 0.0)
    if program == "flow5" and beta != 0.0:
        raise ParseError(
            str(file),
            line,
            f"a sideslip of {beta:g} deg",
            "0: flow5 changed its sign in version 7.24 and the file does not state the version; "
            "take the lateral derivatives from the stability log",
        )
    if values.get("Ctrl", 0.0) != 0.0:
        raise ParseError(
            str(file),
            line,
            f"the control parameter {values['Ctrl']:g}",
            "0: the file does not state which controls it moves; give one polar without it",
        )
    return {
        "alpha": alpha * DEGREE,
        "beta": beta * DEGREE,
        "file": file.name,
        "line": line,
        "variable": "",
    }


def _turn_to_flight_dynamics(values: Mapping[str, float], beta: float) -> dict[str, float]:
    """Return the coefficients with the axes and signs of flight dynamics.

    With the drag and side force D, Y along the wind axes, those along the stability axes are
    CD cos(beta) + CY sin(beta) and CY cos(beta) - CD sin(beta).
    """
    turned = {}
    for name in _COMMON:
        if name in values:
            turned[name] = -values[name] if name in _AFT_AND_UP else values[name]
    # From wind axes to stability axes, a rotation by the sideslip.
    if beta and "CY" in turned:
        sin, cos = float(np.sin(beta)), float(np.cos(beta))
        drag, side = turned["CD"], turned["CY"]
        turned["CD"] = drag * cos + side * sin
        turned["CY"] = side * cos - drag * sin
    return turned
