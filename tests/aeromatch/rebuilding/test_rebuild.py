"""A match as a build: the same bytes whatever was kept, killed or damaged, and no more work than a
change needs.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from aeromatch.cli.actions.examples import example_folder
from aeromatch.planning.record_looks import STATES
from aeromatch.rebuilding.products import FLIGHTS
from flightmech.support.kept_stages.store import PLACE
from pom.diagnosis.joint_correction import SWAPS

pytestmark = pytest.mark.nightly
FIT = """
[[fit]]
name = "pitch"
records = ["cruise"]
manoeuvres = ["3211 elevator", "doublet elevator"]
models = ["CL = 1 + alpha + qhat + delta_e", "Cm = 1 + alpha + qhat + delta_e"]
"""
# the corrected model states which share of the gap each of its terms explains in a case
# and every diagnosis enters the ranking over all cases
CORRECTED = {
    "corrected database",
    "corrected aircraft",
    "model files",
    "ranking over all cases",
}
# kills itself at once when the given number of results is kept
KILLER = """
import os, signal, sys
from flightmech.support.kept_stages.store import StageStore
write, left = StageStore.write, [int(sys.argv.pop(1))]
def killing(self, stage, *rest):
    found = write(self, stage, *rest)
    print("\\nkept", stage, file=sys.stderr, flush=True)
    left[0] -= 1
    if not left[0]:
        os.kill(os.getpid(), signal.SIGKILL)
    return found
