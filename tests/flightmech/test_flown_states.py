"""States kept with a database: cells of a fixed grid, whatever the order of the fits."""

import numpy as np
import pytest

from flightmech.flown_samples import FLOWN_SAMPLES, with_flown_samples
from flightmech.flown_states import (
    CELL,
    FLOWN_STATES,
    HIGHEST,
    flown_size,
    gather_states,
    join_states,
    pack_states,
    unpack_states,
)

SAMPLES = {
    "alpha": np.radians([2.0, 2.2, 3.0, np.nan]),
    "mach": np.array([0.30, 0.301, 0.35, 0.35]),
    "beta": np.radians([0.0, 0.3, -1.2, 0.0]),
    "gear": np.zeros(4),
    "h_agl": np.array([2.0, 2.2, 5000.0, 5.0]),
    "qhat": np.array([0.0, -0.002, 0.001, 0.001]),
}


def test_cells_of_samples():
    states = gather_states([SAMPLES])
    assert states.axes == ("alpha", "beta", "mach", "gear")
    # the first two samples share a cell, the last one is left out
    assert states.cells.tolist() == [[2, 0, 15, 0], [3, -1, 18, 0]]
    assert states.single["h_agl"].tolist() == [2, 5, HIGHEST / CELL["h_agl"]]
    assert states.sizes["qhat"] == pytest.approx(0.00197)


def test_text_and_back():
    states = gather_states([SAMPLES])
    again = unpack_states(pack_states(states))
    assert again.axes == states.axes
    assert np.array_equal(again.cells, states.cells)
    assert again.sizes == states.sizes
    assert unpack_states("") is None
    assert unpack_states("damaged") is None
    assert pack_states(None) == ""


def test_axis_that_a_part_lacks_is_left_out():
    other = {name: SAMPLES[name] for name in ("alpha", "mach", "beta")}
    joined = gather_states([SAMPLES, other])
    assert joined.axes == ("alpha", "beta", "mach")
    text = join_states(pack_states(gather_states([SAMPLES])), pack_states(gather_states([other])))
    assert np.array_equal(unpack_states(text).cells, joined.cells)


def test_no_state_without_alpha_and_mach():
    assert gather_states([{"alpha": SAMPLES["alpha"]}]) is None
    assert gather_states([]) is None


def test_databases_joined():
    text = pack_states(gather_states([SAMPLES]))
    joined = with_flown_samples({FLOWN_STATES: text}, {FLOWN_SAMPLES: ""}, {})
    assert joined == {FLOWN_STATES: text}


def test_sizes_without_samples():
    assert flown_size(None, "qhat") == 0.01
    assert flown_size(None, "delta_e") == 0.1
    assert flown_size(None, "gear") == 1.0
    assert flown_size(gather_states([SAMPLES]), "qhat") == pytest.approx(0.00197)
