"""End of a search by Levenberg-Marquardt steps: proven maximum, or too few iterations."""

from __future__ import annotations

import numpy as np
import pytest

from flighttest.maximum_likelihood.likelihood import CONVERGED, EXHAUSTED, Likelihood
from flighttest.maximum_likelihood.search import PROVEN, invert_information, maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out

TIME = np.linspace(0.0, 3.0, 60)


class Decay:
    """Readings of a exp(-b t)."""

    def __init__(self, rng):
        self.measured = self.predict(np.array([2.0, 1.0])) + 0.05 * rng.standard_normal((60, 1))

    def predict(self, values):
        return (values[0] * np.exp(-values[1] * TIME))[:, None]

    def slopes(self, values, steps, central):
        columns = []
        for shift in np.diag(steps):
            low, width = (values - shift, 2.0) if central else (values, 1.0)
            columns.append(
                (self.predict(values + shift) - self.predict(low)) / (width * shift.sum())
            )
        return np.stack(columns, axis=2)


@pytest.fixture
def likelihood():
    layout = lay_out({"a": Unknown(0.5), "b": Unknown(0.2)}, [{}])
    return Likelihood([Decay(np.random.default_rng(2))], layout, np.zeros(1, int))


def test_the_last_iteration_is_converged_at_the_maximum_only(likelihood):
    """Searches that end after 1, 2, 3 ... iterations, against the distance from the maximum."""
    best = maximise_likelihood(likelihood, 50)
    assert best.stop == CONVERGED
    stderr = np.sqrt(np.diag(invert_information(best.information, np.ones(2, bool))))
    far, close = [], []
    for iterations in range(1, best.iterations):
        end = maximise_likelihood(likelihood, iterations)
        assert end.iterations == iterations
        distance = float(np.max(np.abs(end.theta - best.theta) / stderr))
        (far if distance > PROVEN else close).append((iterations, distance, end))
    for _, _, end in far:
        assert end.stop == EXHAUSTED
    for _, _, end in close:
        assert end.stop == CONVERGED
    # After two iterations the search is far off, and one iteration before its end it is not.
    assert far[1][0] == 2
    assert far[1][1] > 1.0
    assert close
    step = np.abs(far[1][2].remaining) / stderr
    assert step.max() > PROVEN
