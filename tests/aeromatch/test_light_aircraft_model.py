"""The simulated aeroplane of the C182 example: the sign of the moment of its turning propeller."""

import importlib.util

import numpy as np
import pytest

from aeromatch.cli.actions.examples import example_folder

pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")


def load_aircraft():
    """Load the aeroplane of the recordings with the function of the example."""
    file = example_folder("c182") / "jsbsim_c182.py"
    spec = importlib.util.spec_from_file_location("jsbsim_c182", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.load_aircraft()


def fly_with_rates(fdm, q, r):
    """Return moments of the propeller about y and z, rates q and r, and angular momentum."""
    start = {"h-sl-ft": 5000.0, "vc-kts": 100.0, "q-rad_sec": q, "r-rad_sec": r}
    for name, value in start.items():
        fdm["ic/" + name] = value
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    for _ in range(4):
        fdm.run()
    inertia = 1.67  # of the propeller [slug ft2]
    momentum = inertia * fdm["propulsion/engine/propeller-rpm"] * np.pi / 30.0
    names = (
        "moments/m-prop-lbsft",
        "moments/n-prop-lbsft",
        "velocities/q-rad_sec",
        "velocities/r-rad_sec",
    )
    return np.array([fdm[name] for name in names]), momentum


def test_a_turning_propeller_acts_with_minus_omega_cross_its_momentum():
    # With H along +x, of a propeller that turns clockwise seen from behind, -omega x (H, 0, 0) is
    # (0, -r H, +q H).
    fdm = load_aircraft()
    steady, momentum = fly_with_rates(fdm, 0.0, 0.0)
    pitching, _ = fly_with_rates(fdm, 0.2, 0.0)
    yawing, _ = fly_with_rates(fdm, 0.0, 0.2)
    assert momentum > 300.0
    dq = pitching[2] - steady[2]
    dr = yawing[3] - steady[3]
    # The flow at the hub changes with the rates too, hence the tolerance.
    assert pitching[1] - steady[1] == pytest.approx(dq * momentum, rel=0.05)
    assert yawing[0] - steady[0] == pytest.approx(-dr * momentum, rel=0.05)
