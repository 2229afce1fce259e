"""What tests of several packages share."""

import gc
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

ROOT = Path(__file__).parents[1]
START = Path.cwd()
sys.path.insert(0, str(ROOT / "tests"))  # for modules that tests of several packages share

from short_demo import make_short_project  # noqa: E402

os.environ["AEROMATCH_STORE"] = (
    "off"  # no test reads what another one, or the user, left; those of the store name their own
)
EXAMPLES = int(
    os.environ.get("AEROMATCH_EXAMPLES", "30")
)  # of a property; .ci/run tries 100, and tests that need more take multiples
settings.register_profile(
    "any load", deadline=None, max_examples=EXAMPLES
)  # a busy machine is not a fault of the code
settings.load_profile("any load")
# With the default of 700 new objects, looking through the modules and the collected tests takes 7 %
# of the processor time.
gc.set_threshold(50_000, 20, 20)
CHROMIUM = shutil.which("chromium")
# ms that a browser may take for what ends well; a busy machine is not a fault of the page
PATIENCE = 300_000
HERE = ("http://127.0.0.1:", "file:", "data:", "blob:")


# folders whose tests fit models to records: their estimates must not depend on the kernel of the
# linear algebra
FITS = [
    f"tests/{place}/"
    for place in (
        "real",
        "aerodb/update",
        "flighttest/equation_error",
        "flighttest/maximum_likelihood",
    )
]
FITS += [
    f"tests/flighttest/{name}/"
    for name in ("reconstruction", "combining", "separable", "model_structure", "uncertainty")
]
FITS += [
    f"tests/flighttest/{name}/"
    for name in (
        "engine",
        "ground_effect",
        "landing_gear",
        "multibody",
        "spin",
        "actuators",
        "stall",
    )
]


def _place_in_the_run(item):
    """Return the rank of a test in the order of a run; see `pytest_collection_modifyitems`."""
    if item.path.name == "test_demo.py":
        return 0
    if item.path.name == "test_docs.py":
        page = item.callspec.params["page"] if hasattr(item, "callspec") else None
        return 2 if page and "./run demo" in page.read_text(encoding="utf-8") else 1
    if item.path.name == "test_model_exchange.py":  # reads the demo
        return 2
    is_long = item.path.parent.name in ("real", "published")
    return 1 if item.path.parent == ROOT / "tests" or is_long else 3


@pytest.hookimpl(optionalhook=True)  # a hook of pytest-xdist
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file in one process."""
    if config.getvalue("dist") != "loadfile":
        return None
    from scheduling import FileScheduling  # needs pytest-xdist

    return FileScheduling(config, log)


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(items):
    """Order the tests, and mark what follows from the place of a test: the fits, for one.

    All tests of a file run in one process (`scheduling.FileScheduling`).  A process that begins a
    long file last keeps the others waiting, so the order is stated: the demo, which takes longest,
    then what does not wait for it among the pages and the tests next to this file, and the longest
    files, then the pages that read the demo, then all else (``--no-loadscope-reorder`` keeps this
    order).
    """
    items.sort(key=_place_in_the_run)
    for item in items:
        if item.get_closest_marker("browser"):
            item.add_marker(pytest.mark.serial)
        if item.get_closest_marker("nightly"):
            item.add_marker(pytest.mark.slow)
        if item.nodeid.startswith(tuple(FITS)):
            item.add_marker(pytest.mark.blas)


def pytest_runtest_setup(item):
    if CHROMIUM is None and item.get_closest_marker("browser"):
        pytest.skip("needs chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def chromium():
    """The browser; every test opens its own contexts in it.

    A test never reads a state once that an action brings about: it waits for it with ``expect``,
    which repeats until it holds.
    """
    sync_api = pytest.importorskip("playwright.sync_api")
    sync_api.expect.set_options(timeout=PATIENCE)
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"], timeout=PATIENCE
        )
        yield browser
        browser.close()


@pytest.fixture
def new_page(chromium):
    """Return a function that opens a page in a context of its own, as ``browser.new_page``, with
    patience.
    """
    contexts = []

    def make(**options):
        contexts.append(
            chromium.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
        )
        contexts[-1].set_default_timeout(PATIENCE)
        return contexts[-1].new_page()

    yield make
    for context in contexts:
        context.close()


@pytest.fixture
def complaints():
    """The messages on the console of `page`; a test that brings about a complaint takes it out."""
    return []


@pytest.fixture
def page(new_page, complaints):
    """A page that must neither complain nor load anything from elsewhere than this machine."""
    page, asked = new_page(), []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    assert [url for url in asked if not url.startswith(HERE)] == []
    assert complaints == []


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory):
    """Return the temporary folder that all test processes of one session share."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if os.environ.get("PYTEST_XDIST_WORKER") else own


