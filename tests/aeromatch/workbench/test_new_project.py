"""Page of a new project on the server: dropped files, columns, values, and the draft that is
kept.
"""

import asyncio
import json
import shutil
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import xarray as xr

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import served
from starlette.requests import ClientDisconnect
from test_hostile_requests import send

from aeromatch.cli.actions.verbs import _carry_out_actions
from aeromatch.cli.verbs import match_command
from aeromatch.drafting.folder import draft_project
from aeromatch.drafting.gaps import engine_numbers
from aeromatch.drafting.merging import merge_toml
from aeromatch.project.editing import set_key
from aeromatch.workbench.actions import read_action_log
from aeromatch.workbench.allowed_actions import (
    ActionError,
    PlaceholderFolders,
    demand_allowed,
    named_paths,
)
from aeromatch.workbench.new_project import dropped_files
from aeromatch.workbench.new_project.aircraft_data import aircraft_rows, fact_rows, give_values
from aeromatch.workbench.new_project.column_edits import edit_column
from aeromatch.workbench.new_project.draft import keep_draft, show_draft
from aeromatch.workbench.new_project.recorded_columns import pack_columns, recorded_tables
from aeromatch.workbench.new_project.sources import list_files, recordings_of
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import SchemaError
from flighttest.records.readers.name_map_reading import read_names

C182 = Path(__file__).parents[3] / "data" / "c182"


@pytest.fixture
def opened(tmp_path):
    """A new project without files."""
    (tmp_path / "new").mkdir()
    (tmp_path / "work").mkdir()
    return OpenProject(tmp_path / "new" / "aeromatch.toml", tmp_path / "work")


@pytest.fixture(scope="module")
def drafted_folder(tmp_path_factory):
    """A project that init has drafted from one recording, whose elevator has an unknown heading."""
    folder = tmp_path_factory.mktemp("drafted") / "new"
    folder.mkdir()
    copy_sources(folder)
    done = draft_project(folder)
    (folder.parent / "draft.json").write_text(json.dumps({**done.to_dict(), "problems": []}))
    return folder


@pytest.fixture
def drafted(drafted_folder, tmp_path):
    """A copy of the drafted project, with its draft kept."""
    shutil.copytree(drafted_folder, tmp_path / "new")
    (tmp_path / "work").mkdir()
    opened = OpenProject(tmp_path / "new" / "aeromatch.toml", tmp_path / "work")
    keep_draft(opened, (drafted_folder.parent / "draft.json").read_text())
    return opened


def copy_sources(folder):
    """Copy two listings and a recording whose elevator is the column CH7 without a unit."""
    for name in ("clean.out", "elevator_m0.15_h5000.out"):
        shutil.copy(C182 / "datcom" / name, folder)
    text = (C182 / "flight" / "check_short_period.csv").read_text()
    (folder / "flight.csv").write_text(text.replace("Elevator (deg)", "CH7", 1))


def receive(opened, name, *parts, length=None):
    """Return the result of a dropped file with a content in parts; an exception is raised."""

    async def stream():
        for part in parts:
            if isinstance(part, Exception):
                raise part
            yield part

    return asyncio.run(dropped_files.receive_file(opened, name, length, stream()))


# ---- dropped files ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        *("", ".", "..", "../a.csv", "a/b.csv", "a\\b.csv", "C:a.csv", "/etc/a.csv", ".draft"),
        *("-o.csv", " a.csv", "a.csv.", "a\0.csv", "a\n.csv", "nul.csv", "COM1", "a" * 121),
        "\ud800.csv",
    ],
)
def test_a_name_with_a_path_is_refused(opened, name):
    with pytest.raises(ActionError, match="rename the file"):
        receive(opened, name, b"x")
    assert list(opened.file.parent.iterdir()) == []


def test_a_dropped_file_is_written_completely_or_not(opened):
    folder = opened.file.parent
    with pytest.raises(ClientDisconnect):
        receive(opened, "a.csv", b"time,q\n", ClientDisconnect())
    assert list(folder.iterdir()) == []
    assert list((opened.work / "dropped").iterdir()) == []
    assert receive(opened, "flight 1.csv", b"time,", b"q\n")["copy"] is None
    assert (folder / "flight 1.csv").read_bytes() == b"time,q\n"
    with pytest.raises(ActionError, match="is empty"):
        receive(opened, "b.csv")
    assert [file.name for file in folder.iterdir()] == ["flight 1.csv"]


