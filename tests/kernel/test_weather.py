"""Wind over height, Dryden turbulence, discrete gust: numbers by hand, a NumPy counterpart, spectra
against MIL-F-8785C.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from scipy import linalg, signal, stats

import flightmech
from flightmech.errors import SimulationError
from flightmech.terms import make_term

FT, DEG = 0.3048, np.pi / 180.0
SPAN = 10.3
GUSTS = [f"air.gust_{axis}" for axis in "uvwpqr"]
WINDS = ["air.wind_n", "air.wind_e", "air.wind_d"]
STEADY = {"mode.earth": 0.0, "init.V": 80.0, "turbulence.mode": 1.0}
GIVEN = {
    **STEADY,
    "turbulence.V": 80.0,
    **{
        f"turbulence.sigma_{axis}": sigma
        for axis, sigma in zip("uvw", (1.5, 2.0, 1.0), strict=True)
    },
    **{
        f"turbulence.L_{axis}": length
        for axis, length in zip("uvw", (50.0, 60.0, 40.0), strict=True)
    },
}


@pytest.fixture(scope="module")
def probe() -> flightmech.SimModel:
    """A body without aerodynamics: what the air does changes neither its speed nor its attitude."""
    body = flightmech.Aircraft("probe", 17.0, 1.67, SPAN, 2300.0, 10800.0, 8100.0, 15100.0)
    return flightmech.compile(body, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


def fly(sim: flightmech.SimModel, time, parameters, step: float = 0.01, **inputs) -> xr.Dataset:
    columns = {
        name: ("time", np.broadcast_to(values, np.shape(time))) for name, values in inputs.items()
    }
    return flightmech.simulate(
        sim, xr.Dataset(columns, {"time": np.asarray(time, float)}), parameters, step=step
    )


def gusts(run: xr.Dataset) -> np.ndarray:
    """u, v, w [m/s], p, q, r [rad/s]; (time, 6)."""
    return np.stack([run[name].values for name in GUSTS], axis=1)


def wind(sim: flightmech.SimModel, **parameters: float) -> np.ndarray:
    """Return n, e, d at the aircraft."""
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    run = fly(sim, [0.0], {"mode.earth": 0.0, "init.V": 80.0, **given})
    return np.array([float(run[name][0]) for name in WINDS])


# ---- steady wind
# --------------------------------------------------------------------------------------------------


def test_linear_shear_by_hand(probe):
    found = wind(
        probe,
        wind_n=3.0,
        wind__shear_n=0.01,
        wind__shear_e=-0.02,
        wind__shear_d=0.001,
        wind__shear_h=200.0,
        init__h=700.0,
    )
    np.testing.assert_allclose(
        found, [3.0 + 0.01 * 500.0, -0.02 * 500.0, 0.001 * 500.0], rtol=1e-15
    )


@pytest.mark.parametrize(
    ("feet", "share"),
    [
        (20.0, 1.0),
        (100.0, np.log(100.0 / 0.15) / np.log(20.0 / 0.15)),  # 1.3289
        (3.0, np.log(3.0 / 0.15) / np.log(20.0 / 0.15)),  # 0.6123
        (0.0, np.log(3.0 / 0.15) / np.log(20.0 / 0.15)),
        (5000.0, np.log(1000.0 / 0.15) / np.log(20.0 / 0.15)),
    ],
)
def test_logarithmic_boundary_layer_by_hand(probe, feet, share):
    """10 m/s from the east at 20 ft over a runway at 300 m blow towards the west."""
    height = 300.0 + feet * FT
    found = wind(
        probe, wind__W20=10.0, wind__from=90.0 * DEG, env__runway_elevation=300.0, init__h=height
    )
    np.testing.assert_allclose(
        found, [0.0, -10.0 * share, 0.0], rtol=1e-12, atol=1e-14
    )  # rounding of the height in feet


@pytest.mark.parametrize(
    ("height", "expected"),
    [
        (0.0, (1.0, 2.0, 0.0)),
        (150.0, (2.0, 1.0, 0.25)),
        (300.0, (3.0 + 2.0 / 3.0, -2.0, 1.0 / 3.0)),
        (900.0, (7.0, -8.0, 0.0)),
    ],
)
def test_table_of_winds_by_hand(probe, height, expected):
    rows = [
        (100.0, 1.0, 2.0, 0.0),
        (200.0, 3.0, 0.0, 0.5),
        (500.0, 5.0, -6.0, 0.0),
        (600.0, 7.0, -8.0, 0.0),
        (50.0, 99.0, 99.0, 99.0),
    ]
    table = {
        f"wind__{column}{i}": value
        for i, row in enumerate(rows, 1)
        for column, value in zip("hned", row, strict=True)
    }
    np.testing.assert_allclose(
        wind(probe, wind__rows=4.0, init__h=height, **table), expected, rtol=1e-15, atol=1e-15
    )


def test_table_of_one_row_holds_everywhere(probe):
    for height in (0.0, 100.0, 5000.0):
        found = wind(
            probe, wind__rows=1.0, wind__h1=100.0, wind__n1=4.0, wind__e1=-1.0, init__h=height
        )
        np.testing.assert_array_equal(found, [4.0, -1.0, 0.0])


def test_the_aircraft_starts_in_the_wind_of_its_height(probe):
    run = fly(
        probe, [0.0], {**STEADY, "turbulence.mode": 0.0, "wind.shear_e": 0.02, "init.h": 1000.0}
    )
    np.testing.assert_allclose([run.V[0], run.vn[0], run.ve[0]], [80.0, 80.0, 20.0], rtol=1e-14)


# ---- turbulence: a counterpart
# ---------------------------------------------------------------------------------------------

WORD = 2**64 - 1


def mixed(z: int) -> int:
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & WORD
    return z ^ (z >> 31)


def normals(seed: int, point: int) -> np.ndarray:
    """Six deviates of a grid point: splitmix64 and Box-Muller."""
    golden = 0x9E3779B97F4A7C15
    key = mixed((seed + golden) & WORD)
    raw = [mixed((key + (6 * point + j + 1) * golden) & WORD) for j in range(6)]
    uniform = np.array([((word >> 11) + 1) * 2.0**-53 for word in raw])
    radius, angle = np.sqrt(-2.0 * np.log(uniform[0::2])), 2.0 * np.pi * uniform[1::2]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).ravel()


def step_of(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and Cholesky factor of the noise of x' = A x + B n over dt: Van Loan, IEEE Trans.
    AC-23 (1978).
    """
    n = len(A)
    big = linalg.expm(np.block([[-A, B @ B.T], [np.zeros((n, n)), A.T]]) * dt)
    transition = big[n:, n:].T
    Q = transition @ big[:n, n:]
    factor = np.zeros((n, n))
    factor[:, 0] = Q[:, 0] / np.sqrt(Q[0, 0])
    if n == 2:
        factor[1, 1] = np.sqrt(max(Q[1, 1] - factor[1, 0] ** 2, 0.0))
    return transition, factor


