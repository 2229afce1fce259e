from copy import copy
from functools import partial
from types import SimpleNamespace

import pytest

from aeromatch.project.model_sections import NewTerm
from aeromatch.project.project import read_project
from aeromatch.rebuilding.products import of_cases
from aeromatch.workflow.devices import read_devices
from aeromatch.workflow.windows import inputs_of
from datcom_io.reading.reader import ListingCase
from flightmech.errors import ParseError, SchemaError
from flightmech.units import DEGREE
from pom.replaying.recorded_runs import RecordedRuns

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


def test_a_title_has_200_characters_at_most(write):
    """Each command prints it whole."""
    assert read_project(write(("Toy", "x" * 200))).title == "x" * 200
    with pytest.raises(SchemaError, match="title: string should have at most 200 char") as caught:
        read_project(write(("Toy", "x" * 200_000)))
    assert len(str(caught.value)) < 2000


def test_terms_without_a_place_stop_unless_the_project_allows_them(write):
    assert read_project(write()).unplaced == "raise"
    assert (
        read_project(write(('cutoff = "4 Hz"', 'cutoff = "4 Hz"\nunplaced = "warn"'))).unplaced
        == "warn"
    )
    (text,) = problems(write(('cutoff = "4 Hz"', 'unplaced = "ignore"')))
    assert "unplaced" in text


def test_a_role_may_have_several_listings(write, tmp_path):
    project = read_project(
        write(
            ('clean = "clean.out"', 'clean = "clean.out"\nelevator = ["clean.out", "names.toml"]')
        )
    )
    assert project.listings.by_role["elevator"] == (
        ListingCase(tmp_path / "clean.out"),
        ListingCase(tmp_path / "names.toml"),
    )


def test_what_is_stated_about_the_listings_is_no_role(write):
    project = read_project(write(('clean = "clean.out"', 'clean = "clean.out"\npowered = true')))
    assert list(project.listings.by_role) == ["clean"]
    assert project.listings.statements == {
        "powered": True,
        "tailless": False,
        "move_reference": False,
    }


def test_a_role_may_take_one_case_of_a_listing(write, tmp_path):
    place = "clean.out:TOTAL: small aircraft"
    project = read_project(write(('clean = "clean.out"', f'clean = "{place}"')))
    assert project.listings.by_role["clean"] == (
        ListingCase(tmp_path / "clean.out", "TOTAL: small aircraft"),
    )
    assert problems(write(('clean = "clean.out"', 'clean = "clear.out:2"'))) == [
        f"listings.clean: no file 'clear.out:2' in {tmp_path}; write FILE, or FILE:CASE for "
        f"one case of it"
    ]


def test_a_role_may_have_a_pattern_of_listings(write, tmp_path):
    for name in ("flaps_20.out", "flaps_10.out", "flaps_[x].out"):
        (tmp_path / name).touch()
    clean = 'clean = "clean.out"'
    project = read_project(write((clean, f'{clean}\nflaps = "flaps_*.out:2"')))
    assert project.listings.by_role["flaps"] == (
        ListingCase(tmp_path / "flaps_10.out", "2"),
        ListingCase(tmp_path / "flaps_20.out", "2"),
        ListingCase(tmp_path / "flaps_[x].out", "2"),
    )
    # A name with the letters of a pattern that is a file, and files that two patterns name.
    several = 'flaps = ["flaps_[x].out", "flaps_??.out", "flaps_1*.out"]'
    project = read_project(write((clean, f"{clean}\n{several}")))
    names = [place.file.name for place in project.listings.by_role["flaps"]]
    assert names == ["flaps_[x].out", "flaps_10.out", "flaps_20.out"]
    (text,) = problems(write((clean, f'{clean}\nflaps = "flap-*.out"')))
    assert text.startswith("listings.flaps: no file matches 'flap-*.out'")


def test_a_project_is_read(write, tmp_path):
    project = read_project(write())
    assert project.file == tmp_path / "aeromatch.toml"
    assert list(project.flights) == ["run_1", "run_2"]
    assert project.listings.by_role == {"clean": (ListingCase(tmp_path / "clean.out"),)}
    assert project.listings.altitude == pytest.approx(3048.0)
    assert project.cutoff == 4.0
    assert project.cases == (tmp_path / "case.toml",)
    assert project.fit[0].models == ("CL = 1 + alpha",)


