"""The FMU against the direct kernel call, and the promises of both standards.

The model is small and synthetic: all six coefficients, tables of one and two axes, one engine with a lag.
"""

from __future__ import annotations

import ctypes
import os
import re
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

import flightmech
from flightmech.aircraft import Engine
from flightmech.errors import ParseError, SchemaError
from flightmech.fmu import read_fmu, write_fmu
from flightmech.terms import make

VERSIONS = ("2.0", "3.0")
START = {"init.V": 90.0, "init.h": 3000.0, "init.gamma": 0.0, "mode.trim": 1}
TRACE = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "az", "CL", "Cm", "engine1.thrust")


@pytest.fixture(scope="module")
def sim() -> flightmech.SimModel:
    """A light trainer: every coefficient, tables of no to two axes, one engine with a lag."""
    alpha, mach = np.array([-0.2, 0.0, 0.15, 0.3]), np.array([0.1, 0.6])
    leaves = {
        "/CL/basic": make([[-0.8, -0.9], [0.2, 0.25], [0.95, 1.1], [1.4, 1.5]], {"alpha": alpha, "mach": mach}, source="datcom"),
        "/CL/delta_e": make(0.4, regressors=["delta_e"]),
        "/CL/alphadothat": make(2.0, regressors=["alphadothat"]),
        "/CD/basic": make([0.06, 0.025, 0.07, 0.2], {"alpha": alpha}, comment="parabola through 4 points"),
        "/CY/beta": make(-0.6, regressors=["beta"]),
        "/Cl/beta": make([-0.05, -0.06, -0.08, -0.1], {"alpha": alpha}, ["beta"]),
        "/Cl/phat": make(-0.45, regressors=["phat"]),
        "/Cl/aileron": make(-0.12, regressors=["delta_a"]),
        "/Cm/basic": make([0.2, 0.02, -0.12, -0.35], {"alpha": alpha}),
        "/Cm/qhat": make(-14.0, regressors=["qhat"]),
        "/Cm/delta_e": make(-1.1, regressors=["delta_e"]),
        "/Cn/beta": make(0.09, regressors=["beta"]),
        "/Cn/rhat": make(-0.14, regressors=["rhat"]),
        "/Cn/rudder": make(-0.07, regressors=["delta_r"]),
    }
    thrust = make([[200.0, 100.0], [9000.0, 7000.0]], {"throttle": [0.0, 1.0], "mach": mach})
    aircraft = flightmech.Aircraft(
        "Trainer & co",
        17.0,
        1.67,
        10.3,
        2500.0,
        10000.0,
        8100.0,
        15000.0,
        Ixz=500.0,
        cg=(0.02, 0.0, 0.1),
        engines=(Engine((0.0, 0.0, 0.1), thrust=thrust, time_constant=0.8),),
    )
    return flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))


@pytest.fixture(scope="module")
def fmus(sim, tmp_path_factory) -> dict[str, Path]:
    """Both FMUs, unpacked."""
    folder = tmp_path_factory.mktemp("fmu")
    return {v: Path(fmpy.extract(str(write_fmu(sim, folder / f"v{v[0]}.fmu", v)), str(folder / v))) for v in VERSIONS}


@pytest.fixture(scope="module")
def inputs() -> xr.Dataset:
    """Six seconds of elevator, aileron, rudder and throttle at 50 Hz, each a smooth pulse."""
    time = 0.02 * np.arange(301)

    def pulse(start: float, size: float) -> np.ndarray:
        return size * np.sin(np.clip((time - start) / 1.5, 0.0, 1.0) * 2.0 * np.pi)

    signals = {"delta_e": pulse(0.5, -0.03), "delta_a": pulse(1.5, 0.02), "delta_r": pulse(2.5, 0.03)}
    return xr.Dataset({name: ("time", values) for name, values in signals.items()}, {"time": time})


