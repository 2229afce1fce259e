"""What decides the last bit of a result apart from its inputs: the program, the libraries it counts
with, the arithmetic of the machine.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from platform import machine

from flightmech.support.imports import PACKAGES

LIBRARIES = ("aeromatch", "fmpy", "numpy", "scipy", "pandas", "xarray", "h5py", "jinja2", "typst")
"""Libraries whose version decides what is counted or written."""

_ARITHMETIC = (
    "OPENBLAS_CORETYPE",
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "MKL_CBWR",
    "NPY_DISABLE_CPU_FEATURES",
)


@cache
def hash_installation() -> str:
    """Return the hash of our packages with kernel, templates and tables, then the versions of
    `LIBRARIES` and the kind of machine.
    """
    digest = hashlib.sha256()
    for name in PACKAGES:
        folder = os.path.dirname(str(find_spec(name).origin))  # type: ignore[union-attr]
        for file in sorted(_files(folder)):
            digest.update(
                f"{name}/{file[len(folder) + 1 :]}".replace(os.sep, "/").encode()
                + b"\0"
                + Path(file).read_bytes()
            )
    return " ".join(
        [
            digest.hexdigest(),
            *(f"{name} {_version(name)}" for name in LIBRARIES),
            sys.platform,
            machine(),
        ]
    )


@cache
def hash_arithmetic() -> str:
    """Return what decides how linear algebra sums, short of importing it: settings of the
    environment, and the kind of processor.
    """
    set_to = {name: os.environ.get(name, "") for name in _ARITHMETIC}
    return hashlib.sha256(repr((set_to, sys.version_info[:3], _processor())).encode()).hexdigest()


def _processor() -> str:
    """Return model and features of the processor; its architecture where the system does not state
    them.
    """
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        wanted = ("model name", "flags", "Features", "CPU part")
        return " ".join(dict.fromkeys(line for line in lines if line.startswith(wanted)))
    return f"{machine()} {os.environ.get('PROCESSOR_IDENTIFIER', '')}"


def _files(folder: str) -> list[str]:
    """Return the files of a package, without what Python compiles and what lies hidden."""
    found: list[str] = []
    for item in os.scandir(folder):
        if item.is_dir():
            found += (
                [] if item.name == "__pycache__" or item.name.startswith(".") else _files(item.path)
            )
        elif not item.name.startswith(".") and not item.name.endswith(
            (".pyc", ".pyi", ".md", ".part")
        ):
            found.append(item.path)
    return found


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
