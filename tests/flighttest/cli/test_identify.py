import json
import shutil

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from flightmech import terms
from flightmech.errors import (
    AeromatchError,
    AeromatchWarning,
    IdentificationError,
    OutOfRange,
    SchemaError,
    UnknownName,
)
from flighttest.cli.group import flight
from flighttest.cli.identify import (
    identify_command,
    inertia_command,
    join_command,
    partition_command,
    select_command,
    tabulate_command,
)
from flighttest.regression.equation_error.fit_file import open_fit

AIRCRAFT = """
name = "test"
S = 16.0
cbar = 1.6
b = 10.0
mass = 2000.0
Ixx = 11000.0
Iyy = 8000.0
Izz = 15000.0
"""

REFERENCE = {
    "title": "test",
    "aircraft": "test",
    "source": "test",
    "S": 16.0,
    "cbar": 1.6,
    "b": 10.0,
    "x_ref": 0.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
    "force_axes": "stability",
}


@pytest.fixture
def files(tmp_path):
    """A path whose side force is CY = -0.5 beta + 0.2 delta_r."""
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(1000)
    zero = np.zeros(1000)
    beta, rudder = 0.05 * np.sin(1.3 * t), 0.1 * np.sin(2.9 * t + 1)
    columns = {
        "V": zero + 80,
        "alpha": zero + 0.05,
        "beta": beta,
        "qbar": zero + 4000,
        "delta_r": rudder,
    }
    columns |= {k: zero for k in ("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax")}
    columns |= {
        "az": zero - 9.8,
        "ay": 4000 * 16 / 2000 * (-0.5 * beta + 0.2 * rudder + 1e-4 * rng.normal(size=1000)),
    }
    states = xr.Dataset({k: ("time", v) for k, v in columns.items()}, coords={"time": t})
    xr.DataTree.from_dict({"/states": states}).to_netcdf(tmp_path / "path.nc", engine="h5netcdf")
    (tmp_path / "a.toml").write_text(AIRCRAFT)
    return [str(tmp_path / "path.nc"), "--aircraft", str(tmp_path / "a.toml")], tmp_path


def run(*arguments):
    return CliRunner().invoke(identify_command, arguments, catch_exceptions=False)


@pytest.mark.nightly
def test_the_table_and_the_file(files):
    base, folder = files
    result = run(*base, "--model", "CY = 1 + beta + delta_r", "-o", str(folder / "fit.nc"))
    assert result.exit_code == 0
    assert "CY = 1 + beta + delta_r" in result.output
    assert "std error" in result.output
    np.testing.assert_allclose(
        open_fit(folder / "fit.nc").estimates["estimate"], [0, -0.5, 0.2], atol=1e-3
    )


@pytest.mark.nightly
def test_windows_of_one_path_and_errors_of_the_measurement(files):
    """Two paths with a window each give what the windows give in one fit; the error of the mass
    moves every coefficient alike.
    """
    base, folder = files
    path, *aircraft = base
    second = str(folder / "second.nc")
    shutil.copy(path, second)
    model = ("--model", "CY = 1 + beta + delta_r")
    own = ("--window-of", "path", "0", "8", "--window-of", "second", "10", "18")
    found = json.loads(
        run(path, second, *aircraft, *model, *own, "--error", "mass", "0.1", "--json").output
    )
    expected = json.loads(
        run(path, *aircraft, *model, "--window", "0", "8", "--window", "10", "18", "--json").output
    )
    assert found["samples"] == expected["samples"] == 800
    assert found["R2"] == expected["R2"]
    for term, row in found["terms"].items():
        assert row["estimate"] == expected["terms"][term]["estimate"]
    assert found["terms"]["beta"]["stderr_systematic"] == pytest.approx(0.1 * 0.5, rel=0.01)
    assert expected["terms"]["beta"]["stderr_systematic"] < 0.01
    with pytest.raises(UnknownName, match="third"):
        run(path, second, *aircraft, *model, "--window-of", "third", "0", "8")
    with pytest.raises(SchemaError, match="second: no window"):
        run(path, second, *aircraft, *model, "--window-of", "path", "0", "8")


