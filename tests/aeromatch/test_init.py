"""`aeromatch init`: names and units of columns, geometry of the cards, and a folder that the next
verb reads.
"""

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io

import flightmech
import flighttest
import pom
from aeromatch.cli.actions.examples import copy_example
from aeromatch.drafting.flown import held_for_proof
from aeromatch.drafting.folder import StatedFacts, draft_project
from aeromatch.drafting.name_map.names import draft_names
from aeromatch.planning.match_plan import make_plan
from aeromatch.project.project import read_project
from flightmech.errors import SchemaError
from flightmech.units import DEGREE, FOOT, G0, KNOT, POUND_FORCE
from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres, named_by_response

T37 = Path(__file__).parents[2] / "data" / "t37"
C182 = T37.parent / "c182"
CLEAN = T37 / "datcom" / "t37_clean.out"
MASS = StatedFacts(values={"mass": "2150 kg", "Ixx": "10826", "Iyy": "8135 kg m2", "Izz": "15162"})
COLUMNS = {  # column of the recorder: canonical name, what one of the recorder is in SI
    "RollRate": ("p", DEGREE),
    "PitchRate": ("q", DEGREE),
    "YawRate": ("r", DEGREE),
    "Bank": ("phi", DEGREE),
    "Pitch": ("theta", DEGREE),
    "HdgTrue": ("psi", DEGREE),
    "Nx": ("ax_imu", G0),
    "Ny": ("ay_imu", G0),
    "Nz": ("az_imu", -G0),
    "AOA": ("alpha_vane", DEGREE),
    "Sideslip": ("beta_vane", DEGREE),
    "KCAS": ("V_cas", KNOT),
    "PressAlt_ft": ("h_baro", FOOT),
    "Elev_deg": ("delta_e", DEGREE),
    "AIL_deg": ("delta_a", -DEGREE),  # a recorder that counts right roll as positive
    "Rud_deg": ("delta_r", DEGREE),
    "Thrust_L_lbf": ("engine1.thrust", POUND_FORCE),
    "Thrust_R_lbf": ("engine2.thrust", POUND_FORCE),
}


@pytest.fixture(scope="module")
def flown():
    """Ninety seconds of a T-37 record: 3-2-1-1 and doublets, in SI."""
    record = flighttest.read(T37 / "flight" / "t37_01_clean_low_speed_5kft.nc", T37 / "names.toml")
    return flighttest.cut(record, 5.0, 95.0)


@pytest.fixture(scope="module")
def columns(flown):
    time = flown["time"].values
    return {"Time_ms": np.round(1000.0 * time)} | {
        name: flown[own].values / one for name, (own, one) in COLUMNS.items()
    }


