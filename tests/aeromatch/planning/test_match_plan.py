"""The plan of a match: each planted fault is a problem before anything is computed, all of a
project at once; sound projects have none.
"""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from aeromatch.planning.match_plan import make_plan
from aeromatch.planning.sample_checks import manoeuvre_problems
from aeromatch.project.files import Listings
from aeromatch.project.project import read_project
from aeromatch.project.sections import Controls, EngineSection, GroundEffectSection, RecordSelection
from aeromatch.rebuilding.match_options import MatchOptions
from flightmech.errors import SchemaError
from flightmech.support.kept_stages.stages import Stages
from flightmech.support.kept_stages.store import StageStore
from flightmech.units import DEGREE

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture
def copy(tmp_path):
    """A copy of the C182 that may be spoilt."""
    shutil.copytree(DATA / "c182", tmp_path / "c182")
    return tmp_path / "c182"


def edit(file: Path, *pairs: tuple[str, str]) -> None:
    """Replace texts of a file that are there."""
    text = file.read_text()
    for old, new in pairs:
        assert old in text, f"{old!r} not in {file}"
        text = text.replace(old, new, 1)
    file.write_text(text)


def matches(problems: list[str], pattern: str) -> bool:
    return any(re.search(pattern, text) for text in problems)


@pytest.mark.nightly
def test_sound_project_has_no_problem_for_any_number_of_processes(tmp_path):
    project = read_project(DATA / "c182" / "aeromatch.toml")
    plan = make_plan(project, tmp_path / "out", 1)
    assert plan.problems == []
    assert plan.departures == []
    assert make_plan(project, tmp_path / "out", 2).to_dict() == plan.to_dict()
    plan.demand()
    assert not (tmp_path / "out").exists()
    assert [look.last for look in plan.looks.values()] == pytest.approx(
        [150.0, 150.0, 150.0, 21.76, 98.0, 26.0, 12.48, 17.0], abs=0.02
    )
    rows = {row["fit"]: row for row in plan.fit_rows()}
    assert (rows["pitch"]["records"], rows["pitch"]["windows"]) == (3, 9)
    assert "report/report.pdf" in plan.products
    assert len(plan.case_rows()) == 5
    assert plan.steps[1] == "read and check 8 flight records"
    assert plan.to_dict()["problems"] == []


