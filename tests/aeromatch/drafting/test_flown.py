"""Manoeuvres that neither identify nor prove."""

import pandas as pd

from aeromatch.drafting.flown import describe_unknown, describe_unused

COLUMNS = ["manoeuvre", "control", "start", "end"]


def test_a_manoeuvre_without_a_use_is_a_remark():
    rows = [
        ("phugoid", "elevator", 10.0, 90.0),
        ("dublett", "elevator", 100.0, 110.0),
        ("doublet", "rudder", 120.0, 130.0),
        ("throttle_chop_and_slam", "throttle", 140.0, 150.0),
    ]
    tables = {"a": pd.DataFrame(rows, columns=COLUMNS)}
    assert describe_unused(tables, {}) == [
        "phugoid elevator of a neither identifies nor proves: --prove a makes a case of it",
        "dublett elevator of a neither identifies nor proves: its kind is not known; near it: "
        "doublet",
    ]
    (remark,) = describe_unused(tables, {"a": [(8.5, 90.0)]})
    assert remark.startswith("dublett")


def test_movements_in_which_no_input_stands_are_a_remark():
    rows = [
        ("unknown", "rudder", 41.5, 44.75),
        ("unknown", "rudder", 55.0, 64.5),
        ("unknown", "elevator", 70.0, 72.0),
        ("doublet", "elevator", 4.5, 15.0),
    ]
    (text,) = describe_unknown("cruise", pd.DataFrame(rows, columns=COLUMNS))
    assert text.startswith("cruise: the rudder moves from 41.5 to 44.75 s, and in 1 more places")
    assert "map the pedals of the pilot" in text
    assert describe_unknown("cruise", pd.DataFrame(rows[2:], columns=COLUMNS)) == []