@pytest.mark.nightly
@pytest.mark.parametrize("command", ["identify", "select"])
def test_a_fit_knows_its_windows_in_another_form(files, command):
    """Another cut-off, wing area and name of the path do not make data of the fit unseen."""
    base, folder = files
    fit, copy, other = str(folder / "fit.nc"), str(folder / "copy.nc"), str(folder / "b.toml")
    model = ["--model", "CY = 1 + beta + delta_r"]
    if command == "select":
        model = ["--coefficient", "CY", "--variables", "beta delta_r", "--order", "1"]
    done = CliRunner().invoke(
        flight, [command, *base, *model, "--window", "0", "8", "-o", fit], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    shutil.copy(base[0], copy)
    (folder / "b.toml").write_text(AIRCRAFT.replace("S = 16.0", "S = 15.0"))

    def board(path, aircraft, start, *words):
        words = ["validate", fit, "--path", path, "--aircraft", aircraft, *words]
        words += ["--window", str(start), str(start + 8), "--json"]
        found = CliRunner().invoke(flight, words, catch_exceptions=False)
        return json.loads(found.stdout)["summary"][0]

    for path, aircraft in ((copy, base[2]), (base[0], other)):
        assert board(path, aircraft, 2, "--cutoff", "5")["windows"] == "0 of 1"
    later = board(copy, base[2], 10)
    assert later["windows"] == "1 of 1"
    assert later["R2"] > 0.99


@pytest.mark.slow
def test_a_selection_follows_constraints(files):
    base, _ = files
    words = ["select", *base, "--coefficient", "CY", "--variables", "beta delta_r", "--order", "1"]
    words += ["--constraint", "CY_delta_r = -0.25*beta", "--json"]
    done = CliRunner().invoke(flight, words, catch_exceptions=False)
    rows = json.loads(done.stdout)["terms"]
    assert rows["delta_r"]["estimate"] == pytest.approx(-0.25 * rows["beta"]["estimate"], rel=1e-12)


@pytest.mark.slow
def test_the_document_and_windows(files):
    base, _ = files
    result = run(
        *base,
        "--model",
        "CY = 1 + beta + delta_r",
        "--window",
        "0",
        "8",
        "--window",
        "10",
        "18",
        "--intercepts",
        "separate",
        "--json",
    )
    found = json.loads(result.output)
    assert found["manoeuvres"] == 2
    assert set(found["terms"]) == {"1[0]", "1[1]", "beta", "delta_r"}
    assert found["terms"]["beta"]["estimate"] == pytest.approx(-0.5, abs=1e-3)
    assert len(found["covariance"]) == 4
    assert found["remarks"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "error"),
    [
        (["--model", "CY = 1 + betta"], UnknownName),
        (["--model", "CY = 1 + beta", "--window", "0", "99"], OutOfRange),
        (["--model", "CY = 1 + beta + gear"], UnknownName),
    ],
)
def test_bad_input_is_an_error_of_the_package_and_leaves_no_file(files, more, error):
    base, folder = files
    with pytest.raises(error) as caught:
        run(*base, *more, "-o", str(folder / "fit.nc"))
    assert isinstance(caught.value, AeromatchError)
    assert not (folder / "fit.nc").exists()


@pytest.mark.nightly
def test_in_frequency_with_a_ridge_and_with_the_prior_of_a_database(files, tmp_path):
    base, _ = files
    found = json.loads(
        run(*base, "--model", "CY = 1 + beta + delta_r", "--band", "0.1", "1", "--json").output
    )
    assert found["domain"] == "frequency"
    assert found["terms"]["beta"]["estimate"] == pytest.approx(-0.5, abs=1e-3)
    assert (
        "frequencies in 0.1 ... 1 Hz"
        in run(*base, "--model", "CY = 1 + beta + delta_r", "--band", "0.1", "1").output
    )
    assert (
        json.loads(
            run(*base, "--model", "CY = 1 + beta + delta_r", "--ridge", "0.1", "--json").output
        )["ridge"]
        == 0.1
    )
    leaf = terms.make_term(np.array(-0.4), {}, ["beta"], stderr=np.array(0.1), source="datcom")
    xr.DataTree.from_dict({"/": xr.Dataset(attrs=REFERENCE), "/CY/beta": leaf}).to_netcdf(
        tmp_path / "prior.nc", engine="h5netcdf"
    )
    result = run(*base, "--model", "CY = 1 + beta + delta_r", "--prior", str(tmp_path / "prior.nc"))
    assert "with prior" in result.output
    with pytest.raises(SchemaError, match="--weights goes with a fit in time"):
        run(*base, "--model", "CY = 1 + beta", "--band", "0.1", "1", "--weights", "robust")
    with pytest.raises(SchemaError, match="--ridge is 'much'; expected a number or auto"):
        run(*base, "--model", "CY = 1 + beta", "--ridge", "much")


