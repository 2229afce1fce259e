"""The order of the code: packages in one strict chain, folders in a declared order inside each
package, no circle anywhere.

Every import counts: at the top of a module, inside a function, and for type checking only.
"""

import runpy
import subprocess
import sys
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from import_graph import CHAIN, imported, modules

ROOT = Path(__file__).parents[1]
# folders and loose modules of each package: one imports only from those before it
ORDER = {
    "flightmech": [
        "short_text",
        "errors",
        "units",
        "quantities",
        "names",
        "plugins",
        "axes",
        "air",
        "support",
        "flown_states",
        "flown_samples",
        "term_checks",
        "terms",
        "aircraft",
        "build_up",
        "envelope",
        "simulation",
        "steady_flight",
        "fmu_export",
        "flying_qualities",
        "cli",
    ],
    "datcom_io": [
        "cells",
        "decks",
        "drawings",
        "printout",
        "arrays",
        "listing",
        "reading",
        "exchange",
        "runs",
        "cli",
    ],
    "aerodb": [
        "store",
        "update",
        "prior",
        "estimators",
        "exchange",
        "edit",
        "comparison",
        "figures",
        "cli",
    ],
    "flighttest": [
        "remarks",
        "parameter_constraints",
        "records",
        "regression",
        "reconstruction",
        "in_flight",
        "special_tests",
        "maximum_likelihood",
        "submodels",
        "flight_programme",
        "cli",
    ],
    "pom": [
        "samples",
        "tolerances",
        "cases",
        "status",
        "result_signals",
        "result",
        "result_notices",
        "fmu",
        "judging",
        "probing",
        "replaying",
        "checking",
        "archive",
        "diagnosis",
        "programme",
        "report",
        "cli",
    ],
    "aeromatch": [
        "project",
        "rebuilding",
        "workflow",
        "planning",
        "drafting",
        "workbench",
        "delivery",
        "cli",
        "__main__",
    ],
}
MOST_MODULES = 13  # in one folder
# Folders at the edge, which only some users need, and what outside the command line may import
# them: a reader can leave them out and still follow the whole job.
WINGS = {
    "aerodb.estimators": ["aeromatch.project.priors"],
    "aerodb.exchange.daveml": ["aeromatch.delivery"],
    "aerodb.exchange.jsbsim": ["aeromatch.delivery"],
    "aerodb.exchange.tables.matlab": ["aeromatch.delivery"],
    "datcom_io.exchange": [],
    "datcom_io.runs": [],
    "flighttest.records.readers.formats.chapter10": ["flighttest.records.files"],
    "flighttest.special_tests": [],
    "flighttest.flight_programme.evaluation": [],
    "flighttest.flight_programme.input_design": ["flighttest.flight_programme.planning"],
    "flighttest.flight_programme.planning": ["pom.programme"],
    "pom.diagnosis.tuning": ["pom.report.models.tuning"],
    "aeromatch.drafting": ["aeromatch.workbench"],
    "aeromatch.planning": [],
    "aeromatch.workbench": [],
    "aeromatch.delivery": [],
}


