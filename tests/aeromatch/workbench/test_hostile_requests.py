"""Requests that the page does not send, commands and logs that lead out of the project."""

import asyncio
import contextlib
import http.client
import json
import socket
import sys
from pathlib import Path
from urllib.parse import quote

import pytest
from starlette.requests import ClientDisconnect

from aeromatch.workbench.requests import request_body
from aeromatch.workbench.requests.request_body import BodyError, read_body
from aeromatch.workbench.server import NEW_PROJECT_ROUTES

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, served, small_project

from aeromatch.workbench import actions, databases, identification, matching, records
from aeromatch.workbench.allowed_actions import ActionError, PlaceholderFolders, demand_allowed

ROUTES = {**records.ROUTES, **identification.ROUTES, **databases.ROUTES, **matching.ROUTES}
ROUTES |= NEW_PROJECT_ROUTES
ODD = ("", "\0", "²", "-1", "nan", "1e999", "9" * 4400, "a" * 3000, "../..", "/etc/passwd", "[")
BODIES = (
    b"",
    b"null",
    b"[]",
    b"{}",
    b"3",
    b"\xff",
    b"[" * 100_000,
    b'{"words": ["set", "{project}/\\ud800", "a", "b"], "wait": 5}',
    b'{"words": ["set", "{project}/a\\u0000", "a", "b"]}',
    b'{"words": ["set", "{project}/none.toml", "a", "b"], "wait": [1]}',
    b'{"words": ["set", "{project}/none.toml", "a", "b"], "wait": NaN}',
    b'{"words": ["set", "--none"]}',
    b'{"words": {"a": 1}}',
    b'{"number": {}}',
    b'{"number": true}',
    b'{"number": 1e999}',
    b'{"windows": [{"record": "\\udc80", "start": 0, "end": 1}], "model": "Cm = 1"}',
    b'{"windows": [{"record": 1, "start": "x", "end": null}], "model": []}',
    b'{"windows": [], "model": "Cm = 1 + __import__(1)"}',
)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    with served(small_project(folder / "t37"), folder / "work") as client:
        yield client


def send(client, method, path, body=None, token=True):
    """Send a request as it stands, and return the code and the bytes of the answer."""
    link = http.client.HTTPConnection("127.0.0.1", client.bench.port, timeout=60)
    link.putrequest(method, path, skip_accept_encoding=True)
    if token:
        link.putheader("X-Aeromatch-Token", client.bench.token)
    if body is not None:
        link.putheader("Content-Length", str(len(body)))
    link.endheaders(body)
    answer = link.getresponse()
    return answer.status, answer.read()


def is_refusal(code, content):
    """Return whether an answer refuses a request with a sentence."""
    return 400 <= code < 500 and len(content) > 5


@pytest.mark.nightly
def test_odd_bodies_are_refused_with_a_sentence(client):
    posts = [path for method, path in ROUTES if method == "POST"] + ["/api/act", "/api/cancel"]
    for path in posts:
        for body in BODIES:
            code, content = send(client, "POST", path, body)
            assert is_refusal(code, content), (path, body[:60], code)
    # a request that was refused has no effect on later ones
    assert send(client, "GET", "/api/jobs")[0] == 200


class LeftRequest:
    """A request whose client leaves in the middle of the body."""

    headers = {}

    async def stream(self):
        yield b"{"
        raise ClientDisconnect


class StalledRequest(LeftRequest):
    """A request whose client sends a part of the body, and waits."""

    async def stream(self):
        yield b"{"
        await asyncio.sleep(60.0)


def test_a_client_that_leaves_in_the_middle_of_its_body_is_no_fault_of_the_server():
    with pytest.raises(ClientDisconnect):
        asyncio.run(read_body(LeftRequest()))


def test_a_body_that_does_not_end_is_refused(monkeypatch):
    monkeypatch.setattr(request_body, "_MOST_PAUSE", 0.05)
    with pytest.raises(BodyError, match="stopped after 1 bytes") as caught:
        asyncio.run(read_body(StalledRequest()))
    assert caught.value.status == 408


# a body that the server reads, one that it refuses, and one of a method without a body
@pytest.mark.parametrize(
    ("method", "path", "code"),
    [("POST", "/api/act", 413), ("POST", "/api/new/file?name=a.csv", 413), ("GET", "/", 200)],
)
def test_a_stated_length_is_refused_before_the_body_arrives(client, method, path, code):
    with socket.create_connection(("127.0.0.1", client.bench.port), timeout=60) as link:
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{client.bench.port}\r\n"
        head += f"X-Aeromatch-Token: {client.bench.token}\r\nContent-Length: 99000000000\r\n\r\n"
        link.sendall(head.encode())
        # The server ends the connection, otherwise this loop does not end.
        answer = b"".join(iter(lambda: link.recv(65536), b""))
    assert answer.startswith(b"HTTP/1.1 %d " % code), answer[:300]


