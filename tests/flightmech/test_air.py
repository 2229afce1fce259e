"""Atmosphere against the printed standard, airspeeds there and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightmech import air

# U.S. Standard Atmosphere, 1976, table I: geopotential height m, T K, p Pa (5 digits printed)
PRINTED = [
    (0.0, 288.150, 1.01325e5),
    (11000.0, 216.650, 2.26320e4),
    (20000.0, 216.650, 5.47487e3),
    (32000.0, 228.650, 8.68014e2),
    (47000.0, 270.650, 1.10905e2),
    (51000.0, 270.650, 6.69384e1),
    (71000.0, 214.650, 3.95639),
]


def geometric(H: float) -> float:
    return 6356766.0 * H / (6356766.0 - H)


@pytest.mark.parametrize(("H", "T", "p"), PRINTED)
def test_layer_bases(H, T, p):
    here = air.atmosphere(geometric(H))
    assert float(here.temperature) == pytest.approx(T, abs=5e-4)
    assert float(here.p_static) == pytest.approx(
        p, rel=2e-5
    )  # the printed pressures belong to R = 287.0531


def test_sea_level():
    here = air.atmosphere(0.0)
    assert float(here.rho) == pytest.approx(1.2250, abs=5e-5)
    assert float(here.a_sound) == pytest.approx(340.294, abs=5e-4)


@pytest.mark.parametrize(("delta_T", "qnh"), [(0.0, 101325.0), (20.0, 101325.0), (-15.0, 98000.0)])
def test_pressure_is_hydrostatic_also_off_standard(delta_T, qnh):
    """dp/dH = -rho g0 with the geopotential height, by central differences over 2 m."""
    H = np.array([100.0, 5000.0, 10990.0, 15000.0, 25000.0, 40000.0, 60000.0])
    up, here, down = (air.atmosphere(geometric(H + d), delta_T, qnh) for d in (1.0, 0.0, -1.0))
    np.testing.assert_allclose((up.p_static - down.p_static) / 2.0, -here.rho * 9.80665, rtol=1e-6)


def test_offset_and_sea_level_pressure():
    here = air.atmosphere(0.0, 10.0, 100000.0)
    assert (float(here.temperature), float(here.p_static)) == (298.15, 100000.0)


@pytest.mark.parametrize("qnh", [95000.0, 101325.0, 104000.0])
@pytest.mark.parametrize("delta_T", [-20.0, 0.0, 20.0])
def test_an_altimeter_set_to_the_qnh_shows_the_elevation(qnh, delta_T):
    """Height over the pressure qnh in the troposphere: p = (qnh^k - p0^k L H / T0)^(1/k), with
    k = R L / g.
    """
    elevation = 1500.0
    sea = air.sea_level_pressure(qnh, elevation, delta_T)
    p = float(air.atmosphere(elevation, delta_T, sea).p_static)
    k = 287.05287 * 0.0065 / 9.80665
    H = 6356766.0 * elevation / (6356766.0 + elevation)
    expected = (qnh**k - 101325.0**k * 0.0065 / 288.15 * H) ** (1.0 / k)
    assert p == pytest.approx(expected, rel=1e-10)
    assert float(air.pressure_altitude(p) - air.pressure_altitude(qnh)) == pytest.approx(H)


@given(st.floats(-1000.0, 70000.0))
def test_pressure_altitude_there_and_back(H):
    assert float(air.pressure_altitude(air.atmosphere(geometric(H)).p_static)) == pytest.approx(
        H, abs=1e-5
    )


@given(st.floats(0.0, 5.0), st.floats(100.0, 110000.0))
def test_mach_there_and_back(mach, p):
    assert float(air.mach_number(air.impact_pressure(mach, p), p)) == pytest.approx(
        mach, rel=1e-9, abs=1e-7
    )


def test_impact_pressure_is_smooth_at_mach_one():
    below, above = air.impact_pressure(np.array([1.0 - 1e-7, 1.0 + 1e-7]), 101325.0)
    assert above - below == pytest.approx(0.0, abs=0.05)
    assert float(air.impact_pressure(1.0, 1.0)) == pytest.approx(1.2**3.5 - 1.0, rel=1e-14)


def test_pitot_ratio_behind_a_shock():
    """Pitot over static pressure at Mach 2: 5.640, NACA Report 1135, table II."""
    assert float(air.impact_pressure(2.0, 1.0)) + 1.0 == pytest.approx(5.640, abs=5e-4)


def test_speeds_at_sea_level_are_one():
    V = np.array([30.0, 100.0, 250.0, 400.0])
    np.testing.assert_allclose(air.true_airspeed(V, 101325.0, 288.15), V, rtol=1e-12)
    np.testing.assert_allclose(air.equivalent_airspeed(V, air.RHO_SEA), V, rtol=1e-15)


def test_calibrated_speed_at_altitude():
    """300 kt at 30 000 ft, by the isentropic formula written out."""
    here = air.atmosphere(geometric(9144.0))
    V = air.true_airspeed(300.0 * 1852.0 / 3600.0, here.p_static, here.temperature)
    q_c = 101325.0 * ((1.0 + 0.2 * (154.33333333 / 340.29398803) ** 2) ** 3.5 - 1.0)
    mach = np.sqrt(5.0 * ((q_c / float(here.p_static) + 1.0) ** (2.0 / 7.0) - 1.0))
    assert float(V / here.a_sound) == pytest.approx(mach, rel=1e-9)
    assert float(
        air.calibrated_airspeed(air.impact_pressure(mach, here.p_static))
    ) == pytest.approx(154.33333333, rel=1e-9)
