"""Choice between models of friction: weights, and standard errors that contain the difference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses import friction_models
from flighttest.submodels.control_loading.responses.circuit_fit import WIDE, CircuitFit
from flighttest.submodels.control_loading.responses.friction_models import join_models
from flighttest.submodels.control_loading.responses.response_fit import ResponseFit
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
)

READINGS = 1000


def fit_of(
    width: str, mass: float, cost: float, at_bound: bool = False, converged: bool = True
) -> CircuitFit:
    """Return a fit of a mass with a standard error of 0.1 and a width."""
    low = np.array([-np.inf, -9.0])
    theta = np.array([mass, -9.0 if at_bound else -7.0])
    likelihood: Any = SimpleNamespace(
        layout=SimpleNamespace(low=low, names=("mass", width)),
        has_reading=[np.ones((READINGS // 2, 2), bool)],
    )
    maximum: Any = SimpleNamespace(cost=cost, is_proven=converged, theta=theta)
    return CircuitFit(
        names=("mass", width),
        theta=theta,
        covariance=np.diag([0.01, 1.0]),
        rms={},
        maximum=maximum,
        likelihood=likelihood,
    )


def test_models_that_fit_equally_widen_the_standard_error():
    fits = {
        FRICTION_RATE: [fit_of(FRICTION_RATE, 4.0, 500.0)],
        BRISTLE_TRAVEL: [fit_of(BRISTLE_TRAVEL, 5.0, 500.0)],
    }
    fit, weights, widened, *_ = join_models(fits)
    assert weights == {FRICTION_RATE: 0.5, BRISTLE_TRAVEL: 0.5}
    assert widened == pytest.approx(np.sqrt(51.0))
    assert fit.value("mass")[1] == pytest.approx(np.sqrt(0.01 + 0.5))


def test_the_likelier_model_is_taken_as_it_is():
    fits = {
        FRICTION_RATE: [fit_of(FRICTION_RATE, 4.0, 512.0)],
        BRISTLE_TRAVEL: [fit_of(BRISTLE_TRAVEL, 5.0, 500.0)],
    }
    fit, weights, widened, *_ = join_models(fits)
    assert widened == pytest.approx(1.0, abs=1e-3)
    assert weights[BRISTLE_TRAVEL] == pytest.approx(1.0, abs=1e-5)
    assert fit.names[1] == BRISTLE_TRAVEL
    assert fit.value("mass") == (5.0, pytest.approx(0.1, rel=1e-3))


def test_coulomb_friction_has_no_width_as_an_unknown():
    fits = {
        FRICTION_RATE: [fit_of(FRICTION_RATE, 4.0, 500.0, at_bound=True)],
        BRISTLE_TRAVEL: [fit_of(BRISTLE_TRAVEL, 5.0, 500.0)],
    }
    weights = join_models(fits).weights
    assert weights[FRICTION_RATE] / weights[BRISTLE_TRAVEL] == pytest.approx(np.sqrt(READINGS))


def test_maxima_that_are_nearly_as_high_widen_the_standard_error():
    """The weight of a model does not grow with the number of its maxima."""
    ends = [fit_of(BRISTLE_TRAVEL, mass, 500.0) for mass in (5.0, 5.4, 5.0 + 1e-6)]
    choice = join_models({BRISTLE_TRAVEL: ends, FRICTION_RATE: [fit_of(FRICTION_RATE, 5.0, 500.0)]})
    assert choice.maxima == 2
    assert choice.weights == {FRICTION_RATE: 0.5, BRISTLE_TRAVEL: 0.5}
    assert choice.fit.value("mass")[1] == pytest.approx(np.sqrt(0.01 + 0.5 * 0.5 * 0.4**2))
    assert choice.widened_by_maxima > 2.0
    assert choice.widened == pytest.approx(1.0)


def test_maxima_that_differ_by_a_width_alone_widen_no_constant():
    near, far = fit_of(BRISTLE_TRAVEL, 5.0, 500.0), fit_of(BRISTLE_TRAVEL, 5.01, 500.5)
    far.theta[1] = -3.0
    choice = join_models({BRISTLE_TRAVEL: [near, far]})
    assert choice.maxima == 2
    assert choice.widened_by_maxima == pytest.approx(1.0, abs=0.01)
    assert choice.fit.value(BRISTLE_TRAVEL)[1] > 2.0 * near.value(BRISTLE_TRAVEL)[1]


def test_the_best_of_several_ends_is_taken():
    worse, best = fit_of(BRISTLE_TRAVEL, 9.0, 520.0), fit_of(BRISTLE_TRAVEL, 5.0, 500.0)
    early = fit_of(FRICTION_RATE, 4.0, 530.0, converged=False)
    choice = join_models({BRISTLE_TRAVEL: [worse, best], FRICTION_RATE: [early]})
    assert choice.fit.value("mass") == (5.0, pytest.approx(0.1))
    assert choice.maxima == 1
    assert choice.unfinished == (FRICTION_RATE,)


def test_a_likely_model_is_searched_from_several_starts(monkeypatch):
    """From a narrow width, and from the end of the other model; one start does not find all."""
    begins = []

    def search(*given: Any) -> CircuitFit:
        width, begin = given[5], given[7] if len(given) > 7 else None
        begins.append((width, begin))
        cost = {FRICTION_RATE: 600.0, BRISTLE_TRAVEL: 500.0}[width]
        cost -= 2.0 * (begin is not None and begin.width < WIDE)
        return fit_of(width, 5.0 + 0.01 * cost, cost)

    monkeypatch.setattr(friction_models, "fit_circuit", search)
    nothing: Any = ()
    choice = friction_models.fit_friction_models(nothing, (), (), {"friction": 1.0}, {})
    assert choice.fit.maximum.cost == 498.0
    assert choice.maxima == 2
    assert [width for width, _ in begins].count(FRICTION_RATE) == 1
    assert begins[-1][1].values["mass"] == pytest.approx(11.0)


def test_a_preload_is_searched_from_a_wide_and_a_narrow_travel(monkeypatch):
    """Costs of pedals of the T-37: with one start, friction over a travel would be given up."""

    def search(*given: Any) -> CircuitFit:
        width, begin = given[5], given[7]
        cost = {FRICTION_RATE: 560.0, BRISTLE_TRAVEL: 585.0}[width]
        if width == BRISTLE_TRAVEL and begin.preload_width > WIDE:
            cost = 526.0
        return fit_of(width, 5.0, cost)

    monkeypatch.setattr(friction_models, "fit_circuit", search)
    nothing: Any = ()
    start = {"friction": 1.0, "preload": 1.0}
    choice = friction_models.fit_friction_models(nothing, (), (), start, {})
    assert choice.fit.maximum.cost == 526.0
    assert choice.weights[BRISTLE_TRAVEL] > 0.99


@pytest.mark.parametrize(("widened", "is_open"), [(1.5, True), (1.01, False)])
def test_a_choice_that_widens_a_standard_error_is_remarked(widened, is_open):
    fit = ResponseFit(
        convergence=Convergence(True, 10, 0.5),
        windows=4,
        rms={"travel": 1.0, "surface": 1.0},
        hand_damping=(0.0, 1.0),
        widths={},
        friction_models={FRICTION_RATE: 0.7, BRISTLE_TRAVEL: 0.3},
        widened=widened,
    )
    texts = [one.text for one in fit.remarks]
    assert any("by the rate 70%, over a travel 30%" in text for text in texts) == is_open


@pytest.mark.parametrize(("widened", "is_open"), [(1.5, True), (1.01, False)])
def test_maxima_that_widen_a_standard_error_are_remarked(widened, is_open):
    fit = ResponseFit(
        convergence=Convergence(True, 10, 0.5),
        windows=4,
        rms={"travel": 1.0, "surface": 1.0},
        hand_damping=(0.0, 1.0),
        widths={},
        friction_models={BRISTLE_TRAVEL: 1.0},
        maxima=3,
        widened_by_maxima=widened,
    )
    texts = [one.text for one in fit.remarks]
    assert any("3 maxima that are nearly equal" in text for text in texts) == is_open


@pytest.mark.parametrize(
    ("converged", "width", "is_maximum", "severities"),
    [
        (True, np.nan, True, []),
        (False, 0.35, True, ["note"]),
        (False, np.nan, False, ["warning"]),
    ],
)
def test_a_stationary_end_is_a_result_that_has_not_converged(
    converged, width, is_maximum, severities
):
    fit = ResponseFit(
        convergence=Convergence(converged, 17, 30.0),
        windows=4,
        rms={"travel": 1.0, "surface": 1.0},
        hand_damping=(0.0, 1.0),
        widths={},
        friction_models={BRISTLE_TRAVEL: 1.0},
        stationary_within=width,
    )
    assert fit.is_maximum == is_maximum
    assert [one.severity for one in fit.remarks] == severities
    assert all("not converged" in one.text for one in fit.remarks)
    assert any("within 0.35 standard errors" in one.text for one in fit.remarks) == (width > 0.0)


GEARING, S_HINGE, C_HINGE, RATE, FINE = -1.8, 2.2, 0.33, 100, 1e-4
TRUTH = {"mass": 6.0, "damping": 30.0, "friction": 9.0, "Ch_e: delta_e": -0.29}
BRISTLE = 3e-4


def record_with_bristles(qbar: float, size: float, rng: np.random.Generator) -> xr.Dataset:
    """Return a column with bristles that a hand moves slowly, or lets go (4 s).

    `size` is the force of a release, or 0 for a sweep; semi-implicit Euler with fine steps.
    """
    time = np.arange(0.0, 4.0 + 0.5 / RATE, 1.0 / RATE)
    s = v = y = 0.0
    spring = -TRUTH["Ch_e: delta_e"] * qbar * S_HINGE * C_HINGE * GEARING**2
    forces, travels = [], []
    for t in time:
        travels.append(s)
        for k in range(round(1.0 / RATE / FINE)):
            now = t + k * FINE
            F = 110.0 * np.sin(0.5 * np.pi * now)
            if size:
                # It lets go between two samples.
                F = size * min(now / 1.5, 1.0) if now < 2.004 else 0.0
            if not k:
                forces.append(F)
            y = (y + FINE * v / BRISTLE) / (1.0 + FINE * abs(v) / BRISTLE)
            push = F - spring * s - TRUTH["damping"] * v - TRUTH["friction"] * y
            v += FINE * push / TRUTH["mass"]
            s += FINE * v
    travel, count = np.array(travels), len(time)
    channels = {
        "F_column": np.array(forces) + rng.normal(0.0, 0.5, count),
        "column": travel + rng.normal(0.0, 5e-5, count),
        "delta_e": GEARING * travel + rng.normal(0.0, 1.5e-4, count),
        "qbar": np.full(count, qbar),
    }
    return xr.Dataset({name: ("time", x) for name, x in channels.items()}, {"time": time})


def column_records() -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return driven and free records of the column with bristles."""
    rng = np.random.default_rng(3)
    driven, free = [], []
    for qbar in (2500.0, 5000.0):
        driven.append(record_with_bristles(qbar, 0.0, rng))
        free += [record_with_bristles(qbar, size, rng) for size in (90.0, -70.0)]
    return driven, free