def low_altitude(h: float, W20: float) -> tuple[np.ndarray, np.ndarray]:
    """MIL-F-8785C figures 10 and 11; h [m] over ground, sigma [m/s], L [m]."""
    feet = min(max(h / FT, 10.0), 1000.0)
    base = 0.177 + 0.000823 * feet
    sigma_w = 0.1 * W20
    along = feet * FT / base**1.2
    return np.array([sigma_w / base**0.4, sigma_w / base**0.4, sigma_w]), np.array(
        [along, along, feet * FT]
    )


def counterpart(
    seed: int, V: np.ndarray, sigma: np.ndarray, L: np.ndarray, b: float, dt: float
) -> np.ndarray:
    """Gust u v w p q r at grid points 0 ... n; V (n,), sigma and L (n, 3) are those of the way to
    points 1 ... n.
    """
    a, v, w, roll = np.zeros(1), np.zeros(2), np.zeros(2), np.zeros(1)
    lag = {"v": 0.0, "w": 0.0}
    found = [np.zeros(6)]
    for k in range(len(V)):
        z = normals(seed, k + 1)

        def first(x, T, z):
            transition, factor = step_of(np.array([[-1.0 / T]]), np.array([[np.sqrt(2.0 / T)]]), dt)
            return transition @ x + factor @ z

        def second(x, T, z):
            """x'' form of the Dryden filter: a is of first order, c follows it with the same time
            constant.
            """
            transition, factor = step_of(
                np.array([[-1.0, 0.0], [1.0, -1.0]]) / T, np.array([[np.sqrt(2.0 / T)], [0.0]]), dt
            )
            return transition @ x + factor @ z

        a, v, w = (
            first(a, L[k, 0] / V[k], z[:1]),
            second(v, L[k, 1] / V[k], z[1:3]),
            second(w, L[k, 2] / V[k], z[3:5]),
        )
        roll = first(roll, 4.0 * b / (np.pi * V[k]), z[5:])
        shape = np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)]) / np.sqrt(2.0)
        gust = np.array([sigma[k, 0] * a[0], sigma[k, 1] * shape @ v, sigma[k, 2] * shape @ w])
        sigma_p = sigma[k, 2] * np.sqrt(
            0.8 * np.pi**2 / (8.0 * b * L[k, 2]) * (np.pi * L[k, 2] / (4.0 * b)) ** (1.0 / 3.0)
        )
        rates = []
        for name, i, n, sign in (("w", 2, 4.0, -1.0), ("v", 1, 3.0, 1.0)):
            T = n * b / (np.pi * V[k])
            rise = gust[i] - found[-1][i]
            # y - e of T e' = y - e under y linear in time
            lag[name] = lag[name] * np.exp(-dt / T) + rise * T / dt * (1.0 - np.exp(-dt / T))
            rates.append(sign * lag[name] / (V[k] * T))
        found.append(np.array([*gust, sigma_p * roll[0], *rates]))
    return np.array(found)


