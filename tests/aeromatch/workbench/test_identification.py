"""The page of the identification: the fit is that of the command line, and what is shown of it is
true of it.
"""

import json
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from bench import PATIENCE, reconstructed_project, served

import aerodb
import flighttest
from aeromatch.project.editing import set_key
from aeromatch.project.project import read_project
from aeromatch.workbench import coefficients, fit_curves
from aeromatch.workbench import identification as page
from aeromatch.workbench.actions import demand_allowed, make_folders
from aeromatch.workbench.opened import OpenProject
from aeromatch.workbench.processes import Jobs
from aeromatch.workflow.windows import spans_of
from flightmech.errors import IdentificationError, OutOfRange, ParseError, SchemaError, UnknownName
from flighttest.cli.identify import identify_command
from flighttest.regression.combining.mixed_estimation import prior_of
from flighttest.regression.equation_error.fit_file import open_fit

pytestmark = pytest.mark.slow
FIRST, SECOND = "t37_01_clean_low_speed_5kft", "t37_02_clean_cruise_5kft"
PITCH = ("3211 elevator", "doublet elevator")
MODEL = "Cm = 1 + alpha + qhat + delta_e"
PRIOR = "{work}/match/datcom.nc"


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """The T-37's project with two records reconstructed over their first 49 s, and DATCOM's tables
    where a match leaves them.
    """
    folder = tmp_path_factory.mktemp("opened")
    return OpenProject(
        reconstructed_project(folder / "t37", folder / "work", [FIRST, SECOND]), folder / "work"
    )


def windows(opened, *records, names=PITCH):
    rows = {
        record: page.list_record_manoeuvres(opened, {"name": record}, None)["rows"]
        for record in records
    }
    return [
        {"record": record, "start": row["start"], "end": row["end"]}
        for record in records
        for row in rows[record]
        if row["label"] in names
    ]


def wanted(opened, *records, **more):
    return {
        "windows": windows(opened, *(records or (FIRST,))),
        "model": MODEL,
        "cutoff": 4.0,
        **more,
    }


def test_what_can_be_chosen(opened):
    found = page.list_fit_choices(opened, {}, None)
    assert found["records"] == [FIRST, SECOND]
    assert [fit["name"] for fit in found["fits"]] == [fit.name for fit in opened.project.fit]
    assert found["priors"] == [PRIOR]
    assert found["cutoff"] == 4.0
    assert found["file"] == "{project}/aeromatch.toml"
    rows = page.list_record_manoeuvres(opened, {"name": FIRST}, None)["rows"]
    assert [row["label"] for row in rows][:4] == [
        "trim",
        "3211 elevator",
        "recover",
        "doublet elevator",
    ]
    assert (rows[1]["start"], rows[1]["end"]) == (9.0, 21.7)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "more",
    [
        {},
        pytest.param({"intercepts": "separate", "cutoff": None}, marks=pytest.mark.nightly),
        pytest.param(
            {"weights": "robust", "model": "CL = 1 + alpha + delta_e"}, marks=pytest.mark.nightly
        ),
        pytest.param({"ridge": "auto"}, marks=pytest.mark.nightly),
        pytest.param({"ridge": 0.01, "weights": "manoeuvre"}, marks=pytest.mark.nightly),
        pytest.param({"band": [0.1, 2.0]}, marks=pytest.mark.nightly),
        pytest.param(
            {"band": [0.1, 1.7], "ridge": 0.02, "intercepts": "separate"}, marks=pytest.mark.nightly
        ),
    ],
)
def test_the_fit_is_that_of_the_command_line(opened, tmp_path, more):
    """Every number of the file that the command writes is the number shown; two records with
    different windows.
    """
    body = wanted(opened, FIRST, SECOND, **more)
    body["windows"] = body["windows"][1:]
    shown = page.show_fit(opened, {}, body)
    words = [*shown["command"], "-o", "{work}/fits/pitch.nc"]
    demand_allowed(words)
    make_folders(words, opened.places)
    done = CliRunner().invoke(
        identify_command, opened.places.real(words)[2:], catch_exceptions=False
    )
    assert done.exit_code == int(any(remark["severity"] == "error" for remark in shown["remarks"]))
    saved = open_fit(opened.work / "fits" / "pitch.nc")
    assert shown["model"] == str(saved.model)
    assert [row["term"] for row in shown["terms"]] == [
        str(term) for term in saved.estimates["term"].values
    ]
    for name in ("estimate", "stderr", "stderr_systematic", "t", "vif", "low", "high"):
        np.testing.assert_array_equal(
            [row[name] for row in shown["terms"]], saved.estimates[name].values
        )
    np.testing.assert_array_equal(shown["correlation"], saved.estimates["correlation"].values)
    for name in ("R2", "residual_rms", "samples", "manoeuvres"):
        assert shown["attributes"][name] == saved.estimates.attrs[name]
    assert "{work}/fits/pitch.nc" in page.list_fit_choices(opened, {}, None)["saved"]


