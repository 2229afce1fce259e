"""Array replay of FMI 3.0: a whole record in one step."""

from __future__ import annotations

import ctypes
from pathlib import Path

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.fmi1 import FMICallException

import flightmech

MOVED = ("delta_e", "delta_a", "delta_r")


def record_of(step: float, duration: float = 4.0) -> xr.Dataset:
    """Return smooth pulses of elevator, aileron and rudder, one after the other."""
    time = step * np.arange(round(duration / step) + 1)

    def pulse(start: float, size: float) -> np.ndarray:
        return size * np.sin(np.clip((time - start) / 1.2, 0.0, 1.0) * 2.0 * np.pi)

    return xr.Dataset(
        {
            n: ("time", pulse(0.3 + i, s))
            for i, (n, s) in enumerate(zip(MOVED, (-0.03, 0.02, 0.03), strict=True))
        },
        {"time": time},
    )


def configured(slave, record: xr.Dataset):
    """Give an instance the arrays of a record through FMPy's own calls."""
    size = record.sizes["time"]
    inputs = [v for v in slave.model.modelVariables if v.causality == "input"]
    u = np.tile([float(v.start) for v in inputs], (size, 1))
    for i, variable in enumerate(inputs):
        if variable.name in record:
            u[:, i] = record[variable.name].values
    slave.fmu.enterConfigurationMode()
    slave.fmu.setUInt64([slave.references["replay.n"]], [size])
    slave.fmu.exitConfigurationMode()
    slave.fmu.setFloat64([slave.references["replay.t"]], record["time"].values)
    slave.fmu.setFloat64([slave.references["replay.u"]], u.ravel())
    return slave


def flown(slave, outputs: tuple[str, ...], size: int) -> np.ndarray:
    """Return replay.y."""
    y = slave.fmu.getFloat64([slave.references["replay.y"]], nValues=size * len(outputs))
    return np.reshape(y, (size, len(outputs)))


def test_one_step_gives_the_bits_of_the_direct_call(trainer, instance, condition):
    record = record_of(0.02)
    direct = flightmech.simulate(trainer, record, condition, hold="linear")
    slave = configured(instance("3.0"), record).start()
    slave.step(0.0, 4.0)
    y = flown(slave, trainer.outputs, record.sizes["time"])
    assert abs(direct["theta"] - direct["theta"][0]).max() > 0.02
    for i, name in enumerate(trainer.outputs):
        np.testing.assert_array_equal(y[:, i], direct[name].values, err_msg=name)
    assert slave.get("V", "theta") == [direct["V"].values[-1], direct["theta"].values[-1]]


@pytest.mark.slow
def test_the_three_ways_agree_within_the_hold_of_the_inputs(fmus, trainer, instance, condition):
    """FMPy's loop holds each sample over its step: half a step late on average, so the difference
    halves with the step.
    """
    errors = []
    for step in (0.02, 0.01):
        record = record_of(step)
        table = np.zeros(record.sizes["time"], [(name, float) for name in ("time", *MOVED)])
        for name in ("time", *MOVED):
            table[name] = record[name].values
        held = fmpy.simulate_fmu(
            str(fmus["3.0"]),
            stop_time=4.0,
            output_interval=step,
            start_values=condition,
            input=table,
            output=["q", "theta"],
        )
        own = instance("3.0").start()
        rows = [own.get("q", "theta")]
        for k in range(record.sizes["time"] - 1):
            own.set({name: float(record[name][k]) for name in MOVED})
            own.step(record["time"].values[k], step)
            rows.append(own.get("q", "theta"))
        # FMPy interpolates the record at its own clock: a rounding of the inputs
        np.testing.assert_allclose(
            np.transpose(rows), [held["q"], held["theta"]], rtol=0.0, atol=1e-13
        )
        slave = configured(instance("3.0"), record).start()
        slave.step(0.0, 4.0)
        q = flown(slave, trainer.outputs, record.sizes["time"])[:, trainer.outputs.index("q")]
        errors.append(abs(q - held["q"]).max())
    # first order; the ends of the pulses, where the slope jumps, leave a few per cent
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)
    assert errors[1] < 0.03 * abs(q).max()


def test_pieces_of_a_record_give_the_bits_of_the_whole(trainer, instance, condition):
    record = record_of(0.02)
    direct = flightmech.simulate(trainer, record, condition, hold="linear")
    size = record.sizes["time"] // 2 + 1
    slave = configured(instance("3.0"), record.isel(time=slice(size))).start()
    slave.step(0.0, 2.0)
    second = record.isel(time=slice(size - 1, None))
    u = np.zeros((size, len(trainer.inputs)))
    for name in MOVED:
        u[:, trainer.inputs.index(name)] = second[name].values
    slave.fmu.setFloat64([slave.references["replay.t"]], second["time"].values)
    slave.fmu.setFloat64([slave.references["replay.u"]], u.ravel())
    slave.step(2.0, 2.0)
    theta = flown(slave, trainer.outputs, size)[:, trainer.outputs.index("theta")]
    np.testing.assert_array_equal(theta, direct["theta"].values[size - 1 :])


def test_after_a_replay_steps_are_ordinary(instance):
    record = record_of(0.02)
    slave = configured(instance("3.0"), record).start()
    slave.step(0.0, 4.0)
    slave.set({"delta_e": -0.02})
    slave.step(4.0, 0.5)
    assert slave.get("delta_e") == [-0.02]
    assert slave.get("q")[0] > 0.0


