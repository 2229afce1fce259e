"""Stages: what is kept is not computed, what changed is, and what is kept is safe."""

import os
import stat
import subprocess
import sys
import warnings
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.support.kept_stages import stages as module
from flightmech.support.kept_stages.checked_files import DIGEST, write_checked
from flightmech.support.kept_stages.explanation import StageTrace
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flightmech.support.kept_stages.store import (
    LIMIT,
    PLACE,
    StageStore,
    bytes_of,
    size_limit,
    store_folder,
)


@pytest.fixture
def store(tmp_path):
    return StageStore(tmp_path / "store")


class Counted:
    """A stage that counts its calls."""

    def __init__(self, value=1.0):
        self.calls, self.value = 0, value

    def __call__(self):
        self.calls += 1
        return self.value


def entries(store):
    return sorted(store.folder.rglob("output.pkl"))


def test_a_stage_runs_once_for_equal_inputs(store):
    make = Counted(np.arange(3.0))
    for value in (2.0, 2.0, 3.0, 2.0):
        kept = Stages(store).one("cubes", {"value": value}, make)
        assert (kept.value == np.arange(3.0)).all()
    assert make.calls == 2


def test_another_program_keeps_nothing_of_the_earlier(store, monkeypatch):
    make = Counted()
    for program in ("1", "2", "1"):
        monkeypatch.setattr(module, "hash_installation", lambda program=program: program)
        Stages(store).one("cubes", {}, make)
    assert make.calls == 2


def test_a_change_without_effect_ends_there(store):
    later = Counted()
    for value in (2.0, -2.0):
        square = Stages(store).one("square", {"value": value}, lambda value=value: value**2)
        Stages(store).one("later", {"square": square}, later)
    assert later.calls == 1


def test_nothing_is_read_before_it_is_needed(store, monkeypatch):
    Stages(store).one("a", {}, Counted(5.0))
    monkeypatch.setattr(StageStore, "read", lambda *_: pytest.fail("read"))
    kept = Stages(store).one("a", {}, Counted())
    part = kept.part("half", lambda value: value / 2.0)
    Stages(store).one("b", {"of": [kept, part]}, Counted())
    assert set(Values({"a": kept})) == {"a"}


def test_a_part_counts_by_the_whole_and_its_name():
    kept = Kept("abc", (4.0,))
    assert kept.part("half", lambda value: value / 2.0).value == 2.0
    assert kept.part("half", abs).content_digest != kept.part("other", abs).content_digest


@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "head"])
def test_a_damaged_entry_is_computed_again(store, damage):
    make = Counted(np.arange(100.0))
    first = Stages(store).one("a", {}, make)
    (file,) = entries(store)
    whole = file.read_bytes()
    broken = {
        "flip": whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:],
        "cut": whole[:200],
        "empty": b"",
        "head": b"\0" + whole[1:],
    }
    file.write_bytes(broken[damage])
    again = Stages(store).one("a", {}, make)
    assert (again.value == first.value).all()
    assert make.calls == 2
    assert file.read_bytes() == whole


@pytest.mark.parametrize("body", [b"", b"no pickle", b"cno_such_module\nX\n."])
def test_an_intact_entry_that_cannot_be_loaded_is_computed_again(store, body):
    """For example a pickle of another version of a library."""
    make = Counted()
    Stages(store).one("a", {}, make)
    (file,) = entries(store)
    line = file.read_bytes()[DIGEST:].partition(b"\n")[0] + b"\n"
    write_checked(file, line, body)
    assert Stages(store).one("a", {}, make).value == 1.0
    assert Stages(store).one("a", {}, make).value == 1.0
    assert make.calls == 2


def test_a_damaged_remark_is_not_printed(store):
    """The remarks of a result are printed although the result itself is not read."""

    def make():
        warnings.warn("the mass is 12 kg", AeromatchWarning, stacklevel=2)

    for _ in range(2):
        stages = Stages(store)
        with pytest.warns(AeromatchWarning, match="the mass is 12 kg"):
            stages.one("a", {}, make)
        (file,) = entries(store)
        file.write_bytes(file.read_bytes().replace(b"12 kg", b"92 kg"))
    assert stages.computed["a"] == 1


@pytest.mark.parametrize("line", [b"1\n", b"null\n", b"\xff\n", b"\n"])
def test_an_entry_without_a_line_of_remarks_is_computed_again(store, line):
    make = Counted()
    Stages(store).one("a", {}, make)
    (file,) = entries(store)
    write_checked(file, line, b"x")
    assert Stages(store).one("a", {}, make).value == 1.0
    assert make.calls == 2


