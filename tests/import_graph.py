"""Imports of the modules of the packages, for the tests of their order and the page of folders."""

import ast
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
    stub = file.with_suffix(
        ".pyi"
    )  # the public names of a package, which its __init__.py loads when they are used
    texts = [part.read_text(encoding="utf-8") for part in (file, stub) if part.is_file()]
    for node in (node for text in texts for node in ast.walk(ast.parse(text))):
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


def nearest(name: str, known: dict[str, Path]) -> str:
    """Return the module that a dotted name is, or that holds it; empty for what is not ours."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name
