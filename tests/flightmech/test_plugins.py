"""Tests of the entry points by which other packages add readers and exporters."""

import pytest

from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.plugins import DATABASE_EXPORTERS, find_plugins, load_plugin


def test_an_entry_point_is_found_and_loaded(add_distribution) -> None:
    add_distribution("alpha-formats", {DATABASE_EXPORTERS: {"alpha": "json:dumps"}})
    points = find_plugins(DATABASE_EXPORTERS)
    assert load_plugin(points["alpha"])([1]) == "[1]"


def test_a_format_of_the_product_is_not_replaced(add_distribution) -> None:
    add_distribution("alpha-formats", {DATABASE_EXPORTERS: {"csv": "json:dumps"}})
    with pytest.warns(AeromatchWarning, match="'csv' = 'json:dumps' of 'alpha-formats' is left"):
        assert "csv" not in find_plugins(DATABASE_EXPORTERS, own=["csv"])


def test_of_two_objects_with_one_name_the_second_is_named(add_distribution) -> None:
    add_distribution("alpha-formats", {DATABASE_EXPORTERS: {"alpha": "json:dumps"}})
    add_distribution("beta-formats", {DATABASE_EXPORTERS: {"alpha": "json:loads"}})
    with pytest.warns(AeromatchWarning, match="'json:dumps' has the same name"):
        assert find_plugins(DATABASE_EXPORTERS)["alpha"].value == "json:dumps"


@pytest.mark.parametrize(
    ("value", "error"),
    [("no_module_of_this_name:f", "ModuleNotFoundError"), ("json:no_such", "AttributeError")],
)
def test_a_broken_entry_point_names_its_distribution(add_distribution, value, error) -> None:
    add_distribution("alpha-formats", {DATABASE_EXPORTERS: {"alpha": value}})
    with pytest.raises(AeromatchError, match=rf"'alpha' of 'alpha-formats' .*{error}"):
        load_plugin(find_plugins(DATABASE_EXPORTERS)["alpha"])