def test_history_is_that_of_the_counterpart(probe):
    time = 0.02 * np.arange(151)
    run = fly(probe, time, {**GIVEN, "turbulence.seed": 7.0})
    sigma, L = np.array([1.5, 2.0, 1.0]), np.array([50.0, 60.0, 40.0])
    expected = counterpart(
        7, np.full(150, 80.0), np.tile(sigma, (150, 1)), np.tile(L, (150, 1)), SPAN, 0.02
    )
    # the covariance of a step is 1e-7 of the process, which the matrix exponential gives to 1e-16:
    # relative 1e-9
    np.testing.assert_allclose(gusts(run), expected, rtol=1e-7, atol=1e-9)


def test_history_follows_height_and_airspeed_of_the_flight(probe):
    """A dive from 1300 to 60 ft over the runway: intensity and length of the height, speed of the
    moment.
    """
    dt, n = 0.02, 200
    runway, W20 = 100.0, 15.0
    start = {
        "init.h": runway + 1300.0 * FT,
        "init.theta": -80.0 * DEG,
        "init.V": 90.0,
        "env.runway_elevation": runway,
    }
    weather = {
        "turbulence.W20": W20,
        "turbulence.severity": 4.0,
        "turbulence.step": dt,
        "wind.shear_n": 0.005,
    }
    run = fly(probe, dt * np.arange(n + 1), {**STEADY, **start, **weather}, step=dt)
    h = run.h.values[:-1]
    air = np.stack([run[name].values for name in ("vn", "ve", "vd")], axis=1)[:-1]
    air[:, 0] -= 0.005 * h
    V = np.linalg.norm(air, axis=1)
    assert h[0] - runway > 1290.0 * FT  # begins between the two models
    assert h[-1] - runway < 320.0 * FT  # ends in the lower one
    sigma, L = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        low_sigma, low_L = low_altitude(h[k] - runway, W20)
        part = np.clip((h[k] - runway) / FT / 1000.0 - 1.0, 0.0, 1.0)
        aloft = FT * np.interp(
            h[k] / FT, [500.0, 1750.0, 3750.0], [8.6, 9.6, 10.6]
        )  # MIL-F-8785C figure 7, 1e-3
        sigma[k] = low_sigma + (aloft - low_sigma) * part
        L[k] = low_L + (1750.0 * FT - low_L) * part
    expected = counterpart(0, V, sigma, L, SPAN, dt)
    # horizontal along the heading, horizontal to the right, down, at nose 80 deg down; blended with
    # body axes above 1000 ft
    part = np.clip((run.h.values - runway) / FT / 1000.0 - 1.0, 0.0, 1.0)[:, None]
    c, s = np.cos(-80.0 * DEG), np.sin(-80.0 * DEG)
    to_body = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    expected[:, :3] = (1.0 - part) * (expected[:, :3] @ to_body.T) + part * expected[:, :3]
    np.testing.assert_allclose(gusts(run), expected, rtol=1e-7, atol=1e-8)


