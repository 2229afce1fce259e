"""How a quantity is written for people: symbol, words, display unit, number of digits.

The vocabulary's SI value becomes the display value here and nowhere else in the report.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

import numpy as np
from markupsafe import Markup

from flightmech import units
from flightmech.errors import UnknownName
from flightmech.names import SIGNS, lookup
from flightmech.support.figures import MINUS

MISSING = "\N{EN DASH}"
SYMBOLS = {
    "pass": "✓",
    "limits_exceeded": "✓!",
    "record_error": "✓?",
    "fail": "✗",
    "invalid": "!",
    "not_tested": "–",
    "advisory": "○",
}
"""Verdicts as marks: never colour alone."""

_GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "theta": "θ",
    "phi": "φ",
    "psi": "ψ",
    "rho": "ρ",
}
_HAT, _BAR, _DOT = (
    "\N{COMBINING CIRCUMFLEX ACCENT}",
    "\N{COMBINING MACRON}",
    "\N{COMBINING DOT ABOVE}",
)
# symbols that the rules of `symbol_parts` would not find: base, subscript
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
    "thrust_drive": ("F", ""),
    **{f"wind_{x}": ("W", x) for x in "ned"},
    **{f"{axis}_cg_b": (axis, "cg") for axis in "xyz"},
    "V_cas": ("V", "CAS"),
    "V_eas": ("V", "EAS"),
    **{
        name: (name[0], name[1:])
        for name in (
            "ax",
            "ay",
            "az",
            "nz",
            "vn",
            "ve",
            "vd",
            "n1",
            "n2",
            "CL",
            "CD",
            "CY",
            "CX",
            "CZ",
        )
    },
    **{name: ("C", name[1]) for name in ("Cl", "Cm", "Cn")},
    **{name: ("I", name[1:]) for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")},
}
# derivatives the vocabulary leaves out; trim residuals carry them
_EXTRA = {
    **{
        f"{x}_dot": (f"body acceleration along {axis}", "m s-2", "m s-2")
        for x, axis in (("u", "x"), ("v", "y"), ("w", "z"))
    },
    "thrust_drive": ("net thrust that drives the model", "N", "lbf"),
    "qnh": ("pressure setting of the altimeter", "Pa", "hPa"),
    "V_dot": ("rate of true airspeed", "m s-2", "m s-2"),
}
# names for a page, where the vocabulary's long name is a definition
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
    **{
        f"wind_{axis}": f"wind, velocity {way}"
        for axis, way in (("n", "north"), ("e", "east"), ("d", "down"))
    },
}
# what has two ends: the words for 0 and 1
_ENDS = {"gear": ("up", "down"), "speedbrake": ("in", "out")}
# decimals of a value that was measured, by display unit; elsewhere three significant digits
_DECIMALS = {
    "deg": 2,
    "deg/s": 2,
    "deg/s²": 3,
    "kt": 1,
    "ft": 0,
    "ft/min": 0,
    "lbf": 1,
    "m/s²": 3,
    "g": 3,
    "m/s": 1,
    "%": 1,
    "kg": 0,
    "°C": 1,
    "K": 1,
    "hPa": 1,
    "m": 3,
}
# load factors are judged and drawn in g, as the tolerance table prints them; the number is the same
_IN_G = {"nz", "dnz"}
_WORDS = {
    "trim": "bias found by the trim",
    "left": "left after the trim",
    "bias": "bias applied",
    "applied": "as applied",
    "term": "scale of the term",
}
AT_END = 0.01
_SILENT = {"init", "mass", "env"}
_SUPER = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_POWER = re.compile(r"([A-Za-z%])(\d)")
# a panel never zooms in further than this on a quantity without tolerance
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
    """A quantity as shown.

    ``base`` and ``sub`` make the symbol, ``words`` the name on a page, ``meaning`` the definition,
    ``unit`` the display unit as printed (empty for a pure number), ``sign`` the positive sense in
    words; ``factor`` and ``offset`` give display = SI * factor + offset.
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
        return Markup("<i>{}</i>{}").format(
            self.base, Markup("<sub>{}</sub>").format(self.sub) if self.sub else ""
        )

    @property
    def least_span(self) -> float:
        """Smallest height of a panel without tolerance, in display units."""
        return _LEAST_SPAN.get(self.unit, 0.0)

    def shown(self, si):
        """Return SI values in display units."""
        return np.asarray(si, float) * self.factor + self.offset

    def width(self, si):
        """Return an SI difference or half width in display units: the offset of a temperature stays
        out.
        """
        return np.asarray(si, float) * self.factor


