"""A process that is killed while it saves, and a disk that is full: the older file or the new one
is there, whole, never a third thing.
"""

import os
import resource
import signal

import pytest
import write_calls
import xarray as xr

import aerodb
from flightmech import terms

ROOT = {
    "aircraft": "test",
    "S": 16.9,
    "cbar": 1.667,
    "b": 10.31,
    "x_ref": -3.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
    "force_axes": "stability",
    "source": "by hand",
    "history": "by hand",
    "absent": "",
}
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL of POSIX")


def make_pair():
    """Return two databases that differ in every number."""
    small = aerodb.make_database(
        {
            "CL/basic": terms.make_term([0.1, 0.9], {"alpha": [0.0, 0.2]}),
            "Cm/qhat": terms.make_term(-17.0),
        },
        title="one",
        **ROOT,
    )
    changed = {
        name: leaf.assign(value=leaf["value"] * 2.0 + 1.0)
        for name, leaf in aerodb.terms(small).items()
    }
    big = terms.make_term(
        [[float(i + j) for i in range(60)] for j in range(60)],
        {"mach": range(60), "alpha": range(60)},
        history="y" * 20_000,
    )
    changed["CD/basic"] = big
    return small, aerodb.make_database(changed, **{**small.attrs, "title": "another"})


@pytest.fixture
def pair():
    return make_pair()


def save_killed_at_each_call(folder):
    """Save one database over another and be killed; the file is one of the two, and the next save
    removes what the kill left.
    """
    (old, new), path = make_pair(), folder / "db.nc"
    aerodb.save(old, path)
    seen = []
    for number in write_calls.each_call(lambda: aerodb.save(new, path), folder):
        there = aerodb.open(path)  # checks the seal over every byte
        seen.append("new" if there.identical(new) else "old")
        assert there.identical(new if seen[-1] == "new" else old), f"call {number}"
        aerodb.save(old, path)
        assert os.listdir(folder) == ["db.nc"], f"call {number}"
    assert aerodb.open(path).identical(new)
    assert seen == sorted(seen, reverse=True), (
        "once the new file is in place, the old one does not return"
    )
    assert len(seen) > 4, seen


@pytest.mark.serial
def test_a_killed_save_leaves_the_old_file_or_the_new_one(tmp_path):
    write_calls.run_preloaded(save_killed_at_each_call, tmp_path)


def test_what_a_kill_leaves_behind_does_no_harm(pair, tmp_path):
    path = tmp_path / "db.nc"
    (tmp_path / ".db.nc.0badcafe.part").write_bytes(b"\x89HDF half of a file")
    aerodb.save(pair[1], path)
    xr.testing.assert_identical(aerodb.open(path), pair[1])
    assert [file.name for file in tmp_path.glob("*.nc")] == ["db.nc"]


def in_a_child(work):
    """Return the exit code of a child process that does `work`: what it returns."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.slow
@pytest.mark.parametrize("room", [0, 1, 4096, 40_000])
def test_a_full_disk_leaves_the_old_file(pair, tmp_path, room):
    path = tmp_path / "db.nc"
    aerodb.save(pair[0], path)
    before = path.read_bytes()

    def work():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        try:
            aerodb.save(pair[1], path)
        except OSError:
            return 7
        return 0

    assert in_a_child(work) == 7
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["db.nc"]
