"""The packages on systems that the tests do not run on: every call that only POSIX has stands
behind a condition, and `run.ps1` does what `run` does.

Nothing of this is run on Windows or macOS: it is read.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from flightmech.support import atomic_write, temporary_names
from flightmech.support.kept_stages import store

ROOT = Path(__file__).parents[1]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
# modules and attributes that Windows does not have
MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "posix", "crypt", "syslog"}
ATTRIBUTES = {
    "os": {
        *("fork", "forkpty", "setsid", "setpgid", "getpgid", "getpgrp", "killpg", "geteuid"),
        *("getuid", "getgid", "chown", "fchown", "lchown", "mkfifo", "mknod", "nice", "uname"),
        *("sched_getaffinity", "sysconf", "pread", "pwrite", "statvfs", "wait", "wait3", "wait4"),
        *("O_NOFOLLOW", "O_NONBLOCK", "O_DIRECTORY", "O_CLOEXEC", "setuid", "setgid"),
        *("openpty", "pipe2", "posix_fadvise", "posix_spawn", "chroot", "WNOHANG"),
    },
    "signal": {"SIGKILL", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGPIPE", "alarm", "pause"},
    "select": {"poll", "epoll", "kqueue"},
    "socket": {"AF_UNIX", "socketpair"},
    "time": {"tzset"},
}
# a module without any of these words needs no syntax tree
WORDS = re.compile(rf"\b({'|'.join(sorted(MODULES.union(*ATTRIBUTES.values())))})\b")
# words of a condition on the system
CONDITION = re.compile(r"os\.name|sys\.platform|platform\.system|hasattr")
# functions that run inside the sandbox or behind a condition of their caller, with the reason
BEHIND_CALLER = {
    ("pom/fmu/worker/__main__.py", "_end_with_input"): "only in the sandbox, which is of Linux",
}


def sources():
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def posix_uses(tree: ast.Module) -> list[tuple[str, int, list[ast.AST]]]:
    """Return each use of a name that only POSIX has, its line, and the nodes around it."""
    found: list[tuple[str, int, list[ast.AST]]] = []

    def visit(node: ast.AST, around: list[ast.AST]) -> None:
        if isinstance(node, ast.Import):
            names = {alias.name.partition(".")[0] for alias in node.names} & MODULES
            found.extend((name, node.lineno, around) for name in sorted(names))
        if isinstance(node, ast.ImportFrom) and node.module in MODULES:
            found.append((str(node.module), node.lineno, around))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            is_of_posix = node.attr in ATTRIBUTES.get(node.value.id, ())
            if is_of_posix:
                found.append((f"{node.value.id}.{node.attr}", node.lineno, around))
        for child in ast.iter_child_nodes(node):
            visit(child, [*around, node])

    visit(tree, [])
    return found


def is_conditional(around: list[ast.AST], text: str) -> bool:
    """Return whether a condition on the system stands around or before a use in its function."""
    for node in around:
        if isinstance(node, ast.If | ast.IfExp | ast.BoolOp):
            test = node.test if not isinstance(node, ast.BoolOp) else node
            if CONDITION.search(ast.get_source_segment(text, test) or ""):
                return True
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                is_guard = isinstance(statement, ast.If) and isinstance(
                    statement.body[-1], ast.Return | ast.Raise
                )
                if is_guard and CONDITION.search(
                    ast.get_source_segment(text, statement.test) or ""
                ):
                    return True
    return False


@pytest.mark.slow
def test_names_of_posix_stand_behind_a_condition():
    bare = []
    for file in sources():
        text = file.read_text(encoding="utf-8")
        if not WORDS.search(text):
            continue
        name = file.relative_to(ROOT).as_posix()
        for use, line, around in posix_uses(ast.parse(text)):
            functions = [node.name for node in around if isinstance(node, ast.FunctionDef)]
            if any((name, function) in BEHIND_CALLER for function in functions):
                continue
            if not is_conditional(around, text):
                bare.append(f"{name}:{line}: {use}")
    assert bare == []


@pytest.mark.parametrize(
    ("source", "uses"),
    [
        ("import fcntl", 1),
        ("import sys\nif sys.platform != 'win32':\n    import fcntl", 0),
        ("import os\ndef f():\n    os.killpg(1, 9)", 1),
        ("import os\ndef f():\n    if os.name == 'nt':\n        return\n    os.geteuid()", 0),
    ],
)
def test_the_reading_sees_what_it_looks_for(source, uses):
    found = posix_uses(ast.parse(source))
    assert sum(not is_conditional(around, source) for _, _, around in found) == uses


def test_a_store_on_windows_asks_no_owner(tmp_path, monkeypatch):
    tmp_path.chmod(0o777)
    with pytest.raises(Exception, match="others may write"):
        store._demand_private(tmp_path)
    monkeypatch.setattr(store.os, "name", "nt")
    monkeypatch.delattr(store.os, "geteuid")
    store._demand_private(tmp_path)


def test_files_are_replaced_without_locks_and_flushes_of_folders(tmp_path, monkeypatch):
    """The branches of Windows: no flock, no fsync of a folder, no exchange of two names."""
    monkeypatch.setattr(atomic_write.sys, "platform", "win32")
    monkeypatch.setattr(atomic_write, "fcntl", None)
    file = tmp_path / "a.txt"
    for text in ("first", "second"):
        atomic_write.write_text(file, text)
    assert file.read_text() == "second"
    assert [item.name for item in tmp_path.iterdir()] == ["a.txt"]
    assert not atomic_write._exchange_in_one_step(tmp_path / "a", tmp_path / "b")


def test_no_process_is_signalled_on_windows(tmp_path, monkeypatch):
    """There os.kill with signal 0 would end the process, so that its files stay."""

    def refuse(*arguments):
        raise AssertionError(arguments)

    # a number that no process has
    name = re.sub(r"-\d+-", "-4000000-", temporary_names.temporary_name(".a.txt"))
    (tmp_path / name).touch()
    assert list(temporary_names.find_leftovers(tmp_path, ".a.txt")) == [tmp_path / name]
    monkeypatch.setattr(temporary_names.os, "kill", refuse)
    monkeypatch.setattr(temporary_names.os, "name", "nt")
    assert list(temporary_names.find_leftovers(tmp_path, ".a.txt")) == []


def test_the_script_of_windows_does_what_run_does():
    shell, power = ((ROOT / name).read_text(encoding="utf-8") for name in ("run", "run.ps1"))
    verbs = re.findall(r"^(\w+)\)$", shell, re.M)
    assert verbs == ["demo", "test", "docs"]
    assert re.findall(r'^ +"(\w+)" \{$', power, re.M) == verbs
    for words in (
        "mkdocs build --strict",
        '-m "not slow and not serial" -rs',
        "--dist loadfile",
        "NO_MKDOCS_2_WARNING",
        "(3, 11)",
        "pyproject.toml",
        "hatch_build.py",
        "kernel",
    ):
        assert words in shell, words
        assert words in power, words
    # a parameter with attributes makes -o, -v, -p and -w those of PowerShell itself
    assert "param(" not in power
    assert "[Parameter" not in power
