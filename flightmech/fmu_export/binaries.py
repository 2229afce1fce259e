"""The compiled kernel as the binaries of an FMU.

FMI 3.0 has a folder per architecture.  FMI 2.0 has one slot for 64-bit Linux and one for macOS: the first takes the x86-64
library (a Linux on ARM needs FMI 3.0), the second a universal binary of both macOS libraries.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

from ..errors import SchemaError
from ..simulation.kernel import FOLDER, SUFFIX

FMI2_FOLDER = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64", "aarch64-darwin": "darwin64"}

# Mach-O universal binary: big-endian header, <mach-o/fat.h>; processor types of <mach/machine.h>, alignment 2**14
_FAT_MAGIC = 0xCAFEBABE
_PROCESSOR = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}
_ALIGNMENT = 14


def compiled(folder: Path = FOLDER) -> dict[str, bytes]:
    """Return the libraries found, by platform such as ``x86_64-linux``.

    Raises
    ------
    SchemaError
        When there is none.
    """
    found = {path.parent.name: path.read_bytes() for suffix in SUFFIX.values() for path in sorted(folder.glob(f"*/*{suffix}"))}
    if not found:
        raise SchemaError("FMU", [f"no compiled kernel under {folder}; install the package, or run 'python hatch_build.py' in a checkout"])
    return found


def binaries(libraries: Mapping[str, bytes], identifier: str, version: str) -> dict[str, bytes]:
    """Return the files of the folder ``binaries`` by their place in the FMU.

    Parameters
    ----------
    libraries : mapping of str to bytes
        Libraries by platform, from `compiled`.
    identifier : str
        Model identifier: the file name that importers look for.
    version : {"2.0", "3.0"}
        FMI version.

    Raises
    ------
    SchemaError
        When FMI `version` has no folder for any of the libraries.
    """
    if version == "3.0":
        return {f"binaries/{name}/{identifier}{_suffix(name)}": data for name, data in libraries.items()}
    known = {name: data for name, data in libraries.items() if name in FMI2_FOLDER}
    if not known:
        raise SchemaError("FMU", [f"FMI 2.0 has no folder for {', '.join(libraries)}; write FMI 3.0"])
    mac = {name: data for name, data in known.items() if name in _PROCESSOR}
    if len(mac) > 1:
        known = {name: data for name, data in known.items() if name not in mac} | {next(iter(mac)): universal(mac)}
    return {f"binaries/{FMI2_FOLDER[name]}/{identifier}{_suffix(name)}": data for name, data in known.items()}


def universal(libraries: Mapping[str, bytes]) -> bytes:
    """Return the macOS libraries of several processors joined into one universal binary."""
    step = 1 << _ALIGNMENT
    header, body = struct.pack(">II", _FAT_MAGIC, len(libraries)), b""
    offset = step
    for name, data in sorted(libraries.items()):
        header += struct.pack(">IIIII", *_PROCESSOR[name], offset, len(data), _ALIGNMENT)
        body += data + bytes(-len(data) % step)
        offset = step + len(body)
    return header.ljust(step, b"\0") + body


def _suffix(name: str) -> str:
    return SUFFIX[name.split("-")[1]]
