"""Values that come in: refused at once when they are not finite, and then nothing has changed."""

from __future__ import annotations

from ctypes import byref, c_double

import numpy as np
import pytest

from flightmech.errors import SimulationError
from flightmech.simulation.kernel import Simulation
from flightmech.simulation.kernel_library import load_kernel

AM_BAD_INDEX, AM_NOT_FINITE = 1, 3
NOT_FINITE = pytest.mark.parametrize(
    ("value", "text"), [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")]
)


@NOT_FINITE
def test_a_parameter_that_is_not_finite_is_refused_at_once(value, text, sim):
    run, index = Simulation(sim.model), sim.parameters.index("mass.Ixz")
    run.set_parameter(index, 123.0)
    with pytest.raises(SimulationError, match=f"^mass.Ixz is {text}; it must be finite$"):
        run.set_parameter(index, value)
    assert run.parameter(index) == 123.0


@NOT_FINITE
def test_an_input_that_is_not_finite_is_refused_at_once(value, text, sim):
    run, index, kept = Simulation(sim.model), sim.inputs.index("gear"), c_double()
    assert load_kernel().am_set_input(run.handle, index, c_double(0.5)) == 0
    assert load_kernel().am_set_input(run.handle, index, c_double(value)) == AM_NOT_FINITE
    assert load_kernel().am_error(run.handle).decode() == f"gear is {text}; it must be finite"
    assert load_kernel().am_get_input(run.handle, index, byref(kept)) == 0
    assert kept.value == 0.5


def test_of_all_inputs_none_changes_when_one_is_refused(sim, start):
    run, u = start(sim, init__V=100.0, delta_e=0.1), np.zeros(len(sim.inputs))
    before = run.outputs()
    u[sim.inputs.index("wind_d")] = np.nan
    with pytest.raises(SimulationError, match=r"^wind_d is nan; it must be finite$"):
        run.set_inputs(u)
    assert (run.outputs() == before).all()
    assert before[sim.outputs.index("applied.delta_e")] == 0.1


def test_indices_that_do_not_exist(sim):
    run = Simulation(sim.model)
    for index in (-1, len(sim.inputs)):
        assert load_kernel().am_set_input(run.handle, index, c_double(0.0)) == AM_BAD_INDEX
        assert load_kernel().am_error(run.handle).decode() == f"there is no input {index}"
    for index in (-1, 10**6):
        assert load_kernel().am_set_parameter(run.handle, index, 0.0) == AM_BAD_INDEX
        assert load_kernel().am_error(run.handle).decode() == f"there is no parameter {index}"
