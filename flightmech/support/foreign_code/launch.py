"""Program that sets the limits of a foreign process, and then becomes it.

``python -I -S launch.py LIMITS COMMAND ...`` with LIMITS as JSON. It imports the standard library
only, because it starts before every foreign process.
"""

import ctypes
import json
import os
import struct
import sys
from contextlib import suppress
from platform import machine

if sys.platform != "win32":
    import resource

_PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, _PR_SET_NO_NEW_PRIVS = 22, 2, 38
_ALLOW, _ERROR, _KILL_PROCESS = 0x7FFF0000, 0x00050000, 0x80000000
_EPERM, _EAGAIN, _ENOSYS = 1, 11, 38
_CLONE_THREAD = 0x00010000
# Calls with a number from here on have the 32-bit layout of x86.
_X32 = 0x40000000
# Architecture word of the kernel, and the numbers of the calls (Linux, asm/unistd.h).
_SYSTEMS = {
    "x86_64": (
        0xC000003E,
        {"clone": [56], "fork": [57, 58], "clone3": [435]},
        # socket, socketpair
        {"network": [41, 53]},
        # ptrace, mount, umount2, pivot_root, unshare, setns, move_mount, fsopen, open_tree,
        # process_vm_readv and writev, open_by_handle_at, pidfd_getfd
        [101, 165, 166, 155, 272, 308, 429, 430, 428, 310, 311, 304, 438],
        # add_key, request_key, keyctl, bpf, perf_event_open, userfaultfd, io_uring
        [248, 249, 250, 321, 298, 323, 425, 426, 427],
    ),
    "aarch64": (
        0xC00000B7,
        {"clone": [220], "fork": [], "clone3": [435]},
        {"network": [198, 199]},
        [117, 40, 39, 41, 97, 268, 429, 430, 428, 270, 271, 265, 438],
        [217, 218, 219, 280, 241, 282, 425, 426, 427],
    ),
}


def set_limits(limits: dict[str, int]) -> None:
    """Limit this process and all that it starts.

    Parameters
    ----------
    limits : dict
        ``memory`` and ``written`` [byte], ``files`` (open at once); 0: no limit. ``processes``:
        whether it may start other processes. ``network``: whether it may open sockets.
    """
    if sys.platform == "win32":
        return
    kinds = {"memory": "RLIMIT_AS", "written": "RLIMIT_FSIZE", "files": "RLIMIT_NOFILE"}
    for name, kind in kinds.items():
        if limits.get(name):
            set_limit(kind, limits[name])
    # A dump of the memory is not needed.
    set_limit("RLIMIT_CORE", 0)
    if not (limits.get("processes") and limits.get("network")):
        forbid_calls(bool(limits.get("processes")), bool(limits.get("network")))


def set_limit(kind: str, size: int) -> None:
    """Set a limit of this process if the system supports it."""
    if sys.platform == "win32" or not hasattr(resource, kind):
        return
    limit = getattr(resource, kind)
    # A process cannot raise its hard limit.
    hard = resource.getrlimit(limit)[1]
    if hard != resource.RLIM_INFINITY:
        size = min(size, hard)
    # macOS does not limit the address space.
    with suppress(ValueError, OSError):
        resource.setrlimit(limit, (size, size))


def forbid_calls(processes: bool, network: bool) -> None:
    """Forbid new processes, sockets, and calls that reach into other processes (Linux).

    The number of processes of the superuser has no other limit: RLIMIT_NPROC does not count them.
    Threads are allowed.
    """
    if not sys.platform.startswith("linux") or machine() not in _SYSTEMS or sys.maxsize < 2**32:
        return
    program = filter_program(machine(), processes, network)
    buffer = ctypes.create_string_buffer(program)
    head = struct.pack("@HxxxxxxQ", len(program) // 8, ctypes.addressof(buffer))
    call = ctypes.CDLL(None, use_errno=True).prctl
    call.argtypes = [ctypes.c_int, *([ctypes.c_ulong] * 4)]
    if call(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0:
        pointer = ctypes.create_string_buffer(head)
        call(_PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, ctypes.addressof(pointer), 0, 0)


def filter_program(system: str, processes: bool, network: bool) -> bytes:
    """Return the filter of system calls as a program of the kernel (seccomp, classic BPF)."""
    word, starts, sockets, reaching, deep = _SYSTEMS[system]
    refused = dict.fromkeys([*reaching, *deep], _EPERM)
    # io_uring opens sockets without the call that is filtered. Libraries work without it.
    refused |= dict.fromkeys([425, 426, 427], _ENOSYS)
    if not network:
        refused |= dict.fromkeys(sockets["network"], _EPERM)
    if not processes:
        refused |= dict.fromkeys(starts["fork"], _EAGAIN)
        # The flags of clone3 lie in memory. The C library then starts threads by clone.
        refused |= dict.fromkeys(starts["clone3"], _ENOSYS)
    lines = [
        # architecture; a process of another one is killed
        (0x20, 0, 0, 4),
        (0x15, 1, 0, word),
        (0x06, 0, 0, _KILL_PROCESS),
        (0x20, 0, 0, 0),
        # calls of the 32-bit layout
        (0x35, 0, 1, _X32),
        (0x06, 0, 0, _ERROR | _EPERM),
    ]
    for number, error in refused.items():
        lines += [(0x15, 0, 1, number), (0x06, 0, 0, _ERROR | error)]
    if not processes:
        for number in starts["clone"]:
            # The flags are the first argument, at byte 16. A thread is allowed.
            lines += [
                (0x15, 0, 4, number),
                (0x20, 0, 0, 16),
                (0x45, 1, 0, _CLONE_THREAD),
                (0x06, 0, 0, _ERROR | _EAGAIN),
                (0x06, 0, 0, _ALLOW),
            ]
    lines.append((0x06, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *line) for line in lines)


if __name__ == "__main__":
    set_limits(json.loads(sys.argv[1]))
    os.execv(sys.argv[2], sys.argv[2:])