def pretty_unit(unit: str) -> str:
    """Return a unit as printed: ``m s-1`` becomes ``m/s``, ``kg m2`` becomes ``kg m²``, ``1``
    becomes nothing.
    """
    text = {
        "1": "",
        "-": "",
        "m s-1": "m/s",
        "m s-2": "m/s2",
        "kg m-3": "kg/m3",
        "degC": "°C",
        "rad s-1": "rad/s",
    }.get(unit, unit)
    return _POWER.sub(lambda m: m.group(1) + m.group(2).translate(_SUPER), text)


def symbol_parts(name: str) -> tuple[str, str]:
    """Return base and subscript of the symbol of a canonical name."""
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    head, _, tail = name.partition("_")
    if tail == "dot":
        return _GREEK.get(head, head) + _DOT, ""
    if head.endswith("hat"):
        return head[0] + _HAT, tail
    return _GREEK.get(head, head), tail


@cache
def quantity_label(name: str) -> QuantityLabel:
    """Return how the quantity `name` is shown; a name outside the vocabulary keeps its own text and
    SI value.

    Prefixes of the simulation's names (``engine1.``, ``trim.``, ``residual.`` ...) become words.
    """
    *prefixes, stem = name.split(".")
    if prefixes and prefixes[0] == "term":
        return QuantityLabel(name, name, "", "scale of the term", "", "", 1.0, 0.0)
    if prefixes[:1] == ["trim"] and stem.endswith("_dot"):
        prefixes = ["left"]
    notes = [
        f"engine {p.removeprefix('engine')}" if p.startswith("engine") else _WORDS.get(p, p)
        for p in prefixes
        if p not in _SILENT
    ]
    try:
        row = lookup(stem)
    except UnknownName:
        if stem not in _EXTRA:
            return QuantityLabel(name, name, "", "", "", "", 1.0, 0.0)
        words, si_unit, display = _EXTRA[stem]
        sign = ""
    else:
        words, si_unit, display, sign = row.long_name, row.units, row.display_units, row.sign
    base, sub = symbol_parts(stem)
    sub = " ".join(
        [sub, *(p.removeprefix("engine") for p in prefixes if p.startswith("engine"))]
    ).strip()
    factor, offset = _conversion(display)
    unit = "g" if stem in _IN_G else pretty_unit(display if display != "1" else si_unit)
    return QuantityLabel(
        name,
        base,
        sub,
        ", ".join([_SHORT.get(stem, words), *notes]),
        unit,
        _spelt(sign),
        factor,
        offset,
        ", ".join([words, *notes]),
    )


def _spelt(sign: str) -> str:
    return re.sub("|".join(SIGNS), lambda m: SIGNS[m.group()], sign)


def _conversion(display: str) -> tuple[float, float]:
    _, factor, offset = units.parse_unit(display)
    return 1.0 / factor, -offset / factor


def format_number(value, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, never in powers of ten between 1e-4 and
    1e6; NaN becomes a dash.

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
        return MISSING if math.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    text = f"{value:.{max(digits - 1 - size, 0)}f}" if -5 < size < 6 else f"{value:.{digits - 1}e}"
    return text.replace("-", MINUS)


def fixed_decimals(value, decimals: int) -> str:
    """Return a number with `decimals` decimals; NaN becomes a dash, minus zero loses its sign."""
    if value is None or not math.isfinite(float(value)):
        return MISSING
    text = f"{float(value):.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", MINUS)


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
    return f"{math.floor(float(share) * 1000.0) / 10.0:.1f} %"


def short_number(value: float, digits: int = 4) -> str:
    """Return a number without trailing zeros, for values that are set rather than measured.

    Examples
    --------
    >>> short_number(40.0), short_number(0.1900)
    ('40', '0.19')
    """
    text = format_number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def measured_text(si: float, name: str) -> str:
    """Return a value with its display unit, e.g. for a table of conditions; an undercarriage is up,
    down or on its way.
    """
    shown = quantity_label(name)
    stem = name.rpartition(".")[2]
    if stem in _ENDS and (end := round(si)) in (0, 1) and abs(si - end) < AT_END:
        return _ENDS[stem][end]
    return f"{plain_measured_text(float(shown.shown(si)), shown.unit)}\N{NO-BREAK SPACE}{shown.unit}".rstrip(
        "\N{NO-BREAK SPACE}"
    )


