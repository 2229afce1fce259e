import os

import pytest

from flightmech.support import atomic_write
from flightmech.support.atomic_write import folder_written_atomically, write_text, written_atomically


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
        monkeypatch.setattr(atomic_write, "_exchanged", lambda *_: False)
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


def test_a_text_keeps_its_line_ends_and_an_error_keeps_the_old_one(tmp_path):
    target = tmp_path / "a.txt"
    write_text(target, "one\r\ntwo\n")
    assert target.read_bytes() == b"one\r\ntwo\n"
    with pytest.raises(UnicodeEncodeError):
        write_text(target, "\N{GREEK SMALL LETTER ALPHA}", "latin-1")
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_bytes() == b"one\r\ntwo\n"
