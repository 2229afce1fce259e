import math

import pytest

from datcom_io.cells import BLANK, NA, NDM, NOT_A_NUMBER, OK, OVERFLOW, SENTINEL, read_cell


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("  0.096", 0.096),
        (".096", 0.096),
        ("-.021", -0.021),
        (" .0 ", 0.0),
        ("-0.000", 0.0),
        (" 5.797E+00", 5.797),
        ("1.0D-02", 0.01),
        ("2.5e-02", 0.025),
        ("5.800-002", 0.058),
        ("2.1162+003", 2116.2),
        ("-4.", -4.0),
    ],
)
def test_number(text, value):
    assert read_cell(text) == (value, OK)


@pytest.mark.parametrize(
    ("text", "flag"),
    [
        ("", BLANK),
        ("      ", BLANK),
        ("   NDM ", NDM),
        ("  NA  ", NA),
        (" ****** ", OVERFLOW),
        ("  NaN", NOT_A_NUMBER),
        ("-1.#IND", NOT_A_NUMBER),
        (" 1.#QNAN0", NOT_A_NUMBER),
    ],
)
def test_word(text, flag):
    value, found = read_cell(text)
    assert math.isnan(value)
    assert found == flag


@pytest.mark.parametrize(
    "text", ["1.00E-30", "2.0E-30", "-1.0000E-30", "0.1000E-29", "3.2808E-30", "0.1000000E-29"]
)
def test_sentinel_keeps_its_number(text):
    assert read_cell(text) == (float(text), SENTINEL)


def test_infinity_is_a_failed_number():
    assert read_cell("Infinity") == (math.inf, NOT_A_NUMBER)


@pytest.mark.parametrize("text", ["1.2.3", "ALPHA", "1.0 2.0", "NDMX", "--5", "1*", "N A"])
def test_garbage_is_no_cell(text):
    assert read_cell(text) is None