def test_intensity_and_length_of_the_specification():
    """MIL-F-8785C at 100 ft and 20 kt at 20 ft, by hand: base 0.2593."""
    sigma, L = low_altitude(100.0 * FT, 10.2889)
    np.testing.assert_allclose(sigma, [1.7653, 1.7653, 1.02889], rtol=1e-4)
    np.testing.assert_allclose(L / FT, [505.2, 505.2, 100.0], rtol=1e-3)


# ---- turbulence: statistics
# -----------------------------------------------------------------------------------------

DT = 0.02
COUNT = 2**16


@pytest.fixture(scope="module")
def long_history(probe) -> np.ndarray:
    run = fly(probe, DT * np.arange(COUNT + 1), {**GIVEN, "turbulence.seed": 20.0}, step=DT)
    return gusts(run)[1:]


def spectra(f: np.ndarray) -> np.ndarray:
    """One-sided spectra of u v w p q r over frequency [Hz], MIL-F-8785C sec. 3.7.1.2."""
    V, b = 80.0, SPAN
    W = 2.0 * np.pi * f / V  # spatial frequency

    def lateral(sigma, L):
        return sigma**2 * L / np.pi * (1.0 + 3.0 * (L * W) ** 2) / (1.0 + (L * W) ** 2) ** 2

    u = 1.5**2 * 2.0 * 50.0 / np.pi / (1.0 + (50.0 * W) ** 2)
    v, w = lateral(2.0, 60.0), lateral(1.0, 40.0)
    p = (
        1.0**2
        / 40.0
        * 0.8
        * (np.pi * 40.0 / (4.0 * b)) ** (1.0 / 3.0)
        / (1.0 + (4.0 * b * W / np.pi) ** 2)
    )
    q = W**2 / (1.0 + (4.0 * b * W / np.pi) ** 2) * w
    r = W**2 / (1.0 + (3.0 * b * W / np.pi) ** 2) * v
    return np.stack([u, v, w, p, q, r], axis=1) * (
        2.0 * np.pi / V
    )  # per spatial frequency to per Hz


def test_spectra(long_history):
    """Averages over bands; 64 segments without overlap give 2 x 64 degrees of freedom per
    independent frequency.

    A Hann window makes 1 of 1.5 frequencies independent.  Bounds: chi-square at 1e-4 on either side
    (36 comparisons), and 3 % for the sampling at 50 Hz, which folds 0.8 % into the spectrum at 2.5
    Hz and, for q and r, takes 2 % off by the line between points.
    """
    length = COUNT // 64
    f, found = signal.welch(long_history, 1.0 / DT, "hann", length, 0, detrend=False, axis=0)
    edges = [0.1, 0.2, 0.4, 0.7, 1.2, 1.8, 2.5]
    for low, high in pairwise(edges):
        band = (f >= low) & (f < high)
        ratio = (found[band] / spectra(f[band])).mean(axis=0)
        freedom = 2.0 * 64.0 * max(band.sum() / 1.5, 1.0)
        bounds = stats.chi2.ppf([1e-4, 1.0 - 1e-4], freedom) / freedom
        assert (ratio > bounds[0] * 0.97).all(), (low, ratio)
        assert (ratio < bounds[1] * 1.03).all(), (low, ratio)


def test_standard_deviations(long_history):
    """The variance of a mean over T = 1311 s of a square with correlation time t_c is 2 t_c/T; four
    standard errors.
    """
    sigma_p = 0.9540 * 1.0 / (40.0 * SPAN**2) ** (1.0 / 3.0)  # MIL-STD-1797A prints 0.95
    for i, (sigma, T) in enumerate(
        [
            (1.5, 50.0 / 80.0),
            (2.0, 60.0 / 80.0),
            (1.0, 40.0 / 80.0),
            (sigma_p, 4.0 * SPAN / (80.0 * np.pi)),
        ]
    ):
        error = 4.0 * np.sqrt(2.0 * T / (COUNT * DT))
        assert long_history[:, i].var() == pytest.approx(sigma**2, rel=error), i


