"""High-lift and control devices; numbers typed from the corpus (../shared/data/datcom), at the
lines named.
"""

import math

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, NDM, OK, SENTINEL
from flightmech.errors import ParseError

DEG = math.pi / 180.0
EXACT = {"rtol": 1e-12, "atol": 1e-15}  # the same printed number through one multiplication


def cells_of(listing, table, line):
    """Return text, value, flag of the cells of a table's row."""
    frame = listing.cells()
    row = frame[(frame["table"] == table) & (frame["line"] == line)]
    return list(zip(row["column"], row["text"], row["flag"]))


def replaced(lines, number, text):
    """Return lines with the one of a number (from 1) replaced, or left out for None."""
    return [*lines[: number - 1], *([] if text is None else [text]), *lines[number:]]


@pytest.mark.parametrize(
    ("case", "device", "rows"),
    [
        (0, "fowler flap", 206),
        (1, "double-slotted flap", 304),
        (2, "split flap", 401),
        (3, "leading-edge flap", 498),
        (4, "leading-edge slat", 595),
    ],
)
def test_flap_types(corpus, case, device, rows):
    found = corpus("flap_types")[case].to_datatree()["symflp"]
    assert (found.attrs["surface"], found.attrs["device"]) == ("wing", device)
    assert str(found["lines"][0].values) == f"{rows}-{rows + 2}"
    np.testing.assert_allclose(found["delta"], np.array([0.0, 15.0, 30.0]) * DEG, **EXACT)


def test_leading_edge_devices(corpus):
    flap, slat = (corpus("flap_types")[case].to_datatree()["symflp"] for case in (3, 4))
    assert [float(flap[name][0, 2]) for name in ("dCL", "dCm")] == [-0.074, -0.0751]  # line 500
    assert (flap["dCLmax_flag"] == NDM).all()
    assert (flap["CL_alpha_delta_flag"] == NDM).all()
    assert float(flap["dCDi"][0, 9, 2]) == -8.67e-03  # line 517
    assert float(slat["CL_alpha_delta"][0, 1]) == pytest.approx(
        6.240e-02 / DEG, rel=1e-12
    )  # line 596
    assert "dCDi" not in slat  # FTYPE 7 and 8 have none


def test_split_flap_has_hinge_moments(corpus):
    split = corpus("flap_types")[2].to_datatree()["symflp"].isel(condition=0, delta=0)  # line 401
    assert float(split["Ch_alpha"]) == pytest.approx(1.254e-04 / DEG, rel=1e-12)
    assert float(split["Ch_delta"]) == pytest.approx(5.478e-03 / DEG, rel=1e-12)


def test_jet_flap_leaks_the_mark_of_a_missing_number(corpus):
    found = corpus("jet_flap")[0].to_datatree()["symflp"]
    assert [float(found[name][0, 2]) for name in ("dCL", "dCm")] == [0.880, -0.4598]  # line 139
    assert (found["dCDi_flag"] == SENTINEL).all()  # 1.00E-30, lines 146-155
    assert found["dCDi"].isnull().all()


def test_device_without_a_heading_of_its_own_is_identified_by_the_cards(corpus_lines):
    """FTYPE 8 prints no configuration line, so the CASEID stands in its place."""
    lines = [
        line.replace("FTYPE=7.0", "FTYPE=8.0")
        for line in corpus_lines("flap_types")
        if "LEADING-EDGE SLAT" not in line
    ]
    found = datcom_io.read(lines)[4].to_datatree()["symflp"]
    assert (found.attrs["surface"], found.attrs["device"]) == ("wing", "krueger flap")


def test_notes_of_supersonic_controls_are_read_whole(corpus_lines):
    lines = list(corpus_lines("flap_types"))
    at = lines.index("0***NDM PRINTED WHEN NO DATCOM METHODS EXIST")
    lines[at:at] = [
        "0*NOTE* METHODS VALID FOR CONFIGURATIONS WITH LEADING(HINGE LINE) AND TRAILING "
        "EDGES OF THE CONTROL SURFACE "
        "SWEPT AHEAD OF THE MACH",
        "        LINES FROM THE DEFLECTED CONTROLS.",
        "0*NOTE* OTHER RESTRICTIONS USED IN THE DERIVATION OF THE METHODS ARE PRESENTED IN "
        "VOL. II AND/OR DATCOM",
        "0*NOTE* CH(A) AND CH(D) DERIVATIVES ARE FOR STRAIGHT SIDED SYMMETRICAL BICONVEX "
        "AIRFOILS BASED ON TWICE THE AREA-MOMENT OF THE",
        "        CONTROL ABOUT ITS HINGE LINE.",
    ]
    listing = datcom_io.read(lines)
    page = next(page for page in listing.pages if page.kind == "high-lift")
    assert [note.text for note in page.notes if note.text.startswith("*NOTE*")] == [
        f"{lines[at].lstrip('0')} {lines[at + 1].strip()}",
        lines[at + 2].lstrip("0"),
        f"{lines[at + 3].lstrip('0')} {lines[at + 4].strip()}",
    ]
    assert listing.unread == []