@pytest.fixture(scope="module")
def recordings(columns, tmp_path_factory):
    """The record twice, as CSV files of a recorder with names and units of its own."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("monday", "tuesday"):
        pd.DataFrame({**columns, "Event": 0.0}).to_csv(
            folder / f"{name}.csv", index=False, float_format="%.7g"
        )
    return folder


@pytest.fixture(scope="module")
def drafted(recordings, tmp_path_factory):
    folder = tmp_path_factory.mktemp("project") / "mine"
    return folder, draft_project(folder, [CLEAN], [recordings], MASS)


@pytest.mark.slow
def test_recorded_channels_come_back_in_si(drafted, flown):
    """Units by name and by size, the milliseconds of the clock, the load factor upwards and the
    reversed aileron.
    """
    folder, _ = drafted
    record = flighttest.read(
        next(folder.parent.parent.glob("recordings*/monday.csv")), folder / "names.toml"
    )
    for name, _ in COLUMNS.values():
        leaf = flighttest.records.record.find_channel_leaf(record, name)
        np.testing.assert_allclose(
            record[leaf][name].values,
            flown[name].values,
            rtol=1e-5,
            atol=1e-5 * np.abs(flown[name].values).max(),
        )
    np.testing.assert_allclose(record["imu"]["time"].values, flown["time"].values, atol=6e-4)
    assert "Event" in (folder / "names.toml").read_text()


@pytest.mark.slow
def test_every_drafted_file_passes_the_checks_of_the_product(drafted):
    folder, done = drafted
    assert done.complete
    project = read_project(folder / "aeromatch.toml")
    aircraft = flightmech.read_aircraft(folder / "aircraft.toml")
    assert aircraft.mass == 2150.0
    assert len(aircraft.engines) == 2
    assert {fit.name.partition(",")[0] for fit in project.fit} == {"pitch", "roll and yaw"}
    assert set(flighttest.records.read_manoeuvres(folder / "manoeuvres.csv")) == {
        "monday",
        "tuesday",
    }
    for file in project.cases:
        case = pom.read_case(file)
        assert (
            Path(case.record).stem == "tuesday"
        )  # the last of each test proves, the others identify
    assert {file.stem for file in project.cases} == {"short_period", "roll_response", "dutch_roll"}
    assert any("inertial unit" in text for text in done.remarks)


def test_what_a_case_replays_does_not_identify(drafted):
    folder, _ = drafted
    project = read_project(folder / "aeromatch.toml")
    cases = [pom.read_case(file) for file in project.cases]
    marks = flighttest.records.read_manoeuvres(folder / "manoeuvres.csv")
    for fit in project.fit:
        for record in fit.records:
            named = [
                row
                for row in marks[record].to_dict("records")
                if f"{row['manoeuvre']} {row['control']}" in fit.manoeuvres
            ]
            spans = [*fit.window, *((row["start"], row["end"]) for row in named)]
            for case in cases:
                assert Path(case.record).stem != record or all(
                    a >= case.window[1] or b <= case.window[0] for a, b in spans
                )


def test_a_file_of_another_origin_is_left_alone(tmp_path, aeromatch):
    (tmp_path / "aircraft.toml").write_text("mine = 1\n")
    done = aeromatch("init", tmp_path, "--datcom", CLEAN)
    assert done.returncode == 0
    assert "aircraft.toml: not drafted by init, and left alone" in done.stderr
    assert (tmp_path / "aircraft.toml").read_text() == "mine = 1\n"


def test_what_nobody_knows_is_marked_and_refused_with_a_sentence(tmp_path, aeromatch):
    done = aeromatch("init", tmp_path / "new", "--datcom", CLEAN, "--json")
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert not found["complete"]
    assert {"mass", "Ixx", "Iyy", "Izz"} <= {text.split()[0] for text in found["remarks"]}
    with pytest.raises(SchemaError, match="mass: not given yet; write a number in kg"):
        flightmech.read_aircraft(tmp_path / "new" / "aircraft.toml")
    project = tmp_path / "new" / "aeromatch.toml"
    project.write_text(
        project.read_text() + '[[fit]]\nname="a"\nrecords=["a"]\nwindow=[0,1]\nmodels=["CL = 1"]\n'
    )
    with pytest.raises(SchemaError, match="flights: '\\?' stands for files"):
        read_project(project)


def test_an_error_leaves_nothing_behind(tmp_path):
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n2,3\n")
    with pytest.raises(SchemaError, match="no column"):
        draft_project(tmp_path / "new", [CLEAN], [tmp_path / "notes.csv"], MASS)
    assert not (tmp_path / "new").exists()
    with pytest.raises(SchemaError, match="no listing, deck or recording"):
        draft_project(tmp_path / "empty", [], [], MASS)


@pytest.mark.slow
def test_matlab_structure_with_names_of_its_own(columns, tmp_path):
    content = {name: values for name, values in columns.items() if name != "Time_ms"}
    scipy.io.savemat(
        tmp_path / "flight.mat", {"rec": {"time": columns["Time_ms"] / 1000.0, **content}}
    )
    rows = {row.name: row.channel for row in draft_names([tmp_path / "flight.mat"]).rows}
    assert {name for name, _ in COLUMNS.values()} == set(rows)
    assert rows["az_imu"].sign == -1
    assert rows["theta"].unit == "deg"


def test_a_canonical_record_needs_no_map(flown, tmp_path):
    canonical = pd.DataFrame(
        {"time": flown["time"].values}
        | {name: flown[name].values for name in ("p", "q", "r", "theta")}
    )
    file = tmp_path / "canonical.csv"
    file.write_text(
        "time,p [rad/s],q [rad/s],r [rad/s],theta [rad]\n"
        + canonical.to_csv(index=False, header=False)
    )
    draft = draft_names([file])
    assert draft.identity
    assert draft.mapping() is None


def test_texts_are_toml_with_a_comment_for_every_key(drafted):
    folder, _ = drafted
    for file in folder.glob("*.toml"):
        text = file.read_text()
        tomllib.loads(text)
        assert text.startswith("#")


@pytest.mark.nightly
def test_folders_inside_are_looked_into_and_cases_have_names_of_their_own(tmp_path):
    """The light-aircraft example: listings and recordings in a folder each, two cases of one
    test.
    """
    copy_example("c182", tmp_path / "new", inputs_only=True)
    flight = tmp_path / "new" / "flight"
    # A case needs the propeller.
    shutil.copy(C182 / "aircraft.toml", tmp_path / "new")
    for name in (
        "cruise",
        "fast",
        "check_roll",
        "check_power",
        "check_dutch_roll",
        "check_phugoid",
    ):
        (flight / f"{name}.csv").unlink()
    (flight / "again.csv").write_bytes((flight / "check_short_period.csv").read_bytes())
    done = draft_project(tmp_path / "new", known=MASS, prove=["check_short_period", "again"])
    assert [row[0] for row in done.roles] == sorted(
        file.name for file in (tmp_path / "new" / "datcom").glob("*.out")
    )
    assert set(done.records) == {"slow", "check_short_period", "again"}
    cases = [pom.read_case(file) for file in (tmp_path / "new" / "cases").glob("*.toml")]
    assert sorted(case.name for case in cases) == ["short_period_1", "short_period_2"]
    mapped = (tmp_path / "new" / "names.toml").read_text()
    assert 'vn = "GS North"' in mapped
    assert 'mass = "Gross Wt"' in mapped


# What the flights were flown for, by the marks of the records.  Without marks: the roll into the
# bank of the spiral is a roll response
# as well; the deceleration before the slam is a power change too; runs on the ground (25, 71, 72),
# the turns (56) and the release of the
# pedals (55, a pulse of the rudder to who sees the surface alone) are not recognised.
_PROOFS = {
    "21_val_short_period_full_flaps_gear_down": "2.c.10",
    "22_val_roll_response_clean": "2.d.2",
    "23_val_power_chop": "2.c.1",
    "24_val_power_slam": "2.c.1 2.c.1",
    "26_val_phugoid": "2.c.9",
    "27_val_dutch_roll": "2.d.7",
    "28_val_spiral": "2.d.2 2.d.4",
    "29_val_flap_change": "2.c.2",
    "30_val_gear_change": "2.c.4",
    "32_val_rudder_approach": "2.d.6",
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", _PROOFS)
def test_records_of_the_t37_are_drafted_as_what_they_were_flown_for(name):
    record = flighttest.read(T37 / "flight" / f"t37_{name}.nc", T37 / "names.toml")
    marked = held_for_proof(
        {"a": named_by_response(record, flighttest.records.marked_manoeuvres(record))}, ["a"], ["a"]
    )
    found = held_for_proof({"a": find_manoeuvres(record)}, ["a"], ["a"])
    assert " ".join(case.test for case in found) == _PROOFS[name]
    assert {case.test for case in marked} == {_PROOFS[name].split()[-1]}


def test_an_engine_is_judged_where_its_speed_is_recorded():
    chop = pd.DataFrame(
        [("throttle_chop", "throttle", 10.0, 15.0)],
        columns=["manoeuvre", "control", "start", "end"],
    )
    assert [case.test for case in held_for_proof({"a": chop}, ["a"], ["a"])] == ["1.f.2"]
    assert held_for_proof({"a": chop}, ["a"], []) == []


@pytest.mark.nightly
def test_an_unknown_column_is_found_corrected_and_kept(columns, tmp_path):
    """The elevator in a column E1: it is named as a candidate, and the author's line stays."""
    renamed = {("E1" if name == "Elev_deg" else name): values for name, values in columns.items()}
    flight = tmp_path / "monday.csv"
    pd.DataFrame({**renamed, "Event": 0.0}).to_csv(flight, index=False, float_format="%.7g")
    folder = tmp_path / "project"
    first = draft_project(folder, [CLEAN], [flight], MASS)
    assert {row.column for row in first.columns if row.quantity == "-"} == {"E1", "Event"}
    assert any(text.startswith("no elevator (delta_e)") for text in first.remarks)
    (candidate,) = [text for text in first.remarks if text.startswith("column E1 moves")]
    assert 'delta_e = { column = "E1", unit = "..." }' in candidate

    names = folder / "names.toml"
    text = names.read_text()
    mine = 'delta_e = { column = "E1", unit = "deg" }   # mine\n'
    names.write_text(text.replace("[controls]\n", f"[controls]\n{mine}"))
    again = draft_project(folder)
    assert mine in names.read_text()
    assert "#   E1" not in names.read_text()
    assert mine in (folder / "names.toml.1.bak").read_text()
    assert any("elevator" in flown for flown in again.records["monday"]["manoeuvres"])
    (row,) = [row for row in again.columns if row.quantity == "delta_e"]
    assert (row.column, row.confidence) == ("E1", "as you wrote it")
    assert flightmech.read_aircraft(folder / "aircraft.toml").mass == 2150.0
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    draft_project(folder)
    assert {file: file.read_bytes() for file in before} == before


