"""Free motion of a circuit by the kernel: derivatives, order of the scheme, dry friction as a
limit.
"""

from __future__ import annotations

import numpy as np
import pytest

from flightmech.simulation.estimation.circuit_response import (
    CIRCUIT_CONSTANTS,
    DrivenCircuit,
    LinearInput,
)

from .test_circuit_output_error import CABLE, GEARING, TRUTH, linkage

STEP, SAMPLES, JUMP = 0.01, 60, 20
CONSTANTS = {
    "mass": 6.0,
    "damping": 30.0,
    "friction": 9.0,
    "aft_mass": 0.5 * GEARING**2,
    "aft_damping": 1.2 * GEARING**2,
    "aft_friction": 3.0 * abs(GEARING),
    "cable_stiffness": 31000.0,
    "cable_damping": 50.0,
    "preload": 5.0,
    "stiffness": 200.0,
    "rate_width": 2e-3,
    "place_width": 1e-3,
    "rigging": 0.01,
    "bristle_travel": 4e-4,
}
# Unknowns: every constant, the start of both ends, offset of the force, hinge moment by the square
# of the deflection, and the time of the jump.
OTHERS = {"start": 0.004, "aft_start": 0.006, "offset": 2.0, "square": -300.0, "edge": 0.37}


def circuit(
    parts: int, has_cable: bool = True, has_bristles: bool = False
) -> tuple[DrivenCircuit, np.ndarray]:
    """Return a circuit that is pushed and released between two samples; and unknowns."""
    theta = np.array([*CONSTANTS.values(), *OTHERS.values()])
    names = [*CONSTANTS, *OTHERS]
    n = len(names)

    def linear(shape, at_zero=0.0):
        return LinearInput(np.full(shape, at_zero, float), np.zeros((*shape, n)))

    constants = linear((len(CIRCUIT_CONSTANTS),))
    for k, name in enumerate(CIRCUIT_CONSTANTS):
        constants.slope[k, names.index(name)] = 1.0
    start = linear((2,))
    start.slope[0, names.index("start")] = start.slope[1, names.index("aft_start")] = 1.0
    time = STEP * np.arange(SAMPLES)
    force = linear((SAMPLES,))
    force.at_zero[:] = np.where(np.arange(SAMPLES) <= JUMP, 90.0 + 20.0 * np.sin(9.0 * time), 0.0)
    force.slope[:, names.index("offset")] = -1.0
    moment = linear((SAMPLES, 3))
    moment.at_zero[:, 1] = -700.0 * (1.0 + 0.2 * time)
    moment.slope[:, 2, names.index("square")] = 1.0
    edge = linear((SAMPLES,), np.nan)
    edge.at_zero[JUMP] = 0.0
    edge.slope[JUMP, names.index("edge")] = 1.0
    given = DrivenCircuit(
        has_cable, has_bristles, GEARING, STEP, parts, constants, start, force, moment, edge
    )
    return given, theta


@pytest.mark.slow
@pytest.mark.parametrize("has_bristles", [False, True])
@pytest.mark.parametrize("has_cable", [True, False])
@pytest.mark.parametrize("edge", [0.37, 0.0, 1.0])
def test_derivatives_are_those_of_differences(has_cable, edge, has_bristles):
    given, theta = circuit(20, has_cable, has_bristles)
    theta[-1] = edge
    Y = given.slopes(theta).held()
    names = [*CONSTANTS, *OTHERS]
    for k, name in enumerate(names):
        # A piece of a sub-step has at least a millionth of it: a larger step of the edge.
        h = 1e-3 if name == "edge" else 1e-5 * abs(theta[k])
        up, down = theta.copy(), theta.copy()
        up[k], down[k] = theta[k] + h, theta[k] - h
        if name == "edge":
            up[k], down[k] = min(up[k], 1.0), max(down[k], 0.0)
        difference = given.follow(up) - given.follow(down)
        difference /= up[k] - down[k]
        size = np.abs(difference).max()
        assert np.abs(difference - Y[:, :, k]).max() <= 2e-3 * size + 1e-12, name


@pytest.mark.parametrize("has_bristles", [False, True])
def test_error_falls_with_the_square_of_the_sub_step(has_bristles):
    motion = []
    for parts in (20, 40, 320):
        given, theta = circuit(parts, has_bristles=has_bristles)
        motion.append(given.follow(theta))
    errors = [np.abs(y - motion[-1]).max() / np.ptp(motion[-1]) for y in motion[:2]]
    assert errors[0] < 2e-4
    assert errors[1] < 0.35 * errors[0]


