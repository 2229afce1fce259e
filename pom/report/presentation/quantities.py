"""Display of quantities: symbol, words, display unit, number of digits.

The vocabulary's SI value becomes the display value here and nowhere else in the report.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from markupsafe import Markup

from flightmech import units
from flightmech.aircraft.controls import ICE
from flightmech.errors import UnknownName
from flightmech.names import GREEK, SIGNS, lookup
from flightmech.support.figures import MINUS
from pom.report.presentation.unit_sets import current_units, display_unit_of

MISSING = "\N{EN DASH}"
SYMBOLS = {
    "pass": "✓",
    "pass_with_departures": "✓*",
    "limits_exceeded": "✓!",
    "record_error": "✓?",
    "leak": "✗=",
    "not_driven": "✗~",
    "demonstration": "◇",
    "fail": "✗",
    "invalid": "!",
    "not_tested": "–",
    "advisory": "○",
}
"""Verdicts as marks, for readers who do not distinguish the colours."""

_HAT = "\N{COMBINING CIRCUMFLEX ACCENT}"
_BAR = "\N{COMBINING MACRON}"
_DOT = "\N{COMBINING DOT ABOVE}"
# Symbols that do not follow the rules of `symbol_parts`: base and subscript.
_SYMBOLS = {
    "qbar": ("q" + _BAR, ""),
    "cbar": ("c" + _BAR, ""),
    "alphadothat": ("α" + _DOT + _HAT, ""),
    "betadothat": ("β" + _DOT + _HAT, ""),
    "hdot": ("h" + _DOT, ""),
    "mach": ("M", ""),
    "temperature": ("T", ""),
    "a_sound": ("a", ""),
    "time": ("t", ""),
    "thrust": ("F", ""),
    "dnz": ("Δn", "z"),
    "delta_T": ("ΔT", ""),
    "mass": ("m", ""),
    "wind_n": ("W", "n"),
    "wind_e": ("W", "e"),
    "wind_d": ("W", "d"),
    "x_cg_b": ("x", "cg"),
    "y_cg_b": ("y", "cg"),
    "z_cg_b": ("z", "cg"),
    "V_cas": ("V", "CAS"),
    "V_eas": ("V", "EAS"),
    "Cl": ("C", "l"),
    "Cm": ("C", "m"),
    "Cn": ("C", "n"),
}
# Symbols of which the first letter is the base and the rest is the subscript.
_FIRST_LETTER = (
    *("ax", "ay", "az", "nz", "vn", "ve", "vd", "n1", "n2"),
    *("CL", "CD", "CY", "CX", "CZ"),
    *("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
)
# Quantities that the vocabulary does not have: words, SI unit and display unit.
_EXTRA = {
    "u_dot": ("body acceleration along x", "m s-2", "m s-2"),
    "v_dot": ("body acceleration along y", "m s-2", "m s-2"),
    "w_dot": ("body acceleration along z", "m s-2", "m s-2"),
    "qnh": ("pressure setting of the altimeter", "Pa", "hPa"),
    "V_dot": ("rate of true airspeed", "m s-2", "m s-2"),
}
# Short names, where the long name of the vocabulary is a definition.
_SHORT = {
    "nz": "normal load factor",
    "delta_a": "aileron deflection",
    "gear": "undercarriage",
    "speedbrake": "speed-brake",
    "h": "height over mean sea level",
    "throttle": "power lever",
    "gamma": "flight-path angle",
    "delta_T": "temperature over standard",
    "x_cg_b": "c.g. forward of moment reference",
    "y_cg_b": "c.g. right of moment reference",
    "z_cg_b": "c.g. below moment reference",
    "wind_n": "wind, velocity north",
    "wind_e": "wind, velocity east",
    "wind_d": "wind, velocity down",
    ICE: "ice, 0 clean, 1 the ice of the database",
}
# Quantities with two end positions, and the words of 0 and 1.
_ENDS = {"gear": ("up", "down"), "speedbrake": ("in", "out")}
# A value this near to an end position is printed as the word of that end.
AT_END = 0.01
# Decimals of a measured value by display unit.  Other units have three significant digits.
_DECIMALS = {
    "deg": 2,
    "deg/s": 2,
    "deg/s²": 3,
    "kt": 1,
    "ft": 0,
    "ft/min": 0,
    "lbf": 1,
    "m/s²": 3,
    "ft/s²": 3,
    "g": 3,
    "m/s": 1,
    "%": 1,
    "kg": 0,
    "lb": 0,
    "N": 0,
    "in": 2,
    "kg m²": 0,
    "slug ft²": 0,
    "°C": 1,
    "K": 1,
    "hPa": 1,
    "m": 3,
}
_HIGH = 100.0  # [m] from here on a length has one decimal
# Load factors are drawn in g, as the tolerance table prints them.  The number is the same.
_IN_G = {"nz", "dnz"}
# Words of the prefixes of the simulation's names.
_PREFIXES = {
    "trim": "bias found by the trim",
    "left": "left after the trim",
    "bias": "bias applied",
    "applied": "as applied",
    "term": "scale of the term",
}
# Prefixes that the name on a page leaves out.
_SILENT = {"init", "mass", "env"}
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_POWER = re.compile(r"([A-Za-z%])(\d)")
# Units whose printed form is not their own text.
_PRINTED_UNITS = {
    "1": "",
    "-": "",
    "m s-1": "m/s",
    "m s-2": "m/s2",
    "kg m-3": "kg/m3",
    "degC": "°C",
    "rad s-1": "rad/s",
}
# Smallest height of a panel of a quantity without tolerance, by display unit.
_LEAST_SPAN = {
    "deg": 1.0,
    "deg/s": 1.0,
    "kt": 2.0,
    "ft": 10.0,
    "g": 0.04,
    "ft/min": 100.0,
    "%": 2.0,
    "lbf": 10.0,
    "m/s": 0.5,
    "": 0.02,
}


@dataclass(frozen=True)
class QuantityLabel:
    """A quantity as a page shows it.

    Attributes
    ----------
    name : str
        Canonical name, with prefixes.
    base, sub : str
        Symbol and its subscript.
    words : str
        Name on a page; empty outside the vocabulary.
    unit : str
        Display unit as printed; empty for a pure number.
    sign : str
        Positive sense in words.
    factor, offset : float
        Conversion: display = SI * factor + offset.
    meaning : str
        Definition.
    """

    name: str
    base: str
    sub: str
    words: str
    unit: str
    sign: str
    factor: float
    offset: float
    meaning: str = ""

    @property
    def is_word(self) -> bool:
        """Whether the quantity has no symbol, only a name such as ``gear``."""
        return len(self.base) > 2 and self.base.isascii()

    @property
    def html(self) -> Markup:
        """The symbol with its subscript; a plain name stays upright."""
        if self.is_word:
            return Markup("{}").format(self.words or self.name)
        subscript = Markup("<sub>{}</sub>").format(self.sub) if self.sub else ""
        return Markup("<i>{}</i>{}").format(self.base, subscript)

    @property
    def least_span(self) -> float:
        """Smallest height of a panel without tolerance, in display units."""
        return _LEAST_SPAN.get(self.unit, 0.0)

    def shown(self, si):
        """Return SI values in display units."""
        return np.asarray(si, float) * self.factor + self.offset

    def width(self, si):
        """Return an SI difference or half width in display units, without an offset."""
        return np.asarray(si, float) * self.factor


def pretty_unit(unit: str) -> str:
    """Return a unit as printed.

    Examples
    --------
    >>> pretty_unit("m s-1"), pretty_unit("kg m2"), pretty_unit("1")
    ('m/s', 'kg m²', '')
    """
    text = _PRINTED_UNITS.get(unit, unit)
    return _POWER.sub(_raise_power, text)


def _raise_power(match: re.Match[str]) -> str:
    return match.group(1) + match.group(2).translate(_SUPERSCRIPTS)


def symbol_parts(name: str) -> tuple[str, str]:
    """Return base and subscript of the symbol of a canonical name."""
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    if name in _FIRST_LETTER:
        return name[0], name[1:]
    stem, _, tail = name.partition("_")
    if tail == "dot":
        return GREEK.get(stem, stem) + _DOT, ""
    if stem.endswith("hat"):
        return stem[0] + _HAT, tail
    return GREEK.get(stem, stem), tail


def quantity_label(name: str) -> QuantityLabel:
    """Return the display of a quantity in the units of the report (`unit_sets.shown_in`).

    A name outside the vocabulary keeps its text and its SI value.  Prefixes of the simulation's
    names (``engine1.``, ``trim.``, ``residual.`` ...) become words.
    """
    return _make_label(name, current_units())


@cache
def _make_label(name: str, unit_set: str) -> QuantityLabel:
    *prefixes, item = name.split(".")
    # an input that drives an engine has the name of its quantity
    stem = item.removesuffix("_drive")
    if prefixes and prefixes[0] == "term":
        return QuantityLabel(
            name, name, "", words="scale of the term", unit="", sign="", factor=1.0, offset=0.0
        )
    # The trim reports residual accelerations with the prefix of its biases.
    if prefixes[:1] == ["trim"] and stem.endswith("_dot"):
        prefixes = ["left"]
    try:
        row = lookup(stem)
    except UnknownName:
        if stem not in _EXTRA:
            return QuantityLabel(name, name, "", words="", unit="", sign="", factor=1.0, offset=0.0)
        words, si_unit, display_unit = _EXTRA[stem]
        sign = ""
    else:
        words, si_unit, display_unit = row.long_name, row.units, row.display_units
        sign = row.sign
    # a load factor is shown in g by every set
    if stem not in _IN_G:
        display_unit = display_unit_of(si_unit, display_unit, unit_set)
    if stem != item:
        words = f"{words} that drives the model"
    base, sub = symbol_parts(stem)
    notes, engines = _prefix_notes(prefixes)
    factor, offset = _display_conversion(display_unit)
    unit = pretty_unit(display_unit if display_unit != "1" else si_unit)
    return QuantityLabel(
        name=name,
        base=base,
        sub=" ".join([sub, *engines]).strip(),
        words=", ".join([_SHORT.get(item, words), *notes]),
        unit="g" if stem in _IN_G else unit,
        sign=_spell_sign(sign),
        factor=factor,
        offset=offset,
        meaning=", ".join([words, *notes]),
    )


def _prefix_notes(prefixes: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the words of prefixes, and the numbers of engines for the subscript."""
    notes, engines = [], []
    for prefix in prefixes:
        if prefix.startswith("engine"):
            number = prefix.removeprefix("engine")
            engines.append(number)
            notes.append(f"engine {number}")
        elif prefix not in _SILENT:
            notes.append(_PREFIXES.get(prefix, prefix))
    return notes, engines


