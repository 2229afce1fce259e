"""Texts of the exceptions."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from flightmech import errors
from flightmech.names import lookup


def test_parse_error_names_file_and_line():
    error = errors.ParseError("a.out", 12, "'NaN'", "a number")
    assert str(error) == "a.out, line 12: found 'NaN'; expected a number"
    assert (error.file, error.line) == ("a.out", 12)
    assert str(errors.ParseError("a.out", 0, "nothing", "a listing")).startswith(
        "a.out: found nothing"
    )


def test_unknown_name_shows_near_or_all_names():
    assert "near it: gear" in str(errors.UnknownName("gaer", ["gear", "flap"]))
    assert (
        str(errors.UnknownName("xyz", ["b", "a"], "key", "see the manual"))
        == "unknown key 'xyz'; allowed: a, b; see the manual"
    )


def test_schema_error_holds_all_problems():
    error = errors.SchemaError("database", ["one", "two"])
    assert str(error) == "database: 2 problems\n  - one\n  - two"
    assert error.problems == ["one", "two"]


def test_out_of_range_and_simulation_error_carry_data():
    assert errors.OutOfRange("text", np.array([True, False])).mask.tolist() == [True, False]
    assert errors.SimulationError("stopped", 3.5).time == 3.5


def test_all_are_errors_of_the_package():
    names = [
        "ParseError",
        "UnknownName",
        "UnitError",
        "SchemaError",
        "OutOfRange",
        "IdentificationError",
        "SimulationError",
    ]
    for name in names:
        assert issubclass(getattr(errors, name), errors.AeromatchError)
    with pytest.raises(errors.AeromatchError):
        raise errors.UnitError("x")


OTHER_NAMES = {
    "chord": "cbar",
    "span": "b",
    "heading": "psi",
    "Bank angle": "phi",
    "wing_area": "S",
    "elevator": "delta_e",
}


@pytest.mark.parametrize(("name", "symbol"), OTHER_NAMES.items())
def test_other_names_of_the_field_lead_to_the_symbol(name, symbol):
    """Spelling alone led `span` and `heading` elsewhere."""
    assert errors.near_names(
        name, ["S", "b", "cbar", "phi", "psi", "theta", "delta_e", "h_agl"]
    ) == [symbol]
    assert symbol not in errors.near_names(
        name, ["theta", "h_agl"]
    )  # only what the place at hand allows


def test_every_symbol_with_other_names_is_of_the_vocabulary_or_of_the_aircraft_file():
    aircraft = {"S", "cbar", "b", "mass", "Ixx", "Iyy", "Izz"}
    for symbol in set(errors._SYMBOL.values()) - aircraft:
        assert lookup(symbol).name == symbol


@pytest.mark.parametrize(
    "error",
    [
        errors.ParseError("a.out", 3, "x", "a number"),
        errors.UnknownName("alhpa", ["alpha", "beta"], "state", "case 1"),
        errors.SchemaError("case a.toml", ["one", "two"]),
        errors.SimulationError("stopped", 3.5),
        errors.OutOfRange("too far", np.array([True, False])),
    ],
)
def test_an_error_of_another_process_is_the_same(error):
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert str(there) == str(error)
    assert there.__dict__.keys() == error.__dict__.keys()
    assert all(
        np.array_equal(there.__dict__[name], value) for name, value in error.__dict__.items()
    )


def test_a_long_line_is_shown_without_its_middle():
    names = [f"channel{i}" for i in range(20_000)]
    heading = "a" + "x" * 100_000 + "z"
    cases = [
        errors.UnknownName("p", ["time", heading], "column", "the name map requires it"),
        errors.UnknownName(heading, ["time"], "column", "the name map requires it"),
        errors.UnknownName(
            "p", names, "channel", f"there are {', '.join(names)}; the name map requires it"
        ),
        errors.ParseError("r.csv", 3, heading, "a number; the name map requires it"),
        errors.SchemaError("r.csv", [f"{heading}: the name map requires it"]),
        errors.AeromatchWarning(f"{heading} is left out; the name map requires it"),
    ]
    for error in cases:
        assert len(str(error)) < 2000
        assert "characters left out" in str(error)
        assert str(error).endswith("the name map requires it")
    # what a program reads is complete
    assert cases[0].allowed == [heading, "time"]
    text = "x" * 1500
    assert str(errors.AeromatchError(text)) == text
