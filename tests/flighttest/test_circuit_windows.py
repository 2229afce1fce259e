"""Windows of free motion as pieces of one likelihood: sub-steps and number of unknowns."""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses import circuit_fit
from flighttest.submodels.control_loading.responses.free_response import FreeWindow, find_windows
from flighttest.submodels.control_loading.responses.window_response import (
    FRICTION_RATE,
    LONGEST_STEP,
)

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
    widths = circuit_fit._with_widths(START, windows, FRICTION_RATE)
    unknowns = circuit_fit._common_unknowns(START, {}) | widths
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


@pytest.mark.slow
def test_a_long_window_has_longer_pieces_of_the_force_error():
    """15 s with a driving hand are 150 pieces of 0.1 s; the kernel has room for 128 unknowns."""
    for seconds in (3.0, 15.0):
        time = np.arange(0.0, seconds, 0.01)
        rng = np.random.default_rng(1)
        travel = 0.01 * np.sin(6.0 * np.maximum(time - 1.0, 0.0))
        force = 4.0 * -36.0 * travel + 0.02 * rng.standard_normal(len(time))
        channels = {"F_pedal": force, "pedal": travel, "delta_r": travel, "qbar": 1000.0 + 0 * time}
        columns = {name: ("time", x) for name, x in channels.items()}
        (found,) = find_windows(LOADING, [xr.Dataset(columns, {"time": time})])
        assert found.is_driven
        assert 1 < len(found.errors) <= 72
        # all samples are in one piece, and a longer mean of noise is smaller
        assert sum(part.stop - part.start for part, _ in found.errors) == len(found.time)
        part, sigma = found.errors[0]
        assert sigma == pytest.approx(0.02 / np.sqrt(part.stop - part.start), rel=0.2)
        piece = likelihood_of([found]).pieces[0]
        start = np.array([START.get(name, 0.0) for name in piece.names])
        start[[name in circuit_fit.WIDTHS for name in piece.names]] = np.log(1e-3)
        assert np.isfinite(piece.predict(start)).all()


def test_a_window_without_room_is_refused():
    windows = [window(0.01), window(0.01, errors=130)]
    with pytest.raises(IdentificationError, match=r"0-0\.39 s has 138 unknowns.*divide the window"):
        circuit_fit.fit_circuit(LOADING, windows, [], START, {})


def test_the_noise_of_a_long_line_of_the_force_is_one_unknown():
    """The mean of 100 samples of 0.5 N has an error of 0.05 N, which moves the offset."""
    time = np.arange(0.0, 3.0, 0.01)
    after = np.maximum(time - 1.0, 0.0)
    travel = 0.05 * np.exp(-4.0 * after) * np.cos(20.0 * after)
    force = np.where(time < 1.0, 80.0, 0.0)
    force = force + np.random.default_rng(3).normal(0.0, 0.5, len(time))
    channels = {"F_pedal": force, "pedal": travel, "delta_r": travel, "qbar": 1000.0 + 0 * time}
    columns = {name: ("time", x) for name, x in channels.items()}
    (found,) = find_windows(LOADING, [xr.Dataset(columns, {"time": time})])
    assert len(found.edges) == 1
    held, free = found.errors
    # The mean is that of the whole line, of which the window has a part.
    assert held[1] == pytest.approx(0.5 / np.sqrt(100), rel=0.2)
    assert free[1] == pytest.approx(0.5 / np.sqrt(200), rel=0.2)
    covered = [k for part, _ in found.errors for k in range(part.start, part.stop)]
    assert covered == list(range(len(found.time)))
