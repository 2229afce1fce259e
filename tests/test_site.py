"""The documentation as a site: built with warnings as errors, opened in a real browser, no request
to another host.
"""

import functools
import http.server
import os
import re
import runpy
import subprocess
import sys
import threading
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [
    "index.html",
    "how-to/own-aircraft/",
    "explanation/proof-of-match/tolerances/",
    "reference/verbs/",
    "reference/flighttest.regression.equation_error/",
    "design/folders/",
]


def test_every_page_is_in_the_table_of_contents():
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")]
    pages += runpy.run_path(str(ROOT / "docs" / "scripts" / "make_site.py"))["SCRIPTS"]
    assert [page for page in pages if page not in listed] == [], "add it to nav in mkdocs.yml"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves a folder without a line for each request."""

    def log_message(self, *_):
        pass


def _build_site(folder):
    """Build the site in a folder, with warnings as errors, and return the folder."""
    pytest.importorskip("mkdocs", reason="needs the docs extra: pip install -e '.[docs]'")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    built = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=3000
    )
    assert built.returncode == 0, built.stderr
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Serve the site and return its address; ``AEROMATCH_SITE`` names one that is built already."""
    folder = os.environ.get("AEROMATCH_SITE") or _build_site(tmp_path_factory.mktemp("site"))
    handler = functools.partial(Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.mark.slow
@pytest.mark.browser
def test_pages_fit_every_screen_and_request_nothing_from_another_host(site, new_page):
    """Each page is opened once: it counts as loaded half a second after its last request."""
    from playwright.sync_api import expect

    page = new_page()
    requests, failures = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("response", lambda response: response.status >= 400 and failures.append(response.url))
    page.on("pageerror", lambda error: failures.append(str(error)))
    for name in PAGES:
        page.goto(site + name, wait_until="networkidle")
        expect(page.locator("article h1")).to_have_count(1)
        for width in (1280, 360):
            page.set_viewport_size({"width": width, "height": 800})
            page.wait_for_function(f"innerWidth == {width}")
            print(name, width)  # shown if the wait below ends without a result
            # scripts of the page wrap its tables after the change of the width
            page.wait_for_function(f"document.documentElement.scrollWidth <= {width}")
    assert len(requests) > len(PAGES)
    assert [url for url in requests if not url.startswith((site, "data:", "blob:"))] == []
    assert failures == []


@pytest.mark.slow
@pytest.mark.browser
def test_search_finds_a_page(site, new_page):
    from playwright.sync_api import expect

    page = new_page()
    page.goto(site, wait_until="networkidle")
    page.locator("input[name=query]").press_sequentially(
        "collinearity"
    )  # the page listens to keys, not to a change of the value
    hit = page.locator(
        ".md-search-result__link"
    ).first  # changes with every key: the list of "co" is drawn before that of the whole word
    # the page that explains what it does to standard errors
    expect(hit).to_have_attribute("href", re.compile("/regression/"))
