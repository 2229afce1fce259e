"""Page ``folders.md``, the folders of every package and what they import. The site has the page
(`make_site`); ``python docs/scripts/make_folders.py`` prints it.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from import_graph import CHAIN, imported, modules  # noqa: E402


def declared_order() -> dict[str, list[str]]:
    """Return the order of folders that `tests/test_chain.py` declares.

    It is read and not imported, since the site is made without pytest.
    """
    source = (ROOT / "tests" / "test_chain.py").read_text(encoding="utf-8")
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ORDER":
            return ast.literal_eval(node.value)
    raise LookupError("tests/test_chain.py declares no ORDER")


ORDER = declared_order()
HEAD = """# Folders

Each package consists of a folder `cli` for its command line and folders by subject. A folder is a
namespace: the stub `__init__.pyi` lists its public names, and `__init__.py` loads them from that
list when they are first used (`flighttest.equation_error.regress`). The stub of the package lists
its namespaces and, once more, the names that a user needs first (`flighttest.regress`); every other
name is listed once.

Folders and loose modules have an order: each imports only from those above it in the tables below.
`tests/test_chain.py` enforces that, counts circles over all imports (deferred and type-only ones
too) and refuses a folder with more than thirteen modules. The page is made with the site.
"""
HISTORY = """
**Before and after.** Until 2026-11-28 flighttest had 29 folders and 1 loose module on its first
level, pom 12 and 3, and flightmech 10 and 8. Methods stood side by side: each sensor, each
estimator and each submodel had a folder, and three folders of flightmech held steady flight, trim
and linear model. Now the folders are the steps of the work. flighttest goes from records through
regression and reconstruction to submodels and the programme. pom goes from tolerances and cases
through FMU, judging and replaying to diagnosis and report. What only some users need stands at the
edge (`WINGS` in `tests/test_chain.py`), and the core imports none of it.

The lines were 140 columns wide and are 100 wide now; the product has grown by other work since. The
counts (2026-11-30) are those of files without tests: tokens per line of code, width below which 95
% of the lines are, comprehensions, conditional expressions and comments on a line of their own per
100 lines of code, comprehensions with two generators, files above 450 lines, names of classes and
of public functions that occur twice, public functions of one word, imports inside functions.

| package | files | lines | tokens | tokens/line | width | compr. | 2 gen. | cond. | comments | \
>450 | classes | functions | 1 word | deferred |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | \
---: |
| flightmech, before | 100 | 13509 | 98109 | 11.8 | 119 | 7.6 | 35 | 3.9 | 0.5 | 1 | 5 | 11 | 149 \
| 82 |
| flightmech, now | 138 | 27037 | 150093 | 8.8 | 90 | 2.9 | 1 | 1.0 | 4.5 | 0 | 0 | 3 | 47 | 17 |
| datcom_io, before | 89 | 11095 | 88196 | 11.4 | 117 | 8.5 | 68 | 4.4 | 0.2 | 0 | 0 | 6 | 73 | 44 |
| datcom_io, now | 100 | 20125 | 116544 | 8.3 | 88 | 3.3 | 0 | 0.4 | 4.1 | 0 | 0 | 0 | 6 | 14 |
| aerodb, before | 126 | 19559 | 158328 | 12.7 | 121 | 10.0 | 108 | 4.6 | 0.4 | 1 | 1 | 34 | 214 | \
141 |
| aerodb, now | 182 | 40330 | 242040 | 8.9 | 90 | 3.5 | 0 | 0.9 | 3.8 | 0 | 0 | 2 | 28 | 14 |
| flighttest, before | 308 | 42975 | 334117 | 13.1 | 121 | 9.5 | 136 | 3.7 | 0.1 | 3 | 15 | 31 | \
294 | 297 |
| flighttest, now | 426 | 89562 | 531369 | 9.4 | 90 | 3.7 | 3 | 0.9 | 4.1 | 0 | 0 | 5 | 48 | 15 |
| pom, before | 173 | 21120 | 163107 | 11.9 | 119 | 9.6 | 65 | 4.8 | 0.3 | 0 | 2 | 26 | 199 | 117 |
| pom, now | 211 | 42389 | 244886 | 8.7 | 89 | 3.5 | 0 | 1.0 | 3.8 | 0 | 0 | 1 | 12 | 5 |
| aeromatch, before | 41 | 7692 | 60654 | 11.5 | 122 | 10.1 | 42 | 4.2 | 0.2 | 2 | 0 | 2 | 58 | 67 |
| aeromatch, now | 120 | 23212 | 136299 | 8.5 | 90 | 3.4 | 0 | 1.3 | 3.4 | 0 | 0 | 1 | 9 | 18 |
| total, before | 837 | 115950 | 902511 | 12.4 | 120 | 9.3 | 454 | 4.2 | 0.3 | 7 | 85 | 220 | 987 \
| 748 |
| total, now | 1177 | 242655 | 1421231 | 9.0 | 90 | 3.5 | 4 | 0.9 | 4.0 | 0 | 0 | 26 | 150 | 83 |

`python benchmarks/same_results.py` compares two runs file by file. The match of the C182 before
the files were moved and after it has the same bytes in all 21 files: databases, FMUs,
`results.json`, page, PDF. After the names, the density and the work on the kernel that followed,
the databases and 10 other files have the same bytes. `results.json`, `results.nc` and the
descriptions in the three FMUs have the same numbers. The libraries in the FMUs differ, and page,
PDF and manifest carry their digests; their numbers are not compared.
"""


def page() -> str:
    """Return the page."""
    known = modules()
    graph = {name: imported(file, known) for name, file in known.items()}
    return HEAD + HISTORY + "".join(_table(package, known, graph) for package in CHAIN)


def _table(package: str, known: dict[str, Path], graph: dict[str, set[str]]) -> str:
    """Return the table of one package, in the order that its folders and loose modules have."""
    rows = []
    for place in ORDER[package]:
        whole = f"{package}.{place}"
        inside = [name for name in graph if name == whole or name.startswith(f"{whole}.")]
        count = sum(known[name].name != "__init__.py" for name in inside)
        others = set().union(*(graph[name] for name in inside))
        used = {name.split(".")[1] for name in others if name.startswith(f"{package}.")}
        before = ", ".join(other for other in ORDER[package] if other in used - {place})
        ending = "/" if known[whole].name == "__init__.py" else ".py"
        rows.append(f"| `{place}{ending}` | {count} | {_holds(known[whole])} | {before} |\n")
    return (
        f"\n## {package}\n\n| folder | modules | holds | imports from |\n| --- | ---: | --- "
        f"| --- |\n" + "".join(rows)
    )


def _holds(file: Path) -> str:
    """Return what a module or a folder states of itself, and the names of the folders inside."""
    text = (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").partition("\n\n")[
        0
    ]
    inner = (
        sorted(path.parent.name for path in file.parent.glob("*/__init__.py"))
        if file.name == "__init__.py"
        else []
    )
    return " ".join(text.split()).removesuffix(".") + (
        f"; folders {', '.join(inner)}" if inner else ""
    )


if __name__ == "__main__":
    print(page(), end="")
