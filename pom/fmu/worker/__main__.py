"""The child process: jobs come on stdin, replies leave on a private copy of stdout; what the FMU prints goes to stderr."""

import os
import pickle
import shutil
import sys
import threading
import time

from pom.fmu.worker import Model, replay


def main(path: str, folder: str, parent: str) -> None:
    """Answer jobs until stdin ends, or the process with the number `parent`."""
    threading.Thread(target=_end_with, args=(int(parent), folder), daemon=True).start()
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        model, fault = Model(path, folder), ""
    except Exception as error:
        model, fault = None, f"loading failed: {error}"
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)
        except EOFError:
            break
        pickle.dump(replay(model, job) if model else {"outputs": None, "moved": {}, "error": fault}, replies)
        replies.flush()
    shutil.rmtree(folder, ignore_errors=True)


def _end_with(parent: int, folder: str) -> None:
    """End with the parent, even when the FMU hangs and reads no input any more."""
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


if __name__ == "__main__":
    main(*sys.argv[1:4])
