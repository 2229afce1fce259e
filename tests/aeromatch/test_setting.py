"""`aeromatch set` changes one key and nothing else."""

import difflib
import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

import pom
from aeromatch.project.editing import TRIAL, set_key, set_verb, write_trial
from aeromatch.project.project import read_project
from flightmech.errors import SchemaError
from flighttest.records.readers.name_map_reading import read_names

T37 = Path(__file__).parents[2] / "data" / "t37"


@pytest.fixture
def project(tmp_path):
    for name in (
        "aeromatch.toml",
        "aircraft.toml",
        "apriori.toml",
        "engine.nc",
        "engine.toml",
        "names.toml",
        "names_cockpit.toml",
    ):
        shutil.copy(T37 / name, tmp_path)
    for name in ("datcom", "flight", "cases"):
        (tmp_path / name).symlink_to(T37 / name)
    return tmp_path / "aeromatch.toml"


def difference(before: str, after: str) -> list[str]:
    return [
        line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"
    ]


@pytest.mark.nightly
def test_a_value_changes_and_all_else_stays(project):
    before = project.read_text()
    set_key(project, "cutoff", "3 Hz")
    assert difference(before, project.read_text()) == [
        '- cutoff = "4 Hz"        # before coefficients are formed: twice the highest '
        "frequency of the inputs",
        '+ cutoff = "3 Hz"        # before coefficients are formed: twice the highest '
        "frequency of the inputs",
    ]
    assert read_project(project).cutoff == 3.0
    assert set_key(project, "fit.0.models", '["CL = 1 + alpha"]') == ["CL = 1 + alpha"]
    assert read_project(project).fit[0].models == ("CL = 1 + alpha",)
    assert set_key(project, 'terms."CL/gear".stderr', "0.07") == 0.07
    assert read_project(project).terms["CL/gear"].stderr == 0.07


@pytest.mark.nightly
def test_an_entry_is_appended_and_removed(project):
    before, fits = project.read_text(), read_project(project).fit
    record = fits[0].records[0]
    set_key(
        project,
        "fit.+",
        f'{{name = "drag", records = ["{record}"], manoeuvres = ["doublet elevator"], models '
        f'= ["CD = 1 + alpha"]}}',
    )
    assert [fit.name for fit in read_project(project).fit] == [*(fit.name for fit in fits), "drag"]
    set_key(project, f"fit.{len(fits)}", None)
    assert read_project(project).fit == fits
    assert difference(before.rstrip(), project.read_text().rstrip()) == []


@pytest.mark.slow
def test_the_first_entry_of_a_list(project):
    """A project without fits gets one."""
    record = read_project(project).fit[0].records[0]
    text = project.read_text()
    project.write_text(text[: text.index("[[fit]]")])
    set_key(
        project,
        "fit.+",
        f'{{name = "drag", records = ["{record}"], window = [1.0, 9.0], models = ["CD = 1 + '
        f'alpha"]}}',
    )
    assert [(fit.name, fit.window) for fit in read_project(project).fit] == [
        ("drag", ((1.0, 9.0),))
    ]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("cutof", "3 Hz", "cutof"),
        ("cutoff", "-3 Hz", "more than 0 Hz"),
        ("fit.99.models", '["CL = 1"]', "the list has"),
        ("fit.0.models", '["CL = 1 + alfa"]', "alfa"),
        ("title.x", "1", "inside a value"),
        ("", "1", "with dots"),
        ("fit.0.nothing", None, "nothing"),
    ],
)
def test_a_fault_leaves_the_file_alone(project, key, value, text):
    before = project.read_bytes()
    with pytest.raises(SchemaError, match=text) as refused:
        set_key(project, key, value)
    assert project.read_bytes() == before
    assert ".part" not in str(refused.value)
    assert sorted(item.name for item in project.parent.iterdir() if item.name.startswith(".")) == []


@pytest.mark.slow
def test_cases_names_and_aircraft_files_are_read_by_their_readers(project):
    case = project.parent / "case.toml"
    text = (T37 / "cases" / "21_short_period.toml").read_text().replace("../", "")
    case.write_text(text)
    set_key(case, "case.window", "[4.0, 17.0]")
    assert "[4.0, 17.0]" in case.read_text()
    with pytest.raises(SchemaError, match="windw"):
        set_key(case, "case.windw", "[4.0, 17.0]")
    set_key(project.parent / "aircraft.toml", "mass", "2500.0")
    with pytest.raises(SchemaError):
        set_key(project.parent / "names.toml", "ground.V", '{ columm = "V" }')


ENGINES = """[controls]
engine1.throttle = "left"  # of the pedestal
engine2 = { throttle = "right" }
"engine1.thrust" = "thrust"
delta_e = "elevator"  # up is negative
delta_f.column = "flap"

[controls.speedbrake]
column = "brake"

[vanes]
alpha_vane = "alpha"
"""


