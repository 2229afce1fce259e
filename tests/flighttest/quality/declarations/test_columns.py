"""Columns and headings against the name map: what contradicts is named, what kinematics prove is an
error, sound maps give nothing.
"""

import numpy as np
import pytest

import flighttest
from flightmech.air import pressure_altitude
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.declarations.columns import (
    column_findings,
    pressure_height_findings,
)
from flighttest.reconstruction.quality.declarations.headings import heading_findings
from flighttest.records.sensors.measurements import pressure
from flighttest.records.signals.record_flags import flags

TIME = np.arange(0.0, 30.0, 0.05)
MOTION = {
    "theta [deg]": 3.0 + 5.0 * np.sin(TIME),
    "phi [deg]": 20.0 * np.sin(0.7 * TIME),
    "Weight (lb)": 5000.0 - TIME,
    "Thrust (lb)": 900.0 + TIME,
    "CAS (kt)": 150.0 + TIME,
    "Height (h)": 1000.0 + 5.0 * TIME,
    "GPS Alt (ft)": 3300.0 + 16.0 * TIME,
    "Lever (%)": 0.5 + 0.01 * TIME,
    "copy [deg]": 3.0 + 5.0 * np.sin(TIME),
}


@pytest.fixture
def read(tmp_path):
    def of(entries, columns=MOTION):
        rows = np.stack([TIME, *columns.values()], axis=1)
        text = "\n".join(",".join(f"{x:.9g}" for x in row) for row in rows)
        (tmp_path / "flight.csv").write_text(",".join(["time", *columns]) + "\n" + text + "\n")
        (tmp_path / "names.toml").write_text("[all]\n" + entries + "\n")
        record = flighttest.read(tmp_path / "flight.csv", tmp_path / "names.toml")
        return record, resample_channels(record, flags(record))

    return of


def named(findings):
    return [(finding.severity, finding.name) for finding in findings]


ATTITUDE = 'theta = "theta"\nphi = "phi"\n'


def test_one_column_for_two_channels(read):
    findings, wrong = column_findings(*read('theta = "theta"\nphi = "theta"'))
    assert named(findings) == [("warning", "column:theta+phi")]
    assert "'theta'" in findings[0].text
    assert wrong == ()


def test_two_columns_with_the_same_samples(read):
    findings, _ = column_findings(*read('theta = "theta"\nphi = "copy"'))
    assert named(findings) == [("warning", "column:phi+theta")]
    assert "'copy'" in findings[0].text


@pytest.mark.parametrize(
    "entries",
    [
        ATTITUDE,
        # one lever for both engines
        'theta = "theta"\nengine1.throttle = "Lever"\nengine2.throttle = "Lever"',
        'theta = "theta"\nbrake_left = "Lever"\nbrake_right = "Lever"',
        # one vertical speed, down and up
        'theta = "theta"\nvd = { column = "CAS", sign = -1 }\nhdot = "CAS"',
    ],
)
def test_legitimate_use_of_a_column(entries, read):
    assert column_findings(*read(entries)) == ([], ())


def test_kinematics_show_which_channel_of_a_column_is_wrong(read):
    """The rate of pitch attitude follows q; a bank angle read from the same column does not follow
    p.
    """
    p, q, r = 0.05 * np.cos(1.7 * TIME), 5.0 * np.cos(TIME), 0.02 * np.sin(TIME)
    rates = {f"{name} [deg/s]": x for name, x in (("p", p), ("q", q), ("r", r))}
    columns = {"theta [deg]": MOTION["theta [deg]"], "Roll [deg]": np.cumsum(p) * 0.05, **rates}
    findings, wrong = column_findings(
        *read('theta = "theta"\nphi = "theta"\np = "p"\nq = "q"\nr = "r"', columns)
    )
    assert named(findings) == [("error", "column:phi+theta")]
    assert findings[0].remedy == 'phi = "Roll"   # in [all] of the name map'
    assert wrong == ("phi",)


