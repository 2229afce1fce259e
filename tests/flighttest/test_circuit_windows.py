"""Windows of free motion as pieces of one likelihood: sub-steps and number of unknowns."""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses import circuit_fit
from flighttest.submodels.control_loading.responses.free_response import FreeWindow
from flighttest.submodels.control_loading.responses.window_response import LONGEST_STEP

LOADING = ControlLoading("pedal", 1.0, 1.0, 0.3, "Ch_r = 1", ("offset", "friction", "mass"))
START = {"offset": 0.0, "friction": 5.0, "mass": 4.0, "Ch_r: 1": 0.0, "rigging": 0.0}


def window(step: float, samples: int = 40, errors: int = 0) -> FreeWindow:
    """A pedal that is moved by a force, without noise."""
    t = np.arange(samples) * step
    travel = 0.01 * np.sin(6.0 * t)
    return FreeWindow(
        time=t,
        measured=np.column_stack([travel, travel]) / 1e-5,
        scale=np.full(2, 1e-5),
        force=4.0 * -36.0 * travel,
        weight=np.zeros(samples),
        load=np.zeros(samples),
        factors=[(0, np.ones(samples))],
        ground=0.0,
        edges=(),
        errors=((slice(0, 1), 0.1),) * errors,
        is_driven=True,
    )


def likelihood_of(windows):
    unknowns = circuit_fit._common_unknowns(START, {}) | circuit_fit._with_widths(START, windows)
    layout = circuit_fit._lay_out_records(unknowns, windows, 0)
    return circuit_fit.CircuitLikelihood(LOADING, windows, [], layout, START)


def test_every_window_has_the_sub_steps_of_its_own_steps():
    """A sub-step is 0.25 ms at most, whatever the step of the first window."""
    windows = [window(0.001), window(0.01)]
    for order in (windows, windows[::-1]):
        likelihood = likelihood_of(order)
        for piece in likelihood.pieces:
            assert piece.step / piece.parts <= LONGEST_STEP * (1.0 + 1e-9)
        others = likelihood.with_records(order, [])
        assert [piece.parts for piece in others.pieces] == [p.parts for p in likelihood.pieces]
    assert {piece.parts for piece in likelihood.pieces} == {4, 40}
