"""Marks of a panel: judged values, the fitted mode, flow angles at rest, numbers at the edges."""

from dataclasses import replace

import numpy as np
import pytest
import report_fixture as fixture

from flightmech.support.figures import Frame
from pom.report.case import panel_drawing, panel_marks, panels, start
from pom.report.presentation.quantities import quantity_label


def test_a_judged_value_has_its_half_width():
    time = np.linspace(0.0, 10.0, 101)
    common = {"window_start": 1.0, "window_stop": 10.0, "unit": "ft", "flight_value": 90.0}
    rows = [
        # a model that stops later than the flight has a later instant
        {"criterion": "distance", "measure": "elapsed", "at": 9.5, "width": 25.0, **common},
        {"criterion": "distance", "measure": "elapsed", "at": 9.0, "width": 25.0, **common},
        # a width in another unit, and a criterion that was not judged
        {
            "criterion": "share",
            "measure": "elapsed",
            "at": 9.0,
            "width": 8.0,
            **common,
            "unit": "%",
        },
        {"criterion": "other", "measure": "steady", "at": np.nan, "width": np.nan, **common},
    ]
    marks = panel_marks.judged_values(rows, quantity_label("distance"), time, 10.0 * time)
    assert marks == [(9.0, 9.0, pytest.approx(90.0), 25.0)]
    metres = [{**rows[1], "unit": "m", "width": 7.62}]
    (mark,) = panel_marks.judged_values(metres, quantity_label("distance"), time, 10.0 * time)
    assert mark.half == pytest.approx(25.0)
    share = [{**rows[1], "unit": "%", "width": 10.0}]
    assert panel_marks.judged_values(share, quantity_label("phi"), time, time) == []
    mean = [{"criterion": "climb", "measure": "segment_mean", "at": 2.0, "width": 5.0, **common}]
    assert panel_marks.judged_values(mean, quantity_label("h"), time, time) == [
        (1.0, 10.0, 90.0, 5.0)
    ]


def test_the_envelope_of_a_mode_touches_its_extremes():
    t = np.linspace(0.0, 12.0, 1201)
    sigma, wd = 0.2, 2.0 * np.pi / 3.0
    y = 4.0 + 0.1 * t + 5.0 * np.exp(-sigma * t) * np.cos(wd * t + 0.4)
    offset, slope, amplitude, phase = panel_marks.fit_linear_part(t, y, sigma=sigma, wd=wd)
    assert (offset, slope, amplitude, phase) == pytest.approx((4.0, 0.1, 5.0, 0.4))
    mark = panel_marks.ModeMark(0.0, 12.0, offset, slope, amplitude, sigma, [], "")
    low, high = mark.envelope(t)
    assert np.all(y <= high + 1e-9)
    assert np.all(y >= low - 1e-9)
    first, second = panel_marks._find_peaks(t, wd, phase)
    assert second - first == pytest.approx(3.0)
    assert np.interp(first, t, high - y) == pytest.approx(0.0, abs=1e-3)
    # a window with a single maximum has two minima
    short = t[(t > 2.0) & (t < 6.6)]
    first, second = panel_marks._find_peaks(short, wd, phase=2.9)
    assert np.cos(wd * (first - short[0]) + 2.9) == pytest.approx(-1.0)
    assert panel_marks._find_peaks(t[:200], wd, phase) == []


def test_a_standing_aeroplane_has_no_flow_angles():
    before = fixture.roll_result()
    signals = before.signals.copy(deep=True)
    name = "V_cas" if "V_cas" in signals else "V"
    if name not in signals:
        signals[name] = signals[next(iter(signals.data_vars))] * 0.0 + 80.0
    signals["alpha"] = signals[name] * 0.0 + 0.1
    signals[name][:] = 80.0
    slow = signals["time"].values < signals["time"].values[0] + 1.0
    signals[name][:, slow] = 1.0
    judged = [row["channel"] for row in before.rows]
    assert "alpha" not in judged
    by_channel = {p.channel: p for p in panels.make_case_panels(replace(before, signals=signals))}
    flight = by_channel["alpha"].traces["flight"]
    np.testing.assert_array_equal(np.isnan(flight), slow)
    # a record on the ground throughout has no panel of them
    signals[name][:] = 1.0
    by_channel = {p.channel: p for p in panels.make_case_panels(replace(before, signals=signals))}
    assert "alpha" not in by_channel

    trim = before.trim.copy()
    trim.loc["gamma"] = -0.57
    trim.loc["V"] = 1.0
    tables = start.trim_tables(replace(before, trim=trim))
    shown = [row["label"].name for _, rows in tables["parts"] for row in rows]
    assert "V" in shown
    assert not set(shown) & {"alpha", "gamma"}


def test_numbers_at_the_edge_keep_clear_of_each_other():
    result = fixture.roll_result()
    (panel, *_) = panels.make_case_panels(result)
    time = result.signals["time"].values
    frame = Frame(54.0, 20.0, 600.0, 170.0, (float(time[0]), float(time[-1])), (-1.0, 1.0))
    high = np.where(np.arange(len(time)) == len(time) // 2, 5.0, 0.0)
    traces = {"flight": 0.0 * high, "datcom": high, "corrected": 2.0 * high, "final": 3.0 * high}
    crowded = replace(panel, traces=traces, exits={})
    styles = {"datcom": "run-1", "corrected": "run-2", "final": "run-3"}
    svg = panel_drawing.mark_models_beyond_scale(frame, time, crowded, styles)
    heights = [part.split('"')[0] for part in svg.split(' y="')[1:]]
    assert len(heights) == 3
    assert len(set(heights)) == 3
    taken = [(0.0, 0.0, 30.0, 10.0)]
    assert panel_drawing.clear_line(5.0, 9.0, "12", "start", inward=10.5, taken=taken) == 19.5
    assert panel_drawing.clear_line(90.0, 9.0, "12", "start", inward=10.5, taken=taken) == 9.0


def test_the_flight_is_drawn_last():
    result = fixture.roll_result()
    (panel, *_) = panels.make_case_panels(result)
    time = result.signals["time"].values
    frame = Frame(54.0, 20.0, 600.0, 170.0, (float(time[0]), float(time[-1])), panel.scale)
    styles = {"flight": "run-0", "datcom": "run-1", "corrected": "run-2", "final": "run-3"}
    svg = panel_drawing.draw_window_and_traces(frame, time, panel, styles)
    assert svg.rindex('class="hair"') > svg.rindex("run-3")
