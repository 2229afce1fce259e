import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
import flighttest
import pom
from aeromatch.project.files import Listings
from aeromatch.project.model_sections import NewTerm
from aeromatch.project.priors import PriorSection
from aeromatch.project.project import read_project
from aeromatch.project.sections import Controls, GroundEffectSection, RecordSelection
from aeromatch.workflow.aerodynamics import (
    WAYS,
    a_priori,
    add_missing_terms,
    compare_tables,
    final_database,
    fit_records,
    reconstruct_records,
    samples_of,
)
from aeromatch.workflow.faulty_samples import list_faults, without_faults
from aeromatch.workflow.windows import (
    IdentificationWindows,
    find_copied_records,
    inputs_of,
    marks_of,
    parts_in_spans,
    records_of,
    rests_on,
    samples_of_copies,
    select_windows,
    spans_of,
)
from flightmech import terms
from flightmech.errors import AeromatchWarning, SchemaError
from pom.checking.case_check import SampleFault

DATA = Path(__file__).parents[2] / "data" / "t37"
MANOEUVRES = [
    {"manoeuvre": "3211", "control": "elevator", "start": 1.0, "end": 4.0},
    {"manoeuvre": "doublet", "control": "elevator", "start": 4.0, "end": 6.0},
    {"manoeuvre": "doublet", "control": "rudder", "start": 6.0, "end": 9.0},
]


@pytest.fixture(scope="module")
def shipped():
    return read_project(DATA / "aeromatch.toml")


@pytest.fixture(scope="module")
def prior(shipped):
    """The a-priori database of the clean aeroplane alone."""
    clean = shipped.with_changes(listings=Listings.model_construct(clean=shipped.listings.clean))
    return a_priori(clean, flightmech.read_aircraft(shipped.aircraft))


@pytest.mark.nightly
def test_the_a_priori_database_needs_no_listing():
    """Of one source it is that source, with the rudder that DATCOM does not have."""
    light = read_project(DATA.parent / "c182" / "aeromatch.toml")
    section = PriorSection.model_construct(
        files=tuple(sorted((DATA.parent / "avl").glob("*.st"))),
        length_unit="ft",
        controls={"elevator": "+delta_e", "aileron": "+delta_a", "rudder": "-delta_r"},
        CD0=0.027,
    )
    without = light.with_changes(listings=Listings(), prior=(section,))
    db = a_priori(without, flightmech.read_aircraft(light.aircraft))
    assert db.attrs["source"] == "AVL"
    assert "Cn/rudder" in aerodb.terms(db)
    assert without.prior_model == "prior"


@pytest.fixture
def project(shipped, tmp_path):
    """A project with one small record and one fit."""
    q = xr.Dataset({"q": ("time", np.zeros(11), {"units": "rad s-1"})}, {"time": np.arange(11.0)})
    tree = xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs={"manoeuvres": json.dumps(MANOEUVRES)}), "/imu": q}
    )
    tree.to_netcdf(tmp_path / "run_1.nc", engine="h5netcdf")
    (tmp_path / "names.toml").write_text('[imu]\nq = "q"\n')
    fit = shipped.fit[0].model_copy(
        update={
            "records": ("run_1",),
            "manoeuvres": ("3211 elevator",),
            "models": ("CL = 1 + alpha",),
        }
    )
    return shipped.with_changes(
        names=tmp_path / "names.toml",
        flights={"run_1": tmp_path / "run_1.nc"},
        fit=(fit,),
        terms={},
        held=(),
        controls=Controls(),
        gear=None,
        ground_effect=None,
    )


def fitted(project, *manoeuvres):
    return project.with_changes(fit=(project.fit[0].model_copy(update={"manoeuvres": manoeuvres}),))


def windows_of(project):
    return select_windows(
        project,
        {name: flighttest.read(file, project.names) for name, file in project.flights.items()},
    )


