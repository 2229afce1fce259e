"""Submodels, a-priori sources, ice and cases of a project file."""

import os

import pytest

from aeromatch.project.files import ProjectFolder
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import prior_step
from aeromatch.workflow.windows import inputs_of
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

PROJECT = """
title = "Toy"
aircraft = "aircraft.toml"
names = "names.toml"
flights = "flight/*.nc"
cases = ["case.toml"]
cutoff = "4 Hz"

[listings]
clean = "clean.out"
altitude = "10000 ft"

[terms."CL/gear"]
regressors = ["gear"]
stderr = 0.05

[[fit]]
name = "pitch"
records = ["run_1"]
manoeuvres = ["3211 elevator"]
models = ["CL = 1 + alpha"]
"""


@pytest.fixture
def write(tmp_path):
    """Write a project file next to the files it names."""
    (tmp_path / "flight").mkdir()
    for name in (
        "aircraft.toml",
        "names.toml",
        "case.toml",
        "clean.out",
        "flight/run_1.nc",
        "flight/run_2.nc",
    ):
        (tmp_path / name).touch()

    def write(*changes):
        text = PROJECT
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "aeromatch.toml").write_text(text)
        return tmp_path / "aeromatch.toml"

    return write


def problems(path):
    with pytest.raises(SchemaError) as caught:
        read_project(path)
    return caught.value.problems


SUBMODELS = """
[engine]
flown = [{ records = ["run_1"], manoeuvres = ["throttle_chop_and_slam"] }]
engines = [1, 2]
pla = ["10 deg", "50 deg"]

[controls.column]
driven = [{ records = ["run_1", "run_2"] }]
free = [{ records = ["run_2"], manoeuvres = ["release_column"] }]
model = "Ch_e = 1 + alpha + delta_e"

[gear]
flown = [{ records = ["run_2"] }]
errors = { lift = 0.2 }

[ground_effect]
models = ["CL = 1 + alpha"]
flown = [{ records = ["run_1"] }]
"""


def test_submodels_are_read(write):
    path = write()
    path.write_text(path.read_text() + SUBMODELS)
    project = read_project(path)
    assert project.engine.pla == pytest.approx((10.0 * DEGREE, 50.0 * DEGREE))
    assert list(project.controls.sections) == ["column"]
    assert list(project.submodels) == [
        "engine.flown",
        "controls.column.driven",
        "controls.column.free",
        "gear.flown",
        "ground_effect.flown",
    ]
    assert project.submodels["controls.column.free"][0].manoeuvres == ("release_column",)


def test_a_project_without_submodels_has_none(write):
    assert read_project(write()).submodels == {}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'records = ["run_1"] }]',
            'records = ["run_3"] }]',
            "ground_effect.flown.records: unknown record 'run_3'; near it: run_2, run_1",
        ),
        ("engines = [1, 2]", "engine = [1, 2]", "engine.engine: unknown key; near it: engines"),
        ("[controls.column]", "[controls.colum]", "controls.colum: unknown key; near it: column"),
        (
            "Ch_e = 1",
            "Ch_r = 1",
            "controls.column.model: unknown hinge-moment coefficient 'Ch_r'; near it: Ch_e",
        ),
        (
            "Ch_e = 1 + alpha",
            "Ch_e = 1 + alfa",
            "controls.column.model: unknown quantity 'alfa'; near it: alpha",
        ),
        (
            "driven =",
            'constants = ["frictoin"]\ndriven =',
            "controls.column.constants: unknown term of the force 'frictoin'; near it: friction",
        ),
        ('"10 deg", ', "", "engine.pla.1: missing; give it"),
        (
            "engines =",
            'climbs = "climbs.csv"\nengines =',
            "engine.polar: missing; climbs need CD0 and K of the drag polar",
        ),
        ("lift = 0.2", "lfit = 0.2", "gear.errors: unknown source of error 'lfit'; near it: lift"),
        (
            "lift = 0.2",
            "lift = -0.2",
            "gear.errors.lift: input should be greater than or equal to 0",
        ),
        (
            'models = ["CL = 1 + alpha"]',
            'models = ["CL = 1 + alfa"]',
            "ground_effect.models: unknown quantity 'alfa'; near it: alpha",
        ),
    ],
)
def test_faulty_submodels(write, old, new, words):
    path = write()
    assert old in SUBMODELS
    path.write_text(path.read_text() + SUBMODELS.replace(old, new))
    assert any(words in text for text in problems(path)), problems(path)


def test_an_engine_without_records(write):
    path = write()
    path.write_text(path.read_text() + "[engine]\nrate = 10.0\n")
    assert problems(path) == ["engine: no records; give flown, flights, starts, points or climbs"]


