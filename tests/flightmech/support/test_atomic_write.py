import os
import stat

import h5py
import numpy as np
import pytest

from flightmech.support import atomic_write
from flightmech.support.atomic_write import (
    folder_for_files,
    folder_written_atomically,
    write_text,
    written_atomically,
)
from flightmech.support.temporary_names import temporary_name


def test_the_file_appears_when_the_block_ends(tmp_path):
    target = tmp_path / "a.txt"
    with written_atomically(target) as part:
        part.write_text("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_the_older_file_and_nothing_else(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(UnicodeEncodeError), written_atomically(target) as part:
        part.write_text("half way: \udc80", encoding="utf-8")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="make it first"):
        written_atomically(tmp_path / "none" / "a.txt").__enter__()


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_permissions_follow_the_umask(tmp_path):
    mask = os.umask(0o027)
    try:
        with written_atomically(tmp_path / "a.txt") as part:
            part.write_text("new")
    finally:
        os.umask(mask)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def filled(folder, text, name="a.txt"):
    with folder_written_atomically(folder) as part:
        (part / name).write_text(text)


def test_a_folder_appears_when_the_block_ends(tmp_path):
    target = tmp_path / "terms"
    with folder_written_atomically(target) as part:
        (part / "a.txt").write_text("new")
        assert not target.exists()
    assert (target / "a.txt").read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("in_one_step", [True, False])
def test_a_folder_takes_the_place_of_an_older_one(tmp_path, monkeypatch, in_one_step):
    if not in_one_step:
        monkeypatch.setattr(atomic_write, "_exchange_in_one_step", lambda *_: False)
    target = tmp_path / "terms"
    filled(target, "old", "gone.txt")
    filled(target, "new")
    assert [file.name for file in target.iterdir()] == ["a.txt"]
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_the_older_folder_and_nothing_else(tmp_path):
    target = tmp_path / "terms"
    filled(target, "old")
    with pytest.raises(UnicodeEncodeError), folder_written_atomically(target) as part:
        (part / "a.txt").write_text("half way: \udc80", encoding="utf-8")
    assert (target / "a.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_files_of_a_command_appear_together_in_a_new_folder_and_singly_in_an_older_one(tmp_path):
    target = tmp_path / "deep" / "runs"
    with pytest.raises(UnicodeEncodeError), folder_for_files(target) as place:
        (place / "a.txt").write_text("half way: \udc80", encoding="utf-8")
    assert list(target.parent.iterdir()) == []
    with folder_for_files(target) as place:
        (place / "a.txt").write_text("new")
        assert not target.exists()
    assert (target / "a.txt").read_text() == "new"
    # a folder of the user is not exchanged: a shell may work in it
    with folder_for_files(target) as place:
        assert place == target


def test_a_text_keeps_its_line_ends_and_an_error_keeps_the_old_one(tmp_path):
    target = tmp_path / "a.txt"
    write_text(target, "one\r\ntwo\n")
    assert target.read_bytes() == b"one\r\ntwo\n"
    with pytest.raises(UnicodeEncodeError):
        write_text(target, "\N{GREEK SMALL LETTER ALPHA}", "latin-1")
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_bytes() == b"one\r\ntwo\n"


posix = pytest.mark.skipif(os.name != "posix", reason="links, permissions and processes of POSIX")


@posix
def test_through_a_link_the_target_is_written_and_keeps_its_mode(tmp_path):
    (tmp_path / "deep").mkdir()
    target, link = tmp_path / "deep" / "a.txt", tmp_path / "link.txt"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to("deep/a.txt")
    write_text(link, "new")
    assert os.readlink(link) == "deep/a.txt"
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    folder, to_folder = tmp_path / "terms", tmp_path / "to_terms"
    to_folder.symlink_to("terms")
    filled(to_folder, "old")
    folder.chmod(0o750)
    filled(to_folder, "new")
    assert os.readlink(to_folder) == "terms"
    assert (folder / "a.txt").read_text() == "new"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o750


@posix
def test_what_may_not_be_replaced_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    target, folder = tmp_path / "a.txt", tmp_path / "terms"
    write_text(target, "old")
    target.chmod(0o444)
    with pytest.raises(
        PermissionError, match="read-only, not replaced; make it writable or give another name"
    ):
        write_text(target, "new")
    filled(folder, "old")
    folder.chmod(0o555)
    with pytest.raises(PermissionError, match="read-only"):
        filled(folder, "new")
    folder.chmod(0o755)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a regular file, cannot be replaced"):
        write_text(tmp_path / "pipe", "new")
    with pytest.raises(NotADirectoryError, match="a file; give the name of a folder"):
        filled(target, "new")
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda path, _: path != tmp_path)
        for writing in (lambda: write_text(target, "new"), lambda: filled(folder, "new")):
            with pytest.raises(
                PermissionError, match="nothing can be written into this folder; give another one"
            ):
                writing()
    monkeypatch.chdir(folder)
    for busy in (folder, tmp_path):
        with pytest.raises(
            OSError, match="this command works in it; give the name of a folder inside it"
        ):
            filled(busy, "new")
    assert (target.read_text(), (folder / "a.txt").read_text()) == ("old", "old")
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", "terms", "pipe"}


