"""Thin-surface models of DATCOM decks, and their geometry files."""

from pathlib import Path

import numpy as np
import pytest

from aerodb.estimators.vortex_lattice.avl_text import PanelCounts, write_avl
from aerodb.estimators.vortex_lattice.geometry import model_of_decks
from aerodb.estimators.vortex_lattice.sections import STATIONS, read_mean_line
from datcom_io.decks.deck_file import read_deck
from flightmech.errors import SchemaError
from flightmech.units import DEGREE, FOOT

DATA = Path(__file__).parents[3] / "data"
STUDY = DATA / "t37" / "datcom" / "t37_study.inp"
RUDDER = (0.35, 0.0, 1.0)


@pytest.fixture(scope="module")
def t37():
    return model_of_decks([read_deck(STUDY)], RUDDER)


def test_surfaces_are_those_of_the_cards(t37):
    wing, tail, fin = t37.surfaces
    assert (wing.name, tail.name, fin.name) == ("wing", "tail", "fin")
    # Both sides of the trapezium of chords 6.37 and 4.50 ft over 16.915 ft.
    area = 2.0 * np.trapezoid(wing.chord, wing.span)
    assert area == pytest.approx(16.915 * (6.37 + 4.50) * FOOT**2, rel=1e-12)
    # Incidence 1.5 deg at the root, washout 2.5 deg, dihedral 3 deg.
    assert wing.twist[[0, -1]] == pytest.approx(np.array([1.5, -1.0]) * DEGREE)
    assert wing.z[-1] == pytest.approx(16.915 * FOOT * np.tan(3.0 * DEGREE))
    # The quarter chord is not swept: the leading edge moves aft by a quarter of the change.
    assert wing.x[-1] - wing.x[0] == pytest.approx(0.25 * (6.37 - 4.50) * FOOT)
    assert not fin.is_mirrored
    assert fin.y == pytest.approx(0.0)
    area = t37.reference.S
    assert area == pytest.approx(182.0 * FOOT**2)
    assert t37.reference.x == pytest.approx(9.88 * FOOT)


def test_each_device_is_on_its_surface(t37):
    wing, tail, fin = t37.surfaces
    assert [part.control for part in wing.controls] == ["delta_f", "delta_a"]
    assert [part.control for part in tail.controls] == ["delta_e"]
    # The elevator begins with 1.18 ft of the local chord at 0.55 ft.
    local = 4.1 - (4.1 - 2.6) * 0.55 / 6.97
    assert tail.controls[0].chords[0] == pytest.approx(1.18 / local)
    assert fin.controls[0].chords == (0.35, 0.35)
    assert not any("rudder" in remark for remark in t37.remarks)
    without = model_of_decks([read_deck(STUDY)])
    assert any("no rudder" in remark for remark in without.remarks)


def test_several_decks_of_one_aeroplane_give_one_control_each():
    folder = DATA / "t37" / "datcom"
    names = ("t37_elevator.inp", "t37_aileron.inp", "t37_flaps.inp")
    together = model_of_decks([read_deck(folder / name) for name in names])
    found = {part.control for surface in together.surfaces for part in surface.controls}
    assert found == {"delta_e", "delta_a", "delta_f"}


def test_decks_of_two_aeroplanes_are_refused():
    other = DATA / "calibration" / "navion.inp"
    with pytest.raises(SchemaError, match="give decks of one aeroplane"):
        model_of_decks([read_deck(STUDY), read_deck(other)])


def test_a_whole_tail_is_the_elevator_of_a_deck_with_a_hinge():
    model = model_of_decks([read_deck(DATA / "calibration" / "a7a.inp")])
    assert model.surfaces[1].controls[0].chords == (1.0, 1.0)


@pytest.mark.parametrize(
    ("card", "place", "height"),
    [
        ("4 2412", 0.4, 0.02),  # largest camber and its place are the digits
        ("5 23012", 0.15, 0.0184),  # Abbott and von Doenhoff: 1.8 % at 15 %
        ("6 64-410", 0.5, 0.4 * np.log(2.0) / (4.0 * np.pi)),  # mean line a = 1
        ("6 65A007", 0.5, 0.0),
    ],
)
def test_mean_lines(tmp_path, card, place, height):
    text = STUDY.read_text().replace("NACA W 4 2415", f"NACA W {card}")
    deck = tmp_path / "deck.inp"
    deck.write_text(text)
    line, remark = read_mean_line(read_deck(deck)[0], "W")
    assert remark == ""
    assert line.max() == pytest.approx(height, abs=2e-4)
    if height:
        assert STATIONS[line.argmax()] == pytest.approx(place, abs=0.03)


def test_a_section_without_a_formula_is_stated(tmp_path):
    deck = tmp_path / "deck.inp"
    deck.write_text(STUDY.read_text().replace("NACA W 4 2415", "NACA W S 3-30.0-2.5-40.1"))
    line, remark = read_mean_line(read_deck(deck)[0], "W")
    assert not line.any()
    assert "its camber is not computed" in remark


def test_geometry_file_has_the_signs_of_the_product(t37):
    files = write_avl(t37, PanelCounts(), with_body=False)
    assert list(files) == ["geometry.avl"]
    lines = files["geometry.avl"].splitlines()
    controls = {}
    for line in lines:
        if line.startswith("delta_"):
            name, gain, hinge, *_, mirrored = line.split()
            controls.setdefault(name, (float(gain), float(hinge), float(mirrored)))
    # Ailerons move against each other; a positive rudder of the geometry file goes to the right.
    assert {name: (gain, side) for name, (gain, _, side) in controls.items()} == {
        "delta_f": (1.0, 1.0),
        "delta_a": (1.0, -1.0),
        "delta_e": (1.0, 1.0),
        "delta_r": (-1.0, 1.0),
    }
    assert controls["delta_r"][1] == pytest.approx(0.65)
    assert lines[3].split() == [f"{n:.9g}" for n in (t37.reference.S, 5.47 * FOOT, 33.83 * FOOT)]


def test_the_body_is_a_file_of_its_own(t37):
    files = write_avl(t37, PanelCounts(), with_body=True)
    assert list(files) == ["geometry.avl", "body.dat"]
    x, centre, radius = t37.body
    # Circle of the area of the ellipse of half width 2.3 ft and half height 2.125 ft at 6 ft.
    assert x[5] == pytest.approx(6.0 * FOOT)
    assert radius[5] == pytest.approx(np.sqrt(2.3 * 2.125) * FOOT)
    assert centre[5] == pytest.approx(0.5 * (3.1 - 1.15) * FOOT)
