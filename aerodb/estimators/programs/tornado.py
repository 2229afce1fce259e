"""Results of Tornado (vortex lattice in MATLAB): ``NAME-Cx.mat`` and the text export of it.

- Forces are lift and drag, and the side force of the body. Moments and rates are about the axes of
  the drawing: x aft, y right, z up. About the axes of flight dynamics Cl, Cn, p and r change their
  sign; CL, CD, CY, Cm and q keep it.
- Derivatives are per radian, controls included, and rates are p b/2V, q c/2V, r b/2V.
- Controls have no names. They are numbered in the order of the flapped partitions.
- The text prints the block of the roll rate again in place of that of the pitch rate, which is
  then not read: only the MAT file has derivatives with the pitch rate. It has no moment centre.
- The forces of a perturbed rate use the circulation of that rate and the local speed of the state:
  the change of local speed is missing, and Cl with the yaw rate is nearly 0.
- A solution whose CL or CD exceeds 10 is not one of the flow; only the condition number shows it.

Source: exports of version 1.36; ``coeff_create3`` and ``solver9`` of its source code.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from flightmech.errors import ParseError
from flightmech.support.array_files.mat_files import load_mat
from flightmech.support.input_files import WESTERN, decode_text, read_bytes, with_line_feeds
from flightmech.units import DEGREE

_EXPORT = "%Tornado exported result data"
_MAT = "MATLAB 5.0 MAT-file"
_EXPECTED = "a result of Tornado (NAME-Cx.mat or its text export)"
_LABELLED = re.compile(r"^\s*((?:[-+]?(?:\d|\.|NaN|Inf)\S*\s+)+)%\s*(.+?)\s*$", re.IGNORECASE)
_VARIABLES = {"a": "alpha", "b": "beta", "P": "phat", "Q": "qhat", "R": "rhat", "d": "control"}
_COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
# Coefficients and variables that change their sign between axes x aft, z up and x forward, z down.
_TURNED = ("Cl", "Cn", "phat", "rhat")
_MOST = 10.0
_REPEATED = (
    "the text export repeats the block of the roll rate in place of the pitch rate: there are no "
    "derivatives with the pitch rate; they are in the MAT file"
)
_INVISCID = "Tornado computes thin surfaces in inviscid flow: no stall, no bodies, no friction drag"
_YAW_RATE = (
    "the derivatives with rates leave out the change of the local speed: Cl with the yaw rate is "
    "far too small; take it from another source"
)
_NO_CENTRE = "the text export has no moment centre; its S, cbar and b are {S:g}, {cbar:g}, {b:g}"


class _TornadoSolution(NamedTuple):
    """Numbers of one solution: names of the program to a value or one per control, and line."""

    numbers: dict[str, tuple[np.ndarray, int]]
    state: dict[str, float]
    reference: dict[str, float]
    centre: tuple[float, float, float] | None
    condition: float
    remarks: tuple[str, ...]


def is_tornado(text: str) -> bool:
    """Return whether a text begins like a result of Tornado, or like a MAT file."""
    return text.startswith((_EXPORT, _MAT))


def read_tornado(path: str | Path) -> CoefficientSet:
    """Return the numbers of one solution.

    Parameters
    ----------
    path : str or Path
        The MAT file, or the text that the program exports.

    Raises
    ------
    ParseError
        Another MAT file, a damaged file, or a solution that is not one of the flow.
    """
    file = Path(path)
    raw = read_bytes(file, _EXPECTED)
    if raw.startswith(_MAT.encode()):
        solution = _read_mat(file, raw)
    else:
        text = with_line_feeds(decode_text(raw, file, _EXPECTED, otherwise=WESTERN))
        if not is_tornado(text):
            raise ParseError(str(file), 1, repr(text[:60]), _EXPECTED)
        solution = _read_text(file, text.split("\n"))
    _check(file, solution)
    count = max((values.size for values, _ in _of_controls(solution)), default=0)
    controls = tuple(f"control{number}" for number in range(1, count + 1))
    condition = _condition(file, solution)
    rows = list(_rows(file, solution, condition, controls))
    lengths = solution.reference
    reference, remarks = None, [_INVISCID, *solution.remarks]
    if solution.centre is None:
        remarks.append(_NO_CENTRE.format(**lengths))
    else:
        reference = EstimateReference(**lengths, **dict(zip("xyz", solution.centre)))
    if controls:
        remarks.append("controls are numbered in the order of the flapped partitions")
    return CoefficientSet(
        "Tornado",
        (file.name,),
        force_axes="stability",
        moment_axes="body",
        control_axes="body",
        reference=reference,
        controls=controls,
        numbers=make_numbers(rows, controls),
        unit_stated=True,
        remarks=tuple(remarks),
        cautions=(_YAW_RATE,) if "Cl_R" in solution.numbers else (),
        inviscid=True,
    )


def _read_mat(file: Path, raw: bytes) -> _TornadoSolution:
    """Return the solution in the structures results, state, geo and ref."""
    names = ("results", "state", "geo", "ref")
    try:
        content = load_mat(
            raw, file.name, _EXPECTED, simplify_cells=True, variable_names=list(names)
        )
    except NotImplementedError as error:
        raise ParseError(
            str(file), 0, "a MAT file of version 7.3", f"{_EXPECTED}; save it with -v7"
        ) from error
    missing = [name for name in names if not isinstance(content.get(name), Mapping)]
    if missing:
        raise ParseError(
            str(file),
            0,
            f"a MAT file without the structure {', '.join(missing)}",
            f"{_EXPECTED}, which has {', '.join(names)}",
        )
    results, state, geo, ref = (content[name] for name in names)
    numbers = {}
    for coefficient in _COEFFICIENTS:
        for suffix in ("", *(f"_{letter}" for letter in _VARIABLES)):
            value = results.get(coefficient + suffix)
            if value is not None:
                numbers[coefficient + suffix] = _array(file, coefficient + suffix, value), 0
    fields = {"AS": "V", "alpha": "alpha", "betha": "beta", "P": "p", "Q": "q", "R": "r"}
    lengths = {"S_ref": "S", "C_mac": "cbar", "b_ref": "b"}
    centre = _array(file, "geo.ref_point", geo.get("ref_point"))
    if centre.size != 3:
        raise ParseError(str(file), 0, "geo.ref_point of other size", "three coordinates")
    x, y, z = (float(value) for value in centre)
    return _TornadoSolution(
        numbers,
        {to: float(_array(file, name, state.get(name))[0]) for name, to in fields.items()},
        {to: float(_array(file, name, ref.get(name))[0]) for name, to in lengths.items()},
        centre=(x, y, z),
        condition=float(_array(file, "dwcond", results.get("dwcond", np.nan))[0]),
        remarks=(),
    )


def _array(file: Path, name: str, value: Any) -> np.ndarray:
    array = np.atleast_1d(np.asarray(value))
    if array.dtype.kind not in "fiub" or array.ndim != 1 or not array.size:
        raise ParseError(str(file), 0, f"{name} that is not a number", f"{_EXPECTED} as saved")
    return array.astype(float)


def _read_text(file: Path, lines: Sequence[str]) -> _TornadoSolution:
    """Return the solution of a text export, whose numbers stand before their labels."""
    labelled: dict[str, tuple[np.ndarray, int]] = {}
    in_pitch = False
    remarks: tuple[str, ...] = ()
    for number, line in enumerate(lines, 1):
        if line.startswith("%"):
            # The heading of the repeated block; all others end it.
            in_pitch = line.startswith("%Pitch rate derivatives") or (
                in_pitch and not line.rstrip().endswith(":")
            )
        match = _LABELLED.match(line)
        if not match:
            continue
        label = match[2].partition("[")[0].partition(",")[0].strip()
        if in_pitch and label.endswith("_P"):
            remarks = (_REPEATED,)
            continue
        # The second CY repeats the first.
        labelled.setdefault(label, (np.array([float(w) for w in match[1].split()]), number))
    state = {"Airspeed": "V", "Angle of attack": "alpha", "Angle of sideslip": "beta"}
    state |= {"Roll rate": "p", "Pitch rate": "q", "Yaw rate": "r"}
    lengths = {"Reference area": "S", "Mean Aero Chord": "cbar", "Reference span": "b"}
    for name in (*state, *lengths, *_COEFFICIENTS):
        if name not in labelled:
            raise ParseError(
                str(file), len(lines), f"no '{name}'", "a whole export; it was cut off"
            )
    names: list[str] = []
    for coefficient in _COEFFICIENTS:
        names += [coefficient, *(f"{coefficient}_{variable}" for variable in _VARIABLES)]
    return _TornadoSolution(
        {name: labelled[name] for name in names if name in labelled},
        {to: float(labelled[name][0][0]) for name, to in state.items()},
        {to: float(labelled[name][0][0]) for name, to in lengths.items()},
        centre=None,
        condition=float(labelled.get("Solver numerical condition.", (np.array([np.nan]), 0))[0][0]),
        remarks=remarks,
    )


def _check(file: Path, solution: _TornadoSolution) -> None:
    for name in _COEFFICIENTS:
        if name not in solution.numbers:
            raise ParseError(str(file), 0, f"no {name}", f"{_EXPECTED} of a solved case")
    for name, (values, line) in solution.numbers.items():
        if not np.isfinite(values).all():
            raise ParseError(str(file), line, f"{name} = {values}", "numbers; the run has failed")
    for name in ("CL", "CD"):
        values, line = solution.numbers[name]
        if abs(values[0]) > _MOST:
            raise ParseError(
                str(file),
                line,
                f"{name} = {values[0]:g} with a condition number of {solution.condition:.3g}",
                f"at most {_MOST:g}: the lattice is broken, or the reference area is wrong",
            )


def _of_controls(solution: _TornadoSolution) -> Iterator[tuple[np.ndarray, int]]:
    for name, entry in solution.numbers.items():
        if name.endswith("_d"):
            yield entry


def _condition(file: Path, solution: _TornadoSolution) -> dict[str, Any]:
    """Return the flight condition with the signs of flight dynamics. [rad]"""
    state, lengths = solution.state, solution.reference
    speed = state["V"]
    if not speed > 0.0:
        raise ParseError(str(file), 0, f"an airspeed of {speed:g}", "the speed of a flight")
    if abs(state["alpha"]) > 90.0 * DEGREE:
        raise ParseError(str(file), 0, f"alpha {state['alpha']:g} rad", "an angle in radians")
    # Tornado has p and r positive about axes that point aft and up.
    # 0.0 - x avoids the text -0 of a rate of zero.
    return {
        "alpha": state["alpha"],
        "beta": state["beta"],
        "phat": 0.0 - state["p"] * lengths["b"] / (2.0 * speed),
        "qhat": state["q"] * lengths["cbar"] / (2.0 * speed),
        "rhat": 0.0 - state["r"] * lengths["b"] / (2.0 * speed),
        "file": file.name,
    }


def _rows(
    file: Path, solution: _TornadoSolution, condition: dict[str, Any], controls: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """Yield totals and derivatives with the signs of flight dynamics."""
    for name, (values, line) in solution.numbers.items():
        coefficient, _, letter = name.partition("_")
        variable = _VARIABLES[letter] if letter else ""
        targets = controls if variable == "control" else [variable]
        if values.size != len(targets):
            raise ParseError(str(file), line, f"{values.size} numbers of {name}", str(len(targets)))
        sign = 1.0
        for turned in (coefficient, variable):
            sign = -sign if turned in _TURNED else sign
        place = condition | {"coefficient": coefficient, "line": line}
        for target, value in zip(targets, values):
            yield place | {"variable": target, "value": sign * float(value) + 0.0}
