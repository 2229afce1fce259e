"""Outputs of AVL (Athena Vortex Lattice): ``.st``, ``.sb`` and ``.ft``.

- ``.st``: derivatives in stability axes (primes in the print), ``.sb``: in body axes, with respect
  to the velocities u, v, w over V; ``.ft``: total forces only. All three print the totals.
- Derivatives with respect to alpha, beta and the rates p b/2V, q c/2V, r b/2V are per radian, those
  of a control per unit of its variable, which is a degree if its gain is 1.
- A third print ("Derivatives...") mixes moments in body axes and rates in stability axes. It is
  refused.
- The rolling and yawing moments of the controls are in body axes in both prints, although the rows
  of ``.st`` are labelled Cl' and Cn': ``.st`` and ``.sb`` of one run have the same digits, and
  totals with deflections agree with body axes only.
- The names of the controls are in the header of the last table, ``aileron d1  elevator d2``.
- The files state no unit of length. The sign of a control is that of the geometry file.

Source: M. Drela, H. Youngren, AVL User Primer; prints of version 3.32.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from flightmech.errors import ParseError
from flightmech.support.input_files import demand_regular
from flightmech.units import DEGREE

BANNER = "Vortex Lattice Output -- Total Forces"
# The search begins at words only: within a long word it would begin at each letter.
_PAIR = re.compile(
    r"(?<![\w'/])([A-Za-z][\w'/]*)\s*=\s*"
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?|\*+|[-+]?(?:[Nn][Aa][Nn]|[Ii][Nn][Ff]\w*))"
)
_HEADING = re.compile(r"(\S.*?)\s+(d\d+)(?=\s|$)")
_STABILITY, _BODY = "Stability-axis derivatives", "Geometry-axis derivatives"
_MIXED = re.compile(r"^ Derivatives\.\.\.", re.MULTILINE)
# Prints of another form, by their mark.
_MACHINE = re.compile(r"^VERSION [\d.]+\s*$", re.MULTILINE)
_JET = "Jet Vortex Lattice Output"
_AXES_LINE = "Standard axis orientation"
# Totals by their name in the print. Those with a prime are about stability axes.
_STABILITY_TOTALS = {
    "CLtot": "CL",
    "CDtot": "CD",
    "CYtot": "CY",
    "Cl'tot": "Cl",
    "Cmtot": "Cm",
    "Cn'tot": "Cn",
}
_BODY_TOTALS = {
    "CXtot": "CX",
    "CYtot": "CY",
    "CZtot": "CZ",
    "Cltot": "Cl",
    "Cmtot": "Cm",
    "Cntot": "Cn",
}
_LETTERS = {
    "a": "alpha",
    "b": "beta",
    "p": "phat",
    "q": "qhat",
    "r": "rhat",
    "u": "u",
    "v": "v",
    "w": "w",
}
_DERIVATIVE = re.compile(r"(CL|CD|CX|CY|CZ|Cl|Cm|Cn)(?:([abpqruvw])|(d\d+))$")
# Lines of free text, and one whose left side names derivatives that it does not print.
_SKIPPED = ("Configuration:", "Run case:", "Clb Cnr")
_NAME_LENGTH = 12  # characters of a control's name in the heading of the derivatives
_SYMMETRY = re.compile(r"^[ \t]*([YZ]) Symmetry", re.MULTILINE)
# Letters of a line, of which AVL prints less than 200. The patterns take the square of it.
_LONGEST_LINE = 1000
_MOST_LIFT = 10.0  # a larger lift coefficient is a run that did not converge
# Tolerance of the check that the neutral point belongs to the derivatives. [chords]
_NEUTRAL_POINT_TOLERANCE = 2e-3


def is_avl(text: str) -> bool:
    """Return whether a text is an output of AVL that `read_avl` reads."""
    return BANNER in text[:2000]


def read_avl(path: str | Path) -> CoefficientSet:
    """Return the numbers of one output of AVL.

    Parameters
    ----------
    path : str or Path
        A file ``.st``, ``.sb`` or ``.ft``.

    Raises
    ------
    ParseError
        The file is not such an output, it is cut off, a number is not a number, or the axes are
        not those of the standard orientation (x forward, z down).
    """
    file = Path(path)
    demand_regular(file, "an output of AVL (.st, .sb or .ft)")
    text = file.read_text(encoding="utf-8", errors="replace")
    if not is_avl(text):
        raise ParseError(str(file), 1, repr(text[:60]), f"an output of AVL with '{BANNER}'")
    _refuse_other_prints(file, text)
    for number, line in enumerate(text.splitlines(), 1):
        if len(line) > _LONGEST_LINE:
            expected = f"an output of AVL with lines of at most {_LONGEST_LINE}; it is damaged"
            raise ParseError(str(file), number, f"a line of {len(line)} letters", expected)
    return _AvlPrint(file, text).coefficient_set()


def _refuse_other_prints(file: Path, text: str) -> None:
    """Raise for prints of AVL and its relatives that have another form."""
    expected = "the print of the commands ST, SB or FT of the menu OPER"
    found = ""
    if _JET in text[:2000]:
        found, expected = "a print of JVL, AVL with jets", "an output of AVL: JVL has other totals"
    elif _MACHINE.search(text[:2000]):
        found = "a print of AVL for machines (MRF), whose numbers stand before their names"
        expected += "; switch MRF off and write the file again"
    elif _MIXED.search(text):
        found = "derivatives of moments in body axes with respect to rates in stability axes"
    if found:
        raise ParseError(str(file), 1, found, expected)


class _AvlPrint:
    """One printed run case."""

    def __init__(self, file: Path, text: str):
        self.file = file
        self.lines = text.splitlines()
        self.pairs: dict[str, tuple[float, int]] = {}
        self.controls: dict[str, str] = {}
        self.settings: dict[str, float] = {}
        self._read_pairs()
        self._read_controls()
        if symmetry := _SYMMETRY.search(text):
            meaning = {"Y": "a mirrored half of the aeroplane", "Z": "a ground plane"}
            raise ParseError(
                str(file),
                text.count("\n", 0, symmetry.start()) + 1,
                f"{symmetry[1]} symmetry: {meaning[symmetry[1]]}",
                "a run of the whole aeroplane in free air (iYsym and iZsym 0)",
            )
        if _AXES_LINE not in text:
            raise ParseError(
                str(file),
                1,
                "axes that are not of the standard orientation",
                "an output with 'Standard axis orientation,  X fwd, Z down' (menu OPER, option O)",
            )

    def _read_pairs(self) -> None:
        """Read all pairs of a name and a number, with the line of each."""
        for number, line in enumerate(self.lines, 1):
            if line.strip().startswith(_SKIPPED):
                continue
            for name, digits in _PAIR.findall(line):
                try:
                    value = float(digits.replace("D", "E").replace("d", "e"))
                except ValueError:
                    value = float("nan")
                if not math.isfinite(value):
                    raise ParseError(
                        str(self.file), number, f"{name} = {digits}", "a number; run the case again"
                    )
                first, place = self.pairs.setdefault(name, (value, number))
                if value != first:
                    raise ParseError(
                        str(self.file),
                        number,
                        f"{name} = {digits}, and {first:g} in line {place}",
                        "one run case in one file",
                    )

    def _read_controls(self) -> None:
        """Read the names of the controls d1, d2 ... and their settings."""
        for line in self.lines:
            found = _HEADING.findall(line.strip())
            if found and "=" not in line:
                self.controls |= {key: name.strip() for name, key in found}
        begin = self._line_of("CDff") or self._line_of("CLff") or 0
        for line in self.lines[begin:]:
            match = re.fullmatch(r"\s+(\S.*?)\s*=\s*([-+\d.Ee]+)\s*", line)
            if match and not _DERIVATIVE.match(match[1]):
                self.settings[match[1].strip()] = float(match[2])
            if _STABILITY in line or _BODY in line:
                break
        # The heading of the derivatives has the first characters of a longer name.
        names = {name[:_NAME_LENGTH].strip(): name for name in self.settings}
        for key, name in self.controls.items():
            if name not in names:
                raise ParseError(
                    str(self.file),
                    len(self.lines),
                    f"derivatives of {name} without its setting",
                    f"a whole print; it has settings of {', '.join(self.settings) or 'none'}",
                )
            self.controls[key] = names[name]

    def _line_of(self, name: str) -> int | None:
        return self.pairs[name][1] if name in self.pairs else None

    def number(self, name: str) -> float:
        """Return a number of the header.

        Raises
        ------
        ParseError
            The print does not hold it.
        """
        if name not in self.pairs:
            raise ParseError(
                str(self.file),
                len(self.lines),
                f"no {name}",
                "a whole print with reference quantities, condition and totals; write it again",
            )
        return self.pairs[name][0]

    def coefficient_set(self) -> CoefficientSet:
        """Return all numbers of the print."""
        text = "\n".join(self.lines)
        in_body = _BODY in text
        totals = _BODY_TOTALS if in_body else _STABILITY_TOTALS
        # A control without derivatives (.ft) has a setting all the same.
        controls = tuple(self.settings)
        condition = self._condition(controls)
        rows = []
        for printed, coefficient in totals.items():
            value = self.number(printed)
            rows.append(self._row(condition, coefficient, "", value, self.pairs[printed][1]))
        for name, (value, line) in self.pairs.items():
            match = _DERIVATIVE.match(name)
            if not match:
                continue
            coefficient, letter, control = match.groups()
            if letter:
                variable = _LETTERS[letter]
            else:
                if control not in self.controls:
                    raise ParseError(
                        str(self.file), line, f"{name} without a name of {control}", "its heading"
                    )
                # Per degree of the control variable in the print.
                variable, value = self.controls[control], value / DEGREE
            rows.append(self._row(condition, coefficient, variable, value, line))
        self._check(in_body)
        reference = EstimateReference(
            *(self.number(name) for name in ("Sref", "Cref", "Bref", "Xref", "Yref", "Zref"))
        )
        remarks = [
            "AVL computes thin surfaces in inviscid flow: no stall, friction drag only from the "
            "profile drag data of the geometry (CDvis), and bodies by slender-body theory",
            "derivatives of controls are per degree of the control variable times its gain",
        ]
        axes = "body" if in_body else "stability"
        return CoefficientSet(
            "AVL",
            (self.file.name,),
            force_axes=axes,
            moment_axes=axes,
            control_axes="body",
            reference=reference,
            controls=controls,
            numbers=make_numbers(rows, controls),
            remarks=tuple(remarks),
            inviscid=self.pairs.get("CDvis", (0.0, 0))[0] == 0.0,
        )

    def _condition(self, controls: tuple[str, ...]) -> dict[str, Any]:
        """Return Mach number, angles, rates and settings of the controls. [rad]"""
        condition = {
            "mach": self.number("Mach"),
            "alpha": self.number("Alpha") * DEGREE,
            "beta": self.number("Beta") * DEGREE,
            "phat": self.number("pb/2V"),
            "qhat": self.number("qc/2V"),
            "rhat": self.number("rb/2V"),
        }
        for name in controls:
            condition[name] = self.settings[name] * DEGREE
        return condition

    def _row(
        self,
        condition: dict[str, Any],
        coefficient: str,
        variable: str,
        value: float,
        line: int,
    ) -> dict[str, Any]:
        place = {"file": self.file.name, "line": line}
        found = {"coefficient": coefficient, "variable": variable, "value": value}
        return condition | found | place

    def _check(self, in_body: bool) -> None:
        """Raise for a run that did not converge, or derivatives that contradict each other."""
        name = "CZtot" if in_body else "CLtot"
        if abs(self.number(name)) > _MOST_LIFT:
            raise ParseError(
                str(self.file),
                self.pairs[name][1],
                f"{name} = {self.number(name):g}",
                f"at most {_MOST_LIFT:g}; the run has not converged, or Sref is wrong",
            )
        if not {"Xnp", "CLa", "Cma"} <= set(self.pairs) or self.number("CLa") == 0.0:
            return
        # Xnp - Xref = -Cma / CLa Cref is an identity of the program.
        printed = (self.number("Xnp") - self.number("Xref")) / self.number("Cref")
        margin = -self.number("Cma") / self.number("CLa")
        if abs(printed - margin) > _NEUTRAL_POINT_TOLERANCE * max(1.0, abs(margin)):
            raise ParseError(
                str(self.file),
                self.pairs["Xnp"][1],
                f"Xnp at {printed:.4f} chords behind Xref",
                f"{margin:.4f} chords, which CLa and Cma of the same print give; the file was "
                f"changed or is of two runs",
            )