@pytest.mark.parametrize("cutoff", ["0 Hz", "-4 Hz"])
def test_a_low_pass_needs_a_frequency(write, cutoff):
    assert problems(write(("4 Hz", cutoff)))[0].startswith(
        "cutoff: a low-pass needs a frequency of more than 0 Hz; leave the key out"
    )


def test_all_misspelt_keys_are_reported_at_once(write):
    found = problems(
        write(("cutoff", "cutof"), ("regressors", "regresors"), ("manoeuvres", "maneuvers"))
    )
    assert "cutof: unknown key; near it: cutoff" in found
    assert any("regresors: unknown key; near it: regressors" in text for text in found)
    assert any(text.startswith("fit.0.maneuvers: unknown key") for text in found)
    assert len(found) == 3


def test_cases_may_be_given_by_absolute_paths(write, tmp_path):
    assert read_project(write(('["case.toml"]', f'["{tmp_path}/case.*"]'))).cases == (
        tmp_path / "case.toml",
    )


@pytest.mark.parametrize("name", [".", "cases"])
def test_a_folder_is_no_case(write, tmp_path, name):
    (tmp_path / "cases").mkdir()
    (found,) = problems(write(('["case.toml"]', f'["{name}"]')))
    assert found.startswith(f"cases: {name!r} is a folder; name its files")


@pytest.mark.parametrize(
    ("old", "key"), [('["case.toml"]', "cases"), ('"clean.out"', "listings.clean")]
)
def test_a_crowd_of_patterns_is_not_searched_for(write, old, key):
    crowd = "[" + "'none/*', " * 1001 + "]"
    found = problems(write((old, crowd)))
    few = f"{key}: 1001 names or patterns; at most 1000; join them in a pattern"
    assert few in found
    assert not any("none/*" in text for text in found)


def test_a_file_of_another_kind_is_called_by_it(write, tmp_path):
    (tmp_path / "wrong.toml").write_text('name = "x"\nS = 16.0\ncbar = 1.6\nb = 10.0\n')
    (found,) = problems(tmp_path / "wrong.toml")
    assert found.startswith("this is an aircraft file (it has S, cbar)")


def test_all_that_is_not_there_is_reported_at_once(write):
    changes = [
        ('"clean.out"', '"cleen.out"'),
        ('"aircraft.toml"', '"none.toml"'),
        ('["case.toml"]', '["none/*.toml"]'),
        ('["run_1"]', '["run_3"]'),
        ('"CL = 1 + alpha"', '"CL = 1 + alfa"'),
        ('["gear"]', '["geer"]'),
    ]
    found = problems(write(*changes))
    assert len(found) == 6
    text = "\n".join(found)
    assert "listings.clean: no file 'cleen.out'" in text
    assert "aircraft: no file 'none.toml'" in text
    assert "cases: no file matches 'none/*.toml'" in text
    assert "fit.0.records: unknown record 'run_3'; near it: run_2, run_1" in text
    assert "fit.0.models: unknown quantity 'alfa'; near it: alpha" in text
    assert "terms.CL/gear: regressor: unknown quantity 'geer'; near it: gear" in text


def test_no_flights_at_all(write):
    assert any(
        text.startswith("flights: no file matches 'flight/*.csv'")
        for text in problems(write(("flight/*.nc", "flight/*.csv")))
    )


def test_two_recordings_of_one_name(write, tmp_path):
    (tmp_path / "flight" / "run_1.csv").touch()
    (found,) = problems(write(('"flight/*.nc"', '"flight/run_*.*"')))
    assert found.startswith("flights: ")
    assert "run_1.csv" in found
    assert "are both record 'run_1'; rename one" in found
    # a file that two patterns match is one recording
    assert (
        len(read_project(write(('"flight/*.nc"', '["flight/*.nc", "flight/run_1.nc"]'))).flights)
        == 2
    )


def test_a_unit_of_another_quantity(write):
    (found,) = problems(write(('"10000 ft"', '"10000 kt"')))
    assert found.startswith("listings.altitude")


