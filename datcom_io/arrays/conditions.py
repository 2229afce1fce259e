"""Which flight condition, ground height and deflection a page belongs to.

Headings repeat: a flight condition may occur twice, the dynamic page comes again after every ground
page, and with a flap on the tail in ground effect the block of heights comes once per deflection
under equal headings.  So pages are numbered by their order among pages of the same heading, and the
printed values only name the group.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from datcom_io.cells import OK, OVERFLOW
from datcom_io.decks.deck import Deck
from datcom_io.printout.content import Page, PrintedCase
from flightmech.units import FOOT, INCH, POUND_FORCE

_LENGTH = {"FT": FOOT, "IN": INCH, "M": 1.0, "CM": 0.01}
_PRESSURE = {
    "FT": POUND_FORCE / FOOT**2,
    "IN": POUND_FORCE / INCH**2,
    "M": 1.0,
    "CM": 1.0,
}  # CM prints N/m2 under N/CM**2
_ENGLISH = ("FT", "IN")
_HALF_UNIT = {
    "mach": 0.0005,
    "h": 0.005,
    "ground_height": 0.005,
    "flap": 0.0151,
    "reference": 0.0005,
}  # a flap of 0 prints as 0.01


def si_factor(units: str, dim: str) -> float:
    """Return the factor from a printed quantity to SI for a unit of length of the print."""
    length = _LENGTH.get(dim, math.nan)
    factors = {
        "length": length,
        "speed": length,
        "area": length**2,
        "pressure": _PRESSURE.get(dim, math.nan),
        "temperature": 1.0 / 1.8 if dim in _ENGLISH else 1.0,
        "reynolds": 1.0 / FOOT
        if dim in _ENGLISH
        else 1.0,  # per foot with DIM IN too, per metre with DIM CM
        "1": 1.0,
    }
    return factors[units]


class PrintedCondition(NamedTuple):
    """A flight condition in SI; NaN where the print has nothing. [1, m, m s-1, Pa, K, 1/m]"""

    mach: float
    h: float
    V: float
    p_static: float
    temperature: float
    reynolds_per_m: float


class PagePlace(NamedTuple):
    """Place of a page: index of the condition, height over ground [m, infinite in free air],
    deflection [deg].
    """

    condition: int
    ground_height: float
    delta: float


Group = tuple[str, ...]


def printed_condition(page: Page) -> Group:
    """Return Mach number, altitude and velocity as printed: the part of the line that is right on
    every kind of page.
    """
    return tuple(page.conditions.text(0, i) for i in range(3)) if page.conditions else ()


def nearest_exact(value: float, exact: Sequence[float], half_unit: float) -> float:
    """Return the exact value that prints as `value`, or `value` itself when there is none."""
    return next((x for x in exact if abs(x - value) <= half_unit * (1.0 + 1e-6)), value)


def control_surface(deck: Deck) -> str:
    """Return ``tail`` when the program puts a SYMFLP on the horizontal tail, else ``wing``.

    The deck does not state it: with a wing and a horizontal tail the device is the tail's.
    """
    return "tail" if {"WGPLNF", "HTPLNF"} <= deck.namelists.keys() else "wing"


def order_conditions(case: PrintedCase) -> tuple[list[PrintedCondition], dict[int, PagePlace]]:
    """Return the flight conditions of a case in order, and the place of each page by its first
    line.

    Dynamic and auxiliary pages that repeat an earlier one, and pages without flight condition, have
    no place.  Ailerons and spoilers have no part in the ground effect, but the heights come again
    for each of their deflections: the first page has the place, the later ones hold the ground
    effect of those before.
    """
    occurrences = _occurrences(case)
    keys: dict[int, tuple[Group, int]] = {}  # page to printed condition and its occurrence
    deltas: dict[int, float] = {}
    for pages in _groups(case).values():
        group = printed_condition(pages[0])
        times = occurrences.get(group, 1)
        each = max(1, len(pages) // times)  # pages of this heading within one condition
        for i, page in enumerate(pages):
            if i % each and (
                page.kind in ("dynamic", "auxiliary")
                or (page.kind == "static" and "ASYFLP" in case.deck.namelists)
            ):
                continue
            if page.kind == "static" and math.isfinite(page.ground_height):
                keys[page.first], deltas[page.first] = (
                    (group, i // each),
                    _ground_delta(case.deck, page, i % each, each),
                )
            else:
                keys[page.first] = (group, i // each)
    order = {key: i for i, key in enumerate(dict.fromkeys(keys[first] for first in sorted(keys)))}
    heights = [h * _LENGTH[case.deck.dim] for h in case.deck.schedule("GRNDEF", "GRDHT", "NGH")]
    spots = {
        page.first: PagePlace(
            order[keys[page.first]], _ground_height(page, heights), deltas.get(page.first, 0.0)
        )
        for page in case.pages
        if page.first in keys
    }
    return _conditions(case, spots, len(order)), spots


def _groups(case: PrintedCase) -> dict[tuple, list[Page]]:
    """Return pages with tables or values by heading, in order."""
    groups: dict[tuple, list[Page]] = defaultdict(list)
    for page in case.pages:
        if page.conditions is not None and page.printed:
            flap = "" if math.isnan(page.flap) else str(page.flap)
            key = (
                page.kind,
                page.printed[0].name,
                page.configuration,
                page.power,
                page.ground_height,
                flap,
                *printed_condition(page),
            )
            groups[key].append(page)
    return groups


def _occurrences(case: PrintedCase) -> dict[Group, int]:
    """Return how often each printed condition occurs, counted on the free-air pages of one
    configuration.
    """
    times: dict[Group, int] = {}
    for pages in _groups(case).values():
        if pages[0].kind == "static" and math.isinf(pages[0].ground_height):
            group = printed_condition(pages[0])
            times[group] = max(times.get(group, 0), len(pages))
    return times


def _ground_delta(deck: Deck, page: Page, ordinal: int, each: int) -> float:
    """Return the deflection of a ground page: printed for wing flaps, identified by its ordinal for
    tail flaps. [deg]
    """
    deltas = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    if not math.isnan(page.flap):
        return nearest_exact(page.flap, deltas, _HALF_UNIT["flap"])
    return deltas[ordinal] if each == len(deltas) else 0.0


def _ground_height(page: Page, heights: Sequence[float]) -> float:
    """Return the height over ground; printed in feet whatever card DIM states. [m]"""
    return nearest_exact(page.ground_height * FOOT, heights, _HALF_UNIT["ground_height"] * FOOT)


def _conditions(
    case: PrintedCase, spots: dict[int, PagePlace], count: int
) -> list[PrintedCondition]:
    """Return the conditions in SI, exact Mach number and altitude taken from the deck where they
    print as the listing shows.
    """
    pages: dict[int, Page] = {}  # the first static page of each condition, or its first page
    for page in sorted(
        (page for page in case.pages if page.first in spots), key=lambda page: page.kind != "static"
    ):
        pages.setdefault(spots[page.first].condition, page)
    schedule = case.deck.conditions()
    exact = schedule if len(schedule) == count else [(math.nan, math.nan)] * count
    return [_condition(pages[i], exact[i]) for i in range(count)]


def _condition(page: Page, exact: tuple[float, float]) -> PrintedCondition:
    assert page.conditions is not None
    values = []
    wrong = (
        page.kind == "high-lift" and page.dim != "FT"
    )  # pressure, temperature and Reynolds number of control pages
    for column, name in enumerate(PrintedCondition._fields):
        if wrong and name in ("p_static", "temperature", "reynolds_per_m"):
            values.append(math.nan)
            continue
        value = (
            float(page.conditions.values[0, column])
            if page.conditions.flags[0, column] == OK
            else math.nan
        )
        if name in ("mach", "h"):
            overflown = page.conditions.flags[0, column] == OVERFLOW
            value = (
                exact[column]
                if overflown
                else nearest_exact(value, [exact[column]], _HALF_UNIT[name])
            )
        values.append(value * si_factor(page.conditions.columns[column].units, page.dim))
    return PrintedCondition(*values)


def reference_quantities(case: PrintedCase) -> dict[str, float]:
    """Return reference area, lengths and moment centre, in SI, from the pages.

    The page is right where the deck is silent: the program computes what OPTINS does not give.  The
    deck's digits are used where they print as the page shows.
    """
    deck = case.deck
    given = {
        "S": deck.value("OPTINS", "SREF"),
        "cbar": deck.value("OPTINS", "CBARR"),
        "b": deck.value("OPTINS", "BLREF"),
        "x_cg": deck.value("SYNTHS", "XCG"),
        "z_cg": deck.value("SYNTHS", "ZCG"),
    }
    found: dict[str, float] = {}
    page, table = next(
        (
            (page, page.conditions)
            for page in case.pages
            if page.kind == "static" and page.conditions is not None
        ),
        (None, None),
    )
    if page is None or table is None:
        return found
    for k, column in enumerate(table.columns):
        if column.quantity in given:
            exact, value = given[column.quantity], float(table.values[0, k])
            if exact is not None:
                value = (
                    exact
                    if table.flags[0, k] == OVERFLOW
                    else nearest_exact(value, [exact], _HALF_UNIT["reference"])
                )
            found[column.quantity] = value * si_factor(column.units, page.dim)
    return found


_PARTS = (
    ("VENTRAL FIN", "fin"),
    ("TWIN VERTICAL PANEL", "panels"),
    ("VERTICAL TAIL", "vertical"),
    ("HORIZONTAL TAIL", "horizontal"),
    ("WING", "wing"),
    ("BODY", "body"),
)

LOW_ASPECT_RATIO = "LOW ASPECT RATIO WINGS AND WING-BODY COMBINATIONS"


def parse_configuration(configuration: str) -> frozenset[str]:
    """Return the parts named in a configuration line: ``body wing horizontal vertical fin panels``.

    Examples
    --------
    >>> sorted(parts("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"))
    ['body', 'horizontal', 'vertical', 'wing']
    """
    if configuration == LOW_ASPECT_RATIO:
        return frozenset(("body", "wing"))
    return frozenset(part for words, part in _PARTS if words in configuration)


def printed_name(made_of: frozenset[str]) -> str:
    """Return the configuration line that the program prints for parts.

    Examples
    --------
    >>> printed_name(frozenset(("body", "wing", "vertical", "horizontal")))
    'WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL'
    """
    if len(made_of) == 1:
        alone = {"body": "DATCOM BODY ALONE", "wing": "WING ALONE"}
        return next(alone.get(part, words) for words, part in _PARTS if part in made_of)
    order = [
        ("wing", "WING"),
        ("body", "BODY"),
        ("horizontal", "HORIZONTAL TAIL"),
        ("vertical", "VERTICAL TAIL"),
    ]
    if made_of == {"body", "wing", "horizontal", "vertical"}:
        order[2:] = order[
            :1:-1
        ]  # the vertical tail stands first on the page of the plain aeroplane, and only there
    order += [("fin", "VENTRAL FIN"), ("panels", "TWIN VERTICAL PANEL")]
    return "-".join(words for part, words in order if part in made_of)
