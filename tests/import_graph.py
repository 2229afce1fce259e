"""Imports of the modules of the packages, for the tests of their order and the page of folders."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parents[1]
CHAIN = ["flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch"]


def module_name(file: Path, root: Path = ROOT) -> str:
    parts = file.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules(root: Path = ROOT) -> dict[str, Path]:
    return {
        module_name(file, root): file
        for package in CHAIN
        for file in sorted((root / package).rglob("*.py"))
    }


def imported(file: Path, known: dict[str, Path], root: Path = ROOT) -> set[str]:
    """Return the modules that a file imports, wherever the import stands; names that leave their
    package by dots begin with one.
    """
    own = module_name(file, root)
    package = own.split(".") if file.name == "__init__.py" else own.split(".")[:-1]
    found = set()
    # the public names of a package, which its __init__.py loads when they are used
    stub = file.with_suffix(".pyi")
    for node in [*import_statements(file), *import_statements(stub)]:
        if isinstance(node, ast.Import):
            found |= {nearest(alias.name, known) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level > len(package):
                found.add("." * node.level)
                continue
            base = ".".join(
                [
                    *(package[: len(package) - node.level + 1] if node.level else []),
                    *filter(None, [node.module]),
                ]
            )
            found |= {nearest(f"{base}.{alias.name}", known) for alias in node.names}
    return found - {"", own}


# fields of a statement that hold statements, or handlers and cases with statements
BLOCKS = ("body", "orelse", "handlers", "finalbody", "cases")


@functools.cache  # the tests and the page of folders read the same files
def import_statements(file: Path) -> list[ast.Import | ast.ImportFrom]:
    """Return all import statements of a file, empty when there is no such file."""
    if not file.is_file():
        return []
    found, statements = [], list(ast.parse(file.read_text(encoding="utf-8")).body)
    # only statements hold imports: expressions, most of a tree, are not visited
    while statements:
        node = statements.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.append(node)
        for block in BLOCKS:
            statements += getattr(node, block, [])
    return found


def nearest(name: str, known: dict[str, Path]) -> str:
    """Return the module that a dotted name is, or that holds it; empty for what is not ours."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name
