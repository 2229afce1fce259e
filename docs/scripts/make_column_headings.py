"""Page ``column-headings.md``, the headings of recordings that are recognised. The site has the
page (`make_site`); ``python docs/scripts/make_column_headings.py`` prints it.

The words come from `aeromatch.drafting.name_map.heading_words`, quantities and units from
`flightmech.names`.
"""

from __future__ import annotations

from aeromatch.drafting.name_map.columns import guess_quantity
from aeromatch.drafting.name_map.heading_words import HEADING_WORDS
from flightmech.names import lookup

HEAD = """# Recognised column headings

`aeromatch init` proposes a quantity for each column of a recording. It compares the heading with
the words of this table, which are those of the program. Canonical names and
symbols of the [nomenclature](nomenclature.md) are recognised too.

- Upper and lower case, spaces, dots, hyphens and underscores do not matter.
- A unit may follow in brackets or as last word: `Roll Rate (deg/s)`, `Elevator_Pos_deg`.
- Words such as `pos`, `sensor`, `raw`, `adc`, `ins` are ignored.
- `left`, `right`, `1`, `2` select the engine, or the side of an aileron or flap.
- A sense such as `TEU`, `ANL`, `LWD` that is opposite to the positive sense gives `sign = -1`.
- A unit of another quantity rejects the proposal. Without a unit, the size of the values decides.

A heading that is not recognised stays out of the proposed map, and the map lists it. Add a line by
hand: [name maps](../explanation/flight-test/name-maps.md).

| quantity | meaning | SI unit | headings |
| --- | --- | --- | --- |
"""


def quantity_of(word: str) -> str:
    """Return the canonical name that is proposed for a heading, empty without one."""
    guess = guess_quantity(word)
    return guess.name if guess else ""


def page() -> str:
    """Return the page."""
    lines = []
    for name, words in HEADING_WORDS.items():
        # "engine." stands for the number of an engine, of which every item has the same quantities
        symbol = name.replace("engine.", "engine1.")
        quantity = lookup(symbol)
        # A canonical name among the words means its own quantity, such as nz.
        shown = ", ".join(word for word in words.split() if quantity_of(word) == symbol)
        lines.append(f"| `{symbol}` | {quantity.long_name} | {quantity.units} | {shown} |\n")
    return HEAD + "".join(lines)


if __name__ == "__main__":
    print(page(), end="")