def test_the_rows_of_a_table_stand_in_place_of_the_marks_of_a_record(project, tmp_path):
    (tmp_path / "manoeuvres.csv").write_text(
        "record,kind,control,start,end\nrun_1,doublet,elevator,2,3\n"
    )
    given = fitted(project, "doublet elevator").with_changes(manoeuvres=tmp_path / "manoeuvres.csv")
    records = {"run_1": flighttest.read(project.flights["run_1"], project.names)}
    assert select_windows(given, records).fits == [{"run_1": [(2.0, 3.0)]}]
    del records["run_1"].attrs["manoeuvres"]
    assert select_windows(given, records).fits == [{"run_1": [(2.0, 3.0)]}]
    assert tmp_path / "manoeuvres.csv" in inputs_of(given, ["run_1"])
    (tmp_path / "manoeuvres.csv").write_text(
        "record,kind,control,start,end\nrun1,doublet,elevator,2,3\n"
    )
    with pytest.raises(SchemaError, match="manoeuvres: unknown record 'run1'; near it: run_1"):
        select_windows(given, records)


def test_faulty_samples_are_cut_out_of_the_windows_of_the_fits(project):
    windows = IdentificationWindows([{"run_1": [(1.0, 4.0), (4.0, 9.0)]}], {})
    held = SampleFault(("q",), "held", 5.0, 6.0)
    cut, texts = without_faults(project, windows, {"run_1": [held]})
    # half a second about it, and the remainder of half a second before it is too short
    assert cut.fits == [{"run_1": [(1.0, 4.0), (6.5, 9.0)]}]
    (text,) = texts
    assert text.endswith(
        "record run_1: held values of q from 5 to 6 s left out, with 0.5 s on both sides; the "
        "reconstruction of the states still uses them"
    )
    gaps = [SampleFault((name,), "gap", 34.0, 36.0) for name in ("q", "alpha_vane")]
    assert list_faults({"run_1": [held, *gaps], "run_2": []}) == [
        "run_1: held values of q from 5 to 6 s, gap in the clock from 34 to 36 s"
    ]
    lost = SampleFault(("p", "phi", "q"), "lost", 7.0, 7.02)
    assert list_faults({"run_1": [lost]}) == ["run_1: samples lost in p, q from 7 to 7.02 s"]
    assert without_faults(project, windows, {"run_1": [lost]})[0].fits == [
        {"run_1": [(1.0, 4.0), (4.0, 6.5), (7.52, 9.0)]}
    ]
    # a gap of a group that no fit uses, and a fault outside the windows
    others = [SampleFault(("vn", "ve"), "gap", 5.0, 6.0), SampleFault(("q",), "held", 10.0, 11.0)]
    assert without_faults(project, windows, {"run_1": others}) == (windows, [])
    gap = SampleFault(("p", "q"), "gap", 0.0, 20.0)
    with pytest.raises(SchemaError, match="run_1: its windows hold faulty samples throughout"):
        without_faults(project, windows, {"run_1": [gap]})


def test_faulty_samples_are_cut_out_of_ground_effect_and_stall(project):
    spans = {"run_1": [(-np.inf, np.inf)]}
    names = ("ground_effect.flown", "stall.flown", "engine.flown", "gear.flown")
    windows = IdentificationWindows([], dict.fromkeys(names, spans))
    faults = [
        SampleFault(("alpha_vane",), "held", 2.0, 3.0),
        SampleFault(("engine1.thrust",), "held", 5.0, 6.0),
        SampleFault(("vn",), "missing", 7.0, 8.0),
    ]
    cut, texts = without_faults(project.with_changes(fit=()), windows, {"run_1": faults})
    parts = {"run_1": [(-np.inf, 1.5), (3.5, np.inf)]}
    assert cut.submodels == {
        "ground_effect.flown": parts,
        "stall.flown": parts,
        # transients, which a cut would take apart
        "engine.flown": spans,
        "gear.flown": spans,
    }
    thrust = "record run_1: held values of engine1.thrust from 5 to 6 s not left out"
    assert [text.partition(";")[0] for text in texts if "thrust" in text] == [
        f"{name}, {thrust}" for name in names
    ]
    # the reconstruction replaces the ground velocity, which no coefficient reads
    assert [text.partition(",")[0] for text in texts if "vn" in text] == list(names[2:])
    missing = [SampleFault(("q",), "missing", 0.0, 10.0)]
    windows = IdentificationWindows([], {"stall.flown": {"run_1": [(2.0, 9.0)]}})
    with pytest.raises(SchemaError, match=r"stall\.flown, record run_1: its windows hold faulty"):
        without_faults(project.with_changes(fit=()), windows, {"run_1": missing})


