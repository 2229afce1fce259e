"""Every package and every public folder of it has one page of public names, loaded when they are
used.
"""

import importlib
from collections import Counter
from pathlib import Path

import pytest

from flightmech.support.imports import public_names

ROOT = Path(__file__).parents[1]
PACKAGES = ["flightmech", "datcom_io", "aerodb", "flighttest", "pom"]
NOT_PUBLIC = {"cli", "support"}  # what verbs are made of
STUBS = {
    ".".join(stub.parent.relative_to(ROOT).parts): stub
    for name in PACKAGES
    for stub in sorted((ROOT / name).rglob("__init__.pyi"))
}
MOST_FLAT = (
    31  # names of a package itself: those of the README, and four former names; no namespaces
)


@pytest.mark.parametrize("name", STUBS)
def test_every_public_name_is_there(name):
    namespace = importlib.import_module(name)
    assert dir(namespace) == namespace.__all__ == sorted(public_names(STUBS[name]))
    for public in namespace.__all__:
        assert getattr(namespace, public) is not None


@pytest.mark.parametrize("name", STUBS)
def test_no_module_or_folder_carries_the_name_of_a_public_function(name):
    """Importing such a module would hide the function behind it."""
    folder = STUBS[name].parent
    modules = {file.stem for file in folder.iterdir() if file.suffix == ".py" or file.is_dir()}
    assert {
        public
        for public, home in public_names(STUBS[name]).items()
        if public in modules and home != (public, True)
    } == set()


@pytest.mark.parametrize("name", STUBS)
def test_an_unknown_name_lists_the_public_ones(name):
    with pytest.raises(
        AttributeError, match=f"module '{name}' has no attribute 'nosuch'; public are"
    ):
        _ = importlib.import_module(name).nosuch


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_is_a_namespace_of_its_package(package):
    folders = {file.parent.name for file in (ROOT / package).glob("*/__init__.py")}
    public = public_names(STUBS[package])
    namespaces = {home for home, is_module in public.values() if is_module}
    assert namespaces >= folders - NOT_PUBLIC
    assert sum(not is_module for _, is_module in public.values()) <= MOST_FLAT


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_means_one_thing_and_is_listed_at_most_twice(package):
    """In the namespace of its subject, and once more for the package as a whole."""
    listed = [
        (public, name)
        for name, stub in STUBS.items()
        if name.split(".")[0] == package
        for public in public_names(stub)
    ]
    assert max(Counter(public for public, _ in listed).values()) <= 2
    meanings = {}
    for public, name in listed:
        meanings.setdefault(public, set()).add(id(getattr(importlib.import_module(name), public)))
    assert {public for public, things in meanings.items() if len(things) > 1} == set()


@pytest.mark.parametrize("name", [*PACKAGES, "aeromatch"])
def test_type_checkers_use_the_annotations(name):
    assert (ROOT / name / "py.typed").is_file()