def test_an_entry_that_another_job_clears_meanwhile_is_computed_again(store):
    make = Counted()
    Stages(store).one("a", {}, make)
    kept = Stages(store).one("a", {}, make)
    store.clear()
    assert kept.value == 1.0
    assert make.calls == 2


def test_fresh_computes_and_keeps_anew(store):
    make = Counted()
    Stages(store).one("a", {}, make)
    (file,) = entries(store)
    file.write_bytes(b"damaged")
    stages = Stages(store, fresh=True)
    stages.one("a", {}, make)
    assert make.calls == 2
    assert Stages(store).one("a", {}, make).value == 1.0
    assert make.calls == 2


def test_without_a_store_everything_is_computed():
    make = Counted()
    stages = Stages()
    assert [stages.one("a", {"any": object()}, make).value for _ in range(2)] == [1.0, 1.0]
    assert (
        stages.each("b", {"x": {}, "y": {}}, float, lambda item: ("2",), threads=True)["y"].value
        == 2.0
    )
    assert make.calls == 2


def cube(value):
    if value < 0:
        raise ValueError("negative")
    warnings.warn(f"cube of {value}", AeromatchWarning, stacklevel=1)
    return value**3


@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_what_is_complete_is_kept_when_another_item_fails(store):
    values = {"a": 1, "b": 2, "c": -3}
    asked = []

    def arguments(item):
        asked.append(item)
        return (values[item],)

    def run():
        return Stages(store).each(
            "cubes", {item: {"value": value} for item, value in values.items()}, cube, arguments
        )

    with pytest.raises(ValueError, match="negative"):
        run()
    values["c"] = 3
    asked.clear()
    found = run()
    assert {item: kept.value for item, kept in found.items()} == {"a": 1, "b": 8, "c": 27}
    assert list(found) == ["a", "b", "c"]
    assert asked == ["c"]


def test_a_call_that_makes_several_makes_only_what_is_not_kept(store):
    asked = []

    def compute(missing, put):
        asked.append(missing)
        for item in missing:
            put(item, item.upper(), keep=item != "b")

    for _ in range(2):
        found = Stages(store).batch("upper", {item: {"item": item} for item in "abc"}, compute)
        assert {item: kept.value for item, kept in found.items()} == {"a": "A", "b": "B", "c": "C"}
    assert asked == [["a", "b", "c"], ["b"]]


def test_warnings_of_a_stage_are_given_again(store):
    for _ in range(2):
        stages = Stages(store)
        with pytest.warns(AeromatchWarning, match="cube of 2"):
            stages.one("cube", {}, lambda: cube(2))
        assert stages.remarks == ["cube of 2"]


@pytest.mark.parametrize("threads", [False, True])
def test_warnings_of_items_are_given_again(store, threads):
    for _ in range(2):
        stages = Stages(store)
        inputs = {str(x): {"x": x} for x in (2, 3)}
        with pytest.warns(AeromatchWarning, match="cube of"):
            stages.each("cube", inputs, cube, lambda item: (int(item),), 2 - threads, threads)
        assert sorted(stages.remarks) == ["cube of 2", "cube of 3"]


def test_what_cannot_be_kept_counts_by_what_it_was_made_of(store):
    for value in (1, 1, 2):
        kept = Stages(store).one("function", {"value": value}, lambda: lambda: 3)
        assert kept.value() == 3
        Stages(store).one("later", {"function": kept}, Counted())
    assert len(entries(store)) == 2  # of the later stage


def test_a_view_of_a_mapping_is_kept(store):
    Stages(store).one("view", {}, lambda: MappingProxyType({"a": 1}))
    assert Stages(store).one("view", {}, Counted()).value == {"a": 1}


@pytest.mark.parametrize("order", ["C", "F"])
def test_rows_of_zeros_are_left_out_and_come_back_to_the_bit(store, order):
    table = np.asarray(np.random.default_rng(1).normal(size=(6, 4000)), order=order)
    table[[1, 2, 4]] = 0.0
    table[4, 7] = -0.0
    Stages(store).one("errors", {}, lambda: {"table": table, "again": table})
    found = Stages(store).one("errors", {}, Counted()).value
    assert np.ascontiguousarray(found["table"]).tobytes() == np.ascontiguousarray(table).tobytes()
    assert found["again"] is found["table"]
    assert found["table"].flags.c_contiguous == (order == "C")  # sums depend on it
    assert entries(store)[0].stat().st_size < (4.2 if order == "C" else 6.2) * 4000 * 8


