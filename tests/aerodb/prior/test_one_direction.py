"""Tests of controls that are printed in one direction, and of increments without a deflection."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import datcom_io
from aerodb.prior.control_devices import _heights_of_one_moment
from aerodb.prior.increments import _warn_of_lift_without_deflection, with_mirror_image
from flightmech.errors import AeromatchWarning


def roll(points: list[float], values: list[float], axis: str = "delta_a") -> xr.DataArray:
    """Return a table over Mach number and a deflection."""
    return xr.DataArray([values], {"mach": [0.2], axis: points}, ("mach", axis))


def test_an_aileron_of_one_direction_is_mirrored() -> None:
    table = roll([-0.2, -0.1, 0.0], [0.025, 0.013, 0.0])
    with pytest.warns(AeromatchWarning, match=r"turn one way only \(delta_a -11.5 to 0 deg\)"):
        tables, note = with_mirror_image({"Cl": table}, "delta_a", "aileron")
    assert "mirror image" in note
    np.testing.assert_array_equal(tables["Cl"]["delta_a"], [-0.2, -0.1, 0.0, 0.1, 0.2])
    np.testing.assert_array_equal(tables["Cl"].values[0], [0.025, 0.013, 0.0, -0.013, -0.025])
    assert tables["Cl"].dims == table.dims


def test_an_aileron_of_both_directions_stays() -> None:
    table = roll([-0.2, 0.0, 0.1], [0.025, 0.0, -0.013])
    tables, note = with_mirror_image({"Cl": table}, "delta_a", "aileron")
    assert tables["Cl"] is table
    assert note == ""


@pytest.mark.parametrize(
    ("values", "expected"),
    [([0.0115, 0.0115, 0.0252], "0.03 to 0.06"), ([0.01, 0.0115, 0.02], ""), ([0.0, 0.0, 0.1], "")],
)
def test_spoiler_heights_with_the_same_moment(values: list[float], expected: str) -> None:
    assert _heights_of_one_moment(roll([0.03, 0.06, 0.1], values, "delta_s")) == expected


@pytest.mark.parametrize(
    ("card", "lift", "words"),
    [
        ("JETFLP=1.0,CMU=0.2", 0.087, r"CMU=0.2\) blows at every deflection, and D\(CL\).* 0.087"),
        ("FTYPE=1.0", 0.087, r"D\(CL\) of 0.087 is printed at zero deflection"),
    ],
)
def test_lift_of_a_flap_without_deflection(card: str, lift: float, words: str) -> None:
    deck = datcom_io.read_deck([f" $SYMFLP {card},NDELTA=2.0,DELTA(1)=0.0,20.0$"])[0]
    given = SimpleNamespace(role="flaps", decks=[deck])
    CL = roll([0.0, 0.35], [lift, 0.4], "delta_f")
    with pytest.warns(AeromatchWarning, match=words):
        _warn_of_lift_without_deflection(given, {"CL": CL}, "delta_f")


def test_a_flap_without_lift_at_zero() -> None:
    deck = datcom_io.read_deck([" $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,20.0$"])[0]
    given = SimpleNamespace(role="flaps", decks=[deck])
    CL = roll([0.0, 0.35], [0.002, 0.4], "delta_f")
    _warn_of_lift_without_deflection(given, {"CL": CL}, "delta_f")
