"""Tests of conditions that print the same heading twice."""

from pathlib import Path

import numpy as np

import datcom_io
from datcom_io.printout.layouts.trim import AIRCRAFT, BLOCKS

LISTINGS = Path(__file__).parents[1] / "listings"


def test_pages_of_a_device_alone_count_the_conditions() -> None:
    """Mach 5 and 15 at two equal pressures: four conditions, no static page among them."""
    case = datcom_io.read(LISTINGS / "hypersonic_tail_flap.out")[1]
    leaf = case.to_datatree()["symflp"]
    assert leaf["mach"].values.tolist() == [5.0, 15.0, 5.0, 15.0]
    first, second = leaf["dCL"].values[0], leaf["dCL"].values[2]
    assert np.array_equal(first, second, equal_nan=True)


# page of an own random deck; the trim ended before the first row
PAGE = [
    "0-----------------UNTRIMMED--------------------HORIZONTAL STABILIZER "
    "COEFFICIENTS----------------AT TRIM INCIDENCE------",
    "",
    "0 ALPHA     CD       CL       CM       HM                                         "
    "ALIHT    CD       CL       CM       HM",
    "",
    "",
    "0                                         WING-BODY-TAIL COEFFICIENTS AT TRIM INCIDENCE",
    "",
    "0                                                    ALPHA     CD       CL",
    "0",
    "0*NOTE** TRIM RESULTS HAVE BEEN TERMINATED BECAUSE THE NEXT ANGLE OF ATTACK EXCEEDS "
    "ALPHA (CL) MAX.",
]


def test_trim_tables_of_a_stabilizer_without_rows_are_understood() -> None:
    lines = list(enumerate(PAGE, 1))
    stabilizer = next(block for block in BLOCKS if block.names[0] == "trim_stabilizer")
    aircraft = next(block for block in BLOCKS if block.names[0] == AIRCRAFT.name)
    assert stabilizer.read(lines, 0) == ([], 3)
    printed, after = aircraft.read(lines, 5)
    assert printed == []
    assert after <= 9
    # any other line below an empty table is another form of page
    other = [*lines[:5], (6, "0 SOMETHING ELSE")]
    assert stabilizer.read(other, 0) is None