def test_a_copy_with_changes_takes_only_keys_of_the_file(write):
    project = read_project(write())
    other = project.with_changes(unplaced="warn")
    assert (project.unplaced, other.unplaced, other.file) == ("raise", "warn", project.file)
    with pytest.raises(TypeError, match="fits: not a key of a project file"):
        project.with_changes(fits=())


PRIOR = """
[[prior]]
files = "avl/*.st"
length_unit = "ft"
controls = { rudder = "-delta_r" }
"""


def with_priors(write, text, files=("avl/a0.st", "avl/a4.st", "tunnel.nc", "map.toml")):
    """Return a project file with further a-priori sources."""
    path = write(("[terms", f"{text}\n[terms"))
    for name in files:
        file = path.parent / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
    return path


def test_a_prior_names_its_files_and_what_they_do_not_state(write):
    project = read_project(with_priors(write, PRIOR))
    (section,) = project.prior
    assert [file.name for file in section.files] == ["a0.st", "a4.st"]
    assert section.options()["length_unit"] == pytest.approx(0.3048)
    assert section.options()["reference"] is None
    # the files are inputs of the report
    assert set(section.files) <= set(inputs_of(project, []))
    known = PRIOR + 'S = "174 ft2"\ncbar = 1.5\nb = 11.0\nx_ref = 2.3\n'
    (section,) = read_project(with_priors(write, known)).prior
    area = section.options()["reference"].S
    assert area == pytest.approx(16.165, abs=1e-3)


def test_a_project_may_have_no_datcom_listing(write):
    path = with_priors(write, PRIOR)
    assert read_project(path).own_models == ("prior", "corrected", "final")
    text = path.read_text()
    listings = '[listings]\nclean = "clean.out"\naltitude = "10000 ft"\n'
    assert listings in text
    path.write_text(text.replace(listings, ""))
    project = read_project(path)
    assert project.listings.places() == []
    assert prior_step(project) == "read 1 source, build the a-priori database"
    path.write_text(text.replace('clean = "clean.out"', 'flaps = "clean.out"'))
    assert problems(path) == [
        "listings.clean: missing, with listings of flaps; give the listing of the whole aeroplane "
        "without deflections"
    ]
    path.write_text(text.replace(listings, "").replace(PRIOR, ""))
    assert problems(path) == [
        "listings: no a-priori source; give listings.clean, a Digital DATCOM listing, or a table "
        "[[prior]] with outputs of another program"
    ]


def test_faults_of_a_prior_are_listed(write):
    wrong = PRIOR.replace('"ft"', '"furlong"').replace("controls", "S = 16.0\ncontrols")
    found = problems(with_priors(write, wrong))
    assert found[0] == "prior.0: cbar, b, x_ref missing; S, cbar, b, x_ref go together"
    assert found[1].startswith("prior.0.length_unit: ")
    database = '[[prior]]\nfiles = ["tunnel.nc"]\nmach = 0.2\n'
    assert problems(with_priors(write, database)) == [
        "prior.0: mach with a database, which states it; leave it out"
    ]
    absent = problems(write(("[terms", "[[prior]]\nfiles = 'none/*.st'\n[terms")))
    assert absent[0].startswith("files: no file matches 'none/*.st'")
    empty = problems(write(("[terms", "[[prior]]\nfiles = []\n[terms")))
    assert empty[0] == "files: an empty list; give a file or a pattern such as 'folder/*'"
    drag = problems(with_priors(write, f"{PRIOR}CD0 = nan\n"))
    assert "prior.0.CD0" in drag[0]
    assert "finite number" in drag[0]
    alone = problems(write(('cutoff = "4 Hz"', 'take = { "Cn/*" = "AVL" }')))
    assert alone == ["take: chooses among several sources; give more [[prior]] tables"]


def test_a_faulty_file_of_ice_is_a_problem_of_the_project(write):
    path = with_priors(write, "", files=("ice.toml",))
    text = path.read_text().replace('cutoff = "4 Hz"', 'ice = "ice.toml"')
    path.write_text(text)
    found = problems(path)
    assert {line.partition(":")[0] for line in found} == {"ice"}
    assert any("title" in line for line in found)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_case_file_that_is_a_pipe_is_a_problem(tmp_path):
    (tmp_path / "a.toml").write_text("")
    os.mkfifo(tmp_path / "b.toml")
    folder = ProjectFolder(tmp_path / "aeromatch.toml")
    assert folder.matching("*.toml", "cases") == []
    (problem,) = folder.problems
    assert problem.startswith("cases: ")
    assert "b.toml: found a named pipe or a device" in problem
