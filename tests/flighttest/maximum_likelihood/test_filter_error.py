"""Linear models: output error in frequency, filter error, and the turbulence that an open-loop fit
does not survive.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad_vec
from scipy.linalg import expm

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flighttest.maximum_likelihood.linear.state_space import (
    Matrices,
    Predictor,
    filter_innovations,
    innovation_slopes,
    make_predictor,
    solve_recursion,
    steady_filter,
)
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out

A = np.array([[-1.2, 0.98], [-6.0, -1.8]])
B = np.array([[-0.1], [-9.0]])
C = np.array([[1.0, 0.0], [0.0, 1.0], [7.3, 0.0]])
OUTPUTS, NOISE = ("alpha", "q", "nz"), np.array([2e-3, 2e-3, 0.02])
TRUTH = {"A[alpha,alpha]": -1.2, "A[q,alpha]": -6.0, "A[q,q]": -1.8, "B[q,delta_e]": -9.0}
STARTS = {"A[alpha,alpha]": -1.0, "A[q,alpha]": -5.0, "A[q,q]": -1.5, "B[q,delta_e]": -8.0}


@pytest.fixture(scope="module")
def model() -> flighttest.maximum_likelihood.LinearModel:
    names = {
        "state": ["alpha", "q"],
        "state_": ["alpha", "q"],
        "input": ["delta_e"],
        "output": list(OUTPUTS),
    }
    matrices = {
        "A": (("state", "state_"), A),
        "B": (("state", "input"), B),
        "C": (("output", "state_"), C),
        "D": (("output", "input"), np.zeros((3, 1))),
    }
    return flighttest.maximum_likelihood.linear_model(xr.Dataset(matrices, names))


def flight(seed, gust=0.0, duration=20.0, step=0.04, noise=1.0, late=0):
    """A record: elevator multistep linear between samples; `gust` disturbs both states as white
    noise; `late` samples of delay.
    """
    rng, fine = np.random.default_rng(seed), 10
    t = np.arange(0.0, duration + step / 2, step)
    u = 0.03 * np.interp(
        t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0]
    ) + 0.01 * np.sin(5.0 * t) * (t < 15)
    seen = np.interp(t - late * step, t, u)
    h = step / fine
    F = expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2)) @ B[:, 0]
    x, states = np.zeros(2), []
    for k in range((len(t) - 1) * fine + 1):
        if k % fine == 0:
            states.append(x)
        x = (
            F @ x
            + G * np.interp((k + 0.5) * h, t, seen)
            + gust * np.sqrt(h) * np.array([0.02, 0.03]) * rng.standard_normal(2)
        )
    y = np.array(states) @ C.T + noise * NOISE * rng.standard_normal((len(t), 3))
    return xr.Dataset(
        {"delta_e": ("time", u)} | {name: ("time", y[:, k]) for k, name in enumerate(OUTPUTS)},
        {"time": t},
    )


def errors(fit, against="stderr"):
    e = fit.estimates.sel(parameter=list(TRUTH))
    return (e["estimate"].values - np.array(list(TRUTH.values()))) / e[against].values


def test_frequency_and_time_agree_on_one_record(model):
    record = flight(1)
    time = flighttest.maximum_likelihood.filter_error(model, record, STARTS)
    frequency = flighttest.maximum_likelihood.frequency_output_error(
        model, record, STARTS, band=(0.05, 4.0)
    )
    for fit in (time, frequency):
        assert fit.estimates.attrs["converged"] == 1
        assert np.abs(errors(fit)).max() < 3.0
    assert np.allclose(
        errors(time), errors(frequency), atol=1.0
    )  # the band leaves out the noise above 4 Hz, and little else
    ratio = frequency.estimates["stderr_white"].sel(parameter=list(TRUTH)) / time.estimates[
        "stderr_white"
    ].sel(parameter=list(TRUTH))
    assert ((ratio > 0.8) & (ratio < 1.3)).all()


def test_constants_and_the_end_of_the_record_do_not_matter_in_frequency(model):
    """Cut in mid-motion, with instruments that are off: the same estimates as for the whole
    motion.
    """
    record = flight(2, noise=0.0).isel(time=slice(40, 400))
    record["alpha"], record["delta_e"] = record["alpha"] + 0.1, record["delta_e"] + 0.02
    fit = flighttest.maximum_likelihood.frequency_output_error(
        model, record, STARTS, band=(0.1, 3.0)
    )
    found = fit.estimates["estimate"].sel(parameter=list(TRUTH)).values
    assert np.allclose(
        found, list(TRUTH.values()), rtol=2e-3
    )  # corners of the input between 25 samples per second
    assert list(fit.estimates["parameter"].values) == list(STARTS)


def test_a_delay_of_the_input_is_found_in_frequency(model):
    fit = flighttest.maximum_likelihood.frequency_output_error(
        model, flight(3, late=2), {**STARTS, "delay.delta_e": (0.0, np.inf, -0.2, 0.2)}
    )
    row = fit.estimates.sel(parameter="delay.delta_e")
    assert abs(row["estimate"] - 0.08) < 3.0 * row["stderr"]
    assert row["stderr"] < 0.005


@pytest.mark.nightly
def test_open_loop_in_turbulence_is_warned_of_and_the_filter_is_better(model):
    calm = {"process.alpha": 0.01, "process.q": 0.01}
    loop, filtered, wider = [], [], []
    for seed in range(8):
        record = flight(seed, gust=1.0)
        with pytest.warns(
            AeromatchWarning,
            match=r"turbulence or a missing term: residuals of alpha .* q "
            r".*flighttest\.maximum_likelihood\.filter_error",
        ):
            open_loop = flighttest.maximum_likelihood.filter_error(model, record, STARTS)
        assert "turbulence" in open_loop.report()
        fit = flighttest.maximum_likelihood.filter_error(model, record, {**STARTS, **calm})
        assert fit.warnings == ()
        loop.append(errors(open_loop, "stderr_white"))
        filtered.append(errors(fit))
        stderr = (
            one.estimates["stderr"].sel(parameter=list(TRUTH)).values for one in (open_loop, fit)
        )
        wider.append(np.divide(*stderr))
    assert np.sqrt(np.mean(np.square(filtered))) < 1.4
    assert (
        np.sqrt(np.mean(np.square(loop))) > 2.0
    )  # Cramer-Rao bounds of white residuals are not to be trusted
    assert np.median(wider) > 1.0  # and what is true of the open loop is wider


@pytest.mark.nightly
def test_the_filter_distinguishes_noise_from_gusts(model):
    fit = flighttest.maximum_likelihood.filter_error(
        model,
        flight(5, gust=1.0, duration=40.0),
        {**STARTS, "process.alpha": 0.01, "process.q": 0.01},
    )
    e = fit.estimates
    truth = {
        "process.alpha": 0.02,
        "process.q": 0.03,
        "noise.alpha": 2e-3,
        "noise.q": 2e-3,
        "noise.nz": 0.02,
    }
    for name, value in truth.items():
        row = e.sel(parameter=name)
        assert abs(row["estimate"] - value) < 3.5 * row["stderr"], name
    ratio = (e["stderr"] / e["stderr_white"]).sel(parameter=list(TRUTH))
    assert (ratio < 1.4).all()  # innovations are white


def test_instruments_starts_and_drift_in_time(model):
    record = flight(6).isel(time=slice(60, None))
    record["nz"] = record["nz"] + 1.0
    free = {"sensor.nz": 0.0, "init.alpha": 0.0, "init.q": 0.0, "drift.q": 0.0}
    fit = flighttest.maximum_likelihood.filter_error(model, record, STARTS | free)
    assert np.abs(errors(fit)).max() < 3.0
    assert abs(fit.parameters["sensor.nz"] - 1.0) < 0.02
    assert abs(fit.parameters["drift.q"]) < 3.0 * fit.estimates["stderr"].sel(parameter="drift.q")


@pytest.mark.slow
def test_several_records_have_their_own_offsets(model):
    records = [flight(seed, duration=12.0) for seed in (1, 2)]
    records[1]["alpha"] = records[1]["alpha"] + 0.05
    fit = flighttest.maximum_likelihood.filter_error(
        model, records, STARTS | {"sensor.alpha": Unknown(0.0, own=True)}
    )
    assert abs(fit.of_manoeuvre(2)["sensor.alpha"] - 0.05) < 2e-3
    assert abs(fit.of_manoeuvre(1)["sensor.alpha"]) < 2e-3
    both = flighttest.maximum_likelihood.frequency_output_error(model, records, STARTS)
    assert np.abs(errors(both)).max() < 3.0


def test_a_steady_filter_satisfies_its_equations():
    intensity, noise, step = np.array([0.02, 0.03]), NOISE, 0.02
    found = steady_filter(
        Matrices(A, B, C, np.zeros((3, 1))), np.array([0.1, 0.2]), intensity, noise, step
    )
    Q = quad_vec(lambda s: expm(A * s) @ np.diag(intensity**2) @ expm(A.T * s), 0.0, step)[0]
    R = np.diag(noise**2)
    P = np.zeros((2, 2))
    for _ in range(2000):
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        P = found.F @ (P - K @ C @ P) @ found.F.T + Q
    assert np.allclose(found.S, C @ P @ C.T + R, rtol=1e-9)
    assert np.allclose(found.K, K, rtol=1e-8)
    ramp = quad_vec(lambda s: expm(A * (step - s)) @ B * (s / step), 0.0, step)[0]
    assert np.allclose(found.G1, ramp, rtol=1e-9)
    assert np.allclose(found.g, np.linalg.solve(A, found.F - np.eye(2)) @ [0.1, 0.2], rtol=1e-9)


@pytest.mark.parametrize("states", [1, 2, 4])
def test_the_banded_system_is_the_recursion(states):
    rng = np.random.default_rng(states)
    M, drive, x = (
        0.5 * rng.standard_normal((states, states)),
        rng.standard_normal((3, 9, states)),
        rng.standard_normal((3, states)),
    )
    found = solve_recursion(M, drive, x)
    for k in range(9):
        np.testing.assert_allclose(found[:, k], x, atol=1e-13)
        x = x @ M.T + drive[:, k]
    np.testing.assert_allclose(found[:, 9], x, atol=1e-13)


def test_slopes_of_innovations_are_their_differences():
    """Every matrix of the filter, its start and the zeros of the instruments move at once, each
    unknown its own way.
    """
    rng = np.random.default_rng(3)
    u, z, width = rng.standard_normal((40, 1)), rng.standard_normal((40, 3)), np.array([2e-5, 4e-5])
    made = steady_filter(
        Matrices(A, B, C, np.array([[0.1], [0.0], [0.3]])),
        np.array([0.1, 0.2]),
        np.array([0.02, 0.03]),
        NOISE,
        0.04,
    )
    base = make_predictor(made, np.array([0.1, -0.2]), np.array([0.01, 0.0, 0.2]))
    up, down = [], []
    for size in width:
        moves = [0.5 * size * rng.standard_normal(part.shape) for part in base]
        up.append(Predictor(*(part + move for part, move in zip(base, moves))))
        down.append(Predictor(*(part - move for part, move in zip(base, moves))))
    stacked = [Predictor(*map(np.stack, zip(*runs))) for runs in (up, down)]
    found = innovation_slopes(base, *stacked, width, u, z)
    for k in range(2):
        expected = (filter_innovations(up[k], u, z) - filter_innovations(down[k], u, z)) / width[k]
        np.testing.assert_allclose(
            found[k], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max()
        )


def test_innovations_are_those_of_the_filter_step_by_step():
    rng = np.random.default_rng(4)
    u, z, offset, x = (
        rng.standard_normal((9, 1)),
        rng.standard_normal((9, 3)),
        np.array([0.1, 0.0, -0.2]),
        np.array([0.3, -0.1]),
    )
    made = steady_filter(
        Matrices(A, B, C, np.array([[0.1], [0.0], [0.3]])),
        np.array([0.1, 0.2]),
        np.array([0.02, 0.03]),
        NOISE,
        0.04,
    )
    found = filter_innovations(make_predictor(made, x, offset), u, z)
    for k in range(9):
        e = z[k] - made.C @ x - made.D @ u[k] - offset
        np.testing.assert_allclose(found[k], e, atol=1e-13)
        if k < 8:
            x = made.F @ (x + made.K @ e) + made.G0 @ u[k] + made.G1 @ u[k + 1] + made.g


def test_ties_move_elements_together(model):
    linear = xr.Dataset(
        {
            "A": (("state", "state_"), A),
            "B": (("state", "input"), B),
            "C": (("output", "state_"), C),
            "D": (("output", "input"), np.zeros((3, 1))),
        },
        {
            "state": ["alpha", "q"],
            "state_": ["alpha", "q"],
            "input": ["delta_e"],
            "output": list(OUTPUTS),
        },
    )
    tied = flighttest.maximum_likelihood.linear_model(
        linear, {"A[alpha,alpha]": {"C[nz,alpha]": -6.0}}
    )
    assert tied.at({"A[alpha,alpha]": -1.3}).C[2, 0] == pytest.approx(7.9)
    assert model.at({"A[alpha,alpha]": -1.3}).C[2, 0] == 7.3
    with pytest.raises(
        UnknownName, match=r"unknown element 'A\[alpha,alfa\]'; near it: A\[alpha,alpha\]"
    ):
        flighttest.maximum_likelihood.linear_model(linear, {"A[alpha,alfa]": {}})


def test_bad_requests_are_refused_by_name(model):
    record = flight(1, duration=5.0)
    with pytest.raises(UnknownName, match=r"unknown parameter 'A\[q,alfa\]'"):
        flighttest.maximum_likelihood.filter_error(model, record, {"A[q,alfa]": 1.0})
    with pytest.raises(UnknownName, match=r"unknown parameter 'process\.nz'"):
        flighttest.maximum_likelihood.filter_error(model, record, {"process.nz": 1.0})
    with pytest.raises(
        SchemaError, match=r"process\.q starts at zero or below; give a positive start"
    ):
        flighttest.maximum_likelihood.filter_error(model, record, STARTS | {"process.q": 0.0})
    with pytest.raises(IdentificationError, match=r"no multiple of 1/5 s in 0\.1 \.\.\. 0\.15 Hz"):
        flighttest.maximum_likelihood.frequency_output_error(
            model, record, STARTS, band=(0.1, 0.15)
        )
    with pytest.raises(IdentificationError, match="6 unknowns and fewer values of the spectra"):
        flighttest.maximum_likelihood.frequency_output_error(
            model, record, STARTS, band=(0.1, 0.25)
        )
    record["q"][7] = np.nan
    with pytest.raises(SchemaError, match="q is not finite in 1 samples"):
        flighttest.maximum_likelihood.filter_error(model, record, STARTS)
    with pytest.raises(UnknownName, match="unknown signal 'nz'"):
        flighttest.maximum_likelihood.filter_error(model, record.drop_vars("nz"), STARTS)


@pytest.mark.nightly
@pytest.mark.parametrize("step", [0.1, 0.25])
def test_measurement_noise_on_a_slow_recorder_is_no_turbulence(model, step):
    """Six records of white noise; a block of 0.08 s holds one sample and no noise inside."""
    for seed in range(6):
        assert (
            flighttest.maximum_likelihood.filter_error(
                model, flight(seed, duration=40.0, step=step), STARTS
            ).warnings
            == ()
        )


@pytest.mark.nightly
def test_innovations_of_a_wrong_filter_are_remarked_in_every_text(model, tmp_path):
    """Without process noise in turbulence they are coloured; with it they are white."""
    record = flight(3, gust=1.0)
    with pytest.warns(AeromatchWarning, match="turbulence or a missing term"):
        wrong = flighttest.maximum_likelihood.filter_error(model, record, STARTS)
    assert {r.term for r in wrong.remarks if r.kind == "coloured"} == set(OUTPUTS)
    assert "innovations of alpha are coloured" in wrong.report()
    assert "innovations of alpha are coloured" in str(wrong.as_dict()["remarks"])
    path = tmp_path / "fit.nc"
    flighttest.maximum_likelihood.save_output_error(wrong, path)
    assert flighttest.maximum_likelihood.open_output_error(path).report() == wrong.report()
    stirred = {"process.alpha": 0.02, "process.q": 0.03}
    right = flighttest.maximum_likelihood.filter_error(model, record, STARTS | stirred)
    assert not [r for r in right.remarks if r.kind == "coloured"]
    assert right.as_dict()["whiteness"]["q"]["portmanteau_probability"] > 0.01 / 3


def test_gusts_show_on_a_recorder_of_ten_samples_a_second(model):
    with pytest.warns(AeromatchWarning, match="turbulence or a missing term"):
        flighttest.maximum_likelihood.filter_error(
            model, flight(0, duration=40.0, step=0.1, gust=2.0), STARTS
        )


def gusty_flight(seed, time_constant=1.7, level=0.012, duration=20.0, step=0.04):
    """A record in a gust of first order that the vane sees: alpha of the record is that of the
    airflow.
    """
    rng, fine = np.random.default_rng(seed), 10
    h, t = step / fine, np.arange(0.0, duration + step / 2, step)
    u = 0.03 * np.interp(t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0])
    # states alpha, q, gust; the inertial motion responds to alpha + gust
    F = np.zeros((3, 3))
    F[:2, :2], F[:2, 2], F[2, 2] = A, A[:, 0], -1.0 / time_constant
    whole = expm(h * np.block([[F, np.r_[B[:, 0], 0.0][:, None]], [np.zeros((1, 4))]]))
    x, states = np.zeros(3), []
    for k in range((len(t) - 1) * fine + 1):
        if k % fine == 0:
            states.append(x)
        x = whole[:3, :3] @ x + whole[:3, 3] * np.interp((k + 0.5) * h, t, u)
        x[2] += level * np.sqrt(2.0 * h / time_constant) * rng.standard_normal()
    states = np.array(states)
    states[:, 0] += states[:, 2]
    y = states[:, :2] @ C.T + NOISE * rng.standard_normal((len(t), 3))
    return xr.Dataset(
        {"delta_e": ("time", u)} | {name: ("time", y[:, k]) for k, name in enumerate(OUTPUTS)},
        {"time": t},
    )


@pytest.mark.nightly
def test_all_starts_of_the_noise_end_at_one_maximum(model):
    """The search once ended up to 150 above it, with a step made small by damping alone."""
    record, costs = gusty_flight(1), []
    for alpha, q in ((0.005, 0.01), (0.02, 0.001), (0.0006, 0.0006), (0.04, 0.04)):
        wanted = {**STARTS, "process.alpha": alpha, "process.q": q}
        found = flighttest.maximum_likelihood.filter_error(model, record, wanted).estimates
        assert found.attrs["stop"] == "converged"
        costs.append(found.attrs["cost"])
    assert np.ptp(costs) < 0.01


class Valley:
    """A cost with a gradient that is wrong: nothing lowers it, though its slope is not zero."""

    def __init__(self, error):
        self.layout = lay_out({"a": Unknown(0.0, 1e9), "b": Unknown(0.0, 1e9)}, [{}])
        self.error = error

    def residuals(self, theta):
        return theta

    def scatter(self, residuals):
        return np.ones((1, 1))

    def cost(self, theta, residuals):
        return 0.5 * float(residuals @ residuals)

    def expect(self, steps, central):
        pass

    def slopes(self, theta, steps, central):
        return theta

    def normal(self, theta, residuals, slopes):
        return np.eye(2), -theta + np.array([self.error, 0.0])


@pytest.mark.parametrize(
    ("error", "stop"), [(0.0, "converged"), (0.25, "converged"), (5.0, "stalled")]
)
def test_a_search_that_cannot_move_has_converged_only_where_its_gradient_is_small(error, stop):
    found = maximise_likelihood(Valley(error), 20)
    assert found.stop == stop
    assert found.converged == (stop == "converged")
