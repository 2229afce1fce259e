"""Stability logs of XFLR5 and flow5 (type 7), as text or RTF.

- A block has the derivatives of one trimmed condition, in SI units and without dimension, in the
  stability axes of flight dynamics (x forward, z down) about the centre of gravity. They are per
  radian, and rates are p b/2V, q cbar/2V, r b/2V.
- ``CLa`` of XFLR5 is -CZ_alpha, CL_alpha plus CD. flow5 prints ``CZa``.
- The log has neither totals nor Mach number. The "reference length" of XFLR5 is the span. Its mean
  chord follows from the two forms of each derivative, Mq/Cmq and Zw/CLa:

      Mq = Cmq rho V S cbar^2 / 4,   Zw = -CLa rho V S / 2.

- XFLR5 has one control for all surfaces that its polar moves. Its derivatives are per radian, those
  of flow5 per unit of the control variable, which is a degree if its gain is 1.

Source: logs of xflr5 6.44; source code of flow5 (``StabDerivatives::computeNDStabDerivatives``,
after Etkin and Reid, table 4.4, and ``PlaneTask::computeControlDerivatives``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from flightmech.errors import ParseError
from flightmech.units import DEGREE, to_si

_MARKS = ("Longitudinal derivatives", "Type 7 - Stability polar")
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?nan(?:\(ind\))?|[-+]?inf)"
_PAIR = re.compile(rf"([A-Z][a-z]{{1,2}})\s*=\s*{_NUMBER}\s+(C[A-Za-z]{{2,3}})\s*=\s*{_NUMBER}")
_ALPHA = re.compile(
    rf"(?:zero-moment angle\.*\s*Alpha\s*=|Calculating Plane for α\s*=)\s*{_NUMBER}"
)
_POSITION = re.compile(rf"Calculation for control position\s+{_NUMBER}")
_TURNED = re.compile(rf"total (?:flap )?angle is\s+{_NUMBER}")
_SPEED = re.compile(rf"balance the weight\.*\s*VInf\s*=\s*{_NUMBER}\s*(\S+)")
_DENSITY = re.compile(rf"Density\s*=\s*{_NUMBER}\s*(\S+)")
_AREA = re.compile(rf"Reference Area\s*=\s*{_NUMBER}\s*(\S+)")
_SPAN = re.compile(rf"Reference length\s*=\s*{_NUMBER}\s*(\S+)")
_CENTRE = re.compile(rf"CoG_([xyz])\s*=\s*{_NUMBER}\s*(\S+)")
# Derivative of the log: coefficient, variable, sign.
_MEANINGS = {
    "CLa": ("CL", "alpha", 1.0),
    "CZa": ("CL", "alpha", -1.0),
    "Cma": ("Cm", "alpha", 1.0),
    "CLq": ("CL", "qhat", 1.0),
    "CZq": ("CL", "qhat", -1.0),
    "Cmq": ("Cm", "qhat", 1.0),
    "CXde": ("CD", "control", -1.0),
    "CYde": ("CY", "control", 1.0),
    "CZde": ("CL", "control", -1.0),
    "CLde": ("Cl", "control", 1.0),
    "CMde": ("Cm", "control", 1.0),
    "CNde": ("Cn", "control", 1.0),
}
for _name in ("CY", "Cl", "Cn"):
    for _letter, _variable in (("b", "beta"), ("p", "phat"), ("r", "rhat")):
        _MEANINGS[_name + _letter] = (_name, _variable, 1.0)
_NEEDED = ("Cma", "Cmq", "CYb", "Clb", "Cnb", "Clp", "Cnp", "Clr", "Cnr")
_CONTROL = "control"
_TOLERANCE = 0.01  # of the reference quantities that follow from the derivatives
_ALPHA_REMARK = "the lift slope of the log is -CZ_alpha, CL_alpha plus the drag coefficient"
_RTF_BYTE = re.compile(r"\\'([0-9a-fA-F]{2})")
_RTF_WORD = re.compile(r"\\(?:u(-?\d+) ?\??|[a-z]+-?\d* ?|[*~\\{}])")


class _LogLine(NamedTuple):
    number: int
    text: str


class _TrimBlock(NamedTuple):
    """Derivatives of one condition: name to without dimension, with dimension and line."""

    pairs: dict[str, tuple[float, float, int]]
    controls: dict[str, dict[str, tuple[float, float, int]]]


def is_stability_log(text: str) -> bool:
    """Return whether a text is a log of a stability analysis of XFLR5 or flow5."""
    return any(mark in text for mark in _MARKS) and "polar name" not in text.lower()[:400]


def read_stability_log(file: Path, text: str) -> CoefficientSet:
    """Return the derivatives of all conditions of a log.

    Raises
    ------
    ParseError
        The log has no derivatives or is cut off, its conditions have different centres of gravity,
        or its reference quantities do not agree with its derivatives.
    """
    lines = [_LogLine(number, line) for number, line in _plain_lines(text)]
    blocks = list(_blocks(file, lines))
    program = "XFLR5"
    if any("CZa" in block.pairs for block in blocks):
        program = "flow5"
    alphas = [float(m[1]) for m in _matches(_ALPHA, lines)]
    if not blocks or len(alphas) != len(blocks):
        raise ParseError(
            str(file),
            len(lines),
            f"{len(blocks)} blocks of derivatives with {len(alphas)} angles of attack",
            "the log of a complete stability analysis (type 7), one block for each trimmed "
            "condition",
        )
    deflections = _deflections(file, lines, len(blocks))
    controls: tuple[str, ...] = tuple(dict.fromkeys(_names(blocks)))
    rows: list[dict[str, Any]] = []
    for block, alpha, deflection in zip(blocks, alphas, deflections):
        condition = {"alpha": alpha * DEGREE, "file": file.name}
        if deflection and not controls:
            controls = (_CONTROL,)
        condition |= {name: deflection * DEGREE for name in controls}
        rows += _rows(block, condition, program)
    reference = _reference(file, lines, blocks) if program == "XFLR5" else None
    remarks = [_ALPHA_REMARK]
    if reference is not None:
        remarks.append(
            f"the mean chord {reference.cbar:.4g} m follows from Mq and Cmq, Zw and CLa; the log "
            f"does not print it"
        )
    if controls:
        remarks.append(
            "derivatives of a control are for all surfaces that it moves, "
            + ("per radian" if program == "XFLR5" else "per degree of its variable (gain 1)")
        )
    return CoefficientSet(
        program,
        (file.name,),
        force_axes="stability",
        moment_axes="stability",
        control_axes="stability",
        reference=reference,
        controls=controls,
        numbers=make_numbers(rows, controls),
        unit_stated=reference is not None,
        remarks=tuple(remarks),
        inviscid=True,
    )


def _plain_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield numbers and texts of lines; RTF without its control words."""
    is_rtf = text.lstrip().startswith("{\\rtf")
    for number, line in enumerate(text.split("\n"), 1):
        if not is_rtf:
            yield number, line
            continue
        for part in re.split(r"\\par(?![a-z])", line):
            plain = _RTF_BYTE.sub(lambda m: bytes.fromhex(m[1]).decode("cp1252", "replace"), part)
            plain = _RTF_WORD.sub(lambda m: chr(int(m[1]) % 65536) if m[1] else "", plain)
            yield number, plain.replace("{", "").replace("}", "").rstrip("\\")


