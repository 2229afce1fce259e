"""Hashes of program, libraries and arithmetic, which results depend on besides their inputs."""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path
from platform import machine

from flightmech.plugins import DATABASE_EXPORTERS, DATABASE_IMPORTERS, RECORD_READERS
from flightmech.support.imports import PACKAGES

LIBRARIES = ("aeromatch", "fmpy", "numpy", "scipy", "pandas", "xarray", "h5py", "jinja2", "typst")
"""Libraries whose version can change results or files."""

# environment variables that select kernels and threads of the linear algebra
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
    """Return the hash of our packages, the versions of `LIBRARIES` and the kind of machine.

    The packages include kernel, templates and tables. Readers and exporters that other packages add
    count as well (`flightmech.plugins`).
    """
    digest = hashlib.sha256()
    for name in PACKAGES:
        folder = os.path.dirname(str(find_spec(name).origin))  # type: ignore[union-attr]
        for file in sorted(_list_files(folder)):
            # the same path on all systems
            path = f"{name}/{file[len(folder) + 1 :]}".replace(os.sep, "/")
            digest.update(path.encode() + b"\0" + Path(file).read_bytes())
    versions = [f"{name} {_find_version(name)}" for name in LIBRARIES]
    return " ".join([digest.hexdigest(), *versions, sys.platform, machine(), *_hash_plugins()])


def _hash_plugins() -> list[str]:
    """Return name, object, version and hash of the sources of each entry point of our groups."""
    points: list[EntryPoint] = []
    for group in (RECORD_READERS, DATABASE_EXPORTERS, DATABASE_IMPORTERS):
        points += entry_points(group=group)
    texts = []
    for point in points:
        release = point.dist.version if point.dist else ""
        digest = _hash_package(point.module.partition(".")[0])
        texts.append(f"{point.group} {point.name} {point.value} {release} {digest}")
    return sorted(texts)


def _hash_package(name: str) -> str:
    """Return the hash of the files of a top-level package or module; it is not imported."""
    spec = find_spec(name)
    digest = hashlib.sha256()
    folders = list(spec.submodule_search_locations or ()) if spec else []
    files: list[str] = []
    for folder in folders:
        files += sorted(_list_files(folder))
    if spec and not folders and spec.origin:
        files = [spec.origin]
    for file in files:
        digest.update(Path(file).name.encode() + b"\0" + Path(file).read_bytes())
    return digest.hexdigest()


# Files that are the same in a checkout and in a wheel of any platform.
_SOURCES = (".py", ".csv", ".toml", ".html", ".css", ".js", ".json", ".typ", ".txt", ".svg")
_EXAMPLES = "aeromatch/data/"  # only in a wheel


@cache
def hash_sources() -> dict[str, str]:
    """Return the hash of the sources, tables and templates of each of our packages, by name.

    Compiled libraries differ between platforms and are not among them.
    """
    digests = {}
    for name in PACKAGES:
        folder = os.path.dirname(str(find_spec(name).origin))  # type: ignore[union-attr]
        digest = hashlib.sha256()
        for file in sorted(_list_files(folder)):
            path = f"{name}/{file[len(folder) + 1 :]}".replace(os.sep, "/")
            if path.endswith(_SOURCES) and not path.startswith(_EXAMPLES):
                digest.update(path.encode() + b"\0" + Path(file).read_bytes() + b"\0")
        digests[name] = digest.hexdigest()
    return digests


@cache
def hash_arithmetic() -> str:
    """Return the hash of the settings that change the sums of the linear algebra.

    These are environment variables, the version of Python and the kind of processor. The libraries
    are not imported.
    """
    settings = {name: os.environ.get(name, "") for name in _ARITHMETIC}
    text = repr((settings, sys.version_info[:3], _describe_processor()))
    return hashlib.sha256(text.encode()).hexdigest()


def _describe_processor() -> str:
    """Return model and features of the processor, or its architecture if they are unknown."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        keys = ("model name", "flags", "Features", "CPU part")
        # the lines repeat for each core
        return " ".join(dict.fromkeys(line for line in lines if line.startswith(keys)))
    return f"{machine()} {os.environ.get('PROCESSOR_IDENTIFIER', '')}"


def _list_files(folder: str) -> list[str]:
    """Return the files of a package, without compiled and hidden files."""
    files: list[str] = []
    for item in os.scandir(folder):
        if item.name.startswith(".") or item.name == "__pycache__":
            continue
        if item.is_dir():
            files += _list_files(item.path)
        elif not item.name.endswith((".pyc", ".pyi", ".md", ".part")):
            files.append(item.path)
    return files


def _find_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