def _spell_sign(sign: str) -> str:
    """Return a sign convention with its abbreviations spelt out."""
    return re.sub("|".join(SIGNS), lambda match: SIGNS[match.group()], sign)


def _display_conversion(display_unit: str) -> tuple[float, float]:
    """Return factor and offset from SI to a display unit, the inverse of those of the unit."""
    _, factor, offset = units.parse_unit(display_unit)
    return 1.0 / factor, -offset / factor


def format_number(value, digits: int = 3) -> str:
    """Return a number with `digits` significant digits.

    Numbers from 1e-4 to 1e6 are written without a power of ten.  NaN and None become a dash.

    Examples
    --------
    >>> format_number(1234.5), format_number(0.012345), format_number(float("nan"))
    ('1234', '0.0123', '–')
    """
    if value is None:
        return MISSING
    if isinstance(value, str):
        return value
    value = float(value)
    if not math.isfinite(value):
        return _non_finite_text(value)
    if value == 0.0:
        return "0"
    # The exponent is that of the rounded number: 9.996 has two digits before the point.
    text = f"{value:.{digits - 1}e}"
    exponent = math.floor(math.log10(abs(float(text))))
    if -5 < exponent < 6:
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
    return text.replace("-", MINUS)


def _non_finite_text(value: float) -> str:
    if math.isnan(value):
        return MISSING
    return "∞" if value > 0 else f"{MINUS}∞"


