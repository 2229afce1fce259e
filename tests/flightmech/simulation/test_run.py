"""Runs from Python: inputs by name, parameters, what is reported about tables that were left,
errors.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import SchemaError, SimulationError, UnknownName
from flightmech.simulation.kernel import Stepping
from flightmech.simulation.run import constant_inputs, initialise_run

TRIMMED = {"init.V": 90.0, "init.h": 3000.0, "mode.trim": 2.0}


def over(time, **columns) -> xr.Dataset:
    return xr.Dataset(
        {
            name: ("time", np.broadcast_to(np.asarray(value, float), len(time)))
            for name, value in columns.items()
        },
        {"time": time},
    )


@pytest.fixture(scope="module")
def time() -> np.ndarray:
    return np.round(np.arange(0.0, 4.0, 0.02), 6)


def test_result_carries_units(trainer, time):
    y = flightmech.simulate(trainer, over(time), TRIMMED)
    assert y.sizes == {"time": 200}
    assert y["alpha"].attrs["units"] == "rad"
    assert y["V"].attrs["long_name"] == "true airspeed"
    assert y.attrs["title"] == "Trainer & co"
    assert y.attrs["out_of_range"] == ""


def test_elevator_down_pitches_down(trainer, time):
    y = flightmech.simulate(trainer, over(time, delta_e=np.where(time > 0.5, 0.02, 0.0)), TRIMMED)
    q = y["q"].sel(time=1.0, method="nearest") - y["q"][0]
    assert float(q) < -0.01
    np.testing.assert_allclose(
        y["applied.delta_e"] - y["trim.delta_e"], np.where(time > 0.5, 0.02, 0.0), atol=1e-15
    )


def test_constant_inputs_by_parameter_or_scalar(trainer, time):
    by_parameter = flightmech.simulate(trainer, over(time), {**TRIMMED, "delta_r": 0.01})
    by_scalar = flightmech.simulate(trainer, over(time).assign(delta_r=0.01), TRIMMED)
    by_column = flightmech.simulate(trainer, over(time, delta_r=0.01), TRIMMED)
    for name in ("r", "beta", "phi"):
        assert (by_parameter[name].values == by_column[name].values).all()
        assert (by_scalar[name].values == by_column[name].values).all()


def test_states_of_a_manoeuvre_are_not_inputs(trainer, time):
    y = flightmech.simulate(trainer, over(time, alpha=0.3, ax_imu=1.0), TRIMMED)
    assert float(y["alpha"][0]) < 0.2


def test_hold_differs_from_linear_by_half_a_sample(trainer):
    time = np.arange(0.0, 3.0, 0.1)
    delta_e = 0.02 * np.sin(3.0 * time)
    linear = flightmech.simulate(trainer, over(time, delta_e=delta_e), TRIMMED)
    held = flightmech.simulate(trainer, over(time, delta_e=delta_e), TRIMMED, hold="zero")
    late = flightmech.simulate(
        trainer, over(time, delta_e=0.02 * np.sin(3.0 * np.maximum(time - 0.05, 0.0))), TRIMMED
    )
    assert np.abs(held["q"] - late["q"]).max() < 0.3 * np.abs(held["q"] - linear["q"]).max()


def test_the_step_may_come_with_the_parameters(trainer, time):
    u = over(time, delta_e=0.01)
    found = flightmech.simulate(trainer, u, {**TRIMMED, "mode.step": 0.02})
    assert found.attrs["step"] == 0.02
    assert (found.q == flightmech.simulate(trainer, u, TRIMMED, step=0.02).q).all()


def test_step_hardly_matters(trainer, time):
    """RK4 at 20 ms against 5 ms."""
    coarse = flightmech.simulate(trainer, over(time, delta_e=0.01), TRIMMED, step=0.02)
    fine = flightmech.simulate(trainer, over(time, delta_e=0.01), TRIMMED, step=0.005)
    assert np.abs(coarse["q"] - fine["q"]).max() < 1e-5


def test_tables_that_were_left_are_named(trainer, time):
    y = flightmech.simulate(
        trainer, over(time), {"init.V": 20.0, "init.h": 3000.0, "init.alpha": 0.5}
    )
    assert "alpha above 0.3 in" in y.attrs["out_of_range"]
    assert "mach below 0.1 in" in y.attrs["out_of_range"]


def test_unknown_names_are_refused(trainer, time):
    with pytest.raises(UnknownName, match=r"unknown parameter or input 'init.Vtas'; near it: init"):
        flightmech.simulate(trainer, over(time), {"init.Vtas": 3.0})
    with pytest.raises(UnknownName, match=r"unknown input 'elevator'"):
        flightmech.simulate(trainer, over(time, elevator=0.0))


def test_nan_in_an_input_reports_name_and_time(trainer, time):
    delta_e = np.where(np.isclose(time, 1.5), np.nan, 0.0)
    with pytest.raises(
        SimulationError, match=r"input delta_e is -?nan at t = 1\.5 s; it must be finite"
    ) as caught:
        flightmech.simulate(trainer, over(time, delta_e=delta_e), TRIMMED)
    assert caught.value.time == pytest.approx(1.5)


@pytest.mark.parametrize("last", [np.inf, np.nan])
def test_time_must_be_finite(trainer, last):
    times = np.array([0.0, 0.1, last])
    with pytest.raises(SchemaError, match=r"time is (inf|nan) at sample 2"):
        flightmech.simulate(trainer, over(times, delta_e=np.zeros(3)), TRIMMED)


def test_time_must_be_there_and_rise(trainer):
    with pytest.raises(SchemaError, match=r"no coordinate time"):
        flightmech.simulate(trainer, xr.Dataset({"delta_e": 0.0}))
    with pytest.raises(SchemaError, match=r"time does not rise after 0.1 s \(sample 1\)"):
        flightmech.simulate(trainer, over(np.array([0.0, 0.1, 0.1, 0.2])))


def test_wind_carries_the_aircraft(trainer, time):
    still = flightmech.simulate(trainer, over(time), {**TRIMMED, "mode.earth": 0.0})
    windy = flightmech.simulate(trainer, over(time, wind_e=10.0), {**TRIMMED, "mode.earth": 0.0})
    np.testing.assert_allclose(windy["ve"] - still["ve"], 10.0, atol=1e-6)
    np.testing.assert_allclose(windy["V"], still["V"], rtol=1e-9)


def test_trim_dataset(trainer):
    y = flightmech.trim(trainer, {"init.V": 90.0, "init.h": 3000.0})
    assert y.sizes == {}
    assert float(y["trim.w_dot"]) == pytest.approx(0.0, abs=1e-11)
    assert 0.0 < float(y["trim.throttle"]) < 1.0
    assert float(y["nz"]) == pytest.approx(np.cos(float(y["theta"])), abs=0.01)
    with pytest.raises(UnknownName, match=r"'init.speed'"):
        flightmech.trim(trainer, {"init.speed": 90.0})


def test_steps_through_arrays_in_place_are_those_of_single_calls(trainer):
    values = TRIMMED
    u = constant_inputs(trainer, values)
    one, other = initialise_run(trainer, values, u), initialise_run(trainer, values, u)
    run = Stepping(other)
    for k in range(20):
        ends = np.stack([u, u])
        ends[:, trainer.inputs.index("delta_e")] += 0.01 * np.array(
            [np.sin(0.3 * k), np.sin(0.3 * k + 0.3)]
        )
        one.step(0.02 * k, 0.02, *ends)
        run.ends[:] = ends
        run.step(0.02 * k, 0.02)
        assert one.outputs().tobytes() == run.outputs().tobytes()
    assert run.outputs() is run.y
    run.ends[1, 0] = np.nan
    with pytest.raises(SimulationError, match="must be finite"):
        run.step(0.4, 0.02)