def has_ends(name: str) -> bool:
    """Whether a quantity is printed by the words of its ends, such as an undercarriage that is up
    or down.
    """
    return name.rpartition(".")[2] in _ENDS


def plain_measured_text(value: float, unit: str) -> str:
    """Return a measured value with the decimals that its display unit deserves, trailing zeros
    kept.
    """
    return fixed_decimals(value, _DECIMALS[unit]) if unit in _DECIMALS else format_number(value)


_COEFFICIENTS = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side-force",
    "Cl": "rolling-moment",
    "Cm": "pitching-moment",
    "Cn": "yawing-moment",
    "CX": "longitudinal-force",
    "CZ": "normal-force",
}
_CAUSES = {
    "altitude": "altitude",
    "flap": "flap extension",
    "elevator": "elevator deflection",
    "tab": "tab deflection",
    "aileron": "aileron deflection",
    "rudder": "rudder deflection",
    "qhat": "pitch rate",
    "phat": "roll rate",
    "rhat": "yaw rate",
    "alphadothat": "rate of change of angle of attack",
    "betadothat": "rate of change of sideslip",
    "beta": "sideslip",
    "sideslip": "sideslip",
    "load_factor": "load factor",
    "speedbrake": "speed-brake extension",
    "gear": "gear extension",
    "ground": "ground effect",
}
_WITH = {
    "flap": "with flaps",
    "gear": "with gear down",
    "ground": "in ground effect",
    "speedbrake": "with speed-brakes",
    "beta": "in sideslip",
}
_VARIABLES = {
    "delta_f": "flap extension",
    "gear": "gear extension",
    "speedbrake": "speed-brake extension",
    "h_agl": "ground effect",
    "delta_e": "elevator deflection",
    "delta_a": "aileron deflection",
    "delta_r": "rudder deflection",
}
_WHOLE = {
    "C*/*": "whole aerodynamic model",
    "engine/*": "whole engine model",
    "gear/*": "whole landing gear",
    "circuit/*": "all control circuits",
    "engine/static": "thrust and air flow of the engines over their speed",
    "engine/schedule": "commanded engine speed over the lever",
    "engine/dynamics": "how the engines follow the lever",
    "engine/rest": "the rest of the engine deck, such as fuel flow",
    "engine/thrust": "thrust and lag of the engines",
    "gear/steering": "nose-wheel steering",
    "gear/runway": "runway friction",
    "fuel/load": "fuel",
}


def term_words(term: str) -> str:
    """Return a term, a group of terms or a part of the aircraft in words; an unknown name gives an
    empty text.

    Examples
    --------
    >>> term_words("Cl/phat")
    'rolling-moment increment due to roll rate'
    >>> term_words("Cn/rhat_gear")
    'yawing-moment increment due to yaw rate, with gear down'
    >>> term_words("Cm/*"), term_words("*(gear)"), term_words("engine/static")
    ('all pitching-moment terms', 'all terms of gear extension', 'thrust and air flow of the engines over their speed')
    """
    if term in _WHOLE:
        return _WHOLE[term]
    if term.startswith("*(") and term[2:-1] in _VARIABLES:
        return f"all terms of {_VARIABLES[term[2:-1]]}"
    coefficient, _, name = term.partition("/")
    force = _COEFFICIENTS.get(coefficient, "")
    if force and name == "*":
        return f"all {force} terms"
    if coefficient == "gear":
        return f"{name} leg of the landing gear" if name in ("nose", "left", "right") else ""
    if not force or name == "basic":
        return f"basic {force.replace('-', ' ')}" if force else ""
    if name == "flap_slope":
        return f"change of {force} slope due to flap extension"
    cause, _, where = (name, "", "") if name in _CAUSES else name.partition("_")
    if cause not in _CAUSES or (where and where not in _WITH):
        return ""
    return f"{force} increment due to {_CAUSES[cause]}" + (f", {_WITH[where]}" if where else "")