def fixed_decimals(value, decimals: int) -> str:
    """Return a number with `decimals` decimals.

    NaN and None become a dash.  A number that is rounded to zero has no sign.
    """
    if value is None or not math.isfinite(float(value)):
        return MISSING
    text = f"{float(value):.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def percent_text(share) -> str:
    """Return a share as percent, never rounded up to 100 while a sample is outside.

    Examples
    --------
    >>> percent_text(0.9999), percent_text(1.0)
    ('99.9 %', '100 %')
    """
    if share is None or not math.isfinite(float(share)):
        return MISSING
    if share >= 1.0:
        return "100 %"
    # Rounded down to a tenth of a percent.
    return f"{math.floor(float(share) * 1000.0) / 10.0:.1f} %"


def short_number(value: float, digits: int = 4) -> str:
    """Return a number without trailing zeros, for values that a person has set.

    Examples
    --------
    >>> short_number(40.0), short_number(0.1900)
    ('40', '0.19')
    """
    text = format_number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def measured_text(si: float, name: str) -> str:
    """Return a value with its display unit, for example for a table of conditions.

    A quantity with two end positions, such as an undercarriage, has the word of its end there.
    """
    label = quantity_label(name)
    stem = name.rpartition(".")[2]
    if stem in _ENDS:
        end = round(si)
        if end in (0, 1) and abs(si - end) < AT_END:
            return _ENDS[stem][end]
    value = plain_measured_text(float(label.shown(si)), label.unit)
    return f"{value}\N{NO-BREAK SPACE}{label.unit}".rstrip("\N{NO-BREAK SPACE}")


def has_ends(name: str) -> bool:
    """Return whether a quantity is printed by the words of its end positions."""
    return name.rpartition(".")[2] in _ENDS


def plain_measured_text(value: float, unit: str) -> str:
    """Return a measured value with the decimals of its display unit, with trailing zeros."""
    # millimetres of a centre of gravity, not of a height
    if unit == "m" and abs(value) >= _HIGH:
        return fixed_decimals(value, 1)
    if unit in _DECIMALS:
        return fixed_decimals(value, _DECIMALS[unit])
    return format_number(value)