def test_an_empty_part_at_the_end_of_a_whole_record_is_no_record():
    data = {"run_1": xr.Dataset({"q": ("time", np.zeros(100))}, {"time": 0.1 * np.arange(100)})}
    # faults from 0.2 to 1.3 s and from 9.6 s on
    spans = {"run_1": [(-np.inf, -0.3), (1.8, 9.1), (10.1, np.inf)]}
    (part,), names = parts_in_spans(data, spans)
    assert (part["time"].values[0], part["time"].values[-1]) == pytest.approx((1.8, 9.1))
    assert names == ["run_1"]


def test_windows_by_kind_and_by_kind_and_control(project):
    assert windows_of(fitted(project, "doublet elevator")).fits == [{"run_1": [(4.0, 6.0)]}]
    assert windows_of(fitted(project, "doublet", "3211 elevator")).fits == [
        {"run_1": [(4.0, 6.0), (6.0, 9.0), (1.0, 4.0)]}
    ]


def test_windows_by_time_go_with_manoeuvres_or_stand_alone(project):
    def fit(**more):
        content = {"name": "pitch", "records": ["run_1"], "models": ["CL = 1"], **more}
        return windows_of(
            project.with_changes(fit=(type(project.fit[0]).model_validate(content),))
        ).fits

    assert fit(window=[2.0, 5.0]) == [{"run_1": [(2.0, 5.0)]}]
    assert fit(window=[[2.0, 5.0], ["6 s", "8 s"]]) == [{"run_1": [(2.0, 5.0), (6.0, 8.0)]}]
    assert fit(window=[2.0, 5.0], manoeuvres=["doublet elevator"]) == [
        {"run_1": [(4.0, 6.0), (2.0, 5.0)]}
    ]
    with pytest.raises(
        ValueError,
        match=r"neither manoeuvres nor window; give one of them, as window = \[start, end\]",
    ):
        fit()
    with pytest.raises(
        ValueError,
        match=r"a window from 5 to 2 s; give start and end in seconds of the record, the end later",
    ):
        fit(window=[5.0, 2.0])


def test_what_proves_the_model_does_not_identify_it(project):
    """A record may do both, at different times."""
    case = SimpleNamespace(name="a", record="x/run_1.nc", window=(4.0, 9.0))
    read = {name: flighttest.read(file, project.names) for name, file in project.flights.items()}
    apart = select_windows(fitted(project, "3211 elevator"), read, [case])
    assert apart.fits == [{"run_1": [(1.0, 4.0)]}]
    ground = GroundEffectSection(flown=(RecordSelection(records=("run_1",)),), models=("CL = 1",))
    both = fitted(project, "doublet elevator").with_changes(ground_effect=ground)
    with pytest.raises(SchemaError) as caught:
        select_windows(both, read, [case])
    assert caught.value.problems == [
        "fit 'pitch': record run_1 proves case a from 4 to 9 s; it cannot identify too",
        "ground_effect.flown: record run_1 proves case a from 4 to 9 s; it cannot identify too",
    ]