def test_what_grows_with_every_job_is_remembered(store):
    assert Stages(store).recall("judged", {"case": 1}, {}) == {}
    Stages(store).remember("judged", {"case": 1}, {"a": 1})
    assert Stages(store).recall("judged", {"case": 1}, {}) == {"a": 1}
    assert Stages(store, fresh=True).recall("judged", {"case": 1}, {}) == {}


def test_the_reason_of_a_stage_names_what_changed(store, tmp_path):
    reasons = []

    def run(fresh=False, **inputs):
        trace = StageTrace.of(store.folder, tmp_path / "out")
        stages = Stages(store, trace, fresh, explain=reasons.append)
        stages.one("fit", inputs, Counted(), "pitch")
        stages.close()

    run(record=1, model="a")
    run(record=1, model="a")
    run(record=2, model="a")
    run(record=2)
    store._file("fit", entries(store)[0].parent.name).unlink()
    entry = entries(store)
    for file in entry:
        file.unlink()
    run(record=2)
    run(True, record=2)
    assert reasons == [
        "fit pitch: not computed for this folder before",
        "fit pitch: changed: record",
        "fit pitch: left out: model",
        "fit pitch: nothing changed, but no intact result is kept",
        "fit pitch: --fresh",
    ]


def test_a_trace_with_half_a_line_is_read_as_far_as_it_goes(store, tmp_path):
    trace = StageTrace.of(store.folder, tmp_path)
    trace.note("a", {"x": "1"})
    (file,) = (store.folder / "traces").iterdir()
    file.write_text(file.read_text() + '["b", {"x"')
    assert StageTrace.of(store.folder, tmp_path).reason("a", {"x": "2"}) == "changed: x"
    assert (
        StageTrace.of(store.folder, tmp_path).reason("b", {"x": "2"})
        == "not computed for this folder before"
    )


def test_a_damaged_line_of_a_trace_counts_as_missing(store, tmp_path):
    trace = StageTrace.of(store.folder, tmp_path)
    trace.note("a", {"x": "1"})
    trace.note("b", {"x": "1"})
    (file,) = (store.folder / "traces").iterdir()
    file.write_bytes(file.read_bytes().replace(b'["a"', b'["\xff"'))
    assert StageTrace.of(store.folder, tmp_path).reason("b", {"x": "2"}) == "changed: x"
    assert (
        StageTrace.of(store.folder, tmp_path).reason("a", {"x": "2"})
        == "not computed for this folder before"
    )


def test_what_was_not_used_for_the_longest_time_goes_first(store):
    for k in range(3):
        Stages(store).one("a", {"k": k}, Counted(np.zeros(1000)))
    for age, file in enumerate(entries(store)):
        os.utime(file, (1e9 + age, 1e9 + age))
    oldest = entries(store)[0]
    store.shorten(20_000)
    assert len(entries(store)) == 2
    assert not oldest.exists()
    assert store.usage()["a"][0] == 2
    store.clear()
    assert store.usage() == {}


def test_a_store_of_another_user_or_open_to_others_is_refused(tmp_path, monkeypatch):
    folder = tmp_path / "store"
    StageStore(folder)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o770)
    with pytest.raises(SchemaError, match="others may write to the store"):
        StageStore(folder)
    folder.chmod(0o700)
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(SchemaError, match="belongs to another user"):
        StageStore(folder)


def test_the_place_and_the_size_are_those_of_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv(PLACE, str(tmp_path))
    assert store_folder() == tmp_path
    monkeypatch.setenv(PLACE, "off")
    assert store_folder() is None
    monkeypatch.delenv(PLACE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert store_folder() == tmp_path / "aeromatch" / "stages"
    monkeypatch.setenv(LIMIT, "2.5 MB")
    assert size_limit() == 2.5e6
    with pytest.raises(SchemaError, match="'much' is not a size"):
        bytes_of("much")


KILLED = """
import os, signal, sys
from pathlib import Path
from flightmech.support.kept_stages.stages import Stages
from flightmech.support.kept_stages.store import StageStore
stages, after = Stages(StageStore(Path(sys.argv[1]))), int(sys.argv[2])
for k in range(6):
    if k == after:
        os.kill(os.getpid(), signal.SIGKILL)
    stages.one("a", {"k": k}, lambda: k)
print(sum(stages.computed.values()))
"""


@pytest.mark.nightly
def test_a_job_that_is_killed_goes_on_where_it_was(tmp_path):
    root = str(Path(module.__file__).parents[3])

    def run(after):
        command = [sys.executable, "-c", KILLED, str(tmp_path / "store"), str(after)]
        return subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": root}
        )

    assert run(4).returncode == -9
    assert run(9).stdout.strip() == "2"
