"""Columns that move as an absent quantity does, on a record of the light aircraft."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aeromatch.drafting.name_map.candidates import find_candidates
from aeromatch.drafting.name_map.name_repair import check_draft
from aeromatch.drafting.name_map.names import draft_names
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording

FLIGHT = Path(__file__).parents[3] / "data" / "c182" / "flight" / "cruise.csv"
# Sign and unit of each column; the recorder counts a right roll as positive.
COLUMNS = {
    "delta_e": ("Elevator", 1, "deg"),
    "delta_a": ("Aileron", -1, "deg"),
    "delta_r": ("Rudder", 1, "deg"),
    "p": ("Roll Rate", 1, "deg/s"),
    "q": ("Pitch Rate", 1, "deg/s"),
    "r": ("Yaw Rate", 1, "deg/s"),
    "phi": ("Roll", 1, "deg"),
    "theta": ("Pitch", 1, "deg"),
    "alpha_vane": ("AOA", 1, "deg"),
    "beta_vane": ("AOS", 1, "deg"),
    "V_cas": ("CAS", 1, "kt"),
    "h_baro": ("Press Alt", 1, "ft"),
}


@pytest.fixture(scope="module")
def table():
    (table,) = open_recording(FLIGHT, NameMap({})).tables.values()
    return table


@pytest.fixture(scope="module")
def rows():
    return draft_names([FLIGHT]).rows


@pytest.mark.slow
@pytest.mark.parametrize("quantity", COLUMNS)
def test_a_hidden_column_comes_first(table, rows, quantity):
    column, sign, unit = COLUMNS[quantity]
    known = [row for row in rows if row.name != quantity]
    used = {name for row in known for name in row.channel.columns}
    free = [name for name in table.columns if name not in used and name != "Time"]
    found = find_candidates(known, table, free, step=0.04)
    best = next(item for item in found if item.quantity == quantity)
    assert (best.column, best.sign, best.unit) == (column, sign, unit)


@pytest.mark.parametrize("quantity", ["p", "q", "r", "phi", "theta", "h_baro"])
def test_the_size_gives_a_unit_that_no_heading_states(table, rows, quantity):
    column, _, unit = COLUMNS[quantity]
    known = [row for row in rows if row.name != quantity]
    units = {name: text for name, text in table.units.items() if name != column}
    (best, *_) = find_candidates(
        known, type(table)(table.columns, units=units), [column], step=0.04
    )
    assert (best.column, best.unit) == (column, unit)


def test_a_column_in_a_unit_of_another_quantity_is_not_a_candidate(table, rows):
    """A pitch rate moves with the normal force, and is not an angle of attack."""
    known = [row for row in rows if row.name not in ("q", "alpha_vane")]
    found = find_candidates(known, table, ["Pitch Rate"], step=0.04)
    assert {item.quantity for item in found} == {"q"}


def test_noise_is_no_candidate(table, rows):
    rng = np.random.default_rng(1)
    columns = {name: np.asarray(values, float) for name, values in table.columns.items()}
    columns["Elevator"] = rng.normal(size=len(columns["Elevator"]))
    noisy = type(table)(columns, units=table.units)
    known = [row for row in rows if row.name != "delta_e"]
    assert find_candidates(known, noisy, ["Elevator"], step=0.04) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mirrored", "reversed_channels"),
    [
        pytest.param(("Roll", "Roll Rate"), {"phi", "p"}, marks=pytest.mark.nightly),
        (("Roll", "Roll Rate", "Aileron"), {"phi", "p"}),
        pytest.param(("Pitch", "Pitch Rate"), {"theta", "q"}, marks=pytest.mark.nightly),
    ],
)
def test_an_angle_and_its_rate_that_are_reversed_together_are_corrected(
    mirrored, reversed_channels, tmp_path
):
    """Bank and roll rate of a left-handed recorder agree, and contradict the turn alone."""
    table = pd.read_csv(FLIGHT)
    columns = {column.partition(" (")[0].partition(" [")[0]: column for column in table.columns}
    for name in mirrored:
        table[columns[name]] *= -1.0
    flight = tmp_path / "mirror.csv"
    table.to_csv(flight, index=False)
    as_recorded, mirror = draft_names([FLIGHT]), draft_names([flight])
    right, _, findings = check_draft(as_recorded, [FLIGHT])
    assert findings == []
    draft, _, findings = check_draft(mirror, [flight])
    assert findings == []
    signs = {row.name: row.channel.sign for row in right.rows}
    corrected = {row.name: row.channel.sign for row in draft.rows}
    turned = {name for name, sign in corrected.items() if sign != signs[name]}
    expected = set(reversed_channels)
    if "Aileron" in mirrored:
        expected.add("delta_a")
    assert turned == expected


def test_a_gap_does_not_hide_a_candidate(table, rows):
    columns = {name: np.array(values, float) for name, values in table.columns.items()}
    columns["Roll"][100] = np.nan
    gappy = type(table)(columns, units=table.units)
    known = [row for row in rows if row.name != "p"]
    found = find_candidates(known, gappy, ["Roll Rate"], step=0.04)
    assert [(item.quantity, item.column) for item in found] == [("p", "Roll Rate")]
