"""The hash of what items hold: equal content, equal hash; any difference, another one."""

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightmech.support.kept_stages.content_hashes import FileContent, content_hash


@dataclass
class Pair:
    one: object
    other: object


class Plain:
    def __init__(self, value):
        self.value = value


LONG = np.arange(10_000.0)
CHANGED = np.where(LONG == 5000.0, 5000.0 + 1e-9, LONG)  # where a printed table is shortened


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        ("a", b"a"),
        ([1, 2], [2, 1]),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}),
        (LONG, CHANGED),
        (LONG, LONG.astype("f4")),
        (pd.DataFrame({"x": LONG}), pd.DataFrame({"x": CHANGED})),
        (pd.DataFrame({"x": [1.0]}), pd.DataFrame({"y": [1.0]})),
        (xr.Dataset({"x": ("t", LONG)}), xr.Dataset({"x": ("t", CHANGED)})),
        (xr.Dataset({"x": 1.0}), xr.Dataset({"x": 1.0}, attrs={"title": "b"})),
        (
            xr.DataTree.from_dict({"/a": xr.Dataset({"x": ("t", LONG)})}),
            xr.DataTree.from_dict({"/a": xr.Dataset({"x": ("t", CHANGED)})}),
        ),
        (
            xr.DataTree.from_dict({"/a": xr.Dataset({"x": 1.0})}),
            xr.DataTree.from_dict({"/b": xr.Dataset({"x": 1.0})}),
        ),
        (Pair(1, LONG), Pair(1, CHANGED)),
        ({1, 2}, {1, 3}),
        (Path("a"), Path("b")),
        (Plain(LONG), Plain(CHANGED)),
    ],
    ids=lambda item: type(item).__name__,
)
def test_every_difference_counts(one, other):
    assert content_hash(one) != content_hash(other)
    assert content_hash(one) == content_hash(one)


def test_a_view_of_a_mapping_counts_as_the_mapping():
    assert content_hash(MappingProxyType({"a": LONG})) == content_hash({"a": LONG})


def test_a_file_counts_by_name_and_bytes_whatever_its_folder_and_time(tmp_path):
    found = []
    for folder, name, text in (
        ("a", "x.nc", "1"),
        ("b", "x.nc", "1"),
        ("b", "y.nc", "1"),
        ("b", "x.nc", "2"),
    ):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / name).write_text(text)
        found.append(content_hash(FileContent.of(tmp_path / folder / name)))
    assert found[0] == found[1]
    assert len(set(found)) == 3
