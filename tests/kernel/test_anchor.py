"""The later slopes of a step take their place on the Earth from its start: the step is that of four
whole derivatives.
"""

from __future__ import annotations

import numpy as np
import pytest


def whole_step(run, x: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """Classical Runge-Kutta on `Simulation.derivative`, which finds every place from the
    beginning.
    """
    k1 = run.derivative(x, u)
    k2 = run.derivative(x + 0.5 * h * k1, u)
    k3 = run.derivative(x + 0.5 * h * k2, u)
    k4 = run.derivative(x + h * k3, u)
    return x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@pytest.mark.parametrize("earth", [1, 2, 3])
@pytest.mark.parametrize("lat", [0.0, 0.8, -1.5707963])
@pytest.mark.parametrize("h", [0.01, 0.1, 1.0])
def test_a_step_is_that_of_whole_derivatives(sim, start, earth, lat, h):
    """Up to 110 m from the start, which is farther than the short way goes; 2e-9 m are two
    roundings of a position.
    """
    values = {
        "init__V": 110.0,
        "init__h": 3000.0,
        "init__lat": lat,
        "init__psi": 0.7,
        "init__gamma": 0.2,
        "mode__earth": earth,
    }
    run = start(sim, **values, mode__step=1.0, wind_n=8.0, wind_e=-5.0)
    u = np.zeros(len(sim.inputs))
    u[sim.inputs.index("wind_n")], u[sim.inputs.index("wind_e")] = 8.0, -5.0
    expected = whole_step(run.copy(), run.state, u, h)
    run.step(0.0, h, u, u)
    found = run.state
    assert np.abs(found[:3] - expected[:3]).max() < 2e-9
    assert np.abs(found[3:] - expected[3:]).max() < 1e-11  # 1e-12 m/s were seen
