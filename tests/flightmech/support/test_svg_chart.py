"""The SVG writer of all pages."""

import re

import numpy as np
import pytest

from flightmech.support import figures as svg_chart
from flightmech.support.arrays import thin_to_extremes


def test_lines_keep_their_shape_with_few_points():
    x = np.linspace(0, 600, 3001)
    y = 80 + 50 * np.sin(x / 40) + np.where(np.abs(x - 300) < 0.3, 30, 0)
    keep = svg_chart.simplify_line(x, y, 0.15)
    assert len(keep) < 300
    assert np.abs(np.interp(x, x[keep], y[keep]) - y).max() <= 0.15


def divided(x, y, slack, first, last):
    """Return the points that Douglas and Peucker keep between two, one piece after the other."""
    inner = np.arange(first, last)
    error = np.abs(np.interp(x[inner], x[[first, last]], y[[first, last]]) - y[inner])
    if last - first < 2 or error.max() <= slack:
        return []
    worst = int(inner[np.flatnonzero(error == error.max())[-1]])
    return [*divided(x, y, slack, first, worst), worst, *divided(x, y, slack, worst, last)]


@pytest.mark.parametrize("slack", [0.0, 0.15, 3.0])
def test_the_points_kept_are_those_of_the_pieces_one_by_one(slack):
    rng = np.random.default_rng(3)
    for count in (2, 3, 10, 300):
        x = np.sort(rng.uniform(0.0, 600.0, count))
        for y in (
            np.cumsum(rng.normal(size=count)),
            rng.integers(0, 4, count).astype(float),
            np.zeros(count),
        ):
            kept = [0, *divided(x, y, slack, 0, count - 1), count - 1]
            assert svg_chart.simplify_line(x, y, slack).tolist() == kept
    assert svg_chart.simplify_line(np.zeros(1), np.zeros(1)).tolist() == [0]


def test_several_points_at_one_place_end_the_search():
    """The interpolation sees one of them: the others stay wrong, whether they are kept or not."""
    keep = svg_chart.simplify_line(
        np.array([0.0, 1.0, 1.0, 1.0, 2.0]), np.array([0.0, 5.0, 0.0, 5.0, 0.0]), 0.1
    ).tolist()
    assert keep[0] == 0
    assert keep[-1] == 4
    assert {2, 3} <= set(keep)  # down and up again


def test_path_data_lead_back_to_the_points():
    frame = svg_chart.Frame(0.0, 0.0, 100.0, 100.0, (0.0, 100.0), (100.0, 0.0))
    x, y = np.array([0.0, 10.04, 20.0, 33.3, 34.0]), np.array([5.0, 90.0, 4.96, np.nan, 7.0])
    found = re.findall(
        r"[Mlh]|-?\d*\.?\d+", svg_chart.draw_curve(frame, x, y, "").partition(' d="')[2]
    )
    assert found == ["M", "0", "5", "l", "10", "85", "10", "-85", "M", "34", "7", "h", "0"]


def test_ticks_are_round_and_inside():
    assert svg_chart.tick_text(svg_chart.choose_ticks(-0.31, 1.02, 5)) == ["0.0", "0.5", "1.0"]
    assert svg_chart.tick_text(svg_chart.choose_ticks(-21.0, 19.0, 5)) == ["−20", "−10", "0", "10"]
    assert svg_chart.tick_text(svg_chart.choose_ticks(1.1, 1.9, 1)) == [
        "1.2",
        "1.4",
        "1.6",
        "1.8",
    ]  # no multiple of 1 or 0.5 twice
    assert svg_chart.tick_text([-2e-9, 0.0, 2e-9]) == ["−2e−09", "0", "2e−09"]


def test_limits_hold_all_finite_values_and_are_never_equal():
    assert svg_chart.find_axis_limits(np.array([1.0, np.nan, 3.0]), 0.5) == (0.0, 4.0)
    assert svg_chart.find_axis_limits(np.array([-4.0, -4.0])) == (-6.0, -2.0)
    assert svg_chart.find_axis_limits(np.array([1e-9, 2e-9])) == (
        1e-9,
        2e-9,
    )  # small is not constant
    assert svg_chart.find_axis_limits(np.array([np.nan])) == (-0.5, 0.5)


def test_thinning_keeps_the_ends_of_every_part_and_the_gaps():
    y = np.random.default_rng(1).normal(size=10_000)
    y[2000:3000] = np.nan
    kept = thin_to_extremes(y, 100)
    assert len(kept) <= 200
    assert {int(np.nanargmin(y)), int(np.nanargmax(y))} <= set(kept.tolist())
    assert np.isnan(y[kept]).sum() == 10  # one for every part of 100 samples
    np.testing.assert_array_equal(thin_to_extremes(y[:200], 100), np.arange(200))


def test_texts_are_escaped():
    assert svg_chart.draw_text(1.0, 2.0, "a < b & c") == '<text x="1" y="2">a &lt; b &amp; c</text>'
    assert 'aria-label="&quot;x&quot;"' in svg_chart.make_svg_figure(10.0, "", '"x"', 20.0)