@pytest.mark.nightly
def test_the_prior_is_what_the_tables_say(opened):
    shown = page.show_fit(opened, {}, wanted(opened, prior=PRIOR))
    paths = page.form_windows(opened, page.FitRequest(**wanted(opened)))
    prior = prior_of(
        flighttest.regress(flighttest.RegressionModel.parse(MODEL), paths),
        aerodb.open(opened.work / "match" / "datcom.nc"),
    )
    given = {
        row["term"]: (row["prior"], row["prior_stderr"]) for row in shown["terms"] if "prior" in row
    }
    assert given == {
        str(term): (float(prior["estimate"].sel(term=term)), float(prior["stderr"].sel(term=term)))
        for term in prior["term"].values
    }
    assert -30.0 < given["qhat"][0] < -20.0  # DATCOM's Cm_q -17.6 and Cm_alphadot -10.0
    none = page.show_fit(opened, {}, wanted(opened, model="CX = 1 + alpha", prior=PRIOR))
    assert "CX" in none["without_prior"]
    assert not any("prior" in row for row in none["terms"])
    with pytest.raises(UnknownName):
        page.show_fit(opened, {}, wanted(opened, prior="{project}/engine.nc"))


def test_partial_regression_has_the_estimate_as_its_slope(opened):
    """To rounding, with and without weights; the residual of the line is the residual of the
    fit.
    """
    for more in ({}, {"weights": "robust"}, {"intercepts": "separate", "weights": "manoeuvre"}):
        found = page._fit(opened, page.FitRequest(**wanted(opened, **more)))
        for term, estimate in zip(
            found.estimates["term"].values, found.estimates["estimate"].values, strict=True
        ):
            x, y = fit_curves.added_variable_residuals(found, str(term))
            assert x @ y / (x @ x) == pytest.approx(estimate, rel=1e-9)
    in_band = wanted(opened, band=[0.1, 2.0])
    found = page._fit(opened, page.FitRequest(**in_band))
    assert found.estimates.attrs["domain"] == "frequency"
    for term in ("alpha", "qhat", "delta_e"):
        slope = page.show_partial_regression(opened, {}, {"fit": in_band, "term": term})["slope"]
        assert slope == pytest.approx(float(found.estimates["estimate"].sel(term=term)), rel=1e-9)
    with pytest.raises(UnknownName):  # the constant is found in time
        page.show_partial_regression(opened, {}, {"fit": in_band, "term": "1"})
    shown = page.show_partial_regression(opened, {}, {"fit": wanted(opened), "term": "qhat"})
    estimates = {
        row["term"]: row["estimate"] for row in page.show_fit(opened, {}, wanted(opened))["terms"]
    }
    assert shown["slope"] == pytest.approx(estimates["qhat"], rel=1e-9)
    found = page._fit(opened, page.FitRequest(**wanted(opened)))
    x, y = fit_curves.added_variable_residuals(found, "qhat")
    np.testing.assert_allclose(y - estimates["qhat"] * x, found.residual, atol=1e-12)
    with pytest.raises(UnknownName):
        page.show_partial_regression(opened, {}, {"fit": wanted(opened), "term": "beta"})


