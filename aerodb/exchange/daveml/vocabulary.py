"""Quantity, unit and sign of the variables of a DAVE-ML file, in the vocabulary of this package."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import groupby

import numpy as np

from aerodb.exchange.daveml.document.elements import DaveVariable
from aerodb.exchange.daveml.document.units import unit_of_code
from aerodb.exchange.spelling import spell
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import SchemaError, UnitError
from flightmech.names import VOCABULARY, is_quantity, lookup
from flightmech.terms import SOURCES
from flightmech.units import parse_unit

# Prefix of the name of a check case that is stored in the database.
STORED = "checks: "

# End of the name of a constant that is the table of a term. It becomes a table without axes again,
# with or without standard error.
VALUE = " value"

WRITER = "aeromatch"  # prefix of the fileVersion of an exported file
_MORE = "| "  # prefix of a continuation line
_KEY = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(:=|:) ?(.*)", re.DOTALL)


def pack_attributes(attributes: Mapping[str, str | float]) -> str:
    """Return attributes as lines of text; a number has the separator ``:=``, a text ``:``.

    Characters that XML does not allow become question marks.
    """
    lines = []
    for key, value in attributes.items():
        if isinstance(value, str):
            text = f"{key}: {value}".replace("\r", "").replace("\n", f"\n{_MORE}")
            lines += text.split("\n")
        elif isinstance(value, int | np.integer):
            lines.append(f"{key}:= {value}")
        else:
            lines.append(f"{key}:= {float(value)!r}")
    return replace_illegal_characters("\n".join(lines))


def unpack_attributes(text: str) -> dict[str, str | float]:
    """Return the attributes of a text by `pack_attributes`."""
    attributes: dict[str, str | float] = {}
    # A NUL, which XML cannot contain, marks the line breaks inside a value.
    for line in text.replace(f"\n{_MORE}", "\0").replace("\n|", "\0").split("\n"):
        match = _KEY.fullmatch(line)
        if match is None:
            continue
        key, separator, value = match.groups()
        if separator == ":=":
            attributes[key] = _parse_number(value)
        else:
            attributes[key] = value.replace("\0", "\n")
    return attributes


def _parse_number(text: str) -> int | float:
    return int(text) if re.fullmatch(r"-?\d{1,18}", text) else float(text)


def replace_illegal_characters(text: str) -> str:
    """Replace the characters that XML does not allow by question marks."""
    return re.sub("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)


def source_runs(source: np.ndarray) -> str:
    """Return the source codes of nodes as runs in C order: ``12 datcom, 3 judgement``."""
    runs = []
    for code, group in groupby(source.ravel().tolist()):
        runs.append(f"{len(list(group))} {SOURCES[code]}")
    return ", ".join(runs)


def source_codes(text: str, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return the source codes of a text by `source_runs`, or None if they do not fit the shape."""
    pairs = [part.split() for part in text.split(", ")]
    if not all(len(pair) == 2 and pair[0].isdigit() and pair[1] in SOURCES for pair in pairs):
        return None
    counts = [int(pair[0]) for pair in pairs]
    if sum(counts) != int(np.prod(shape)):
        return None
    codes = np.repeat([SOURCES.index(pair[1]) for pair in pairs], counts)
    return codes.astype(np.uint8).reshape(shape)


