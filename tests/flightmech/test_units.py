"""Exact factors, the parser, texts with units."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightmech.errors import UnitError
from flightmech.quantities import finite_number, number_or_text, option_quantity, parse_quantity
from flightmech.units import _BASE, fitted_unit, from_si, known_unit, parse_unit, to_si


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        (1.0, "ft", 0.3048),
        (1.0, "kt", 1852.0 / 3600.0),
        (1.0, "lbf", 4.4482216152605),
        (1.0, "slug", 14.593902937206364),  # lbf s2/ft
        (180.0, "deg", math.pi),
        (1.0, "ft2", 0.09290304),
        (1.0, "slug ft2", 1.3558179483314004),
        (15.0, "degC", 288.15),
        (59.0, "degF", 288.15),
        (518.67, "degR", 288.15),
        (1013.25, "hPa", 101325.0),
        (1.0, "psf", 47.88025898033584),
        (6.0, "deg/s", math.pi / 30.0),
        (60.0, "ft/min", 0.3048),
        (7.0, "m s-1", 7.0),
        (3.0, "kg/m3", 3.0),
        (0.45, "lb/hp/h", 0.45 * 0.45359237 / (745.6998715822702 * 3600.0)),
        (2.0, "", 2.0),
    ],
)
def test_factors_are_the_definitions(value, unit, si):
    assert to_si(value, unit) == pytest.approx(si, rel=1e-15)


@given(st.floats(-1e6, 1e6), st.sampled_from(sorted(_BASE)))
def test_there_and_back(value, unit):
    assert from_si(to_si(value, unit), unit) == pytest.approx(value, rel=1e-12, abs=1e-9)


def test_dimension_is_checked():
    assert parse_unit("N")[0] == parse_unit("kg m s-2")[0]
    with pytest.raises(UnitError, match=r"'kg' cannot be converted to 'm'"):
        to_si(1.0, "kg", "m")


def test_unknown_units_and_offsets_in_products():
    with pytest.raises(UnitError, match=r"unknown unit 'furlong'; known are"):
        parse_unit("furlong")
    with pytest.raises(UnitError, match=r"degC has an offset and cannot stand in a product; use K"):
        parse_unit("m degC")


@pytest.mark.parametrize(
    ("text", "units", "si"),
    [
        ("4000 ft", "m", 1219.2),
        ("-20deg", "rad", -math.pi / 9.0),
        (3, "m", 3.0),
        ("2.5e-1 1", "1", 0.25),
    ],
)
def test_quantities_of_a_file(text, units, si):
    assert parse_quantity(text, units) == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize("text", ["12", "deg", True, "1,5 deg"])
def test_texts_that_are_no_quantity(text):
    with pytest.raises(UnitError, match=r"found|unknown unit"):
        parse_quantity(text, "rad")


KNOT, DEG, POUND_FOOT = 1852 / 3600, math.pi / 180, 1.3558179483314004
SPELT = {
    **{
        "kN": 1000.0,
        "knots": KNOT,
        "KIAS": KNOT,
        "(kt)": KNOT,
        "mph": 0.44704,
        "ft/min": 0.00508,
        "fpm": 0.00508,
        "NM": 1852.0,
    },
    **{
        "°": DEG,
        "°/s": DEG,
        "º/sec": DEG,
        "deg per sec": DEG,
        "DEG/S": DEG,
        "rad/sec²": 1.0,
        "G": 9.80665,
        "g's": 9.80665,
    },
    **{
        "lbs": 0.45359237,
        "lbs/hr": 0.45359237 / 3600,
        "slug-ft^2": POUND_FOOT,
        "slug·ft²": POUND_FOOT,
        "kg-m2": 1.0,
    },
    **{
        "Nm": 1.0,
        "ft-lb": POUND_FOOT,
        "mb": 100.0,
        "in Hg": 3386.38864,
        "in.": 0.0254,
        "m s-1": 1.0,
        "": 1.0,
    },
}


@pytest.mark.parametrize("text", SPELT)
def test_units_as_recorders_spell_them(text):
    assert to_si(1.0, text) == pytest.approx(SPELT[text], rel=1e-7)
    assert known_unit(known_unit(text)) == known_unit(text)


def test_a_spelling_with_two_meanings_is_refused_and_a_pound_goes_by_its_quantity():
    with pytest.raises(UnitError, match=r"unknown unit 'KN'; near it: kN or kt"):
        parse_unit("KN")
    assert [fitted_unit("lbs", unit) for unit in ("N", "kg", "m")] == ["lbf", "lb", "lb"]
    assert fitted_unit("lbf", "kg") == "lb"
    assert parse_unit("°C") == parse_unit("degC")


@pytest.mark.parametrize(
    ("text", "expected", "factor"),
    [
        ("100 ft", "m", 30.48),
        ("x1000 lb", "kg", 453.59237),
        ("100ft", "m", 30.48),
        ("lb/in2", "Pa", 6894.757293),
        ("lbs/ft^2", "Pa", 47.88025898),
        ("1/min", "rad s-1", 0.10471976),
        ("min-1", "rad s-1", 0.10471976),
        ("rev/min", "rad s-1", 0.10471976),
        ("kph", "kg s-1", 1.0 / 3600.0),
        ("kph", "m s-1", 1.0 / 3.6),
        ("m s⁻¹", "m s-1", 1.0),
        ("ms⁻²", "m s-2", 1.0),
        ("°s⁻¹", "rad s-1", 0.017453293),
        ("g’s", "m s-2", 9.80665),
        ("g0", "m s-2", 9.80665),
        ("% RPM", "1", 0.01),
        ("ft MSL", "m", 0.3048),
    ],
)
def test_units_in_headings(text, expected, factor):
    unit = fitted_unit(text, expected)
    assert to_si(1.0, unit, expected) == pytest.approx(factor, rel=1e-7)


@pytest.mark.parametrize("text", ["10", "100", "12 ft", "m 2", "10 100 ft", "KN"])
def test_numbers_are_no_units(text):
    with pytest.raises(UnitError):
        parse_unit(text)


def test_electric_units_have_the_ampere_in_their_dimension():
    assert parse_unit("V A")[0] == parse_unit("W")[0] == parse_unit("N m s-1")[0]
    assert parse_unit("ohm")[0] == parse_unit("V A-1")[0]
    assert to_si(5.0, "Ah", "A s") == pytest.approx(18000.0)
    assert to_si(800.0, "rpm/V", "rad s-1 V-1") == pytest.approx(83.775804, rel=1e-7)
    for unit, expected in (("A", "1"), ("V", "W"), ("W", "V"), ("Ah", "s")):
        with pytest.raises(UnitError, match="cannot be converted"):
            to_si(1.0, unit, expected)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "much", ""])
def test_texts_that_are_no_finite_number(text):
    with pytest.raises(ValueError):
        finite_number(text)
    with pytest.raises(UnitError, match="expected a number and a unit"):
        parse_quantity(number_or_text(text), "m")


def test_texts_that_are_a_finite_number():
    assert finite_number("-1.5e3") == number_or_text("-1.5e3") == -1500.0
    assert number_or_text("3 ft") == "3 ft"


@pytest.mark.parametrize(
    "text",
    ["kt^" + "2" * 5000, "10x" * 2000 + "m", "km999999", "m999999999999"],
)
def test_units_of_a_hostile_file_are_refused(text):
    # digits without end, multiples in each other, powers that overflow
    with pytest.raises(UnitError) as caught:
        parse_unit(text)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("text", ["MPa9 MPa9 MPa9 MPa9 MPa9 MPa9", "mm9 " * 12])
def test_a_unit_beyond_the_floating_point_numbers_is_refused(text):
    with pytest.raises(UnitError, match=r"its factor to SI is (inf|0)"):
        parse_unit(text)


def test_an_option_takes_a_bare_number_and_names_itself_in_an_error():
    assert option_quantity("--station", "8.95", "m") == 8.95
    assert option_quantity("--station", "10 ft", "m") == pytest.approx(3.048)
    for text in ("8,95", "8,95 m"):
        with pytest.raises(
            UnitError, match=r"--station: found '8,95.*decimal comma.*write a point"
        ):
            option_quantity("--station", text, "m")
    with pytest.raises(UnitError, match="--station: "):
        option_quantity("--station", "2 deg", "m")


@pytest.mark.parametrize(
    ("text", "units", "si"),
    [
        ("12 Hz", "rad s-1", 24.0 * math.pi),
        ("3 rev/s", "rad s-1", 6.0 * math.pi),
        ("3 rad/s", "Hz", 1.5 / math.pi),
        ("600 rpm", "Hz", 10.0),
        ("2 Hz", "Hz", 2.0),
        ("2 Hz", "s-1", 2.0),
    ],
)
def test_a_hertz_of_a_rotation_is_a_turn_per_second(text, units, si):
    assert parse_quantity(text, units) == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize("unit", ["rpm", "rev/min", "deg/s", "rev s-1"])
def test_a_quantity_of_events_in_a_second_counts_no_angle(unit):
    with pytest.raises(UnitError, match="counts turns or radians"):
        to_si(6.0, unit, "s-1")
    assert to_si(6.0, "1/min", "s-1") == pytest.approx(0.1)
    assert to_si(6.0, "rad/s", "s-1") == to_si(6.0, "Hz", "s-1") == 6.0