def test_the_spectrum_holds_the_variance(opened):
    """The density of a tone and of white noise in place of the residual: power at the tone, level
    of the noise.
    """
    found = page._fit(opened, page.FitRequest(**wanted(opened)))
    shown = fit_curves.power_spectral_densities(found)
    assert (shown["segments"], shown["left_out"]) == (2, 0)
    assert shown["frequency"][0] == pytest.approx(1.0 / 9.9)  # of the shorter window
    assert shown["frequency"][-1] == pytest.approx(25.0, abs=0.06)
    rng, name = np.random.default_rng(3), "Cm"
    noise = rng.normal(0.0, 0.1, found.data.sizes["sample"])
    tone = np.sqrt(2.0) * np.sin(2 * np.pi * 2.0 * found.data["time"].values)
    data = found.data.assign(
        {
            name: (
                "sample",
                found.regressors.values @ found.estimates["estimate"].values + noise + tone,
            )
        }
    )
    made = fit_curves.power_spectral_densities(
        type(found)(found.name, found.model, found.estimates, data, found.design, found.regressors)
    )
    frequency, power = np.asarray(made["frequency"]), np.asarray(made["residual"])
    assert frequency[power.argmax()] == pytest.approx(2.0, abs=frequency[0])
    near = np.abs(frequency - 2.0) < 0.5
    assert np.sum(power[near]) * frequency[0] == pytest.approx(1.0, rel=0.1)
    assert np.mean(power[frequency > 5.0]) == pytest.approx(2.0 * 0.01 / 50.0, rel=0.1)


def test_samples_of_the_windows_one_after_another(opened):
    body = wanted(opened)
    found = page._fit(opened, page.FitRequest(**body))
    shown = page.show_fit_samples(opened, {}, {"fit": body, "points": 4000})
    fitted = np.asarray(shown["fitted"])
    there = np.isfinite(fitted)
    assert there.sum() == found.data.sizes["sample"]
    assert (~there).sum() == 2  # one gap behind each window
    np.testing.assert_allclose(
        np.asarray(shown["measured"])[there] - fitted[there], found.residual, atol=1e-15
    )
    assert np.all(np.diff(shown["time"]) > 0.0)
    assert [one["label"] for one in shown["windows"]] == list(PITCH)
    assert shown["windows"][1]["from"] == pytest.approx(12.7)
    part = page.show_fit_samples(opened, {}, {"fit": body, "start": 3.0, "stop": 5.0})
    assert 2.9 < part["time"][0] <= 3.0
    assert 5.0 <= part["time"][-1] < 5.1
    with pytest.raises(SchemaError):
        page.show_fit_samples(opened, {}, {"fit": body, "start": "x"})


def test_left_out_in_turn(opened):
    """Each row is the fit without that window or term; what cannot be fitted is stated."""
    body = wanted(opened)
    rows = page.leave_one_out(opened, {}, body)["rows"]
    assert [(row["left_out"], row["name"]) for row in rows] == [
        *(("window", f"{FIRST}: {name}") for name in PITCH),
        *(("term", name) for name in ("alpha", "qhat", "delta_e")),
    ]
    alone = page.show_fit(opened, {}, {**body, "windows": body["windows"][1:]})
    assert rows[0]["estimates"] == {row["term"]: row["estimate"] for row in alone["terms"]}
    less = page.show_fit(opened, {}, {**body, "model": "Cm = 1 + alpha + delta_e"})
    assert (
        rows[3]["R2"]
        == less["attributes"]["R2"]
        < page.show_fit(opened, {}, body)["attributes"]["R2"]
    )
    refused = page.leave_one_out(opened, {}, {**body, "model": "Cm = 1 + gear + alpha"})["rows"]
    assert "gear does not move" in refused[-1]["refused"]


