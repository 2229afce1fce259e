"""The child process: jobs come on stdin, replies leave on a private copy of stdout; what the FMU
prints goes to stderr.
"""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress

import numpy as np

from pom.fmu.worker import UnpackedFmu, replay_job
from pom.fmu.worker.messages import reply_bytes, reply_columns


def answer_jobs(
    path: str, folder: str, parent: str, memory: str, written: str, unpacked: str
) -> None:
    """Answer jobs until stdin ends, or the process with the number `parent`; 0: somebody else
    watches over it.
    """
    if int(parent):
        threading.Thread(target=_end_with, args=(int(parent), folder), daemon=True).start()
    replies = os.dup(1)
    os.dup2(2, 1)
    _limit("RLIMIT_AS", int(memory))
    _limit("RLIMIT_CORE", 1)
    try:
        model, fault = UnpackedFmu(path, folder, int(unpacked)), ""
    except Exception as error:
        model, fault = None, f"loading failed: {error}"
    _limit("RLIMIT_FSIZE", int(written))
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)  # of the parent
        except EOFError:
            break
        if model is None:
            _send(replies, reply_bytes(job["number"], fault, np.empty((0, 0))))
            continue
        found = replay_job(model, job)
        _send(replies, reply_bytes(job["number"], found["error"], reply_columns(job, found)))
    shutil.rmtree(folder, ignore_errors=True)


def _send(handle: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(handle, rest) :]


def _limit(kind: str, size: int) -> None:
    """Set a limit of the process where the system has it; 0: none."""
    try:
        import resource
    except ImportError:
        return
    if size and hasattr(resource, kind):
        which = getattr(resource, kind)
        most = resource.getrlimit(which)[1]
        size = size if most == resource.RLIM_INFINITY else min(size, most)
        with suppress(ValueError, OSError):  # macOS does not limit the address space
            resource.setrlimit(which, (size, size))


def _end_with(parent: int, folder: str) -> None:
    """End with the parent, and all processes of the FMU, even when it hangs and reads no input any
    more.
    """
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    answer_jobs(*sys.argv[1:7])
