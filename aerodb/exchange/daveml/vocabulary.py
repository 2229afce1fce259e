"""Which quantity of the vocabulary a variable of a DAVE-ML file is, in which unit and with which
sign.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import groupby

import numpy as np

from aerodb.exchange.daveml.document.model import DaveVariable
from aerodb.exchange.daveml.document.units import unit_of_code
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import VOCABULARY, lookup
from flightmech.terms import SOURCES
from flightmech.units import parse_unit

STORED = "checks: "  # how the name of a case begins that stands in the database


# reduced rate: the rate it is made of and the reference length; rate * length / (2 V)
REDUCED = {
    "phat": ("p", "b"),
    "qhat": ("q", "cbar"),
    "rhat": ("r", "b"),
    "alphadothat": ("alpha_dot", "cbar"),
    "betadothat": ("beta_dot", "b"),
}
# how the name of a constant ends that is the table of a term; it stays one, with or without
# standard error
VALUE = " value"


WRITER = "aeromatch"  # how the fileVersion of our files begins
_MORE = "| "  # a line that goes on
_KEY = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(:=|:) ?(.*)", re.DOTALL)


def pack_attributes(attributes: Mapping[str, str | float]) -> str:
    """Return attributes as lines; numbers stand behind ``:=``.  Characters that XML does not allow
    become question marks.
    """
    lines = []
    for key, item in attributes.items():
        if isinstance(item, str):
            lines += f"{key}: {item}".replace("\r", "").replace("\n", f"\n{_MORE}").split("\n")
        else:
            lines.append(
                f"{key}:= {item}"
                if isinstance(item, int | np.integer)
                else f"{key}:= {float(item)!r}"
            )
    return replace_illegal_characters("\n".join(lines))


def unpack_attributes(text: str) -> dict[str, str | float]:
    """Return the attributes that `pack_attributes` wrote."""
    found: dict[str, str | float] = {}
    for line in text.replace(f"\n{_MORE}", "\0").replace("\n|", "\0").split("\n"):
        match = _KEY.fullmatch(line)
        if match:
            found[match[1]] = (
                _number(match[3]) if match[2] == ":=" else match[3].replace("\0", "\n")
            )
    return found


def _number(text: str) -> int | float:
    return int(text) if re.fullmatch(r"-?\d{1,18}", text) else float(text)


def replace_illegal_characters(text: str) -> str:
    """Return a text in which the characters that XML does not allow are question marks."""
    return re.sub("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)


def source_runs(source: np.ndarray) -> str:
    """Return the source codes of nodes as runs in C order: ``12 datcom, 3 judgement``."""
    return ", ".join(
        f"{len(list(group))} {SOURCES[code]}" for code, group in groupby(source.ravel().tolist())
    )


def source_codes(text: str, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return the source codes that `source_runs` wrote, or None when they do not fit the shape."""
    pairs = [part.split() for part in text.split(", ")]
    if not all(len(pair) == 2 and pair[0].isdigit() and pair[1] in SOURCES for pair in pairs):
        return None
    counts = [int(pair[0]) for pair in pairs]
    if sum(counts) != int(np.prod(shape)):
        return None
    return (
        np.repeat([SOURCES.index(pair[1]) for pair in pairs], counts)
        .astype(np.uint8)
        .reshape(shape)
    )


COEFFICIENTS = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn", "Ch_e", "Ch_a", "Ch_r")
# names found in published files in addition to those of S-119 that `flightmech.names` lists;
# letters only, lower case
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
_OPPOSITES = [  # words and abbreviations of S-119 for the two senses
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
    """Return the quantity of the vocabulary that a variable is by its name or varID, or ``""``.

    Names of S-119 come first, in any case and with or without a unit at their end
    (``angleOfAttack_d``); then the names of the vocabulary.
    """
    for text in (variable.name, variable.varID):
        for known in (_letters(text), _letters(re.sub("_(d|deg|rad|r)$", "", text))):
            if known in _S119:
                return _S119[known]
    for text in (variable.name, variable.varID):
        if _is_quantity(text):
            return text
    return "mach" if variable.name.lower() == "mach" else ""


def device_of(variable: DaveVariable) -> str:
    """Return the name of an input that is no quantity of the vocabulary,
    ``device.DBFLL.deflection``; ``""`` for other units.

    An angle is a deflection, a pure number a setting; other units have no place in the tables of a
    database.
    """
    try:
        unit = unit_of_code(variable.units)
        dimension = parse_unit(unit)[0]
    except UnitError:
        return ""
    kind = {
        parse_unit("rad")[0]: "deflection" if "rad" in unit or "deg" in unit else "setting"
    }.get(dimension, "")
    return f"{DEVICE}{re.sub('[^A-Za-z0-9_]', '_', variable.varID)}.{kind}" if kind else ""


def _is_quantity(text: str) -> bool:
    """Whether a text names a quantity of the vocabulary; those of one engine, ``engine1.thrust``,
    are in the vocabulary without prefix.
    """
    try:
        lookup(text)
    except UnknownName:
        return False
    return True


def file_unit_conversion(variable: DaveVariable, quantity: str) -> tuple[float, float]:
    """Return factor and offset of value_file = factor * value_SI + offset, units and sign.

    Raises
    ------
    SchemaError
        A unit of another quantity, or none where an angle needs one.
    """
    expected = lookup(quantity).units
    try:
        unit = unit_of_code(variable.units)
        dimension, to_si, offset = parse_unit(unit)
        if dimension != parse_unit(expected)[0] or (
            "rad" in expected and "rad" not in unit and "deg" not in unit
        ):
            problem = f"unit {variable.units!r}, where {quantity} needs one such as {expected}"
            raise UnitError(
                f"{problem}; name it with names={{'{variable.varID}': '{quantity} [deg]'}}, say"
            )
    except UnitError as error:
        raise SchemaError(f"variable {variable.varID} ({variable.name})", [str(error)]) from None
    sense = -1.0 if has_opposite_sign(variable.sign, lookup(quantity).sign) else 1.0
    return sense / to_si, -offset / to_si


def has_opposite_sign(sign: str, own: str) -> bool:
    """Whether a sign convention is the opposite of that of the vocabulary; what is not known counts
    as the same.
    """
    theirs, ours = _letters(sign), _letters(own)
    return any((theirs in a and ours in b) or (theirs in b and ours in a) for a, b in _OPPOSITES)