def test_components_are_independent_but_for_the_rates_that_follow(long_history):
    """q follows w and r follows v; all others are uncorrelated, with an error of sqrt(t_c/T) =
    0.024; four of them.
    """
    found = np.corrcoef(long_history.T)
    for i, j in [
        (0, 1),
        (0, 2),
        (0, 3),
        (0, 4),
        (0, 5),
        (1, 2),
        (1, 3),
        (1, 4),
        (2, 3),
        (2, 5),
        (3, 4),
        (3, 5),
        (4, 5),
    ]:
        assert abs(found[i, j]) < 0.1, (i, j)


def test_pitch_and_yaw_of_the_air_have_the_sign_of_a_rotation(long_history):
    """Air that turns nose-up about the c.g. goes up ahead of it: a gust that grows downward on the
    way turns it nose-down.
    """
    low = signal.butter(
        4, 0.1, fs=1.0 / DT, output="sos"
    )  # 0.1 Hz: the filters of q and r lag by 6 degrees there
    slow = signal.sosfilt(low, long_history, axis=0)
    slope = np.gradient(slow, DT, axis=0)
    assert np.corrcoef(slow[:, 4], slope[:, 2])[0, 1] < -0.98
    assert np.corrcoef(slow[:, 5], slope[:, 1])[0, 1] > 0.98
    np.testing.assert_allclose(np.polyfit(slope[:, 2], slow[:, 4], 1)[0], -1.0 / 80.0, rtol=0.05)


# ---- turbulence: what it may depend on
# ------------------------------------------------------------------------------


def test_history_does_not_depend_on_the_steps(probe):
    """All of internal step, communication step and their pattern; linear between points of the
    grid, rounding of the times.
    """
    marks = np.arange(0.0, 3.01, 0.3)
    expected = gusts(fly(probe, marks, GIVEN, step=0.01))
    assert np.abs(expected[1:]).min(axis=0).max() > 0.0
    for step in (0.003, 0.02, 0.05, 0.3):
        np.testing.assert_allclose(
            gusts(fly(probe, marks, GIVEN, step=step)), expected, rtol=0.0, atol=1e-11
        )
    for times in (
        np.union1d(np.round(np.arange(0.0, 3.0, 1.0 / 60.0), 12), marks),
        np.union1d(np.random.default_rng(3).uniform(0.0, 3.0, 40), marks),
    ):
        found = gusts(fly(probe, times, GIVEN))[np.searchsorted(times, marks)]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)


def test_history_of_the_flight_depends_on_the_steps_as_the_flight_does(sim):
    """With airspeed and height of the flight: exact where steps end on grid points, and near where
    they do not.
    """
    calm = {"init.V": 90.0, "init.h": 400.0, "mode.trim": 1.0, "mode.engine": 2.0}
    rough = {"turbulence.mode": 1.0, "turbulence.W20": 15.0, "turbulence.severity": 4.0}
    marks = np.arange(0.0, 5.01, 0.5)
    expected = gusts(fly(sim, marks, {**calm, **rough}, step=0.01))
    scale = np.abs(expected).max(axis=0)
    found = gusts(fly(sim, np.arange(0.0, 5.01, 0.1), {**calm, **rough}, step=0.005))[::5]
    assert (
        np.abs(found - expected).max(axis=0) < 2e-5 * scale
    ).all()  # integration error of airspeed and attitude
    times = np.union1d(np.round(np.arange(0.0, 5.0, 1.0 / 60.0), 12), marks)
    found = gusts(fly(sim, times, {**calm, **rough}))[np.searchsorted(times, marks)]
    assert (np.abs(found - expected).max(axis=0) < 1e-2 * scale).all()  # airspeed up to 10 ms old


def test_points_are_joined_by_lines(probe):
    found = gusts(fly(probe, 0.005 * np.arange(401), GIVEN, step=0.005))
    points = found[::4]
    grid = 0.02 * np.arange(len(points))
    for i in range(6):
        np.testing.assert_allclose(
            found[:, i], np.interp(0.005 * np.arange(401), grid, points[:, i]), atol=1e-12
        )


