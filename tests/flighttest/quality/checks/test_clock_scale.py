"""A clock that does not count seconds is named, and the rest is judged on seconds."""

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.recording.clock_scale import clock_scale


def flight(counts, degrees=False, seconds=120.0, rate=25.0):
    """Return angles and rates of a slow weave on a clock of so many counts in a second."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    phi, theta = 0.4 * np.sin(0.5 * t), 0.05 + 0.1 * np.sin(0.9 * t)
    psi = 0.3 * np.sin(0.3 * t)
    slopes = (0.2 * np.cos(0.5 * t), 0.09 * np.cos(0.9 * t), 0.09 * np.cos(0.3 * t))
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    p = slopes[0] - slopes[2] * st
    q = slopes[1] * cf + slopes[2] * ct * sf
    r = slopes[2] * ct * cf - slopes[1] * sf
    factor = 1.0 / DEGREE if degrees else 1.0
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (3, t.size))
    columns = {"phi": phi, "theta": theta, "psi": psi, "p": p, "q": q, "r": r}
    data = xr.Dataset(
        {
            name: ("time", (factor if name in "pqr" else 1.0) * x + noise[k % 3])
            for k, (name, x) in enumerate(columns.items())
        },
        {"time": counts * t},
        {"rate": rate / counts},
    )
    return xr.DataTree.from_dict({"/imu": data})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("counts", "unit"),
    [(1e3, "ms"), (1e6, "us"), (1.0 / 60.0, "min"), (25.0, ""), (2.0, ""), (0.5, "")],
)
def test_clock_that_does_not_count_seconds(counts, unit):
    quality = flighttest.assess(flight(counts))
    (error,) = [one for one in quality.findings if one.severity == "error"]
    assert error.channels[0] == "time"
    assert error.evidence["factor"] == pytest.approx(counts, rel=0.02)
    assert error.evidence["rate"] == pytest.approx(25.0, rel=0.02)
    assert (f'unit = "{unit}"' if unit else "rate = ") in error.remedy


def test_clock_of_milliseconds_stated_twice():
    quality = flighttest.assess(flight(1e-3))  # seconds under a heading in ms
    assert [one.name for one in quality.findings if one.severity == "error"] == [
        "unit:time+phi+theta+psi"
    ]


@pytest.mark.parametrize("degrees", [False, True])
def test_seconds_are_seconds(degrees):
    assert clock_scale(flight(1.0, degrees)) is None


def with_height(record, counts):
    """Return the record with a climb whose velocity is right on a clock of these counts."""
    data = record["imu"].to_dataset()
    time = data["time"].values / counts
    climb = {
        "h_gps": ("time", 1000.0 + 40.0 * np.sin(0.4 * time)),
        "vd": ("time", -16.0 * np.cos(0.4 * time)),
    }
    return xr.DataTree.from_dict({"/imu": data.assign(climb)})


@pytest.mark.parametrize("counts", [1.16, 1.24, 0.82])
def test_a_stretched_clock_is_not_a_scale_of_the_gyros(counts):
    scale = clock_scale(with_height(flight(counts), counts))
    assert scale.factor == pytest.approx(counts, rel=0.01)
    assert scale.rate == pytest.approx(25.0, rel=0.01)
    assert scale.angles == ("phi", "theta", "psi", "h_gps")
    # gyros of one scale: the velocity fits its height; without a velocity nothing shows which
    assert clock_scale(with_height(flight(counts), 1.0)) is None
    assert clock_scale(flight(counts)) is None
