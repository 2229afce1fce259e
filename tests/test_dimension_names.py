"""Readers of netCDF files state how dimensions without names are read."""

import ast
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
READERS = {"open_dataset", "open_datatree", "open_groups", "load_dataset", "load_datatree"}


def test_every_reader_names_the_way():
    """Without it xarray prints advice to programmers about files of others."""
    calls, silent = 0, []
    for file in chain.from_iterable((ROOT / name).rglob("*.py") for name in PACKAGES):
        text = file.read_text(encoding="utf-8")
        if not any(f"xr.{name}(" in text for name in READERS):
            continue
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            if node.func.attr in READERS and ast.unparse(node.func.value) == "xr":
                calls += 1
                if "phony_dims" not in {keyword.arg for keyword in node.keywords}:
                    silent.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert calls >= 11
    assert silent == []