def circle(edges: dict[str, set[str]]) -> list[str]:
    """Return one circle of a graph, empty when there is none."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return error.args[1]
    return []


@pytest.fixture(scope="module")
def graph():
    known = modules()
    return {name: imported(file, known) for name, file in known.items()}


@pytest.mark.slow
@pytest.mark.parametrize("package", CHAIN)
def test_package_imports_only_what_stands_to_its_left(graph, package):
    right = CHAIN[CHAIN.index(package) + 1 :]
    for name, others in graph.items():
        if name.split(".")[0] == package:
            wrong = {
                other for other in others if other.startswith(".") or other.split(".")[0] in right
            }
            assert not wrong, f"{name} imports {sorted(wrong)}"


@pytest.mark.parametrize("package", CHAIN)
def test_folders_import_only_those_before_them(graph, package):
    order = ORDER[package]
    places = {name.split(".")[1] for name in graph if name.startswith(f"{package}.")}
    assert places == set(order), (
        "declare new folders and loose modules in ORDER, delete those that went"
    )
    for name, others in graph.items():
        if name.startswith(f"{package}."):
            place = order.index(name.split(".")[1])
            wrong = {
                x
                for x in others
                if x == package
                or (x.startswith(f"{package}.") and order.index(x.split(".")[1]) > place)
            }
            assert not wrong, f"{name} imports {sorted(wrong)}"


def test_no_circle_of_modules(graph):
    assert not circle(graph)


def test_no_circle_of_folders(graph):
    """At every depth: a folder, or a module next to it, never needs what needs it."""
    for depth in range(2, max(name.count(".") for name in graph) + 2):
        edges = defaultdict(set)
        for name, others in graph.items():
            for other in others:
                a, b = (x.split(".")[:depth] for x in (name, other))
                if a != b and len(a) == len(b) == depth and a[:-1] == b[:-1]:
                    edges[".".join(a)].add(".".join(b))
        assert not circle(edges), f"depth {depth}"


@pytest.mark.parametrize("wing", WINGS)
def test_the_core_does_not_import_a_wing(graph, wing):
    """Only the command line, the namespaces above a wing, and the declared users import it."""
    assert any(is_inside(name, wing) for name in graph), f"{wing} went; delete it from WINGS"
    users = []
    for name, others in graph.items():
        if is_inside(name, wing) or not any(is_inside(other, wing) for other in others):
            continue
        is_namespace = is_inside(wing, name)
        is_command_line = name.split(".")[1:2] == ["cli"]
        if not is_namespace and not is_command_line:
            users.append(name)
    allowed = WINGS[wing]
    extra = [name for name in users if not any(is_inside(name, place) for place in allowed)]
    unused = [place for place in allowed if not any(is_inside(name, place) for name in users)]
    assert not extra, f"{extra} import {wing}; move what they need into the core"
    assert not unused, f"{unused} no longer import {wing}; delete them from WINGS"


def is_inside(name: str, folder: str) -> bool:
    """Return whether a module is a folder, or stands in it."""
    return name == folder or name.startswith(f"{folder}.")


def test_folders_are_small():
    for folder in {file.parent for file in modules().values()}:
        count = sum(file.name != "__init__.py" for file in folder.glob("*.py"))
        assert count <= MOST_MODULES, (
            f"{folder.relative_to(ROOT)} holds {count} modules; make a folder for one of its "
            f"subjects"
        )
        assert (folder / "__init__.py").is_file(), f"{folder.relative_to(ROOT)} has no __init__.py"


@pytest.mark.slow
def test_the_page_of_folders_has_a_row_for_each():
    page = runpy.run_path(str(ROOT / "docs" / "scripts" / "make_folders.py"))["page"]()
    sections = page.split("\n## ")[1:]
    assert [section.split("\n")[0] for section in sections] == CHAIN
    for section, places in zip(sections, ORDER.values(), strict=True):
        rows = [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")]
        assert [row.removesuffix("/").removesuffix(".py") for row in rows] == places


def test_every_kind_of_import_is_seen(tmp_path):
    for name in (
        "pom/__init__.py",
        "pom/case.py",
        "pom/rows.py",
        "aeromatch/__init__.py",
        "aeromatch/cli.py",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("", encoding="utf-8")
    file = tmp_path / "pom" / "wrong.py"
    file.write_text(
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from . import rows\n"
        "def f():\n    from .case import read_case\n    import aeromatch.cli\n    from "
        "...kernel import x\n    return read_case\n"
    )
    known = modules(tmp_path)
    assert imported(file, known, tmp_path) == {"pom.rows", "pom.case", "aeromatch.cli", "..."}
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}


@pytest.mark.slow
def test_the_whole_job_is_imported_without_an_extra():
    """`./run demo` installs none: what draws, serves or typesets is imported where it is used."""
    extras = ("matplotlib", "starlette", "uvicorn", "typst", "distributed", "asammdf", "pin")
    code = f"import sys; sys.modules.update(dict.fromkeys({extras}))\n"
    code += "import aeromatch.planning.match_plan, aeromatch.workflow.steps, aeromatch.cli.verbs"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_kernel_knows_no_python():
    for file in [*(ROOT / "kernel").rglob("*.c"), *(ROOT / "kernel").rglob("*.h")]:
        assert "Python.h" not in file.read_text(encoding="utf-8"), file.name