@pytest.mark.parametrize("end", [".out", ".pdas.out"])
def test_ailerons_of_both_builds(t37, end):
    asyflp = t37(f"t37_aileron{end}")[0].to_datatree()["asyflp"]
    assert asyflp.attrs["surface"] == "wing"
    assert float(asyflp["Cl"][0, 0]) == -4.9445e-02
    assert float(asyflp["Cn"][0, 18, 8]) == -1.198e-02


def test_unequal_ailerons(corpus):
    asyflp = corpus("cz150_aileron")[0].to_datatree()["asyflp"]
    assert asyflp["Cn"].dims == ("condition", "alpha", "delta_pair")
    assert float(asyflp["Cn"][1, 12, 0]) == 1.768e-02  # line 225
    assert (
        float(asyflp["Cn"][0, 0, 0]) == -5.214e-03
    )  # line 146, -40.0 touches the sign of equality above
    np.testing.assert_allclose(
        asyflp["delta_left"], np.array([-20.0, -10.0, 0.0, 10.0, 20.0]) * DEG, **EXACT
    )


def test_ailerons_without_a_method(corpus_lines):
    """The table stays empty under its headings; the deflections of the heading are kept."""
    lines = list(corpus_lines("cz150_aileron"))
    at = lines.index("0ALPHA") + 1
    until = next(i for i in range(at, len(lines)) if lines[i].startswith("1"))
    lines[at:until] = [
        "0",
        "0*NOTE* NO OUTPUT AVAILABLE FOR THIS COMBINATION OF MACH NUMBER AND CONFIGURATION.",
    ]
    listing = datcom_io.read(lines)
    assert listing.unread == []
    page = next(page for page in listing.pages if page.kind == "high-lift")
    assert page.parsed
    assert page.notes[0].text.startswith("*NOTE* NO OUTPUT AVAILABLE")
    assert cells_of(listing, "asyflp_cn", at - 1) == [
        ("(DELTAL-DELTAR)", text, "ok") for text in ("-40.0", "-20.0", "0.0", "20.0", "40.0")
    ]
    asyflp = listing[0].to_datatree()["asyflp"]
    assert asyflp.sizes["condition"] == 2
    assert (asyflp["Cl_flag"][0] == ABSENT).all()
    assert (asyflp["Cn_flag"][1] == OK).all()


def test_flap_spoiler_at_three_speeds(corpus):
    listing = corpus("spoilers_diff_tail")
    found = listing[0].to_datatree()["spoiler"]
    assert found.attrs["device"] == "flap spoiler"
    np.testing.assert_allclose(found["mach"], [0.3, 0.7, 1.6])
    assert found["Cl"].dims == ("condition", "deflection")
    assert found["Cl"][0].values.tolist() == [
        6.9082e-03,
        6.9082e-03,
        6.9082e-03,
        1.3049e-02,
    ]  # lines 199-202
    assert found["Cn"][0].values.tolist() == [0.0, 1.136e-03, 2.272e-03, 3.408e-03]
    assert (found["Cn_flag"][1] == NDM).all()  # lines 306-309
    assert found["Cl"][1].values.tolist() == [8.1364e-03, 8.1364e-03, 8.1364e-03, 1.5369e-02]
    assert found["Cl"][2].values.tolist() == [
        0.0,
        1.6890e-03,
        3.3781e-03,
        5.0671e-03,
    ]  # lines 344-347
    assert found["Cn"][2].values.tolist() == [0.0, 1.044e-03, 2.088e-03, 3.132e-03]
    assert found["xs_c"].values.tolist() == [0.7] * 4
    assert found["hs_c"].values.tolist() == found["ds_c"].values.tolist() == [0.0, 0.03, 0.06, 0.09]
    assert found["lines"].values.tolist() == ["199-202", "306-309", "344-347"]
    assert cells_of(listing, "spoiler", 309) == [
        ("XS/C", "0.7000", "ok"),
        ("HS/C", "0.0900", "ok"),
        ("DS/C", "0.0900", "ok"),
        ("(CL)ROLL", "1.5369E-02", "ok"),
        ("CN", "NDM", "NDM"),
    ]


