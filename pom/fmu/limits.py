"""What the child process of an FMU may use; environment variables change it."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass

from flightmech.errors import SchemaError

_SIZES = {"": 1.0, "B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9}


@dataclass(frozen=True)
class Limits:
    """Limits of a child process; 0: none.

    Attributes
    ----------
    memory : int
        Address space, ``AEROMATCH_FMU_MEMORY`` (POSIX). [byte]
    written : int
        Any file that it writes, and what it prints, ``AEROMATCH_FMU_WRITTEN`` (POSIX). [byte]
    unpacked : int
        All files of the FMU together, ``AEROMATCH_FMU_UNPACKED``. [byte]
    sandbox : bool
        It runs in bubblewrap, ``AEROMATCH_FMU_SANDBOX=bwrap`` (Linux): without network, and writing to its own folder only.
    """

    memory: int = 2_000_000_000
    written: int = 256_000_000
    unpacked: int = 1_000_000_000
    sandbox: bool = False


def limits(environment: Mapping[str, str] = os.environ) -> Limits:
    """Return the limits as the environment has them.

    Raises
    ------
    SchemaError
        Variables that are no size; a sandbox where there is no bubblewrap; all of them.

    Examples
    --------
    >>> limits({"AEROMATCH_FMU_MEMORY": "8 GB", "AEROMATCH_FMU_WRITTEN": "none"})
    Limits(memory=8000000000, written=0, unpacked=1000000000, sandbox=False)
    """
    problems: list[str] = []
    sizes = {}
    for name in ("memory", "written", "unpacked"):
        text = environment.get(f"AEROMATCH_FMU_{name.upper()}", "").strip()
        if text:
            sizes[name] = _size(f"AEROMATCH_FMU_{name.upper()}", text, problems)
    sandbox = environment.get("AEROMATCH_FMU_SANDBOX", "").strip()
    if sandbox not in ("", "none", "bwrap"):
        problems.append(f"AEROMATCH_FMU_SANDBOX is {sandbox!r}; give 'bwrap' or 'none'")
    if sandbox == "bwrap" and not (sys.platform == "linux" and shutil.which("bwrap")):
        problems.append("AEROMATCH_FMU_SANDBOX is 'bwrap', and there is no program bwrap; install bubblewrap, or leave the variable out")
    if problems:
        raise SchemaError("environment", problems)
    return Limits(**sizes, sandbox=sandbox == "bwrap")


def _size(name: str, text: str, problems: list[str]) -> int:
    if text == "none":
        return 0
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]*)", text)
    if match is None or match[2] not in _SIZES or not float(match[1]):
        problems.append(f"{name} is {text!r}; give a size such as '4 GB' or '500 MB', or 'none'")
        return 0
    return round(float(match[1]) * _SIZES[match[2]])


def sandboxed(folder: str) -> list[str]:
    """Return what stands before a command that runs in bubblewrap: all is read-only but `folder`; no network, processes of its own."""
    rights = ["--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc", "--bind", folder, folder]
    return ["bwrap", *rights, "--unshare-net", "--unshare-pid", "--unshare-ipc", "--unshare-uts", "--die-with-parent", "--chdir", folder]
