"""Tests of the damping that a database takes when the printed one is suspect."""

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest

import aerodb
import datcom_io
from aerodb.prior.damping import with_tail_arm
from aerodb.prior.increments import elevator_effect
from aerodb.prior.print_remarks import describe_tail_pressure
from aerodb.prior.sources import collect_source
from aerodb.store.plausibility import check_plausibility
from flightmech.errors import AeromatchWarning
from flightmech.terms import SOURCES
from flightmech.units import FOOT

LISTING = Path(__file__).parents[1] / "listings" / "multi.out"


@pytest.fixture(scope="module")
def light(craft):
    """Return the aircraft of the listing."""
    lengths = {"cbar": 4.9 * FOOT, "b": 33.0 * FOOT, "reference": (-7.2 * FOOT, 0.0, -0.1 * FOOT)}
    return dataclasses.replace(craft, name="Light single", S=160.0 * FOOT**2, **lengths)


@pytest.fixture(scope="module")
def printed() -> list[str]:
    return LISTING.read_text().splitlines(keepends=True)


@pytest.fixture
def read_with(printed, tmp_path):
    """Return a reader of the listing with another word in the column CMQ."""

    def read(word: str):
        lines = list(printed)
        row = next(i for i, line in enumerate(lines) if "CMQ" in line) + 2
        head, old, tail = lines[row][:25], lines[row][25:37], lines[row][37:]
        assert float(old) < 0.0
        lines[row] = f"{head}{word:>12}{tail}"
        file = tmp_path / "damping.out"
        file.write_text("".join(lines))
        return datcom_io.read(file)

    return read


