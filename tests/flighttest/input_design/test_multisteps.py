"""Multisteps against the published bands of their spectra; sweeps; sequences."""

import numpy as np
import pytest

from flightmech.errors import SchemaError, UnknownName
from flighttest.flight_programme.input_design.input_shapes import (
    PATTERNS,
    in_sequence,
    multistep,
    sweep,
    unit_step,
)
from flighttest.flight_programme.input_design.input_signals import active_part, measures


def spectrum(pattern):
    """Power of an ideal multistep over omega times the unit step."""
    signal = multistep("delta_e", 1.0, 1.0, PATTERNS[pattern], rate=500.0)
    part = active_part(signal)
    power = np.abs(np.fft.rfft(part["delta_e"].values, 1 << 19)) ** 2
    x = 2.0 * np.pi * np.fft.rfftfreq(1 << 19, 1.0 / 500.0)
    near = x < 7.0
    return x[near], power[near] / power[near].max()


@pytest.mark.parametrize(
    ("pattern", "low", "high"),
    [("doublet", 1.15, 3.65), ("3-2-1-1", 0.28, 2.65), ("1-2-1", 1.15, 2.43)],
)  # identification.md 14.2: half-power band in omega dt
def test_half_power_bands(pattern, low, high):
    x, power = spectrum(pattern)
    band = x[power >= 0.5]
    assert band.min() == pytest.approx(
        low, abs=0.01
    )  # half a unit of the last digit, and the ramp of one sample
    assert band.max() == pytest.approx(high, abs=0.01)


def test_a_doublet_is_strongest_at_2_33():
    x, power = spectrum("doublet")
    assert x[power.argmax()] == pytest.approx(2.33, abs=0.005)


def test_unit_step_places_the_mode_in_the_band():
    for pattern in PATTERNS:
        x, power = spectrum(pattern)
        assert np.interp(unit_step(pattern, 1.0), x, power) > 0.5
    with pytest.raises(UnknownName, match="2-1-1"):
        unit_step("2-1-1", 1.0)


def test_steps_have_their_lengths_and_signs():
    u = active_part(multistep("delta_e", -0.05, 0.4, PATTERNS["3-2-1-1"]))["delta_e"].values
    inner = u[np.abs(np.abs(u) - 0.05) < 1e-12]
    assert inner[0] == pytest.approx(-0.05)
    runs = np.diff(np.flatnonzero(np.diff(np.sign(u))))
    assert runs.tolist() == [60, 40, 20, 20]
    assert u.sum() / 50.0 == pytest.approx(-0.05 * 0.4, rel=1e-9), (
        "3 - 2 + 1 - 1 unit steps are left over"
    )


def test_rise_and_free_response():
    signal = multistep("delta_e", 0.05, 0.4, PATTERNS["doublet"], rise=0.1, free=2.0)
    assert measures(signal).loc["delta_e", "rate"] == pytest.approx(2 * 0.05 / 0.1, rel=1e-9)
    assert (signal["delta_e"].values[-150:] == 0.0).all()
    assert signal.attrs["active_stop"] - signal.attrs["active_start"] == pytest.approx(
        2 * 0.4 + 0.1 + 2.0, abs=0.021
    )


@pytest.mark.parametrize("law", ["logarithmic", "linear"])
def test_a_sweep_rises_from_one_end_of_its_band_to_the_other(law):
    u = active_part(sweep("delta_e", 0.05, (0.1, 2.0), 60.0, law=law))["delta_e"].values
    crossings = np.flatnonzero(np.diff(np.signbit(u))) / 50.0
    found, middle = 0.5 / np.diff(crossings), (crossings[1:] + crossings[:-1]) / 2.0
    expected = 0.1 * 20.0 ** (middle / 60.0) if law == "logarithmic" else 0.1 + 1.9 * middle / 60.0
    # half a cycle at 2 Hz is 12.5 samples of which crossings are seen to one
    assert (np.abs(found / expected - 1.0) < 0.1).all()
    assert np.mean(found / expected) == pytest.approx(1.0, abs=0.01)
    assert np.abs(u).max() == pytest.approx(0.05, rel=1e-3)
    cycles = 60.0 * (1.9 / np.log(20.0) if law == "logarithmic" else 1.05)
    assert len(crossings) / 2.0 == pytest.approx(cycles, abs=1.0)


def test_one_after_the_other():
    rudder, aileron = (
        multistep(name, 0.05, 0.3, PATTERNS["doublet"]) for name in ("delta_r", "delta_a")
    )
    both = in_sequence([rudder, aileron], pause=2.0)
    assert both.sizes["time"] == 2 * (rudder.sizes["time"] - 1) + 100 + 1
    assert not ((both["delta_r"] != 0.0) & (both["delta_a"] != 0.0)).any()
    assert both["delta_r"].sum() == pytest.approx(float(rudder["delta_r"].sum()), abs=1e-12)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: multistep("delta_e", 0.1, 0.02), "too short"),
        (lambda: sweep("delta_e", 0.1, (0.1, 8.0), 60.0), "up to 5 Hz"),
        (lambda: sweep("delta_e", 0.1, (0.1, 2.0), 10.0), "hold 1.0 cycles of 0.1 Hz"),
        (lambda: in_sequence([]), "rates none"),
        (lambda: unit_step("doublet", 0.0), "must be positive"),
    ],
)
def test_refusals(call, text):
    with pytest.raises(SchemaError, match=text):
        call()
