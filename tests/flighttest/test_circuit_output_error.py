"""Output error on the control circuit: integration, inputs without noise, and estimates of circuits
whose motion is simulated here.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.submodels.control_loading import identification, simulation
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses import circuit_fit
from flighttest.submodels.control_loading.responses.free_response import find_windows
from flighttest.submodels.control_loading.responses.friction_models import join_models
from flighttest.submodels.control_loading.responses.quiet_inputs import quiet_lines
from flighttest.submodels.control_loading.responses.window_response import FRICTION_RATE
from flighttest.submodels.control_loading.simulation import simulate_linkages

TRUTH = {
    "mass": 6.0,
    "damping": 30.0,
    "friction": 9.0,
    "preload": 0.0,
    "stiffness": 0.0,
    "rigging": 0.0,
}
CABLE = {
    "inertia": 0.5,
    "hinge_friction": 3.0,
    "hinge_damping": 1.2,
    "cable_stiffness": 31000.0,
    "cable_damping": 50.0,
}
GEARING = -1.8


def linkage(constants: dict, force: np.ndarray, moment: float, step: float, edges=None):
    """Return travel and deflection of one linkage under a force and a hinge moment slope."""
    count = len(force)
    H = np.zeros((count, 2, 1))
    H[:, 1, 0] = moment
    return simulate_linkages(
        {name: np.array([value]) for name, value in constants.items()},
        GEARING,
        (np.zeros(1), np.zeros(1)),
        force[:, None],
        H,
        step,
        edges,
    )


@pytest.mark.nightly
def test_motion_converges_with_the_square_of_the_sub_step(monkeypatch):
    # A cable damper between both ends: the old velocity of one end would act as a mass of D h / 2.
    time = np.arange(0.0, 0.6, 0.01)
    force = np.interp(time, [0.05, 0.15, 0.35, 0.45], [0.0, 90.0, 90.0, 0.0])
    motion = []
    for longest in (1e-3, 5e-4, 1e-4):
        monkeypatch.setattr(simulation, "LONGEST_STEP", longest)
        motion.append(linkage(TRUTH | CABLE, force, -700.0, 0.01)[0][:, 0])
    errors = [np.abs(s - motion[-1]).max() for s in motion[:2]]
    assert errors[0] < 1e-4 * np.ptp(motion[-1])
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
def test_a_jump_between_two_samples_has_the_impulse_of_its_time(part):
    force = np.zeros(12)
    force[4:] = 60.0
    edges = np.full((12, 1), np.nan)
    edges[3] = part
    free = TRUTH | {"friction": 0.0, "damping": 0.0}
    s, _ = linkage(free, force, 0.0, 0.01, edges)
    # The force acts from part of a step before sample 4.
    acts = 0.01 * (np.arange(12) - 4 + part)
    exact = 0.5 * 60.0 / free["mass"] * np.maximum(acts, 0.0) ** 2
    assert s[:, 0] == pytest.approx(exact, abs=2e-3 * exact.max())


def test_inputs_become_lines_and_keep_their_jumps():
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 6.0, 0.01)
    true = np.where(time < 2.0, 0.0, np.where(time < 4.0, 80.0, 0.0))
    quiet, sizes = quiet_lines(true + rng.normal(0.0, 0.6, len(time)), 0.6)
    assert np.abs(quiet - true).max() < 0.25
    assert sizes.min() > 100
    wavy = 30.0 * np.sin(9.0 * time) + rng.normal(0.0, 0.1, len(time))
    kept, sizes = quiet_lines(wavy, 0.1)
    assert np.abs(kept - wavy).max() < 1.0  # not a line: as recorded, or within its noise


RATE, NOISE = 100.0, {"F_column": 0.5, "column": 5e-5, "delta_e": 1.5e-4}


def column_record(force, qbar: float, rng: np.random.Generator | None) -> xr.Dataset:
    """Return a record of a column with Ch_e = -0.29 delta_e; `force` over time in fine steps."""
    fine, every = 2e-3, round(1.0 / RATE / 2e-3)
    time = np.arange(0.0, 4.0 + 0.5 * fine, fine)
    F = np.array([force(t) for t in time])
    s, delta = linkage(TRUTH, F, -0.29 * qbar * 2.2 * 0.33, fine)
    channels = {"F_column": F, "column": s[:, 0], "delta_e": delta[:, 0]}
    channels |= {name: np.full(len(time), 0.0) for name in ("alpha", "delta_t")}
    channels |= {"qbar": np.full(len(time), qbar), "nz": np.ones(len(time))}
    record = {}
    for name, x in channels.items():
        noise = 0.0 if rng is None else rng.normal(0.0, NOISE.get(name, 0.0), len(x[::every]))
        record[name] = ("time", x[::every] + noise)
    return xr.Dataset(record, {"time": time[::every]})


@pytest.fixture(scope="module")
def columns():
    """A circuit without a cable: sweeps and releases at two speeds."""
    rng = np.random.default_rng(11)
    loading = ControlLoading(
        "column",
        GEARING,
        2.2,
        0.33,
        "Ch_e = 1 + delta_e",
        ("offset", "friction", "damping", "mass"),
    )
    driven, free = [], []
    for qbar in (2500.0, 5000.0):
        driven.append(column_record(lambda t: 110.0 * np.sin(np.pi * t / 2.0), qbar, rng))
        for size in (90.0, -70.0):
            # Let go between two samples.
            free.append(
                column_record(
                    lambda t, size=size: size * min(t / 1.5, 1.0) if t < 2.004 else 0.0, qbar, rng
                )
            )
    return loading, driven, free


@pytest.mark.nightly
def test_output_error_finds_the_circuit_that_was_simulated(columns):
    loading, driven, free = columns
    fit = identify_control_loading(loading, driven, free, order=2, method="output error")
    regression = identify_control_loading(loading, driven, free, order=2, method="regression")
    for name in ("mass", "damping", "friction", "Ch_e: delta_e"):
        value, stderr = fit.value(name)
        true = TRUTH.get(name, -0.29)
        assert abs(value - true) < 3.5 * stderr
        assert stderr < 0.02 * abs(true)
    # Derivatives of noise are not needed: the mass is several times as accurate.
    assert fit.value("mass")[1] < 0.5 * regression.value("mass")[1]
    # The hand of these records has no error proportional to the rate.
    value, stderr = fit.response.hand_damping
    assert abs(value) < 3.5 * stderr
    assert "output error of 6 windows of free motion" in fit.report()
    assert 0.8 < fit.response.rms["travel"] < 1.3
    assert fit.remarks == []


@pytest.fixture
def one_search(monkeypatch):
    """Friction by the rate alone."""

    def fit(*records):
        return join_models({FRICTION_RATE: [circuit_fit.fit_circuit(*records)]})

    monkeypatch.setattr(identification, "fit_friction_models", fit)


@pytest.mark.slow
@pytest.mark.usefixtures("one_search")
def test_regressions_replace_an_output_error_that_did_not_converge(columns, monkeypatch):
    loading, driven, free = columns
    monkeypatch.setattr(circuit_fit, "_ITERATIONS", 1)
    output_error = identify_control_loading(loading, driven, free, order=2, method="output error")
    regression = identify_control_loading(loading, driven, free, order=2, method="regression")
    best = identify_control_loading(loading, driven, free, order=2)
    assert not output_error.has_converged
    assert best.response is None
    assert any("the result is that of the regressions" in one.text for one in best.remarks)
    for name in ("mass", "damping", "friction", "Ch_e: delta_e"):
        value, stderr = best.value(name)
        assert value == pytest.approx(regression.value(name)[0], rel=1e-9)
        # The standard error contains the difference of both methods.
        difference = output_error.value(name)[0] - regression.value(name)[0]
        assert stderr == pytest.approx(np.hypot(regression.value(name)[1], difference), rel=1e-6)


def test_windows_end_before_a_stop_and_methods_are_named(columns):
    loading, driven, free = columns
    whole = find_windows(loading, free[:1])
    reached = max(float(window.measured[:, 0].max() * window.scale[0]) for window in whole)
    cut = find_windows(loading, free[:1], (-0.2, 0.9 * reached))
    assert sum(len(window.time) for window in cut) < sum(len(window.time) for window in whole)
    with pytest.raises(IdentificationError, match="allowed: best, regression, output error"):
        identify_control_loading(loading, driven, free, method="guess")
