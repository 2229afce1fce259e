"""Who is answered, with what; actions, their log and its replay; work that is cancelled."""

import json
import os
import shutil
import stat
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import PATIENCE, RECORD, T37, served, small_project

from aeromatch.workbench import actions
from aeromatch.workbench.actions import ActionError, PlaceholderFolders
from flightmech.errors import ParseError
from flighttest.records.manoeuvre_table import read_manoeuvres


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workbench")
    with served(small_project(folder / "t37"), folder / "work") as client:
        yield client


def test_only_the_token_opens_data(client):
    assert client.ask("/api/project")[0] == 200
    for token in (None, "", "x" * 43, client.bench.token[:-1], "\xe9" * 43):
        code, _, text = client.ask("/api/project", x_aeromatch_token=token)
        assert code == 403
        assert b"T-37" not in text
    assert stat.S_IMODE((client.bench.opened.work / "token").stat().st_mode) == 0o600
    assert client.bench.token not in client.ask("/")[2].decode()


def test_other_pages_and_other_hosts_are_refused(client):
    """A hostile page: its origin, its kind of request, and a name of its own that it lets resolve
    to 127.0.0.1.
    """
    for headers in (
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"sec_fetch_site": "cross-site"},
        {"sec_fetch_site": "same-site"},
        {"host": "evil.example"},
        {"host": f"evil.example:{client.bench.port}"},
    ):
        assert client.ask("/api/project", **headers)[0] == 403, headers
        assert client.ask("/api/act", body={"words": ["set"]}, **headers)[0] == 403, headers
        assert client.ask("/", **headers)[0] == 403, headers
    assert client.ask("/api/project", origin=client.base, sec_fetch_site="same-origin")[0] == 200


def test_headers_keep_the_page_to_itself(client):
    _, headers, _ = client.ask("/")
    policy = headers["content-security-policy"]
    assert "script-src 'self'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert not any(name.lower().startswith("access-control") for name in headers)
    assert headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/%2e%2e/server.py",
        "/uplot/../../writer.py",
        "/report/x/match/report/report.html",
        "/etc/passwd",
    ],
)
def test_files_outside_are_not_served(client, path):
    assert client.ask(path)[0] in (403, 404)


def test_a_report_is_sandboxed_and_has_an_address_of_its_own(client):
    report = client.bench.opened.work / "match" / "report"
    report.mkdir(parents=True)
    (report / "report.html").write_text("<script>1</script>")
    (client.bench.opened.work / "secret").write_text("x")
    address = client.data("/api/jobs")["report"]
    code, headers, _ = client.ask(address, x_aeromatch_token=None)
    assert code == 200
    assert headers["content-security-policy"].startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in headers["content-security-policy"]
    assert client.ask(address.replace("report/", "report/0", 1))[0] == 403
    shutil.rmtree(report.parent)


def test_bad_requests_name_what_came(client):
    code, _, text = client.ask("/api/record", {"name": "t37_27_val_dutch_rol"})
    assert code == 400
    assert RECORD in json.loads(text)["text"]
    assert (
        client.ask(
            "/api/channels",
            {"name": RECORD, "channels": "record/imu/p", "start": "x", "stop": 1, "points": 9},
        )[0]
        == 400
    )
    assert (
        client.ask(
            "/api/channels",
            {"name": RECORD, "channels": "record/imu/none", "start": 0, "stop": 1, "points": 9},
        )[0]
        == 400
    )
    assert client.ask("/api/act", body={"words": "set"})[0] == 400
    assert client.ask("/api/cancel", body={"number": 99})[0] == 400


@pytest.mark.parametrize(
    "words",
    [
        ["datcom", "run", "x"],
        ["view", "{project}/aeromatch.toml"],
        ["match", "{project}/aeromatch.toml", "-o", "/tmp/x"],
        ["match", "{project}/../aeromatch.toml", "-o", "{work}/match"],
        ["set", "~/x.toml", "a", "1"],
        ["match", "{project}/aeromatch.toml", "--output=/tmp/x"],
        [],
        ["set", 1],
    ],
)
def test_actions_are_verbs_inside_the_project(words):
    with pytest.raises(ActionError):
        actions.demand_allowed(words)


