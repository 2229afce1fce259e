"""The low-pass of a relation does not carry the noise of a last sample into the record."""

from types import SimpleNamespace

import numpy as np

from flighttest.reconstruction.quality.checks.relations import RELATIONS


def test_a_noisy_last_sample_stays_at_the_end():
    """The second derivative of a height has errors of 200 m/s2 at the ends of a record."""
    vertical = next(relation for relation in RELATIONS if relation.name == "vertical")
    side = np.zeros(1240)
    side[-1] = 200.0
    left = np.abs(vertical._filter_side(side, SimpleNamespace(step=0.05)))
    # the samples that count begin half a period from the end
    assert left[: -round(0.5 / (vertical.cutoff * 0.05))].max() < vertical.tolerance
