"""``aeromatch flight plan`` on the T-37: one condition, four manoeuvres, from the a-priori model to
cards.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import a_priori, add_missing_terms
from flighttest.cli.group import flight
from flighttest.flight_programme.input_design.predicted_response import trimmed_start
from flighttest.flight_programme.planning.catalogue import read_catalogue
from flighttest.flight_programme.planning.pilot import fly_manoeuvres
from flighttest.flight_programme.planning.predicted_record import predicted_record
from flighttest.flight_programme.planning.prediction import with_assumed
from flighttest.records.files import save_record

PROJECT = Path(__file__).parents[1] / "data" / "t37" / "aeromatch.toml"
pytestmark = pytest.mark.filterwarnings("ignore:flaps:flightmech.errors.AeromatchWarning")
CATALOGUE = """
title = "T-37"
margin = 0.8
cutoff = "4 Hz"
errors = { mass = 0.005, thrust = 0.015, inertia = 0.0 }
assumed = { "Cn/rudder" = -0.06, "CY/rudder" = 0.2 }
rates = { gps = "5 Hz" }
[limits]
alpha = ["-6 deg", "14 deg"]
beta = ["-10 deg", "10 deg"]
nz = [0.0, 2.5]
[[condition]]
name = "clean cruise"
setup = "60 s"
fixed = { V = "194 kt", h = "5000 ft" }
[[condition]]
name = "too slow"
setup = "60 s"
fixed = { V = "40 kt", h = "5000 ft" }
[[manoeuvre]]
name = "3211 elevator"
kind = "multistep"
setup = "15 s"
[manoeuvre.axis.delta_e]
amplitude = "5 deg"
pattern = "3-2-1-1"
step = "0.6 s"
free = "6 s"
[[manoeuvre]]
name = "doublet rudder"
kind = "multistep"
[manoeuvre.axis.delta_r]
amplitude = "6 deg"
pattern = "doublet"
step = "1 s"
free = "6 s"
[[manoeuvre]]
name = "sideslips"
kind = "sideslip"
amplitude = "8 deg"
duration = "9 s"
[[manoeuvre]]
name = "level speed"
kind = "level_speed"
amplitude = "12 kt"
duration = "14 s"
[[fit]]
name = "pitch"
manoeuvres = ["3211 elevator", "level speed"]
models = ["CL = 1 + alpha + qhat + delta_e", "Cm = 1 + alpha + qhat + delta_e"]
[[fit]]
name = "yaw"
manoeuvres = ["doublet rudder", "sideslips"]
models = ["Cn = 1 + beta + rhat + delta_r"]
[[wanted]]
term = "CL/basic"
within = { alpha = ["0 deg", "3 deg"], mach = [0.25, 0.35] }
ratio = 0.3
[[wanted]]
term = "Cn/rudder"
ratio = 0.05
"""


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    shipped = read_project(PROJECT)
    project = shipped.with_changes(
        engine=None,
        controls=type(shipped.controls)(),
        gear=None,
        ground_effect=None,
    )
    aircraft = flightmech.read_aircraft(project.aircraft)
    aerodb.save(
        add_missing_terms(project, a_priori(project, aircraft)),
        folder / "prior.nc",
    )
    (folder / "catalogue.toml").write_text(CATALOGUE, encoding="utf-8")
    files = [
        "--aircraft",
        str(project.aircraft),
        "--database",
        str(folder / "prior.nc"),
        "-o",
        str(folder / "plan"),
    ]
    found = CliRunner().invoke(
        flight, ["plan", str(folder / "catalogue.toml"), *files], catch_exceptions=False
    )
    return found, folder / "plan"


@pytest.mark.nightly
@pytest.mark.slow
def test_a_plan_is_reached_in_less_than_the_catalogue_takes(planned):
    found, folder = planned
    assert found.exit_code == 0
    order, nodes = pd.read_csv(folder / "order.csv"), pd.read_csv(folder / "nodes.csv")
    assert set(nodes["state"]) == {"reached"}
    assert (nodes["expected"] <= nodes["bound"]).all()
    assert 0 < len(order) < 4
    assert np.isfinite(order["fuel"]).all()
    assert "cannot be flown: too slow, sideslips" in found.output


@pytest.mark.nightly
@pytest.mark.slow
def test_every_manoeuvre_has_its_card_and_every_input_its_files(planned):
    _, folder = planned
    order = pd.read_csv(folder / "order.csv")
    cards = sorted(file.name for file in (folder / "cards").iterdir())
    assert len(cards) == len(order)
    assert all((folder / "cards" / card).read_bytes().startswith(b"%PDF") for card in cards)
    inputs = {file.stem for file in (folder / "inputs").iterdir()}
    assert inputs == {Path(card).stem for card in cards if "3211" in card or "doublet" in card}


@pytest.mark.nightly
@pytest.mark.slow
def test_coverage_after_one_card(planned):
    """The first card as flown with other noise: done, its nodes better than before the flight, the
    others still needed.
    """
    _, folder = planned
    order = pd.read_csv(folder / "order.csv")
    catalogue, aircraft = (
        read_catalogue(folder.parent / "catalogue.toml"),
        flightmech.read_aircraft(read_project(PROJECT).aircraft),
    )
    database = aerodb.open(folder.parent / "prior.nc")
    sim = flightmech.compile(aircraft, with_assumed(database, catalogue))
    first = next(m for m in catalogue.manoeuvre if m.name == order["manoeuvre"][0])
    start = trimmed_start(sim, {}, "level", catalogue.condition[0].fixed)
    signal = first.design.signal() if first.design else None
    record = predicted_record(
        fly_manoeuvres(sim, start, [(first, signal)]), aircraft, "flown", catalogue.rates, seed=99
    )
    save_record(record, folder.parent / "flown.nc")
    files = [
        "--plan",
        str(folder),
        "--aircraft",
        str(read_project(PROJECT).aircraft),
        "--database",
        str(folder.parent / "prior.nc"),
    ]
    arguments = [
        "coverage",
        str(folder.parent / "catalogue.toml"),
        str(folder.parent / "flown.nc"),
        *files,
        "--json",
    ]
    found = json.loads(CliRunner().invoke(flight, arguments, catch_exceptions=False).output)
    assert found["records"] == {"flown": "clean cruise"}
    assert found["done"] == [f"clean cruise, {first.name}"]
    assert [row["manoeuvre"] for row in found["needed"]] == [
        name for name in order["manoeuvre"] if name != first.name
    ]
    nodes = pd.DataFrame(found["nodes"])
    assert {"achieved", "open"} >= set(nodes["state"])
    assert (nodes["expected"] <= nodes["bound"] * (1 + 1e-9)).all()
    assert (nodes["achieved"] < 0.6 * nodes["before"]).any()
