"""Figures of listings: a curve for each condition, in the units of the field."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import datcom_io
from datcom_io.arrays.figure import coefficient_figure
from flightmech.errors import SchemaError, UnknownName

pytest.importorskip("matplotlib")
DATCOM = Path(__file__).parents[3] / "data" / "t37" / "datcom"


@pytest.fixture(scope="module")
def clean():
    return datcom_io.read(DATCOM / "t37_clean.out")


def test_a_listing_shows_lift_drag_and_moment_at_each_condition(clean):
    figure = clean.plot()
    lift, drag, moment = figure.axes
    assert [ax.get_ylabel() for ax in figure.axes] == ["CL", "CD", "Cm"]
    assert lift.get_xlabel() == "alpha [deg]"
    assert (
        len(lift.get_lines()) == len(drag.get_lines()) == len(moment.get_lines()) == 18
    )  # 6 Mach numbers at 3 altitudes
    printed = clean[0].block("static")
    first = printed[(printed["mach"] == 0.15) & (printed["altitude"] == 0.0)]
    np.testing.assert_allclose(lift.get_lines()[0].get_xdata(), first["ALPHA"])
    np.testing.assert_allclose(lift.get_lines()[0].get_ydata(), first["CL"])
    legend = [text.get_text() for text in moment.get_legend().get_texts()]
    assert legend == [
        "M 0.15",
        "M 0.2",
        "M 0.3",
        "M 0.4",
        "M 0.5",
        "M 0.6",
        "0 ft",
        "10000 ft",
        "20000 ft",
    ]
    assert (
        lift.get_title(loc="left")
        == "1 T-37 OWN DECK CLEAN AIRCRAFT, wing-body-vertical tail-horizontal tail, free air, "
        "power off"
    )


def test_equal_conditions_look_equal(clean):
    lines = clean[0].plot(["CL"]).axes[0].get_lines()
    looks = {(line.get_color(), line.get_linestyle()) for line in lines}
    assert len(looks) == len(lines)
    assert len({line.get_color() for line in lines}) == 6
    assert len({line.get_linestyle() for line in lines}) == 3


def test_heights_over_ground():
    figure = datcom_io.read(DATCOM / "t37_ground.out").plot(["CL"])
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert legend[0] == "2.5 ft over ground"
    assert legend[-1] == "free air"


def test_a_build_up_shows_the_most_complete_configuration_or_the_chosen_one(clean):
    whole = clean[0].to_datatree()["static"].to_dataset()[["CL"]]
    static = xr.concat(
        [(0.9 * whole).assign_coords(configuration="WING-BODY"), whole], "configuration"
    )
    case = {"build": xr.DataTree.from_dict({"/static": static})}
    figure = coefficient_figure("build", case, ["CL"])
    assert ", wing-body-vertical tail-horizontal tail," in figure.axes[0].get_title(loc="left")
    part = coefficient_figure("build", case, ["CL"], "WING-BODY")
    assert ", wing-body," in part.axes[0].get_title(loc="left")
    full, less = (figure.axes[0].get_lines()[0].get_ydata() for figure in (figure, part))
    np.testing.assert_allclose(less, 0.9 * full)
    with pytest.raises(
        UnknownName,
        match=r"unknown configuration 'WING'; .*there are WING-BODY, WING-BODY-VERTICAL",
    ):
        coefficient_figure("build", case, ["CL"], "WING")


def test_what_is_not_printed(clean):
    with pytest.raises(
        UnknownName, match=r"unknown coefficient of .* 'Ch_e'.*there are CD, CL, Cm, CN"
    ):
        clean.plot(["Ch_e"])
    with pytest.raises(SchemaError, match="no case prints static coefficients over alpha"):
        datcom_io.Listing("empty.out").plot()
