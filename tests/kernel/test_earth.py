"""Spherical Earths (mode.earth 2 and 3) against Kepler's orbits in inertial space, and the places
on them.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq

import flightmech
from flightmech.terms import make_term

RADIUS, MU, RATE = 6371007.1809, 3.986004418e14, 7.292115e-5  # NASA/TM-2015-218675, table 73
PLACES = [
    (0.0, 0.0),
    (0.6, -2.1),
    (-1.2, 3.0),
    (0.3, np.pi - 1e-6),
    (np.pi / 2, 0.0),
    (-np.pi / 2, 0.0),
]


@pytest.fixture(scope="module")
def stone() -> flightmech.SimModel:
    """A body without aerodynamics."""
    body = flightmech.Aircraft("stone", 1.0, 1.0, 1.0, 10.0, 1.0, 1.0, 1.0)
    return flightmech.compile(body, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


def fly(sim, time, **parameters) -> xr.Dataset:
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    return flightmech.simulate(
        sim, xr.Dataset(coords={"time": np.asarray(time, float)}), given, step=0.05
    )


def local_axes(lat: float, lon: float) -> np.ndarray:
    """Return north, east and down in Earth axes, (3, 3)."""
    (s, c), (sl, cl) = (np.sin(lat), np.cos(lat)), (np.sin(lon), np.cos(lon))
    return np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])


def turned(v: np.ndarray, angle: float) -> np.ndarray:
    """Turn a vector about the Earth's axis."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def kepler(r: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return the place after a time on an ellipse: Kepler's equation for the change E of the
    eccentric anomaly, then f and g.
    """
    size, radial = np.linalg.norm(r), r @ v
    a = 1.0 / (2.0 / size - v @ v / MU)
    n, sigma = np.sqrt(MU / a**3), radial / np.sqrt(MU * a)

    def equation(E):
        return E - (1.0 - size / a) * np.sin(E) + sigma * (1.0 - np.cos(E)) - n * t

    E = brentq(equation, 0.0, 1.0, xtol=1e-16, rtol=1e-15)
    f = 1.0 - a / size * (1.0 - np.cos(E))
    g = t - (E - np.sin(E)) / n
    return f * r + g * v


@pytest.mark.parametrize("earth", [2.0, 3.0])
@pytest.mark.parametrize(("lat", "lon"), PLACES)
def test_place_is_found_again(stone, earth, lat, lon):
    y = fly(
        stone, [0.0], mode__earth=earth, init__lat=lat, init__lon=lon, init__h=12345.0, init__V=0.0
    ).isel(time=0)
    assert float(y.h) == pytest.approx(12345.0, abs=2e-9)  # rounding of 6.4e6 m
    assert float(y.lat) == pytest.approx(lat, abs=1e-15 * 4)
    if abs(lat) < 1.5:
        assert float(y.lon) == pytest.approx(lon, abs=1e-15 * 4)


def test_gravitation_is_inverse_square(stone):
    """At rest the specific force is zero and the climb rate begins with -mu/r^2; the rotating
    sphere takes the centrifugal part off.
    """
    for h in (0.0, 20000.0):
        r = RADIUS + h
        for earth, expected in ((2.0, MU / r**2), (3.0, MU / r**2 - RATE**2 * r)):
            y = fly(stone, [0.0, 0.01], mode__earth=earth, init__h=h, init__V=0.0)
            assert -float(y.hdot[1]) / 0.01 == pytest.approx(
                expected, rel=1e-9
            )  # 6e-9 m/s of the fall in 0.01 s changes 1e-9


def test_fall_on_the_sphere_at_rest(stone):
    """Time of a radial fall in closed form: t = sqrt(r0^3/2mu) (acos(sqrt x) + sqrt(x (1 - x))), x
    = r/r0.
    """
    r0, t = RADIUS + 30000.0, 75.0
    scale = np.sqrt(r0**3 / (2.0 * MU))
    x = brentq(
        lambda x: scale * (np.arccos(np.sqrt(x)) + np.sqrt(x * (1.0 - x))) - t,
        0.99,
        1.0 - 1e-9,
        xtol=1e-15,
    )
    y = fly(
        stone,
        [0.0, t],
        mode__earth=2.0,
        init__lat=0.7,
        init__lon=-1.0,
        init__h=30000.0,
        init__V=0.0,
    ).isel(time=1)
    assert float(y.h) == pytest.approx(r0 * x - RADIUS, abs=1e-6)
    assert float(y.lat) == pytest.approx(0.7, abs=1e-14)
    assert abs(float(y.ve)) < 1e-12


@pytest.mark.parametrize("earth", [2.0, 3.0])
@pytest.mark.parametrize(("lat", "lon"), PLACES[:4])
def test_flight_without_air_is_an_orbit(stone, earth, lat, lon):
    """800 m/s north-east and 300 m/s up for 200 s; on the rotating sphere the start has the speed
    of the ground too.
    """
    rate = RATE if earth == 3.0 else 0.0
    gamma = np.arctan2(300.0, 800.0)
    V = np.hypot(800.0, 300.0)
    start = {
        "init__lat": lat,
        "init__lon": lon,
        "init__h": 10000.0,
        "init__V": V,
        "init__theta": gamma,
        "init__psi": np.pi / 4,
    }
    y = fly(stone, [0.0, 200.0], mode__earth=earth, **start).isel(time=1)
    north, east, down = local_axes(lat, lon)
    r = -(RADIUS + 10000.0) * down
    v = 800.0 * np.sqrt(0.5) * (north + east) - 300.0 * down + np.cross([0.0, 0.0, rate], r)
    there = turned(kepler(r, v, 200.0), -rate * 200.0)
    size = np.linalg.norm(there)
    # 4000 steps of 6.4e6 m, rounded to 1e-9 m each; RK4 adds 1e-8 m
    assert float(y.h) == pytest.approx(size - RADIUS, abs=1e-5)
    assert float(y.lat) == pytest.approx(np.arcsin(there[2] / size), abs=1e-11)
    assert float(y.lon) == pytest.approx(np.arctan2(there[1], there[0]), abs=1e-11)


@pytest.mark.filterwarnings("ignore:init.h 4e")
def test_attitude_against_the_local_horizon_of_the_rotating_sphere(stone):
    """A body without rotation in space, over a fixed place on the equator for 600 s: the horizon
    turns below it by 15 deg/h.
    """
    y = fly(stone, [0.0, 600.0], mode__earth=3.0, init__h=4.0e6, init__V=0.0).isel(time=1)
    turn = RATE * 600.0 + float(y.lon)
    assert float(y.phi) == pytest.approx(-turn, abs=1e-12)
    assert float(y.theta) == pytest.approx(0.0, abs=1e-12)


def test_outputs_in_earth_axes_on_request(stone):
    """Without the request there are none; over a flat Earth the axes are north, east and down and
    do not turn.
    """
    assert not [name for name in stone.outputs if name.startswith(("earth.", "inertial."))]
    body = flightmech.Aircraft("stone", 1.0, 1.0, 1.0, 10.0, 1.0, 1.0, 1.0, earth_outputs=True)
    sim = flightmech.compile(body, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))
    y = fly(sim, [0.0, 2.0], init__V=50.0, init__h=1000.0, init__psi=0.3, mode__earth=0.0)
    np.testing.assert_allclose(
        [y[f"earth.v{axis}"][-1] for axis in "xyz"],
        [y[name][-1] for name in ("vn", "ve", "vd")],
        rtol=1e-14,
    )
    assert float(y["earth.z"][-1]) == -float(y["h"][-1])
    for axis in ("x", "y", "z", "vx", "vy", "vz"):
        assert (y[f"inertial.{axis}"] == y[f"earth.{axis}"]).all()
    np.testing.assert_allclose(y["gravitation"], 9.80665, rtol=1e-15)
