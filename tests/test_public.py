"""Every package has one page of public names, loaded when they are used."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ["flightmech", "datcom_io", "aerodb", "flighttest", "pom"]


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there(name):
    package = importlib.import_module(name)
    assert dir(package) == package.__all__ or set(package.__all__) <= set(dir(package))
    assert sorted(package.__all__) == sorted(package._HOME)
    for public in package.__all__:
        assert getattr(package, public) is not None


@pytest.mark.parametrize("name", PACKAGES)
def test_no_module_carries_the_name_of_a_public_function(name):
    """Importing such a module would hide the function behind it."""
    home = importlib.import_module(name)._HOME
    modules = {file.stem for file in (ROOT / name).glob("*.py")}
    assert {public for public in home if public in modules and home[public] != public} == set()


@pytest.mark.parametrize("name", PACKAGES)
def test_an_unknown_name_says_what_there_is(name):
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nosuch'; public are"):
        _ = importlib.import_module(name).nosuch