COEFFICIENTS = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn", "Ch_e", "Ch_a", "Ch_r")
# Names in published files that are not in S-119 (`flightmech.names`). Letters only, lower case.
_ALIASES = {
    "totalcoefficientoflift": "CL",
    "totalcoefficientofdrag": "CD",
    "aerobodyforcecoefficienty": "CY",
    "rollingmomentcoefficient": "Cl",
    "pitchingmomentcoefficient": "Cm",
    "yawingmomentcoefficient": "Cn",
    "machnumber": "mach",
    "longitudinalreferencelength": "cbar",
    "lateralreferencelength": "b",
    "referencearea": "S",
}
# Words and abbreviations of S-119 for the two senses of a sign convention.
_OPPOSITES = [
    ({"ted", "trailingedgedown"}, {"teu", "trailingedgeup"}),
    ({"tel", "trailingedgeleft"}, {"ter", "trailingedgeright"}),
    (
        {"rwd", "rightwingdown", "rightroll"},
        {"lwd", "leftwingdown", "leftroll", "righttedleftroll"},
    ),
    ({"anu", "noseup", "aircraftnoseup"}, {"and", "nosedown", "aircraftnosedown"}),
    ({"anr", "noseright", "aircraftnoseright"}, {"anl", "noseleft", "aircraftnoseleft"}),
    ({"fwd", "forward"}, {"aft", "rearward"}),
    ({"rt", "right"}, {"lt", "left"}),
    ({"up"}, {"down", "dn", "dwn"}),
    ({"windfromright", "windinrightear", "wir"}, {"windfromleft", "windinleftear", "wil"}),
]


def _letters(text: str) -> str:
    return re.sub("[^a-z]", "", text.lower())


_S119 = {_letters(row.s119): row.name for row in VOCABULARY.values() if row.s119} | _ALIASES


def quantity_of(variable: DaveVariable) -> str:
    """Return the quantity that a variable is by its name or varID, or ``""``.

    Names of S-119 come first, in any case and with or without a unit at their end
    (``angleOfAttack_d``).  The names of the vocabulary follow.
    """
    for text in (variable.name, variable.varID):
        for letters in (_letters(text), _letters(re.sub("_(d|deg|rad|r)$", "", text))):
            if letters in _S119:
                return _S119[letters]
    for text in (variable.name, variable.varID):
        if is_quantity(text):
            return text
    return "mach" if variable.name.lower() == "mach" else ""


def device_of(variable: DaveVariable) -> str:
    """Return the name of an input that is not in the vocabulary: ``device.DBFLL.deflection``.

    An angle is a deflection, a pure number a setting.  For any other unit the result is ``""``,
    because such an input cannot enter the tables of a database.
    """
    try:
        unit = unit_of_code(variable.units)
        dimension = parse_unit(unit)[0]
    except UnitError:
        return ""
    # An angle and a pure number have the same dimension.
    if dimension != parse_unit("rad")[0]:
        return ""
    kind = "deflection" if "rad" in unit or "deg" in unit else "setting"
    return f"{DEVICE}{re.sub('[^A-Za-z0-9_]', '_', variable.varID)}.{kind}"


def file_unit_conversion(variable: DaveVariable, quantity: str) -> tuple[float, float]:
    """Return factor and offset of value_file = factor * value_SI + offset, for unit and sign.

    Raises
    ------
    SchemaError
        The unit belongs to another quantity, or an angle has no unit.
    """
    expected = lookup(quantity).units
    try:
        unit = unit_of_code(variable.units)
        dimension, to_si, offset = parse_unit(unit)
        # Angles and pure numbers have the same dimension, so the unit itself is compared.
        lacks_angle = "rad" in expected and "rad" not in unit and "deg" not in unit
        if dimension != parse_unit(expected)[0] or lacks_angle:
            problem = f"unit {variable.units!r}, where {quantity} needs one such as {expected}"
            name = spell(
                f"names={{'{variable.varID}': '{quantity} [deg]'}}",
                f"--names '{variable.varID}={quantity} [deg]'",
            )
            raise UnitError(f"{problem}; name it with {name}, say")
    except UnitError as error:
        raise SchemaError(f"variable {variable.varID} ({variable.name})", [str(error)]) from None
    sense = -1.0 if has_opposite_sign(variable.sign, lookup(quantity).sign) else 1.0
    return sense / to_si, -offset / to_si


def has_opposite_sign(sign: str, vocabulary_sign: str) -> bool:
    """Return whether a sign convention is opposite to that of the vocabulary.

    An unknown convention counts as the same.
    """
    file_letters, vocabulary_letters = _letters(sign), _letters(vocabulary_sign)
    for first, second in _OPPOSITES:
        if file_letters in first and vocabulary_letters in second:
            return True
        if file_letters in second and vocabulary_letters in first:
            return True
    return False