def test_both_are_suspects_where_neither_fits(read):
    """Both attitude angles are read from a column that is neither: no other channel is blamed."""
    p, q, r = 20.0 * np.cos(1.3 * TIME), 15.0 * np.sin(0.9 * TIME), 3.0 * np.sin(TIME)
    columns = {f"{name} [deg/s]": x for name, x in (("p", p), ("q", q), ("r", r))} | {
        "x [deg]": 9.0 * np.sin(2.1 * TIME)
    }
    findings, wrong = column_findings(
        *read('theta = "x"\nphi = "x"\np = "p"\nq = "q"\nr = "r"', columns)
    )
    assert named(findings) == [("error", "column:theta+phi")]
    assert "do not hold with both" in findings[0].text
    assert set(wrong) == {"theta", "phi"}


HEADINGS = {
    "kg under lb": (
        'mass = { column = "Weight", unit = "kg" }',
        "stated_unit:mass",
        'mass = { column = "Weight", unit = "lb" }',
    ),
    "N under lb": (
        'engine1.thrust = { column = "Thrust", unit = "N" }',
        "stated_unit:engine1.thrust",
        'unit = "lbf"',
    ),
    "m/s under kt": (
        'V_cas = { column = "CAS", unit = "m/s" }',
        "stated_unit:V_cas",
        'unit = "kt"',
    ),
    "rad under deg": (
        'theta = { column = "theta", unit = "rad" }',
        "stated_unit:theta",
        'unit = "deg"',
    ),
    "ft under kt": (
        'h_baro = { column = "CAS", unit = "ft" }',
        "stated_unit:h_baro",
        "check the column",
    ),
    "converted twice": (
        'V_cas = { column = "CAS", scale = 0.514444 }',
        "stated_unit:V_cas",
        'V_cas = "CAS"',
    ),
    "satellite height": ('h_baro = "GPS Alt"', "column_name:h_baro", "check the column"),
    "sideslip": (
        'theta = { column = "phi", unit = "deg" }',
        "column_name:theta",
        "check the column",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", HEADINGS)
def test_heading_that_contradicts(case, read):
    entry, name, remedy = HEADINGS[case]
    more = "" if entry.startswith("theta") else 'theta = "theta"\n'
    (finding,) = heading_findings(*read(more + entry))
    assert (finding.severity, finding.name) == ("warning", name)
    assert remedy in finding.remedy


@pytest.mark.slow
@pytest.mark.parametrize(
    "entry",
    [
        'mass = { column = "Weight", unit = "lb" }',
        'engine1.thrust = { column = "Thrust", unit = "lbf" }',  # lb of a force
        'h_baro = { column = "Height", unit = "m" }',  # h is a symbol here, not the hour
        'engine1.throttle = { column = "Lever", unit = "%" }',
        'V_cas = { column = "CAS", scale = 1.03 }',
        'h_gps = "GPS Alt"',
        'V_cas = { column = "CAS", unit = "m/s", polynomial = [0.0, 0.5] }',
    ],
)
def test_heading_that_agrees(entry, read):
    assert heading_findings(*read('theta = "theta"\n' + entry)) == []


def test_kinematics_agree_with_the_name_map(read):
    """The heading states deg, the column holds radians, as the name map has it: a note."""
    q = np.cos(TIME)
    columns = {
        "theta [deg]": np.sin(TIME) / 2.0,
        "phi [rad]": 0.0 * TIME + 1e-3 * np.sin(TIME),
        "q [rad/s]": q / 2.0,
        "r [rad/s]": 0.0 * TIME,
    }
    record, signals = read(
        'theta = { column = "theta", unit = "rad" }\nphi = "phi"\nq = "q"\nr = "r"', columns
    )
    (finding,) = heading_findings(record, signals)
    assert (finding.severity, finding.name) == ("note", "stated_unit:theta")


@pytest.mark.parametrize(
    ("shift", "stretch", "found"),
    [(0.0, 1.0, False), (20.0, 1.0, False), (120.0, 1.0, True), (0.0, 1.06, True)],
)
def test_height_of_a_satellite_receiver_is_no_pressure_height(shift, stretch, found, read):
    p_static = pressure(2000.0 + 60.0 * TIME)
    columns = {
        "p_static [Pa]": p_static,
        "h_baro [m]": shift + stretch * pressure_altitude(p_static),
        "theta [deg]": MOTION["theta [deg]"],
    }
    _, signals = read('theta = "theta"\np_static = "p_static"\nh_baro = "h_baro"', columns)
    assert named(pressure_height_findings(signals)) == (
        [("warning", "definition:h_baro+p_static")] if found else []
    )