def _matches(pattern: re.Pattern[str], lines: list[_LogLine]) -> Iterator[re.Match[str]]:
    for line in lines:
        yield from pattern.finditer(line.text)


def _blocks(file: Path, lines: list[_LogLine]) -> Iterator[_TrimBlock]:
    """Yield the derivatives of each condition."""
    block: _TrimBlock | None = None
    in_controls = False
    name = _CONTROL
    for number, text in lines:
        stripped = text.strip()
        if stripped.startswith("Longitudinal derivatives"):
            if block is not None:
                yield _complete(file, block)
            block, in_controls, name = _TrimBlock({}, {}), False, _CONTROL
        elif block is not None and stripped.startswith("Control derivatives"):
            in_controls = True
        elif block is not None:
            found = _PAIR.findall(text)
            for dimensional, first, reduced, second in found:
                pair = (_value(file, number, reduced, second), float(first), number)
                if in_controls:
                    block.controls.setdefault(name, {})[f"{reduced}"] = pair
                elif dimensional:
                    block.pairs.setdefault(reduced, pair)
            if in_controls and stripped and not found:
                # flow5 prints the name of each control; XFLR5 goes on with its matrices.
                in_controls = not stripped.startswith("_")
                name = stripped
    if block is not None:
        yield _complete(file, block)


def _value(file: Path, line: int, name: str, digits: str) -> float:
    value = float(digits.partition("(")[0])
    if not abs(value) < 1e6:
        raise ParseError(str(file), line, f"{name} = {digits}", "a number; the run has failed")
    return value


def _complete(file: Path, block: _TrimBlock) -> _TrimBlock:
    missing = [name for name in _NEEDED if name not in block.pairs]
    if not {"CLa", "CZa"} & set(block.pairs):
        missing.insert(0, "CLa")
    if missing:
        lines = [line for _, _, line in block.pairs.values()]
        raise ParseError(
            str(file),
            max(lines, default=0),
            f"derivatives without {', '.join(missing)}",
            "a whole block; the log was cut off",
        )
    return block


def _names(blocks: list[_TrimBlock]) -> Iterator[str]:
    for block in blocks:
        yield from block.controls


