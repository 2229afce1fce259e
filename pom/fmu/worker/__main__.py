"""Main program of the child process.

Jobs come on stdin. Replies are written to a private copy of stdout. The text that the FMU prints
goes to stderr.
"""

from __future__ import annotations

import os
import pickle
import select
import shutil
import signal
import sys
import threading
import time
from functools import partial

import numpy as np

from flightmech.support.foreign_code.launch import set_limit
from pom.fmu.worker.messages import reply_bytes, reply_columns
from pom.fmu.worker.model import UnpackedFmu
from pom.fmu.worker.run import replay_job


def answer_jobs(path: str, folder: str, parent: str, written: str, unpacked: str) -> None:
    """Answer jobs until stdin or the process `parent` ends.

    Parameters
    ----------
    path, folder : str
        The FMU, and the folder for its files.
    parent : str
        Number of the parent process; 0: it is not visible in the sandbox.
    written, unpacked : str
        As in `pom.fmu.limits.WorkerLimits`. [byte]
    """
    if int(parent):
        watch = partial(_end_with, int(parent), folder)
    else:
        watch = partial(_end_with_input)
    threading.Thread(target=watch, daemon=True).start()
    # The FMU can print to stdout, which is therefore redirected to stderr.
    replies = os.dup(1)
    os.dup2(2, 1)
    try:
        model, fault = UnpackedFmu(path, folder, int(unpacked)), ""
    except Exception as error:
        model, fault = None, f"loading failed: {error}"
    if int(written):
        set_limit("RLIMIT_FSIZE", int(written))
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)  # of the parent
        except EOFError:
            break
        if model is None:
            _send(replies, reply_bytes(job["number"], fault, np.empty((0, 0))))
            continue
        reply = replay_job(model, job)
        _send(replies, reply_bytes(job["number"], reply["error"], reply_columns(job, reply)))
    shutil.rmtree(folder, ignore_errors=True)


def _send(handle: int, content: bytes) -> None:
    unsent = memoryview(content)
    while unsent:
        unsent = unsent[os.write(handle, unsent) :]


def _end_with(parent: int, folder: str) -> None:
    """End this process and all processes of the FMU when the parent ends.

    A hanging FMU does not read the end of its input, so a thread watches the parent.
    """
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    _end_all()


def _end_with_input() -> None:
    """End this process and all processes of the FMU when nobody holds the other end of stdin.

    Bubblewrap ends with its parent only from the moment in which it has asked the system for it.
    A parent that is killed before leaves a sandbox behind, and a hanging FMU in it for ever.
    """
    waiting = select.poll()
    waiting.register(0, 0)  # without an event: only the end of the pipe is reported
    waiting.poll()
    _end_all()


def _end_all() -> None:
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    answer_jobs(*sys.argv[1:6])