def build(light, listing):
    """Return the database and the warnings on its damping."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        db = aerodb.from_datcom(light, clean=listing[0])
    return db, [str(item.message) for item in caught if "Cm_qhat" in str(item.message)]


@pytest.mark.nightly
def test_a_positive_pitch_damping_is_replaced_by_the_share_of_the_tail(read_with, light) -> None:
    """The page prints -2.503E-01 per degree; of the other sign it contradicts CMAD."""
    printed, none = build(light, read_with("-2.503E-01"))
    db, (warning,) = build(light, read_with("2.503E-01"))
    assert none == []
    leaf, sound = db["Cm/qhat"], printed["Cm/qhat"]
    # share of the tail against the whole: the page is consistent within 10 %
    assert np.allclose(leaf["value"], sound["value"], rtol=0.1)
    assert (leaf["value"] < 0.0).all()
    assert np.allclose(leaf["stderr"] / np.abs(leaf["value"]), 0.5)
    assert (leaf["source"] == SOURCES.index("judgement")).all()
    assert "suspect in sign or size (14.34 per radian)" in warning
    assert "take its place with twice the standard error" in warning
    assert "suspect" in leaf.attrs["comment"]


def test_the_cells_of_the_reader_have_the_flag(read_with) -> None:
    listing = read_with("2.503E-01")
    dynamic = listing[0].to_datatree()["dynamic"]
    suspect = datcom_io.FLAGS.index("suspect")
    assert (dynamic["Cm_qhat_flag"].values[0] == suspect).all()
    assert not (dynamic["CL_qhat_flag"].values == suspect).any()
    (message,) = [item.text for item in listing.messages if "Cm_qhat" in item.text]
    assert "14.34 per radian" in message
    assert "for the tail alone" in message


@pytest.mark.nightly
def test_a_column_of_infinity_is_named(read_with, light) -> None:
    """A public deck prints -Infinity for CLP at every angle, without a word."""
    listing = read_with("NaN")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        db = aerodb.from_datcom(light, clean=listing[0])
    texts = [str(item.message) for item in caught]
    (text,) = [text for text in texts if "NaN or infinity" in text]
    assert "prints NaN or infinity for Cm_qhat (all cells)" in text
    assert "Cm/qhat" not in aerodb.terms(db)


@pytest.mark.slow
def test_a_moment_of_the_elevator_off_the_arm_of_the_tail_is_replaced() -> None:
    """A public listing prints a quarter of it, because its run computed flaps before."""
    cases = {case.name.split(":")[0]: case for case in datcom_io.read(LISTING)}
    clean = collect_source("clean", cases["TOTAL"])
    effect = elevator_effect(collect_source("elevator", cases["Elevator"]), 1524.0)
    (h_ref,) = clean.grid("dynamic")["h"].values
    assert with_tail_arm(effect, clean, h_ref) is effect
    Cm = effect.tables["Cm"]
    carried = dataclasses.replace(effect, tables={**effect.tables, "Cm": 0.25 * Cm})
    with pytest.warns(AeromatchWarning, match="takes its place with twice the standard error"):
        repaired = with_tail_arm(carried, clean, h_ref)
    np.testing.assert_allclose(repaired.tables["Cm"], Cm, rtol=0.2, atol=1e-3)
    assert bool(repaired.judged["Cm"].all())


@pytest.fixture(scope="module")
def fast_jet(craft):
    """Return the database of a jet whose tail has Q/QINF of 0 at Mach 1.5 and 2."""
    file = Path(__file__).parents[2] / "datcom_io" / "listings" / "tail_pressure.out"
    listing = datcom_io.read(file)
    optins = listing[0].deck.namelists["OPTINS"]
    S, cbar, b = (optins[name][0] for name in ("SREF", "CBARR", "BLREF"))
    x = -listing[0].deck.value("SYNTHS", "XCG")
    aircraft = dataclasses.replace(craft, S=S, cbar=cbar, b=b, reference=(x, 0.0, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        return aerodb.from_datcom(aircraft, clean=listing[0])


def test_a_tail_without_dynamic_pressure_is_implausible(fast_jet) -> None:
    findings = {item.subject: item for item in check_plausibility(fast_jet)}
    assert findings["tail pressure"].stops
    assert "Q/QINF of 0 to 3.56 at the tail for Mach 1.5 2" in findings["tail pressure"].source
    assert "tail pressure is implausible" in fast_jet.attrs["notices"]


def test_strips_take_the_place_of_a_suspect_supersonic_damping(fast_jet) -> None:
    """The print has -2.379 and -1.828 per radian; strips and body give -1.51 and -1.09."""
    leaf = fast_jet["Cm/qhat"]
    assert leaf["value"].sel(mach=1.5).values == pytest.approx(-1.512, abs=2e-3)
    assert leaf["value"].sel(mach=2.0).values == pytest.approx(-1.092, abs=2e-3)
    assert (leaf["source"] == SOURCES.index("judgement")).all()


def test_another_fault_of_the_rows_is_not_one_of_the_tail() -> None:
    """NALPHA counts an angle that the deck does not give; Q/QINF is near 1 in the flagged rows."""
    file = Path(__file__).parents[2] / "datcom_io" / "listings" / "missing_angle.out"
    listing = datcom_io.read(file)
    with pytest.warns(AeromatchWarning, match="numbers of missing_angle.out are suspect"):
        clean = collect_source("clean", listing[0])
    suspect = datcom_io.FLAGS.index("suspect")
    assert (clean.grid("downwash")["q_ratio_flag"] == suspect).any()
    assert describe_tail_pressure(clean, float(clean.grid("static")["h"][0])) == ""


def test_lifting_line_takes_the_place_of_a_suspect_roll_damping(craft) -> None:
    """The program prints -1.38 per radian at alpha 0; with angles up to 16 deg alone, -0.4465."""
    file = Path(__file__).parents[2] / "datcom_io" / "listings" / "lift_of_wings.out"
    lengths = {"S": 24.2, "cbar": 2.022, "b": 13.36, "reference": (-6.3, 0.0, 0.15)}
    jet = dataclasses.replace(craft, name="Light jet", **lengths)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        db = aerodb.from_datcom(jet, clean=datcom_io.read(file)[2])
    (text,) = [str(item.message) for item in caught if "Cl_phat" in str(item.message)]
    assert "lifting-line theory of the planform" in text
    leaf = db["Cl/phat"]
    assert float(leaf["value"].sel(alpha=0.0, mach=0.3)) == pytest.approx(-0.4465, rel=0.01)
    assert (leaf["source"] == SOURCES.index("judgement")).all()