@pytest.mark.nightly
def test_a_map_outside_of_the_project_is_used_as_it_stands(recordings, drafted, tmp_path):
    folder, _ = drafted
    (tmp_path / "mine.toml").write_bytes((folder / "names.toml").read_bytes())
    flight = recordings / "monday.csv"
    done = draft_project(tmp_path / "new", [CLEAN], [flight], MASS, own_map=tmp_path / "mine.toml")
    assert not (tmp_path / "new" / "names.toml").exists()
    assert {row.confidence for row in done.columns} == {"as you wrote it", "not taken"}
    project = read_project(tmp_path / "new" / "aeromatch.toml")
    assert project.names.resolve() == (tmp_path / "mine.toml").resolve()


@pytest.mark.nightly
def test_answers_and_edits_of_every_file_stay(recordings, tmp_path):
    folder, flight = tmp_path / "project", recordings / "monday.csv"
    draft_project(folder, [CLEAN], [flight], StatedFacts(values={"mass": "2150 kg"}))
    aircraft, project = folder / "aircraft.toml", folder / "aeromatch.toml"
    aircraft.write_text(aircraft.read_text().replace('Ixx = "?"', 'Ixx = "10826 kg m2"'))
    project.write_text(project.read_text() + "\n[errors]\nmass = 0.004\n")
    table = pd.read_csv(folder / "manoeuvres.csv")
    table["end"] += 0.5
    table.to_csv(folder / "manoeuvres.csv", index=False)
    done = draft_project(folder, known=StatedFacts(values={"Iyy": "8135 kg m2"}))
    text = aircraft.read_text()
    assert 'mass = "2150 kg"' in text
    assert 'Ixx = "10826 kg m2"' in text
    assert 'Iyy = "8135 kg m2"' in text
    assert tomllib.loads(project.read_text())["errors"] == {"mass": 0.004}
    assert pd.read_csv(folder / "manoeuvres.csv")["end"].tolist() == table["end"].tolist()
    assert (folder / "aircraft.toml.1.bak").read_text().count('"?"') == 2
    assert not done.complete  # Izz
    assert [text for text in done.remarks if "replace the '?'" in text] == [
        "Izz is not known: replace the '?' in aircraft.toml"
    ]
    cases = sorted((folder / "cases").glob("*.toml"))
    cases[0].unlink()
    table.to_csv(folder / "manoeuvres.csv", index=False, sep=";", decimal=",")
    done = draft_project(folder)
    assert not cases[0].exists()
    assert any(f"{cases[0].name}: removed by you" in text for text in done.remarks)
    assert pd.read_csv(folder / "manoeuvres.csv")["end"].tolist() == table["end"].tolist()
    draft_project(folder, force=True)
    assert cases[0].exists()
    assert pd.read_csv(folder / "manoeuvres.csv")["end"].tolist() != table["end"].tolist()
    assert (folder / "manoeuvres.csv.1.bak").exists()


