"""Folders of the binaries, and the universal binary of macOS read back by its header."""

from __future__ import annotations

import re
import struct

import pytest

from flightmech.errors import SchemaError
from flightmech.fmu_export.fmu_file import find_libraries, place_libraries
from flightmech.simulation.kernel import load_kernel

ALL = {
    "x86_64-linux": b"A",
    "aarch64-linux": b"B",
    "x86_64-windows": b"C",
    "x86_64-darwin": b"D" * 70_000,
    "aarch64-darwin": b"E" * 5,
}


def test_fmi3_has_a_folder_per_architecture():
    assert place_libraries(ALL, "t37", "3.0") == {
        "binaries/x86_64-linux/t37.so": b"A",
        "binaries/aarch64-linux/t37.so": b"B",
        "binaries/x86_64-windows/t37.dll": b"C",
        "binaries/x86_64-darwin/t37.dylib": ALL["x86_64-darwin"],
        "binaries/aarch64-darwin/t37.dylib": ALL["aarch64-darwin"],
    }


def test_fmi2_joins_the_macos_libraries_and_leaves_linux_on_arm_out():
    files = place_libraries(ALL, "t37", "2.0")
    assert sorted(files) == [
        "binaries/darwin64/t37.dylib",
        "binaries/linux64/t37.so",
        "binaries/win64/t37.dll",
    ]
    assert files["binaries/linux64/t37.so"] == b"A"
    fat = files["binaries/darwin64/t37.dylib"]
    magic, count = struct.unpack_from(">II", fat)
    assert (magic, count) == (0xCAFEBABE, 2)
    slices = {}
    for i in range(count):
        processor, _, offset, size, alignment = struct.unpack_from(">IIIII", fat, 8 + 20 * i)
        assert offset % (1 << alignment) == 0
        slices[processor] = fat[offset : offset + size]
    assert slices == {0x01000007: ALL["x86_64-darwin"], 0x0100000C: ALL["aarch64-darwin"]}


def test_one_macos_library_stays_as_it_is():
    assert place_libraries({"aarch64-darwin": b"E"}, "t37", "2.0") == {
        "binaries/darwin64/t37.dylib": b"E"
    }


def test_linux_on_arm_alone_needs_fmi3():
    with pytest.raises(SchemaError, match=r"no folder for aarch64-linux; write FMI 3\.0"):
        place_libraries({"aarch64-linux": b"B"}, "t37", "2.0")


def test_no_library_states_how_to_get_one(tmp_path):
    with pytest.raises(SchemaError, match=r"no compiled kernel .* run 'python hatch_build.py'"):
        find_libraries(tmp_path)


def test_an_fmu_carries_the_functions_of_the_standard_and_nothing_else():
    """Names that a library exports stand between zero bytes, on macOS with an underscore."""
    for platform, content in find_libraries().items():
        found = set(re.findall(rb"\0_?((?:am_|fmi[23])\w+)(?=\0)", content))
        interface = sorted(name for name in found if name.startswith(b"am_"))
        assert not interface, f"{platform}: {interface}"
        assert {b"fmi2DoStep", b"fmi2GetDerivatives", b"fmi3DoStep"} <= found, platform


def test_python_loads_a_library_without_the_standard():
    kernel = load_kernel()
    assert hasattr(kernel, "am_batch")
    assert not hasattr(kernel, "fmi3DoStep")
