"""Tests of values that the models of files refuse."""

import time

import pytest

from flightmech.errors import SchemaError
from flightmech.support.toml_models import Strict, validate_content


class Inner(Strict):
    """A table in a file."""

    share: float = 0.0


class Outer(Strict):
    """A file with a value of each kind."""

    CD0: float | None = None
    count: int = 0
    pair: tuple[float, float] = (0.0, 0.0)
    start: float | str = ""
    fixed: dict[str, float | str] = {}
    uses_power: bool = False
    flags: dict[str, bool] = {}
    inner: tuple[Inner, ...] = ()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("CD0", True),
        ("count", False),
        ("pair", [0.1, True]),
        ("start", True),
        ("fixed", {"h": 1.0, "V": True}),
    ],
)
def test_true_and_false_are_no_numbers(key, value):
    with pytest.raises(SchemaError, match=f"{key}: found .*; expected numbers or texts"):
        validate_content(Outer, {key: value}, "file")


def test_a_truth_value_in_an_inner_table_is_found_there():
    with pytest.raises(SchemaError, match=r"inner.1.share: found True; expected numbers"):
        validate_content(Outer, {"inner": [{"share": 1}, {"share": True}]}, "file")


def test_truth_values_and_numbers_at_their_places():
    content = {"CD0": 1, "uses_power": True, "flags": {"a": False}, "fixed": {"V": "90 kt"}}
    assert validate_content(Outer, content, "file").model_dump(exclude_unset=True) == content


def test_a_crowd_of_unknown_keys_takes_no_time():
    begin = time.process_time()
    with pytest.raises(SchemaError) as caught:
        validate_content(Outer, {f"k{number}": 1 for number in range(20_000)}, "file")
    assert time.process_time() - begin < 1.0
    assert len(caught.value.problems) == 20_000
    assert caught.value.problems[0].startswith("k0: unknown key; ")
    assert caught.value.problems[-1] == "k19999"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"inner": ["run_1"]}, r"inner.0: expected a table \{ ... \} of share; found 'run_1'"),
        ({"inner": 3}, r"inner: expected a list, as \[a, b\]; found 3"),
        ({"pair": {"a": 1.0}}, r"pair: expected a list, as \[a, b\]; found \{'a': 1.0\}"),
    ],
)
def test_a_value_of_another_shape_is_answered_with_the_shape(content, text):
    with pytest.raises(SchemaError, match=text):
        validate_content(Outer, content, "file")
