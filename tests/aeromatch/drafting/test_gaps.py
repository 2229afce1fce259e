"""Values of the aircraft file that wait for their author, and those that he has given."""

import pytest
import xarray as xr

from aeromatch.drafting.gaps import AircraftGap, compare_mass, describe_other_recorders, open_gaps

DRAFT = """mass = "?"
cg = [0.0, 0.0, 0.0]   # from the reference point; CONFIRM: taken as there

[[engine]]
position = [0.0, 0.0, 0.0]   # CONFIRM: not known
"""
GAPS = [
    AircraftGap(("mass",), "mass"),
    AircraftGap(("cg",), "cg"),
    AircraftGap(("engine", 0, "position"), "engine"),
    AircraftGap((), "thrust"),
]


@pytest.mark.parametrize(
    ("old", "new", "filled"),
    [
        ("", "", None),
        ('"?"', '"900 kg"', "mass"),
        ("cg = [0.0", "cg = [0.1", "cg"),
        ("; CONFIRM: taken as there", "", "cg"),
        ("position = [0.0", "position = [2.0", "engine"),
        ("[[engine]]\nposition", "[other]\nposition", "engine"),
    ],
)
def test_a_value_of_the_author_fills_its_gap(old, new, filled):
    texts = open_gaps(GAPS, DRAFT, DRAFT.replace(old, new) if old else DRAFT)
    assert texts == [gap.text for gap in GAPS if gap.text != filled]


@pytest.mark.parametrize(
    ("stated", "is_far"), [("2280", True), ('"2280 lb"', False), ('"?"', False), ("800.0", False)]
)
def test_a_mass_in_pounds_without_unit_shows_against_the_recorded_one(stated, is_far):
    leaf = xr.Dataset({"mass": ("time", [1040.0, 1034.2])})
    record = xr.DataTree.from_dict({"mass": leaf})
    remarks = compare_mass(f"mass = {stated}\n", {"a": record})
    assert (len(remarks) == 1) == is_far
    assert compare_mass(f"mass = {stated}\n", {}) == []


def test_a_record_with_few_channels_is_of_another_recorder():
    def record(*names):
        leaf = xr.Dataset({name: ("time", [0.0, 1.0]) for name in names})
        return xr.DataTree.from_dict({"imu": leaf})

    records = {"a": record("p", "q", "r"), "b": record("p", "q"), "c": record("p")}
    (remark,) = describe_other_recorders(records)
    assert remark.startswith("c has 1 channels and another record 3")
    assert describe_other_recorders({}) == []
