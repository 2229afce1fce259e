"""Kill a process at each of its calls that write, or let this call fail; no clock decides.

A test calls `run_preloaded` with a function of its own module.  That function runs in a new
process, in front of whose C library ``write_calls.c`` counts the calls.  There it repeats its work
with `each_call` and looks at the files after each kill; ``test_write_failures.py`` runs verbs of
the command line.
"""

from __future__ import annotations

import ctypes
import importlib.util
import inspect
import itertools
import os
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

SOURCE = Path(__file__).with_suffix(".c")


def run_preloaded(function: Callable[..., None], folder: Path) -> None:
    """Call ``function(folder)`` in a process with the counting library; fail with what it prints
    when it fails.
    """
    library = folder / "write_calls.so"
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    subprocess.run(
        [*compiler, "-shared", "-fPIC", "-O1", "-o", library, SOURCE, "-ldl"], check=True
    )
    work = folder / "work"
    work.mkdir()
    command = [sys.executable, __file__, inspect.getfile(function), function.__name__, work]
    environment = {
        **os.environ,
        "LD_PRELOAD": str(library),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    done = subprocess.run(
        command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    # the counts of calls and trials
    print(done.stdout)
    assert done.returncode == 0, done.stdout


def each_call(work: Callable[[], object], folder: Path) -> Iterator[int]:
    """Yield 1, 2, ... after a child process that does `work` was killed at that call of it that
    writes below `folder`.

    The last child completes the work, and the iterator ends.
    """
    library = ctypes.CDLL(os.environ["LD_PRELOAD"])
    for number in itertools.count(1):
        child = os.fork()
        if child == 0:
            code = 1
            try:
                library.kill_at_call(str(folder).encode(), ctypes.c_long(number))
                work()
                code = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if ended == 0:
            return
        assert ended == -signal.SIGKILL, f"the work failed before call {number}: exit code {ended}"
        yield number


def main() -> None:
    """Call the function of the module and the folder that the command line names."""
    module, function, folder = sys.argv[1:]
    specification = importlib.util.spec_from_file_location("killed_at_each_call", module)
    assert specification is not None
    assert specification.loader is not None
    test_module = importlib.util.module_from_spec(specification)
    # dataclasses look their module up by its name
    sys.modules[specification.name] = test_module
    specification.loader.exec_module(test_module)
    getattr(test_module, function)(Path(folder))


if __name__ == "__main__":
    main()
