"""Bubblewrap around a foreign process: what it sees of the system.

The process has a user namespace of its own without capabilities, no network, no other processes,
an empty environment and empty temporary folders. It sees the system's programs and libraries, the
interpreter, the packages, and the files that it works on, all read-only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from flightmech.errors import SchemaError
from flightmech.support.imports import PACKAGES

SANDBOX_VARIABLE = "AEROMATCH_FMU_SANDBOX"
MODES = ("auto", "bwrap", "none")
# The folder that holds our packages.
ROOT = Path(__file__).parents[3]
# Size of /run and /dev/shm. [byte]
_SMALL = 16_000_000
# Programs and libraries of the system; /nix and /gnu hold them where /usr does not.
_SYSTEM = ("/usr", "/nix/store", "/gnu/store")
_LINKED = ("/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
_LINKER = ("/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d", "/etc/localtime")
# Time for an empty program. [s]
_PROBE = 30.0


def sandbox_words(
    readable: Iterable[str | os.PathLike[str]] = (), writable: str = "", size: int = 1_000_000_000
) -> list[str]:
    """Return the words before a command that runs in bubblewrap.

    Parameters
    ----------
    readable : iterable of path
        Files and folders that the command reads. They have their own paths.
    writable : str
        Folder of the system that it may write; without it, nothing outside of the sandbox.
    size : int
        Size of its temporary folder ``/tmp``. [byte]
    """
    words = ["bwrap", "--unshare-user", "--unshare-pid", "--unshare-ipc", "--unshare-net"]
    words += ["--unshare-uts", "--unshare-cgroup-try", "--uid", "65534", "--gid", "65534"]
    words += ["--cap-drop", "ALL", "--new-session", "--die-with-parent", "--clearenv"]
    if "--disable-userns" in _options():
        words.append("--disable-userns")
    words += ["--dev", "/dev", *_tmpfs("/dev/shm", _SMALL), "--remount-ro", "/dev"]
    # The superuser owns the settings of the kernel in /proc also without capabilities.
    words += ["--proc", "/proc", "--remount-ro", "/proc"]
    words += [*_tmpfs("/tmp", size), *_tmpfs("/run", _SMALL)]
    for path in _SYSTEM:
        words += ["--ro-bind-try", path, path]
    for path in _LINKED:
        if os.path.islink(path):
            words += ["--symlink", os.readlink(path), path]
        else:
            words += ["--ro-bind-try", path, path]
    for path in _LINKER:
        words += ["--ro-bind-try", path, path]
    for path in [*_interpreter_paths(), *(os.fspath(item) for item in readable)]:
        words += ["--ro-bind", path, path]
    if writable:
        words += ["--bind", writable, writable]
    for name, value in sandbox_environment().items():
        words += ["--setenv", name, value]
    # The root itself is in memory, and without a limit of its size.
    return [*words, "--remount-ro", "/", "--chdir", writable or "/tmp"]


def sandbox_environment() -> dict[str, str]:
    """Return the whole environment of a process in the sandbox."""
    return {
        "PATH": "/usr/bin:/bin",
        "HOME": "/tmp",
        "TMPDIR": "/tmp",
        "LC_ALL": "C.UTF-8",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT),
        "PYTHONDONTWRITEBYTECODE": "1",
        SANDBOX_VARIABLE: "none",
    }


def _tmpfs(path: str, size: int) -> list[str]:
    if "--size" in _options():
        return ["--size", str(size), "--tmpfs", path]
    return ["--tmpfs", path]


@cache
def _interpreter_paths() -> tuple[str, ...]:
    """Return the folders of the interpreter, of installed packages, and of ours."""
    prefixes = [sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix]
    folders = [*prefixes, os.path.dirname(os.path.dirname(os.path.realpath(sys.executable)))]
    for entry in sys.path:
        if os.path.basename(entry) in ("site-packages", "dist-packages"):
            folders.append(entry)
    folders += [str(ROOT / name) for name in PACKAGES]
    bound: list[str] = []
    for folder in dict.fromkeys([*folders, *map(os.path.realpath, folders)]):
        # What lies in a folder that is already bound is seen there.
        known = ["/usr", *bound]
        is_seen = any(folder == item or folder.startswith(item + "/") for item in known)
        if folder != "/" and os.path.isdir(folder) and not is_seen:
            bound.append(folder)
    return tuple(bound)


def read_sandbox_mode(environment: Mapping[str, str] = os.environ) -> str:
    """Return ``auto`` (a sandbox where there is one), ``bwrap`` (always) or ``none``.

    Raises
    ------
    SchemaError
        Another word, or ``bwrap`` on a system where bubblewrap does not work.
    """
    mode = environment.get(SANDBOX_VARIABLE, "").strip() or "auto"
    if mode not in MODES:
        allowed = " or ".join(map(repr, MODES))
        raise SchemaError("environment", [f"{SANDBOX_VARIABLE} is {mode!r}; give {allowed}"])
    if mode == "bwrap" and sandbox_problem():
        raise SchemaError(
            "environment",
            [
                f"{SANDBOX_VARIABLE} is 'bwrap', and {sandbox_problem()}; install bubblewrap, or "
                f"leave the variable out"
            ],
        )
    return mode


def uses_sandbox(mode: str) -> bool:
    """Return whether code of others runs in the sandbox under a mode."""
    return mode == "bwrap" or (mode == "auto" and not sandbox_problem())


def sandbox_problem() -> str:
    """Return why this system has no sandbox; empty if it has one."""
    if sys.platform != "linux":
        return "bubblewrap needs Linux"
    program = shutil.which("bwrap")
    if program is None:
        return "the program bwrap is missing"
    return _probe_sandbox(program)


@cache
def _probe_sandbox(program: str) -> str:
    """Return why an empty program does not run in the sandbox; empty if it does."""
    command = [*sandbox_words(), sys.executable, "-I", "-S", "-c", ""]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_PROBE, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{program} does not run ({error})"
    if done.returncode:
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines() or ["no reason printed"]
        return f"{program} makes no sandbox here ({lines[-1].strip()})"
    return ""


def _options() -> str:
    """Return the help of bubblewrap, which lists the options of its version."""
    return _read_help(shutil.which("bwrap") or "")


@cache
def _read_help(program: str) -> str:
    if not program:
        return ""
    with subprocess.Popen(
        [program, "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        output, _ = process.communicate(timeout=_PROBE)
    return output.decode("utf-8", "replace")


def name_sandbox() -> str:
    """Return the name of the sandbox of code of others on this system; ``none`` with the reason."""
    text = describe_sandbox()
    return "bubblewrap" if text.startswith("in ") else text.replace("without a sandbox", "none")


def describe_sandbox(mode: str | None = None) -> str:
    """Return in which sandbox code of others runs on this system, for a report."""
    mode = mode or read_sandbox_mode()
    if uses_sandbox(mode):
        return "in the sandbox of bubblewrap"
    reason = f"{SANDBOX_VARIABLE} is 'none'" if mode == "none" else sandbox_problem()
    return f"without a sandbox ({reason})"
