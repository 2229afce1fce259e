"""Tests of lift and roll damping that do not fit the wing, and of angles that do not rise."""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.reading.attached_flow import estimate_wing_slopes

LISTINGS = Path(__file__).parents[1] / "listings"
CLEAN = Path(__file__).parents[3] / "data" / "c182" / "datcom" / "clean.out"
STATIC = {"CD", "CL", "CM", "CN", "CA", "XCP", "CLA", "CMA"}


@pytest.fixture(scope="module")
def wings():
    return datcom_io.read(LISTINGS / "lift_of_wings.out")


def suspects(case) -> dict[str, set[str]]:
    """Return the suspect columns by table."""
    cells = case.cells()
    cells = cells[cells["flag"] == "suspect"]
    return {name: set(part["column"]) for name, part in cells.groupby("table")}


def texts(case, words: str) -> list[str]:
    return [message.text for message in case.messages if words in message.text]


def test_angles_that_fall_make_all_tables_suspect(wings) -> None:
    cells = wings[0].cells()
    cells = cells[cells["table"].isin(["static", "dynamic"]) & ~cells["column"].eq("ALPHA")]
    assert set(cells["flag"]) <= {"suspect", "NDM", "blank"}
    assert (cells["flag"] == "suspect").sum() > 40
    (text,) = texts(wings[0], "do not rise")
    assert "(12 is followed by 4)" in text


def test_a_cranked_wing_without_its_lift(wings) -> None:
    found = suspects(wings[1])
    assert found["static"] == STATIC
    (text,) = texts(wings[1], "does not fit the planform")
    assert "it changes by 1.73 per radian" in text
    assert "about 5.23" in text


def test_roll_damping_by_a_wrong_angle_of_zero_lift(wings) -> None:
    assert suspects(wings[2]) == {"dynamic": {"CLP", "CYP", "CNP"}}
    (text,) = texts(wings[2], "does not fit the planform")
    assert "-1.38 per radian" in text
    assert "leave out the angles of attack behind the stall" in text


def test_lift_and_roll_damping_of_sound_listings() -> None:
    assert not texts(datcom_io.read(CLEAN)[0], "does not fit the planform")


def test_slopes_of_an_elliptic_limit() -> None:
    """A wing of large aspect ratio tends to the slopes 2 pi and -2 pi / 6 of its sections."""
    deck = datcom_io.read_deck(
        [" $WGPLNF CHRDR=1.0,CHRDTP=1.0,SSPN=5000.0,SAVSI=0.0,CHSTAT=0.25,TYPE=1.0$"]
    )[0]
    slopes = estimate_wing_slopes(deck, 0.0)
    assert slopes is not None
    assert slopes.lift == pytest.approx(2.0 * np.pi, rel=1e-3)
    assert slopes.roll == pytest.approx(-2.0 * np.pi / 6.0, rel=1e-3)
    # Both compress by Prandtl and Glauert in that limit.
    fast = estimate_wing_slopes(deck, 0.6)
    assert fast is not None
    assert fast.lift / slopes.lift == pytest.approx(1.25, rel=1e-3)
