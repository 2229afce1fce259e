"""A small project for the tests of the workbench, and a client of its server."""

from __future__ import annotations

import json
import shutil
import threading
import urllib.error
import urllib.request
import warnings
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlencode

T37 = Path(__file__).parents[3] / "data" / "t37"
RECORD = "t37_27_val_dutch_roll"
MULTISINE = "t37_10_multisine_clean_5kft"
CASE = "22_roll_response"
PATIENCE = 1200.0  # s, that a busy machine may take for what ends well


def small_project(folder: Path) -> Path:
    """Return the file of the T-37's project with its own copies of the texts; recordings and
    listings are links.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (
        "aeromatch.toml",
        "aircraft.toml",
        "apriori.toml",
        "engine.nc",
        "engine.toml",
        "names.toml",
        "names_cockpit.toml",
    ):
        shutil.copy(T37 / name, folder)
    for name in ("datcom", "flight"):
        (folder / name).symlink_to(T37 / name, target_is_directory=True)
    shutil.copytree(T37 / "cases", folder / "cases")
    return folder / "aeromatch.toml"


def one_case_project(folder: Path) -> Path:
    """Return the file of a `small_project` with one case and one record that identifies, the
    multisine: a match takes 18 s.
    """
    import tomlkit

    file = small_project(folder)
    content = tomlkit.parse(file.read_text(encoding="utf-8"))
    content["flights"] = [f"flight/{MULTISINE}.nc", "flight/t37_22_val_roll_response_clean.nc"]
    content["cases"] = [f"cases/{CASE}.toml"]
    content["fit"] = [fit for fit in content["fit"] if fit["name"] == "multisine"]
    for submodel in ("engine", "controls", "gear", "ground_effect"):
        content.pop(submodel, None)
    file.write_text(tomlkit.dumps(content), encoding="utf-8")
    return file


def reconstructed_project(folder: Path, work: Path, records: list[str]) -> Path:
    """Return the file of a `small_project`; in its working folder 49 s of some records,
    reconstructed, and the tables of DATCOM.
    """
    import aerodb
    import flighttest
    from aeromatch.project.project import read_project
    from aeromatch.workflow.aerodynamics import a_priori
    from flightmech.aircraft.aircraft_file import read_aircraft
    from flightmech.errors import AeromatchWarning

    project = read_project(file := small_project(folder))
    aircraft = read_aircraft(project.aircraft)
    for name in ("paths", "match"):
        (work / name).mkdir(parents=True)
    for name in records:
        path = flighttest.reconstruct(
            flighttest.read(project.flights[name], project.names), aircraft, windows=[(0.0, 49.3)]
        )
        flighttest.reconstruction.save_path(path, work / "paths" / f"{name}.nc")
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", AeromatchWarning
        )  # of the listing of the flaps; tests/aerodb has them
        aerodb.save(a_priori(project, aircraft), work / "match" / "datcom.nc")
    return file


class Client:
    """Calls a server as the page does."""

    def __init__(self, bench):
        self.bench, self.base = bench, f"http://127.0.0.1:{bench.port}"

    def ask(self, path, query=None, body=None, **headers):
        """Return code, headers and bytes of an answer; a header of value None is not sent."""
        url = self.base + path + (f"?{urlencode(query)}" if query else "")
        sent = {
            "x-aeromatch-token": self.bench.token,
            **{name.replace("_", "-"): text for name, text in headers.items()},
        }
        request = urllib.request.Request(url, None if body is None else json.dumps(body).encode())
        for name, text in sent.items():
            if text is not None:
                request.add_header(name, text)
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return answer.status, dict(answer.headers), answer.read()
        except urllib.error.HTTPError as refused:
            return refused.code, dict(refused.headers), refused.read()

    def data(self, path, query=None, body=None):
        code, _, found = self.ask(path, query, body)
        assert code == 200, found
        return json.loads(found)

    def act(self, *words):
        """Perform an action and return what the server states of it when it has ended."""
        job = self.data(
            "/api/act", body={"words": words, "wait": 60}
        )  # the server waits for a minute at most
        self.bench.jobs.wait(job["number"], PATIENCE)
        return next(one for one in self.data("/api/jobs")["jobs"] if one["number"] == job["number"])


@contextmanager
def served(project: Path, work: Path, port: int = 0):
    """Yield a workbench that is served in a thread."""
    import uvicorn

    from aeromatch.workbench.opened import OpenProject
    from aeromatch.workbench.server import Workbench

    bench = Workbench(OpenProject(project, work), port)
    bench.socket.listen(64)
    server = uvicorn.Server(uvicorn.Config(bench.app(), log_level="warning"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bench.socket]}, daemon=True)
    thread.start()
    try:
        yield Client(bench)
    finally:
        server.should_exit = True
        thread.join(120)
        assert not thread.is_alive()


def drawn_anew(page, query):
    """Have a page read all again, as when an action has ended, and wait until it has drawn an
    element anew.
    """
    page.evaluate("query => { window.before = document.querySelector(query); }", query)
    page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")
    page.wait_for_function(
        "query => window.before && document.querySelector(query) !== window.before", arg=query
    )
