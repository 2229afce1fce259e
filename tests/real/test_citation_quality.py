"""Data quality of the real flights of the Citation II: every trap that the README of the data set
lists is caught by name.

The recorder's channels are read twice: as the name maps in ``maps`` have them, and as recorded,
without sign and offset.
"""

from pathlib import Path

import pytest

import flighttest
from flightmech.units import DEGREE

HERE = Path(__file__).parent
FLIGHTS = HERE.parents[1] / ".." / "shared" / "data" / "flight" / "citation_phlab"
pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(
        not FLIGHTS.is_dir(),
        reason="the Citation II flights (../shared/data/flight/citation_phlab) are not here",
    ),
]
FILES = {2018: "flight_20180312_1", 2019: "flight_20190305_2_partial", 2020: "flight_20200310_2"}
MORE = {
    2018: '\n[more]\nF_column = "column_fe"\nhdot = { column = "Dadc1_altRate", unit = "ft/min" '
    "}\n",
    2019: '\n[more]\nF_column = "column_fe"\n',
}
MORE[2020] = MORE[2018] + 'column = { column = "column_Se", scale = "1 cm" }\n'


def assessed(year, text, folder):
    names = folder / "names.toml"
    names.write_text(text + MORE[year])
    return flighttest.assess(flighttest.read(FLIGHTS / f"{FILES[year]}.csv.gz", names))


@pytest.fixture(scope="module")
def as_recorded(tmp_path_factory):
    """The flights with the recorder's own signs and definitions."""
    found = {}
    for year in FILES:
        text = (
            (HERE / "maps" / f"citation_{year}.toml")
            .read_text()
            .replace("sign = -1", "sign = 1")
            .replace(', offset = "-1 g"', "")
        )
        found[year] = assessed(year, text, tmp_path_factory.mktemp(str(year)))
    return found


@pytest.fixture(scope="module")
def as_mapped(tmp_path_factory):
    return {
        year: assessed(
            year,
            (HERE / "maps" / f"citation_{year}.toml").read_text(),
            tmp_path_factory.mktemp(str(year)),
        )
        for year in FILES
    }


def named(quality, *severities):
    return {f"{f.kind}:{f.channels[0]}" for f in quality.findings if f.severity in severities}


def finding(quality, name):
    return next(f for f in quality.findings if f"{f.kind}:{f.channels[0]}" == name)


def test_signs_and_definitions_as_recorded(as_recorded):
    """delta_a differs from flight to flight, delta_r is nose right in every one, NormAcc is load
    factor minus one, pull is negative.
    """
    assert named(as_recorded[2018], "error") == {"sign:delta_r", "definition:az_imu"}
    assert named(as_recorded[2019], "error") == {
        "sign:delta_r",
        "sign:delta_a",
    }  # no accelerations in this file
    assert named(as_recorded[2020], "error") == {
        "sign:delta_r",
        "sign:delta_a",
        "definition:az_imu",
        "sign:F_column",
    }
    text = finding(as_recorded[2018], "definition:az_imu").text
    assert "load factor minus one, positive up, not the specific force" in text
    assert (
        'az_imu = { column = "Ahrs1_bNormAcc", sign = -1, offset = "-1 g" }'
        in finding(as_recorded[2020], "definition:az_imu").remedy
    )


def test_mapped_flights_are_sound(as_mapped):
    assert named(as_mapped[2018], "error", "warning") == set()
    assert named(as_mapped[2019], "error", "warning") == set()
    assert named(as_mapped[2020], "error", "warning") == {
        "sign:F_column",
        "stuck:column",
    }  # added here, without sign


def test_column_position_is_dead(as_mapped):
    """README: column_Se looks unreliable (nearly constant)."""
    assert (
        "delta_e moves and column does not go with it"
        in finding(as_mapped[2020], "stuck:column").text
    )


@pytest.mark.parametrize("year", FILES)
def test_pitch_rate_scale(as_mapped, year):
    """README: theta_dot = 0.986 ... 0.993 (q cos phi - r sin phi), R2 0.999; phi_dot slope
    0.999.
    """
    table = as_mapped[year].kinematics.set_index("relation")
    assert 0.9855 <= table.loc["theta_rate", "slope"] <= 0.9945
    assert table.loc["theta_rate", "correlation"] ** 2 == pytest.approx(0.999, abs=1e-3)
    assert table.loc["phi_rate", "slope"] == pytest.approx(0.999, abs=0.004)


def test_pitch_rate_scale_is_named_where_it_is_certain(as_mapped):
    assert "scale:theta" in named(as_mapped[2018], "note")


@pytest.mark.parametrize("year", [2018, 2020])
def test_climb_rate(as_mapped, year):
    """README: altRate slope 0.994 against d(alt)/dt, bias -0.04 m/s."""
    row = as_mapped[year].kinematics.set_index("relation").loc["climb_rate"]
    assert row["offset"] == pytest.approx(-0.04, abs=0.005)
    assert row["slope"] == pytest.approx(0.994, abs=0.01)


def test_upwash_and_offset_of_the_vane(as_mapped):
    """README: in level flight vane = 1.08 ... 1.13 (theta - gamma) + 0.4 ... 0.9 deg; whole flights
    give a little less slope.
    """
    for year in FILES:
        row = as_mapped[year].kinematics.set_index("relation").loc["vane"]
        assert 1.0 < row["slope"] < 1.15
        assert 0.4 * DEGREE < row["offset"] < 1.6 * DEGREE
    assert "alpha_vane shows 1.06" in finding(as_mapped[2018], "scale:alpha_vane").text


def test_vane_at_low_speed(as_mapped):
    """README: meaningless below about 60 kt."""
    for year in FILES:
        assert 10.0 < finding(as_mapped[year], "minimum_speed:alpha_vane").evidence["speed"] <= 31.0


def test_slow_temperature_and_rudder_bias(as_mapped):
    """README: slow channels have less bandwidth than 10 Hz; the rudder has a bias of -1 to -1.6
    deg, in the recorder's sign.
    """
    assert "coarse:temperature" in named(as_mapped[2018], "note") & named(as_mapped[2020], "note")
    for year in (2018, 2019):
        assert (
            1.0 * DEGREE
            < finding(as_mapped[year], "offset:delta_r").evidence["offset"]
            < 1.6 * DEGREE
        )


def test_what_was_not_recorded(as_mapped):
    assert set(finding(as_mapped[2018], "absent:psi").channels) >= {"psi", "beta_vane", "vn"}


def test_true_airspeed_is_mach_times_sound(as_mapped):
    """README: TAS = M sqrt(1.4 R SAT) to 0.016 %."""
    for year in (2018, 2020):
        row = as_mapped[year].kinematics.set_index("relation").loc["mach"]
        assert row["slope"] == pytest.approx(1.0, abs=5e-4)


def test_every_surface_is_answered(as_mapped):
    for quality in as_mapped.values():
        assert list(quality.answers["surface"]) == ["delta_e", "delta_a", "delta_r"]
        assert (quality.answers["ratio"] < -10.0).all()
