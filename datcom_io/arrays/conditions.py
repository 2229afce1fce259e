"""Flight condition, ground height and deflection of each page.

Headings repeat.  A flight condition may occur twice, and the dynamic page comes again after every
ground page.  With a flap on the tail in ground effect, the block of heights comes once per
deflection under equal headings.  Pages are therefore numbered by their order among the pages of the
same heading; the printed values only name the group.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from datcom_io.cells import OK, OVERFLOW
from datcom_io.decks.deck import Deck
from datcom_io.printout.content import Page, PrintedCase
from datcom_io.printout.tables import PrintedTable
from flightmech.units import FOOT, INCH, POUND_FORCE

LENGTH_UNITS = {"FT": FOOT, "IN": INCH, "M": 1.0, "CM": 0.01}
# With DIM CM the program prints N/m2 under the label N/CM**2.
_PRESSURE = {
    "FT": POUND_FORCE / FOOT**2,
    "IN": POUND_FORCE / INCH**2,
    "M": 1.0,
    "CM": 1.0,
}
_ENGLISH = ("FT", "IN")
# Half of the last printed digit.  A flap of 0 deg prints as 0.01 deg.
_HALF_UNIT = {
    "mach": 0.0005,
    "h": 0.005,
    "ground_height": 0.005,
    "flap": 0.0151,
    "reference": 0.0005,
}

_SAME = 1e-5  # relative difference of the single precision of the program


def si_factor(units: str, dim: str) -> float:
    """Return the factor from a printed quantity to SI for the unit of length of the print."""
    is_english = dim in _ENGLISH
    length = LENGTH_UNITS.get(dim, math.nan)
    factors = {
        "length": length,
        "speed": length,
        "area": length**2,
        "pressure": _PRESSURE.get(dim, math.nan),
        "temperature": 1.0 / 1.8 if is_english else 1.0,
        # The Reynolds number is per foot with DIM IN too, and per metre with DIM CM.
        "reynolds": 1.0 / FOOT if is_english else 1.0,
        "1": 1.0,
    }
    return factors[units]


class PrintedCondition(NamedTuple):
    """A flight condition in SI; NaN where the print has no number. [1, m, m s-1, Pa, K, 1/m]"""

    mach: float
    h: float
    V: float
    p_static: float
    temperature: float
    reynolds_per_m: float


class PagePlace(NamedTuple):
    """Place of a page among the pages of its case.

    Index of the condition, height over ground [m, infinite in free air], deflection [deg].
    """

    condition: int
    ground_height: float
    delta: float


Group = tuple[str, ...]
"""Mach number, altitude and velocity as printed."""


def printed_condition(page: Page) -> Group:
    """Return Mach number, altitude and velocity as printed.

    This part of the flight-condition line is right on every kind of page.
    """
    if not page.conditions:
        return ()
    return tuple(page.conditions.text(0, i) for i in range(3))


def nearest_exact(value: float, exact: Sequence[float], half_unit: float) -> float:
    """Return the exact value that prints as `value`, or `value` itself when there is none."""
    for candidate in exact:
        if abs(candidate - value) <= half_unit * (1.0 + 1e-6):
            return candidate
    return value


def control_surface(deck: Deck) -> str:
    """Return ``tail`` when the program puts a SYMFLP on the horizontal tail, else ``wing``.

    The deck does not state it: with a wing and a horizontal tail the device is the tail's.
    """
    if {"WGPLNF", "HTPLNF"} <= deck.namelists.keys():
        return "tail"
    return "wing"


def order_conditions(case: PrintedCase) -> tuple[list[PrintedCondition], dict[int, PagePlace]]:
    """Return the flight conditions of a case in order, and the place of each page by first line.

    Dynamic and auxiliary pages that repeat an earlier one, and pages without flight condition, do
    not have a place.  Ailerons and spoilers do not act on the ground effect, but the heights come
    again for each of their deflections.  There the first page has the place; the later ones hold
    the ground effect of the deflections before.
    """
    groups = _pages_by_heading(case)
    occurrences = _count_occurrences(groups)
    keys: dict[int, tuple[Group, int]] = {}  # page to printed condition and its occurrence
    deltas: dict[int, float] = {}
    for pages in groups.values():
        condition = printed_condition(pages[0])
        # Number of pages with this heading within one flight condition.
        per_condition = max(1, len(pages) // occurrences.get(condition, 1))
        for i, page in enumerate(pages):
            occurrence, ordinal = divmod(i, per_condition)
            if ordinal and _repeats_first_page(case, page):
                continue
            keys[page.first] = (condition, occurrence)
            if page.kind == "static" and math.isfinite(page.ground_height):
                delta = _ground_deflection(case.deck, page, ordinal, per_condition)
                deltas[page.first] = delta
    # Conditions are numbered in the order of their first pages.
    order: dict[tuple[Group, int], int] = {}
    for first in sorted(keys):
        order.setdefault(keys[first], len(order))
    unit = LENGTH_UNITS[case.deck.dim]
    heights = [height * unit for height in case.deck.schedule("GRNDEF", "GRDHT", "NGH")]
    spots = {}
    for page in case.pages:
        if page.first in keys:
            spots[page.first] = PagePlace(
                order[keys[page.first]],
                _ground_height(page, heights),
                deltas.get(page.first, 0.0),
            )
    return _make_conditions(case, spots, len(order)), spots


def _repeats_first_page(case: PrintedCase, page: Page) -> bool:
    """Return whether a later page of a heading within one condition repeats the first one."""
    if page.kind == "static":
        return "ASYFLP" in case.deck.namelists
    return page.kind in ("dynamic", "auxiliary")


def _pages_by_heading(case: PrintedCase) -> dict[tuple[Any, ...], list[Page]]:
    """Return pages with tables or values by heading, in order."""
    groups: dict[tuple[Any, ...], list[Page]] = defaultdict(list)
    for page in case.pages:
        if page.conditions is None or not page.printed:
            continue
        # NaN differs from itself, so a page without flap gets an empty text.
        flap = ""
        if not math.isnan(page.flap):
            flap = str(page.flap)
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


def _count_occurrences(groups: dict[tuple[Any, ...], list[Page]]) -> dict[Group, int]:
    """Return how often each printed condition occurs.

    The free-air pages of one configuration are counted.  Some regimes print no static page; the
    pages of the control device are counted there, one for each condition.
    """
    static: dict[Group, int] = {}
    device: dict[Group, int] = {}
    for pages in groups.values():
        condition, count = printed_condition(pages[0]), len(pages)
        if pages[0].kind == "static" and math.isinf(pages[0].ground_height):
            static[condition] = max(static.get(condition, 0), count)
        elif pages[0].kind == "high-lift":
            device[condition] = max(device.get(condition, 0), count)
    return {**device, **static}


def _ground_deflection(deck: Deck, page: Page, ordinal: int, per_condition: int) -> float:
    """Return the deflection of a ground page. [deg]

    It is printed for wing flaps; for tail flaps the ordinal of the page identifies it.
    """
    deltas = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    if not math.isnan(page.flap):
        return nearest_exact(page.flap, deltas, _HALF_UNIT["flap"])
    if per_condition == len(deltas):
        return deltas[ordinal]
    return 0.0


def _ground_height(page: Page, heights: Sequence[float]) -> float:
    """Return the height over ground; printed in feet whatever card DIM states. [m]"""
    return nearest_exact(page.ground_height * FOOT, heights, _HALF_UNIT["ground_height"] * FOOT)


def _make_conditions(
    case: PrintedCase, spots: dict[int, PagePlace], count: int
) -> list[PrintedCondition]:
    """Return the conditions in SI.

    Mach number and altitude have the digits of the deck where they print as the listing shows.
    """
    # The first static page of each condition, or else its first page.
    pages: dict[int, Page] = {}
    placed = [page for page in case.pages if page.first in spots]
    for page in sorted(placed, key=lambda page: page.kind != "static"):
        pages.setdefault(spots[page.first].condition, page)
    exact = case.deck.conditions()
    if len(exact) != count:
        exact = [(math.nan, math.nan)] * count
    return [_make_condition(pages[i], exact[i]) for i in range(count)]


def _make_condition(page: Page, exact: tuple[float, float]) -> PrintedCondition:
    """Return the condition of a page; `exact` is Mach number and altitude of the deck."""
    assert page.conditions is not None
    # Control pages convert pressure, temperature and Reynolds number the wrong way unless in feet.
    wrong: tuple[str, ...] = ()
    if page.kind == "high-lift" and page.dim != "FT":
        wrong = ("p_static", "temperature", "reynolds_per_m")
    values = []
    for k, name in enumerate(PrintedCondition._fields):
        if name in wrong:
            values.append(math.nan)
            continue
        flag = page.conditions.flags[0, k]
        value = math.nan
        if flag == OK:
            value = float(page.conditions.values[0, k])
        if name in ("mach", "h"):
            if flag == OVERFLOW:
                value = exact[k]
            else:
                value = nearest_exact(value, [exact[k]], _HALF_UNIT[name])
        values.append(value * si_factor(page.conditions.columns[k].units, page.dim))
    return PrintedCondition(*values)


# Quantity of the flight-condition line to the namelist variable that gives it.
_REFERENCE_CARDS = {
    "S": ("OPTINS", "SREF"),
    "cbar": ("OPTINS", "CBARR"),
    "b": ("OPTINS", "BLREF"),
    "x_cg": ("SYNTHS", "XCG"),
    "z_cg": ("SYNTHS", "ZCG"),
}


def reference_quantities(case: PrintedCase) -> dict[str, float]:
    """Return reference area, lengths and moment centre, in SI, from the pages.

    The program computes what OPTINS does not give, so the page is right where the deck is silent.
    The digits of the deck are used where they print as the page shows.
    """
    quantities: dict[str, float] = {}
    static = _first_static_line(case)
    if static is None:
        return quantities
    dim, table = static
    for k, column in enumerate(table.columns):
        if column.quantity not in _REFERENCE_CARDS:
            continue
        exact = case.deck.value(*_REFERENCE_CARDS[column.quantity])
        value = float(table.values[0, k])
        if exact is not None:
            if table.flags[0, k] == OVERFLOW:
                value = exact
            else:
                value = nearest_exact(value, [exact], _HALF_UNIT["reference"])
        quantities[column.quantity] = value * si_factor(column.units, dim)
    return quantities


def reference_contradictions(case: PrintedCase) -> Iterator[tuple[int, str]]:
    """Yield line and text of reference quantities that differ on the page and the input cards."""
    static = _first_static_line(case)
    # A scale factor multiplies some cards and not others.
    if static is None or case.deck.value("SYNTHS", "SCALE") not in (None, 1.0):
        return
    dim, table = static
    if dim != case.deck.dim:
        text = f"the page is in {dim} and card DIM of the case is {case.deck.dim}"
        yield table.lines[0], f"{text}: page and cards are of different runs"
    for k, column in enumerate(table.columns):
        cards = _REFERENCE_CARDS.get(column.quantity)
        if cards is None or table.flags[0, k] != OK:
            continue
        exact = case.deck.value(*cards)
        if exact is None:
            continue
        value = float(table.values[0, k])
        if abs(value - exact) > _HALF_UNIT["reference"] * (1.0 + 1e-6) + _SAME * abs(exact):
            text = f"{cards[1]} is {exact:g} on the input cards and {value:g} on the page: the "
            yield (
                table.lines[0],
                f"{text}page is used; run the deck again, and check which is right",
            )


def _first_static_line(case: PrintedCase) -> tuple[str, PrintedTable] | None:
    """Return unit of length and flight-condition line of the first static page that has one."""
    for page in case.pages:
        if page.kind == "static" and page.conditions is not None:
            return page.dim, page.conditions
    return None


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
    >>> sorted(parse_configuration("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"))
    ['body', 'horizontal', 'vertical', 'wing']
    """
    if configuration == LOW_ASPECT_RATIO:
        return frozenset(("body", "wing"))
    return frozenset(part for name, part in _PARTS if name in configuration)


_ALONE = {"body": "DATCOM BODY ALONE", "wing": "WING ALONE"}
# Order of the parts on a page, and the one page where the vertical tail stands first.
_ORDER = ("wing", "body", "horizontal", "vertical", "fin", "panels")
_PLAIN_AEROPLANE = frozenset(("body", "wing", "horizontal", "vertical"))
_PLAIN_ORDER = ("wing", "body", "vertical", "horizontal")


def printed_name(made_of: frozenset[str]) -> str:
    """Return the configuration line that the program prints for parts.

    Examples
    --------
    >>> printed_name(frozenset(("body", "wing", "vertical", "horizontal")))
    'WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL'
    """
    names = {part: name for name, part in _PARTS}
    if len(made_of) == 1:
        (part,) = made_of
        return _ALONE.get(part, names[part])
    order: tuple[str, ...] = _ORDER
    if made_of == _PLAIN_AEROPLANE:
        order = _PLAIN_ORDER
    return "-".join(names[part] for part in order if part in made_of)
