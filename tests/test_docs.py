"""Every example command of the documentation runs, as printed, from a fresh folder; every name that
an example of Python uses exists.

What a page may rely on is stated in its first paragraph set in italics, which begins with
"Commands": *a checkout* puts ``data``, ``docs``, ``examples`` and ``tests`` of the repository into
the folder, *./run demo* the output of the demo as ``out/t37``, ``../shared`` the material next to a
checkout, ``log.ulg`` a log of an autopilot, written here.

Blocks of language ``console`` hold commands after ``$`` and what they print, ``sh`` commands only.
Output must come in the order printed; a line ``...`` stands for any number of lines, and ``...`` at
the end of a line for its rest. A block with ``title="name"`` is written as that file first. A
comment ``exit code 1`` behind a command states how it ends. ``<!-- slow -->`` before a block leaves
it, and what follows on the page, to the slow tests.
"""

from __future__ import annotations

import ast
import importlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
import tomllib
import warnings
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
from docs_results import CHECKS
from sampling import sampled

from aeromatch.cli.command import cli, main
from flightmech.errors import AeromatchWarning

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "flighttest"))  # for recorders
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LANGUAGES = {"console", "sh", "text", "python", "toml", "csv", "matlab", "json", "xml"}
# commands that are not run here: a part of the command, and why
NOT_RUN = {
    "./run demo": "makes an environment over the network; tests/aeromatch/test_demo.py runs the "
    "demo itself",
    "./run test": "this suite",
    ".ci/run": "runs this suite",
    ".ci/nightly": "runs the rest of this suite",
    "-m pytest": "tests of this suite",
    "pip install": "downloads from a package index",
    "benchmarks/": "minutes of measurement; no step of any work",
    "./run docs": "makes an environment over the network; tests/test_site.py builds the site",
    "aeromatch view": "serves until it is interrupted; tests/aeromatch/workbench opens it",
    "--actions": "needs the log of a session of the workbench; "
    "tests/aeromatch/workbench/test_server.py replays one",
    "aeromatch flight stall": "needs recorded stalls, no part of the repository; "
    "tests/flighttest/stall runs the verb on simulated ones",
    "db import-aircraft": "files of other programs, no part of the repository; "
    "tests/aerodb/cli/test_import_aircraft.py runs it",
    "aeromatch store": "shows and clears the cache of the user; "
    "tests/aeromatch/rebuilding/test_store_verb.py calls it",
    "ruff": "style and types: run by .ci/run",
}
# pages of ten seconds and more, whose verbs have tests of their own in the suite: for .ci/nightly
NIGHTLY_PAGES = (
    "add-a-submodel.md",
    "certify-a-report.md",
    "data-package.md",
    "fits-into-tables.md",
    "flapping-vehicle.md",
    "compare-databases.md",
    "real-flights.md",
    "tuning.md",
    "batch-on-a-cluster.md",
    "diagnosis.md",
    "edit-a-database.md",
    "reconstruct-a-flight.md",  # the tutorial runs the verbs of this page and of the next
    "fit-a-manoeuvre.md",
    "plan-a-programme.md",
    "control-law.md",
    "own-fmu.md",
    "stalls.md",
    "identify-an-actuator.md",
    "another-estimator.md",
    "design-a-test-input.md",
    "uav-log.md",
    "ice.md",
    "wind-tunnel.md",
    "export-a-database.md",
    "light-aircraft.md",  # the project of this tutorial is made from nothing by test_init
    "own-aircraft.md",
    "propeller-aircraft.md",
    "project-files.md",
)
FENCE = re.compile(
    r"^(?P<slow><!-- slow -->\n+)?(?P<indent> *)```(?P<language>\S*)(?: "
    r"title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^(?P=indent)```$",
    re.M | re.S,
)
NEEDS = re.compile(r"^\*(Commands [^*]+)\*$", re.M)
NUMBER = re.compile(r"(?P<number>[+-]?\d+(?:\.(?P<digits>\d+))?)(?P<tail>[^\d]*)")
# identified models, and all that they fly, move in the third digit from one processor and one BLAS
# to another
PRECISION = 0.02
EXPANDED = set("*?|<>&;$`")  # a line with one of these goes to a shell


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    language: str
    title: str | None
    text: str
    slow: bool  # it, or a block before it, is marked slow

    def commands(self) -> list[tuple[str, list[str]]]:
        """Return every command with the lines that it prints; a backslash at the end of a line
        joins the next.
        """
        text = self.text.replace("\\\n", " ")
        if self.language == "sh":
            return [
                (line, [])
                for line in text.splitlines()
                if line.strip() and not line.startswith("#")
            ]
        found: list[tuple[str, list[str]]] = []
        for line in text.splitlines():
            if line.startswith("$ "):
                found.append((line[2:], []))
            else:
                found[-1][1].append(line)
        return found


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page."""
    found: list[Block] = []
    for match in FENCE.finditer(page.read_text(encoding="utf-8")):
        slow = bool(match["slow"]) or (bool(found) and found[-1].slow)
        found.append(Block(match["language"], match["title"], textwrap.dedent(match["text"]), slow))
    return found


def needs(page: Path) -> str:
    """Return what the page states that its commands need."""
    stated = NEEDS.search(page.read_text(encoding="utf-8"))
    return stated[1] if stated else ""


def reason_not_run(command: str) -> str | None:
    """Return why a command is not run here."""
    return next((reason for part, reason in NOT_RUN.items() if part in command), None)


def name(page: Path) -> str:
    """Return the name of a page for the report."""
    return page.relative_to(ROOT).as_posix()


def has_commands(page: Path, slow: bool) -> bool:
    """Return whether the page has blocks of commands for the fast, or for the slow tests."""
    runs = [
        block
        for block in blocks(page)
        if block.language in ("console", "sh")
        and any(not reason_not_run(c) for c, _ in block.commands())
    ]
    late = "./run demo" in needs(page)
    return any((block.slow or late) == slow for block in runs)


class Reader:
    """Somebody who types the commands of a page in a fresh folder."""

    def __init__(self, folder: Path, monkeypatch, capfd) -> None:
        self.folder, self.monkeypatch, self.capfd = folder, monkeypatch, capfd
        folder.mkdir()
        monkeypatch.chdir(folder)
        tools = folder.parent / "bin"
        tools.mkdir()
        (tools / "aeromatch").write_text(
            f"#!{sys.executable}\nfrom aeromatch.cli import main\nmain()\n"
        )
        (tools / "aeromatch").chmod(0o755)
        monkeypatch.setenv(
            "PATH",
            f"{tools}{os.pathsep}{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        )
        monkeypatch.setenv("PYTHONPATH", str(ROOT))

    def call(self, command: str) -> tuple[int, str]:
        """Run one line; return its exit code and all that it printed."""
        if not command.startswith("aeromatch ") or EXPANDED & set(command):
            done = subprocess.run(
                command,
                shell=True,
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=3000,
            )
            return done.returncode, done.stdout
        self.monkeypatch.setattr(sys, "argv", shlex.split(command, comments=True))
        with warnings.catch_warnings():
            warnings.simplefilter("default", AeromatchWarning)
            with pytest.raises(SystemExit) as ended:
                main()
        printed = self.capfd.readouterr()
        return int(ended.value.code or 0), printed.out + printed.err

    def follow(self, page: Path, slow: bool) -> None:
        """Run the commands of a page, write its files, compare what is printed."""
        for number, block in enumerate(blocks(page)):
            if block.slow and not slow:
                break
            if block.title:
                Path(block.title).parent.mkdir(parents=True, exist_ok=True)
                Path(block.title).write_text(block.text, encoding="utf-8")
            elif block.language in ("console", "sh"):
                outputs = [
                    self.run(f"{name(page)}: {command}", command, printed)
                    for command, printed in block.commands()
                    if not reason_not_run(command)
                ]
                check = CHECKS.get((name(page), number))
                if check is not None:
                    check(self.folder, "\n".join(outputs))

    def run(self, place: str, command: str, printed: list[str]) -> str:
        """Run one command, compare what it prints with what the page has, and return it."""
        code, output = self.call(command)
        assert code == exit_code(command, printed), f"{place}: exit code {code}\n{output}"
        missing = unlike(printed, output.splitlines())
        assert missing is None, (
            f"{place}: does not print, where the page has it: {missing!r}\n{output}"
        )
        return output


def exit_code(command: str, printed: list[str]) -> int:
    """Return the exit code that a page states in a comment, or that belongs to what it shows: 2 for
    bad input, 1 for a check that fails.
    """
    stated = re.search(r"# exit code (\d)", command)
    if stated:
        return int(stated[1])
    if any(line.startswith("error:") for line in printed):
        return 2
    return int(any("FAIL" in line or ": error:" in line for line in printed))


def unlike(printed: list[str], output: list[str]) -> str | None:
    """Return the first line of a page that the output does not have in its place, or None."""
    at, anywhere = 0, False
    for line in printed:
        if line.strip() == "...":
            anywhere = True
            continue
        places = (
            range(at, len(output)) if anywhere or not at else range(at, min(at + 1, len(output)))
        )
        hit = next((i for i in places if same(line, output[i])), None)
        if hit is None:
            return line
        at, anywhere = hit + 1, False
    return None


def same(line: str, printed: str) -> bool:
    """Return whether a line of a page stands for a printed one: spaces do not count, and numbers
    only to `PRECISION`.
    """
    a, b = line.split(), printed.split()
    if a[-1:] == ["..."]:
        a, b = a[:-1], b[: len(a) - 1]
    return len(a) == len(b) and all(map(same_word, a, b))


def same_word(a: str, b: str) -> bool:
    """Return whether two words agree, or two numbers with their digits after the point."""
    if a == b:
        return True
    x, y = (NUMBER.fullmatch(word) for word in (a, b))
    if x is None or y is None or x["tail"] != y["tail"]:
        return False
    return abs(float(x["number"]) - float(y["number"])) <= max(
        PRECISION * abs(float(x["number"])), 2.0 * 10.0 ** -len(x["digits"] or "")
    )


@pytest.fixture
def reader(tmp_path, monkeypatch, capfd, shared_folder):
    monkeypatch.setenv("AEROMATCH_STORE", str(shared_folder / "store"))
    return Reader(tmp_path / "fresh", monkeypatch, capfd)


def provide(page: Path, folder: Path) -> None:
    """Put what the page states that it needs into the folder."""
    stated = needs(page)
    if "../shared" in stated:
        if not (ROOT.parent / "shared").is_dir():
            pytest.skip("needs ../shared, material that is not part of the repository")
        (folder.parent / "shared").symlink_to(ROOT.parent / "shared")
    if "checkout" in stated:
        for part in ("data", "examples", "tests", "docs"):
            (folder / part).symlink_to(ROOT / part)
    if "`log.ulg`" in stated:
        from recorders import px4_flight

        px4_flight.write(folder / "log.ulg")


INEXPENSIVE = [
    pytest.param(page, marks=[pytest.mark.nightly] if page.name in NIGHTLY_PAGES else [])
    for page in PAGES
    if has_commands(page, slow=False)
]


@pytest.mark.slow
@pytest.mark.parametrize("page", INEXPENSIVE, ids=name)
def test_inexpensive_commands_run(page, reader):
    provide(page, reader.folder)
    reader.follow(page, slow=False)


def verbs_of(page: Path) -> set[str]:
    """Return the verbs and the programs that the commands of a page use; a page for newcomers has
    its own name among them.
    """
    commands = [
        command
        for block in blocks(page)
        if block.language in ("console", "sh")
        for command, _ in block.commands()
    ]
    verbs = set()
    for words in (command.split() for command in commands if not reason_not_run(command)):
        verb = (
            [word for word in words[1:3] if re.fullmatch(r"[a-z-]+", word)]
            if words[0] == "aeromatch"
            else words[1:2]
        )
        verbs.add(" ".join([words[0], *verb]))
    if page.name in NIGHTLY_PAGES:
        return set()
    for_newcomers = page.parent.name in ("how-to", "tutorials") or name(page) in (
        "README.md",
        "docs/index.md",
    )
    return verbs | ({name(page)} if for_newcomers else set())


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    sampled([page for page in PAGES if has_commands(page, slow=True)], verbs_of, order=1),
    ids=name,
)
def test_all_commands_run(page, reader, request):
    provide(page, reader.folder)
    if "./run demo" in needs(page):
        nightly = request.node.get_closest_marker("nightly")
        written, run = request.getfixturevalue("whole_demo" if nightly else "demo")
        assert run.returncode == 0, run.stderr
        shutil.copytree(written, reader.folder / "out" / "t37")
    reader.follow(page, slow=True)


def test_blocks_are_marked_and_every_exception_is_used():
    everything = ""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"^ *```", text, re.M)) == 2 * len(blocks(page)), (
            f"{name(page)}: a fence that is not read: language, title"
        )
        for block in blocks(page):
            assert block.language in LANGUAGES, (
                f"{name(page)}: language {block.language!r}; allowed are {sorted(LANGUAGES)}"
            )
            if block.language in ("console", "sh"):
                everything += block.text
            else:
                stray = re.search(r"^(\$ .*|aeromatch .*)", block.text, re.M)
                assert block.language != "text" or not stray, (
                    f"{name(page)}: {stray[1]!r} in a block of text is not run; write console or sh"
                )
    assert [part for part in NOT_RUN if part not in everything] == []


def test_the_citation_names_the_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"\nversion: {project['version']}\n" in (ROOT / "CITATION.cff").read_text(
        encoding="utf-8"
    )


def spans(page: Path) -> list[str]:
    """Return the commands that a page names in running text."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return [" ".join(span.split()) for span in re.findall(r"`(aeromatch [a-z][^`]*)`", text)]


@pytest.mark.parametrize("page", [page for page in PAGES if spans(page)], ids=name)
def test_commands_in_running_text_exist(page):
    for span in spans(page):
        if span.startswith("aeromatch.") or "..." in span.split()[:3]:
            continue
        words = shlex.split(span.replace("[", "").replace("]", ""))[1:]
        command: click.Command = cli
        with click.Context(cli) as context:
            while (
                isinstance(command, click.Group) and words and re.fullmatch(r"[a-z|-]+", words[0])
            ):
                names = words.pop(0).split("|")
                members = {each: command.get_command(context, each) for each in names}
                assert None not in members.values(), f"{name(page)}: {span}: no command {names}"
                command = members[names[-1]]
        known = {
            text for option in command.params for text in (*option.opts, *option.secondary_opts)
        } | {"--help", "--json"}
        if not isinstance(command, click.Group):
            unknown = [word for word in words if re.match(r"--?[a-z]", word) and word not in known]
            assert unknown == [], f"{name(page)}: {span}: no option {unknown}"


PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")


@pytest.mark.parametrize(
    "page", [page for page in PAGES if any(b.language == "python" for b in blocks(page))], ids=name
)
def test_names_in_python_examples_exist(page):
    for block in blocks(page):
        if block.language == "python":
            for node in ast.walk(ast.parse(block.text)):
                check_import(node, name(page))
                if isinstance(node, ast.Call):
                    check_keywords(node, name(page))
                if isinstance(node, ast.Attribute):
                    resolved(node, name(page))


def test_readme_and_start_page_have_the_same_lines_of_python():
    """The page is read in the repository as well, where nothing inserts the lines."""
    ours = [block.text for block in blocks(ROOT / "README.md") if block.language == "python"]
    page = [
        block.text for block in blocks(ROOT / "docs" / "index.md") if block.language == "python"
    ]
    assert ours
    assert page == ours


def check_import(node: ast.AST, place: str) -> None:
    """Import what an example imports from the packages."""
    if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
        for alias in node.names:
            assert hasattr(importlib.import_module(node.module or ""), alias.name), (
                f"{place}: {node.module} has no {alias.name}"
            )


def resolved(node: ast.expr, place: str) -> object | None:
    """Return what a dotted name of one of the packages means; None for other expressions."""
    if isinstance(node, ast.Name):
        return importlib.import_module(node.id) if node.id in PACKAGES else None
    if not isinstance(node, ast.Attribute):
        return None
    owner = resolved(node.value, place)
    if owner is None or not hasattr(owner, "__name__"):
        return None
    if not hasattr(owner, node.attr):
        importlib.import_module(
            f"{owner.__name__}.{node.attr}"
        )  # ModuleNotFoundError names what is missing
    return getattr(owner, node.attr)


def check_keywords(node: ast.Call, place: str) -> None:
    """Assert that a call of the packages takes the keywords that an example gives."""
    import inspect

    called = resolved(node.func, place)
    if callable(called):
        parameters = inspect.signature(called).parameters
        if not any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
            unknown = [
                word.arg for word in node.keywords if word.arg and word.arg not in parameters
            ]
            assert unknown == [], f"{place}: {ast.unparse(node.func)} takes no {unknown}"