@pytest.mark.nightly
def test_selection_and_its_file(files):
    base, folder = files
    arguments = [
        *base,
        "--coefficient",
        "CY",
        "--variables",
        "beta delta_r alpha",
        "--order",
        "2",
        "-o",
        str(folder / "chosen.nc"),
    ]
    result = CliRunner().invoke(select_command, arguments, catch_exceptions=False)
    assert "prediction: CY = 1 + beta + delta_r" in result.output
    assert "models that the evidence allows: " in result.output
    assert open_fit(folder / "chosen.nc").model.terms == ("1", "beta", "delta_r")
    found = json.loads(
        CliRunner()
        .invoke(
            select_command, [*arguments, "--method", "stepwise", "--json"], catch_exceptions=False
        )
        .output
    )
    assert found["idle"] == ["alpha", "alpha**2"]  # beta*alpha, as good as beta, comes after it
    assert [step["action"] for step in found["steps"]] == ["kept", "entered", "entered"]
    with pytest.raises(SchemaError, match="no candidates: give --variables"):
        CliRunner().invoke(select_command, [*base, "--coefficient", "CY"], catch_exceptions=False)


@pytest.mark.nightly
def test_fits_from_files_are_joined(files):
    base, folder = files
    for k, (start, stop) in enumerate((("0", "6"), ("6", "12"), ("12", "18"))):
        run(
            *base,
            "--model",
            "CY = 1 + beta + delta_r",
            "--window",
            start,
            stop,
            "-o",
            str(folder / f"{k}.nc"),
        )
    names = [str(folder / f"{k}.nc") for k in range(3)]
    assert (
        "3 fits joined by median"
        in CliRunner()
        .invoke(join_command, [*names, "--method", "median"], catch_exceptions=False)
        .output
    )
    found = json.loads(
        CliRunner().invoke(join_command, [*names, "--json"], catch_exceptions=False).output
    )
    assert found["terms"]["beta"]["estimate"] == pytest.approx(-0.5, abs=1e-3)


@pytest.mark.slow
def test_bins_with_their_unit(files):
    base, _ = files
    arguments = [*base, "--model", "CY = 1 + beta + delta_r", "--over", "beta", "-3 0 3 deg"]
    assert (
        "in 2 bins"
        in CliRunner().invoke(partition_command, arguments, catch_exceptions=False).output
    )
    found = json.loads(
        CliRunner().invoke(partition_command, [*arguments, "--json"], catch_exceptions=False).output
    )
    assert found["bins"][0]["beta_low"] == pytest.approx(np.radians(-3))
    assert found["bins"][1]["estimate"][1] == pytest.approx(-0.5, abs=5e-3)
    with pytest.raises(
        SchemaError, match=r"edges of beta are 'a b deg'; expected finite numbers and a unit"
    ):
        CliRunner().invoke(
            partition_command,
            [*base, "--model", "CY = 1 + beta", "--over", "beta", "a b deg"],
            catch_exceptions=False,
        )


def test_inertia_of_a_flight_without_coupling_is_refused(files):
    base, _ = files
    models = [
        x
        for text in ("Cl = 1 + beta", "Cm = 1 + delta_r", "Cn = 1 + beta")
        for x in ("--model", text)
    ]
    with pytest.raises(IdentificationError, match="equation of p_dot: pq, qr are zero throughout"):
        CliRunner().invoke(inertia_command, [*base, *models], catch_exceptions=False)


@pytest.mark.nightly
def test_a_figure_that_must_not_be_used_is_exit_code_1(files):
    """Rudder of the other sign; and a rolling moment that no term moves."""
    base, folder = files
    with xr.open_datatree(folder / "path.nc") as tree:
        states = tree["states"].to_dataset().load()
    rng = np.random.default_rng(1)
    states["delta_r"] = -states["delta_r"]
    states["p_dot"] = states["p_dot"] + 0.01 * rng.normal(size=1000)
    xr.DataTree.from_dict({"/states": states}).to_netcdf(folder / "odd.nc", engine="h5netcdf")
    odd = [str(folder / "odd.nc"), *base[1:]]
    wrong = run(*odd, "--model", "CY = 1 + beta + delta_r", "--correlation")
    assert wrong.exit_code == 1
    assert "!! sign against the convention: dCY/ddelta_r is -0.2" in wrong.output
    assert "correlation " in wrong.output
    assert "all slopes: F(2, " in wrong.output
    noise = run(*odd, "--model", "Cl = 1 + beta + delta_r", "--json")
    assert noise.exit_code == 1
    assert [one["kind"] for one in json.loads(noise.output)["remarks"]] == ["no excitation"]


