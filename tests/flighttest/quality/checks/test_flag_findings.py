"""A recorder that stops is one finding, whatever the number of its groups of channels."""

from types import SimpleNamespace

import pandas as pd
import pytest

from flighttest.reconstruction.quality.checks.samples import _degrees_finding, flag_findings

COLUMNS = ["leaf", "channel", "kind", "start", "stop", "samples", "note"]


def found(*rows):
    return flag_findings(pd.DataFrame(rows, columns=COLUMNS))


def test_one_gap_of_all_clocks_is_one_finding():
    gap = ("", "gap", 34.0, 36.0, 0, "2 s")
    (finding,) = found(("imu", *gap), ("vanes", *gap), ("gps", *gap))
    assert finding.name == "gap:imu+vanes+gps"
    assert finding.text == "imu, vanes, gps: gaps in the clock at 34 s (2 s)"
    assert (finding.start, finding.stop) == (34.0, 36.0)


def test_other_gaps_and_channels_keep_their_finding():
    rows = [
        ("imu", "", "gap", 34.0, 36.0, 0, "2 s"),
        ("gps", "", "gap", 34.0, 36.5, 0, "2.5 s"),
        ("controls", "delta_a", "missing", 6.0, 8.0, 39, ""),
        ("controls", "delta_e", "missing", 6.0, 8.0, 39, ""),
    ]
    names = [finding.name for finding in found(*rows)]
    assert names == ["gap:imu", "gap:gps", "missing:delta_a", "missing:delta_e"]


@pytest.mark.parametrize(("units", "unit"), [("rad", "0.03 deg"), ("rad s-1", "0.03 deg/s")])
def test_a_noise_in_degrees_without_its_unit_is_named(units, unit):
    row = SimpleNamespace(channel="phi", units=units, noise=5.4e-4)
    (finding,) = _degrees_finding(row, 0.03)
    assert finding.name == "noise:phi"
    assert f"'{unit}'" in finding.remedy
    assert _degrees_finding(row, 5.2e-4) == []
    assert _degrees_finding(SimpleNamespace(channel="V", units="m s-1", noise=5.4e-4), 0.03) == []