# faults by name: what is changed in the copy, and what the plan must state; those of one table are
# planted in one project
FIRST = {
    "window beyond the record": (
        lambda p: edit(p / "cases/phugoid.toml", ("98.0]", "98.08]")),
        r"case phugoid: the window 4 .* 98.08 s lies outside",
    ),
    "drive by a torque that is not recorded": (
        lambda p: edit(p / "cases/roll_response.toml", ('engine = "map"', 'engine = "torque"')),
        r"case roll_response: .*engine1\.torque",
    ),
    "manoeuvre that one record lacks, of a record that there is not": (
        lambda p: edit(p / "manoeuvres.csv", ("cruise,doublet,rudder", "cruse,doublet,rudder")),
        r"fit 'roll and yaw', record cruise: unknown manoeuvre 'doublet rudder'",
        r"manoeuvres: unknown record 'cruse'",
    ),
    "manoeuvre over the time of another axis": (
        lambda p: edit(
            p / "manoeuvres.csv",
            ("slow,doublet,rudder,54.5,65.15", "slow,doublet,rudder,14.0,22.0"),
        ),
        r"manoeuvres: record slow: doublet rudder from .* s, where the rudder does not move",
    ),
    "controls of the cockpit that are not recorded, all of them": (
        lambda p: edit(
            p / "cases/dutch_roll.toml", ('surfaces = "recorded"', 'surfaces = "cockpit"')
        ),
        r"case dutch_roll: .*'column'",
        r"case dutch_roll: .*'pedal'",
    ),
    "regressor that is not recorded": (
        lambda p: edit(
            p / "aeromatch.toml",
            ("CL = 1 + alpha + qhat + delta_e", "CL = 1 + alpha + qhat + delta_f"),
        ),
        r"fit 'pitch': CL = 1 \+ alpha \+ qhat \+ delta_f needs delta_f, which record slow, "
        r"cruise, fast",
    ),
    "held term that is not in the database": (
        lambda p: edit(
            p / "aeromatch.toml", ('cases = ["cases', 'held = ["Cm/qhut"]\ncases = ["cases')
        ),
        r"held: .*Cm/qhut",
    ),
    "record that cannot be read": (
        lambda p: (p / "flight/check_power.csv").write_text("Time (s),Roll Rate (deg/s)\n0,abc\n"),
        r"record check_power: ",
    ),
    "row that is not in the table": (
        lambda p: edit(p / "cases/short_period.toml", ('"2.c.10"', '"2.c.99"')),
        r"2\.c\.99",
    ),
}
SECOND = {
    "two cases of one name": (
        lambda p: edit(
            p / "cases/power_change.toml", ('name = "power_change"', 'name = "phugoid"')
        ),
        r"2 cases are named 'phugoid'",
    ),
    "drive by a fan speed that the aircraft has no engine for": (
        lambda p: (
            edit(p / "names.toml", ("engine1.prop_command =", "engine1.n1 =")),
            edit(
                p / "cases/roll_response.toml",
                ('engine = "map"', 'engine = "n1"'),
                ('propeller = "rpm"', 'propeller = "lever"'),
            ),
        ),
        r"case roll_response, model datcom: .*n1_drive",
        r"case roll_response, model final: .*n1_drive",
    ),
    "edition that is not in the table": (
        lambda p: edit(p / "cases/short_period.toml", ("2014-01-01", "1914-01-01")),
        r"1914",
    ),
    "two fits that cannot be distinguished": (
        lambda p: edit(p / "aeromatch.toml", ('name = "power"', 'name = "pitch"')),
        r"fit 'pitch' gives 2 models of Cm for record slow",
    ),
    "coefficient that the database lacks": (
        lambda p: edit(
            p / "aeromatch.toml",
            ("CL = 1 + alpha + qhat + delta_e", "CX = 1 + alpha + qhat + delta_e"),
        ),
        r"unknown coefficient 'CX'",
    ),
    "low-pass faster than the samples": (
        lambda p: edit(
            p / "aeromatch.toml", ('title = "C182"', 'title = "C182"\ncutoff = "30 Hz"')
        ),
        r"cut-off 30 Hz",
    ),
    "fit over the time that a case replays": (
        lambda p: edit(
            p / "cases/phugoid.toml", ("../flight/check_phugoid.csv", "../flight/cruise.csv")
        ),
        r"record cruise proves case phugoid from 4 to 98 s; it cannot identify too",
    ),
    "published models without standard errors": (
        lambda p: (
            (p / "local.csv").write_text("model,term,estimate\nCm = 1 + alpha,alpha,-0.9\n"),
            edit(
                p / "aeromatch.toml",
                ('cases = ["cases', 'published = ["local.csv"]\ncases = ["cases'),
            ),
        ),
        r"published: ",
    ),
    "model from elsewhere that is not an FMU": (
        lambda p: (
            (p / "other.fmu").write_text("nothing"),
            edit(
                p / "aeromatch.toml",
                ("[listings]", '[models.other]\nfmu = "other.fmu"\n[listings]'),
            ),
        ),
        r"models\.other: .*other\.fmu",
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("faults", [FIRST, SECOND], ids=["first", "second"])
def test_planted_faults_are_all_stated_at_once(faults, copy, tmp_path):
    for plant, *_ in faults.values():
        plant(copy)
    plan = make_plan(read_project(copy / "aeromatch.toml"), tmp_path / "out", 1)
    silent = [
        name
        for name, (_, *patterns) in faults.items()
        if not all(matches(plan.problems, one) for one in patterns)
    ]
    assert silent == [], plan.problems
    with pytest.raises(SchemaError, match="nothing was computed"):
        plan.demand()


def test_a_row_over_the_time_of_another_axis_is_a_problem():
    time = np.arange(0.0, 40.0, 0.02)
    noise = 0.2 * DEGREE * np.random.default_rng(1).standard_normal(time.size)
    elevator = np.where((time > 5.0) & (time < 8.0), 3.0 * DEGREE, 0.0) + noise
    aileron = np.where((time > 25.0) & (time < 28.0), 8.0 * DEGREE, 0.0)
    states = xr.Dataset(
        {"delta_e": ("time", elevator), "delta_a": ("time", aileron)}, {"time": time}
    )
    rows = [
        ("3211", "elevator", 4.0, 12.0),
        ("3211", "elevator", 24.0, 32.0),
        ("pull_up_push_down", "elevator", 24.0, 32.0),
        ("doublet", "rudder", 4.0, 12.0),
    ]
    table = pd.DataFrame(rows, columns=["manoeuvre", "control", "start", "end"])
    assert manoeuvre_problems("run12", table, states) == [
        "manoeuvres: record run12: 3211 elevator from 24 to 32 s, where the elevator does not move "
        "(elevator 0.29 deg, aileron 8 deg); correct its times or its control"
    ]


def few(project, *records: str, **changes):
    """A project with the clean listing alone, these records, and neither fits nor cases but those
    given.
    """
    nothing = {
        "fit": (),
        "cases": (),
        "terms": {},
        "controls": Controls(),
        "gear": None,
        "ground_effect": None,
    }
    return project.with_changes(
        listings=Listings.model_construct(clean=project.listings.clean),
        flights={name: project.flights[name] for name in records},
        **{**nothing, **changes},
    )


@pytest.mark.nightly
def test_only_what_changed_is_checked_again(copy, tmp_path):
    names = ("short_period", "phugoid")
    records, cases = (
        [f"check_{name}" for name in names],
        tuple(copy / "cases" / f"{name}.toml" for name in names),
    )
    project = few(read_project(copy / "aeromatch.toml"), *records, cases=cases, manoeuvres=None)
    other = few(
        read_project(copy / "aeromatch.toml"),
        "check_short_period",
        cases=cases[:1],
        manoeuvres=None,
        unplaced="warn",
    )

    def planned(project, **options):
        stages = Stages(StageStore(tmp_path / "store"))
        return make_plan(project, tmp_path / "out", 1, stages=stages, **options).to_dict(), dict(
            stages.computed
        )

    first, computed = planned(project, keep_records=True)
    assert first["problems"] == []
    assert computed == {
        "record": 2,
        "record look": 2,
        "a-priori database": 1,
        "opened database": 1,
        "model check": 2,
        "case check": 2,
    }
    assert planned(project) == (first, {})
    assert planned(other)[1] == {}
    edit(cases[0], ('title = "', 'title = "Another '))
    changed, computed = planned(project)
    assert computed == {}  # a check does not depend on texts
    assert changed["cases"][0]["title"].startswith("Another")
    edit(cases[0], ("window = [4.0, 15.1]", "window = [4.0, 15.0]"))
    assert planned(project)[1] == {"record look": 1, "case check": 1}
    edit(cases[1], ("98.0]", "98.08]"))
    for _ in range(2):  # a problem is never kept
        faulty, computed = planned(project)
        assert matches(faulty["problems"], "case phugoid: the window 4 .* 98.08 s lies outside")
        assert computed == {"record look": 1, "case check": 1}


@pytest.mark.nightly
def test_submodels_whose_records_lack_their_channels(tmp_path):
    project = read_project(DATA / "t37" / "aeromatch.toml")
    flight, ground, column = (
        "t37_12_low_pass_1p7m",
        "t37_61_taxi_turns_slow",
        "t37_41_controls_on_ground",
    )
    whole = RecordSelection(records=(flight,), window=((1.0, 5.0),))
    engine = EngineSection(
        flown=(RecordSelection(records=(ground,), window=((0.0, 2.0), (900.0, 901.0))),),
        engines=(1, 3),
    )
    wheel = project.controls.wheel.model_copy(
        update={
            "driven": (RecordSelection(records=(column,), manoeuvres=("force_rudder",)),),
            "arm": 0.0,
            "free": (),
        }
    )
    effect = GroundEffectSection(
        flown=(whole,), models=("CL = 1 + alpha", "CL = 1 + alpha + delta_t"), ground=("Cm = 1",)
    )
    gear = project.gear.model_copy(update={"flown": (whole,)})
    spoilt = few(
        project,
        flight,
        ground,
        column,
        engine=engine,
        controls=Controls(wheel=wheel),
        gear=gear,
        ground_effect=effect,
        held=("CL/none",),
    )
    problems = make_plan(spoilt, tmp_path / "out", 1).problems
    for pattern in (
        r"engine\.flown, record t37_61.*: 900 \.\.\. 901 s is not inside the record",
        r"controls\.wheel: arm is 0\.0",
        r"controls\.wheel\.driven, record t37_41.*: unknown manoeuvre 'force_rudder'",
        r"gear\.flown, record t37_12",
        r"ground_effect\.models: two models of CL",
        r"ground_effect\.ground: .*no model of Cm",
        r"held: unknown term 'CL/none'",
    ):
        assert matches(problems, pattern), (pattern, problems)


@pytest.mark.slow
def test_folders_and_cluster(tmp_path):
    project = few(read_project(DATA / "c182" / "aeromatch.toml"))
    (tmp_path / "file").write_text("")
    options = MatchOptions(scheduler="tcp://127.0.0.1:1", resume=tmp_path / "file" / "kept")
    problems = make_plan(project, tmp_path / "file", 1, options).problems
    assert matches(problems, r"^output: .*file: a file; give the name of a folder")
    assert matches(problems, r"^--resume: .*file is a file")
    assert matches(problems, r"^--scheduler: (no cluster at|dask)")