def test_a_stored_state_holds_the_record(trainer, instance):
    record = record_of(0.02)
    size = record.sizes["time"]
    slave = configured(instance("3.0"), record).start()
    bytes_before = slave.fmu.serializeFMUState(slave.fmu.getFMUState())
    slave.step(0.0, 4.0)
    first = flown(slave, trainer.outputs, size)
    other = instance("3.0")
    other.fmu.setFMUState(other.fmu.deserializeFMUState(bytes_before))
    other.step(0.0, 4.0)
    np.testing.assert_array_equal(flown(other, trainer.outputs, size), first)


def test_without_a_replay_the_row_is_that_of_the_outputs(trainer, instance):
    slave = instance("3.0").start()
    slave.step(0.0, 0.5)
    assert flown(slave, trainer.outputs, 1)[0].tolist() == slave.get(*trainer.outputs)


def test_a_failed_replay_keeps_what_was_flown(trainer, instance):
    record = record_of(0.02)
    slave = configured(instance("3.0"), record).start({"mass.Iyy": 1.0})
    with pytest.raises(FMICallException):
        slave.step(0.0, 4.0)
    (message,) = slave.messages
    count = int(message.split("replay failed after ")[1].split()[0])
    y = flown(slave, trainer.outputs, record.sizes["time"])
    assert 1 < count < record.sizes["time"]
    assert np.isfinite(y[:count]).all()
    assert np.isnan(y[count:]).all()


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda s: s.step(0.0, 1.0),
            "replay.t runs from 0 s to 4 s, the step from 0 s to 1 s; give one step for the "
            "whole record",
        ),
        (
            lambda s: s.fmu.setFloat64([70001], [0.0]),
            "1 values for 1 variables; a scalar takes one, an array as many as it has elements",
        ),
        (lambda s: s.fmu.getFloat64([70003], nValues=7), "7 values for 1 variables"),
        (
            lambda s: s.fmu.setFloat64([70003], np.zeros(201)),
            "an array of the replay is computed by the model and cannot be set",
        ),
        (
            lambda s: s.fmu.setFloat64([70001], [*range(200), np.nan]),
            "an array of the replay is nan; it must be finite",
        ),
        (
            lambda s: s.fmu.setUInt64([70000], [5]),
            "setting replay.n, a structural parameter, is not allowed while the instance is "
            "in step mode",
        ),
        (lambda s: s.fmu.getUInt64([1000]), "replay.n is the only variable of this type"),
        (
            lambda s: s.fmu.enterConfigurationMode(),
            "entering configuration mode is not allowed while the instance is in step mode",
        ),
    ],
)
def test_wrong_use_is_refused_and_changes_nothing(trainer, instance, act, message):
    record = record_of(0.02)
    slave = configured(instance("3.0"), record).start()
    with pytest.raises(FMICallException):
        act(slave)
    assert message in slave.messages[-1]
    slave.step(0.0, 4.0)
    assert np.isfinite(flown(slave, trainer.outputs, 201)).all()


def test_times_have_to_rise(instance):
    record = record_of(0.02)
    slave = configured(instance("3.0"), record).start()
    slave.fmu.setFloat64([slave.references["replay.t"]], [*record["time"].values[:-2], 3.9, 3.9])
    with pytest.raises(FMICallException):
        slave.step(0.0, 3.9)
    assert slave.messages == ["replay.t does not rise after 3.96 s (sample 199)"]


@pytest.mark.parametrize("count", [0, 10_000_001, 2**64 - 1])
def test_impossible_lengths_are_refused(instance, count):
    slave = instance("3.0")
    slave.fmu.enterConfigurationMode()
    with pytest.raises(FMICallException):
        slave.fmu.setUInt64([slave.references["replay.n"]], [count])
    assert slave.messages == [f"replay.n is {count}; give 1 (no replay) to 10000000 samples"]
    assert slave.fmu.getUInt64([slave.references["replay.n"]]) == [1]


def test_the_description_reports_the_arrays(fmus, trainer):
    found = {v.name: v for v in fmpy.read_model_description(str(fmus["3.0"])).modelVariables}
    assert found["replay.n"].causality == "structuralParameter"
    assert [found[f"replay.{name}"].shape for name in "tuy"] == [
        (1,),
        (1, len(trainer.inputs)),
        (1, len(trainer.outputs)),
    ]
    assert "replay.n" not in {
        v.name for v in fmpy.read_model_description(str(fmus["2.0"])).modelVariables
    }


def test_the_example_does_what_it_states(trainer, tmp_path, monkeypatch, condition):
    example = Path(__file__).parents[3] / "examples" / "replay_in_one_step.py"
    flightmech.write_fmu(trainer, tmp_path / "model.fmu", "3.0")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(example.read_text(encoding="utf-8"), names)
    record = xr.Dataset({"delta_e": ("time", names["u"][:, 0])}, {"time": names["time"]})
    assert names["u"][60, 0] == -0.02
    np.testing.assert_array_equal(
        names["pitch"], flightmech.simulate(trainer, record, condition)["theta"].values
    )


def test_pointers_of_numpy_serve(trainer, instance, condition):
    """The raw functions take a record without turning it into Python numbers."""
    record = record_of(0.02)
    slave = configured(instance("3.0"), record).start()
    slave.step(0.0, 4.0)
    y = np.empty((201, len(trainer.outputs)))
    reference = (ctypes.c_uint * 1)(slave.references["replay.y"])
    slave.fmu.fmi3GetFloat64(
        slave.fmu.component, reference, 1, y.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), y.size
    )
    np.testing.assert_array_equal(y, flown(slave, trainer.outputs, 201))
