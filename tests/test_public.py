"""Every package has one page of public names, loaded when they are used."""

import importlib
from pathlib import Path

import pytest

from flightmech.support.lazy import public_names

ROOT = Path(__file__).parents[1]
PACKAGES = ["flightmech", "datcom_io", "aerodb", "flighttest", "pom"]


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there(name):
    package = importlib.import_module(name)
    assert dir(package) == package.__all__ or set(package.__all__) <= set(dir(package))
    assert package.__all__ == sorted(public_names(ROOT / name / "__init__.pyi"))
    for public in package.__all__:
        assert getattr(package, public) is not None


@pytest.mark.parametrize("name", PACKAGES)
def test_no_module_carries_the_name_of_a_public_function(name):
    """Importing such a module would hide the function behind it."""
    home = public_names(ROOT / name / "__init__.pyi")
    modules = {file.stem for file in (ROOT / name).glob("*.py")}
    assert {public for public in home if public in modules and home[public] != (public, True)} == set()


@pytest.mark.parametrize("name", PACKAGES)
def test_an_unknown_name_lists_the_public_ones(name):
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nosuch'; public are"):
        _ = importlib.import_module(name).nosuch


@pytest.mark.parametrize("name", [*PACKAGES, "aeromatch"])
def test_type_checkers_use_the_annotations(name):
    assert (ROOT / name / "py.typed").is_file()
