"""Reference quantities of a print of Missile DATCOM: of the pages, with the digits of the cards."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from aerodb.estimators.coefficient_set import EstimateReference
from flightmech.errors import ParseError
from flightmech.units import to_si

# Quantity of a page and its variable in $REFQ.
_CARDS = {
    "REF AREA": "SREF",
    "REF LENGTH": "LREF",
    "LAT REF LENGTH": "LATREF",
    "MOMENT CENTER": "XCG",
}
_REFQ = re.compile(r"^[ \t]*(?:\d+\s+)?[$&]REFQ\b(.*?)(?:[$&]|\Z)", re.DOTALL | re.MULTILINE)
_CARD_NUMBER = re.compile(r"^\s{0,6}\d+\s(?=\s)", re.MULTILINE)
_ASSIGNMENT = re.compile(r"\b([A-Z]+)\s*=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[ED][-+]?\d+)?)")
_UNITS = {"M": "m", "FT": "ft", "IN": "in", "CM": "cm"}
_ROUNDING = 0.005  # largest share of a quantity that the rounding of its print may be


class RoundedNumber(NamedTuple):
    """A printed number with its unit."""

    digits: str
    unit: str

    @property
    def value(self) -> float:
        """Return the number."""
        return float(self.digits)

    @property
    def rounding(self) -> float:
        """Return half a unit of the last digit."""
        mantissa, _, exponent = self.digits.upper().partition("E")
        decimals = len(mantissa.partition(".")[2])
        return float(0.5 * 10.0 ** (int(exponent or 0) - decimals))


RefqCards = dict[str, set[float]]


def make_missile_reference(
    file: Path, headers: Sequence[Mapping[str, RoundedNumber]], lines: Sequence[str]
) -> tuple[EstimateReference | None, str]:
    """Return the reference quantities in metres and a remark.

    They are None, with the reason as remark, if the print has too few digits and no card the
    quantity.

    Raises
    ------
    ParseError
        The pages have different reference quantities.
    """
    first = headers[0]
    for other in headers[1:]:
        for name in _CARDS:
            if name in other and name in first and other[name] != first[name]:
                raise ParseError(
                    str(file),
                    0,
                    f"{name} {first[name].digits} and {other[name].digits}",
                    "one set of reference quantities in a print; split the cases",
                )
    cards = _read_cards(lines)
    values = {}
    for name, card in _CARDS.items():
        if name not in first:
            raise ParseError(str(file), 0, f"no {name}", "the header of a page of aerodynamics")
        printed = first[name]
        unit = _unit(file, name, printed.unit)
        value = printed.value
        numbers = sorted(cards.get(card, set()))
        if name == "LAT REF LENGTH" and not numbers:
            numbers = sorted(cards.get("LREF", set()))  # the default of the program
        # The print is rounded; a card that rounds to it has all digits.
        exact = [n for n in numbers if abs(n - value) <= 1.001 * printed.rounding]
        if len(exact) == 1:
            value = exact[0]
        elif name != "MOMENT CENTER" and printed.rounding > _ROUNDING * abs(value):
            return None, (
                f"{name} is printed as {printed.digits} {printed.unit}, and no card {card} has "
                f"more digits: give the reference quantities"
            )
        power = "m2" if name == "REF AREA" else "m"
        values[name] = float(to_si(value, unit, power))
    # The print has no height of the moment centre; one card ZCG states it.
    z = cards.get("ZCG", {0.0})
    height = 0.0
    if len(z) == 1:
        height = float(to_si(next(iter(z)), _unit(file, "ZCG", first["MOMENT CENTER"].unit), "m"))
    S, cbar, b, x = (values[name] for name in _CARDS)
    return EstimateReference(S, cbar, b, x=x, y=0.0, z=height), ""


def _unit(file: Path, name: str, text: str) -> str:
    base, _, power = text.partition("**")
    if base not in _UNITS:
        raise ParseError(str(file), 0, f"{name} in {text!r}", f"a unit of {', '.join(_UNITS)}")
    return _UNITS[base] + power


def _read_cards(lines: Sequence[str]) -> RefqCards:
    """Return the values of each variable in the cards $REFQ of all cases."""
    cards: RefqCards = {}
    for block in _refq_blocks(lines):
        for name, digits in _ASSIGNMENT.findall(block.upper()):
            cards.setdefault(name, set()).add(float(digits.replace("D", "E")))
    return cards


def _refq_blocks(lines: Sequence[str]) -> Iterator[str]:
    text = _CARD_NUMBER.sub("", "\n".join(lines))
    for match in _REFQ.finditer(text):
        yield match[1]
