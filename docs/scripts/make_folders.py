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


def page() -> str:
    """Return the page."""
    known = modules()
    graph = {name: imported(file, known) for name, file in known.items()}
    return HEAD + "".join(_table(package, known, graph) for package in CHAIN)


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