def test_a_narrow_width_is_dry_friction():
    """The set-valued friction of `simulate_linkages` is the limit of a small width."""
    given, theta = circuit(100)
    names = [*CONSTANTS, *OTHERS]
    changes = {"rate_width": 2e-5, "place_width": 2e-5, "preload": 0.0, "stiffness": 0.0}
    changes |= {"rigging": 0.0, "start": 0.0, "aft_start": 0.0, "offset": 0.0, "square": 0.0}
    for name, value in changes.items():
        theta[names.index(name)] = value
    given.moment.at_zero[:, 1] = -700.0
    smooth = given.follow(theta)
    edges = np.full((SAMPLES, 1), np.nan)
    edges[JUMP] = OTHERS["edge"]
    dry, _ = linkage(TRUTH | CABLE, given.force.at(theta), -700.0, STEP, edges)
    assert np.abs(smooth[:, 0] - dry[:, 0]).max() < 1e-3 * np.ptp(dry)


def test_wrong_sizes_and_widths_are_refused():
    given, theta = circuit(10)
    theta[list(CONSTANTS).index("rate_width")] = 0.0
    with pytest.raises(ValueError, match="widths"):
        given.follow(theta)
    with pytest.raises(ValueError, match="shape"):
        given._replace(start=LinearInput(np.zeros(3), np.zeros((3, len(theta))))).follow(theta)


def test_a_sub_step_that_does_not_converge_gives_no_motion():
    """Negative friction beyond the inertia of a sub-step has no unique velocity at its end."""
    given, theta = circuit(40)
    theta[list(CONSTANTS).index("friction")] = -1000.0
    y, Y = given.follow(theta), given.slopes(theta).held()
    assert np.isnan(y).all()
    assert np.isnan(Y).all()


def resting(force: float) -> tuple[DrivenCircuit, np.ndarray]:
    """Return a circuit with bristles under a constant force, with both ends at zero travel."""
    given, theta = circuit(20, has_bristles=True)
    for name in ("start", "aft_start", "rigging", "offset", "square"):
        theta[[*CONSTANTS, *OTHERS].index(name)] = 0.0
    given.force.at_zero[:] = force
    given.edge.at_zero[:] = np.nan
    given.edge.slope[:] = 0.0
    return given, theta


def test_bristles_hold_a_force_below_friction_and_not_one_above():
    held = resting(0.9 * CONSTANTS["friction"])[0].follow(resting(0.0)[1])
    assert np.abs(held).max() < 1e-12
    given, theta = resting(2.0 * CONSTANTS["friction"])
    moved, Y = given.follow(theta), given.slopes(theta).held()
    assert moved[-1, 0] > 1e-3
    # Bristles that are fully deflected at the start hold no more of a larger start.
    assert np.isfinite(Y).all()


def test_balance_at_rest_depends_on_the_start_of_the_ends():
    """The cable of a displaced end bends the bristles of both: derivatives are those of this."""
    given, theta = resting(3.0)
    names = [*CONSTANTS, *OTHERS]
    k = names.index("aft_start")
    theta[k] = 5e-5
    Y = given.slopes(theta).held()
    up, down = theta.copy(), theta.copy()
    up[k], down[k] = 5.0001e-5, 4.9999e-5
    difference = (given.follow(up) - given.follow(down)) / 2e-9
    np.testing.assert_allclose(Y[:, :, k], difference, atol=1e-6)


def test_a_small_bristle_travel_is_dry_friction():
    given, theta = circuit(100, has_bristles=True)
    names = [*CONSTANTS, *OTHERS]
    changes = {"bristle_travel": 2e-6, "place_width": 2e-5, "preload": 0.0, "stiffness": 0.0}
    changes |= {"rigging": 0.0, "start": 0.0, "aft_start": 0.0, "offset": 0.0, "square": 0.0}
    for name, value in changes.items():
        theta[names.index(name)] = value
    given.moment.at_zero[:, 1] = -700.0
    bristles = given.follow(theta)
    edges = np.full((SAMPLES, 1), np.nan)
    edges[JUMP] = OTHERS["edge"]
    dry, _ = linkage(TRUTH | CABLE, given.force.at(theta), -700.0, STEP, edges)
    assert np.abs(bristles[:, 0] - dry[:, 0]).max() < 2e-3 * np.ptp(dry)
