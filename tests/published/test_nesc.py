"""NASA/NESC 6-DOF check cases 1, 2, 3, 6, 7 and 9: NASA/TM-2015-218675, trajectories of tool 4.

Printed: values at 30 s, stated in the documentation of the check cases (ft, deg, ft/s, deg/s).
Trajectories: the published time histories at 0.1 s where ``../shared`` has them, else at 1 s from
``trajectories/``.  Figures of acceptance over the run: height 2e-3 ft, velocity 1e-4 ft/s, attitude
1e-6 deg, rates 1e-7 deg/s, with steps of 10 ms.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from nesc import records

import flightmech
from flightmech.terms import make_term

FOLDER = Path(__file__).parents[2] / ".." / "shared" / "data" / "flight" / "nesc_checkcases"
THINNED = Path(__file__).parent / "trajectories"
FT, DEG = 0.3048, np.pi / 180.0
SLUG, SLUG_FT2 = 14.593902937, 1.3558179483  # NASA/TM-2015-218675, as used by the check cases
HEIGHT, VELOCITY, ATTITUDE, RATE = 2e-3, 1e-4, 1e-6, 1e-7


@cache
def sphere(CD: float) -> flightmech.SimModel:
    inertia = 3.6 * SLUG_FT2
    body = flightmech.Aircraft(
        "sphere", 0.1963495 * FT**2, FT, FT, SLUG, inertia, inertia, inertia, earth_outputs=True
    )
    db = xr.DataTree.from_dict({"/CD/basic": make_term(CD)})
    db.attrs["force_axes"] = "wind"
    return flightmech.compile(body, db)


@cache
def brick(damping: float) -> flightmech.SimModel:
    """8 x 4 x 2.25 inch; the moments that tool 4 prints belong to 2/9 ft2, 1/3 ft and 2/3 ft, the
    report rounds them to 5 digits.
    """
    inertia = [x * SLUG_FT2 for x in (0.001894220, 0.006211019, 0.007194665)]
    body = flightmech.Aircraft(
        "brick",
        2.0 / 9.0 * FT**2,
        2.0 / 3.0 * FT,
        FT / 3.0,
        0.155404754 * SLUG,
        *inertia,
        earth_outputs=True,
    )
    terms = {
        f"/{c}/damping": make_term(-damping, regressors=[rate])
        for c, rate in (("Cl", "phat"), ("Cm", "qhat"), ("Cn", "rhat"))
    }
    return flightmech.compile(body, xr.DataTree.from_dict(terms))


DROP = {"init.V": 0.0, "init.h": 30000.0 * FT}
TUMBLE = {**DROP, "init.p": 10.0 * DEG, "init.q": 20.0 * DEG, "init.r": 30.0 * DEG}
CASES = {
    1: (lambda: sphere(0.0), DROP),
    2: (lambda: brick(0.0), TUMBLE),
    3: (lambda: brick(1.0), TUMBLE),
    6: (lambda: sphere(0.1), DROP),
    # at rest over the ground in a wind towards east, nose to the north: the air comes from the left
    7: (
        lambda: sphere(0.1),
        {**DROP, "init.V": 20.0 * FT, "init.beta": -90.0 * DEG, "wind_e": 20.0 * FT},
    ),
    9: (
        lambda: sphere(0.1),
        {
            "init.V": 1000.0 * np.sqrt(2.0) * FT,
            "init.h": 0.0,
            "init.alpha": -45.0 * DEG,
            "init.psi": 90.0 * DEG,
            "init.q": -0.00417807 * DEG,
        },
    ),
}


def fly(case: int, time: np.ndarray, **extra: float) -> xr.Dataset:
    model, parameters = CASES[case]
    return flightmech.simulate(
        model(), xr.Dataset(coords={"time": time}), {**parameters, **extra}, step=0.01
    )


def difference(found: np.ndarray, expected, wrap: bool = False) -> float:
    d = found - np.asarray(expected, float)
    return float(np.abs((d + 180.0) % 360.0 - 180.0 if wrap else d).max())


# at 30 s: h [ft], lon [deg], vE, vD [ft/s], roll, pitch, yaw [deg], p, q, r [deg/s]
PRINTED = {
    1: (
        15598.9043522,
        5.74552213287e-5,
        2.10101108617,
        960.293064507,
        -0.125399679189,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ),
    2: (
        15598.9043522,
        5.74552213287e-5,
        2.10101108617,
        960.293064507,
        -56.1513075938,
        -3.81965492189,
        -4.28935504226,
    )
    + (12.6183907757, -17.3974747619, 31.1195888868),
    6: (
        16284.443772,
        5.33798251362e-5,
        1.84293085603,
        864.010905567,
        -0.125395603792,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ),
    7: (
        16285.1612472,
        1.28541735128e-4,
        4.70837589978,
        863.966976848,
        -0.125470765702,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ),
    9: (
        10160.9897645,
        0.0616478507138,
        610.746581927,
        181.748229037,
        0.0,
        0.061647974681,
        90.0,
        0.0,
        -0.00417807,
        0.0,
    ),
}


@pytest.mark.parametrize("case", PRINTED)
def test_printed_values_at_30_s(case):
    h, lon, ve, vd, *rest = PRINTED[case]
    y = fly(case, np.array([0.0, 30.0])).isel(time=1)
    assert difference(y.h / FT, h) < HEIGHT
    assert difference(y.lon / DEG, lon) < 1e-8  # 4e-3 ft along the equator
    assert difference(y.ve / FT, ve) < VELOCITY
    assert difference(y.vd / FT, vd) < VELOCITY
    for name, value in zip(("phi", "theta", "psi"), rest[:3], strict=True):
        assert difference(y[name] / DEG, value, wrap=True) < ATTITUDE, name
    for name, value in zip("pqr", rest[3:], strict=True):
        assert difference(y[name] / DEG, value) < RATE, name


@pytest.mark.parametrize("case", [1, 2, 6, 7, 9])
def test_whole_trajectory(case):
    found, expected = both(case)
    largest = differences(found, expected)
    assert largest["height"] < HEIGHT
    assert largest["velocity"] < VELOCITY
    assert largest["attitude"] < ATTITUDE
    assert largest["rate"] < RATE


@pytest.mark.parametrize("case", [1, 2, 6, 7, 9])
def test_earth_axes_and_gravitation(case):
    """Inertial position and velocity and the gravitation of tool 4, to what the heights and
    velocities are held.

    A thousandth of a foot is 3e-9 ft/s2 of the gravitation.
    """
    found, expected = both(case)
    if "eiPosition_ft_X" not in expected:
        pytest.skip("the thinned trajectories lack these columns; ../shared has them")
    largest = records.differences(records.as_recorded(found), expected)
    largest = {
        name: value for name, value in largest.items() if name.startswith(("ei", "localGravity"))
    }
    assert len(largest) == 7
    for name, value in largest.items():
        assert value < (
            HEIGHT if "Position" in name else VELOCITY if "Velocity" in name else 1e-8
        ), name


def test_damped_brick():
    """Damping multiplies the density: tool 4 is 2.5e-7 thinner at 30 000 ft, which 30 s of tumbling
    turn into 4e-5 deg.

    With the density of tool 4 the attitude agrees to 1.5e-6 deg; the density of tool 4 is not a
    constant factor.
    """
    found, expected = both(3)
    largest = differences(found, expected)
    assert largest["height"] < HEIGHT
    assert largest["velocity"] < VELOCITY
    assert largest["attitude"] < 1e-4
    assert largest["rate"] < 1e-5
    same_density = differences(both(3, **{"env.qnh": 101325.0 * (1.0 - 2.5e-7)})[0], expected)
    assert same_density["attitude"] < 2e-6
    assert same_density["rate"] < 2e-7


def test_atmosphere_of_the_trajectories():
    found, expected = both(9)
    assert (
        difference(found.temperature * 1.8, expected["ambientTemperature_dgR"]) < 1e-5
    )  # follows the height difference
    density = found.rho.values / (SLUG / FT**3)
    assert np.abs(density / expected["airDensity_slug_ft3"] - 1.0).max() < 1e-6
    assert np.abs(found.mach.values / expected["mach"] - 1.0).max() < 1e-6


def both(case: int, **extra: float) -> tuple[xr.Dataset, dict[str, np.ndarray]]:
    """Our run and that of tool 4, at its times."""
    files = [*FOLDER.glob(f"Atmos_{case:02d}_*/*_sim_04.csv"), THINNED / f"case_{case:02d}.csv"]
    with files[0].open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    expected = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    return fly(case, expected["time"], **extra), expected


def differences(found: xr.Dataset, expected: dict[str, np.ndarray]) -> dict[str, float]:
    """Largest differences over the run. [ft, ft/s, deg, deg/s]"""
    velocity = zip(("vn", "ve", "vd"), "XYZ", strict=True)
    attitude = zip(("phi", "theta", "psi"), ("Roll", "Pitch", "Yaw"), strict=True)
    rates = zip("pqr", ("Roll", "Pitch", "Yaw"), strict=True)
    return {
        "height": difference(found.h / FT, expected["altitudeMsl_ft"]),
        "velocity": max(
            difference(found[a] / FT, expected[f"feVelocity_ft_s_{b}"]) for a, b in velocity
        ),
        "attitude": max(
            difference(found[a] / DEG, expected[f"eulerAngle_deg_{b}"], wrap=True)
            for a, b in attitude
        ),
        "rate": max(
            difference(found[a] / DEG, expected[f"bodyAngularRateWrtEi_deg_s_{b}"])
            for a, b in rates
        ),
    }


def test_ballistic_case_has_fourth_order():
    """Halving the step divides the error by 16; case 9, against steps of 5 ms, which are 2e-12 of
    the height.
    """
    model, parameters = CASES[9]
    inputs = xr.Dataset(coords={"time": [0.0, 30.0]})
    h = {
        step: float(flightmech.simulate(model(), inputs, parameters, step=step).h[-1])
        for step in (0.6, 0.3, 0.005)
    }
    assert (h[0.6] - h[0.005]) / (h[0.3] - h[0.005]) == pytest.approx(16.0, rel=0.2)


def test_height_of_the_ballistic_case_does_not_depend_on_longitude():
    time = np.linspace(0.0, 30.0, 31)
    here, there = fly(9, time), fly(9, time, **{"init.lon": 2.0})
    assert (
        np.abs(here.h.values - there.h.values).max() < 1e-7
    )  # rounding of 6.4e6 m over 3000 steps