def _check_random_columns(columns, folder, seed):
    """Draft a record with ten columns renamed or removed, and plan its match."""
    rng = np.random.default_rng(seed)
    chosen = [str(name) for name in rng.choice(list(COLUMNS), 10, replace=False)]
    kept = {}
    for name, values in columns.items():
        if name not in chosen:
            kept[name] = values
        elif rng.random() < 0.5:
            kept[f"X{rng.integers(1000)}"] = values
    flight = folder / "flight.csv"
    folder.mkdir(parents=True)
    pd.DataFrame(kept).to_csv(flight, index=False, float_format="%.7g")
    done = draft_project(folder / "project", [CLEAN], [flight], MASS)
    assert done.complete, chosen
    plan = make_plan(read_project(folder / "project" / "aeromatch.toml"), folder / "out")
    assert plan.problems == [], chosen


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0, 1])
def test_a_drafted_project_is_accepted_by_match(columns, tmp_path, seed):
    _check_random_columns(columns, tmp_path / "new", seed)


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 50))
def test_every_drafted_project_is_accepted_by_match(columns, tmp_path, seed):
    _check_random_columns(columns, tmp_path / "new", seed)


@pytest.fixture(scope="module")
def propelled():
    """A record of the C182 as its recorder writes it, by heading."""
    table = pd.read_csv(C182 / "flight" / "check_short_period.csv", dtype=str)
    return {name: table[name] for name in table}


def _check_propelled(columns, folder, aircraft):
    """Draft a record of the C182 and plan its match; return the draft and the plan."""
    shutil.copytree(C182 / "datcom", folder / "datcom")
    if aircraft:
        shutil.copy(C182 / "aircraft.toml", folder)
    pd.DataFrame(columns).to_csv(folder / "flight.csv", index=False)
    done = draft_project(folder, known=MASS)
    assert done.complete
    plan = make_plan(read_project(folder / "aeromatch.toml"), folder / "out")
    return done, plan


