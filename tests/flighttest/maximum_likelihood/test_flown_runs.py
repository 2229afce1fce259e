"""Slopes by differences of runs: of both sides, of the one that could be flown, of none."""

import numpy as np
import pytest

from flighttest.maximum_likelihood.flown_runs import Runs, output_slopes

BASE = np.array([[1.0, 2.0], [3.0, 4.0]])
SLOPES = np.array([[[1.0, 0.0], [2.0, 5.0]], [[0.5, 1.0], [-3.0, 0.0]]])  # (unknown, time, output)
STEPS = np.array([0.5, 0.25])
UP, DOWN = BASE + SLOPES * STEPS[:, None, None], BASE - SLOPES * STEPS[:, None, None]


def lost(runs: np.ndarray, which: int) -> np.ndarray:
    """Return runs of which one ends after its first sample."""
    runs = runs.copy()
    runs[which, 1:] = np.nan
    return runs


@pytest.mark.parametrize("down", [None, DOWN])
def test_of_what_was_flown(down):
    flown = np.ones(2 if down is None else 4, bool)
    np.testing.assert_array_equal(output_slopes(BASE, UP.copy(), down, STEPS, flown), SLOPES)


def test_one_side_stands_for_both():
    found = output_slopes(
        BASE, lost(UP, 0), lost(DOWN, 1), STEPS, np.array([False, True, True, False])
    )
    np.testing.assert_array_equal(found, SLOPES)


def test_what_no_side_can_fly_has_no_slope():
    found = output_slopes(
        BASE, lost(UP, 1), lost(DOWN, 1), STEPS, np.array([True, False, True, False])
    )
    np.testing.assert_array_equal(found, SLOPES * np.array([1.0, 0.0])[:, None, None])
    np.testing.assert_array_equal(
        output_slopes(BASE, lost(UP, 1), None, STEPS, np.array([True, False])), found
    )


class Flights:
    """Outputs that are quadratic in two unknowns, over three samples; counts what it flies, and
    loses runs above a bound.
    """

    def __init__(self, bound: float = np.inf):
        self.batches: list[int] = []
        self.bound = bound

    def __call__(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.batches.append(len(rows))
        t = np.arange(3.0)
        y = np.stack([np.outer(rows[:, 0] ** 2, t), rows[:, :1] * rows[:, 1:] + t], axis=2)
        ok = rows[:, 0] <= self.bound
        y[~ok, 1:] = np.nan
        return y, ok


AT, SMALL = np.array([2.0, -1.0]), np.array([1e-3, 1e-3])
EXACT = np.stack(
    [
        np.column_stack([4.0 * np.arange(3.0), -np.ones(3)]),
        np.column_stack([np.zeros(3), 2.0 * np.ones(3)]),
    ]
)


@pytest.mark.parametrize(("central", "off"), [(False, 3e-3), (True, 1e-9)])
def test_slopes_that_are_expected_are_flown_with_the_response_and_are_the_same(central, off):
    one, together = Flights(), Flights()
    apart, ahead = Runs(one), Runs(together)
    ahead.expect(SMALL, central)
    np.testing.assert_array_equal(ahead.outputs(AT), apart.outputs(AT))
    np.testing.assert_array_equal(
        ahead.slopes(AT, SMALL, central), apart.slopes(AT, SMALL, central)
    )
    np.testing.assert_allclose(apart.slopes(AT, SMALL, central), EXACT, atol=off)
    count = 4 if central else 2
    assert (together.batches, one.batches) == ([1 + count], [1, count, count])


def test_what_was_flown_ahead_serves_no_other_point_and_no_other_step():
    flights = Flights()
    runs = Runs(flights)
    runs.expect(SMALL, False)
    runs.outputs(AT + 1.0)  # a trial that is discarded
    np.testing.assert_allclose(runs.slopes(AT, SMALL, True), EXACT, atol=1e-9)
    runs.expect(SMALL, True)
    runs.outputs(AT + 0.5)
    runs.slopes(AT + 0.5, 2.0 * SMALL, False)
    assert flights.batches == [3, 1, 4, 5, 2]


@pytest.mark.parametrize("ahead", [False, True])
def test_a_step_that_cannot_be_flown_goes_the_other_way(ahead):
    runs = Runs(Flights(bound=2.0))
    if ahead:
        runs.expect(SMALL, False)
    runs.outputs(AT)
    np.testing.assert_allclose(runs.slopes(AT, SMALL, False), EXACT, atol=3e-3)