def test_the_rest_of_a_body_that_is_too_long_is_not_read(client):
    link = http.client.HTTPConnection("127.0.0.1", client.bench.port, timeout=60)
    parts = (b"1" * 100_000 for _ in range(2000))
    sent = {"X-Aeromatch-Token": client.bench.token}
    with contextlib.suppress(ConnectionError):
        link.request("POST", "/api/act", parts, sent, encode_chunked=True)
    left = sum(len(part) for part in parts)
    assert left > 100_000_000


@pytest.mark.nightly
def test_odd_queries_are_answered_without_a_fault_of_the_server(client):
    names = ("name", "number", "report", "file", "term", "a", "points", "start", "channels", "find")
    gets = [path for method, path in ROUTES if method == "GET"] + ["/api/output", "/api/actions"]
    for path in gets:
        for text in ODD:
            query = "&".join(f"{name}={quote(text)}" for name in names)
            code, content = send(client, "GET", f"{path}?{query}")
            assert code == 200 or is_refusal(code, content), (path, text[:20], code)
    bad_number = send(client, "GET", f"/api/record?name={RECORD}%00")
    assert bad_number[0] == 400
    assert b"zero byte" in bad_number[1]


@pytest.mark.parametrize(
    "path", ["/%00", "/" + "a" * 300, "/uplot/%00", "/%ff", "/uplot/" + "a/" * 3000]
)
def test_odd_paths_are_not_served(client, path):
    code, content = send(client, "GET", path, token=False)
    assert code == 404
    assert content == b"not found"


def test_the_address_of_a_report_serves_the_files_of_a_report_only(client):
    work, ticket = client.bench.opened.work, client.bench.ticket
    report = work / "runs" / "a"
    (report / "cases").mkdir(parents=True)
    for name in ("report.html", "cases/x.html", "notes.txt", "report.pdf"):
        (report / name).write_text(name)
    (report / "cases" / "link.html").symlink_to(work / "token")
    (work / "runs" / "report.html").write_text("x")
    base = f"/report/{ticket}"
    assert send(client, "GET", f"{base}/runs/a/report.html", token=False) == (200, b"report.html")
    assert send(client, "GET", f"{base}/runs/a/cases/x.html", token=False)[0] in (200, 404)
    for name in (
        "token",
        "/token",
        "actions.jsonl",
        "runs/a/notes.txt",
        "runs/a/../../token",
        "runs/a/cases/../../../token",
        "runs/../token/report.html",
        "runs/%2e%2e/token",
        "runs/report.html",
        "runs/a/cases/link.html",
        "runs/a/pages/link.html",
        "match/report/report.html/%00",
        "jobs/1.out.txt",
    ):
        code, content = send(client, "GET", f"{base}/{name}", token=False)
        assert code == 404, name
        assert client.bench.token.encode() not in content


@pytest.mark.parametrize(
    "words",
    [
        ["flight", "mark", "/tmp/out=side.csv", "r", "--kind", "doublet"],
        ["flight", "mark", "../../a=b.csv", "r", "--kind", "doublet"],
        ["flight", "manoeuvres", "{project}/r.nc", "-o/tmp/x.csv"],
        ["flight", "manoeuvres", "{project}/r.nc", "--figure", "{work}2/x.svg"],
        ["flight", "manoeuvres", "{project}/r.nc", "--figure={project}/{work}/../x.svg"],
        ["fmu", "write", "a.toml", "d.nc", "-o", "a/../../m.fmu"],
        ["db", "edit", "{work}/a.nc", "scale", "CL/basic", "--by", "2", "-o/tmp/a.nc"],
        ["db", "edit", "/tmp/a.nc", "scale", "CL/basic", "--by", "2", "-o", "{work}/a.nc"],
        ["pom", "run", "{project}/c.toml", "--model", "m=/tmp/m.fmu"],
        ["pom", "run", "{project}/c.toml", "--model", "/tmp/m=../m.fmu"],
        ["pom", "run", "{project}/c.toml", "--database", "m=C:\\m.nc"],
        ["pom", "run", "{project}/c.toml", "--scheduler", "tcp://127.0.0.1:1"],
        ["match", "{project}/aeromatch.toml", "-o", "{work}/m", "--scheduler=tcp://h:1"],
        ["match", "{project}/aeromatch.toml", "-o", "{work}/m", "--actions", "{work}/l"],
        ["match", "{project}/aeromatch.toml", "-o", "{work}/m", "--resume", "/tmp/kept"],
        ["set", "{project}/aeromatch.toml", "aircraft", '"/etc/a.toml"'],
        ["set", "{project}/aeromatch.toml", "flights", '["flight/a.nc", "../b.nc"]'],
        ["set", "{project}/aeromatch.toml", "a", "b", "--also", "c", '{ file = "~/x" }'],
        ["set", "{project}/aeromatch.toml", "a", "b", "--trial", "/tmp/x.toml"],
        ["set", "{project}/a\0.toml", "a", "b"],
        ["set", "{project}/\ud800.toml", "a", "b"],
        ["set", "{project}/aeromatch.toml", "a", "b", "--none"],
        ["db", "edit", "{work}/a.nc"],
        ["match", "{project}/aeromatch.toml", "x", "-o", "{work}/m"],
    ],
)
def test_a_path_out_of_the_folders_is_refused(words):
    with pytest.raises(ActionError):
        demand_allowed(words)