def _deflections(file: Path, lines: list[_LogLine], number: int) -> list[float]:
    """Return the angle of the control in each condition; 0 if the log moves none. [deg]"""
    positions: list[float] = []
    angles: list[float] = []
    for line in lines:
        if match := _POSITION.search(line.text):
            positions.append(float(match[1]))
            angles.append(0.0)
        elif angles and (match := _TURNED.search(line.text)):
            angles[-1] = angles[-1] or float(match[1])
    if not positions:
        return [0.0] * number
    if len(positions) != number:
        raise ParseError(
            str(file),
            0,
            f"{len(positions)} control positions with {number} blocks of derivatives",
            "a log in which every control position was trimmed; leave out the others",
        )
    return angles


def _rows(block: _TrimBlock, condition: dict[str, Any], program: str) -> Iterator[dict[str, Any]]:
    """Yield the derivatives of a block in the neutral form."""
    for printed, (value, _, line) in block.pairs.items():
        if printed in _MEANINGS:
            coefficient, variable, sign = _MEANINGS[printed]
            yield condition | _number(coefficient, variable, sign * value, line)
    per_unit = 1.0 if program == "XFLR5" else 1.0 / DEGREE
    for name, pairs in block.controls.items():
        for printed, (value, _, line) in pairs.items():
            coefficient, _, sign = _MEANINGS[printed]
            yield condition | _number(coefficient, name, sign * value * per_unit, line)


def _number(coefficient: str, variable: str, value: float, line: int) -> dict[str, Any]:
    return {"coefficient": coefficient, "variable": variable, "value": value, "line": line}


def _reference(file: Path, lines: list[_LogLine], blocks: list[_TrimBlock]) -> EstimateReference:
    """Return the reference quantities in metres, checked against the derivatives."""
    S = _stated(file, lines, _AREA, "Reference Area", 2)
    b = _stated(file, lines, _SPAN, "Reference length", 1)
    centres: dict[str, set[float]] = {}
    for match in _matches(_CENTRE, lines):
        metres = float(to_si(float(match[2]), _unit(match[3]), "m"))
        centres.setdefault(match[1], set()).add(metres)
    moving = [f"CoG_{axis}" for axis, values in centres.items() if len(values) > 1]
    if moving or set(centres) != set("xyz"):
        raise ParseError(
            str(file),
            0,
            f"{', '.join(moving)} that moves" if moving else "no CoG_x, CoG_y, CoG_z",
            "one centre of gravity for all conditions: the derivatives are about it",
        )
    # The log prints dimensional and reduced derivatives side by side. Their ratios hold the
    # reference lengths: Zw / CLa = rho V S / 2, and Mq / Cmq = rho V S cbar^2 / 4.
    zw, lift_slope = blocks[0].pairs["CLa"][1], blocks[0].pairs["CLa"][0]
    mq, damping, line = blocks[0].pairs["Cmq"][1], *blocks[0].pairs["Cmq"][::2]
    lv, dihedral = blocks[0].pairs["Clb"][1], blocks[0].pairs["Clb"][0]
    if min(abs(lift_slope), abs(damping), abs(zw)) == 0.0:
        raise ParseError(str(file), line, "CLa or Cmq 0", "derivatives of an aeroplane")
    cbar = (2.0 * abs(mq / damping) / abs(zw / lift_slope)) ** 0.5
    checks = []
    if dihedral:
        checks.append(("span", b, abs(lv / dihedral) / abs(zw / lift_slope)))
    rho, speed = _find(lines, _DENSITY), _find(lines, _SPEED)
    if rho is not None and speed is not None and (rho[1], speed[1]) == ("kg/m3", "m/s"):
        checks.append(("area", S, abs(zw / lift_slope) / (0.5 * rho[0] * speed[0])))
    for name, stated, implied in checks:
        if abs(implied / stated - 1.0) > _TOLERANCE:
            raise ParseError(
                str(file),
                line,
                f"a reference {name} of {stated:.5g}",
                f"{implied:.5g}, which the derivatives give; the log is of two analyses or was "
                f"changed",
            )
    x, y, z = (centres[axis].pop() for axis in "xyz")
    return EstimateReference(S, cbar, b, x=x, y=y, z=z)


def _find(lines: list[_LogLine], pattern: re.Pattern[str]) -> tuple[float, str] | None:
    for match in _matches(pattern, lines):
        return float(match[1]), _unit(match[2])
    return None


def _stated(
    file: Path, lines: list[_LogLine], pattern: re.Pattern[str], name: str, power: int
) -> float:
    """Return the only value of a reference quantity in metres."""
    values = set()
    for match in _matches(pattern, lines):
        values.add(float(to_si(float(match[1]), _unit(match[2]), "m" if power == 1 else "m2")))
    if len(values) != 1:
        raise ParseError(
            str(file),
            0,
            f"{len(values)} values of '{name}'",
            "one: the log of the stability analyses of one polar",
        )
    return values.pop()


def _unit(text: str) -> str:
    """Return a unit with plain digits: XFLR5 prints a superscript."""
    return text.replace("²", "2").replace("³", "3").rstrip("\\")
