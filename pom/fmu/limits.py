"""Limits of the child process of an FMU, from the environment, and its sandbox."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from flightmech.errors import SchemaError
from flightmech.support.foreign_code.process import RunLimits
from flightmech.support.foreign_code.sandbox import read_sandbox_mode, sandbox_words, uses_sandbox

_SIZES = {"": 1.0, "B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9}
# Size of the temporary folder in the sandbox without a limit of the files. [byte]
_LARGEST_FOLDER = 16_000_000_000


@dataclass(frozen=True)
class WorkerLimits:
    """Limits of a child process; 0: no limit.

    Attributes
    ----------
    memory : int
        Address space, ``AEROMATCH_FMU_MEMORY`` (POSIX). [byte]
    written : int
        Size of each file that it writes, and of its printed text, ``AEROMATCH_FMU_WRITTEN``
        (POSIX). [byte]
    unpacked : int
        Size of all files of the FMU together, ``AEROMATCH_FMU_UNPACKED``. [byte]
    processes : bool
        Whether it may start other processes, ``AEROMATCH_FMU_PROCESSES=none``: no limit (Linux).
    sandbox : str
        ``AEROMATCH_FMU_SANDBOX``: ``auto``, in bubblewrap where it works; ``bwrap``, always;
        ``none``.
    """

    memory: int = 2_000_000_000
    written: int = 256_000_000
    unpacked: int = 1_000_000_000
    processes: bool = False
    sandbox: str = "auto"

    def is_sandboxed(self) -> bool:
        """Return whether an FMU runs in bubblewrap on this system."""
        return uses_sandbox(self.sandbox)

    def of_process(self) -> RunLimits:
        """Return the limits that the process has from its start.

        The worker limits the size of files when the FMU is unpacked. Only the sandbox has no
        network.
        """
        return RunLimits(
            memory=self.memory,
            written=0,
            processes=self.processes,
            network=not self.is_sandboxed(),
        )


def read_worker_limits(environment: Mapping[str, str] = os.environ) -> WorkerLimits:
    """Return the limits of the environment.

    Raises
    ------
    SchemaError
        With all variables that are not a size, and a sandbox on a system without bubblewrap.

    Examples
    --------
    >>> stated = {"AEROMATCH_FMU_MEMORY": "8 GB", "AEROMATCH_FMU_WRITTEN": "none"}
    >>> limits = read_worker_limits(stated)
    >>> limits.memory, limits.written, limits.unpacked, limits.processes
    (8000000000, 0, 1000000000, False)
    """
    problems: list[str] = []
    sizes = {}
    for name in ("memory", "written", "unpacked"):
        variable = f"AEROMATCH_FMU_{name.upper()}"
        text = environment.get(variable, "").strip()
        if text:
            sizes[name] = _parse_size(variable, text, problems)
    processes = environment.get("AEROMATCH_FMU_PROCESSES", "").strip() or "0"
    if processes not in ("0", "none"):
        problems.append(
            f"AEROMATCH_FMU_PROCESSES is {processes!r}; give '0', or 'none' for no limit"
        )
    sandbox = "auto"
    try:
        sandbox = read_sandbox_mode(environment)
    except SchemaError as error:
        problems += error.problems
    if problems:
        raise SchemaError("environment", problems)
    return WorkerLimits(**sizes, processes=processes == "none", sandbox=sandbox)


def _parse_size(name: str, text: str, problems: list[str]) -> int:
    """Return the size in a text; 0 for 'none' and, with a problem, for another text. [byte]"""
    if text == "none":
        return 0
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]*)", text)
    if match is None or match[2] not in _SIZES or not float(match[1]):
        problems.append(f"{name} is {text!r}; give a size such as '4 GB' or '500 MB', or 'none'")
        return 0
    return round(float(match[1]) * _SIZES[match[2]])


_DEFAULT = WorkerLimits()


def sandboxed(
    folder: str = "",
    readable: Iterable[str | os.PathLike[str]] = (),
    limits: WorkerLimits = _DEFAULT,
) -> list[str]:
    """Return the words before a command that runs in bubblewrap as an FMU does.

    Parameters
    ----------
    folder : str
        Folder of the system that it may write; empty: only its own temporary folder.
    readable : iterable of path
        Files that it reads, in addition to interpreter and packages.
    limits : WorkerLimits
    """
    size = _LARGEST_FOLDER
    if limits.unpacked and limits.written:
        size = limits.unpacked + limits.written
    return sandbox_words(readable, folder, size)
