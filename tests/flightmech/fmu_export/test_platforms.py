"""The libraries for other platforms, built here and run under QEMU and Wine: the same bits as on
this machine.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.validation import validate_fmu

import flightmech
from flightmech.fmu_export import fmu_file as writer
from flightmech.fmu_export.fmu_file import find_libraries

ROOT = Path(__file__).parents[3]
ARM_LIBRARIES = "/usr/aarch64-linux-gnu"
# platform: program that runs its programs, suffix of a program
RUNNERS = {
    "x86_64-linux": ((), ""),
    "aarch64-linux": (("qemu-aarch64", "-L", ARM_LIBRARIES), ""),
    "x86_64-windows": (("wine",), ".exe"),
}
MOVED = {"delta_e": -0.03, "delta_a": 0.02, "delta_r": 0.03}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.nightly,
    pytest.mark.skipif(
        os.uname().machine != "x86_64", reason="the emulators are those of an x86-64 Linux"
    ),
]


@pytest.fixture(scope="module")
def libraries(tmp_path_factory) -> dict[str, bytes]:
    """Compile the kernel for every platform, next to that of the installed package."""
    folder = tmp_path_factory.mktemp("binaries")
    build = (
        f"import hatch_build, pathlib; hatch_build.OUT = pathlib.Path({str(folder)!r}); "
        f"hatch_build.build()"
    )
    subprocess.run(
        [sys.executable, "-c", build],
        cwd=ROOT,
        env={**os.environ, "AEROMATCH_TARGETS": "all"},
        check=True,
        timeout=30000,
    )
    return find_libraries(folder)


@pytest.fixture(scope="module")
def record() -> xr.Dataset:
    """Half a minute of pulses at 50 Hz."""
    time = 0.02 * np.arange(1501)
    signals = {
        name: ("time", size * np.sin(np.clip((time - 2.0 - 8.0 * i) / 1.5, 0.0, 1.0) * 2.0 * np.pi))
        for i, (name, size) in enumerate(MOVED.items())
    }
    return xr.Dataset(signals, {"time": time})


@pytest.fixture(scope="module")
def direct(trainer, record, condition, libraries) -> np.ndarray:
    """The outputs of the kernel of this machine, every one at every sample."""
    found = flightmech.simulate(trainer, record, condition)
    assert np.ptp(found["theta"].values) > 0.05
    return np.stack([found[name].values for name in trainer.outputs], axis=1)


@pytest.fixture(scope="module")
def unpacked(trainer, libraries, tmp_path_factory) -> Path:
    """An FMU with all libraries, unpacked."""
    folder = tmp_path_factory.mktemp("all")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "find_libraries", lambda: libraries)
        flightmech.write_fmu(trainer, folder / "two.fmu", "2.0")
        path = flightmech.write_fmu(trainer, folder / "all.fmu", "3.0")
    assert validate_fmu(str(path)) == []
    return Path(fmpy.extract(str(path), str(folder / "all")))


def test_one_fmu_carries_every_platform(unpacked):
    assert sorted(path.name for path in (unpacked / "binaries").iterdir()) == [
        "aarch64-darwin",
        "aarch64-linux",
        "x86_64-darwin",
        "x86_64-linux",
        "x86_64-windows",
    ]
    with zipfile.ZipFile(unpacked.parent / "two.fmu") as archive:
        folders = {
            name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")
        }
    assert folders == {"linux64", "win64", "darwin64"}


@pytest.mark.parametrize("platform", RUNNERS)
def test_the_same_bits_on_every_platform(
    platform, trainer, unpacked, record, direct, condition, tmp_path
):
    runner, suffix = RUNNERS[platform]
    if runner and not shutil.which(runner[0]):
        pytest.skip(f"{runner[0]} is not installed: the library for {platform} is not run")
    if runner[:1] == ("qemu-aarch64",) and not Path(ARM_LIBRARIES).is_dir():
        pytest.skip(
            f"{ARM_LIBRARIES} is absent (Debian package libc6-arm64-cross): the library for "
            f"{platform} is not run"
        )
    program = importer(platform, tmp_path / f"flight{suffix}")
    (library,) = (unpacked / "binaries" / platform).iterdir()
    arrays = tmp_path / "arrays.bin"
    u = np.zeros((record.sizes["time"], len(trainer.inputs)))
    for name in MOVED:
        u[:, trainer.inputs.index(name)] = record[name].values
    sizes = np.array([len(u), u.shape[1], len(trainer.outputs)], np.int64)
    arrays.write_bytes(sizes.tobytes() + record["time"].values.tobytes() + u.tobytes())
    description = fmpy.read_model_description(str(unpacked))
    references = {v.name: v.valueReference for v in description.modelVariables}
    done = subprocess.run(
        [
            *runner,
            str(program),
            native(runner, library),
            native(runner, unpacked / "resources"),
            description.guid,
            native(runner, arrays),
        ],
        input="".join(
            f"{references[name]} {value:.17g}\n" for name, value in condition.items()
        ).encode(),
        capture_output=True,
        env={**os.environ, "WINEDEBUG": "-all", "WINEPREFIX": str(tmp_path / "wine")},
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-2000:]
    np.testing.assert_array_equal(np.frombuffer(done.stdout).reshape(direct.shape), direct)


def importer(platform: str, program: Path) -> Path:
    """Compile the importer for a platform."""
    sys.path.insert(0, str(ROOT))
    try:
        from hatch_build import TARGETS
    finally:
        sys.path.remove(str(ROOT))
    source = Path(__file__).parents[1] / "fmu_flight.c"
    linking = [] if "windows" in platform else ["-ldl"]
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        TARGETS[platform].zig,
        "-O2",
        "-std=c11",
        str(source),
        *linking,
    ]
    subprocess.run([*command, "-o", str(program)], check=True, timeout=3000)
    return program


def native(runner: tuple[str, ...], path: Path) -> str:
    """Return a path as the program sees it: Wine has the root of this system as drive Z."""
    return f"Z:{path}" if runner == ("wine",) else str(path)


@pytest.mark.parametrize("platform", ["x86_64-darwin", "aarch64-darwin"])
def test_the_macos_libraries_hold_both_standards(platform, libraries):
    """They are not run anywhere here: that they are Mach-O files with the functions of the standard
    is all that is known.
    """
    library = libraries[platform]
    assert library[:4] == b"\xcf\xfa\xed\xfe"
    for name in (
        b"_fmi2Instantiate",
        b"_fmi2DoStep",
        b"_fmi3InstantiateModelExchange",
        b"_fmi3DoStep",
        b"_fmi3GetFloat64",
    ):
        assert name in library