def table_of(inputs: xr.Dataset) -> np.ndarray:
    """Return inputs as the structured array that FMPy takes."""
    names = ["time", *map(str, inputs.data_vars)]
    table = np.zeros(inputs.sizes["time"], [(name, float) for name in names])
    for name in names:
        table[name] = inputs[name].values
    return table


def replay(folder: Path, inputs: xr.Dataset, **options) -> dict[str, np.ndarray]:
    """Run FMPy's own loop over the sample times of `inputs`."""
    time = inputs["time"].values
    options = {"start_values": START, "output": TRACE, **options}
    found = fmpy.simulate_fmu(
        str(folder),
        start_time=time[0],
        stop_time=time[-1],
        output_interval=time[1] - time[0],
        input=table_of(inputs),
        fmi_type="CoSimulation",
        **options,
    )
    return {name: found[name] for name in found.dtype.names}


class Slave:
    """An instance driven call by call; texts of the FMU's logger are kept."""

    def __init__(self, folder: Path, guid: str | None = None):
        self.model = fmpy.read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in self.model.modelVariables}
        self.messages: list[str] = []
        kind = FMU2Slave if self.model.fmiVersion == "2.0" else FMU3Slave
        self.fmu = kind(
            guid=guid or self.model.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.model.coSimulation.modelIdentifier,
            instanceName="one",
        )
        if kind is FMU2Slave:
            self.logger = fmi2CallbackLoggerTYPE(lambda *message: self.messages.append(message[4].decode()))
            self.callbacks = fmi2CallbackFunctions(logger=self.logger)
            self.fmu.instantiate(callbacks=self.callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda *message: self.messages.append(message[3].decode()))

    def set(self, values: dict[str, float]) -> None:
        """Set reals."""
        setter = self.fmu.setReal if isinstance(self.fmu, FMU2Slave) else self.fmu.setFloat64
        setter([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Get reals."""
        getter = self.fmu.getReal if isinstance(self.fmu, FMU2Slave) else self.fmu.getFloat64
        return getter([self.references[name] for name in names])

    def start(self, values: dict[str, float] | None = None) -> Slave:
        """Initialise at the condition of all tests, with `values` set before the end of initialization mode."""
        self.enter()
        self.set({**START, **(values or {})})
        self.fmu.exitInitializationMode()
        return self

    def enter(self) -> None:
        """Enter initialization mode at time zero."""
        if isinstance(self.fmu, FMU2Slave):
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def step(self, t: float, dt: float) -> None:
        self.fmu.doStep(t, dt)


@pytest.fixture(params=VERSIONS)
def slave(fmus, request):
    return Slave(fmus[request.param])


# ---- the file


@pytest.mark.parametrize("version", VERSIONS)
def test_the_standard_finds_nothing(sim, tmp_path, version):
    path = write_fmu(sim, tmp_path / "x.fmu", version)
    assert validate_fmu(str(path)) == []
    assert read_fmu(path)["findings"] == []
    assert os.listdir(tmp_path) == ["x.fmu"]


@pytest.mark.parametrize("version", VERSIONS)
def test_same_model_same_bytes(sim, tmp_path, version):
    first, second = (write_fmu(sim, tmp_path / name, version).read_bytes() for name in ("a.fmu", "b.fmu"))
    assert first == second


def test_the_interface_is_the_catalogue(sim, fmus):
    for version in VERSIONS:
        variables = fmpy.read_model_description(str(fmus[version])).modelVariables
        for causality, names in (("input", sim.inputs), ("output", sim.outputs), ("parameter", sim.parameters)):
            assert [v.name for v in variables if v.causality == causality] == list(names)


def test_what_is_in_the_file(sim, tmp_path):
    with zipfile.ZipFile(write_fmu(sim, tmp_path / "x.fmu", "3.0")) as zf:
        names = zf.namelist()
        page = zf.read("documentation/index.html").decode()
        assert zf.read("resources/model.bin") == sim.block
    assert {"modelDescription.xml", "resources/model.bin", "documentation/index.html"} < set(names)
    assert sum(name.startswith("binaries/") for name in names) >= 1
    for term in sim.terms:
        assert f"<td>{term}</td>" in page


def test_a_failed_write_leaves_the_old_file(sim, tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"old")
    with pytest.raises(SchemaError, match=r"FMI version '1.0'; allowed: 2.0, 3.0"):
        write_fmu(sim, path, "1.0")
    assert path.read_bytes() == b"old"
    with pytest.raises(FileNotFoundError):
        write_fmu(sim, tmp_path / "absent" / "x.fmu")


def test_no_fmu_is_a_parse_error(tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"no zip")
    with pytest.raises(ParseError, match="no readable FMU"):
        read_fmu(path)


# ---- the same numbers


@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_and_the_direct_call_agree_to_the_bit(sim, fmus, inputs, version):
    direct = flightmech.simulate(sim, inputs, START, hold="zero")
    found = replay(fmus[version], inputs)
    np.testing.assert_array_equal(found["time"], inputs["time"])
    assert abs(found["theta"] - found["theta"][0]).max() > 0.02  # the manoeuvre is one
    for name in TRACE:
        np.testing.assert_array_equal(found[name], direct[name].values, err_msg=name)


def test_both_standards_agree_to_the_bit(fmus, inputs):
    second, third = (replay(fmus[v], inputs) for v in VERSIONS)
    for name in TRACE:
        np.testing.assert_array_equal(second[name], third[name], err_msg=name)


def test_input_derivatives_give_linear_inputs(sim, fmus, inputs):
    direct = flightmech.simulate(sim, inputs, START, hold="linear")
    names, time = [str(name) for name in inputs.data_vars], inputs["time"].values
    u = np.stack([inputs[name].values for name in names], axis=1)
    slave = Slave(fmus["2.0"]).start()
    references = [slave.references[name] for name in names]
    rows = [slave.get(*TRACE)]
    for k in range(len(time) - 1):
        dt = time[k + 1] - time[k]
        slave.fmu.setReal(references, u[k])
        slave.fmu.setRealInputDerivatives(references, [1] * len(names), (u[k + 1] - u[k]) / dt)
        slave.step(time[k], dt)
        rows.append(slave.get(*TRACE))
    for name, found in zip(TRACE, np.transpose(rows), strict=True):
        # the end value of a step is rebuilt from the slope: one rounding per input and step, 6 s of flight
        scale = abs(direct[name].values).max()
        np.testing.assert_allclose(found, direct[name].values, rtol=0.0, atol=1e-12 * scale, err_msg=name)


def test_derivatives_act_in_one_step_only(fmus):
    slave = Slave(fmus["2.0"]).start()
    slave.fmu.setRealInputDerivatives([slave.references["delta_e"]], [1], [-0.5])
    slave.step(0.0, 0.02)
    assert slave.get("delta_e") == [pytest.approx(-0.01, rel=1e-15)]
    slave.step(0.02, 0.02)
    assert slave.get("delta_e") == [pytest.approx(-0.01, rel=1e-15)]


def test_steps_of_any_size(sim, fmus, inputs):
    held = inputs.isel(time=[0, 1, 26, 27, 80])
    direct = flightmech.simulate(sim, held, START, hold="zero")
    slave = Slave(fmus["3.0"]).start()
    time = held["time"].values
    for k in range(len(time) - 1):
        slave.set({str(name): float(held[name][k]) for name in held.data_vars})
        slave.step(time[k], time[k + 1] - time[k])
        assert slave.get(*TRACE) == [float(direct[name][k + 1]) for name in TRACE]


def test_outputs_follow_inputs_without_a_step(slave):
    slave.start()
    slave.step(0.0, 0.02)
    before, q = slave.get("q_dot", "q")
    slave.set({"delta_e": 0.05})
    after, q_now = slave.get("q_dot", "q")
    assert after < before  # trailing edge down pitches down
    assert q_now == q


def test_trim_at_the_start_is_reported(sim, slave):
    direct = flightmech.trim(sim, START)
    slave.start()
    for name in ("trim.alpha", "trim.delta_e", "trim.thrust", "trim.w_dot", "trim.q_dot"):
        assert slave.get(name) == [float(direct[name])]
    w_dot, q_dot = slave.get("trim.w_dot", "trim.q_dot")
    assert abs(w_dot) < 1e-6
    assert abs(q_dot) < 1e-6


def test_initial_outputs_can_be_read_before_the_end_of_initialization(slave):
    slave.enter()
    slave.set(START)
    early = slave.get(*TRACE)
    slave.set({"init.V": 95.0})
    assert slave.get("V") == [pytest.approx(95.0, rel=1e-14)]
    slave.set({"init.V": START["init.V"]})
    slave.fmu.exitInitializationMode()
    assert slave.get(*TRACE) == early


# ---- states and instances


def test_a_stored_state_gives_the_same_bits_again(slave):
    slave.start()
    slave.set({"delta_e": -0.02})
    slave.step(0.0, 0.5)
    state = slave.fmu.getFMUState()
    kept = slave.fmu.serializeFMUState(state)

    def fly() -> list[float]:
        slave.set({"delta_a": 0.03})
        slave.step(0.5, 0.5)
        slave.step(1.0, 0.25)
        return slave.get(*TRACE, "out_of_range", "trim.delta_e")

    first = fly()
    slave.fmu.setFMUState(state)
    assert slave.get("delta_a", "delta_e") == [0.0, -0.02]
    assert fly() == first
    again = slave.fmu.deserializeFMUState(kept)
    slave.fmu.setFMUState(again)
    assert fly() == first
    for item in (state, again):
        slave.fmu.freeFMUState(item)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_serialised_state_moves_to_another_instance(fmus, version):
    one, two = Slave(fmus[version]).start(), Slave(fmus[version])
    one.step(0.0, 1.0)
    two.fmu.setFMUState(two.fmu.deserializeFMUState(one.fmu.serializeFMUState(one.fmu.getFMUState())))
    for item in (one, two):
        item.step(1.0, 1.0)
    assert one.get(*TRACE) == two.get(*TRACE)


def test_a_damaged_state_is_refused(slave):
    slave.start()
    kept = bytearray(slave.fmu.serializeFMUState(slave.fmu.getFMUState()))
    kept[-20] ^= 1
    with pytest.raises(FMICallException):
        slave.fmu.deserializeFMUState(bytes(kept))
    with pytest.raises(FMICallException):
        slave.fmu.deserializeFMUState(bytes(kept[:-8]))
    assert slave.messages == [
        "these bytes are a damaged state: its SHA-256 does not agree",
        "these bytes are no state of this model: wrong length",
    ]


def test_instances_do_not_touch_each_other(fmus):
    quiet, alone = Slave(fmus["2.0"]).start(), Slave(fmus["2.0"]).start()
    busy = Slave(fmus["3.0"]).start({"init.h": 6000.0})
    for k in range(50):
        busy.set({"delta_e": 0.05, "term.CL.basic": 1.5})
        for item in (quiet, busy, alone):
            item.step(0.02 * k, 0.02)
    assert quiet.get(*TRACE) == alone.get(*TRACE)
    assert busy.get("h")[0] > quiet.get("h")[0] + 2900.0
    busy.fmu.freeInstance()
    quiet.step(1.0, 0.02)


def test_reset_starts_afresh(slave):
    first = slave.start({"mass.mass": 3000.0}).get(*TRACE)
    slave.set({"delta_e": -0.1})
    slave.step(0.0, 1.0)
    slave.fmu.reset()
    assert slave.start().get(*TRACE) != first
    slave.fmu.reset()
    assert slave.start({"mass.mass": 3000.0}).get(*TRACE) == first


# ---- bad input


@pytest.mark.parametrize("version", VERSIONS)
def test_a_wrong_token_is_refused(fmus, version):
    with pytest.raises(Exception, match="Failed to instantiate"):
        Slave(fmus[version], guid="{wrong}")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("change", ["cut", "flip", "empty", "absent"])
def test_a_damaged_model_is_refused(sim, tmp_path, version, change):
    folder = Path(fmpy.extract(str(write_fmu(sim, tmp_path / "x.fmu", version)), str(tmp_path / "x")))
    block = folder / "resources" / "model.bin"
    data = bytearray(block.read_bytes())
    data[len(data) // 2] ^= 16
    {
        "cut": lambda: block.write_bytes(data[:-100]),
        "flip": lambda: block.write_bytes(data),
        "empty": lambda: block.write_bytes(b""),
        "absent": block.unlink,
    }[change]()
    slave = object.__new__(Slave)
    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.__init__(folder)
    (message,) = slave.messages
    expected = {
        "cut": "the file is truncated",
        "flip": "CRC-32 does not agree",
        "empty": "too few for a header",
        "absent": "cannot be opened",
    }
    assert expected[change] in message


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s: s.set({"delta_e": float("nan")}), "delta_e is nan; give a finite value"),
        (lambda s: s.set({"mass.mass": float("inf")}), "mass.mass is inf; give a finite value"),
        (lambda s: s.set({"init.V": 80.0}), "init.V acts at initialisation only; set it before the end of initialization mode, or reset"),
        (lambda s: s.set({"alpha": 0.1}), "alpha is an output and cannot be set"),
        (lambda s: s.step(5.0, 0.02), "step from t = 5 s, but the instance stands at 0 s"),
        (lambda s: s.step(0.0, -0.02), "step size is -0.02 s; give a positive, finite step"),
        (lambda s: s.step(0.0, float("nan")), "step size is nan s"),
        (lambda s: s.fmu.enterInitializationMode(), "entering initialization mode is not allowed while the instance is in step mode"),
    ],
)
def test_a_refused_call_says_why_and_changes_nothing(slave, act, message):
    slave.start()
    before = slave.get(*TRACE, "delta_e", "mass.mass")
    if "entering" in message and isinstance(slave.fmu, FMU3Slave):
        message = "setting the start time is not allowed while the instance is in step mode"
    with pytest.raises(FMICallException):
        act(slave)
    assert message in slave.messages[-1]
    assert slave.get(*TRACE, "delta_e", "mass.mass") == before
    slave.step(0.0, 0.02)


def test_unknown_references_are_refused(slave):
    slave.start()
    for reference in (999, 9_999, 99_999, 4_000_000_000):
        slave.references["unknown"] = reference
        with pytest.raises(FMICallException):
            slave.get("unknown")
        assert f"value reference {reference}" in slave.messages[-1]


def test_outputs_do_not_exist_before_initialization(slave):
    with pytest.raises(FMICallException):
        slave.get("alpha")
    assert slave.messages == ["reading an output is not allowed while the instance is instantiated"]


def test_a_diverged_model_stops_with_an_error_and_can_be_reset(slave):
    slave.start()
    slave.set({"mass.Iyy": 1e-300})
    with pytest.raises(FMICallException):
        slave.step(0.0, 20.0)
    assert "failed: " in slave.messages[-1]
    with pytest.raises(FMICallException):
        slave.step(0.0, 0.1)
    slave.fmu.reset()
    slave.start()
    slave.step(0.0, 0.1)


# ---- completeness, command line


def test_every_function_of_both_standards_is_there(fmus):
    library = ctypes.CDLL(str(next(fmus["2.0"].glob("binaries/*/*.so"))))
    headers = Path(fmpy.__file__).parent / "c-code"
    for header, count in (("fmi2FunctionTypes.h", 44), ("fmi3FunctionTypes.h", 75)):
        names = set(re.findall(r"\b(fmi[23]\w+)TYPE\b", (headers / header).read_text()))
        assert len(names) >= count
        assert [name for name in sorted(names) if not hasattr(library, name)] == []


def test_what_is_not_offered_says_so(slave):
    slave.start()
    with pytest.raises(FMICallException):
        slave.fmu.getBoolean([1000])
    assert "no variable of this type" in slave.messages[-1]