def test_records_that_prove_the_model_give_nothing_to_those_that_identify(project, monkeypatch):
    asked = {}

    def reconstruct(records, aircraft, jobs, validation):
        asked.update(records=records, validation=validation)
        return [f"path of {record}" for record in (*records, *validation)]

    monkeypatch.setattr(flighttest, "reconstruct_programme", reconstruct)
    records = {"proof": "b", "run_1": "a"}
    found = reconstruct_records(project, None, records, 1)
    assert asked == {"records": ["a"], "validation": ["b"]}
    assert found == {"run_1": "path of a", "proof": "path of b"}
    reconstruct_records(project.with_changes(fit=()), None, records, 1)
    assert asked == {"records": ["b", "a"], "validation": []}


def test_the_report_states_which_records_a_number_rests_on(project):
    cases = [
        SimpleNamespace(name="a", record="x/run_2.nc", window=(1.0, 2.0)),
        SimpleNamespace(name="b", record="x/run_1.nc"),
    ]
    windows = IdentificationWindows(
        [{"run_1": [(1.0, 4.0)]}], {"gear.flown": {"run_1": [(0.0, 1.0)]}}
    )
    assert rests_on(project, windows, cases) == {
        "constants of the instruments": "run_1",
        f"fit {project.fit[0].name}": "run_1",
        "gear.flown": "run_1",
        "case a": "run_2",
        "case b": "run_1, which identifies too, at other times",
    }


def test_no_record_of_the_example_both_identifies_and_proves(shipped):
    cases = [pom.read_case(file) for file in shipped.cases]
    assert not {Path(case.record).stem for case in cases} & set(records_of(shipped))


def test_unknown_manoeuvres_are_reported_at_once(project):
    with pytest.raises(SchemaError) as caught:
        windows_of(fitted(project, "3211 elevater", "doublet", "sideslip"))
    first, second = caught.value.problems
    assert first.startswith(
        "fit 'pitch', record run_1: unknown manoeuvre '3211 elevater'; near it: 3211 elevator"
    )
    assert "'sideslip'" in second


def test_records_come_once_and_in_order(project):
    cases = [
        SimpleNamespace(name="a", record="x/run_1.nc"),
        SimpleNamespace(name="b", record="x/run_2.nc"),
    ]
    both = project.with_changes(flights={**project.flights, "run_2": Path("run_2.nc")})
    assert records_of(both, cases) == ["run_1", "run_2"]


def test_a_case_on_a_record_that_is_no_flight_of_the_project(project):
    with pytest.raises(SchemaError, match="case b: unknown record 'run_2'; near it: run_1"):
        records_of(project, [SimpleNamespace(name="b", record="x/run_2.nc")])


def test_cases_have_names_of_their_own(project):
    cases = [SimpleNamespace(name="a", record=f"x/run_{k}.nc") for k in (1, 2)]
    both = project.with_changes(flights={**project.flights, "run_2": Path("run_2.nc")})
    with pytest.raises(SchemaError, match="2 cases are named 'a'"):
        records_of(both, cases)


@pytest.mark.slow
def test_new_terms_are_opened_and_others_stay(project, prior):
    terms = {"CL/gear": NewTerm(regressors=("gear",), stderr=0.05)}
    db = add_missing_terms(project.with_changes(terms=terms, held=("CL/altitude",)), prior)
    gear = aerodb.terms(db)["CL/gear"]
    assert (float(gear["value"]), float(gear["stderr"])) == (0.0, 0.05)
    assert "CL/gear" not in db.attrs["absent"].split()
    assert (aerodb.compare(prior, db).loc[list(aerodb.terms(prior)), "max_difference"] == 0.0).all()


@pytest.mark.slow
def test_a_project_without_new_terms_keeps_the_database(project, prior):
    assert set(aerodb.terms(add_missing_terms(project, prior))) == set(aerodb.terms(prior))


def test_a_held_term_that_is_not_there(project, prior):
    with pytest.raises(SchemaError, match="held: unknown term 'CL/altitud'; near it: CL/altitude"):
        add_missing_terms(project.with_changes(held=("CL/altitud",)), prior)


