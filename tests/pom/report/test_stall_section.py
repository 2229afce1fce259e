"""Section on an identified stall: parameters, terms, loops and separation of every record."""

import sys
from pathlib import Path

import numpy as np
import pytest

from flighttest.submodels.stall.identification import identify_stall
from pom.report.submodels.sections import make_sections

sys.path.insert(0, str(Path(__file__).parents[2] / "flighttest"))
import stall_records as records


@pytest.fixture(scope="module")
def section():
    rng = np.random.default_rng(3)
    data = [records.stall_record(rng, "accelerated") for _ in range(2)]
    found = identify_stall(data, records.STATION, records.CBAR, coefficients=("CL",))
    (made,) = make_sections({"stall": found}, {})
    return made


@pytest.mark.slow
def test_parameters_and_terms(section):
    separation, terms = section.grids
    assert "at 2.58 m from the plane of symmetry; X is the separation point" in separation.caption
    rows = {row[0]: row for row in separation.rows}
    assert list(rows) == ["a1", "alpha_star", "tau1", "tau2", "asymmetry"]
    assert rows["alpha_star"][3] == "deg"
    assert float(rows["alpha_star"][1]) == pytest.approx(17.0, abs=0.5)
    assert [row[0] for row in terms.rows] == ["CL: alpha*X_lift_loss"]
    assert section.techniques[0][0] == "CL"
    assert section.techniques[0][2].startswith("R2 0.9")


def test_every_record_has_its_loop_and_its_separation(section):
    (picture,) = section.pictures
    assert picture.words == (
        "lift coefficient over the angle of attack, and separation over time, of 2 of 2 records"
    )
    for title in ("CL, record 1", "separation point X, record 1", "CL, record 2"):
        assert title in picture.body
    assert any("standard errors do not contain" in text for text in section.remarks)
