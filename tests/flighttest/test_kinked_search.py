"""Search for a maximum with kinks whose places are known."""

from __future__ import annotations

import numpy as np
import pytest

from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.control_loading.responses.direct_search import NEGLIGIBLE, look_around
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


class HiddenPiece(Piece):
    """With a part that depends on |x|, of whose kink the search does not know."""

    def predict(self, values: np.ndarray) -> np.ndarray:
        return super().predict(values) + 2.0 * abs(values[0]) * np.cos(7.0 * TIME)[:, None]


class HiddenKink(Kinked):
    def sides(self, theta: np.ndarray) -> Sides:
        both = super().sides(theta)
        both.pieces[:, 0, 0] += 2.0 * np.sign(theta[0]) * np.cos(7.0 * TIME)
        return both


def hidden_kink(push: float) -> HiddenKink:
    """Return the likelihood of readings that push x to 0 from both sides."""
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(TIME))
    measured = 0.3 * TIME + 0.9 * SLIDES - push * np.cos(7.0 * TIME) + noise
    layout = lay_out({"x": Unknown(0.0), "y": Unknown(0.0)}, [{}])
    return HiddenKink([HiddenPiece(measured)], layout, np.array([0]))


@pytest.mark.parametrize("start", [(-0.5, 0.1), (0.7, 0.1), (0.3, 0.5)])
def test_a_search_that_stalls_at_an_unknown_kink_states_its_width(start):
    """No gradient vanishes there: it has not converged, but no place around it is lower."""
    target = hidden_kink(0.5)
    end = maximise_kinked(target, 60, np.array(start))
    assert end.stop == "stationary"
    assert not end.converged
    assert end.is_proven
    assert end.theta[0] == pytest.approx(0.0, abs=1e-6)
    stderr = np.sqrt(np.diag(np.linalg.inv(end.information)))
    # the least cost at the kink
    y = end.theta[1] + np.linspace(-3.0, 3.0, 121) * stderr[1]
    costs = [target.cost(t, target.residuals(t)) for t in np.column_stack([0.0 * y, y])]
    assert min(costs) > end.cost - NEGLIGIBLE
    assert abs(y[np.argmin(costs)] - end.theta[1]) < (end.width[1] + 0.05) * stderr[1]
    assert end.width.max() <= 0.35


def test_a_place_on_a_slope_is_not_stationary():
    target = likelihood(0.2, 0.3, 0.5)
    end = maximise_kinked(target, 60, np.array([0.0, 0.0]))
    stderr = np.sqrt(np.diag(np.linalg.inv(end.information)))

    def look(theta: np.ndarray):
        cost = target.cost(theta, target.residuals(theta))
        free = np.ones(2, bool)
        return look_around(
            lambda t: target.cost(t, target.residuals(t)), theta, cost, end.information, free
        )

    assert look(end.theta).is_stationary
    away = look(end.theta + 2.0 * stderr * np.array([1.0, 0.0]))
    assert not away.is_stationary
    assert away.fall > NEGLIGIBLE


def test_a_flat_cost_is_not_stationary():
    flat = look_around(lambda t: 0.5 * t[0] ** 2, np.zeros(2), 0.0, np.eye(2), np.ones(2, bool))
    assert flat.fall == 0.0
    assert not flat.is_stationary
