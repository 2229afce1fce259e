"""The vocabulary: unique, with units that parse, engine prefixes, near names."""

from __future__ import annotations

import pytest

from flightmech.errors import UnknownName
from flightmech.names import _ROWS, COEFFICIENTS, VOCABULARY, lookup, quantity_attributes
from flightmech.units import parse_unit


def test_names_are_unique_and_units_parse():
    assert len(VOCABULARY) == len(_ROWS)
    for row in VOCABULARY.values():
        assert parse_unit(row.units)[0] == parse_unit(row.display_units)[0], row.name
        assert parse_unit(row.units)[1:] == (1.0, 0.0), f"{row.name}: {row.units} is not SI"
        assert row.long_name


def test_the_coefficients_are_in_it():
    assert [VOCABULARY[name].units for name in COEFFICIENTS] == ["1"] * 6


def test_engine_prefix():
    assert lookup("engine12.thrust") is VOCABULARY["thrust"]
    with pytest.raises(UnknownName):
        lookup("engine0.thrust")


def test_unknown_names_show_the_near_ones():
    with pytest.raises(UnknownName, match="unknown quantity 'delta_el'; near it: delta_e"):
        lookup("delta_el")


def test_attributes():
    assert quantity_attributes("beta") == {
        "units": "rad",
        "long_name": "angle of sideslip",
        "sign": "wind from right",
    }
    assert "sign" not in quantity_attributes("V")