COLUMN = ControlLoading(
    "column",
    GEARING,
    S_HINGE,
    C_HINGE,
    "Ch_e = 1 + delta_e",
    ("offset", "friction", "damping", "mass"),
)


@pytest.mark.blas
@pytest.mark.nightly
def test_rounding_of_the_records_moves_no_estimate():
    """A control starts where friction stopped it, so the maximum lies at kinks of several windows.

    A search that passes them ends where rounding decides.
    """
    fits = []
    for size in (0.0, 1e-12):
        rng = np.random.default_rng(8)
        records = []
        for group in column_records():
            noisy = []
            for record in group:
                noise = rng.standard_normal((len(record.data_vars), record.sizes["time"]))
                channels = {}
                for (name, x), part in zip(record.data_vars.items(), noise):
                    channels[name] = x * (1.0 + size * part)
                noisy.append(record.assign(channels))
            records.append(noisy)
        fits.append(identify_control_loading(COLUMN, *records, order=2, method="output error"))
    plain, moved = fits
    assert plain.has_converged
    assert moved.has_converged
    for name in ("mass", "friction", "damping", "Ch_e: delta_e"):
        value, stderr = plain.value(name)
        assert abs(moved.value(name)[0] - value) < 1e-6 * stderr


@pytest.mark.nightly
def test_bristles_are_chosen_and_found():
    driven, free = column_records()
    fit = identify_control_loading(COLUMN, driven, free, order=2, method="output error")
    assert fit.response.friction_models[BRISTLE_TRAVEL] > 0.99
    value, stderr = fit.response.widths[BRISTLE_TRAVEL]
    assert abs(value - BRISTLE) < 3.5 * stderr
    assert stderr < 0.2 * BRISTLE
    for name, true in TRUTH.items():
        value, stderr = fit.value(name)
        assert abs(value - true) < 3.5 * stderr
        assert stderr < 0.03 * abs(true)
    assert "friction builds up as 1 - exp" in fit.report()
