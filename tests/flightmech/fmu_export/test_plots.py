"""Plots of the tables: values of the model, drawn where the axes put them."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.fmu_export.term_plots import (
    BOTTOM,
    HEIGHT,
    LEFT,
    LEGEND,
    RIGHT,
    TOP,
    WIDTH,
    AxisSpan,
    make_term_figures,
    parse_axis_spans,
)
from flightmech.simulation.kernel import VARIABLE

DEG = np.pi / 180.0


@pytest.fixture(scope="module")
def drawn(trainer):
    return {figure.term: figure for figure in make_term_figures(trainer)}


def curves(svg: str) -> list[np.ndarray]:
    """Return the points of every curve, in parts of the width and height of the axes."""
    drawn = [
        path for path in ET.fromstring(svg).iter("path") if path.get("class").startswith("curve ")
    ]
    right = WIDTH - RIGHT - (LEGEND if len(drawn) > 1 else 0)
    found = []
    for path in drawn:
        start, _, steps = path.get("d").partition("l")
        numbers = [float(x) for part in (start, steps) for x in re.findall(r"-?\d*\.?\d+", part)]
        points = np.cumsum(np.reshape(numbers, (-1, 2)), axis=0)
        found.append((points - [LEFT, HEIGHT - BOTTOM]) / [right - LEFT, TOP - HEIGHT + BOTTOM])
    return found


def words(svg: str) -> list[str]:
    return [text.text for text in ET.fromstring(svg).iter("text")]


def test_every_term_is_there(drawn, trainer):
    assert tuple(drawn) == trainer.terms


def test_a_table_of_two_axes_is_a_curve_per_level(drawn):
    figure = drawn["CL/basic"]  # -0.8 ... 1.5 over alpha -0.2 ... 0.3, mach 0.1 and 0.6
    low, high = curves(figure.svg)
    assert figure.caption == "shades: mach"
    assert words(figure.svg) == [
        *("−0.5", "0.0", "0.5", "1.0", "1.5"), *("−10", "0", "10"), *("0.1", "0.6"), "alpha [deg]",
    ]  # fmt: skip
    grid = [-0.2, 0.0, 0.15, 0.3]  # rad; the curves turn at the inner ones, there and nowhere else
    # coordinates have one decimal of about 140 units
    for curve, values in ((low, [-0.8, 0.2, 0.95, 1.4]), (high, [-0.9, 0.25, 1.1, 1.5])):
        np.testing.assert_allclose(
            -0.9 + 2.4 * curve[:, 1], np.interp(-0.2 + 0.5 * curve[:, 0], grid, values), atol=0.01
        )
        assert len(curve) <= 6


def test_a_regressor_is_one(drawn):
    figure = drawn["Cl/beta"]
    assert figure.caption == "per unit of beta"
    (curve,) = curves(figure.svg)
    np.testing.assert_allclose(curve[[0, -1], 1], [1.0, 0.0], atol=0.005)  # -0.05 ... -0.10


def test_a_constant_is_reported(drawn):
    figure = drawn["Cm/qhat"]
    assert (figure.svg, figure.value, figure.caption) == ("", -14.0, "per unit of qhat")


def test_a_model_without_variables_has_its_values():
    aircraft = flightmech.Aircraft("constant", 17.0, 1.7, 10.3, 2300.0, 10800.0, 8100.0, 15100.0)
    sim = flightmech.compile(
        aircraft, xr.DataTree.from_dict({"/CL/basic": flightmech.terms.make_term(0.3)})
    )
    assert list(sim.entries(VARIABLE)) == []
    assert [(figure.term, figure.svg, figure.value) for figure in make_term_figures(sim)] == [
        ("CL/basic", "", 0.3)
    ]


def test_an_axis_is_also_its_own_regressor(plain):
    from flightmech.terms import make_term

    sim = plain(CD={"extra": make_term([1.0, 3.0], {"alpha": [0.0, 0.2]}, ["alpha"])})
    figure = next(figure for figure in make_term_figures(sim) if figure.term == "CD/extra")
    (curve,) = curves(figure.svg)
    # (1 + 10 alpha) alpha, 0 ... 0.6
    np.testing.assert_allclose(
        0.6 * curve[:, 1], 0.2 * curve[:, 0] * (1.0 + 2.0 * curve[:, 0]), atol=0.004
    )
    assert figure.caption == ""


def test_axes_are_read_back_as_the_compiler_wrote_them():
    text = (
        "alpha -11.46 ... 17.19 deg (4), mach 0.1 ... 0.6 (2), gear.nose.compression 0 m (1), "
        "V 10 ... 20 m s-1 (3)"
    )
    assert parse_axis_spans(text) == [
        AxisSpan("alpha", pytest.approx(-11.46 * DEG), pytest.approx(17.19 * DEG), 4),
        AxisSpan("mach", 0.1, 0.6, 2),
        AxisSpan("gear.nose.compression", 0.0, 0.0, 1),
        AxisSpan("V", 10.0, 20.0, 3),
    ]


def test_the_axis_with_the_most_nodes_runs_as_far_as_anything_changes(plain):
    from flightmech.terms import make_term

    value = np.array([[1.0, 0.5, 0.1, 0.0, 0.0], [2.0, 1.0, 0.2, 0.0, 0.0]])
    sim = plain(
        CL={
            "ground": make_term(
                value, {"delta_f": [0.0, 0.5], "h_agl": [0.0, 4.0, 10.0, 20.0, 30_000.0]}
            )
        }
    )
    figure = next(figure for figure in make_term_figures(sim) if figure.term == "CL/ground")
    # 30 km halved down to the last length that still holds the last change at 20 m
    assert figure.caption == "constant beyond 96.1 ft; shades: delta_f"
    low, high = curves(figure.svg)
    h = 30_000.0 / 1024.0 * low[:, 0]
    np.testing.assert_allclose(
        2.0 * high[:, 1], np.interp(h, [0.0, 4.0, 10.0, 20.0], [2.0, 1.0, 0.2, 0.0]), atol=0.02
    )
    assert words(figure.svg)[:5] == ["0.0", "0.5", "1.0", "1.5", "2.0"]
