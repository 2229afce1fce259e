"""Ranges of controls and devices that fit another unit."""

import numpy as np
import pytest
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.recording.control_ranges import control_range_findings

TIME = np.arange(0.0, 10.0, 0.05)
MOVES = 0.5 + 0.4 * np.sin(TIME)


def found(name, x):
    x = np.broadcast_to(np.asarray(x, float), TIME.shape)
    everywhere = np.ones(TIME.size, bool)
    signals = ResampledChannels(
        TIME, {name: x}, good={name: everywhere}, flying=everywhere, step=0.05
    )
    data = xr.Dataset({name: ("time", x)}, {"time": TIME}, {"rate": 20.0})
    return control_range_findings(signals, xr.DataTree.from_dict({"/all": data}))


@pytest.mark.parametrize(
    ("name", "x", "words"),
    [
        ("delta_f", 1.0, "a position of 0 to 1 that is taken for an angle"),
        ("delta_f", 0.5, "1/2 of a position of 0 to 1 that is taken for an angle"),
        ("delta_f", np.where(TIME > 5.0, 0.25, 0.0), "1/4 of a position of 0 to 1"),
        ("delta_f", np.where(TIME > 5.0, 1.0 / 3.0, 2.0 / 3.0), "1/3 and 2/3 of a position"),
        ("gear", 100.0, "it fits per cent"),
        ("speedbrake", 50.0, "it fits per cent"),
        ("engine1.throttle", 100.0 * MOVES, "it fits per cent"),
        ("engine2.n1", 100.0 * MOVES, "it fits per cent"),
        ("engine2.n1", 0.01 * MOVES, "a share that is taken for per cent"),
        ("engine1.throttle", 0.01 * MOVES, "a share that is taken for per cent"),
        # an overspeed, and noise on it
        ("engine2.n1", np.linspace(0.004, 0.0133, TIME.size), "a share that is taken for per cent"),
        ("column", 100.0 * MOVES, "it fits mm taken for m"),
        ("pedal", 2.0 * MOVES, "it fits in or cm taken for m"),
        ("wheel", 0.4 * MOVES / DEGREE, "it fits deg taken for rad"),
        ("F_column", 3000.0 * MOVES, "no pilot exerts more than 1340 N"),
        ("engine1.fuel_flow", 400.0 * MOVES, "kg/h or lb/h"),
    ],
)
def test_the_range_of_another_unit(name, x, words):
    (finding,), _ = found(name, x)
    assert (finding.severity, finding.name) == ("warning", f"unit:{name}")
    assert words in finding.text
    assert finding.remedy


@pytest.mark.parametrize(
    ("name", "x"),
    [
        ("delta_f", 40.0 * DEGREE),
        ("delta_f", 20.0 * DEGREE),
        ("delta_f", 15.0 * DEGREE),
        ("delta_f", 28.0 * DEGREE),
        ("delta_f", 38.0 * DEGREE),
        # the flap moves from 0 to 40 deg in the whole record, or stops there shortly
        ("delta_f", 40.0 * DEGREE * TIME / TIME[-1]),
        ("delta_f", np.where(np.abs(TIME - 5.0) < 1.0, 0.5, 0.35)),
        ("gear", 1.006),
        ("engine1.throttle", 0.0024),
        ("engine1.n1", 0.003 * MOVES),
        ("engine1.n1", 1.06),
        ("column", 0.16 * MOVES),
        ("wheel", 1.6 * MOVES),
        ("engine1.fuel_flow", 3.0 * MOVES),
    ],
)
def test_usual_ranges(name, x):
    assert found(name, x) == ([], [])


def test_usual_forces_are_not_checked():
    findings, unchecked = found("F_column", 200.0 * MOVES)
    assert findings == []
    assert unchecked[0][2] == ("F_column",)
