"""Search for a maximum with kinks whose places are known."""

from __future__ import annotations

import numpy as np
import pytest

from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.control_loading.responses.kinked_search import Sides, maximise_kinked

TIME = np.linspace(0.0, 1.0, 40)
# The ratio is that of a load (x + y) to its friction; what slides adds to the readings.
RATIO = np.array([[1.0, 1.0]])
SLIDES = np.sin(5.0 * TIME)


class Piece:
    """A line x + y t, and a part that depends on the ratio up to 1 alone."""

    def __init__(self, measured: np.ndarray):
        self.measured = measured[:, None]

    def predict(self, values: np.ndarray) -> np.ndarray:
        bend = np.clip(RATIO @ values, -1.0, 1.0)
        return (values[0] + values[1] * TIME + 3.0 * bend[0] * SLIDES)[:, None]

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        raise NotImplementedError("the search uses both sides")


class Kinked(Likelihood):
    """The likelihood of one piece with one kink."""

    def sides(self, theta: np.ndarray) -> Sides:
        return Sides(RATIO @ theta, RATIO, np.column_stack([np.ones_like(TIME), TIME])[:, None])

    def join_sides(self, sides: Sides, inside: np.ndarray) -> list[np.ndarray]:
        held = 3.0 * inside[0] * SLIDES[:, None, None] * RATIO
        return [sides.pieces + held]

    def pushes(self, sides: Sides, residuals: list[np.ndarray]) -> np.ndarray:
        weighted = residuals[0][:, 0] / self.noise(residuals)[0, 0]
        return np.array([3.0 * SLIDES @ weighted])

    def place(self, theta: np.ndarray, held: dict[int, float]) -> np.ndarray:
        theta = theta.copy()
        for side in held.values():
            theta[1] = side - theta[0]
        return theta


def likelihood(x: float, y: float, bend: float) -> Kinked:
    """Return the likelihood of readings with this deflection in place of the clipped ratio."""
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(TIME))
    measured = x + y * TIME + 3.0 * bend * SLIDES + noise
    layout = lay_out({"x": Unknown(0.0), "y": Unknown(0.0)}, [{}])
    return Kinked([Piece(measured)], layout, np.array([0]))


# Readings inside, beyond the kink, and those that push to the kink from both sides.
@pytest.mark.parametrize(
    ("x", "y", "bend", "start", "ratio"),
    [
        (0.2, 0.3, 0.5, (-0.5, 0.1), 0.5),
        (1.2, 0.7, 1.0, (2.0, 1.0), 1.9),
        (0.5, 0.4, 1.3, (-0.5, 0.1), 1.0),
    ],
)
def test_the_maximum_is_the_lowest_cost_around_it(x, y, bend, start, ratio):
    target = likelihood(x, y, bend)
    end = maximise_kinked(target, 60, np.array(start))
    assert end.converged
    assert RATIO[0] @ end.theta == pytest.approx(ratio, abs=0.03)
    stderr = np.sqrt(np.diag(np.linalg.inv(end.information)))
    for direction in np.random.default_rng(1).standard_normal((200, 2)):
        for size in (1e-4, 1e-2, 1.0):
            near = end.theta + size * stderr * direction
            cost = target.cost(near, target.residuals(near))
            assert cost > end.cost - 1e-9


def test_a_maximum_at_a_kink_is_exact_and_the_same_from_everywhere():
    target = likelihood(0.5, 0.4, 1.3)
    ends = []
    for start in ((-0.5, 0.1), (3.0, 0.0), (0.0, 0.0), (0.5, 4.0)):
        ends.append(maximise_kinked(target, 60, np.array(start)))
    stderr = np.sqrt(np.diag(np.linalg.inv(ends[0].information)))
    for end in ends:
        assert RATIO[0] @ end.theta == pytest.approx(1.0, abs=1e-12)
        assert np.abs(end.theta - ends[0].theta).max() < 1e-6 * stderr.min()
