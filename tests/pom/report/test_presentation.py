"""What the page prints and draws: quantised traces, line codes, scales, display units, names in
words.
"""

import numpy as np
import pytest
import report_fixture as fixture

from flightmech.errors import SchemaError
from flightmech.support.arrays import true_spans
from pom.report.case import page as case
from pom.report.case import page as case_data
from pom.report.case import panels, start
from pom.report.presentation import quantities, term_words, traces


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1, 2])
def test_quantised_traces_stay_below_a_500th_of_the_tolerance(index):
    result = fixture.results()[index]
    shown = panels.make_case_panels(result)
    data, body = case_data.plot_data(result, shown, [], case.run_line_classes(result.runs))
    np.testing.assert_allclose(
        traces.restore_trace(data["time"], body), result.signals["time"].values, atol=1e-6
    )
    judged = 0
    for panel, head in zip(shown, data["panels"], strict=True):
        for run, values in panel.traces.items():
            error = np.abs(traces.restore_trace(head["traces"][run], body) - values)
            if panel.half is not None:
                assert np.nanmax(error) < np.nanmin(panel.half) / 500
                assert (
                    np.nanmax(np.abs(traces.restore_trace(head["half"], body) - panel.half))
                    < np.nanmin(panel.half) / 500
                )
                judged += 1
            else:
                assert np.nanmax(error) <= (panel.limits[1] - panel.limits[0]) / 1000 * (1 + 1e-9)
    assert judged >= 3


def test_gaps_and_large_jumps_survive_the_quantisation():
    values = np.array([np.nan, 1.0, 1e6, np.nan, np.nan, -1e6, 0.25])
    pack = traces.Pack.empty()
    entry = pack.add(values, 0.01)
    assert entry["type"] == "int32"  # 1e8 steps do not fit 16 bits
    np.testing.assert_allclose(traces.restore_trace(entry, bytes(pack.body)), values, atol=0.005)
    empty = pack.add(np.full(3, np.nan), 1.0)
    assert np.isnan(traces.restore_trace(empty, bytes(pack.body))).all()


def test_smooth_traces_are_differenced_twice_and_gaps_once():
    pack = traces.Pack.empty()
    smooth = 1e3 * np.sin(np.linspace(0.0, 6.0, 500))
    entries = [
        pack.add(smooth, 0.01),
        pack.add(np.where(np.arange(500) == 250, np.nan, smooth), 0.01),
    ]
    assert [(entry["order"], entry["type"]) for entry in entries] == [(2, "int16"), (1, "int16")]
    for entry, holes in zip(entries, (0, 1), strict=True):
        back = traces.restore_trace(entry, bytes(pack.body))
        assert np.isnan(back).sum() == holes
        assert np.nanmax(np.abs(back - smooth)) <= 0.005 + 1e-9


def test_line_code_of_the_figures_and_of_other_models():
    assert case.run_line_classes(["flight", "datcom", "corrected", "final"]) == dict(
        flight="run-0", datcom="run-1", corrected="run-2", final="run-3"
    )
    styles = case.run_line_classes(["final", "rival", "other"])
    assert styles["final"] == "run-3"
    assert len(set(styles.values())) == 4


def test_an_outlier_is_clipped_before_it_squeezes_the_band():
    time = np.linspace(0, 10, 201)
    flight, half = 3.0 * np.sin(time), np.full(201, 1.5)
    low, high = panels.scale_limits(
        {"flight": flight, "poor": flight + np.where(time > 5, 300.0, 0.0)}, half, 0.0
    )
    assert low < -4.49
    assert 4.5 < high < 12.0
    assert 1.5 / (high - low) > panels.LEAST_BAND


def test_a_missing_response_counts_as_outside():
    time = np.arange(5.0)
    half = np.array([np.nan, 1.0, 1.0, 1.0, np.nan])
    mask = panels.is_outside_band(np.array([9.0, 0.5, np.nan, 2.0, 9.0]), np.zeros(5), half)
    assert true_spans(time, mask) == [(2.0, 3.0)]


@pytest.mark.parametrize(
    ("name", "si", "text"),
    [
        ("theta", np.pi / 6, "30.00\N{NO-BREAK SPACE}deg"),
        ("V_cas", 1852 / 36, "100.0\N{NO-BREAK SPACE}kt"),
        ("temperature", 288.15, "15.0\N{NO-BREAK SPACE}°C"),
        ("nz", 1.5, "1.500\N{NO-BREAK SPACE}g"),
        ("gear", 1.0, "down"),
        ("gear", 0.4, "0.400"),
        ("speedbrake", 0.0007, "in"),
    ],
)
def test_values_in_display_units(name, si, text):
    assert quantities.measured_text(si, name) == text


def test_a_difference_of_temperatures_has_no_offset():
    assert quantities.quantity_label("temperature").width(2.0) == pytest.approx(2.0)


def test_symbols():
    assert str(quantities.quantity_label("delta_e").html) == "<i>δ</i><sub>e</sub>"
    assert quantities.quantity_label("engine2.thrust").words == "net thrust, engine 2"
    assert (
        quantities.quantity_label("trim.u_dot").words
        == "body acceleration along x, left after the trim"
    )
    assert (
        quantities.quantity_label("trim.delta_e").words
        == "elevator deflection, bias found by the trim"
    )
    assert quantities.quantity_label("alien").words == ""


@pytest.mark.parametrize(
    ("term", "stated"),
    [
        ("CL/basic", "basic lift"),
        ("CL/gear", "lift increment due to gear extension"),
        ("Cl/phat", "rolling-moment increment due to roll rate"),
        ("Cn/beta_gear", "yawing-moment increment due to sideslip, with gear down"),
        ("CD/load_factor", "drag increment due to load factor"),
        ("CL/canard", ""),
    ],
)
def test_terms_in_words(term, stated):
    assert term_words.term_words(term) == stated


def test_winds_are_named_from_where_they_blow():
    assert start.wind_text(0.0, -5.0) == "from 090° true at 9.7 kt"
    assert start.wind_text(-5.0, 0.0) == "from 360° true at 9.7 kt"
    assert start.wind_text(0.0, 0.0) == "calm"
    assert start.wind_text(5.0, 0.0, -1.0).endswith(
        "from 180° true at 9.7 kt, up 1.0\N{NO-BREAK SPACE}m/s"
    )


def test_the_rest_of_a_record_does_not_squeeze_the_window():
    result = fixture.short_period_result()
    result.signals["theta"].loc[{"run": "flight", "time": result.signals["time"][:5]}] = (
        3.0  # before the window, as vanes at a standstill
    )
    panel = panels.make_case_panels(result)[0]
    assert panel.limits[1] > np.degrees(3.0)
    assert (
        panel.scale == panels.make_case_panels(fixture.short_period_result())[0].scale
    )  # as if it were not there
    assert panels.make_case_panels(result)[1].scale == panels.make_case_panels(result)[1].limits


def test_a_step_holds_the_largest_reading_of_a_panel():
    trace = np.array([0.0, 1e300, -1e300, 1.0, np.nan, np.inf])
    with pytest.raises(SchemaError, match="more than 32 bits"):
        traces.quantise_trace(trace, 1e-3)
    with pytest.raises(SchemaError, match="more than 32 bits"):
        traces.quantise_trace(np.array([0.0, 1e8]), 1e-3)
    first, order, differences = traces.quantise_trace(trace, traces.least_step([trace]))
    assert (first, order) == (0, 1)
    assert list(differences[:3]) == [0, 2**28, -(2**29)]
    # no usual step is changed by it
    assert traces.least_step([np.array([1e4, np.nan])]) < 1e-4
