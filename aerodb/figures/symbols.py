"""Symbols, display units and file names of quantities and terms in figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from aerodb.store.overview import FREE_AIR, plain_number
from flightmech.names import GREEK, SIGNS, lookup
from flightmech.support.figures import MINUS
from flightmech.units import from_si

_SYMBOLS = {
    "mach": "M",
    "h_agl": r"h_\mathrm{AGL}",
    "cbar": r"\bar{c}",
    "qbar": r"\bar{q}",
    "alphadothat": r"\hat{\dot{\alpha}}",
    "betadothat": r"\hat{\dot{\beta}}",
    "dnz": r"(n_z - 1)",
    "nz": "n_z",
    "CT": "C_T",
    "x_cg": r"x_\mathrm{cg}",
    "gear": r"\tau_\mathrm{gear}",
    "speedbrake": r"\tau_\mathrm{sb}",
}
_HAT = re.compile(r"^([pqr])hat$")
_COEFFICIENT = re.compile(r"^C[A-Za-z](_[a-z]+)?$")
# Stems of file names. Some file systems do not distinguish CL and Cl.
_FILES = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side-force",
    "Cl": "roll",
    "Cm": "pitch",
    "Cn": "yaw",
    "CX": "force-x",
    "CZ": "force-z",
    "Ch_e": "hinge-elevator",
    "Ch_a": "hinge-aileron",
    "Ch_r": "hinge-rudder",
}
# Unit of the vocabulary: unit as it is printed.
_PRINTED = {
    "1": "",
    "m s-1": "m/s",
    "m s-2": "m/s$^2$",
    "kg m-3": "kg/m$^3$",
    "degC": "°C",
    "kg m2": "kg m$^2$",
}


def math_symbol(name: str) -> str:
    """Return the symbol of a quantity or coefficient in TeX notation, without dollar signs.

    Examples
    --------
    >>> math_symbol("delta_f"), math_symbol("qhat"), math_symbol("Cl")
    ('\\\\delta_{f}', '\\\\hat{q}', 'C_{l}')
    """
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    hat = _HAT.match(name)
    if hat:
        return rf"\hat{{{hat[1]}}}"
    if _COEFFICIENT.match(name):
        return f"C_{{{name[1:].replace('_', ' ')}}}"
    head, _, tail = name.partition("_")
    base = head
    if head in GREEK:
        base = rf"\{head}"
    elif len(head) > 1:
        # A word is upright, a single letter is italic.
        base = rf"\mathrm{{{head}}}"
    return f"{base}_{{{tail}}}" if tail else base


def term_symbol(term: str, regressors: Sequence[str]) -> str:
    """Return the symbol of a term: ``C_L`` of CL/basic, a derivative, or an increment.

    Examples
    --------
    >>> term_symbol("CL/flap", []), term_symbol("Cm/qhat", ["qhat"])
    ('\\\\Delta C_{L,\\\\,\\\\mathrm{flap}}', 'C_{m\\\\,\\\\hat{q}}')
    """
    coefficient, _, contribution = term.partition("/")
    letter = math_symbol(coefficient).removeprefix("C_{").removesuffix("}")
    subscript = r"\,".join([letter, *map(math_symbol, regressors)])
    # A derivative has its regressor as subscript. Any other term has its name as well.
    if contribution == "basic" or (len(regressors) == 1 and contribution == regressors[0]):
        return f"C_{{{subscript}}}"
    name = contribution.replace("_", r"\ ")
    return rf"\Delta C_{{{subscript},\,\mathrm{{{name}}}}}"


def derivative_unit(regressors: Sequence[str]) -> str:
    """Return the unit of a table that regressors multiply; angles are in radians.

    Examples
    --------
    >>> derivative_unit(["beta", "gear"]), derivative_unit([])
    ('1/rad', '1')
    """
    power = sum(lookup(name).units == "rad" for name in regressors)
    return {0: "1", 1: "1/rad"}.get(power, f"1/rad$^{power}$")


def axis_label(name: str) -> str:
    """Return symbol and display unit of a variable as the label of an axis: ``$\\alpha$ [deg]``."""
    return f"${math_symbol(name)}$ [{printed_unit(name) or '1'}]"


def printed_unit(name: str) -> str:
    """Return the display unit of a quantity as printed; ``""`` for a pure number."""
    unit = lookup(name).display_units
    return _PRINTED.get(unit, unit)


def to_printed_unit(name: str, si: Any) -> Any:
    """Return values of a quantity in its display unit."""
    # The sum with 0.0 turns a negative zero into zero.
    return from_si(np.asarray(si, float), lookup(name).display_units) + 0.0


def value_with_symbol(name: str, si: float) -> str:
    """Return a value with its symbol: ``$M$ = 0.3``, ``$\\delta_{f}$ = 40 deg``."""
    if name == "h_agl" and si >= FREE_AIR:
        return "free air"
    text = f"${math_symbol(name)}$ = {number_text(float(to_printed_unit(name, si)))}"
    unit = printed_unit(name)
    return f"{text} {unit}" if unit else text


def number_text(value: float) -> str:
    """Return a number as printed: four significant digits or a whole number, with a minus sign."""
    return plain_number(value).replace("-", MINUS)


def positive_sense(name: str) -> str:
    """Return the positive sense of a quantity in words, or ``""`` if it has none."""
    sign = lookup(name).sign
    return SIGNS.get(sign, sign).removeprefix("aircraft ")


def file_stem(name: str) -> str:
    """Return the file stem of a term or coefficient: ``lift-basic`` for ``CL/basic``."""
    coefficient, _, contribution = name.partition("/")
    stem = _FILES.get(coefficient, coefficient.replace("_", "-"))
    return f"{stem}-{contribution}".replace("_", "-") if contribution else stem