def test_entries_mean_the_same_windows(opened):
    """What is written into the project is read back as the windows of the page."""
    file = opened.file
    for names, count in ((PITCH, 1), (PITCH[:1], 1)):
        body = page.FitRequest(
            **{**wanted(opened), "windows": windows(opened, FIRST, SECOND, names=names)}
        )
        assert len(page.make_fit_entries(opened, body, "tried")) == count
    own = {"record": SECOND, "start": 10.0, "end": 20.0}
    body = page.FitRequest(**{**wanted(opened), "windows": [*windows(opened, FIRST), own]})
    texts = page.make_fit_entries(opened, body, "tried")
    before = file.read_text()
    known = len(opened.project.fit)
    for text in texts:
        set_key(file, "fit.+", text)
    project = read_project(file)
    file.write_text(before)
    added = project.fit[known:]
    assert [fit.name for fit in added] == ["tried 1", "tried 2"]
    tables = {
        name: flighttest.records.marked_manoeuvres(opened.record(name)) for name in (FIRST, SECOND)
    }
    problems: list[str] = []
    assert spans_of("fit", added, tables, problems) == {
        FIRST: [(9.0, 21.7), (37.54, 47.44)],
        SECOND: [(10.0, 20.0)],
    }
    assert problems == []
    assert added[0].manoeuvres == PITCH
    assert added[0].models == (MODEL,)


def test_coefficients_are_made_once(opened, monkeypatch):
    page.show_fit(opened, {}, wanted(opened))
    monkeypatch.setattr(flighttest, "coefficients", lambda *a, **b: pytest.fail("made again"))
    shown = page.show_fit(opened, {}, wanted(opened, model="Cm = 1 + alpha + delta_e"))
    assert len(shown["terms"]) == 3


@pytest.mark.nightly
def test_coefficients_stay_for_a_later_server_and_make_room_for_what_is_used(opened, monkeypatch):
    """Another server reads them from the working folder, bit by bit the same; another low-pass or
    error is another file; old ones go.
    """
    body = page.FitRequest(**wanted(opened))
    first = page.form_windows(opened, body)
    monkeypatch.setattr(flighttest, "coefficients", lambda *a, **b: pytest.fail("made again"))
    again = page.form_windows(OpenProject(opened.file, opened.work), body)
    monkeypatch.undo()
    for one, other in zip(first, again, strict=True):
        xr.testing.assert_identical(one, other)
    monkeypatch.setattr(
        coefficients, "hash_installation", lambda: "another one of the same version"
    )
    assert not coefficients._coefficient_file(
        OpenProject(opened.file, opened.work), FIRST, 4.0
    ).exists()
    monkeypatch.undo()
    assert coefficients._coefficient_file(
        OpenProject(opened.file, opened.work), FIRST, 4.0
    ).exists()
    whole = flighttest.coefficients(
        opened.path(FIRST), opened.aircraft, dict(opened.project.errors), 4.0
    )
    xr.testing.assert_identical(
        again[0], flighttest.select_time(whole, body.windows[0].start, body.windows[0].end)
    )
    folder = opened.work / coefficients.FOLDER
    known = set(folder.glob(f"{FIRST}_*.nc"))
    page.form_windows(opened, page.FitRequest(**wanted(opened, cutoff=3.0)))
    (new,) = set(folder.glob(f"{FIRST}_*.nc")) - known
    monkeypatch.setattr(coefficients, "MOST_BYTES", 2 * new.stat().st_size)
    page.form_windows(opened, page.FitRequest(**wanted(opened, cutoff=3.5)))
    left = {file.name for file in folder.glob("*.nc")}
    assert len(left) == 2
    assert new.name in left
    page.form_windows(
        OpenProject(opened.file, opened.work), body
    )  # formed once more, since its file is gone


