"""Place of the reference point on the mean chord, from the planform cards."""

from __future__ import annotations

import dataclasses
import warnings

import pytest

import aerodb
import flightmech
from aerodb.prior.reference_quantities import mean_chord_of
from datcom_io.decks.deck import Deck
from flightmech.errors import AeromatchWarning

FILE = """
name = "T-37"
S = 16.908
cbar = 1.66726
b = 10.31
mass = 2900.0
Ixx = 1e4
Iyy = 8e3
Izz = 1.5e4
"""


def deck(planform: dict, synths: dict, dim: str = "M") -> Deck:
    lists = {"WGPLNF": planform, "SYNTHS": synths}
    content = {
        name: {key: [value] for key, value in numbers.items()} for name, numbers in lists.items()
    }
    return Deck(namelists=content, dim=dim)


def test_the_mean_chord_of_a_straight_tapered_wing_has_the_formula_of_textbooks():
    """cbar = 2/3 cr (1 + t + t^2)/(1 + t); the leading edge is that of the station y of cbar."""
    planform = {"CHRDR": 3.0, "CHRDTP": 1.5, "SSPN": 6.0, "SAVSI": 0.0, "CHSTAT": 0.0}
    chord = mean_chord_of(deck(planform, {"XW": 2.0}))
    assert chord.length == pytest.approx(2.0 / 3.0 * 3.0 * 1.75 / 1.5)
    assert chord.leading_edge == pytest.approx(2.0)
    # A quarter chord without sweep: the leading edge recedes with the chord.
    chord = mean_chord_of(deck({**planform, "CHSTAT": 0.25}, {"XW": 2.0}))
    assert chord.leading_edge == pytest.approx(2.0 + 0.25 * (3.0 - chord.length))
    assert mean_chord_of(deck(planform, {"XW": 2.0}, "CM")).length == pytest.approx(
        0.01 * chord.length
    )


def test_a_kink_that_changes_nothing_gives_the_same_chord():
    planform = {"CHRDR": 3.0, "CHRDTP": 1.5, "SSPN": 6.0, "SAVSI": 10.0, "CHSTAT": 0.25}
    straight = mean_chord_of(deck(planform, {"XW": 2.0}))
    kinked = {**planform, "CHRDBP": 2.0, "SSPNOP": 2.0, "SAVSO": 10.0}
    assert mean_chord_of(deck(kinked, {"XW": 2.0})) == pytest.approx(straight)
    swept = mean_chord_of(deck({**kinked, "SAVSO": 30.0}, {"XW": 2.0}))
    assert swept.leading_edge > straight.leading_edge + 0.05


@pytest.mark.parametrize("left_out", ["CHRDTP", "SAVSI", "XW"])
def test_without_all_cards_there_is_no_chord(left_out):
    planform = {"CHRDR": 3.0, "CHRDTP": 1.5, "SSPN": 6.0, "SAVSI": 0.0}
    numbers = {**planform, "XW": 2.0}
    del numbers[left_out]
    synths = {"XW": numbers.pop("XW")} if "XW" in numbers else {}
    assert mean_chord_of(deck(numbers, synths)) is None
    assert mean_chord_of(deck(planform, {"XW": 2.0, "SCALE": 0.5})) is None


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("", "the default, the aircraft file does not give it"),
        ("x_ref_mac = 0.25", "file gives it"),
    ],
)
def test_a_place_that_the_planform_contradicts_is_named(t37, tmp_path, line, words):
    """The cards of the T-37 have the reference point at 0.271 of the mean chord."""
    path = tmp_path / "aircraft.toml"
    path.write_text(FILE.replace("mass", f"{line}\nmass") + "reference = [-3.0114, 0.0, 0.0]\n")
    aircraft = flightmech.read_aircraft(path)
    # 0.25 is more than 0.02 from 0.271, and 0.27 is not.
    with pytest.warns(AeromatchWarning, match=r"x_ref_mac is 0.25 .*lies at 0.2709") as caught:
        aerodb.from_datcom(aircraft, clean=t37["clean"])
    assert any(words in str(item.message) for item in caught)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        aerodb.from_datcom(dataclasses.replace(aircraft, x_ref_mac=0.27), clean=t37["clean"])
    assert not any("x_ref_mac" in str(item.message) for item in caught)