def test_an_older_file_is_kept_as_a_copy(opened):
    for number, content in enumerate((b"1", b"1", b"2", b"3")):
        copy = receive(opened, "a.csv", content)["copy"]
        assert copy == [None, None, "a.csv.1.bak", "a.csv.2.bak"][number]
    contents = {file.name: file.read_bytes() for file in opened.file.parent.iterdir()}
    assert contents == {"a.csv": b"3", "a.csv.1.bak": b"1", "a.csv.2.bak": b"2"}
    # a copy is not a file of the project
    assert [row["name"] for row in list_files(opened)] == ["a.csv"]


def test_a_large_file_is_refused(opened, monkeypatch):
    with pytest.raises(ActionError, match="more than 4 GB"):
        receive(opened, "a.csv", b"x", length="4000000001")
    monkeypatch.setattr(dropped_files, "_SPARE", 10**18)
    with pytest.raises(ActionError, match="no room"):
        receive(opened, "a.csv", b"x", length="1")
    monkeypatch.undo()
    monkeypatch.setattr(dropped_files, "MOST_BYTES", 10)
    # the stated length may be wrong
    with pytest.raises(ActionError, match="more than"):
        receive(opened, "a.csv", b"123456", b"123456", length="1")
    assert list(opened.file.parent.iterdir()) == []


def test_files_of_a_project_get_their_place_by_their_content(opened):
    folder = opened.file.parent
    for name, place in (("aircraft", "aircraft"), ("names", "names")):
        content = (C182 / f"{name}.toml").read_bytes()
        assert receive(opened, "mine.toml", content)["name"] == f"{place}.toml"
        assert (folder / f"{place}.toml").read_bytes() == content
    case = (C182 / "cases" / "phugoid.toml").read_bytes()
    assert receive(opened, "phugoid.toml", case)["name"] == "cases/phugoid.toml"
    for content, problem in (
        ((C182 / "aeromatch.toml").read_bytes(), "is a project file"),
        (
            b'name = "x"\nS = 1\ncbar = 1\nb = 1\nengine = "../../e.nc"\n',
            "leads out of the project",
        ),
        (b'[imu]\np = "P"\n[x]\ny = ["~/z"]\n', "leads out of the project"),
        (case.replace(b"../flight/", b"../../flight/"), "leads out of the project"),
        (b"a = = 3", "is not a TOML file"),
        (b"\xff\xfe\x00", "is not a TOML file"),
    ):
        with pytest.raises(ActionError, match=problem):
            receive(opened, "other.toml", content)
    assert not opened.file.exists()


def test_links_and_folders_are_not_written(opened, tmp_path):
    folder = opened.file.parent
    (tmp_path / "other.csv").write_text("other")
    (folder / "link.csv").symlink_to(tmp_path / "other.csv")
    (folder / "cases").symlink_to(tmp_path)
    (folder / "flights").mkdir()
    for name, content in (
        ("link.csv", b"x"),
        ("flights", b"x"),
        ("a.toml", (C182 / "cases" / "phugoid.toml").read_bytes()),
    ):
        with pytest.raises(ActionError, match=r"is a (link|folder)"):
            receive(opened, name, content)
    assert (tmp_path / "other.csv").read_text() == "other"
    assert not (tmp_path / "a.toml").exists()


def test_the_address_of_files_is_guarded(tmp_path):
    with served(tmp_path / "aeromatch.toml", tmp_path / "work") as client:
        address = "/api/new/file?name=a.csv"
        assert send(client, "POST", address, b"x", token=False)[0] == 403
        assert client.ask(address, body=[1], origin="http://evil.example")[0] == 403
        assert not (tmp_path / "a.csv").exists()
        code, content = send(client, "POST", "/api/new/file?name=..%2Fa.csv", b"x")
        assert (code, b"rename the file" in content) == (400, True)
        code, content = send(client, "POST", address, b"x" * 3_000_000)
        assert (code, json.loads(content)["bytes"]) == (200, 3_000_000)
        assert (tmp_path / "a.csv").stat().st_size == 3_000_000
        assert client.data("/api/title") == {"title": tmp_path.name, "ready": False}


# ---- columns ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_column_without_a_unit_waits_for_one(drafted):
    query = {"column": "CH7", "quantity": "delta_e", "unit": "", "sign": "-"}
    answer = edit_column(drafted, query, None)
    assert answer["commands"] == []
    assert "states a unit" in answer["problem"]
    assert "is in kg" in edit_column(drafted, {**query, "unit": "kg"}, None)["problem"]
    for quantity in ("delta_x", ""):
        assert edit_column(drafted, {**query, "quantity": quantity}, None)["problem"]
    answer = edit_column(drafted, {**query, "unit": "deg"}, None)
    perform(drafted, answer["commands"])
    channel = read_names(drafted.file.parent / "names.toml").leaves["controls"]["delta_e"]
    assert (channel.column, channel.unit, channel.sign) == ("CH7", "deg", -1)


