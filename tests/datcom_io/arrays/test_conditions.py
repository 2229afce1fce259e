"""Every page of the corpus stands at its flight condition, whatever the loops, ground heights and
deflections around it.
"""

from pathlib import Path

import pytest

import datcom_io
from datcom_io.arrays.conditions import order_conditions

CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
FILES = sorted(CORPUS.glob("*/*.out"))
pytestmark = pytest.mark.skipif(not FILES, reason="the corpus ../shared/data/datcom is not there")
PLACED = ("static", "dynamic", "high-lift", "auxiliary")


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_pages_stand_at_the_conditions_of_the_cards(path):
    for case in datcom_io.read(path):
        conditions, spots = order_conditions(case)
        schedule = case.deck.conditions()
        if conditions and schedule:
            assert len(conditions) == len(schedule)
        for page in case.pages:
            if page.first in spots:
                at = conditions[spots[page.first].condition]
                assert at.mach == pytest.approx(
                    page.condition("mach"), abs=0.00051, nan_ok=True
                )  # three decimals are printed
        left = [
            page
            for page in case.pages
            if page.kind in PLACED and page.printed and page.first not in spots
        ]
        assert {page.kind for page in left} <= {"dynamic"}, (
            "only the dynamic page is printed again after every ground page"
        )
        assert not left or case.deck.schedule("GRNDEF", "GRDHT", "NGH")


def test_two_dimensions_of_conditions_stepped_three_ways():
    cases = datcom_io.read(CORPUS / "loop_modes" / "loop_modes.out")
    orders = [
        [(round(at.mach, 3), round(at.h, 2)) for at in order_conditions(case)[0]] for case in cases
    ]
    assert [len(order) for order in orders] == [3, 6, 6]
    machs, heights = (
        [list(dict.fromkeys(pair[k] for pair in order)) for order in orders] for k in range(2)
    )
    assert orders[0] == list(zip(machs[0], heights[0]))
    assert orders[1] == [(mach, height) for height in heights[1] for mach in machs[1]]
    assert orders[2] == [(mach, height) for mach in machs[2] for height in heights[2]]


def test_a_condition_that_comes_twice_is_two_with_all_of_its_pages():
    """Mach numbers with one altitude each: the list of conditions of the shipped elevator, its
    first one requested twice.
    """
    lines = (
        (Path(__file__).parents[3] / "data" / "t37" / "datcom" / "t37_elevator.out")
        .read_text()
        .split("\n")
    )
    starts = [k for k, line in enumerate(lines) if line.startswith("1") and "AUTOMATED" in line]
    static = [k for k in starts if "ANGLE OF ATTACK" in lines[k + 1]]
    case = datcom_io.read([*lines[: static[1]], *lines[static[0] :]])[0]
    conditions, spots = order_conditions(case)
    assert [at.mach for at in conditions][:2] == [0.15, 0.15]
    assert len(conditions) == 6
    kinds = [
        [
            page.kind
            for page in case.pages
            if page.first in spots and spots[page.first].condition == k
        ]
        for k in range(6)
    ]
    assert kinds == [["static", "dynamic", "high-lift"]] * 6
