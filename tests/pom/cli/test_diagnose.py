"""``aeromatch pom diagnose`` from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from flightmech.terms import make_term


@pytest.fixture
def aeromatch(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from pom.cli.group import pom

    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(pom, ["diagnose", *map(str, words)])


@pytest.fixture
def files(write_case, trainer, tmp_path):
    """A case with its record and aircraft, and two databases."""
    final = trainer.database()
    aerodb.save(final, tmp_path / "final.nc")
    aerodb.save(
        trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.8, Cl_phat=0.5), tmp_path / "prior.nc"
    )
    case = write_case(case='aircraft = "trainer.toml"')
    pulse = [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]
    trainer.flight(final, delta_e=pulse).to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    (tmp_path / "trainer.toml").write_text(trainer.TOML)
    return [case, "--prior", "prior.nc", "--final", "final.nc"]


@pytest.mark.nightly
def test_the_ranking_and_the_corrected_database(aeromatch, files, tmp_path):
    done = aeromatch(*files, "-o", "corrected.nc", "--group", "pitch=Cm/elevator,CL/*")
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[1].split()[:4] == ["stage", "term", "explained", "verdict"]
    assert "pitch_angle explained" in lines[1]
    table = {tuple(line.split()[:2]): line for line in lines}
    assert "pass" in table["sequence", "CL/basic"]
    assert "100 %" in table["group", "pitch"]
    assert (
        "With Cm/elevator and CL/basic from the final model, the corrected a-priori model is "
        "within tolerance." in done.output
    )
    assert lines[-1] == "written: corrected.nc, with CL/basic Cm/elevator of final.nc"
    history = aerodb.terms(aerodb.open(tmp_path / "corrected.nc"))["Cm/elevator"].attrs["history"]
    assert "pom diagnose: from final.nc (SHA-256 " in history
    assert "needed by a_case (alone " in history


@pytest.mark.slow
def test_json_holds_every_row_with_its_case(aeromatch, files):
    done = aeromatch(*files, "--json", "--players", 1)
    rows = json.loads(done.stdout)
    joint = [row for row in rows if row["stage"] in ("culprit", "correction")]
    assert {row["case"] for row in rows if row not in joint} == {"a_case"}
    assert {row["case"] for row in joint} == {""}  # over all cases
    assert next(row["term"] for row in joint if row["stage"] == "culprit") == "Cm/elevator"
    assert [row["term"] for row in rows if row["stage"] == "single"][-1] == "Cl/phat"
    share = [row for row in rows if row["stage"] == "share"]
    assert sum(row["explained"] for row in share) == pytest.approx(1.0)
    assert sum(row["normal_acceleration explained"] for row in share) == pytest.approx(1.0)


@pytest.mark.nightly
def test_parts_of_the_aircraft_go_into_a_corrected_file(aeromatch, write_case, trainer, tmp_path):
    strong, weak = (
        replace(
            trainer.AIRCRAFT,
            engines=tuple(
                replace(
                    e, thrust=make_term([500.0, full], {"throttle": [0.0, 1.0]}), time_constant=0.5
                )
                for e in trainer.AIRCRAFT.engines
            ),
        )
        for full in (4500.0, 2500.0)
    )
    for name, aircraft in (("strong.toml", strong), ("weak.toml", weak)):
        flightmech.write_aircraft(aircraft, tmp_path / name)
    db = trainer.database()
    aerodb.save(db, tmp_path / "db.nc")
    time = np.round(np.arange(0.0, 20.001, 0.02), 9)
    lever = np.interp(time, [3.0, 4.0], [0.0, 1.0])
    start = {"init.V": 85.0, "init.h": 1500.0, "mode.engine": 0.0, "mode.trim": 2.0}
    pushed = xr.Dataset({f"engine{i}.throttle": ("time", lever) for i in (1, 2)}, {"time": time})
    flown = flightmech.simulate(flightmech.compile(strong, db), pushed, start)
    found = flown.drop_vars(
        [n for n in flown if str(n).startswith(("applied.", "trim.", "out_of", "air."))]
        + ["lat", "lon"]
    )
    found = found.assign(
        {name: flown[f"applied.{name}"] for name in ("delta_e", "delta_a", "delta_r")}
    )
    found = found.assign(
        {name: values + float(flown["trim.throttle"][0]) for name, values in pushed.items()}
    )
    found.assign(mass=2200.0, z_cg_b=0.2, delta_f=0.0, gear=0.0).to_netcdf(
        tmp_path / "record.nc", engine="h5netcdf"
    )
    path = write_case(
        "2.c.1",
        'aircraft = "strong.toml"\nshortened = "test"',
        "[events]\nchange_start = 3.0\nchange_end = 4.0",
    )
    path.write_text(
        path.read_text()
        .replace('engine = "thrust"', 'engine = "throttle"')
        .replace("[1.0, 9.0]", "[0.0, 15.0]")
    )
    models = [path, "--prior", "db.nc", "--final", "db.nc"]
    done = aeromatch(*models, "--apriori", "weak.toml", "--aircraft-output", "corrected.toml")
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == "written: corrected.toml"
    corrected = flightmech.read_aircraft(tmp_path / "corrected.toml")
    assert float(corrected.engines[0].thrust["value"].max()) == 4500.0
    assert "engine/thrust: pom diagnose: from strong.toml (SHA-256 " in corrected.history
    refused = aeromatch(*models, "--aircraft-output", "corrected.toml")
    assert refused.exit_code == 2
    assert "--aircraft-output needs --apriori" in refused.output


@pytest.mark.parametrize("group", ["pitch", "=Cm/elevator", "pitch="])
def test_a_group_needs_a_name_and_members(aeromatch, write_case, group):
    case = write_case()
    done = aeromatch(case, "--prior", case, "--final", case, "--group", group)
    assert done.exit_code == 2
    assert "expected NAME=TERM,TERM" in done.output


@pytest.mark.slow
def test_problems_of_several_cases_are_reported_at_once(aeromatch, files, tmp_path):
    from flightmech.errors import SchemaError

    bare = tmp_path / "bare.toml"
    bare.write_text(files[0].read_text().replace('aircraft = "trainer.toml"', ""))
    done = aeromatch(files[0], bare, *files[1:])
    assert isinstance(done.exception, SchemaError)
    assert "case.aircraft: missing" in str(done.exception)
    assert "case name 'a_case' is given twice" in str(done.exception)