def test_not_toml(write):
    with pytest.raises(ParseError, match="line 2"):
        read_project(write(('"Toy"', "Toy")))


def test_a_new_term_is_zero_with_its_standard_error():
    term = NewTerm(
        axes={"beta": ("-10 deg", 0.0, "10 deg")},
        regressors=("gear",),
        stderr=(0.3, 0.0, 0.3),
        comment="guess",
    )
    leaf = term.leaf()
    assert (leaf["value"] == 0.0).all()
    assert leaf["beta"].values == pytest.approx([-10.0 * DEGREE, 0.0, 10.0 * DEGREE])
    assert leaf["stderr"].values.tolist() == [0.3, 0.0, 0.3]
    assert leaf.attrs["comment"] == "guess"


def test_standard_errors_that_do_not_fit_the_nodes():
    with pytest.raises(SchemaError, match="stderr has 2 values for 3 nodes"):
        NewTerm(axes={"beta": (-0.1, 0.0, 0.1)}, stderr=(0.3, 0.3)).leaf()


def test_models_from_elsewhere_come_with_their_tables_of_names(write, tmp_path):
    (tmp_path / "simulator.fmu").touch()
    models = (
        '[models]\nsimulator = { fmu = "simulator.fmu", names = "names.toml" }\nother = { '
        'fmu = "simulator.fmu" }\n\n[listings]'
    )
    project = read_project(write(("[listings]", models)))
    assert project.fmus == dict.fromkeys(("simulator", "other"), tmp_path / "simulator.fmu")
    assert project.tables == {"simulator": tmp_path / "names.toml"}
    wrong = '[models]\nfinal = { fmu = "gone.fmu" }\n\n[listings]'
    found = problems(write(("[listings]", wrong)))
    assert (
        found[0]
        == "models.final: the name is taken; call it otherwise than flight, datcom, prior, "
        "corrected, "
        "final"
    )
    assert found[1].startswith("models.final.fmu: no file 'gone.fmu' in ")


def test_the_recordings_of_a_device_are_files_of_the_project(write, tmp_path):
    for name in ("device/short.csv", "device/roll.csv", "host.toml", "master.nc"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    device = (
        '[devices.box]\nrecordings = "device/*.csv"\nnames = "host.toml"\nstart = "500 ms"\n'
        'master = "master.nc"\n\n[listings]'
    )
    project = read_project(write(("[listings]", device)))
    box = project.devices["box"]
    assert sorted(box.recordings) == ["roll", "short"]
    assert box.start == 0.5
    assert [file.name for file in box.files] == ["roll.csv", "short.csv", "host.toml", "master.nc"]
    assert set(box.files) <= set(inputs_of(project, []))


def test_a_device_has_a_name_and_cases_of_its_own(write, tmp_path):
    (tmp_path / "rol.csv").touch()
    device = '[devices.final]\nrecordings = "rol.csv"\nrecurrent_share = 0.2\n\n[listings]'
    assert problems(write(("[listings]", device))) == [
        "devices.final: the name is taken; call it otherwise than flight, datcom, prior, "
        "corrected, final"
    ]
    project = read_project(write(("[listings]", device.replace("final", "box"))))
    cases = [SimpleNamespace(name="roll")]
    with pytest.raises(SchemaError) as caught:
        read_devices(project, cases)
    assert caught.value.problems == [
        "devices.box.recordings: unknown case 'rol'; near it: roll",
        "devices.box.recurrent_share: needs master, the report to compare with",
    ]


def test_a_recording_is_an_input_of_the_replay_of_its_case_alone():
    names = ("short", "roll")
    files = dict(names="", aircraft="", law="", law_names="")
    cases = [SimpleNamespace(name=name, record=f"{name}.nc", **files) for name in names]
    for case in cases:
        case.without_texts = partial(copy, case)
        case.contents = tuple  # no files
    run = RecordedRuns()
    inputs = of_cases(
        cases,
        dict.fromkeys(names),
        fmus={},
        tables={},
        evidence=None,
        content=str,
        recorded={"short": run},
    )
    assert inputs["short"]["recorded"] is run
    assert "recorded" not in inputs["roll"]
