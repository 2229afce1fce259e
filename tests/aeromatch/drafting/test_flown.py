"""Manoeuvres that neither identify nor prove."""

import pandas as pd

from aeromatch.drafting.flown import describe_unused

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