def test_plug_spoiler_and_spoiler_slot_deflector(corpus):
    listing = corpus("spoilers_diff_tail")
    plug, slot = (listing[case].to_datatree()["spoiler"] for case in (1, 2))
    assert (plug.attrs["device"], slot.attrs["device"]) == (
        "plug spoiler",
        "spoiler-slot-deflector",
    )
    assert plug["Cn"][0].values.tolist() == [0.0, 7.574e-04, 1.515e-03, 2.272e-03]  # lines 430-433
    assert slot["Cl"][0].values.tolist() == [
        9.1879e-03,
        1.1399e-02,
        1.1399e-02,
        2.1531e-02,
    ]  # lines 623-626
    assert slot["dd_c"].values.tolist() == [0.0, 0.02, 0.04, 0.06]
    assert slot["Cl"][1].values.tolist() == [
        1.0821e-02,
        1.3425e-02,
        1.3425e-02,
        2.5359e-02,
    ]  # lines 730-733
    assert (slot["Cn_flag"][1] == NDM).all()
    assert "dd_c" not in plug.coords


def test_differential_tail(corpus):
    listing = corpus("spoilers_diff_tail")
    found = listing[3].to_datatree()["asyflp"]
    assert found.attrs["surface"] == "tail"
    assert found["Cl"].dims == ("condition", "alpha", "delta_pair")
    assert float(found["Cl"][0, 9, 0]) == -1.555e-02  # line 887
    assert float(found["Cl"][0, 0, 4]) == 1.436e-02  # line 878
    assert (found["Cl_flag"][1] == ABSENT).all()
    assert found["Cl_transonic"][1].values.tolist() == [
        -1.8687e-02,
        -9.3437e-03,
        0.0,
        9.3437e-03,
        1.8687e-02,
    ]  # lines 1102-1106
    assert (found["Cl_transonic_flag"][0] == ABSENT).all()
    np.testing.assert_allclose(
        found["delta_right"], np.array([10.0, 5.0, 0.0, -5.0, -10.0]) * DEG, **EXACT
    )
    assert (found["lines_Cl"][0].item(), found["lines_Cl_transonic"][1].item()) == (
        "878-887",
        "1102-1106",
    )


def test_frames_of_asterisks_are_decoration_and_their_message_is_kept(corpus):
    listing = corpus("spoilers_diff_tail")
    assert listing.unread == []
    messages = [message for message in listing[3].messages if "LATERAL STABILITY" in message.text]
    assert [message.line for message in messages] == [900, 927]
    assert messages[0].text.endswith("PARAMETERS SHB, SEXT, AND RLPH MUST BE INPUT BY THE USER.")


@pytest.mark.parametrize(
    ("line", "text", "found"),
    [
        (201, None, r"line 201: found 3 rows in the spoiler table"),
        (
            307,
            "                                   0.7000        NDM       0.0300      "
            "8.1364E-03        NDM",
            "1 rows in the spoiler table",
        ),
        (880, None, "9 rows in the asyflp_tail table"),
        (1104, None, "4 rows in the asyflp_roll table"),
    ],
)
def test_damaged_tables_raise_or_are_left_out(corpus_lines, line, text, found):
    lines = replaced(corpus_lines("spoilers_diff_tail"), line, text)
    with pytest.raises(ParseError, match=found):
        datcom_io.read(lines)
    listing = datcom_io.read(lines, partial=True)
    assert any(
        "left out" in message.text and message.origin == "reader" for message in listing.messages
    )


@pytest.mark.parametrize(
    ("line", "old", "new", "found"),
    [
        (
            200,
            "0.0300      0.0300",
            "0.0301      0.0300",
            r"HS/C = 0\.0301; expected 0\.03 as in the input cards",
        ),
        (875, "-10.0", "-11.0", r"\(DELTAL-DELTAR\) = -11 deg; expected -10 deg"),
        (1103, "-5.0", "-6.0", "DELTAL = -6 deg; expected -5 deg"),
    ],
)
def test_print_and_cards_must_agree(corpus_lines, line, old, new, found):
    lines = corpus_lines("spoilers_diff_tail")
    listing = datcom_io.read(replaced(lines, line, lines[line - 1].replace(old, new, 1)))
    with pytest.raises(ParseError, match=found):
        listing.to_datatree()
