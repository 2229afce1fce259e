"""Plain tables hold what the model of pydantic of the same class holds, and leave to it whatever is
not plain.
"""

import copy
import pickle
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from flightmech.errors import SchemaError
from flightmech.support.plain_tables import Plain, define_field, read_plain_table
from flightmech.support.toml_models import model_of, part_schema
from flightmech.support.toml_quantities import Above, InUnits


class Example(Plain):
    """A table of every kind of value."""

    name: str | tuple[str, ...] = define_field(description="Name.")
    sign: Literal[1, -1] = define_field(default=1, description="Sign.")
    scale: float | str = define_field(default=1.0, description="Factor.")
    count: int = define_field(default=3, description="How many.")
    on: bool = define_field(default=False, description="Whether.")
    rows: tuple[tuple[float, float], ...] | None = define_field(
        default=None, examples=[[[1, 2]]], description="Rows."
    )
    stops: tuple[float | str, float | str] | None = define_field(default=None, description="Ends.")
    delay: Annotated[float, InUnits("s")] = define_field(default=0.0, description="Delay.")
    heat: Annotated[float, InUnits("K"), Above(100.0)] | None = define_field(
        default=None, description="Temperature."
    )

    def check(self) -> None:
        """Refuse a contradiction."""
        if self.on and self.count > 5:
            raise ValueError("count is above 5 where on is true")


ITEMS = st.one_of(
    *(
        st.none(),
        st.booleans(),
        st.integers(-7, 7),
        st.floats(allow_nan=False),
        st.text(max_size=3),
    ),
    st.sampled_from(["60 ms", "20 degC", "1 kg", "?", "3", "1.5", 10**30]),
    st.lists(st.floats(-9, 9), max_size=3),
    st.lists(st.lists(st.integers(0, 3), min_size=1, max_size=3), max_size=3),
    st.lists(st.sampled_from(["a", 1, 2.5, None]), max_size=2),
)
CONTENT = st.dictionaries(st.sampled_from([*Example.values, "nmae"]), ITEMS, max_size=4)


@given(CONTENT, st.sampled_from(["x", ["x", "y"], None]))
def test_a_table_holds_what_the_model_of_pydantic_holds(content, name):
    content = content if name is None else {**content, "name": name}
    try:
        expected = dict(model_of(Example).model_validate(content))
    except ValidationError:
        with pytest.raises(SchemaError):
            read_plain_table(Example, content, "example")
        return
    found = vars(read_plain_table(Example, content, "example"))
    assert found == expected
    assert {key: type(item) for key, item in found.items()} == {
        key: type(item) for key, item in expected.items()
    }


def test_errors_name_the_place_and_what_is_allowed():
    with pytest.raises(SchemaError) as raised:
        read_plain_table(Example, {"nmae": "x", "sign": 2, "heat": 50, "delay": "5 m"}, "example")
    assert [text.split(";")[0].split(":")[0] for text in raised.value.problems] == [
        "name",
        "sign",
        "delay",
        "heat",
        "nmae",
    ]
    assert "unknown key; near it: name" in raised.value.problems[-1]
    with pytest.raises(SchemaError, match="count is above 5 where on is true"):
        read_plain_table(Example, {"name": "x", "on": True, "count": 6}, "example")


def test_an_object_is_made_checked_compared_copied_and_never_changed():
    one = Example(name=["a", "b"], delay="60 ms")
    assert (one.name, one.delay, one.count) == (("a", "b"), 0.06, 3)
    assert one == Example(name=("a", "b"), delay=0.06)
    assert hash(one) == hash(one.changed())
    assert one.stated() == {"name": ("a", "b"), "delay": 0.06}
    assert one.changed(count=4).stated() == {**one.stated(), "count": 4}
    assert repr(one) == "Example(name=('a', 'b'), delay=0.06)"
    assert pickle.loads(pickle.dumps(one)) == copy.deepcopy(one) == one
    with pytest.raises(AttributeError, match="cannot be changed"):
        one.count = 5
    with pytest.raises(TypeError, match="given count; expected name, sign"):
        Example(count=5)
    with pytest.raises(TypeError, match="given name, cuont"):
        Example(name="x", cuont=5)
    with pytest.raises(ValueError, match="count"):
        Example(name="x", count="many")


def test_the_schema_is_that_of_the_model():
    schema = part_schema(Example)
    assert schema["required"] == ["name"]
    assert schema["properties"]["delay"] == {
        **{
            "default": 0.0,
            "description": "Delay. [s]",
            "not": {"const": "?"},
            "type": ["number", "string"],
            "x-unit": "s",
        },
    }
    assert schema["properties"]["rows"]["examples"] == [[[1, 2]]]
