"""Many instances, threads, calls in any order, stored states of third parties: refused with a
message, never a crash.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import flightmech

VERSIONS = ("2.0", "3.0")
TRACE = ("V", "alpha", "q", "theta", "phi", "h", "engine1.thrust")
HEAD = 184  # bytes of the head of a serialised state, kernel/shell/store.c


def child(script: str, *arguments) -> str:
    """Run a script next to this file and return what it prints."""
    command = [sys.executable, str(Path(__file__).parents[1] / script), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr[-2000:]}"
    return done.stdout


def fly(slave, elevator: float) -> list[float]:
    """Fly a second with an elevator pulse."""
    slave.start()
    for k in range(50):
        slave.set({"delta_e": elevator if k < 20 else 0.0})
        slave.step(0.02 * k, 0.02)
    return slave.get(*TRACE)


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_a_thousand_instances_at_once(instance, version):
    slave = instance(version)
    alone, crowd = fly(slave, -0.01), []
    for _ in range(1000):  # one library, a thousand instances of it
        slave.open()
        crowd.append(slave.fmu.component)
    assert len(set(crowd)) == 1000
    for place in (0, 500, 999):
        slave.fmu.component = crowd[place]
        assert fly(slave, -0.01) == alone
    free = getattr(slave.fmu, f"fmi{version[0]}FreeInstance")
    for component in crowd[:999]:
        free(component)
    slave.step(1.0, 0.02)


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_instances_in_threads_give_the_bits_of_one(instance, version, monkeypatch):
    monkeypatch.chdir(
        Path.cwd()
    )  # FMPy changes the working directory while it loads a library, and threads lose it
    elevators = np.linspace(-0.02, 0.02, 16)
    alone = [fly(instance(version), elevator) for elevator in elevators]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda elevator: fly(instance(version), elevator), elevators))
    assert found == alone


@pytest.mark.parametrize("version", VERSIONS)
def test_a_set_with_one_bad_value_sets_nothing(instance, version):
    slave = instance(version).start()
    before = slave.get("delta_e", "delta_a", "mass.mass", *TRACE)
    with pytest.raises(FMICallException):
        slave.set({"delta_e": 0.1, "delta_a": float("nan"), "mass.mass": 3000.0})
    assert slave.messages[-1] == "delta_a is nan; it must be finite"
    with pytest.raises(FMICallException):
        slave.set({"delta_e": 0.1, "V": 1.0})
    assert slave.get("delta_e", "delta_a", "mass.mass", *TRACE) == before


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_calls_in_any_order_never_crash(fmus, version):
    """Run in a child process, since a crash would take the tests with it."""
    statuses = child("fmu_calls_child.py", fmus[version], "7").split()
    assert set(statuses) <= {"0", "2", "3"}  # done, discarded, refused
    assert {"0", "3"} <= set(statuses)


# ---- stored states of third parties


def sealed(image: bytes) -> bytes:
    """Return an image with the digest that belongs to its bytes, as a hostile hand would write
    it.
    """
    return image[:64] + hashlib.sha256(image[128:]).hexdigest().encode() + image[128:]


@pytest.fixture
def kept(instance) -> bytes:
    """A serialised state of a simulation in flight."""
    slave = instance("3.0").start()
    slave.step(0.0, 0.5)
    return slave.fmu.serializeFMUState(slave.fmu.getFMUState())


def test_the_seal_is_understood(instance, kept):
    assert sealed(kept) == kept


def test_a_state_of_another_model_is_refused(trainer, plain, tmp_path, third_party, kept):
    folder = fmpy.extract(
        str(flightmech.write_fmu(plain(), tmp_path / "p.fmu", "3.0")), str(tmp_path / "p")
    )
    other = third_party(Path(folder)).open()
    with pytest.raises(FMICallException):
        other.fmu.deserializeFMUState(kept)
    assert other.messages == ["these bytes are a state of another model"]


@pytest.mark.parametrize(
    ("offset", "form", "value", "message"),
    [
        (128, "<i", 7, "unknown mode"),
        (132, "<i", 99, "unknown mode"),
        (152, "<d", float("nan"), "time is not finite"),
        (168, "<Q", 0, "wrong length"),
        (168, "<Q", 2**60, "wrong length"),
        (176, "<Q", 1, "a state of another version of the kernel"),
    ],
)
def test_a_head_without_meaning_is_refused(instance, kept, offset, form, value, message):
    image = bytearray(kept)
    struct.pack_into(form, image, offset, value)
    slave = instance("3.0")
    with pytest.raises(FMICallException):
        slave.fmu.deserializeFMUState(sealed(bytes(image)))
    assert message in slave.messages[-1]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "case",
    [{"mode.controls": 2, "mode.engine": 0}, {"turbulence.mode": 1, "turbulence.sigma_w": 2.0}],
)
def test_hostile_states_never_crash(whole, third_party, tmp_path, case):
    """Random bits under a right seal, every submodel at work: refused, or flown to an error or to
    numbers.
    """
    slave, image = (
        third_party(whole["3.0"]).open().start({"mode.trim": 0, **case}),
        tmp_path / "state.bin",
    )
    slave.step(0.0, 0.5)
    image.write_bytes(slave.fmu.serializeFMUState(slave.fmu.getFMUState()))
    assert int(child("fmu_states_child.py", whole["3.0"], image, HEAD)) > 100


@pytest.mark.slow
def test_memory_does_not_grow_with_runs(instance):
    """A leak of one state, one instance or one image per round would be megabytes."""

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    if not Path("/proc/self/statm").exists():
        pytest.skip("resident memory is read from /proc, which this system does not have")

    slave = instance("3.0")

    def rounds(count: int) -> None:
        for _ in range(count):
            slave.start()
            slave.step(0.0, 0.02)
            state = slave.fmu.getFMUState()
            again = slave.fmu.deserializeFMUState(slave.fmu.serializeFMUState(state))
            slave.fmu.setFMUState(again)
            for item in (state, again):
                slave.fmu.freeFMUState(item)
            slave.fmu.reset()
            slave.fmu.fmi3FreeInstance(
                slave.fmu.component
            )  # freeInstance of FMPy would unload the library, too
            slave.open()

    def growth() -> int:
        """Return the growth over 100 rounds, without what the collector of Python has not freed."""
        gc.collect()
        before = resident()
        rounds(100)
        gc.collect()
        return resident() - before

    rounds(20)
    # One instance holds more than 60 kB: a leak of one per round would be 6 MB each time.  The
    # memory of the process may grow once for other reasons.
    assert min(growth() for _ in range(3)) < 3_000_000


def test_null_pointers_of_an_absent_instance_are_errors(fmus):
    library = ctypes.CDLL(str(next(fmus["2.0"].glob("binaries/*/*.so"))))
    nothing, zero = ctypes.c_void_p(None), ctypes.c_size_t(0)
    for name in (
        "fmi2Terminate",
        "fmi2Reset",
        "fmi2EnterEventMode",
        "fmi3Terminate",
        "fmi3EnterConfigurationMode",
        "fmi3Reset",
    ):
        assert getattr(library, name)(nothing) == 3
    for name in ("fmi2GetReal", "fmi2SetReal", "fmi3GetFloat64", "fmi3SetFloat64"):
        assert getattr(library, name)(nothing, None, zero, None, zero) == 3
    library.fmi2FreeInstance(nothing)
    library.fmi3FreeInstance(nothing)
