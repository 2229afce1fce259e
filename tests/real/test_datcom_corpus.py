"""The whole corpus of own decks and program outputs in ../shared/data/datcom: nothing raises,
nothing is lost.
"""

from pathlib import Path

import numpy as np
import pytest

import datcom_io

CORPUS = Path(__file__).parents[2] / ".." / "shared" / "data" / "datcom"
FILES = sorted(CORPUS.glob("*/*.out"))
pytestmark = pytest.mark.skipif(not FILES, reason="the corpus ../shared/data/datcom is not there")


@pytest.mark.nightly
@pytest.mark.parametrize("path", FILES, ids=[path.name for path in FILES])
def test_every_listing_is_read_whole(path):
    listing = datcom_io.read(path)
    assert listing.unread == []
    lines = path.read_text(encoding="latin-1").count("\n")
    assert listing.line_count in (lines, lines + 1)
    tree = listing.to_datatree()
    assert set(tree.children) == {
        case.name for case in listing if any(page.printed for page in case.pages)
    }


def test_the_same_aircraft_in_four_systems_of_units():
    listing = datcom_io.read(CORPUS / "units_ft_in_m_cm" / "units_ft_in_m_cm.out")
    trees = [case.to_datatree() for case in listing]
    assert [tree.attrs["dim"] for tree in trees] == ["FT", "IN", "M", "CM"]
    metre = trees[2]
    for tree in trees:
        for name, tolerance in (
            ("S", 2e-6),
            ("cbar", 2e-5),
            ("b", 2e-5),
            ("x_cg", 4e-5),
        ):  # three decimals of a foot
            assert tree.attrs[name] == pytest.approx(metre.attrs[name], rel=tolerance)
        for name in ("h", "V", "p_static", "temperature", "reynolds_per_m"):
            # half a unit of the last printed digit of either system, relative to the value
            np.testing.assert_allclose(tree["static"][name], metre["static"][name], rtol=6e-5)
        np.testing.assert_allclose(tree["static"]["CL"], metre["static"]["CL"], atol=0.0011)
        np.testing.assert_allclose(tree["symflp"]["dCL"], metre["symflp"]["dCL"], atol=0.0011)


def test_repeated_conditions_stay_apart():
    listing = datcom_io.read(CORPUS / "loop_modes" / "loop_modes.out")
    assert [case.deck.loop for case in listing] == [1, 2, 3]
    assert [case.to_datatree()["static"].sizes["condition"] for case in listing] == [3, 6, 6]
    pairs = [
        list(zip(tree["static"]["mach"].values, tree["static"]["h"].values))
        for tree in (case.to_datatree() for case in listing)
    ]
    for case, found in zip(listing, pairs):
        np.testing.assert_allclose(found, case.deck.conditions())
    assert sorted(pairs[1]) == sorted(pairs[2])
    assert pairs[1] != pairs[2]


def test_nothing_printed_for_altitude():
    case = datcom_io.read(CORPUS / "speed_input" / "speed_input.out")[
        "REYNOLDS NUMBER ONLY, NO ALTITUDE"
    ]
    static = case.to_datatree()["static"]
    assert static["h"].isnull().all()
    assert static["p_static"].isnull().all()
    assert (static["reynolds_per_m"] > 0).all()


def test_transonic_first_row_is_not_spread():
    static = datcom_io.read(CORPUS / "ce500_transonic" / "ce500_transonic.out")[0].to_datatree(
        fill_transonic=True
    )["static"]
    flags = static["CD_flag"][1]  # Mach number of the second condition lies above STMACH: line 624
    assert int(flags[0]) == 0
    assert (flags[1:] == datcom_io.FLAGS.index("blank")).all()
    assert float(static["CD"][1, 0]) == 0.018
    assert (static["CY_beta_flag"][1] == datcom_io.FLAGS.index("NDM")).all()


def test_words_and_overflow():
    static = datcom_io.read(CORPUS / "overflow" / "overflow.out")[0].to_datatree()["static"]
    assert (static["CL_flag"][0, :3] == datcom_io.FLAGS.index("overflow")).all()  # lines 172-174
    assert static["CD"][0, :3].values.tolist() == [90.151, 47.221, 42.990]
    canard = datcom_io.read(CORPUS / "canard" / "canard.out").cells()
    row = canard[canard["line"] == 264]
    assert row["flag"].tolist() == ["ok", *["nan"] * 8, "ok", "ok", "ok"]


def test_ground_heights_are_feet_under_dim_m():
    static = datcom_io.read(CORPUS / "ce500_ground" / "ce500_ground.out")[0].to_datatree()["static"]
    heights = [1.7, 3.0, 6.0, 9.0, 20.0]  # GRDHT of the deck, printed 5.58 9.84 19.69 29.53 65.62
    np.testing.assert_allclose(static["ground_height"][:-1], heights, rtol=1e-12)


def test_dynamic_page_repeated_after_every_ground_page_counts_once():
    listing = datcom_io.read(CORPUS / "ce500_ground" / "ce500_ground.out")
    assert len(list(listing[0].tables("dynamic"))) == 6
    assert listing[0].to_datatree()["dynamic"].sizes["condition"] == 1
    assert not any("dynamic page differs" in message.text for message in listing.messages)


def test_saved_cases_keep_their_cards():
    listing = datcom_io.read(CORPUS / "save_cascade" / "save_cascade.out")
    assert listing.case_names[-2:] == ["case 5", "case 6"]
    assert [case.deck.deriv for case in listing] == ["RAD"] * 4 + ["DEG"] * 2
    assert all(case.deck.value("OPTINS", "SREF") == 24.2 for case in listing)
    assert listing[4].deck.schedule("FLTCON", "ALSCHD", "NALPHA") == [0.0, 2.0, 4.0, 6.0]
    assert [name for name in ("SYMFLP", "ASYFLP") if name in listing[2].deck.namelists] == [
        "ASYFLP"
    ]
    assert listing[4].to_datatree()["symflp"].attrs["surface"] == "tail"


def test_bad_cases_have_messages_and_good_ones_between_them_tables():
    listing = datcom_io.read(CORPUS / "errors_missing" / "errors_missing.out")
    bad = listing["WING SECTION MISSING"]
    assert bad.pages == []
    assert [message.text for message in bad.messages] == [
        "ERROR-WING PLANFORM PRESENT BUT SECTION CHARACTERISTICS ABSENT-MISSING NAME*WGSCHR*",
        "THIS CASE ABORTED FOR THE ABOVE REASON(S) ALL NAMES REFER TO NAMELIST NAMES",
    ]
    assert "static" in listing["GOOD CASE AFTER AN ABORTED ONE"].to_datatree()
    stopped = datcom_io.read(CORPUS / "errors" / "errors.out")
    assert stopped.messages[-1].text.startswith("*** EXECUTION TERMINATING")
    assert any(
        "** ILLEGAL CONTROL CARD: * THIS LINE IS A DATCOM PLUS STYLE COMMENT" in message.text
        for message in stopped.messages
    )


def test_faults_of_the_program_are_reported():
    texts = " ".join(
        message.text
        for message in datcom_io.read(CORPUS / "ce500_clean" / "ce500_clean.out").messages
    )
    assert "divides the weight by 0.2248 again" in texts
    control = datcom_io.read(CORPUS / "ce500_elevator" / "ce500_elevator.out")
    assert any(
        "pressure 44.198 on a control page, 101330 on the static page" in message.text
        for message in control.messages
    )
    np.testing.assert_allclose(control[0].to_datatree()["symflp"]["p_static"][0], 101330.0)
