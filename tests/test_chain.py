"""The strict chain of packages: each imports only what stands to its left."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CHAIN = ["flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch"]


def imported_packages(file: Path, depth: int = 1) -> set[str]:
    """Return the packages that a file names; `depth` counts the folders from the file up to its package's own."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom) and node.level > depth:
            names.add(f"{'.' * node.level} (leaves the package)")
    return names


@pytest.mark.parametrize("package", CHAIN)
def test_package_imports_only_what_stands_to_its_left(package):
    right = set(CHAIN[CHAIN.index(package) + 1 :])
    for file in sorted((ROOT / package).rglob("*.py")):
        found = imported_packages(file, len(file.relative_to(ROOT).parts) - 1)
        assert not found & right, f"{file.relative_to(ROOT)} imports {sorted(found & right)}"
        assert not any(name.startswith("..") for name in found), f"{file.relative_to(ROOT)} leaves its package by dots"


def test_the_walker_sees_an_import_to_the_right(tmp_path):
    file = tmp_path / "wrong.py"
    file.write_text("def f():\n    from pom.cases.case import read_case\n    import aeromatch.cli\n    return read_case\n")
    assert imported_packages(file) == {"pom", "aeromatch"}


def test_kernel_knows_no_python():
    for file in [*(ROOT / "kernel").rglob("*.c"), *(ROOT / "kernel").rglob("*.h")]:
        assert "Python.h" not in file.read_text(encoding="utf-8"), file.name