def test_another_quantity_takes_the_line_of_the_column_along(drafted):
    file = drafted.file.parent / "names.toml"
    before = read_names(file)
    assert before.leaves["imu"]["q"].column == "Pitch Rate"
    # the heading states the unit, so the map does not repeat it
    query = {"column": "Pitch Rate", "quantity": "r", "unit": "deg/s", "sign": "+"}
    perform(drafted, edit_column(drafted, query, None)["commands"])
    after = read_names(file).leaves
    assert "q" not in after["imu"]
    assert after["imu"]["r"].stated() == {"column": "Pitch Rate"}
    query = {"column": "Pitch Rate", "quantity": "-"}
    perform(drafted, edit_column(drafted, query, None)["commands"])
    assert "r" not in read_names(file).leaves["imu"]
    # other lines stay as they were
    assert after["vanes"] == before.leaves["vanes"]


def test_other_keys_of_a_line_stay(drafted):
    file = drafted.file.parent / "names.toml"
    set_key(file, "imu.q", '{ column = "Pitch Rate", delay = "0.1 s" }')
    query = {"column": "Pitch Rate", "quantity": "q", "unit": "rad/s", "sign": "-"}
    perform(drafted, edit_column(drafted, query, None)["commands"])
    channel = read_names(file).leaves["imu"]["q"]
    assert (channel.unit, channel.sign, channel.delay) == ("rad/s", -1, 0.1)


def perform(opened, commands):
    """Perform commands of `aeromatch set` that the page may send."""
    assert commands
    for words in commands:
        demand_allowed(words, opened.places)
        verb, file, key, value = opened.places.real(words)
        assert verb == "set"
        set_key(file, key, None if value == "--remove" else value)


def test_traces_are_the_columns_as_recorded(drafted):
    query = {"name": "flight", "points": "3", "columns": '["CH7", "Pitch Rate"]'}
    content = pack_columns(drafted, query, None)
    size = int.from_bytes(content[:4], "little")
    (head,) = json.loads(content[4 : 4 + size])
    assert (head["channels"], head["clock"]) == (["Pitch Rate", "CH7"], True)
    assert head["units"] == {"Pitch Rate": "deg/s", "CH7": ""}
    arrays = np.frombuffer(content[4 + size :], "<f8").reshape(3, head["samples"])
    recorded = np.genfromtxt(drafted.file.parent / "flight.csv", delimiter=",", names=True)
    assert arrays[2].max() == recorded["CH7"].max()
    assert arrays[2].min() == recorded["CH7"].min()
    assert arrays[0][-1] <= recorded["Time_s"][-1] - recorded["Time_s"][0]
    for wrong in ({"points": "x"}, {"points": "0" * 9}, {"columns": "CH7"}, {"columns": "[1]"}):
        with pytest.raises(SchemaError):
            pack_columns(drafted, {**query, **wrong}, None)


def test_traces_of_tables_start_at_one_time(opened):
    """A leaf that starts 2 s later is drawn 2 s later."""
    early = xr.Dataset({"q": ("time", [0.1, 0.2])}, {"time": [5.0, 6.0]})
    late = xr.Dataset({"V": ("time", [80.0, 81.0])}, {"time": [7.0, 8.0]})
    xr.DataTree.from_dict({"/imu": early, "/air": late}).to_netcdf(opened.file.parent / "a.nc")
    tables = recorded_tables(opened, "a")
    times = {name: list(table.time) for name, table in tables.items() if table.has_clock}
    assert times == {"imu": [0.0, 1.0], "air": [2.0, 3.0]}


def test_recordings_of_one_name_are_both_listed(opened):
    folder = opened.file.parent
    for name in ("a.csv", "a.mat", "b.csv"):
        (folder / name).write_text("time,q\n0,0\n1,0\n")
    assert list(recordings_of(opened)) == ["a.csv", "a.mat", "b"]
    with pytest.raises(SchemaError, match=r"a\.csv and .*a\.mat are both record 'a'; rename one"):
        draft_project(folder)


def test_engines_of_two_digits():
    names = ["engine10.n1", "engine2.n1", "engine.n1", "engine0.n1", "engine1234567.n1"]
    assert engine_numbers(names) == {2, 10}