@pytest.mark.nightly
def test_a_server_forms_coefficients_in_a_process_that_can_be_cancelled(opened, monkeypatch):
    """What is cancelled leaves no file and no action; asked again it has the bits of those formed
    here; few samples need no process.
    """
    pytest.importorskip("starlette")
    pytest.importorskip("uvicorn")
    body, folder = wanted(opened, FIRST, SECOND, cutoff=2.7), opened.work / coefficients.FOLDER
    with served(opened.file, opened.work) as client, ThreadPoolExecutor(1) as other:
        client.data("/api/fit", body=wanted(opened, cutoff=2.8))
        assert client.data("/api/jobs")["jobs"] == []
        monkeypatch.setattr(coefficients, "MOST_HERE", 4000)
        before = set(folder.glob("*.nc"))
        asked = other.submit(client.ask, "/api/fit", None, body)
        until = time.monotonic() + PATIENCE
        while not (
            jobs := [job for job in client.data("/api/jobs")["jobs"] if job["state"] == "running"]
        ):
            assert time.monotonic() < until
            time.sleep(0.05)
        (job,) = jobs
        assert job["command"] == "coefficients along 2 records"
        assert client.data("/api/cancel", body={"number": job["number"]})["state"] == "cancelled"
        code, _, text = asked.result(PATIENCE)
        assert code == 400
        assert (
            json.loads(text)["text"]
            == "coefficients along 2 records: cancelled; fit again to form them"
        )
        assert set(folder.glob("*.nc")) == before
        shown = client.data("/api/fit", body=body)
        jobs = client.data("/api/jobs")["jobs"]
        assert [job["state"] for job in jobs] == ["cancelled", "done"]
        assert jobs[1]["progress"] == f"{SECOND}, 2 of 2"
        assert client.data("/api/actions")["actions"] == []
    made = sorted(set(folder.glob("*.nc")) - before)
    assert [file.name.rpartition("_")[0] for file in made] == sorted([FIRST, SECOND])
    for file in made:
        path = opened.path(file.name.rpartition("_")[0])
        with xr.open_dataset(file, engine="h5netcdf", decode_timedelta=False) as kept:
            xr.testing.assert_identical(
                kept.load(),
                flighttest.coefficients(path, opened.aircraft, dict(opened.project.errors), 2.7),
            )
    here = page.show_fit(OpenProject(opened.file, opened.work), {}, body)
    assert [row["estimate"] for row in shown["terms"]] == [row["estimate"] for row in here["terms"]]


@pytest.mark.nightly
def test_what_only_looks_does_not_wait_for_the_commands(tmp_path):
    """A command that has not begun holds the queue; a module outside it ends well, or with its
    error, and is not an action.
    """
    begun, go, ended = threading.Event(), threading.Event(), []
    jobs = Jobs(
        tmp_path / "jobs",
        tmp_path,
        list,
        lambda job: begun.set() or go.wait(PATIENCE),
        ended.append,
    )
    first = jobs.add(["--version"])
    assert begun.wait(PATIENCE)
    assert jobs.run("looks", "platform", []).state == "done"
    failed = jobs.run(
        "looks",
        "aeromatch.workbench.coefficients",
        [json.dumps([["none.nc", "none.toml", {}, None, "made.nc"]])],
    )
    assert failed.state == "failed"
    assert "none.nc" in failed.about()["error"]
    assert first.state == "waiting"
    go.set()
    assert jobs.wait(first.number, PATIENCE).state == "done"
    assert ended == [first]
    jobs.stop()
    assert jobs.run("looks", "platform", []).state == "cancelled"


@pytest.mark.nightly
def test_faults_are_stated(opened):
    for change, error in (
        ({"windows": []}, SchemaError),
        ({"model": "Cm = 1 +"}, ParseError),
        ({"model": "Cm = 1 + nothing"}, UnknownName),
        ({"model": "Cm = 1 + gear"}, IdentificationError),
        ({"weights": "none"}, SchemaError),
        ({"cutoff": -1.0}, SchemaError),
        ({"ridge": -1.0}, SchemaError),
        ({"ridge": "some"}, SchemaError),
        ({"band": [2.0, 0.1]}, SchemaError),
        ({"band": [0.1, 2.0], "weights": "robust"}, SchemaError),
        ({"band": [0.001, 0.002]}, IdentificationError),
        ({"windows": [{"record": FIRST, "start": 0.0, "end": 900.0}]}, OutOfRange),
        ({"windows": [{"record": "none", "start": 0.0, "end": 9.0}]}, UnknownName),
        (
            {"windows": [{"record": "t37_26_val_phugoid", "start": 0.0, "end": 9.0}]},
            FileNotFoundError,
        ),
    ):
        with pytest.raises(error):
            page.show_fit(opened, {}, {**wanted(opened), **change})
    with pytest.raises(SchemaError):
        page.show_fit(opened, {}, None)
    with pytest.raises(SchemaError, match="name"):
        page.show_fit_entries(opened, {}, {"fit": wanted(opened), "name": " "})