def test_seed_makes_the_history(probe):
    time = np.arange(0.0, 2.01, 0.1)
    first, again, other = (
        gusts(fly(probe, time, {**GIVEN, "turbulence.seed": seed})) for seed in (11.0, 11.0, 12.0)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.5


def test_a_copy_goes_on_alike(probe, start):
    run = start(probe, **{name.replace(".", "__"): value for name, value in GIVEN.items()})
    u = np.zeros(len(probe.inputs))
    run.step(0.0, 1.234, u, u)
    counterpart_run = run.copy()
    run.step(1.234, 2.0, u, u)
    counterpart_run.step(1.234, 2.0, u, u)
    np.testing.assert_array_equal(run.outputs(), counterpart_run.outputs())


def test_start_is_calm_so_that_a_trim_is_not_disturbed(sim):
    calm = {"init.V": 90.0, "init.h": 400.0, "mode.trim": 1.0, "mode.engine": 2.0}
    rough = {**calm, "turbulence.mode": 1.0, "turbulence.W20": 15.0}
    a, b = fly(sim, [0.0, 1.0], calm), fly(sim, [0.0, 1.0], rough)
    for name in a:
        assert float(a[name][0]) == float(b[name][0]), name
    assert float(b["air.gust_w"][1]) != 0.0


def test_turbulence_that_is_off_changes_nothing(sim):
    given = {
        name: value
        for name, value in GIVEN.items()
        if name not in ("turbulence.mode", "mode.earth")
    }
    time = np.arange(0.0, 1.01, 0.1)
    a, b = fly(sim, time, {"init.V": 80.0}), fly(sim, time, {**given, "turbulence.mode": 0.0})
    for name in a:
        np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=name)


@pytest.mark.slow
def test_switched_on_and_off_under_way(probe, start):
    run = start(
        probe,
        **{name.replace(".", "__"): value for name, value in GIVEN.items()},
        turbulence__seed=4.0,
    )
    switch, u = probe.parameters.index("turbulence.mode"), np.zeros(len(probe.inputs))
    place = [probe.outputs.index(name) for name in GUSTS]
    run.set_parameter(switch, 0.0)
    run.step(0.0, 3600.0, u, u)
    assert not run.outputs()[place].any()
    run.set_parameter(switch, 1.0)
    run.step(3600.0, 2.0, u, u)
    assert np.abs(run.outputs()[place]).min() > 0.0
    run.set_parameter(switch, 0.0)
    run.step(3602.0, 0.01, u, u)
    assert not run.outputs()[place].any()


@pytest.mark.parametrize(
    "extreme",
    [
        {"turbulence.L_v": 1e-300, "turbulence.L_w": 1e-300},
        {"turbulence.V": 1e16},
        {"turbulence.V": 0.0},
        {"turbulence.step": 1.0},
        {"turbulence.seed": 2.0**53},
    ],
)
@pytest.mark.filterwarnings("ignore:turbulence.V 1e")
def test_extreme_values_give_finite_gusts(probe, extreme):
    assert np.isfinite(gusts(fly(probe, [0.0, 1.0, 2.0], {**GIVEN, **extreme}))).all()


def test_a_step_out_of_proportion_ends(probe):
    """30 years in one internal step are 5e10 points: those that the filters have forgotten are
    passed over.
    """
    run = fly(probe, [0.0, 1e9], {**GIVEN, "init.V": 0.0}, step=1e9)
    assert np.isfinite(gusts(run)).all()
    assert np.abs(gusts(run)[1]).min() > 0.0


# ---- into the aerodynamics
# ------------------------------------------------------------------------------------------


def test_gust_velocity_and_rates_reach_the_coefficients():
    """Alone in the model: CL on alpha, Cl on phat, Cm on qhat, Cn on rhat; the air's rates are
    taken from the body's.
    """
    body = flightmech.Aircraft("vane", 17.0, 1.67, SPAN, 2300.0, 10800.0, 8100.0, 15100.0)
    terms = {"/CL/alpha": make_term(5.0, regressors=["alpha"])}
    terms |= {
        f"/{c}/{rate}": make_term(-0.5, regressors=[rate])
        for c, rate in (("Cl", "phat"), ("Cm", "qhat"), ("Cn", "rhat"))
    }
    y = fly(
        flightmech.compile(body, xr.DataTree.from_dict(terms)), 0.1 * np.arange(31), GIVEN
    ).isel(time=slice(1, None))
    V, lengths = y.V.values, {"p": SPAN, "q": 1.67, "r": SPAN}
    for coefficient, rate in (("Cl", "p"), ("Cm", "q"), ("Cn", "r")):
        relative = y[rate].values - y[f"air.gust_{rate}"].values
        np.testing.assert_allclose(
            y[coefficient].values,
            -0.5 * relative * lengths[rate] / (2.0 * V),
            rtol=1e-12,
            atol=1e-15,
        )
    np.testing.assert_allclose(y.CL.values, 5.0 * np.arctan2(y.w, y.u), rtol=1e-12)
    ground = np.stack([y[name].values for name in ("vn", "ve", "vd")])
    air = ground - np.stack([y[name].values for name in WINDS])
    np.testing.assert_allclose(V, np.linalg.norm(air, axis=0), rtol=1e-12)