@pytest.fixture(scope="session")
def demo(shared_folder):
    """Return the folder of one run of the short demo and the finished process.

    For tests marked slow only. See `short_demo`; `whole_demo` is for nightly tests.
    """
    return _perform_once(shared_folder, "demo", _match_short_project)


@pytest.fixture(scope="session")
def whole_demo(shared_folder):
    """Return the folder of one run of the demo and the finished process; for nightly tests."""
    return _perform_once(shared_folder, "whole_demo", lambda _: ["demo"])


def _match_short_project(folder):
    return ["match", str(make_short_project(folder / "t37"))]


def _perform_once(shared, name, words_for):
    """Return folder and process of a run that all test processes of one session share.

    The first process makes it under a file lock, which takes a minute or more. Its stages are kept
    in ``store`` of the shared folder; the pages of the documentation take them from there.

    Parameters
    ----------
    shared : Path
        As of `shared_folder`.
    name : str
        Name of the run.
    words_for : callable
        From a folder for its inputs to the words of the command.
    """
    # as deep as its copies in test_docs: reports name inputs relatively, and the folders of a test
    # process are one level deeper
    levels = ("run", "fresh") if os.environ.get("PYTEST_XDIST_WORKER") else ("fresh",)
    folder = shared.joinpath(name, *levels, "out", "t37")
    protocol = shared / name / "run.json"
    with FileLock(shared / f"{name}.lock"):
        if not protocol.exists():
            folder.parent.mkdir(parents=True)
            words = [*words_for(shared / name), "--json", "-o", str(folder)]
            command = [sys.executable, "-m", "aeromatch", *words]
            run = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=6000,
                env={**os.environ, "AEROMATCH_STORE": str(shared / "store")},
            )
            protocol.write_text(
                json.dumps(
                    {
                        "args": command,
                        "returncode": run.returncode,
                        "stdout": run.stdout,
                        "stderr": run.stderr,
                    }
                )
            )
    return folder, subprocess.CompletedProcess(**json.loads(protocol.read_text()))


@pytest.fixture
def mat_files_in_this_process(monkeypatch):
    """Read MAT files without the child process that protects users from a crash of SciPy: it takes
    half a second a file.
    """
    from flightmech.support.array_files import mat_files

    monkeypatch.setattr(mat_files, "_decode_in_child", mat_files.decode_mat)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_teardown(item):
    """Fail a test that leaves another working directory: later tests of its process would fail by
    chance.
    """
    yield
    if Path.cwd() != START:
        left = Path.cwd()
        os.chdir(START)
        pytest.fail(f"the test left the working directory {left}")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item):
    """Give all tests of a folder that need absent material of ``../shared`` one reason, so that
    ``-rs`` prints one line a folder.
    """
    report = (yield).get_result()
    if report.skipped and isinstance(report.longrepr, tuple) and "../shared" in report.longrepr[2]:
        folder = ROOT.joinpath(*report.nodeid.partition("::")[0].split("/")[:2])
        report.longrepr = (
            str(folder),
            None,
            "Skipped: needs ../shared, material that is not part of the repository",
        )


@pytest.fixture
def add_distribution(tmp_path, monkeypatch):
    """Return a function that puts a distribution with entry points, and its modules, on the path.

    It takes the name, the entry points by group and name, and the text of each module.
    """

    def add(name: str, groups: dict[str, dict[str, str]], **modules: str) -> Path:
        folder = tmp_path / f"site-{name}"
        information = folder / f"{name.replace('-', '_')}-1.0.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        lines = []
        for group, points in groups.items():
            lines += [f"[{group}]", *(f"{key} = {value}" for key, value in points.items())]
        (information / "entry_points.txt").write_text("\n".join(lines) + "\n")
        for module, text in modules.items():
            (folder / f"{module}.py").write_text(text)
            monkeypatch.delitem(sys.modules, module, raising=False)
        monkeypatch.syspath_prepend(str(folder))
        return folder

    return add
