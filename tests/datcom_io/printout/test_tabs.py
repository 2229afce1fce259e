"""Control tabs; numbers typed from ../shared/data/datcom/control_tab, at the lines named."""

import math

import numpy as np
import pytest

import datcom_io
from datcom_io.arrays.conditions import order_conditions
from datcom_io.arrays.families.tabs import stack_tabs
from datcom_io.arrays.stacking import Stacker
from datcom_io.cells import OK
from flightmech.errors import ParseError

DEG = math.pi / 180.0
POUND_FORCE = 4.4482216152605  # N
BUILDS = (".out", ".pdas.out")
FIRST = {".out": 246, ".pdas.out": 244}  # line of the first stick force in either build


@pytest.mark.parametrize("end", BUILDS)
def test_stream_becomes_alpha_by_delta(corpus, end):
    found = corpus("control_tab", end)[0].to_datatree()["tabs"]
    assert found["Ch_tab_free"].dims == ("condition", "alpha", "delta")
    assert dict(found.sizes) == {"condition": 1, "alpha": 10, "delta": 9}
    free = found["Ch_tab_free"][0].values  # from line 260 of build A on
    assert free[0].tolist() == [0.3, 0.251, 0.163, 0.0755, -0.0122, -0.0995, -0.187, -0.275, -0.345]
    assert free[1, :3].tolist() == [0.342, 0.255, 0.2]  # the third stands first on the next line
    assert free[9, 8] == -0.301
    assert found["Ch_tab_locked"][0, 9, 8] == -0.188
    assert found["Ch_tab_gearing"][0, 9, 8] == -0.0853
    assert float(found["delta_tab_trim"][0, 9, 8]) == pytest.approx(50.1 * DEG, rel=1e-12)
    assert float(found["F_stick"][0, 9, 8]) == pytest.approx(2.11e-11 * POUND_FORCE, rel=1e-12)
    assert (found["Ch_tab_free_flag"] == OK).all()
    first = FIRST[end]
    assert str(found["lines_F_stick"][0].values) == f"{first}-{first + 8}"