@pytest.mark.slow
def test_flights_enter_the_tables_in_the_way_that_the_project_names(project):
    """Lift of 0.02 and 0.4 per rad more than the tables have, in each way; the comparison is that
    of all.
    """
    alpha = np.arange(0.0, 0.13, 0.04)
    leaf = terms.make_term(0.2 + 5.0 * alpha, {"alpha": alpha}, stderr=0.05, source="datcom")
    root = dict(
        title="test",
        aircraft="test",
        S=16.0,
        cbar=1.6,
        b=10.0,
        x_ref=0.0,
        y_ref=0.0,
        z_ref=0.0,
        force_axes="stability",
    )
    start = aerodb.make_database({"CL/basic": leaf}, **root)
    t = np.arange(0.0, 4.0, 0.02)
    flown = 0.04 + 0.035 * np.sin(2.0 * t)
    noise = 0.002 * np.random.default_rng(1).normal(size=len(t))
    data = xr.Dataset(
        {"alpha": ("time", flown), "CL": ("time", 0.22 + 5.4 * flown + noise)}, {"time": t}
    )
    windows = IdentificationWindows([{"run_1": [(0.0, 4.0)]}], {})
    fits = fit_records(project, {"run_1": data}, windows, jobs=-1)  # one thread per core
    samples = samples_of(project, start, {"run_1": data}, windows)
    assert [one.attrs["name"] for one in samples] == [fit.name for fit in fits] == ["run_1: pitch"]
    found = {}
    for way in WAYS:
        final, tabulation = final_database(
            project.with_changes(tabulation=way), start, fits, samples
        )
        found[way] = tabulation
        assert float(aerodb.terms(final)["CL/basic"]["value"].sel(alpha=0.04)) == pytest.approx(
            0.436, abs=0.005
        )
    table = compare_tables(project, start, fits, samples, {"tabulate": found["tabulate"]})
    for way, tabulation in found.items():
        np.testing.assert_array_equal(table[f"value {way}"], tabulation["CL/basic"]["value"])


@pytest.mark.filterwarnings("ignore:the project has no")
def test_a_new_title_of_the_project_changes_no_database(project):
    """Otherwise the match would compute diagnosis, models and replays again."""
    alpha = np.arange(0.0, 0.13, 0.04)
    leaf = terms.make_term(0.2 + 5.0 * alpha, {"alpha": alpha}, stderr=0.05, source="datcom")
    root = dict.fromkeys(("S", "cbar", "b"), 1.0) | dict.fromkeys(("x_ref", "y_ref", "z_ref"), 0.0)
    start = aerodb.make_database(
        {"CL/basic": leaf}, title="before", aircraft="Kite", force_axes="stability", **root
    )
    first, _ = final_database(project, start, [])
    second, _ = final_database(project.with_changes(title="Another title"), start, [])
    assert first.attrs == second.attrs
    assert first.attrs["title"] == "Kite: database after flight"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:incompatible fits")  # without the control they are
@pytest.mark.parametrize("way", WAYS)
def test_an_elevator_without_a_table_stops_a_match_in_each_way(project, way):
    """The fit has a significant elevator, the database none: an error, or with `unplaced` of the
    project a warning in the history.
    """
    alpha = np.arange(0.0, 0.13, 0.04)
    leaf = terms.make_term(0.2 + 5.0 * alpha, {"alpha": alpha}, stderr=0.05, source="datcom")
    root = dict(
        title="test",
        aircraft="test",
        S=16.0,
        cbar=1.6,
        b=10.0,
        x_ref=0.0,
        y_ref=0.0,
        z_ref=0.0,
        force_axes="stability",
    )
    start = aerodb.make_database({"CL/basic": leaf}, **root)
    t = np.arange(0.0, 4.0, 0.02)
    flown, elevator = 0.04 + 0.035 * np.sin(2.0 * t), 0.05 * np.cos(5.0 * t)
    lift = 0.2 + 5.0 * flown + 0.5 * elevator + 0.002 * np.random.default_rng(1).normal(size=len(t))
    data = xr.Dataset(
        {"alpha": ("time", flown), "delta_e": ("time", elevator), "CL": ("time", lift)}, {"time": t}
    )
    windows = IdentificationWindows([{"run_1": [(0.0, 4.0)]}], {})
    job = project.with_changes(
        tabulation=way,
        fit=(project.fit[0].model_copy(update={"models": ("CL = 1 + alpha + delta_e",)}),),
    )
    fits = fit_records(job, {"run_1": data}, windows)
    samples = samples_of(job, start, {"run_1": data}, windows)
    with pytest.raises(
        SchemaError, match=r"CL: delta_e of 'run_1: pitch': estimate 0\.[45].*listing for elevator"
    ):
        final_database(job, start, fits, samples)
    with pytest.warns(AeromatchWarning, match="delta_e of 'run_1: pitch'"):
        final, _ = final_database(job.with_changes(unplaced="warn"), start, fits, samples)
    assert "delta_e of 'run_1: pitch'" in final.attrs["history"]