@pytest.mark.nightly
def test_without_thrust_and_propeller_the_match_still_accepts(propelled, tmp_path):
    """Nothing is drafted that no thrust can serve; the propeller in the file makes fit and
    cases.
    """
    folder = tmp_path / "new"
    done, plan = _check_propelled(propelled, folder, aircraft=False)
    assert plan.problems == []
    assert (len(plan.project.fit), len(plan.cases)) == (0, 0)
    (remark,) = [text for text in done.remarks if "thrust" in text]
    assert remark.startswith("no thrust and no propeller: no coefficient can be computed")
    assert "flight neither identifies nor proves: give each [[engine]]" in remark
    # The lines of the author replace the drafted ones.
    shutil.copy(C182 / "aircraft.toml", folder)
    again = draft_project(folder)
    assert not any("thrust" in text for text in again.remarks)
    plan = make_plan(read_project(folder / "aeromatch.toml"), folder / "out")
    assert plan.problems == []
    assert [fit.name for fit in plan.project.fit] == ["pitch"]


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("aircraft", [False, True])
@pytest.mark.parametrize("seed", range(15))
def test_every_draft_of_a_propeller_aircraft_is_accepted(propelled, tmp_path, seed, aircraft):
    """Ten columns are renamed or removed, with the drafted aircraft and with that of the author."""
    rng = np.random.default_rng(seed)
    chosen = [str(name) for name in rng.choice(list(propelled)[1:], 10, replace=False)]
    kept = {}
    for name, values in propelled.items():
        if name not in chosen:
            kept[name] = values
        elif rng.random() < 0.5:
            kept[f"X{rng.integers(1000)}"] = values
    _, plan = _check_propelled(kept, tmp_path / "new", aircraft)
    assert plan.problems == [], chosen


def test_an_unknown_proving_record_is_refused(recordings, tmp_path):
    with pytest.raises(SchemaError, match="unknown record 'mondya'; near it: monday"):
        draft_project(tmp_path / "mine", [CLEAN], [recordings], MASS, prove=["mondya"])
    assert not (tmp_path / "mine").exists()


def test_a_stated_mass_in_another_unit_is_refused(tmp_path):
    facts = StatedFacts(values={"mass": "2280 lbm2", "Ixx": "10826"})
    with pytest.raises(SchemaError, match="mass = '2280 lbm2'"):
        draft_project(tmp_path / "mine", [CLEAN], [], facts)


@pytest.mark.nightly
def test_sources_and_an_outside_map_are_requested_once(recordings, drafted, tmp_path):
    """New listings do not drop the recordings, and the map of the author stays his map."""
    mapped, _ = drafted
    (tmp_path / "mine.toml").write_bytes((mapped / "names.toml").read_bytes())
    folder, flight = tmp_path / "new", recordings / "monday.csv"
    draft_project(folder, [CLEAN], [flight], MASS, own_map=tmp_path / "mine.toml")
    again = draft_project(folder, [CLEAN])
    assert set(again.records) == {"monday"}
    assert not (folder / "names.toml").exists()
    assert {row.confidence for row in again.columns} == {"as you wrote it", "not taken"}


def test_a_latitude_in_degrees_without_their_unit_is_refused(tmp_path):
    given = StatedFacts(values={"latitude": "48"})
    with pytest.raises(
        SchemaError, match=r"--latitude: latitude 48 rad is 2750\.2 deg; .*'48 deg'"
    ):
        draft_project(tmp_path, known=given)


@pytest.mark.nightly
def test_an_edited_case_stays_with_its_flight(recordings, tmp_path):
    folder = tmp_path / "new"
    monday, tuesday = (recordings / f"{name}.csv" for name in ("monday", "tuesday"))
    draft_project(folder, [CLEAN], [monday], MASS)
    case = folder / "cases" / "short_period.toml"
    if not case.exists():
        pytest.fail(f"cases: {[file.name for file in (folder / 'cases').iterdir()]}")
    edited = case.read_text() + "\n[conditions]\nmass = 2300.0\n"
    case.write_text(edited)
    done = draft_project(folder, records=[monday, tuesday])
    assert case.read_text() == edited
    assert any("another record or window" in text for text in done.remarks)


def test_a_file_that_is_left_alone_stays_alone(tmp_path):
    (tmp_path / "aircraft.toml").write_text("name = 'mine'\n")
    for _ in range(2):
        draft_project(tmp_path, [CLEAN], known=MASS)
        assert (tmp_path / "aircraft.toml").read_text() == "name = 'mine'\n"
