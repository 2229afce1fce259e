"""Verb ``db envelope``: maps of the regions as text, figure, table and JSON."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from flightmech.errors import SchemaError
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.terms import make_term

ALPHA = np.radians([-10.0, 0.0, 10.0, 20.0])
LENGTHS = {"S": 27.0, "cbar": 2.2, "b": 15.1, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}


@pytest.fixture
def database():
    """Return a lift curve from flight at 0 and 10 deg, flown from 2 to 8 deg clean."""
    leaf = make_term(0.3 + 5.0 * ALPHA, {"alpha": ALPHA}, stderr=0.01, source="datcom")
    leaf["source"].values[1:3] = 1
    found = aerodb.make_database(
        {"CL/basic": leaf}, title="t", aircraft="a", force_axes="stability", **LENGTHS
    )
    alpha = np.radians(np.linspace(2.0, 8.0, 61))
    samples = {"alpha": alpha, "beta": 0.0 * alpha, "mach": np.full(61, 0.3)}
    found.attrs[FLOWN_STATES] = pack_states(gather_states([{**samples, "gear": 0.0 * alpha}]))
    return found


@pytest.fixture
def path(database, tmp_path):
    aerodb.save(database, tmp_path / "db.nc")
    return str(tmp_path / "db.nc")


def run(*arguments):
    return CliRunner().invoke(db, ["envelope", *arguments], catch_exceptions=False)


def test_text_has_a_map_per_plane_and_the_marks(path):
    lines = run(path).stdout.splitlines()
    assert [line for line in lines if line.startswith("clean")] == [
        "clean: mach over alpha",
        "clean: beta over alpha",
    ]
    assert lines[-1] == "# flown, + between flown points, . a-priori, x extrapolated"
    # cells at Mach 0.3: beyond the table, a-priori, flown, a-priori, beyond the table
    (at_mach,) = [line for line in lines if line.startswith("      0.3 ")]
    marks = at_mach.split()[1]
    assert marks == marks[0] + marks[1:-1] + "x"
    assert "".join(dict.fromkeys(marks)) == "x.#"


def test_a_constant_that_no_flight_supports_is_named(database, tmp_path):
    constant = make_term(0.01, stderr=0.001, source="datcom")
    both = aerodb.replace_terms(database, {"CD/fixture": constant})
    aerodb.save(both, tmp_path / "both.nc")
    lines = run(str(tmp_path / "both.nc")).stdout.splitlines()
    assert lines[-1].endswith("no flight supports CD/fixture, at any state")
    clean = [line for line in lines if line.startswith("      0.3 ")]
    assert set(clean[0].split()[1]) == {".", "x"}
    (first, *_) = json.loads(run(str(tmp_path / "both.nc"), "--json").stdout)["maps"]
    assert first["everywhere"] == ["CD/fixture"]


def test_csv_has_the_regions_of_the_look_up(path, tmp_path):
    target = tmp_path / "maps.csv"
    assert f"written: {target}" in run(path, "-o", str(target)).stdout
    rows = list(csv.DictReader(target.read_text().splitlines()))
    regions = {}
    for row in rows:
        place = row["map"] == "beta over alpha" and abs(float(row["beta"])) < 0.005
        if place:
            regions[round(np.degrees(float(row["alpha"])), 1)] = row["region"], row["axis"]
    assert regions[5.0] == ("flown", "")
    assert {words for alpha, words in regions.items() if alpha > 20.5} == {
        ("extrapolated", "alpha")
    }
    assert {words for alpha, words in regions.items() if 15.5 < alpha < 20.0} == {
        ("a-priori", "alpha")
    }


def test_figure_and_json(path, tmp_path):
    target = tmp_path / "maps.svg"
    found = json.loads(run(path, "-o", str(target), "--json").stdout)
    assert target.read_text().startswith("<svg")
    first, second = found["maps"]
    assert first["plane"] == ["alpha", "mach"]
    assert first["configuration"] == {"gear": 0.0}
    assert second["held"]["mach"] == pytest.approx(0.3)
    assert sum(first["shares"].values()) == pytest.approx(1.0)
    assert first["shares"]["flown"] > 0.0


def test_what_cannot_be_drawn_is_an_error(path, database, tmp_path):
    with pytest.raises(SchemaError, match=r"ending '.png'; give .svg or .csv"):
        run(path, "-o", str(tmp_path / "maps.png"))
    del database.attrs[FLOWN_STATES]
    aerodb.save(database, tmp_path / "old.nc")
    with pytest.raises(SchemaError, match="keeps no flown states"):
        run(str(tmp_path / "old.nc"))
