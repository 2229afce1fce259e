"""`flighttest.manoeuvres`: the marks of a record, or what its controls show."""

from pathlib import Path

import pytest
import xarray as xr

import flighttest
from flightmech.errors import SchemaError

C182 = Path(__file__).parents[3] / "data" / "c182"


@pytest.fixture(scope="module")
def unmarked():
    return flighttest.read(C182 / "flight" / "cruise.csv", C182 / "names.toml")


def test_an_unmarked_record_is_searched(unmarked):
    assert len(flighttest.records.marked_manoeuvres(unmarked)) == 0
    found = flighttest.manoeuvres(unmarked)
    assert found.attrs["origin"] == "found"
    assert {"3211", "doublet"} <= set(found["manoeuvre"])
    assert list(found.columns[:5]) == ["manoeuvre", "control", "start", "end", "note"]


def test_marks_come_before_a_search(unmarked):
    row = '[{"manoeuvre": "mine", "control": "", "start": 1.0, "end": 2.0, "note": ""}]'
    marked = unmarked.copy()
    marked.attrs["manoeuvres"] = row
    table = flighttest.manoeuvres(marked)
    assert (list(table["manoeuvre"]), table.attrs["origin"]) == (["mine"], "marked")


def test_a_record_without_controls_states_what_it_needs(unmarked):
    leaves = {name: node.to_dataset() for name, node in unmarked.children.items()}
    motion = xr.DataTree.from_dict({"imu": leaves["imu"]})
    with pytest.raises(SchemaError, match="no control channel; map at least one of delta_e"):
        flighttest.manoeuvres(motion)