StageStore.write = killing
from aeromatch.cli import main
main()
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A project of one fit, two records and one case, the folder that its match wrote, and a store
    that holds its stages.
    """
    place = tmp_path_factory.mktemp("rebuild")
    project = place / "project"
    shutil.copytree(example_folder("c182"), project)
    for case in sorted((project / "cases").glob("*.toml")):
        if case.stem != "short_period":
            case.unlink()
    head = (project / "aeromatch.toml").read_text(encoding="utf-8").partition("[[fit]]")[0]
    (project / "aeromatch.toml").write_text(head + FIT, encoding="utf-8")
    match(place, "store")
    shutil.copytree(place / "out", place / "first")
    return place


def match(place, store, *options, killed_after=0):
    program = ["-c", KILLER, str(killed_after)] if killed_after else ["-m", "aeromatch"]
    command = [
        sys.executable,
        *program,
        "match",
        "project/aeromatch.toml",
        "-o",
        "out",
        "-j",
        "1",
        *options,
    ]
    environment = {**os.environ, PLACE: str(place / store), "PYTHONPATH": os.pathsep.join(sys.path)}
    found = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True)
    assert found.returncode in (0, -signal.SIGKILL), found.stderr
    return found


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def computed(text):
    """Return the number of results that were computed, by stage, from what ``--explain`` prints."""
    rows = [line.split(": ") for line in text.splitlines() if line.endswith(" reused")]
    return {stage: int(rest.split()[0]) for stage, rest in rows if not rest.startswith("0 ")}


@pytest.mark.nightly
def test_without_a_change_nothing_is_imported_that_computes(small):
    found = match(small, "store")
    assert "nothing changed since the last match" in found.stderr
    assert files(small / "out") == files(small / "first")
    script = (
        "import sys; sys.argv = ['aeromatch', *sys.argv[1:]]\nfrom aeromatch.cli import "
        "main\ntry:\n main()\nfinally:\n"
    )
    script += (
        " print('heavy', {'numpy', 'pandas', 'xarray', 'scipy', 'joblib', 'pydantic'} & "
        "set(sys.modules), file=sys.stderr)"
    )
    command = [
        sys.executable,
        "-c",
        script,
        "match",
        "project/aeromatch.toml",
        "-o",
        "out",
        "-j",
        "1",
    ]
    environment = {
        **os.environ,
        PLACE: str(small / "store"),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    assert (
        "heavy set()"
        in subprocess.run(
            command, cwd=small, env=environment, capture_output=True, text=True
        ).stderr
    )


@pytest.mark.nightly
def test_the_output_is_made_again_from_what_is_kept_with_the_same_bytes(small):
    shutil.rmtree(small / "out")
    found = match(small, "store", "--explain")
    assert computed(found.stderr) == {}
    assert files(small / "out") == files(small / "first")


@pytest.mark.nightly
def test_fresh_computes_everything_with_the_same_bytes(small):
    found = match(small, "store", "--fresh", "--explain")
    assert "solution cruise: --fresh" in found.stderr
    assert {
        "record",
        "solution",
        "path",
        "fit",
        "tables",
        "diagnosis",
        "replay",
        "report page",
    } <= computed(found.stderr).keys()
    assert files(small / "out") == files(small / "first")


@pytest.mark.nightly
def test_damaged_entries_are_computed_again_with_the_same_bytes(small):
    shutil.copytree(small / "store", small / "harmed")
    for number, file in enumerate(sorted((small / "harmed").rglob("output.pkl"))):
        content = file.read_bytes()
        file.write_bytes(
            content[: len(content) // 2]
            if number % 2
            else content[:-1] + bytes([content[-1] ^ 255])
        )
    shutil.rmtree(small / "out")
    found = match(small, "harmed", "--explain")
    assert "what was kept is damaged" in found.stderr
    assert files(small / "out") == files(small / "first")


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("old", "new", "more", "reason"),
    [
        ('title = "', 'title = "Another ', set(), "report page short_period: changed: result"),
        (
            "window = [4.0, 15.1]",
            # with [4.0, 15.0] all shares, in whole per cent, and so the corrected model stay the
            # same
            "window = [4.0, 12.0]",
            {"record look", "case check", "diagnosis", "joint correction", "replay"} | CORRECTED,
            "replay short_period: changed: case",
        ),
    ],
)
def test_a_change_of_a_case_computes_no_more_than_the_case(small, old, new, more, reason):
    """A text of its page is simulated, judged and diagnosed by nothing."""
    case = small / "project" / "cases" / "short_period.toml"
    text = case.read_text(encoding="utf-8")
    assert old in text
    case.write_text(text.replace(old, new), encoding="utf-8")
    try:
        found = match(small, "store", "--explain")
        of_the_case = {"report page", "report pdf", "chapters"} | more
        assert more <= computed(found.stderr).keys() <= of_the_case
        assert any(line.startswith(reason) for line in found.stderr.splitlines())
        changed = files(small / "out")
        match(small, "empty")
        assert files(small / "out") == changed
    finally:
        case.write_text(text, encoding="utf-8")


@pytest.mark.nightly
def test_a_new_title_of_the_project_computes_its_pdf_only(small):
    file = small / "project" / "aeromatch.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('title = "C182"', 'title = "Another title"'), encoding="utf-8")
    try:
        found = match(small, "store", "--explain")
        assert computed(found.stderr) == {"report pdf": 1}
        report = (small / "out" / "report" / "report.html").read_text(encoding="utf-8")
        assert 'data-report="Another title: Proof of Match"' in report
        changed = files(small / "out")
        match(small, "store", "--fresh")
        assert files(small / "out") == changed
    finally:
        file.write_text(text, encoding="utf-8")


@pytest.mark.nightly
def test_a_match_that_is_killed_goes_on_with_the_same_bytes(small):
    stages = [
        line
        for line in match(small, "counted", killed_after=1000).stderr.splitlines()
        if line.startswith("kept ")
    ]
    assert len(stages) > 15
    done = []
    for after in (3, 6, 9):  # results of each attempt, on top of those before
        found = match(small, "killed", killed_after=after)
        assert found.returncode == -signal.SIGKILL
        done += [line for line in found.stderr.splitlines() if line.startswith("kept ")]
    last = match(small, "killed", "--explain")
    done += [
        f"kept {stage}" for stage, count in computed(last.stderr).items() for _ in range(count)
    ]
    aids = {f"kept {aid}" for aid in ("judgements", STATES, SWAPS, FLIGHTS)}  # they save work
    assert sorted(one for one in done if one not in aids) == sorted(
        one for one in stages if one not in aids
    )
    assert files(small / "out") == files(small / "first")


@pytest.mark.nightly
def test_two_matches_at_once_do_not_disturb_each_other(small):
    environment = {
        **os.environ,
        PLACE: str(small / "shared"),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    running = []
    for name in ("out", "out2"):
        words = ["-m", "aeromatch", "match", "project/aeromatch.toml", "-o", name, "-j", "1"]
        running.append(
            subprocess.Popen(
                [sys.executable, *words], cwd=small, env=environment, stdout=subprocess.DEVNULL
            )
        )
    assert [process.wait() for process in running] == [0, 0]
    assert files(small / "out") == files(small / "first")
    other = files(small / "out2")
    assert {name: content for name, content in other.items() if "report" not in name} == {
        name: content for name, content in files(small / "first").items() if "report" not in name
    }
    ours, theirs = (
        json.loads((small / name / "report" / "results.json").read_text())["results"]
        for name in ("out", "out2")
    )
    assert ours == theirs
    assert Path(small / "shared").is_dir()
