"""Tests of the evidence that a device on the tail is the flap of the wing."""

import pytest

from datcom_io.decks.deck_file import read_deck
from datcom_io.decks.device_fit import (
    IS_FLAP,
    MAY_BE_FLAP,
    advise_on_misfit,
    describe_misfit,
    weigh_device_on_tail,
)

# A light aeroplane: the body is 0.8 m from the axis at the wing and 0.15 m at the tail.
AEROPLANE = """\
 $WGPLNF CHRDR=1.95,CHRDTP=1.05,SSPN=5.9,SSPNE=5.1,SAVSI=3.0,TYPE=1.0$
 $HTPLNF CHRDR=1.05,CHRDTP=0.65,SSPN=2.3,SSPNE=2.15,SAVSI=9.0,TYPE=1.0$
"""
WING = AEROPLANE.splitlines()[0]


def weigh(inner: float, outer: float, chord_in: float, chord_out: float, planforms=AEROPLANE):
    device = f" $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=-20.0,20.0,SPANFI={inner},SPANFO={outer},"
    device += f"CHRDFI={chord_in},CHRDFO={chord_out}$"
    (deck,) = read_deck([*planforms.splitlines(), device])
    return weigh_device_on_tail(deck)


@pytest.mark.parametrize(
    ("inner", "outer", "chord_in", "chord_out"),
    [
        (0.15, 2.2, 0.40, 0.27),  # from the body to the tip
        (0.30, 1.9, 0.15, 0.11),  # a small one, which the body at the wing would hide
        (0.0, 2.3, 0.30, 0.30),
        (0.70, 1.2, 0.10, 0.10),  # inside the body at the wing
    ],
)
def test_an_elevator_is_not_doubted(inner, outer, chord_in, chord_out) -> None:
    assert weigh(inner, outer, chord_in, chord_out).weight == 0


@pytest.mark.parametrize(
    ("inner", "outer", "chord_in", "chord_out", "word"),
    [
        # 20 % of the chord of the wing, 1.828 m at the body and 1.614 m at 2.2 m
        (0.82, 2.2, 0.366, 0.323, "29% of that of the tail from the body there"),
        (0.82, 1.6, 0.366, 0.341, "SPANFO=1.6 is 70% of the semispan of the tail"),
        (0.82, 2.2, 0.090, 0.080, "its chord is 12% of that of the tail"),
        (0.82, 2.29, 0.366, 0.320, "20% of that of the wing at both ends"),
    ],
)
def test_a_flap_that_begins_where_the_wing_leaves_the_body(
    inner, outer, chord_in, chord_out, word
) -> None:
    doubt = weigh(inner, outer, chord_in, chord_out)
    assert doubt.weight >= IS_FLAP
    assert word in "; ".join(doubt.clauses)


def test_a_short_device_in_the_middle_of_both_is_doubtful() -> None:
    """It begins 3 % of the wing's semispan from the body, and 37 % of the tail's ends it early."""
    narrow = AEROPLANE.replace("SSPNE=5.1", "SSPNE=5.7")
    doubt = weigh(0.3, 1.4, 0.2, 0.2, planforms=narrow)
    assert doubt.weight == MAY_BE_FLAP
    assert doubt.clauses == ("SPANFO=1.4 is 61% of the semispan of the tail",)


def test_without_planforms_nothing_is_known() -> None:
    assert weigh(0.8, 2.2, 0.4, 0.4, planforms="").weight == 0
    assert weigh(0.8, 2.2, 0.0, 0.0).weight == 0


@pytest.mark.parametrize(("planforms", "misfit"), [(AEROPLANE, False), (WING, True)])
def test_halves_of_a_tail_need_the_tail(planforms, misfit) -> None:
    """STYPE=5 without HTPLNF is an aileron with a wrong type: the program prints a moment of 0."""
    (deck,) = read_deck([*planforms.splitlines(), " $ASYFLP STYPE=5.0,NDELTA=1.0$"])
    text = describe_misfit(deck)
    assert bool(text) == misfit
    if misfit:
        assert text.startswith("$ASYFLP: STYPE=5 is a horizontal tail whose halves move")
        assert "STYPE=4.0" in advise_on_misfit(deck)


# The side of the body is 0.5 m from the axis at the wing, and 0.4 m at the tail.
WIDE_BODY = """\
 $WGPLNF CHRDR=2.4,CHRDTP=1.1,SSPN=4.5,SSPNE=4.0,SAVSI=3.0,TYPE=1.0$
 $HTPLNF CHRDR=0.8,CHRDTP=0.6,SSPN=1.9,SSPNE=1.5,SAVSI=9.0,TYPE=1.0$
"""


def test_a_device_that_fits_both_surfaces_is_doubtful() -> None:
    """15 % of the chord of the wing is 45 and 46 % of that of the tail."""
    doubt = weigh(0.5, 1.52, 0.3383, 0.2941, planforms=WIDE_BODY)
    assert doubt.weight == MAY_BE_FLAP
    assert doubt.clauses[0].startswith("it fits the wing as well: from 0% of the semispan outside")
    named = WIDE_BODY + "CASEID Elevator\n"
    assert weigh(0.5, 1.52, 0.3383, 0.2941, planforms=named).weight == 0


def test_a_device_of_the_larger_surface_is_doubtful() -> None:
    """WGPLNF is the canard of such a deck."""
    canard = AEROPLANE.replace("SSPN=2.3,SSPNE=2.15", "SSPN=8.0,SSPNE=7.8")
    doubt = weigh(0.3, 4.0, 0.2, 0.2, planforms=canard)
    assert (doubt.weight, doubt.clauses) == (
        MAY_BE_FLAP,
        ("HTPLNF has a span of 1.4 times WGPLNF: it is the main wing",),
    )
