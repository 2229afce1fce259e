"""A hostile page in another tab of the same browser, from another port of 127.0.0.1, while the
workbench is open; and a wrong token.
"""

import functools
import http.server
import json
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import served, small_project

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]
ACT = {"words": ["set", "{project}/aeromatch.toml", "cutoff", "1 Hz"]}


@pytest.fixture
def client(tmp_path):
    with served(small_project(tmp_path / "t37"), tmp_path / "work") as client:
        yield client


@pytest.fixture
def elsewhere(tmp_path):
    """Address of a page of another origin on this machine."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "index.html").write_text(
        "<!DOCTYPE html><title>elsewhere</title><body></body>", encoding="utf-8"
    )

    class QuietHandler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format, *args):
            pass

    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(QuietHandler, directory=str(folder))
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/index.html"
    server.shutdown()
    server.server_close()


@pytest.fixture
def context(new_page):
    return new_page().context


FETCH = """async ([url, options]) => {
    try { const answer = await fetch(url, options);
      return [answer.type, answer.status, await answer.text()]; }
    catch (error) { return error.name; }
}"""
FRAME = """(url) => new Promise((done) => {
    const frame = document.createElement("iframe");
    frame.onload = () => {
        let seen;
        try { seen = frame.contentDocument && frame.contentDocument.body.textContent;
          } catch (error) { seen = error.name; }
        done(seen);
    };
    frame.src = url;
    document.body.append(frame);
})"""
SCRIPT = """(url) => new Promise((done) => {
    const script = document.createElement("script");
    script.onload = () => done("loaded");
    script.onerror = () => done("refused");
    script.src = url;
    document.body.append(script);
})"""
SOCKET = """(url) => new Promise((done) => {
    const socket = new WebSocket(url);
    socket.onopen = () => done("open");
    socket.onerror = () => done("refused");
})"""
FORM = """([url, text]) => {
    const form = Object.assign(document.createElement("form"), { method: "post", action: url,
      enctype: "text/plain" });
    const [name, value] = text.split("=");
    form.append(Object.assign(document.createElement("input"), { name, value }));
    document.body.append(form);
    form.submit();
}"""


def test_a_hostile_page_in_another_tab_can_do_nothing(client, elsewhere, context):
    project = client.bench.opened.file
    before = project.read_bytes()
    page = context.new_page()
    page.goto(client.bench.address)
    page.get_by_role("heading", name="T-37", exact=True).wait_for()
    report = client.bench.opened.work / "match" / "report"
    report.mkdir(parents=True)
    (report / "report.html").write_text("<p>secret</p>", encoding="utf-8")
    address = client.base + client.data("/api/jobs")["report"]

    hostile = context.new_page()
    hostile.goto(elsewhere)
    text = json.dumps(ACT)
    for url, options in (
        ("/api/project", {}),
        ("/api/project", {"mode": "no-cors", "credentials": "include"}),
        (
            "/api/project",
            {"headers": {"x-aeromatch-token": client.bench.token}},
        ),  # even a token that has leaked
        ("/api/act", {"method": "POST", "body": text}),
        ("/api/act", {"method": "POST", "body": text, "mode": "no-cors"}),
        ("/main.js", {"mode": "no-cors"}),
    ):
        assert hostile.evaluate(FETCH, [client.base + url, options]) == "TypeError", (url, options)
    assert hostile.evaluate(SCRIPT, client.base + "/main.js") == "refused"
    assert hostile.evaluate(SOCKET, client.base.replace("http", "ws") + "/api/jobs") == "refused"
    for url in (client.base + "/", client.bench.address, address):
        assert hostile.evaluate(FRAME, url) in (None, "SecurityError")
    hostile.wait_for_timeout(300)  # what must not come would have come
    frames = [frame for frame in hostile.frames if frame is not hostile.main_frame]
    assert len(frames) == 3
    assert not any("T-37" in frame.content() or "secret" in frame.content() for frame in frames)
    hostile.evaluate(FORM, [client.base + "/api/act", text[:-1] + ',"x":"="}'])
    hostile.wait_for_url(client.base + "/api/act")
    expect(hostile.locator("body")).to_have_text("requests of other pages are refused")
    assert client.bench.jobs.jobs == {}
    assert not client.bench.opened.log.exists()
    assert project.read_bytes() == before


def test_a_page_that_opens_the_workbench_cannot_look_into_it(client, elsewhere, context):
    hostile = context.new_page()
    hostile.goto(elsewhere)
    with context.expect_page() as opened:
        hostile.evaluate("(url) => { window.other = window.open(url); }", client.bench.address)
    opened.value.get_by_text("requests of other pages are refused").wait_for()
    assert hostile.evaluate("window.other.closed || window.other.length") in (True, 0)
    assert hostile.evaluate(
        "(() => { try { return String(window.other.document); } catch (error) { return "
        "error.name; } })()"
    ) in (
        "SecurityError",
        "null",
    )


def test_a_wrong_token_opens_nothing(client, context):
    page = context.new_page()
    page.goto(f"{client.base}/#token={'x' * 43}")
    page.get_by_text("Refused: open the address that aeromatch view printed.").wait_for()
    assert "T-37" not in page.content()
    assert client.bench.token not in page.content()