def test_the_inputs_are_every_file_of_the_project(shipped):
    names = records_of(shipped)
    cases = [pom.read_case(file) for file in shipped.cases[:2]]
    files = inputs_of(shipped, names, cases)
    assert shipped.aircraft.with_name("engine.nc") in files
    for case in cases:
        assert {Path(name) for name in case.files()} <= set(files)
    listings = {place.file for places in shipped.listings.by_role.values() for place in places}
    assert {
        shipped.file,
        shipped.aircraft,
        *shipped.cases,
        *listings,
        shipped.flights[names[0]],
    } <= set(files)
    assert all(file.is_file() for file in files)


def test_fits_name_the_flight_modes_of_a_log():
    """Next to the rows of the project's table; records without modes are as before."""
    flights = {"log": Path("log.ulg"), "other": Path("other.nc")}
    project = SimpleNamespace(
        fit=[RecordSelection(records=("log", "other"))],
        submodels={},
        manoeuvres=None,
        flights=flights,
    )
    rows = [
        {"manoeuvre": "stabilized", "control": "", "start": a, "end": b, "note": ""}
        for a, b in ((5.0, 8.0), (12.5, 15.0))
    ]
    listed = {
        "log": {"modes": json.dumps(rows)},
        "other": {"manoeuvres": json.dumps(MANOEUVRES[:2])},
    }
    problems: list[str] = []
    tables = marks_of(
        project,
        {name: xr.DataTree(xr.Dataset(attrs=attrs)) for name, attrs in listed.items()},
        problems,
    )
    assert [len(table) for table in tables.values()] == [2, 2]
    taken = [
        RecordSelection(records=("log",), manoeuvres=("stabilized",)),
        RecordSelection(records=("other",), manoeuvres=("doublet elevator",)),
    ]
    found = spans_of("fit", taken, tables, problems)
    assert problems == []
    assert found == {"log": [(5.0, 8.0), (12.5, 15.0)], "other": [(4.0, 6.0)]}


def test_a_copy_of_a_record_of_the_proof_does_not_identify(shipped):
    """The samples decide, not the name of the file."""
    proof = "t37_21_val_short_period_full_flaps_gear_down"
    folder = shipped.file.parent
    copied = flighttest.read(folder / "flight" / f"{proof}.nc", folder / "names.toml")
    case = SimpleNamespace(name="short", record=f"x/{proof}.nc", window=(0.5, 16.5))
    records = {"pull_ups": copied, proof: copied}
    copies = samples_of_copies([proof], ["pull_ups", proof], records)
    (line,) = find_copied_records([("fit 'pitch'", {"pull_ups": [(1.0, 9.0)]})], copies, [case])
    assert line.startswith(f"fit 'pitch': record pull_ups holds samples of record {proof} (")
    assert line.endswith("proves case short; it cannot identify too")
    # another part of the same flight may identify
    assert find_copied_records([("fit", {"pull_ups": [(17.0, 19.0)]})], copies, [case]) == []