# ---- values of the aircraft ---------------------------------------------------------------------


def test_values_are_given_by_options_of_init_or_by_set(drafted):
    texts = {"mass": "2280 lb", "S": "174 ft2", "cg": "0, 0 m, 1 in", "latitude": "45 deg"}
    texts["instruments.vanes.position"] = "1.1, -3.6, -0.55"
    answer = give_values(drafted, {"values": json.dumps(texts)}, None)
    *sets, init = answer["commands"]
    assert init == [
        *("init", "{project}", "--mass", "2280 lb", "--cg", "0", "0 m", "1 in"),
        *("--latitude", "45 deg", "--json"),
    ]
    perform(drafted, sets)
    demand_allowed(init, drafted.places)
    rows = {row["key"]: row for row in aircraft_rows(drafted.file.parent)}
    assert (rows["S"]["text"], rows["mass"]["text"], rows["mass"]["open"]) == ("174 ft2", "", True)
    vanes = rows["instruments.vanes.position"]
    assert (vanes["text"], vanes["open"]) == ("1.1, -3.6, -0.55", False)
    # an edited value is changed in the file, since init keeps it
    set_key(drafted.file.parent / "aircraft.toml", "mass", "1000")
    answer = give_values(drafted, {"values": '{"mass": "1 t"}'}, None)
    assert answer["problem"].startswith("Gross mass: ")
    (words, _) = give_values(drafted, {"values": '{"mass": "900"}'}, None)["commands"]
    assert words == ["set", "{project}/aircraft.toml", "mass", "900.0"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        *("", "[]", '{"mass": 1}', '{"x": "1"}', '{"mass": ""}', '{"mass": "1 m"}'),
        *('{"cg": "1,5 m; 0.2 m"}', '{"cg": "1,5 m, 0.2 m"}', '{"cg": "1,5 m,0.2 m"}'),
        *('{"cg": "-0,05;0"}', '{"cg": "-0,05,0"}', '{"cg": "0.1,,0,0.2"}', '{"cg": "1;2;"}'),
        *('{"latitude": "91"}', '{"latitude": "-1.6 rad"}', '{"latitude": "48,5"}'),
        *('{"cg": "0, 0"}', '{"mass": "nan"}', '{"mass": "1, 2"}', '{"name": " "}', "[" * 9999),
    ],
)
def test_odd_values_are_refused_with_a_sentence(drafted, values):
    answer = give_values(drafted, {"values": values}, None)
    assert answer["commands"] == []
    assert len(answer["problem"]) > 20


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("0.1;0 m; 2 in", ["0.1", "0 m", "2 in"]),
        ("1,2,-.5", ["1", "2", "-.5"]),
        ("0.5, 0, -1e-2", ["0.5", "0", "-1e-2"]),
    ],
)
def test_three_values_with_commas_or_semicolons(drafted, text, parts):
    answer = give_values(drafted, {"values": json.dumps({"cg": text})}, None)
    assert answer["commands"] == [["init", "{project}", "--cg", *parts, "--json"]]


@pytest.mark.parametrize(("text", "given"), [("48", "48 deg"), ("-0.8 rad", "-0.8 rad")])
def test_a_latitude_is_in_degrees_on_the_page(drafted, text, given):
    (words,) = give_values(drafted, {"values": json.dumps({"latitude": text})}, None)["commands"]
    assert words == ["init", "{project}", "--latitude", given, "--json"]
    names = drafted.file.parent / "names.toml"
    set_key(names, "record.latitude", "0.7")
    (shown,) = [row for row in fact_rows(names.parent) if row["key"] == "latitude"]
    assert (shown["text"], shown["unit"]) == ("0.7 rad", "deg")


def test_set_fills_a_drafted_file_one_value_after_the_other(drafted):
    file = drafted.file.parent / "aircraft.toml"
    set_key(file, "mass", "2280 lb")
    for key, value in (("S", '"big"'), ("Ixx", "-3"), ("mass", '"?"'), ("wing", "3")):
        before = file.read_bytes()
        with pytest.raises(SchemaError):
            set_key(file, key, value)
        assert file.read_bytes() == before
    # the drafted value itself is confirmed, and its comment requests it no more
    assert "CONFIRM: taken as there" in file.read_text()
    set_key(file, "cg", "[0.0, 0.0, 0.0]")
    assert "CONFIRM: taken as there" not in file.read_text()