@pytest.mark.nightly
def test_fits_join_the_tables_of_a_database(files):
    """A prior of -0.4 and 0.1 with errors of 0.2; the record was made with -0.5 and 0.2."""
    base, folder = files
    leaves = {
        "CY/beta": terms.make_term(-0.4, {}, ["beta"], stderr=0.2, source="datcom"),
        "CY/rudder": terms.make_term(0.1, {}, ["delta_r"], stderr=0.2, source="judgement"),
    }
    aerodb.save(aerodb.make_database(leaves, **REFERENCE), folder / "prior.nc")
    run(*base, "--model", "CY = 1 + beta + delta_r", "-o", str(folder / "fit.nc"))
    words = [str(folder / "fit.nc"), "--database", str(folder / "prior.nc")]
    done = CliRunner().invoke(
        tabulate_command, [*words, "-o", str(folder / "new.nc")], catch_exceptions=False
    )
    assert done.exit_code == 0
    assert "CY/rudder" in done.output
    new = aerodb.terms(aerodb.open(folder / "new.nc"))
    assert float(new["CY/beta"]["value"]) == pytest.approx(
        -0.5, abs=3 * float(new["CY/beta"]["stderr"])
    )
    assert float(new["CY/rudder"]["value"]) == pytest.approx(
        0.2, abs=3 * float(new["CY/rudder"]["stderr"])
    )
    assert float(new["CY/rudder"]["stderr"]) < 0.02
    held = CliRunner().invoke(
        tabulate_command,
        [*words, "--hold", "CY/beta", "-o", str(folder / "held.nc"), "--json"],
        catch_exceptions=False,
    )
    assert set(json.loads(held.output)["terms"]) == {"CY/rudder"}
    assert float(aerodb.terms(aerodb.open(folder / "held.nc"))["CY/beta"]["value"]) == -0.4
    joined = CliRunner().invoke(
        tabulate_command,
        [*words, "--way", "join", "-o", str(folder / "joined.nc"), "--json"],
        catch_exceptions=False,
    )
    assert (
        json.loads(joined.output)["terms"]["CY/beta"]["level"] is None
    )  # no part of a prior covariance is learnt
    beta = aerodb.terms(aerodb.open(folder / "joined.nc"))["CY/beta"]
    assert beta.attrs["history"].startswith("join_submodels: joined with 1 fits")
    assert float(beta["value"]) == pytest.approx(-0.5, abs=3 * float(beta["stderr"]))
    with pytest.raises(UnknownName, match="unknown held term 'CY/bet'; near it: CY/beta"):
        CliRunner().invoke(
            tabulate_command,
            [*words, "--hold", "CY/bet", "-o", str(folder / "no.nc")],
            catch_exceptions=False,
        )
    assert not (folder / "no.nc").exists()


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:incompatible fits")  # without the control they are
def test_a_rudder_without_a_table_stops_or_is_a_warning(files):
    base, folder = files
    alone = {"CY/beta": terms.make_term(-0.5, {}, ["beta"], stderr=0.2, source="datcom")}
    aerodb.save(aerodb.make_database(alone, **REFERENCE), folder / "clean.nc")
    run(*base, "--model", "CY = 1 + beta + delta_r", "-o", str(folder / "fit.nc"))
    words = [
        str(folder / "fit.nc"),
        "--database",
        str(folder / "clean.nc"),
        "-o",
        str(folder / "new.nc"),
    ]
    for way in ("tabulate", "join"):
        with pytest.raises(
            SchemaError,
            match=r"CY: delta_r of .*estimate 0\.2.*, t \d+.*open the term: "
            r"\[terms\.\"CY/delta_r\"\]",
        ):
            CliRunner().invoke(tabulate_command, [*words, "--way", way], catch_exceptions=False)
        assert not (folder / "new.nc").exists()
    with pytest.warns(AeromatchWarning, match="no place in the database"):
        done = CliRunner().invoke(
            tabulate_command, [*words, "--unplaced", "warn", "--json"], catch_exceptions=False
        )
    found = json.loads(done.output)
    assert [row["term"] for row in found["unplaced"] if row["significant"]] == ["delta_r"]
    assert "delta_r" in found["warnings"][0]
    assert found["warnings"][1].startswith("incompatible fits: CY")
    shown = CliRunner().invoke(db, ["decisions", str(folder / "new.nc")], catch_exceptions=False)
    assert (
        "warning: no place in the database, the estimate is left out: CY: delta_r of"
        in shown.output
    )
    shown = CliRunner().invoke(
        db, ["decisions", str(folder / "new.nc"), "--json"], catch_exceptions=False
    )
    assert json.loads(shown.output)["warnings"] == found["warnings"]
    with pytest.warns(AeromatchWarning, match="no place in the database"):
        done = CliRunner().invoke(
            tabulate_command, [*words, "--unplaced", "warn"], catch_exceptions=False
        )
    assert "Terms without a place in the database" in done.output
