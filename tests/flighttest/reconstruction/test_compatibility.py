"""Data compatibility: raw, corrected and reconstructed signals of a flight whose instrument errors
are known.
"""

import numpy as np
import pytest

import flighttest
from flightmech.errors import SchemaError, UnknownName
from flighttest.reconstruction.compatibility import ljung_box


@pytest.fixture(scope="module")
def flight(flown, aircraft):
    record, error, truth = flown(0, duration=30.0)
    return flighttest.reconstruct(record, aircraft), error, truth


def test_correction_takes_the_errors_off(flight):
    table = flighttest.reconstruction.compatibility_table(flight[0])
    # factor 1.07 about 0.06 rad and an offset of -0.010 rad on the vane: -0.006 rad; the remainder
    # is its noise
    assert table.loc["alpha_vane", "before"] == pytest.approx(0.0066, abs=3e-4)
    assert table.loc["alpha_vane", "after"] == pytest.approx(0.0015, rel=0.05)
    assert (table["after"] <= table["before"] * 1.001).all()
    assert table.loc["alpha_vane", "theil"] < 0.02


def test_reconstructed_signal_is_what_the_truth_shows(flight):
    path, _, truth = flight
    shown = path.compatibility["theta"].sel(version="reconstructed").values
    assert (
        np.abs(shown - truth["theta"].values).max() < 0.003
    )  # three standard errors of bias.theta
    shown = path.compatibility["h_gps"].sel(version="reconstructed")
    there = np.isfinite(shown.values)
    assert np.abs(shown.values[there] - truth["h"].values[there]).max() < 1.5


def test_corrected_stands_where_the_reading_was_true(flight):
    path, error, _ = flight
    signals = path.compatibility["vn"]
    raw, corrected = (
        path.states["time"].values[np.isfinite(signals.sel(version=v).values)]
        for v in ("raw", "corrected")
    )
    assert np.median(raw[-100:] - corrected[-100:]) == pytest.approx(
        error["delay.gps"], abs=0.011
    )  # half a sample


def test_report_has_a_line_per_channel(flight):
    path = flight[0]
    text = flighttest.reconstruction.compatibility_report(path)
    assert text.splitlines()[0] == "Data compatibility: simulated 0"
    assert {line.split()[0] for line in text.splitlines()[2:]} == set(path.fit.index)


def test_white_and_coloured_residuals_are_distinguished():
    noise = np.random.default_rng(1).normal(size=2000)
    assert ljung_box(noise) > 0.05
    assert ljung_box(noise[1:] + 0.3 * noise[:-1]) < 1e-6
    assert np.isnan(ljung_box(np.ones(100)))


@pytest.mark.nightly
def test_figure_is_drawn(flight, tmp_path):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    target = tmp_path / "compatibility.svg"
    flighttest.reconstruction.draw_compatibility(flight[0], target, ["alpha_vane", "theta", "vn"])
    text = target.read_text()
    assert text.count('<g id="axes_') == 3
    with pytest.raises(UnknownName, match="alfa"):
        flighttest.reconstruction.draw_compatibility(flight[0], target, ["alfa"])
    with pytest.raises(SchemaError, match="give one of png, svg, pdf"):
        flighttest.reconstruction.draw_compatibility(flight[0], tmp_path / "compatibility.xyz")