def test_a_new_draft_takes_the_comment_with_the_value():
    drafted = "a = [0.0]   # x; CONFIRM: y\nb = [0.0]   # CONFIRM\nc = true\n"
    new = "a = [0.0]   # x\nb = [1.0]\nc = true\n"
    assert merge_toml(drafted, drafted, new).text == new
    assert merge_toml(drafted, drafted, drafted).text == drafted


# ---- draft --------------------------------------------------------------------------------------


def test_a_draft_is_kept_and_marked_when_files_change(drafted):
    found = show_draft(drafted, {}, None)
    assert (found["drafted"], found["stale"], found["exists"]) == (True, False, True)
    row = next(row for row in found["columns"] if row["column"] == "CH7")
    assert (row["quantity"], row["confidence"], row["keys"]) == ("-", "not taken", {})
    assert any("no elevator" in text for text in found["remarks"])
    assert "engine 1" in found["quantities"]
    receive(drafted, "second.csv", b"time,q\n0,1\n")
    assert show_draft(drafted, {}, None)["stale"] is True
    # the output of a failed command is not a draft
    keep_draft(drafted, '{"error": {}}')
    assert show_draft(drafted, {}, None)["drafted"] is True


def test_init_writes_into_the_folders_of_the_page_only(tmp_path):
    for words in (
        ["init", "/tmp/x"],
        ["init", "{project}/../x"],
        ["init", "~/x"],
        ["init", "{project}", "--records", "/etc"],
        ["init", "{project}", "--names", "../names.toml"],
    ):
        with pytest.raises(ActionError, match="leads out of the project"):
            demand_allowed(words)
    written = [path.text for path in named_paths(["init", "{project}"]) if path.written]
    assert "{project}/aircraft.toml" in written
    for name in ("project", "work", "other"):
        (tmp_path / name).mkdir()
    places = PlaceholderFolders(tmp_path / "project", tmp_path / "work")
    (places.project / "cases").mkdir()
    demand_allowed(["init", "{project}"], places)
    (places.project / "cases" / "phugoid.toml").symlink_to(tmp_path / "other" / "x.toml")
    with pytest.raises(ActionError, match="by a link"):
        demand_allowed(["init", "{project}"], places)


def test_a_project_that_a_log_drafts_need_not_exist(tmp_path):
    (tmp_path / "log.jsonl").write_text("")
    project, log = tmp_path / "aeromatch.toml", tmp_path / "log.jsonl"
    words = [str(project), "-o", str(tmp_path / "out")]
    context = match_command.make_context("match", [*words, "--actions", str(log)])
    assert context.params["project"] == project
    for refused in (words, [str(tmp_path / "no" / "a.toml"), *words[1:], "--actions", str(log)]):
        with pytest.raises(click.UsageError, match="no file"):
            match_command.make_context("match", refused)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_loop_of_init_is_replayed_into_the_same_files(tmp_path):
    """Draft, a column taken as the elevator, masses; replayed with match --actions elsewhere."""
    (tmp_path / "new").mkdir()
    copy_sources(tmp_path / "new")
    with served(tmp_path / "new" / "aeromatch.toml", tmp_path / "work") as client:
        assert client.act("init", "{project}", "--json")["state"] == "done"
        query = {"column": "CH7", "quantity": "delta_e", "unit": "deg", "sign": "+"}
        (words,) = client.data("/api/new/column", query)["commands"]
        assert client.act(*words)["state"] == "done"
        values = json.dumps({"mass": "2280 lb", "Ixx": "2827", "Iyy": "1913", "Izz": "4169"})
        (words,) = client.data("/api/new/values", {"values": values})["commands"]
        assert client.act(*words)["state"] == "done"
        found = client.data("/api/new")
    row = next(row for row in found["columns"] if row["column"] == "CH7")
    assert (row["quantity"], row["confidence"]) == ("delta_e", "as you wrote it")
    assert found["records"]["flight"]["manoeuvres"] == ["doublet elevator"]
    log = tmp_path / "work" / "actions.jsonl"
    assert [entry.words[0] for entry in read_action_log(log)] == ["init", "set", "init"]

    (tmp_path / "again").mkdir()
    copy_sources(tmp_path / "again")
    assert _carry_out_actions(tmp_path / "again" / "aeromatch.toml", tmp_path / "out", log) is False
    for name in ("aircraft.toml", "names.toml", "aeromatch.toml", "manoeuvres.csv"):
        both = [(tmp_path / folder / name).read_bytes() for folder in ("new", "again")]
        assert both[0] == both[1]
