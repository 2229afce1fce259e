"""Licences of the dependencies in the documentation."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "design" / "dependencies.md"
# extras that users do not install
OURS = {"docs", "dev"}


def direct_requirements() -> list[str]:
    """Return the requirements of the package and of the extras of users."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = list(project["dependencies"])
    for extra, requirements in project["optional-dependencies"].items():
        if extra not in OURS:
            found += requirements
    return found


def all_packages(requirements: list[str]) -> set[str]:
    """Return the names of the packages that requirements bring, as far as they are installed."""
    names: set[str] = set()
    left = [Requirement(text) for text in requirements]
    while left:
        requirement = left.pop()
        name = canonicalize_name(requirement.name)
        if name in names:
            continue
        names.add(name)
        try:
            texts = requires(name) or []
        except PackageNotFoundError:
            continue
        for one in map(Requirement, texts):
            extras = requirement.extras or {""}
            if one.marker is None or any(one.marker.evaluate({"extra": e}) for e in extras):
                left.append(one)
    return names


@pytest.mark.slow
def test_the_page_has_the_licence_of_every_dependency():
    table = PAGE.read_text(encoding="utf-8").partition("## Licences")[2]
    listed = set(map(canonicalize_name, re.findall(r"[A-Za-z0-9][\w.-]*", table)))
    packages = all_packages(direct_requirements())
    assert {"numpy", "optvl", "cffi"} <= packages
    assert packages - listed == set()