def test_axes_of_the_gust(probe):
    """Below 1000 ft along the heading and level, above 2000 ft along the body; the same
    deviates.
    """
    attitude = {"init.theta": 30.0 * DEG, "init.psi": 90.0 * DEG, "init.phi": 40.0 * DEG}
    low, high = (
        fly(probe, [0.0, 1.0], {**GIVEN, **attitude, "init.h": h}) for h in (100.0, 5000.0)
    )
    own = gusts(fly(probe, [0.0, 1.0], GIVEN))[1]
    np.testing.assert_allclose(gusts(high)[1], own, rtol=1e-12)
    found = [float(low[name][1]) for name in WINDS]
    np.testing.assert_allclose(found, [-own[1], own[0], own[2]], rtol=1e-12)
    np.testing.assert_allclose(gusts(low)[1, 3:], own[3:], rtol=1e-12)


# ---- discrete gust
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hold", [0.0, 1.0])
def test_one_minus_cosine_by_hand(probe, hold):
    """5 m/s up (w = -5) reached 2 s after 1 s, with 3 m/s from the left; pitch 20 deg turns them
    with the body.
    """
    given = {
        "gust.peak_w": -5.0,
        "gust.peak_v": 3.0,
        "gust.start": 1.0,
        "gust.rise": 2.0,
        "gust.hold": hold,
    }
    time = np.array([0.0, 1.0, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
    run = fly(probe, time, {"mode.earth": 0.0, "init.V": 80.0, "init.theta": 20.0 * DEG, **given})
    shape = np.array([0.0, 0.0, 0.5, 0.5 * (1.0 + np.sqrt(0.5)), 1.0, 0.5, 0.0, 0.0])
    if hold:
        shape[5:] = 1.0
    np.testing.assert_allclose(run["air.gust_w"], -5.0 * shape, atol=1e-12)
    np.testing.assert_allclose(run["air.gust_v"], 3.0 * shape, atol=1e-12)
    np.testing.assert_allclose(run["air.wind_d"], -5.0 * np.cos(20.0 * DEG) * shape, atol=1e-12)
    assert not run["air.gust_q"].any()  # a gust of the whole aircraft, without penetration


# ---- parameters
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"turbulence.mode": 2.0}, "turbulence.mode is 2; it must be 0 (none) or 1 (Dryden)"),
        ({"turbulence.seed": 1.5}, "turbulence.seed is 1.5; it must be a whole number"),
        ({"turbulence.seed": -1.0}, "turbulence.seed is -1"),
        ({"turbulence.step": 0.0}, "turbulence.step is 0; it must be between 0.001 and 1 s"),
        ({"turbulence.severity": 8.0}, "turbulence.severity is 8"),
        ({"turbulence.W20": -1.0}, "turbulence.W20 is -1; it must be zero or positive"),
        ({"turbulence.L_v": 0.0}, "turbulence.L_v is 0; it must be positive"),
        ({"gust.rise": 0.0}, "gust.rise is 0; it must be positive"),
        ({"gust.hold": 0.5}, "gust.hold is 0.5"),
        ({"wind.W20": -3.0}, "wind.W20 is -3"),
        ({"wind.roughness": 1.0}, "wind.roughness is 1; it must be between 0 and 0.9144 m"),
        ({"wind.rows": 9.0}, "wind.rows is 9; it must be a whole number from 0 to 8"),
        (
            {"wind.rows": 3.0, "wind.h2": 100.0, "wind.h3": 100.0},
            "wind.h3 is 100; it must be more than the height before it",
        ),
    ],
)
def test_values_without_meaning_are_refused(probe, parameters, text):
    with pytest.raises(SimulationError) as caught:
        fly(probe, [0.0], {"init.V": 80.0, **parameters})
    assert text in str(caught.value)
