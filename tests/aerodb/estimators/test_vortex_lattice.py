"""Databases of decks by the vortex lattice of OptVL."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as group
from aerodb.estimators.vortex_lattice import lattice
from aerodb.estimators.vortex_lattice.estimate import from_decks
from flightmech.errors import AeromatchError, SchemaError, SimulationError
from flightmech.units import DEGREE

DATA = Path(__file__).parents[3] / "data"
STUDY = DATA / "t37" / "datcom" / "t37_study.inp"
needs_optvl = pytest.mark.skipif(
    importlib.util.find_spec("optvl") is None,
    reason="the package optvl (extra estimate, GPL) is not installed",
)


@pytest.fixture(scope="module")
def short_deck(tmp_path_factory):
    """Return the deck of the T-37 at two Mach numbers and three angles."""
    text = STUDY.read_text()
    begin, end = text.index(" $FLTCON"), text.index(" $OPTINS")
    text = (
        text[:begin]
        + " $FLTCON NMACH=2.0,MACH(1)=0.3,0.9,NALPHA=3.0,ALSCHD(1)=-4.0,0.0,4.0$\n"
        + text[end:]
    )
    deck = tmp_path_factory.mktemp("deck") / "t37.inp"
    deck.write_text(text)
    return deck


@pytest.fixture(scope="module")
def estimated(short_deck):
    return from_decks([short_deck], rudder=(0.35, 0.0, 1.0), CD0=0.02, errors="guide")


def at_zero(db, name):
    table = aerodb.terms(db)[name]["value"]
    return float(table.sel(mach=0.3).interp(alpha=0.0))


@needs_optvl
def test_derivatives_of_the_t37(estimated):
    # Helmbold: a = 2 pi A / (2 + sqrt(A^2 + 4)) of the wing alone; the tail adds a tenth.
    aspect = 33.83**2 / 183.9
    helmbold = 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect**2 + 4.0))
    lift = aerodb.terms(estimated)["CL/basic"]["value"].sel(mach=0.3)
    slope = float(lift.differentiate("alpha").sel(alpha=0.0, method="nearest"))
    assert helmbold < slope < 1.25 * helmbold
    # AVL 3.32 on the same planform: CL_q 10.4, Cl_p -0.466, Cn_r -0.107 at Mach 0.
    assert at_zero(estimated, "CL/qhat") == pytest.approx(10.4, rel=0.05)
    assert at_zero(estimated, "Cl/phat") == pytest.approx(-0.466, rel=0.05)
    assert at_zero(estimated, "Cn/rhat") == pytest.approx(-0.107, rel=0.05)
    # Signs of the product: down elevator pitches down, right aileron down rolls left, trailing
    # edge left yaws left and pushes to the right.
    assert at_zero(estimated, "CL/elevator") > 0.0 > at_zero(estimated, "Cm/elevator")
    assert at_zero(estimated, "Cl/aileron") < 0.0
    assert at_zero(estimated, "CL/flap") > 0.0
    assert at_zero(estimated, "CY/rudder") > 0.0 > at_zero(estimated, "Cn/rudder")
    assert at_zero(estimated, "Cl/beta") < 0.0 < at_zero(estimated, "Cn/beta")
    assert at_zero(estimated, "CD/basic") > 0.02


@needs_optvl
def test_what_is_not_computed_is_absent_or_stated(estimated):
    names = set(aerodb.terms(estimated))
    assert not {name for name in names if "alphadot" in name}
    assert "Cm/alphadothat" in aerodb.terms(estimated) or "alphadothat" in estimated.attrs["absent"]
    comment = estimated.attrs["comment"]
    assert "no body" in comment
    assert "Mach 0.9 of the deck is beyond the method" in comment
    assert aerodb.terms(estimated)["CL/basic"]["mach"].max() == 0.3
    assert "half as many panels change CL_alpha by" in comment


@needs_optvl
def test_calibrated_database_has_the_ratios(estimated, short_deck):
    calibrated = from_decks([short_deck], rudder=(0.35, 0.0, 1.0), CD0=0.02)
    for name, ratio in (("CY/beta", 2.49), ("Cl/phat", 1.04), ("Cm/elevator", 0.85)):
        assert at_zero(calibrated, name) == pytest.approx(ratio * at_zero(estimated, name))


@needs_optvl
def test_the_command_writes_a_database_of_a_deck_alone(tmp_path, short_deck):
    words = ["estimate", str(short_deck), "--rudder", "0.35,0,0.9", "--CD0", "0.02", "--json"]
    done = CliRunner().invoke(group, [*words, "-o", str(tmp_path / "prior.nc")])
    assert done.exit_code == 0, done.output
    tree = aerodb.open(tmp_path / "prior.nc")
    assert tree.attrs["S"] == pytest.approx(16.9083, rel=1e-5)
    assert tree.attrs["x_ref"] == pytest.approx(-3.0114, rel=1e-4)
    assert "Cn/rudder" in aerodb.terms(tree)


@needs_optvl
def test_a_geometry_that_the_library_refuses_is_an_error(short_deck, tmp_path):
    deck = tmp_path / "thin.inp"
    deck.write_text(short_deck.read_text().replace("CHRDTP=4.5,", "CHRDTP=-40.0,"))
    with pytest.raises((SimulationError, SchemaError)):
        from_decks([deck])


def test_without_the_package_the_error_states_what_to_install(monkeypatch, short_deck):
    monkeypatch.setattr(lattice.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(AeromatchError, match=r"pip install 'aeromatch\[estimate\]'"):
        from_decks([short_deck])


@pytest.mark.parametrize("rudder", [(0.0, 0.0, 1.0), (0.3, 0.9, 0.2), (0.3, 0.0, 1.2)])
def test_a_rudder_that_is_not_on_the_fin_is_refused(short_deck, rudder):
    with pytest.raises(SchemaError, match="share of the chord behind the hinge"):
        from_decks([short_deck], rudder=rudder)


def test_conditions_beyond_the_method_are_refused(monkeypatch, short_deck, tmp_path):
    monkeypatch.setattr(lattice.importlib.util, "find_spec", lambda name: object())
    deck = tmp_path / "fast.inp"
    deck.write_text(short_deck.read_text().replace("MACH(1)=0.3,0.9", "MACH(1)=0.8,0.9"))
    with pytest.raises(SchemaError, match=r"give Mach numbers up to 0\.6"):
        from_decks([deck])


@pytest.mark.slow
@pytest.mark.parametrize("text", ["a", "0.3,0"])
def test_words_of_a_rudder(short_deck, tmp_path, text):
    words = ["estimate", str(short_deck), "--rudder", text, "-o", str(tmp_path / "a.nc")]
    done = CliRunner().invoke(group, words)
    assert done.exit_code == 2
    assert "expected CHORD or CHORD,FROM,TO" in done.output
    aircraft = str(DATA / "t37" / "aircraft.toml")
    done = CliRunner().invoke(group, ["estimate", aircraft, "-o", str(tmp_path / "a.nc")])
    assert done.exit_code == 2
    assert "give the decks (.inp)" in done.output


def test_degrees_of_the_library_become_radians():
    result = {
        "totals": {"CL": 0.5, "CD": 9.0, "CDff": 0.01, "CDv": 0.0, "CY": 0.0},
        "derivatives": {"dCL/dalpha": 5.0, "dCm/dq'": -15.0, "static margin": 0.3},
        "controls": {"dCm/ddelta_e": -0.03, "dCl'/ddelta_e": 1.0},
    }
    result["totals"] |= {"Cl'": 0.0, "Cm": 0.0, "Cn'": 0.0}
    rows = lattice._rows_of((0.3, 0.1, 0.0), result, 1)
    found = {(row["coefficient"], row["variable"]): row["value"] for row in rows}
    assert found["Cm", "delta_e"] == pytest.approx(-0.03 / DEGREE)
    assert found["Cm", "qhat"] == -15.0
    # The drag is that of the wake; moments of controls are those along body axes.
    assert found["CD", ""] == pytest.approx(0.01)
    assert ("Cl", "delta_e") not in found
