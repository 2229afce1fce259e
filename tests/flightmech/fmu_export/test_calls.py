"""An instance call by call: stored states, independence, refused calls."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from urllib.parse import quote

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import fmi3LogMessageCallback

from flightmech.fmu_export.fmu_file import write_fmu

VERSIONS = ("2.0", "3.0")
TRACE = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "h",
    "az",
    "CL",
    "Cm",
    "engine1.thrust",
)


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
def test_a_serialised_state_moves_to_another_instance(version, instance):
    one, two = instance(version).start(), instance(version)
    one.step(0.0, 1.0)
    two.fmu.setFMUState(
        two.fmu.deserializeFMUState(one.fmu.serializeFMUState(one.fmu.getFMUState()))
    )
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
        "these bytes are not a state of this model: wrong length",
    ]


@pytest.mark.parametrize("version", VERSIONS)
def test_reading_outputs_and_setting_inputs_again_changes_no_bit(version, instance):
    silent, watched = instance(version).start(), instance(version).start()
    inputs = {"delta_e": -0.02, "delta_a": 0.0, "engine1.throttle": 0.4}
    for k in range(40):
        now = inputs | {"delta_e": -0.02 if k < 20 else 0.01}
        if k in (0, 20):
            silent.set(now)
        watched.get(*TRACE)
        watched.set(now)
        for one in (silent, watched):
            one.step(0.01 * k, 0.01)
    assert watched.get(*TRACE) == silent.get(*TRACE)


def test_instances_do_not_touch_each_other(instance):
    quiet, alone = instance("2.0").start(), instance("2.0").start()
    busy = instance("3.0").start({"init.h": 6000.0})
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
def test_a_wrong_token_is_refused(fmus, version, third_party):
    slave = third_party(fmus[version], guid="{wrong}")
    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.open()
    (message,) = slave.messages
    assert message.startswith("token {wrong} does not belong to model.bin, whose SHA-256 is ")


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("form", ["{path}", "{path}/", "file://{quoted}", "FILE:{quoted}"])
def test_resources_are_found_by_path_and_by_uri(trainer, tmp_path, version, form):
    """FMI 2.0 passes a file URI and FMI 3.0 a path; importers of either pass both."""
    folder = Path(
        fmpy.extract(str(write_fmu(trainer, tmp_path / "x.fmu", version)), str(tmp_path / "a %20b"))
    )
    made, messages = instantiate_at(folder, version, form)
    assert made, messages
    assert messages == []


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("location", ["", "http://host/resources", "file:///%zz", "/" + 5000 * "x"])
def test_a_resource_location_of_another_kind_is_refused(fmus, version, location):
    made, (message,) = instantiate_at(fmus[version], version, location)
    assert not made
    assert message.endswith(
        "is neither a path nor a file URI, or is too long; give the resources folder of the "
        "unpacked FMU, as a path or as file:///<folder>/resources"
    )


def instantiate_at(folder: Path, version: str, form: str) -> tuple[bool, list[str]]:
    """Instantiate for co-simulation at a resource location; return success and the messages."""
    path = folder / "resources"
    location = form.format(path=path, quoted=quote(str(path))).encode()
    model = fmpy.read_model_description(str(folder))
    (binary,) = (folder / "binaries").glob("*linux*/*.so")
    library, messages = ctypes.CDLL(str(binary)), []
    token = model.guid.encode()
    if version == "2.0":
        logger = fmi2CallbackLoggerTYPE(lambda *message: messages.append(message[4].decode()))
        callbacks = fmi2CallbackFunctions(logger=logger)
        library.fmi2Instantiate.restype = ctypes.c_void_p
        made = library.fmi2Instantiate(
            b"x", 1, token, location, ctypes.byref(callbacks), False, False
        )
        if made:
            library.fmi2FreeInstance(ctypes.c_void_p(made))
    else:
        logger = fmi3LogMessageCallback(lambda *message: messages.append(message[3].decode()))
        create = library.fmi3InstantiateCoSimulation
        create.restype = ctypes.c_void_p
        flags = [ctypes.c_bool(False)] * 4
        nothing = ctypes.c_void_p(None)
        count = ctypes.c_size_t(0)
        made = create(b"x", token, location, *flags, nothing, count, nothing, logger, nothing)
        if made:
            library.fmi3FreeInstance(ctypes.c_void_p(made))
    return bool(made), messages


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("change", ["cut", "flip", "empty", "absent"])
def test_a_damaged_model_is_refused(trainer, tmp_path, version, change, third_party):
    folder = Path(
        fmpy.extract(str(write_fmu(trainer, tmp_path / "x.fmu", version)), str(tmp_path / "x"))
    )
    block = folder / "resources" / "model.bin"
    data = bytearray(block.read_bytes())
    data[len(data) // 2] ^= 16
    {
        "cut": lambda: block.write_bytes(data[:-100]),
        "flip": lambda: block.write_bytes(data),
        "empty": lambda: block.write_bytes(b""),
        "absent": block.unlink,
    }[change]()
    slave = third_party(folder)
    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.open()
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
        (lambda s: s.set({"delta_e": float("nan")}), "delta_e is nan; it must be finite"),
        (lambda s: s.set({"mass.mass": float("inf")}), "mass.mass is inf; it must be finite"),
        (
            lambda s: s.set({"init.V": 80.0}),
            "init.V acts at initialisation only; set it before the end of initialization "
            "mode, or reset",
        ),
        (lambda s: s.set({"alpha": 0.1}), "alpha is computed by the model and cannot be set"),
        (lambda s: s.step(5.0, 0.02), "step from t = 5 s, but the instance stands at 0 s"),
        (lambda s: s.step(0.0, -0.02), "step size is -0.02 s; give a positive, finite step"),
        (lambda s: s.step(0.0, float("nan")), "step size is nan s"),
        (
            lambda s: s.fmu.enterInitializationMode(),
            "entering initialization mode is not allowed while the instance is in step mode",
        ),
    ],
)
def test_a_refused_call_states_why_and_changes_nothing(slave, act, message):
    slave.start()
    before = slave.get(*TRACE, "delta_e", "mass.mass")
    if "entering" in message and slave.version == "3.0":
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


def test_an_impossible_start_is_named(slave):
    with pytest.raises(FMICallException):
        slave.start({"mass.mass": -1.0})
    assert slave.messages == ["initialisation failed: mass.mass is -1; it must be positive"]
    slave.fmu.reset()
    slave.start()


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


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_folders_with_blanks_and_accents(trainer, tmp_path, version, third_party):
    folder = tmp_path / "a b é %20 #"
    folder.mkdir()
    unpacked = fmpy.extract(str(write_fmu(trainer, folder / "x.fmu", version)), str(folder / "x"))
    assert third_party(Path(unpacked)).open().start().get("V") == [pytest.approx(90.0, rel=1e-14)]


# ---- completeness


def test_every_function_of_both_standards_is_there(fmus):
    library = ctypes.CDLL(str(next(fmus["2.0"].glob("binaries/*/*.so"))))
    headers = Path(fmpy.__file__).parent / "c-code"
    for header, count in (("fmi2FunctionTypes.h", 44), ("fmi3FunctionTypes.h", 75)):
        names = set(re.findall(r"\b(fmi[23]\w+)TYPE\b", (headers / header).read_text()))
        assert len(names) >= count
        assert [name for name in sorted(names) if not hasattr(library, name)] == []


def test_what_is_not_offered_reports_it(slave):
    slave.start()
    with pytest.raises(FMICallException):
        slave.fmu.getBoolean([1000])
    assert "no variable of this type" in slave.messages[-1]