def test_files_of_others_stay_in_an_exchanged_folder(tmp_path):
    target = tmp_path / "out"
    filled(target, "old", "ours.txt")
    (target / "notes").mkdir()
    (target / "notes" / "mine.txt").write_text("mine")
    with folder_written_atomically(target, own="ours.txt".__eq__) as part:
        (part / "new.txt").write_text("new")
        (target / "late.txt").write_text("late")
    assert {path.relative_to(target).as_posix() for path in target.rglob("*.txt")} == {
        "new.txt",
        "late.txt",
        "notes/mine.txt",
    }
    assert list(tmp_path.iterdir()) == [target]


def killed_at(step, work):
    """Do `work` in a child process that ends, as if it was killed, before its file operation number
    `step`; return whether it did.
    """
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    done = 0

    def counted(function):
        def call(*arguments, **options):
            nonlocal done
            done += 1
            if done == step:
                os._exit(9)
            return function(*arguments, **options)

        return call

    for module, name in (
        (os, "replace"),
        (os, "fsync"),
        (os, "link"),
        (os, "unlink"),
        (os, "rmdir"),
        (atomic_write, "_exchange_in_one_step"),
    ):
        setattr(module, name, counted(getattr(module, name)))
    try:
        work()
    finally:
        os._exit(0)


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork of POSIX")
@pytest.mark.parametrize("in_one_step", [True, False])
def test_a_folder_is_never_mixed_wherever_its_writer_is_killed(tmp_path, monkeypatch, in_one_step):
    if not in_one_step:
        monkeypatch.setattr(atomic_write, "_exchange_in_one_step", lambda *_: False)
    target = tmp_path / "out"

    def write(text):
        with folder_written_atomically(target, own=["a.txt", "b.txt"].__contains__) as part:
            for name in ("a.txt", "b.txt"):
                (part / name).write_text(text)

    write("old")
    (target / "mine.txt").write_text("mine")
    found, step = [], 1
    while killed_at(step, lambda: write("new")):
        if target.exists():
            found.append((target / "a.txt").read_text())
            assert (target / "b.txt").read_text() == found[-1]
            assert (target / "mine.txt").read_text() == "mine"
        else:
            assert not in_one_step
            found.append("none")
        write("old")  # the next writing finds everything in order
        assert {path.name for path in target.iterdir()} == {"a.txt", "b.txt", "mine.txt"}
        assert list(tmp_path.iterdir()) == [target], "what the killed process left is gone"
        step += 1
    assert set(found) == {"old", "new"} | (set() if in_one_step else {"none"})


@pytest.mark.nightly
@posix
def test_the_folder_of_an_interrupted_exchange_is_the_complete_new_one(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic_write, "_exchange_in_one_step", lambda *_: False)
    target = tmp_path / "out"
    filled(target, "old")
    assert any(
        killed_at(step, lambda: filled(target, "new")) and not target.exists()
        for step in range(1, 20)
    )
    assert atomic_write.resolve_folder(target) == target
    assert (target / "a.txt").read_text() == "new"


@posix
def test_parts_of_processes_at_work_and_of_other_machines_stay(tmp_path):
    mine = tmp_path / temporary_name(".a.txt")
    other = tmp_path / ".a.txt.00000000-1-00000000.part"
    gone = tmp_path / mine.name.replace(f"-{os.getpid()}-", f"-{ended()}-")
    for part in (mine, other, gone):
        part.write_text("half")
    write_text(tmp_path / "a.txt", "new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", mine.name, other.name}


def ended():
    """Return the number of a process that has ended."""
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    return child


@pytest.fixture
def little_room():
    """Files of this process may not grow beyond a kilobyte, which ends a write as a full disk
    does.
    """
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def h5py_file(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(10_000)


@pytest.mark.parametrize("write", [lambda path: path.write_bytes(bytes(2000)), h5py_file])
def test_a_full_disk_names_the_file_and_leaves_the_older_one(tmp_path, little_room, write):
    (tmp_path / "a.nc").write_text("older")
    with (
        pytest.raises(OSError, match=r"not written: .*; make room or name another place") as caught,
        written_atomically(tmp_path / "a.nc") as part,
    ):
        write(part)
    assert caught.value.filename == str(tmp_path / "a.nc")
    assert [item.name for item in tmp_path.iterdir()] == ["a.nc"]
    assert (tmp_path / "a.nc").read_text() == "older"


def test_a_full_disk_names_the_folder(tmp_path, little_room):
    with (
        pytest.raises(OSError, match="not written") as caught,
        folder_written_atomically(tmp_path / "out") as part,
    ):
        (part / "page.html").write_bytes(bytes(2000))
    assert caught.value.filename == str(tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_what_can_be_made_again_does_not_wait_for_the_disk(tmp_path, monkeypatch):
    waited, fsync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda handle: waited.append(handle) or fsync(handle))
    with atomic_write.written_atomically(tmp_path / "cache", durable=False) as part:
        part.write_text("new")
    assert waited == []
    with atomic_write.written_atomically(tmp_path / "kept") as part:
        part.write_text("new")
    assert len(waited) == 2  # the file and the names in its folder
    with atomic_write.folder_written_atomically(tmp_path / "report") as folder:
        for number in range(5):
            (folder / f"{number}.csv").write_text("1")
    assert len(waited) == 2 + 5 + 2  # every file, the folder and that above it
