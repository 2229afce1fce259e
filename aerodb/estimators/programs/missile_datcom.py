"""Print of Missile DATCOM (``for006.dat``).

- Static pages have CN, CM, CA, CY, CLN, CLL in body axes (CN up, CA aft), moments about XCG in
  units of the reference lengths. CL, CD and the centre of pressure repeat them and are not read.
- The heading of each page of derivatives states "per degree" or "per radian". Rates are q LREF/2V
  and r LATREF/2V, p LATREF/2V. ``CNAD`` and ``CMAD`` are derivatives with respect to the rate of
  the angle of attack, also with LREF/2V.
- Of a case with pages of several configurations only the one with most fin sets is read.
- The print has panel deflections and no controls. Each pattern of deflections, such as that of an
  elevator, is one control, ``fin2(-1,1,1,-1)``, whose deflection is the largest of the panels.
- Reference quantities are printed with few digits. Those of the cards ``$REFQ`` are taken where
  they agree with the print.

Source: prints of the revisions 3/99 and 9/02; W. Blake, Missile Datcom User's Manual, 1997 Fortran
90 Revision, AFRL-VA-WP-TR-1998-3009.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from aerodb.estimators.coefficient_set import CoefficientSet, make_numbers
from aerodb.estimators.programs.missile_reference import RoundedNumber, make_missile_reference
from flightmech.errors import ParseError
from flightmech.support.input_files import WESTERN, read_text
from flightmech.units import DEGREE

BANNER = "THE USAF AUTOMATED MISSILE DATCOM"
_EXPECTED = "a print of Missile DATCOM (for006.dat)"
_CASE = re.compile(r"CASE\s+(\d+)\s*$")
_STATIC = "STATIC AERODYNAMICS FOR"
_DYNAMIC = re.compile(r"BODY (?:ALONE|\+ (\d+) FIN SETS?) DYNAMIC DERIVATIVES")
_TRIMMED = "STATIC AERODYNAMIC COEFFICIENTS TRIMMED IN PITCH"
_NUMBER = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[ED][-+]?\d+)?|\*NT\*|\*+|[-+]?NAN|[-+]?INF\w*")
_HEADER = re.compile(
    r"([A-Z][A-Z ]*[A-Z]?)\s*=\s*([-+]?(?:\d+\.\d*|\.\d+)(?:E[-+]?\d+)?) {0,2}(\S*)"
)
_PER = re.compile(r"DERIVATIVES \(PER (DEGREE|RADIAN)\)")
_DEFLECTED_SET = re.compile(r"TRIM.*FIN SET (\d)|PANELS FROM FIN SET (\d)")
# Columns of the print: coefficient, variable and sign in the neutral form.
_TOTALS = {
    "CN": ("CZ", "", -1.0),
    "CM": ("Cm", "", 1.0),
    "CA": ("CX", "", -1.0),
    "CY": ("CY", "", 1.0),
    "CLN": ("Cn", "", 1.0),
    "CLL": ("Cl", "", 1.0),
}
_DERIVATIVES = {
    "CNA": ("CZ", "alpha", -1.0),
    "CMA": ("Cm", "alpha", 1.0),
    "CYB": ("CY", "beta", 1.0),
    "CLNB": ("Cn", "beta", 1.0),
    "CLLB": ("Cl", "beta", 1.0),
    "CNQ": ("CZ", "qhat", -1.0),
    "CMQ": ("Cm", "qhat", 1.0),
    "CAQ": ("CX", "qhat", -1.0),
    "CNAD": ("CZ", "alphadothat", -1.0),
    "CMAD": ("Cm", "alphadothat", 1.0),
    "CYR": ("CY", "rhat", 1.0),
    "CLNR": ("Cn", "rhat", 1.0),
    "CLLR": ("Cl", "rhat", 1.0),
    "CYP": ("CY", "phat", 1.0),
    "CLNP": ("Cn", "phat", 1.0),
    "CLLP": ("Cl", "phat", 1.0),
}
_NOT_READ = ("CL", "CD", "CL/CD", "X-C.P.")
_REMARK = (
    "moments are about XCG behind the nose; the alpha-dot derivative of CA is not printed, so "
    "there is none of the lift"
)


def is_missile_datcom(text: str) -> bool:
    """Return whether a text is a print of Missile DATCOM."""
    return BANNER in text[:5000]


def read_missile_datcom(path: str | Path) -> CoefficientSet:
    """Return the numbers of all cases and Mach numbers of a print.

    Parameters
    ----------
    path : str or Path
        A file ``for006.dat``.

    Raises
    ------
    ParseError
        The print has no static pages of a body with fins or of a body alone, a row or a page is cut
        off, the missile is rolled, or reference quantities change.
    """
    file = Path(path)
    lines = read_text(file, _EXPECTED, otherwise=WESTERN).split("\n")
    if not is_missile_datcom("\n".join(lines[:200])):
        raise ParseError(str(file), 1, repr(lines[0][:60]), _EXPECTED)
    pages = _split(file, lines)
    chosen = _complete_configuration(pages)
    if not chosen:
        raise ParseError(
            str(file),
            len(lines),
            "no page of static aerodynamics",
            "the print of a run with static aerodynamics; the run stopped or has only parts",
        )
    patterns = _deflections(file, pages)
    controls = sorted({name for name, _ in patterns.values() if name})
    controls += sorted({page.trim_control for page in chosen if page.trim_control})
    rows: list[dict[str, Any]] = []
    cautions: dict[str, None] = {}
    for page in chosen:
        condition = page.condition(file)
        name, angle = patterns.get(page.run(), ("", 0.0))
        if name:
            condition[name] = angle * DEGREE
        found, lost = page.rows(file, condition)
        rows += found
        cautions.update(dict.fromkeys(lost))
    reference, reference_remark = make_missile_reference(
        file, [page.header for page in chosen], lines
    )
    remarks = [_REMARK]
    if reference_remark:
        remarks.append(reference_remark)
    return CoefficientSet(
        "Missile DATCOM",
        (file.name,),
        force_axes="body",
        moment_axes="body",
        control_axes="body",
        reference=reference,
        controls=tuple(controls),
        numbers=make_numbers(rows, controls),
        unit_stated=True,
        remarks=tuple(remarks),
        cautions=tuple(cautions),
    )


@dataclass
class MissilePage:
    """One page of a print.

    Attributes
    ----------
    case, number : int
        Case, and line of the first line of the page, from 1.
    lines : list of str
    kind : str
        ``static``, ``dynamic``, ``trim`` or empty.
    fin_sets : int
        Fin sets of the configuration of the page.
    header : dict
        Quantity of the flight condition to its printed number and unit.
    trim_control : str
        Name of the control that trims.
    """

    case: int
    number: int
    lines: list[str]
    kind: str = ""
    fin_sets: int = 0
    header: dict[str, RoundedNumber] = field(default_factory=dict)
    trim_control: str = ""

    def run(self) -> tuple[int, float, float]:
        """Return case, Mach number and altitude: the pages with one run belong together."""
        altitude = self.header.get("ALTITUDE")
        mach = self.header["MACH NO"].value
        return self.case, mach, altitude.value if altitude else 0.0

    def condition(self, file: Path) -> dict[str, Any]:
        """Return Mach number and sideslip of the page. [rad]"""
        for name in ("MACH NO", "SIDESLIP", "ROLL", "REF AREA"):
            if name not in self.header:
                raise ParseError(
                    str(file),
                    self.number,
                    f"a page without {name}",
                    "a page with its flight condition; the print was cut off",
                )
        if self.header["ROLL"].value != 0.0:
            raise ParseError(
                str(file),
                self.number,
                f"an aerodynamic roll angle of {self.header['ROLL'].value:g} deg",
                "0 (PHI): the coefficients of a rolled missile have other axes",
            )
        return {
            "mach": self.header["MACH NO"].value,
            "beta": self.header["SIDESLIP"].value * DEGREE,
        }

    def rows(self, file: Path, condition: dict[str, Any]) -> tuple[list[dict[str, Any]], list[str]]:
        """Return the numbers of the tables of the page, and remarks on those that are lost."""
        columns: list[str] = []
        per: float | None = None
        rows: list[dict[str, Any]] = []
        lost = []
        for number, line in enumerate(self.lines, self.number):
            if match := _PER.search(line):
                per = 1.0 if match[1] == "RADIAN" else 1.0 / DEGREE
            words = line.split()
            if words[:1] == ["ALPHA"]:
                columns = words
                continue
            tokens = _NUMBER.findall(line)
            if not columns or not tokens or not _is_row(line):
                columns = columns if not line.strip() or not columns else _close(line, columns)
                continue
            if len(tokens) != len(columns):
                raise ParseError(
                    str(file),
                    number,
                    f"{len(tokens)} numbers under {' '.join(columns)}",
                    f"{len(columns)}; the row is cut off or damaged",
                )
            if per is None and set(columns) & set(_DERIVATIVES):
                raise ParseError(
                    str(file),
                    number,
                    f"derivatives {' '.join(columns)} without a heading that states their unit",
                    "'DERIVATIVES (PER DEGREE)' or '(PER RADIAN)' above them; the page is damaged",
                )
            place = condition | {"file": file.name, "line": number}
            for row in self._read_row(place, dict(zip(columns, tokens)), per or 1.0):
                if row["value"] is None:
                    lost.append(
                        f"{file.name} line {number}: {row['printed']} is not a number and is "
                        f"left out"
                    )
                else:
                    rows.append({key: row[key] for key in row if key != "printed"})
        return rows, lost

    def _read_row(
        self, place: dict[str, Any], cells: dict[str, str], per: float
    ) -> list[dict[str, Any]]:
        alpha = _parse(cells["ALPHA"])
        if alpha is None:
            return [{"value": None, "printed": "ALPHA"}]
        place = place | {"alpha": alpha * DEGREE}
        if self.kind == "trim":
            delta = _parse(cells.get("DELTA", "*"))
            if delta is None:
                return []  # *NT*: no trim point in the range of deflections
            place[self.trim_control] = delta * DEGREE
        rows: list[dict[str, Any]] = []
        for printed, token in cells.items():
            if printed in ("ALPHA", "DELTA", *_NOT_READ):
                continue
            # `per` converts a derivative to one per radian; adding 0.0 turns -0 into 0.
            coefficient, variable, sign = (_TOTALS | _DERIVATIVES)[printed]
            value = _parse(token)
            if value is not None:
                value = value * sign * (per if variable else 1.0) + 0.0
            row = {"coefficient": coefficient, "variable": variable, "value": value}
            rows.append(place | row | {"printed": printed})
        # A trimmed page prints no CM: it is zero.
        if self.kind == "trim":
            zero = {"coefficient": "Cm", "variable": "", "value": 0.0, "printed": "CM"}
            rows.append(place | zero)
        return rows


def _is_row(line: str) -> bool:
    """Return whether a line holds numbers alone."""
    return not re.search(r"[A-Z]{2}", _NUMBER.sub(" ", line.upper()))


def _close(line: str, columns: list[str]) -> list[str]:
    """Return the columns below a line without numbers: a text ends a table."""
    return [] if re.search(r"[A-Z]{4}", line) else columns


def _parse(token: str) -> float | None:
    try:
        value = float(token.replace("D", "E"))
    except ValueError:
        return None
    return value if abs(value) < 1e9 else None


def _split(file: Path, lines: Sequence[str]) -> list[MissilePage]:
    """Return the pages of all cases with their kind and header."""
    starts = [number for number, line in enumerate(lines) if BANNER in line]
    pages = []
    for begin, end in zip(starts, [*starts[1:], len(lines)]):
        match = _CASE.search(lines[begin])
        if not match:
            continue
        page = MissilePage(int(match[1]), begin + 1, list(lines[begin:end]))
        _classify(page)
        if page.kind:
            for line in page.lines:
                for name, digits, unit in _HEADER.findall(line):
                    page.header.setdefault(name.strip(), RoundedNumber(digits, unit))
            if "MACH NO" not in page.header:
                raise ParseError(
                    str(file), page.number, "a page without MACH NO", "a whole page; cut off"
                )
            pages.append(page)
    return pages


def _classify(page: MissilePage) -> None:
    """Set kind and number of fin sets from the headings of a page."""
    for line in page.lines[:8]:
        if _STATIC in line:
            page.kind = "static"
            page.fin_sets = len(re.findall(r"\b\d\b", line.partition("SET")[2]))
        elif match := _DYNAMIC.search(line):
            page.kind = "dynamic"
            page.fin_sets = int(match[1] or 0)
        elif _TRIMMED in line:
            page.kind = "trim"
            sets = [a or b for a, b in _DEFLECTED_SET.findall("\n".join(page.lines))]
            page.trim_control = f"trim of fin set {sets[0]}" if sets else "trim"


def _complete_configuration(pages: Sequence[MissilePage]) -> list[MissilePage]:
    """Return the pages of the configuration with most fin sets, and the trimmed ones."""
    static = [page.fin_sets for page in pages if page.kind == "static"]
    if not static:
        return []
    most = max(static)
    return [page for page in pages if page.kind == "trim" or page.fin_sets == most]


def _deflections(
    file: Path, pages: Sequence[MissilePage]
) -> dict[tuple[int, float, float], tuple[str, float]]:
    """Return the control and its deflection of each run; without one if no panel is deflected."""
    deflections = {}
    for page in pages:
        angles: dict[str, list[float]] = {}
        in_table = False
        for line in page.lines:
            if "PANEL DEFLECTION ANGLES" in line:
                in_table = True
            elif in_table and "FIN 1" not in line:
                words = line.split()
                if not words or not words[0].isdigit():
                    break
                angles[words[0]] = [float(word) for word in _NUMBER.findall(line)]
        if in_table:
            deflections[page.run()] = _pattern(angles)
    runs = {page.run() for page in pages if page.kind == "static"}
    lines = chain.from_iterable(page.lines for page in pages)
    if runs - set(deflections) and any("$DEFLCT" in line for line in lines):
        raise ParseError(
            str(file),
            0,
            "deflected panels without the table PANEL DEFLECTION ANGLES",
            "a print with the pages of derivatives, below which the program prints the deflections",
        )
    return deflections


def _pattern(angles: dict[str, list[float]]) -> tuple[str, float]:
    """Return the name of a pattern of deflections, and its largest deflection. [deg]

    The first deflected panel has the sign of the control.
    """
    flat = list(chain.from_iterable(angles.values()))
    largest = max((abs(angle) for angle in flat), default=0.0)
    if largest == 0.0:
        return "", 0.0
    amplitude = largest if next(angle for angle in flat if angle) > 0.0 else -largest
    names = []
    for number, values in angles.items():
        if any(values):
            shares = ",".join(f"{round(value / amplitude, 2) + 0.0:g}" for value in values)
            names.append(f"fin{number}({shares})")
    return "+".join(names), amplitude
