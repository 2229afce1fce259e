"""Values of the aircraft file that wait for their author, and those that he has given."""

import pytest

from aeromatch.drafting.gaps import AircraftGap, open_gaps

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
    ("old", "new", "closed"),
    [
        ("", "", None),
        ('"?"', '"900 kg"', "mass"),
        ("cg = [0.0", "cg = [0.1", "cg"),
        ("; CONFIRM: taken as there", "", "cg"),
        ("position = [0.0", "position = [2.0", "engine"),
        ("[[engine]]\nposition", "[other]\nposition", "engine"),
    ],
)
def test_a_value_of_the_author_closes_its_gap(old, new, closed):
    texts = open_gaps(GAPS, DRAFT, DRAFT.replace(old, new) if old else DRAFT)
    assert texts == [gap.text for gap in GAPS if gap.text != closed]
