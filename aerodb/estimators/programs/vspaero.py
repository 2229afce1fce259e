"""Outputs of VSPAERO (OpenVSP): ``.stab`` and ``.polar``.

- ``.stab``: one block per condition with total coefficients and derivatives per radian, controls
  included; rates are p b/2V, q c/2V, r b/2V. The names of the controls are those of the rows of the
  perturbation table, in the order of the columns ``ConGrp_1``, ``ConGrp_2`` ...
- ``CMx``, ``CMy``, ``CMz`` are in the axes of the drawing (x aft, z up). ``CMl``, ``CMm`` and
  ``CMn`` are those of flight dynamics, and only these are used.
- ``CS`` is the side force along the wind axes, of which the drag has a part: its slope over
  sideslip is CY_beta + CD. The side force of the body is ``CFy``, which is read.
- ``.polar``: totals over angle of attack, with an empirical friction drag. The heading of some
  versions lacks the last column, FOpt. Version 7 has two lines before the heading, ``tot`` in the
  names of the totals, and moments in the axes of the drawing only.
- The files state no unit of length, and the sign of a control is that of its set-up file.

Source: prints of VSPAERO 6.0.1 to the versions of 2021, and the source code of version 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from flightmech.errors import ParseError
from flightmech.support.input_files import demand_regular
from flightmech.units import DEGREE

_HEADER = ("Sref_", "Cref_", "Bref_", "Xcg_", "Ycg_", "Zcg_", "Mach_", "AoA_", "Beta_")
# Rate in the header: reduced rate and the length that reduces it.
_RATES = {
    "Roll__Rate": ("phat", "Bref_"),
    "Pitch_Rate": ("qhat", "Cref_"),
    "Yaw___Rate": ("rhat", "Bref_"),
}
_NOT_CONTROLS = ("Base_Aero", "Alpha", "Beta", *_RATES, "Mach", "Case", "Coef")
_COEFFICIENTS = {"CL": "CL", "CD": "CD", "CFy": "CY", "CMl": "Cl", "CMm": "Cm", "CMn": "Cn"}
_COLUMNS = {"Alpha": "alpha", "Beta": "beta", "p": "phat", "q": "qhat", "r": "rhat"}
_AXES: dict[str, Any] = {"force_axes": "stability", "moment_axes": "body", "control_axes": "body"}
_POLAR_HEAD = ("Beta", "Mach", "AoA")
# Columns of a polar: coefficient, and its sign in the axes of flight dynamics.
_POLAR = {
    "CL": ("CL", 1.0),
    "CDtot": ("CD", 1.0),
    "CFy": ("CY", 1.0),
    "CMl": ("Cl", 1.0),
    "CMm": ("Cm", 1.0),
    "CMn": ("Cn", 1.0),
}
_POLAR_7 = {
    "CLtot": ("CL", 1.0),
    "CDtot": ("CD", 1.0),
    "CFytot": ("CY", 1.0),
    "CMxtot": ("Cl", -1.0),
    "CMytot": ("Cm", 1.0),
    "CMztot": ("Cn", -1.0),
}
_POLAR_HEAD_LINES = 5  # the heading is one of the first lines
_UNNAMED = "FOpt"  # last column, which the heading of some versions lacks
_MOST_LIFT = 10.0  # a larger lift coefficient is a run that did not converge
# Two controls whose lift and rolling moment are equal and opposite within this share cancel. The
# other coefficients of the same surface differ by the noise of the program.
_OPPOSITE = 0.1
_INVISCID = (
    "VSPAERO computes inviscid flow: the drag of a .stab file is the induced drag, and no stall"
)
_FRICTION = "the friction drag CDo of a .polar file is an empirical estimate of the program"


def is_vspaero(text: str) -> bool:
    """Return whether a text is an output of VSPAERO that `read_vspaero` reads."""
    head = text[:4000]
    return ("Sref_" in head and "Base_Aero" in text) or _is_polar(head)


def _is_polar(head: str) -> bool:
    return _polar_heading(head.splitlines()) is not None


def _polar_heading(lines: Sequence[str]) -> int | None:
    """Return the position of the heading of a polar; None without one."""
    for position, line in enumerate(lines[:_POLAR_HEAD_LINES]):
        words = line.split()
        if tuple(words[:3]) == _POLAR_HEAD and "CDtot" in words:
            return position
    return None


def read_vspaero(path: str | Path) -> CoefficientSet:
    """Return the numbers of one output of VSPAERO.

    Parameters
    ----------
    path : str or Path
        A file ``.stab`` or ``.polar``.

    Raises
    ------
    ParseError
        The file is not such an output, is empty (an aborted run) or cut off, or a lift
        coefficient is that of a run which did not converge.
    """
    file = Path(path)
    demand_regular(file, "an output of VSPAERO (.stab or .polar)")
    text = file.read_text(encoding="utf-8", errors="replace")
    if not text.strip():
        raise ParseError(
            str(file), 0, "an empty file", "the output of a complete run; this run was aborted"
        )
    if _is_polar(text[:4000]):
        return _read_polar(file, text)
    if not is_vspaero(text):
        raise ParseError(
            str(file), 1, repr(text[:60]), "an output of VSPAERO with Sref_ or with Beta Mach AoA"
        )
    return _read_stab(file, text)


def _read_stab(file: Path, text: str) -> CoefficientSet:
    """Return the numbers of all blocks of a ``.stab`` file."""
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if line.startswith("*****")]
    rows: list[dict[str, Any]] = []
    controls: tuple[str, ...] = ()
    is_stated = True
    header: dict[str, float] = {}
    for begin, end in zip(starts, [*starts[1:], len(lines)]):
        block = _StabBlock(file, lines, begin + 1, end)
        if not block.is_empty():
            # the controls are columns of all numbers: every condition must have the same
            if header and block.controls != controls:
                raise ParseError(
                    str(file),
                    begin + 1,
                    f"a block with the controls {' '.join(block.controls) or '(none)'}",
                    f"those of the block before it: {' '.join(controls) or '(none)'}",
                )
            rows += block.rows()
            controls, header = block.controls, block.header
            is_stated &= set(controls) <= set(block.settings)
    reference = EstimateReference(*(header[name] for name in _HEADER[:6]))
    numbers = make_numbers(rows, controls)
    remarks = [_INVISCID]
    if controls and not is_stated:
        remarks.append(
            "the file does not state the deflections of its controls (older versions of the "
            "program): all runs count as without deflection"
        )
    return CoefficientSet(
        "VSPAERO",
        (file.name,),
        **_AXES,
        reference=reference,
        controls=controls,
        numbers=numbers,
        remarks=tuple(remarks),
        cautions=tuple(_describe_cancelling(numbers, controls)),
        inviscid=True,
    )


class _StabBlock:
    """One flight condition of a ``.stab`` file."""

    def __init__(self, file: Path, lines: Sequence[str], begin: int, end: int):
        self.file, self.lines, self.begin, self.end = file, lines, begin, end
        self.header: dict[str, float] = {}
        self.settings: dict[str, float] = {}
        names: list[str] = []
        in_header = True
        for line in lines[begin:end]:
            words = line.split()
            if not words or words[0] == "#":
                continue
            if words[0] in ("Case", "Coef"):
                in_header = False
            elif in_header:
                self._read_header(words)
            elif words[0] not in _NOT_CONTROLS and self._is_perturbation(words):
                names.append(words[0])
            if words[0] == "Coef":
                break
        self.controls = tuple(names)

    def is_empty(self) -> bool:
        """Return whether the block holds no number: asterisks also end the file."""
        return not self.header

    def _read_header(self, words: Sequence[str]) -> None:
        if len(words) >= 2:
            try:
                value = float(words[1])
            except ValueError:
                return
            if words[0].endswith("_") or words[0] in _RATES:
                self.header[words[0]] = value
            else:
                self.settings[words[0]] = value * DEGREE

    @staticmethod
    def _is_perturbation(words: Sequence[str]) -> bool:
        """Return whether a row begins a control: its name alone, or its name and a deflection."""
        if words[0][0] in "+-.0123456789":
            return False
        return len(words) == 1 or words[2:3] == ["deg"]

    def rows(self) -> list[dict[str, Any]]:
        """Return totals and derivatives of the condition."""
        missing = [name for name in _HEADER if name not in self.header]
        if missing:
            raise ParseError(
                str(self.file),
                self.begin + 1,
                f"a block without {', '.join(missing)}",
                "the whole block of a condition; the run was cut off",
            )
        condition = self._condition()
        columns: list[str] = []
        rows: list[dict[str, Any]] = []
        for number in range(self.begin, self.end):
            words = self.lines[number].split()
            if words[:1] == ["Coef"]:
                columns = self._variables(words[2:], number + 1)
            elif columns and words[:1] and words[0] in _COEFFICIENTS:
                rows += self._read_row(words, columns, condition, number + 1)
        # Every coefficient has a total and one derivative per variable.
        if len(rows) != len(_COEFFICIENTS) * (1 + len(columns)):
            raise ParseError(
                str(self.file),
                self.end,
                f"a block with {len(rows)} numbers",
                f"{len(_COEFFICIENTS)} rows of derivatives; the run was cut off",
            )
        return [row for row in rows if row["variable"] is not None]

    def _variables(self, words: Sequence[str], line: int) -> list[Any]:
        """Return the variable of each column; None for columns that are not used."""
        groups = [word for word in words if word.startswith("ConGrp_")]
        if len(groups) != len(self.controls):
            raise ParseError(
                str(self.file),
                line,
                f"{len(groups)} columns of controls",
                f"{len(self.controls)}, one for each of {' '.join(self.controls) or 'no row'}",
            )
        names = dict(zip(groups, self.controls)) | _COLUMNS
        return [names.get(word) for word in words]

    def _condition(self) -> dict[str, Any]:
        mach, alpha, beta = (self.header[name] for name in _HEADER[6:])
        condition = {"mach": mach, "alpha": alpha * DEGREE, "beta": beta * DEGREE}
        speed = self.header.get("Vinf_", 0.0)
        for name, (rate, reference_length) in _RATES.items():
            turned = self.header.get(name, 0.0)
            length = self.header[reference_length]
            if turned and not speed > 0.0:
                raise ParseError(
                    str(self.file),
                    self.begin + 1,
                    f"{name} {turned:g} without Vinf_",
                    "the airspeed of the rate",
                )
            condition[rate] = turned * length / (2.0 * speed) if turned else 0.0
        for name in self.controls:
            condition[name] = self.settings.get(name, 0.0)
        return condition

    def _read_row(
        self, words: Sequence[str], columns: Sequence[Any], condition: dict[str, Any], line: int
    ) -> list[dict[str, Any]]:
        """Return the total and the derivatives of a coefficient."""
        if len(words) != 2 + len(columns):
            raise ParseError(
                str(self.file),
                line,
                f"{len(words) - 1} numbers of {words[0]}",
                f"{1 + len(columns)}; the run was cut off",
            )
        values = _read_numbers(self.file, line, words[1:])
        # A solution that diverged prints large lift.
        if words[0] == "CL":
            _require_converged(self.file, line, values[0])
        place = condition | {"file": self.file.name, "line": line}
        place |= {"coefficient": _COEFFICIENTS[words[0]]}
        return [
            place | {"variable": variable, "value": value}
            for variable, value in zip(["", *columns], values)
        ]


def _read_polar(file: Path, text: str) -> CoefficientSet:
    """Return the totals of a ``.polar`` file; the reference quantities are not in it."""
    lines = text.splitlines()
    position = _polar_heading(lines)
    assert position is not None  # `_is_polar`
    head = lines[position].split()
    columns = _POLAR_7 if "CLtot" in head else _POLAR
    missing = [name for name in columns if name not in head]
    if missing:
        raise ParseError(
            str(file),
            position + 1,
            f"no column {', '.join(missing)}",
            f"the columns {', '.join(columns)}",
        )
    rows = []
    for number, line in enumerate(lines[position + 1 :], position + 2):
        words = line.split()
        if not words:
            continue
        if len(words) == len(head) + 1 and _UNNAMED not in head:
            words = words[:-1]
        if len(words) != len(head):
            raise ParseError(
                str(file), number, f"{len(words)} numbers", f"{len(head)}, as the heading has"
            )
        values = dict(zip(head, _read_numbers(file, number, words)))
        _require_converged(file, number, values[next(iter(columns))])
        condition = {
            "mach": values["Mach"],
            "alpha": values["AoA"] * DEGREE,
            "beta": values["Beta"] * DEGREE,
            "file": file.name,
            "line": number,
            "variable": "",
        }
        for printed, (coefficient, sign) in columns.items():
            value = sign * values[printed] + 0.0
            rows.append(condition | {"coefficient": coefficient, "value": value})
    if not rows:
        raise ParseError(
            str(file), position + 1, "a heading without a row", "the polar of a complete run"
        )
    return CoefficientSet(
        "VSPAERO",
        (file.name,),
        **_AXES,
        reference=None,
        controls=(),
        numbers=make_numbers(rows, ()),
        remarks=(_FRICTION,),
    )


def _read_numbers(file: Path, line: int, words: Sequence[str]) -> list[float]:
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise ParseError(str(file), line, repr(word), "a number; the run has failed")
        values.append(value)
    return values


def _require_converged(file: Path, line: int, lift: float) -> None:
    if abs(lift) > _MOST_LIFT:
        raise ParseError(
            str(file),
            line,
            f"CL = {lift:g}",
            f"at most {_MOST_LIFT:g}; the run has not converged, or Sref is wrong",
        )


def _describe_cancelling(numbers: Any, controls: Sequence[str]) -> list[str]:
    """Return a remark on each pair of controls that do nothing when both move."""
    sizes = {}
    for name in controls:
        rows = numbers[(numbers["variable"] == name) & numbers["coefficient"].isin(("CL", "Cl"))]
        sizes[name] = rows["value"].to_numpy(float)
    remarks = []
    for position, first in enumerate(controls):
        for second in controls[position + 1 :]:
            a, b = sizes[first], sizes[second]
            if np.linalg.norm(a + b) < _OPPOSITE * np.linalg.norm(a):
                remarks.append(
                    f"the derivatives of {first} and {second} are equal and opposite: moved "
                    f"together they have no effect; both groups may hold the same surface"
                )
    return remarks
