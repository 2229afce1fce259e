"""The sign of Ixz: fast rolls show it, gentle ones do not, and nothing is reported where the
coupling that is known is not given back.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.inertia import product_findings


@dataclass
class Body:
    Ixx: float = 10826.0
    Iyy: float = 8135.0
    Izz: float = 15162.0
    Ixz: float = 1500.0


@cache
def rolling(amplitude, Ixz=1500.0, noise=5e-4, seed=0):
    """Return signals of a body with linear aerodynamics that aileron and elevator move at several
    frequencies.
    """
    body, step = Body(Ixz=Ixz), 0.01
    time = np.arange(0.0, 60.0, step)
    delta_a = amplitude * (np.sin(1.9 * time) + np.sin(3.1 * time + 1.0))
    delta_r = 0.3 * amplitude * np.sin(2.3 * time)
    delta_e = 0.02 * np.sin(2.7 * time + 0.4)
    inertia = np.array([[body.Ixx, 0.0, -Ixz], [0.0, body.Iyy, 0.0], [-Ixz, 0.0, body.Izz]])
    inverse = np.linalg.inv(inertia)
    states = np.zeros((len(time), 5))  # p q r alpha beta
    for k in range(len(time) - 1):
        p, q, r, alpha, beta = states[k]
        moments = np.array(
            [
                body.Ixx * (-3.0 * p + 0.8 * r - 4.0 * beta - 12.0 * delta_a[k]),
                body.Iyy * (-2.5 * q - 6.0 * alpha - 8.0 * delta_e[k]),
                body.Izz * (-0.1 * p - 0.7 * r + 4.0 * beta - 3.0 * delta_r[k]),
            ]
        )
        omega = np.array([p, q, r])
        turning = inverse @ (moments - np.cross(omega, inertia @ omega))
        states[k + 1] = states[k] + step * np.array(
            [*turning, q - 1.2 * alpha - p * beta, -r - 0.2 * beta + p * alpha]
        )
    rng = np.random.default_rng(seed)
    seen = states + noise * np.array([1.0, 1.0, 1.0, 0.5, 0.5]) * rng.standard_normal(states.shape)
    values = dict(zip(("p", "q", "r", "alpha_vane", "beta_vane"), seen[::5].T))
    values |= {"delta_a": delta_a[::5], "delta_r": delta_r[::5], "delta_e": delta_e[::5]}
    whole = np.ones(len(time[::5]), bool)
    return ResampledChannels(time[::5], values, {name: whole for name in values}, whole, 5 * step)


@pytest.mark.nightly
@pytest.mark.parametrize("Ixz", [1500.0, -1500.0])
def test_wrong_sign_in_fast_rolls(Ixz):
    signals = rolling(0.2, Ixz)
    assert product_findings(signals, Body(Ixz=Ixz)) == ([], "")
    (finding,), why = product_findings(signals, Body(Ixz=-Ixz))
    assert (finding.severity, finding.name, why) == ("error", "inertia:Ixz", "")
    assert finding.remedy == f'Ixz = "{Ixz:.10g} kg m2" in the aircraft file'
    assert finding.evidence["Ixz"] == pytest.approx(Ixz, rel=0.2)


@pytest.mark.slow
def test_not_checked():
    assert product_findings(rolling(0.2), Body(Ixz=0.0)) == ([], "")  # nothing is stated
    found, why = product_findings(rolling(0.005), Body(Ixz=-1500.0))
    assert found == []
    assert "shows Ixz to" in why
    found, why = product_findings(rolling(0.2), Body(Ixz=-1500.0, Iyy=3.0 * Body.Iyy))
    assert found == []
    assert "known to be" in why
    without = rolling(0.2).without(("alpha_vane",))
    assert product_findings(without, Body(Ixz=-1500.0)) == ([], "not recorded: alpha_vane")