@pytest.mark.nightly
def test_actions_change_files_are_logged_and_replayed(client, tmp_path):
    """Marks and keys, by the page's own words; a copy of the untouched project becomes the same by
    the log.
    """
    mark = [
        "flight",
        "mark",
        "{project}/manoeuvres.csv",
        RECORD,
        "--start-from",
        "{project}/flight/" + RECORD + ".nc",
        "--names",
        "{project}/names.toml",
    ]
    assert (
        client.act(*mark, "--kind", "doublet", "--control", "rudder", "--span", "1", "2.5")["state"]
        == "done"
    )
    assert (
        client.act("set", "{project}/aeromatch.toml", "manoeuvres", "manoeuvres.csv")["code"] == 0
    )
    failed = client.act("set", "{project}/aeromatch.toml", "cutof", "3 Hz")
    assert failed["state"] == "failed"
    assert "cutoff" in failed["error"]
    assert client.act(*mark, "--row", "1", "--span", "1", "3")["state"] == "done"
    project = client.bench.opened.places.project
    marks = read_manoeuvres(project / "manoeuvres.csv")[RECORD]
    assert client.data("/api/record", {"name": RECORD})["manoeuvres"]["source"] == "table"
    assert len(marks) == len(client.data("/api/record", {"name": RECORD})["manoeuvres"]["rows"])
    log = client.bench.opened.log
    entries = actions.read_action_log(log)
    assert [entry.words[0] for entry in entries] == [
        "flight",
        "set",
        "flight",
    ]  # what failed changed nothing

    places = PlaceholderFolders(project, client.bench.opened.work)
    assert actions.to_do(entries, places) == []
    other = PlaceholderFolders(small_project(tmp_path / "t37").parent, tmp_path / "work")
    assert actions.to_do(entries, other) == entries
    assert actions.carry_out(entries, other, lambda text: nullcontext()) == []
    for name in ("manoeuvres.csv", "aeromatch.toml"):
        assert (other.project / name).read_bytes() == (project / name).read_bytes()
    assert actions.to_do(entries, other) == []
    (other.project / "manoeuvres.csv").write_text("record,kind,control,start,end\n")
    with pytest.raises(ActionError, match="its content is none that the log knows"):
        actions.to_do(entries, other)


def test_a_log_of_another_kind_is_refused(tmp_path):
    log = tmp_path / "actions.jsonl"
    log.write_text('{"words": ["set"]}\n')
    with pytest.raises(ParseError, match="JSON with the keys"):
        actions.read_action_log(log)
    log.write_text(
        json.dumps({"number": 1, "words": ["datcom", "run", "rm"], "code": 0, "files": {}}) + "\n"
    )
    with pytest.raises(ActionError, match="no action 'datcom run'"):
        actions.read_action_log(log)


@pytest.mark.slow
@pytest.mark.nightly
def test_work_is_cancelled_with_its_processes_and_leaves_nothing(client):
    words = ["match", "{project}/aeromatch.toml", "-o", "{work}/other"]
    job = client.data("/api/act", body={"words": words})
    after = client.data(
        "/api/act", body={"words": ["set", "{project}/aeromatch.toml", "cutoff", "4 Hz"]}
    )
    assert after["state"] == "waiting"
    until = time.monotonic() + PATIENCE
    while (found := client.data("/api/output", {"number": job["number"]}))[
        "state"
    ] != "running" or "flight records" not in found["err"]:
        assert time.monotonic() < until, found
        time.sleep(0.1)
    process = client.bench.jobs.jobs[job["number"]].process
    assert client.data("/api/cancel", body={"number": job["number"]})["state"] == "cancelled"
    assert process.poll() is not None
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
    assert not (client.bench.opened.work / "other").exists()
    assert client.bench.jobs.wait(after["number"], PATIENCE).state == "done"  # the queue goes on


def test_a_job_that_another_request_adds_does_not_break_a_list_of_jobs(client, monkeypatch):
    describe = client.bench._describe_job

    def describe_and_add(job):
        client.bench.jobs.run("added meanwhile", "platform", [])
        return describe(job)

    client.bench.jobs.run("first", "platform", [])
    with monkeypatch.context() as patch:
        patch.setattr(client.bench, "_describe_job", describe_and_add)
        before = client.data("/api/jobs")["jobs"]
    after = client.data("/api/jobs")["jobs"]
    assert len(after) == 2 * len(before)


def test_the_token_survives_a_restart(tmp_path):
    project = small_project(tmp_path / "t37")
    with served(project, tmp_path / "work") as client:
        token, port = client.bench.token, client.bench.port
    with served(project, tmp_path / "work", port) as client:
        assert (client.bench.token, client.bench.port) == (token, port)
        assert client.data("/api/project")["title"] == "T-37"


def test_a_project_of_the_product_is_left_alone():
    """The tests above work on copies."""
    assert not (T37 / "manoeuvres.csv").exists()
    assert not (T37 / "workbench").exists()