@pytest.mark.parametrize(
    "words",
    [
        ["db", "edit", "{work}/a.nc", "scale", "*/gear", "--by", "2", "--note", "a/.. ", "-o", "b"],
        [
            "pom",
            "run",
            "{project}/c.toml",
            "--model",
            "m={work}/match/final.fmu",
            "-o{work}/runs/a",
        ],
        ["match", "{project}/aeromatch.toml", "--output={work}/match"],
        ["set", "{project}/cases/a.toml", "rationale.q", "about 5 % / 2 s", "--trial", "{work}/a"],
    ],
)
def test_what_the_page_sends_is_allowed(words):
    demand_allowed(words)


@pytest.mark.parametrize("name", ["{work}/token", "{work}/TOKEN", "{project}/w/actions.jsonl"])
def test_files_of_the_workbench_itself_are_not_written(tmp_path, name):
    """A log of others would choose the token of the server, or what the next replay does."""
    (tmp_path / "w").mkdir()
    places = PlaceholderFolders(tmp_path, tmp_path / "w")
    words = ["flight", "identify", "{work}/p.nc", "--aircraft", "{project}/a.toml", "-o"]
    demand_allowed([*words, "{work}/fit.nc"], places)
    with pytest.raises(ActionError, match="a file of the workbench itself"):
        demand_allowed([*words, name], places)


def test_a_link_out_of_the_folders_is_not_written(tmp_path):
    for name in ("project", "work", "other"):
        (tmp_path / name).mkdir()
    places = PlaceholderFolders(tmp_path / "project", tmp_path / "work")
    (places.project / "out").symlink_to(tmp_path / "other")
    (places.project / "names.toml").symlink_to(tmp_path / "other" / "names.toml")
    for words in (
        ["flight", "mark", "{project}/out/a.csv", "r", "--kind", "doublet"],
        ["set", "{project}/names.toml", "imu.q", "Q"],
    ):
        demand_allowed(words)
        with pytest.raises(ActionError, match="by a link"):
            demand_allowed(words, places)
    # recordings are often links
    demand_allowed(["flight", "manoeuvres", "{project}/out/a.nc", "-o", "{work}/a.csv"], places)


ENTRY = (["set", "{project}/x.toml", "a", "b"], 0, {"{project}/x.toml": ("1", "2")})


@pytest.mark.parametrize("torn", ["half", "zeros", "no line end", "half a character"])
def test_an_action_after_a_torn_line_is_logged(tmp_path, torn):
    log = tmp_path / "actions.jsonl"
    actions.append_action(log, *ENTRY)
    whole = log.read_bytes()
    rest = {
        "half": whole[:40],
        "zeros": bytes(64),
        "no line end": whole[:-1],
        "half a character": whole[:20] + b"\xc3",
    }
    log.write_bytes(whole + rest[torn])
    expected = 2 if torn == "no line end" else 1
    assert len(actions.read_action_log(log)) == expected
    assert actions.append_action(log, *ENTRY).number == expected + 1
    assert [json.loads(line)["number"] for line in log.read_text().splitlines()][-1] == expected + 1
    assert len(actions.read_action_log(log)) == expected + 1


def test_a_log_does_not_hash_files_of_others(tmp_path):
    log = tmp_path / "actions.jsonl"
    for name in ("/etc/passwd", "{project}/../a", "x", "{work}/a/../../b"):
        actions.append_action(log, ENTRY[0], 0, {name: ("", "00")})
        with pytest.raises(ActionError, match="leads out of the project"):
            actions.read_action_log(log)
        log.unlink()
