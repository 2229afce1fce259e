"""Choice between models of friction: weights, and standard errors that contain the difference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.responses.circuit_fit import CircuitFit
from flighttest.submodels.control_loading.responses.friction_models import join_models
from flighttest.submodels.control_loading.responses.response_fit import ResponseFit
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
)

READINGS = 1000


def fit_of(width: str, mass: float, cost: float, at_bound: bool = False) -> CircuitFit:
    """Return a fit of a mass with a standard error of 0.1 and a width."""
    low = np.array([-np.inf, -9.0])
    likelihood: Any = SimpleNamespace(
        layout=SimpleNamespace(low=low), has_reading=[np.ones((READINGS // 2, 2), bool)]
    )
    maximum: Any = SimpleNamespace(cost=cost)
    return CircuitFit(
        names=("mass", width),
        theta=np.array([mass, -9.0 if at_bound else -7.0]),
        covariance=np.diag([0.01, 1.0]),
        rms={},
        maximum=maximum,
        likelihood=likelihood,
    )


def test_models_that_fit_equally_widen_the_standard_error():
    fits = {
        FRICTION_RATE: fit_of(FRICTION_RATE, 4.0, 500.0),
        BRISTLE_TRAVEL: fit_of(BRISTLE_TRAVEL, 5.0, 500.0),
    }
    fit, weights, widened = join_models(fits)
    assert weights == {FRICTION_RATE: 0.5, BRISTLE_TRAVEL: 0.5}
    assert widened == pytest.approx(np.sqrt(51.0))
    assert fit.value("mass")[1] == pytest.approx(np.sqrt(0.01 + 0.5))


def test_the_likelier_model_is_taken_as_it_is():
    fits = {
        FRICTION_RATE: fit_of(FRICTION_RATE, 4.0, 512.0),
        BRISTLE_TRAVEL: fit_of(BRISTLE_TRAVEL, 5.0, 500.0),
    }
    fit, weights, widened = join_models(fits)
    assert widened == pytest.approx(1.0, abs=1e-3)
    assert weights[BRISTLE_TRAVEL] == pytest.approx(1.0, abs=1e-5)
    assert fit.names[1] == BRISTLE_TRAVEL
    assert fit.value("mass") == (5.0, pytest.approx(0.1, rel=1e-3))


def test_coulomb_friction_has_no_width_as_an_unknown():
    fits = {
        FRICTION_RATE: fit_of(FRICTION_RATE, 4.0, 500.0, at_bound=True),
        BRISTLE_TRAVEL: fit_of(BRISTLE_TRAVEL, 5.0, 500.0),
    }
    weights = join_models(fits).weights
    assert weights[FRICTION_RATE] / weights[BRISTLE_TRAVEL] == pytest.approx(np.sqrt(READINGS))


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