def test_units_and_axes(corpus):
    found = corpus("control_tab")[0].to_datatree()["tabs"]
    assert {
        name: found[name].attrs["units"] for name in ("F_stick", "Ch_tab_free", "delta_tab_trim")
    } == {
        "F_stick": "N",
        "Ch_tab_free": "1",
        "delta_tab_trim": "rad",
    }
    np.testing.assert_allclose(
        found["delta"],
        np.array([-20, -15, -10, -5, 0, 5, 10, 15, 19]) * DEG,
        rtol=1e-12,
        atol=1e-15,
    )
    np.testing.assert_allclose(
        found["alpha"], np.array([-6, -4, -2, 0, 2, 4, 6, 8, 12, 16]) * DEG, rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize("end", BUILDS)
def test_order_of_the_stream_is_that_of_the_equations(corpus, end):
    """Tab locked is B1 delta + B3 alpha, tab free has the float of the tab in it; B and D are on
    the CONTAB card, per degree.

    The program computes a deflection of zero as 0.01 deg.
    """
    listing = corpus("control_tab", end)
    found = listing[0].to_datatree()["tabs"].isel(condition=0)
    b1, b2, b3, d1, d2, d3 = (
        listing[0].deck.value("CONTAB", name) for name in ("B1", "B2", "B3", "D1", "D2", "D3")
    )
    alpha, delta = (
        found["alpha"] / DEG,
        found["delta"].where(found["delta"] != 0.0, 0.01 * DEG) / DEG,
    )
    locked = (b1 * delta + b3 * alpha).transpose("alpha", "delta").values
    free = (
        ((b1 + d1 * b2 / d2) * delta + (b3 - d3 * b2 / d2) * alpha)
        .transpose("alpha", "delta")
        .values
    )
    coarse = found["one_decimal"].values.astype(bool)
    for name, wanted in (("Ch_tab_locked", locked), ("Ch_tab_free", free)):
        error = np.abs(found[name].values - wanted)
        assert error[coarse].max() <= 0.0501  # half a unit of one decimal
        assert (
            error[~coarse] <= 5.01e-3 * np.abs(wanted[~coarse]) + 1e-8
        ).all()  # half a unit of three digits, and single precision


def test_values_with_one_decimal_are_marked(corpus):
    found = corpus("control_tab")[0].to_datatree()["tabs"]
    coarse = found["one_decimal"]
    assert coarse.dims == ("alpha", "delta")
    assert np.flatnonzero(coarse.values.ravel()).tolist() == list(range(0, 90, 11))
    assert "one decimal" in coarse.attrs["long_name"]


@pytest.mark.parametrize("end", BUILDS)
def test_cells_are_distinguished_by_the_cards(corpus, end):
    """The hook of the layout gives alpha and delta of every cell, which are printed nowhere."""
    case = corpus("control_tab", end)[0]
    for name in ("tab_force", "tab_free", "tab_locked", "tab_gearing", "tab_trim"):
        ((_, table),) = case.tables(name)
        axes = table.layout.axes(case.deck, table)
        assert table.values.shape == axes["alpha"].shape == (9, 11)
        assert (axes["alpha"][0, 8], axes["delta"][0, 8]) == (-6.0, 19.0)
        assert (axes["alpha"][0, 9], axes["delta"][0, 9]) == (-4.0, -20.0)
        assert (axes["alpha"][8, 1], axes["delta"][8, 1]) == (16.0, 19.0)
        assert np.isnan(axes["alpha"][8, 2:]).all()


def test_deflections_of_the_heading_are_cells(corpus):
    listing = corpus("control_tab")
    ((_, group),) = listing[0].values("tab_trim")
    assert group.values.tolist() == [-20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 19.0]
    assert group.lines == (313,) * 9
    assert listing.unread == []
    assert listing.unparsed == []


def test_stick_force_coefficient_without_pressure(corpus_lines):
    """Without atmosphere the program prints a coefficient under another heading."""
    old = "STICK FORCE, F(C), LB (TRIM TAB DEFL. = 0.0)"
    lines = [
        line.replace(old, "STICK FORCE COEFFICIENT, CF(C) (TRIM TAB DEFL. = 0.0)")
        for line in corpus_lines("control_tab")
    ]
    found = datcom_io.read(lines)[0].to_datatree()["tabs"]
    assert "F_stick" not in found
    assert float(found["CF_stick"][0, 9, 8]) == 2.11e-11
    assert found["CF_stick"].attrs["units"] == "1"


@pytest.mark.parametrize("end", BUILDS)
def test_faults_of_the_program_are_reported(corpus, end):
    texts = [
        message.text
        for message in corpus("control_tab", end).messages
        if message.origin == "reader"
    ]
    assert any(text.startswith("stick forces up to 2.68e-11 lb") for text in texts)
    assert any(text.startswith("D(CM) is 0.0000 at every deflection") for text in texts) == (
        end == ".out"
    )


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (
            lambda lines: lines[:262] + lines[263:],
            "79 values in the tab_free table; expected 90 values (NALPHA x NDELTA of the "
            "input cards)",
        ),
        (
            lambda lines: [
                *lines[:261],
                lines[261].replace("-8.75E-02", "         "),
                *lines[262:],
            ],
            "89 values in the tab_free table",
        ),
        (
            lambda lines: [
                *lines[:261],
                lines[261].replace("-8.75E-02", "     word"),
                *lines[262:],
            ],
            "22 values in the tab_free table",
        ),
    ],
    ids=["row lost", "value lost", "word in a value"],
)
def test_a_stream_that_is_not_whole(corpus_lines, change, found):
    lines = change(corpus_lines("control_tab"))
    with pytest.raises(ParseError) as caught:
        datcom_io.read(lines)
    assert found in str(caught.value)
    listing = datcom_io.read(lines, partial=True)
    found_tabs = listing[0].to_datatree()["tabs"]
    assert "Ch_tab_free" not in found_tabs
    assert "Ch_tab_locked" in found_tabs
    assert any(
        "in the tab_free table instead of 90 values" in message.text for message in listing.messages
    )


def test_heading_that_is_not_the_cards(corpus_lines):
    lines = list(corpus_lines("control_tab"))
    lines[256] = lines[256].replace("-15.0", "-16.0")
    with pytest.raises(ParseError, match=r"line 257: found DELTA = -16 deg; expected -15 deg"):
        datcom_io.read(lines).to_datatree()


def test_block_has_one_row_per_value(corpus):
    block = corpus("control_tab")[0].block("tab_trim")
    assert len(block) == 90
    last = block.iloc[-1]  # line 324
    assert (
        last["line"],
        last["ALPHA"],
        last["DELTA"],
        last["TRIM TAB DEFLECTION FOR ZERO STICK FORCE, DEG."],
    ) == (324, 16.0, 19.0, 50.1)
    assert block.attrs["units"]["TRIM TAB DEFLECTION FOR ZERO STICK FORCE, DEG."] == "deg"


def test_stream_that_cards_without_a_count_do_not_fit(corpus_lines):
    """Without NALPHA nothing can be held against the print while reading; the leaf then holds the
    schedule against it.
    """
    cards = {"NALPHA=10.0,": "", "6.0,8.0,12.0,16.0$": "6.0,8.0,12.0$"}
    lines = list(corpus_lines("control_tab"))
    for old, new in cards.items():
        lines = [
            line.replace(old, new) if "-6.0,-4.0,-2.0" in line or "NALPHA" in line else line
            for line in lines
        ]
    case = datcom_io.read(lines)[0]
    with pytest.raises(
        ParseError,
        match="found 90 values in the tab_force table; expected 81 values, alphas x deflections",
    ):
        stack_tabs(Stacker(case, *order_conditions(case), False))