@pytest.mark.parametrize(
    ("key", "value", "before", "after"),
    [
        (
            "controls.engine1.throttle",
            "lever",
            'engine1.throttle = "left"',
            'engine1.throttle = "lever"',
        ),
        (
            'controls."engine1.throttle"',
            "lever",
            'engine1.throttle = "left"',
            'engine1.throttle = "lever"',
        ),
        (
            "controls.engine1.throttle",
            '{ column = "lever", scale = 0.01 }',
            'engine1.throttle = "left"',
            'engine1.throttle = { column = "lever", scale = 0.01 }',
        ),
        ("controls.engine2.throttle", "lever", 'throttle = "right"', 'throttle = "lever"'),
        (
            'controls."engine2.throttle"',
            '{ column = "lever" }',
            'throttle = "right"',
            'throttle = { column = "lever" }',
        ),
        ("controls.engine1.thrust", '{ column = "lbf" }', '= "thrust"', '= { column = "lbf" }'),
        (
            "controls.delta_e",
            '{ column = "elevator", sign = -1 }',
            '= "elevator"',
            '= { column = "elevator", sign = -1 }',
        ),
        ("controls.delta_f.column", "flaps", '"flap"', '"flaps"'),
        ("controls.speedbrake", '{ column = "panel" }', 'column = "brake"', 'column = "panel"'),
        ('controls."engine1.throttle"', None, 'engine1.throttle = "left"  # of the pedestal\n', ""),
        ("controls.engine2.throttle", None, 'engine2 = { throttle = "right" }\n', ""),
        ("controls.engine1.thrust", None, '"engine1.thrust" = "thrust"\n', ""),
    ],
)
def test_a_name_with_a_dot_and_a_table_in_a_table(tmp_path, key, value, before, after):
    """However the file writes it, the entry is changed where it stands, and the lines around it
    stay.
    """
    (tmp_path / "names.toml").write_text(ENGINES)
    assert ENGINES.count(before) == 1
    set_key(tmp_path / "names.toml", key, value)
    assert (tmp_path / "names.toml").read_text() == ENGINES.replace(before, after)


def test_a_name_with_a_dot_that_is_not_there_yet(tmp_path):
    (file := tmp_path / "names.toml").write_text(ENGINES)
    for key, value in (
        ("controls.engine2.thrust", "right"),
        ('controls."engine3.throttle"', "middle"),
        ("vanes.beta_vane", "b"),
    ):
        set_key(file, key, value)
    leaves = read_names(file).leaves
    assert leaves["controls"]["engine2.thrust"].column == "right"
    assert leaves["controls"]["engine2.throttle"].column == "right"
    assert leaves["controls"]["engine3.throttle"].column == "middle"
    assert list(leaves["vanes"]) == ["alpha_vane", "beta_vane"]
    file.write_text(ENGINES + '\n[engine]\nengine1.n1 = "n"\n"engine1.n1" = "m"\n')
    with pytest.raises(SchemaError, match=r"engine\.engine1\.n1: stands there twice"):
        read_names(file)


@pytest.mark.nightly
def test_the_verb(project):
    done = CliRunner().invoke(set_verb, [str(project), "tabulation", "join"])
    assert done.exit_code == 0, done.output
    assert read_project(project).tabulation == "join"
    assert CliRunner().invoke(set_verb, [str(project), "tabulation"]).exit_code == 2
    done = CliRunner().invoke(set_verb, [str(project), "tabulation", "--remove", "--json"])
    assert json.loads(done.output) == {"file": str(project), "key": "tabulation", "value": None}
    assert read_project(project).tabulation == "tabulate"


def test_a_trial_is_a_marked_copy_and_the_case_stays(project, tmp_path):
    case = T37 / "cases" / "22_roll_response.toml"
    before = case.read_bytes()
    (folder := tmp_path / "deep" / "trials").mkdir(parents=True)
    words = [
        str(case),
        "drive.trim",
        "false",
        "--also",
        "tolerance.roll_rate",
        "4 deg/s",
        "--trial",
        str(folder / "wide.toml"),
    ]
    done = CliRunner().invoke(set_verb, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert case.read_bytes() == before
    own, trial = pom.read_case(case), pom.read_case(folder / "wide.toml")
    assert trial.title == f"{TRIAL}: Roll response, clean"
    assert (
        trial.notes == f"{TRIAL}: a copy of 22_roll_response.toml with drive.trim = false, "
        f"tolerance.roll_rate = 4 deg/s."
    )
    assert (own.drive.trim, trial.drive.trim) == (True, False)
    bands = [
        next(c.band.text for c in one.criteria if c.name == "roll_rate") for one in (own, trial)
    ]
    assert bands == ["10 % of the flight value or 2 deg/s, the greater", "4 deg/s"]
    assert [Path(name).resolve() for name in trial.files()[1:]] == [
        Path(name).resolve() for name in own.files()[1:]
    ]


def test_a_trial_that_is_none_is_not_written(project, tmp_path):
    case, output = T37 / "cases" / "22_roll_response.toml", tmp_path / "trial.toml"
    with pytest.raises(SchemaError, match="a trial is the copy of a case file"):
        write_trial(project, output, [("cutoff", "3 Hz")])
    with pytest.raises(SchemaError, match="give the trial another name"):
        write_trial(case, case, [("drive.trim", "false")])
    with pytest.raises(SchemaError, match="roll_rat"):
        write_trial(case, output, [("tolerance.roll_rat", "4 deg/s")])
    assert not output.exists()
    for words in (
        ["drive.trim", "--remove", "--trial", str(output)],
        ["drive.trim", "false", "--also", "drive.wind", "none"],
    ):
        assert CliRunner().invoke(set_verb, [str(case), *words]).exit_code == 2
    assert not output.exists()
