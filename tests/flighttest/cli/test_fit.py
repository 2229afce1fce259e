"""``aeromatch flight fit``: a simulated glider whose truth is known; records with planted mistakes
are named.
"""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
import flightmech
import flighttest
from flightmech.errors import (
    AeromatchWarning,
    IdentificationError,
    ParseError,
    SchemaError,
    UnknownName,
)
from flightmech.terms import make_term
from flighttest.cli.group import flight
from flighttest.maximum_likelihood.fit_job import FitJobResult

TRUTH = {"term.Cm.basic": 1.1, "term.Cm.qhat": 0.8, "term.Cm.elevator": 1.15, "term.CL.basic": 1.05}
NOISE = {"V": 0.1, "alpha": 2e-3, "q": 1e-3, "theta": 1e-3, "az": 0.1}
CRAFT = {
    "S": 16.0,
    "cbar": 1.5,
    "b": 10.0,
    "mass": 900.0,
    "Ixx": 2000.0,
    "Iyy": 2500.0,
    "Izz": 4000.0,
}
FIT = """
title = "Glider, two doublets"
aircraft = "glider.toml"
database = "prior.nc"
outputs = ["V", "alpha", "q", "theta", "az"]

[conditions]
"mode.earth" = 0.0
"init.h" = "500 m"
"init.q" = 0.0

[[record]]
file = "one.nc"
[[record]]
file = "two.nc"
window = [0.0, 8.0]

[parameter]
"term.CL.basic" = { sigma = 0.2 }
"term.Cm.basic" = {}
"term.Cm.qhat" = {}
"term.Cm.elevator" = { low = 0.5, high = 2.0 }
"init.V" = { own = true }
"init.alpha" = { own = true }
"init.theta" = { own = true }
"sensor.alpha" = { start = "0 deg", sigma = "1 deg" }
"""


def flown(sim, seed, amplitude=0.04, length=10.0):
    """Return a doublet as instruments record it; the vane shows 0.01 rad too much."""
    t = np.arange(0.0, length, 0.04)
    record = xr.Dataset(
        {"delta_e": ("time", amplitude * (((t > 1) & (t < 2)) * 1.0 - ((t > 2) & (t < 3))))},
        {"time": t},
    )
    start = {
        "mode.earth": 0.0,
        "init.h": 500.0,
        "init.V": 40.0,
        "init.alpha": 0.03,
        "init.theta": 0.0,
    }
    y = flightmech.simulate(sim, record, {**start, **TRUTH}, outputs=list(NOISE), step=0.04)
    rng = np.random.default_rng(seed)
    for name, sigma in NOISE.items():
        record[name] = (
            y[name] + sigma * rng.standard_normal(t.size) + (0.01 if name == "alpha" else 0.0)
        )
    return record


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The folder with aircraft and database, and the compiled glider."""
    folder = tmp_path_factory.mktemp("glider")
    craft = flightmech.Aircraft(name="glider", **CRAFT)
    (folder / "glider.toml").write_text(
        'name = "glider"\n' + "".join(f"{key} = {value}\n" for key, value in CRAFT.items())
    )
    alpha = [-0.2, 0.0, 0.2, 0.4]
    leaves = {
        "/CL/basic": make_term([-0.8, 0.3, 1.3, 1.5], {"alpha": alpha}),
        "/CD/basic": make_term([0.05, 0.02, 0.08, 0.3], {"alpha": alpha}),
        "/Cm/basic": make_term([0.2, 0.03, -0.15, -0.4], {"alpha": alpha}),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
    }
    about = {
        "title": "glider",
        "aircraft": "glider",
        "source": "test",
        "force_axes": "stability",
        "x_ref": 0.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
    }
    db = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={**about, **{key: CRAFT[key] for key in ("S", "cbar", "b")}}),
            **leaves,
        }
    )
    aerodb.save(db, folder / "prior.nc")
    return folder, flightmech.compile(craft, db)


@pytest.fixture
def folder(model, tmp_path):
    """A folder with model, two records and the fit."""
    source, sim = model
    for name in ("glider.toml", "prior.nc"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    save(tmp_path / "one.nc", flown(sim, 1))
    save(tmp_path / "two.nc", flown(sim, 2))
    (tmp_path / "fit.toml").write_text(FIT)
    return tmp_path


def save(path, states):
    xr.DataTree.from_dict({"/states": states}).to_netcdf(path, engine="h5netcdf", mode="w")


def call(*words):
    return CliRunner().invoke(flight, ["fit", *map(str, words)], catch_exceptions=False)


def replaced(folder, change):
    """Put a changed record in the place of both."""
    for name in ("one.nc", "two.nc"):
        with xr.open_datatree(folder / name, engine="h5netcdf") as tree:
            states = tree["states"].to_dataset().load()
        save(folder / name, change(states))
    return folder / "fit.toml"


@pytest.mark.nightly
def test_the_truth_comes_back_with_file_and_page(folder):
    done = call(
        folder / "fit.toml",
        "-o",
        folder / "fit.nc",
        "--page",
        folder / "fit.html",
        "--database",
        folder / "fitted.nc",
        "--json",
    )
    assert done.exit_code == 0
    found = json.loads(done.stdout)
    for name, truth in TRUTH.items():
        row = found["parameters"][name]
        assert abs(row["estimate"] - truth) < 3.0 * row["stderr"]
        assert row["stderr"] < 0.1
    assert found["parameters"]["sensor.alpha"]["estimate"] == pytest.approx(
        0.01, abs=3.0 * found["parameters"]["sensor.alpha"]["stderr"]
    )
    assert found["converged"] == 1
    assert min(map(min, found["explained"].values())) > 0.9
    again = flighttest.maximum_likelihood.open_output_error(folder / "fit.nc")
    assert (
        again.estimates["estimate"].sel(parameter="term.Cm.qhat")
        == found["parameters"]["term.Cm.qhat"]["estimate"]
    )
    assert len(again.residuals) == 2
    assert again.of_manoeuvre(2)["init.V"] == pytest.approx(40.0, abs=0.3)
    corrected = aerodb.open(folder / "fitted.nc")
    assert found["not_in_the_database"] == [
        "init.V@1",
        "init.V@2",
        "init.alpha@1",
        "init.alpha@2",
        "init.theta@1",
        "init.theta@2",
        "sensor.alpha",
    ]
    scale = found["parameters"]["term.Cm.qhat"]
    assert float(corrected["Cm/qhat"]["value"]) == pytest.approx(-14.0 * scale["estimate"])
    assert float(corrected["Cm/qhat"]["stderr"]) == pytest.approx(14.0 * scale["stderr"])
    page = (folder / "fit.html").read_text()
    assert "term.Cm.elevator" in page
    assert page.count("<svg") >= 12  # five outputs and the elevator, twice
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.slow
def test_report_for_people(folder):
    text = call(folder / "fit.toml").stdout
    assert text.startswith("Glider, two doublets\noutput error in time: manoeuvres 2")
    assert "explained of each output's movement:" in text


@pytest.mark.nightly
def test_a_surface_of_the_wrong_sign_is_refused_by_name(folder):
    with pytest.raises(
        SchemaError,
        match=r"(?s)one.nc: sign:delta_e\+q: delta_e has the wrong sign.*two.nc: sign:delta_e",
    ):
        call(replaced(folder, lambda states: states.assign(delta_e=-states["delta_e"])))


@pytest.mark.slow
def test_a_wrong_unit_is_refused_by_name(folder):
    with pytest.raises(SchemaError, match=r"(unit|range):theta"):
        call(replaced(folder, lambda states: states.assign(theta=np.degrees(states["theta"]))))


@pytest.mark.nightly
def test_a_gap_in_the_clock_is_refused(folder):
    with pytest.raises(SchemaError, match=r"time is not uniform"):
        call(replaced(folder, lambda states: states.isel(time=np.r_[0:100, 130:250])))


@pytest.mark.nightly
def test_no_excitation_is_warned_of_and_no_confident_number_comes_out(folder, model):
    still = flown(model[1], 3, amplitude=0.0)
    with (
        pytest.warns(AeromatchWarning, match=r"excitation:delta_e"),
        pytest.raises(IdentificationError, match=r"no output responds to term.Cm.elevator"),
    ):
        call(replaced(folder, lambda states: still))


@pytest.mark.nightly
def test_inputs_that_move_together_are_warned_of(folder):
    def joined(states):
        return states.assign(delta_a=0.5 * states["delta_e"])

    with pytest.warns(AeromatchWarning, match=r"collinear:delta_e\+delta_a"):
        call(replaced(folder, joined))


@pytest.mark.nightly
def test_a_model_that_does_not_explain_the_record_is_reported(folder):
    def other(states):
        rng = np.random.default_rng(5)
        return states.assign(q=("time", 0.02 * rng.standard_normal(states.sizes["time"])))

    (folder / "fit.toml").write_text(
        FIT.replace('"term.Cm.basic" = {}', '"term.Cm.basic" = { sigma = 0.001 }')
    )
    text = call(replaced(folder, other)).stdout
    assert "! record 1, q: the model does not reproduce the record" in text
    assert "check the channel, mass, thrust and units" in text
    assert "term.Cm.basic lies" in text  # from what was known before


@pytest.mark.nightly
def test_mistakes_of_the_file_are_reported(folder):
    file = folder / "fit.toml"

    def changed(old, new):
        assert old in FIT
        file.write_text(FIT.replace(old, new))
        return file

    with pytest.raises(
        SchemaError, match=r"parameter.term.Cm.qhat.sigm: unknown key; near it: sigma"
    ):
        call(changed('"term.Cm.qhat" = {}', '"term.Cm.qhat" = { sigm = 1.0 }'))
    with pytest.raises(SchemaError, match=r"parameter sensor.alpha: unit 'kg' cannot be converted"):
        call(changed('start = "0 deg"', 'start = "0 kg"'))
    with pytest.raises(SchemaError, match=r"conditions: init.h: unit 'deg' cannot be converted"):
        call(changed("500 m", "500 deg"))
    with pytest.raises(SchemaError, match=r"no file .*three.nc; names are relative to the fit"):
        call(changed("two.nc", "three.nc"))
    with pytest.raises(SchemaError, match=r"record one.nc: .* is taken twice; take it once"):
        call(changed("two.nc", "one.nc"))
    with pytest.raises(SchemaError, match=r"unknown parameter 'term.Cm.rhat'; near it: term.Cm."):
        call(changed("term.Cm.qhat", "term.Cm.rhat"))
    with pytest.raises(UnknownName, match=r"unknown output 'alfa'"):
        call(changed('"alpha", "q"', '"alfa", "q"'))
    (folder / "one.nc").write_text("nothing")
    with pytest.raises(ParseError, match="content that cannot be decoded"):
        call(changed("own = true", "own = true"))


def test_nodes_start_from_the_database(folder, model):
    from flighttest.maximum_likelihood.specification import read_specification

    (folder / "fit.toml").write_text(
        FIT.replace(
            '"term.Cm.qhat" = {}',
            '"node.Cm.basic[2]" = {}\n"offset.CL.basic" = {}\n"table.CD.basic" = {}',
        )
    )
    unknowns = read_specification(folder / "fit.toml").unknowns(model[1])
    assert unknowns["node.Cm.basic[2]"].start == pytest.approx(-0.15)
    assert unknowns["offset.CL.basic"].start == 0.0
    assert unknowns["table.CD.basic"].start == 1.0
    assert unknowns["init.V"].start is None
    assert unknowns["term.Cm.elevator"][2:4] == (0.5, 2.0)


def test_estimates_in_a_database_fly_as_the_parameters_do(model):
    """Scale, offset, node and bias: the corrected model under no parameters is the old one under
    the estimates.
    """
    folder, sim = model
    values = {
        "term.Cm.basic": 1.2,
        "offset.CL.basic": 0.03,
        "node.Cm.basic[1]": 0.05,
        "bias.CD": 0.01,
        "bias.Cn": 1e-6,  # without a basic term in the database
        "table.Cm.elevator": 0.9,
    }
    names = list(values)
    columns = {
        "estimate": ("parameter", list(values.values())),
        "stderr": ("parameter", np.full(6, 0.01)),
    }
    estimates = xr.Dataset(columns, {"parameter": names}, {"method": "test", "manoeuvres": 1})
    fit = flighttest.OutputError(estimates, (), xr.Dataset())
    db = aerodb.open(folder / "prior.nc")
    corrected, left = flighttest.maximum_likelihood.updated_database(db, fit)
    assert left == []
    assert aerodb.terms(corrected)["Cn/basic"]["stderr"].item() == 0.01
    record = flown(sim, 1)[["delta_e"]]
    start = {"mode.earth": 0.0, "init.h": 500.0, "init.V": 40.0, "init.alpha": 0.03}
    craft = flightmech.Aircraft(name="glider", **CRAFT)
    one = flightmech.simulate(sim, record, {**start, **values}, outputs=["q", "V", "r"], step=0.04)
    two = flightmech.simulate(
        flightmech.compile(craft, corrected), record, start, outputs=["q", "V", "r"], step=0.04
    )
    assert abs(one["r"].values).max() > 1e-6
    for name in ("q", "V", "r"):
        np.testing.assert_allclose(two[name], one[name], rtol=1e-9, atol=1e-12)
    with pytest.raises(UnknownName, match=r"unknown term 'Cm/rudder'"):
        flighttest.maximum_likelihood.updated_database(
            db,
            flighttest.OutputError(
                estimates.assign_coords(parameter=["term.Cm.rudder", *names[1:]]), (), xr.Dataset()
            ),
        )


@pytest.mark.nightly
def test_constraints_of_the_file(folder):
    text = 'constraints = ["term.Cm.elevator = 1.15", "term.Cm.qhat < 2"]'
    fit = folder / "fit.toml"
    free = FIT.replace('"term.Cm.elevator" = { low = 0.5, high = 2.0 }', '"term.Cm.elevator" = {}')
    fit.write_text(f"{text}\n{free}")
    done = call(fit, "--json", "-o", folder / "held.nc")
    assert done.exit_code == 0
    found = json.loads(done.stdout)
    assert found["parameters"]["term.Cm.elevator"] == pytest.approx(
        found["parameters"]["term.Cm.elevator"] | {"estimate": 1.15, "stderr": 0.0}, nan_ok=True
    )
    assert [row["active"] for row in found["constraints"]] == [True, False]
    assert abs(found["constraints"][0]["t"]) < 3.5
    again = flighttest.maximum_likelihood.open_output_error(folder / "held.nc")
    assert "constraint term.Cm.elevator = 1.15: holds" in again.report()
    fit.write_text(f"{text}\n{FIT}")
    with pytest.raises(SchemaError, match="a prior or a bound as well"):
        call(fit)


def test_gusts_need_the_source_of_the_angles(folder):
    result = call(folder / "fit.toml", "--process-noise", "gusts")
    assert result.exit_code == 2
    assert "--angle vane or --angle inertial" in result.output


def test_a_scale_of_gusts_is_a_positive_length(folder):
    words = ("--process-noise", "gusts", "--angle", "vane", "--scale", "-3")
    with pytest.raises(SchemaError, match="scale of the gusts is -3"):
        call(folder / "fit.toml", *words)


@pytest.mark.nightly
def test_process_noise_of_a_calm_flight_is_at_its_bound(folder):
    head, _, _ = FIT.partition("[[record]]")
    text = head.replace('"V", "alpha", "q", "theta", "az"', '"q", "az"')
    text += '[[record]]\nfile = "one.nc"\nwindow = [0.0, 5.0]\n'
    text += '[process_noise]\nkind = "process"\n[parameter]\n"term.Cm.qhat" = {}\n'
    text += '"term.Cm.elevator" = {}\n"process.q" = { start = 0.01 }\n'
    (folder / "fit.toml").write_text(text)
    result = call(folder / "fit.toml", "--json", "-o", folder / "fit.nc")
    found = json.loads(result.output)
    assert found["method"] == "filter error of the simulation"
    assert found["converged"]
    values = {name: row["estimate"] for name, row in found["parameters"].items()}
    assert values["process.q"] < 0.02
    assert found["parameters"]["process.q"]["start"] == 0.01  # given in the file
    saved = flighttest.maximum_likelihood.open_output_error(folder / "fit.nc")
    assert "process.alpha" in saved.estimates["parameter"].values
    assert "portmanteau_probability" in saved.noise


def fit_with_residual(record, residual):
    """Return the result of a fit without parameters that leaves a residual."""
    nothing = ("parameter", np.zeros(0))
    estimates = xr.Dataset(
        {"estimate": nothing, "start": nothing, "prior_stderr": nothing},
        {"parameter": np.zeros(0, str)},
        {"method": "output error"},
    )
    fit = SimpleNamespace(residuals=(residual,), estimates=estimates, report=lambda: "estimates")
    return FitJobResult(SimpleNamespace(title=""), None, (record,), fit)


def test_a_motion_that_runs_away_has_no_percentage():
    """The error of V is 8.3 times its movement: -6800 % of a movement has no meaning."""
    t = np.linspace(0.0, 10.0, 200)
    record = xr.Dataset({"V": ("time", np.sin(t)), "q": ("time", np.sin(t))}, {"time": t})
    moved = float(np.std(np.sin(t)))
    residual = record.assign(V=("time", np.full(200, 8.3 * moved)), q=0.1 * record["q"])
    result = fit_with_residual(record, residual)
    (line,) = result.unreproduced()
    assert line.startswith("record 1: V: the model does not reproduce the record: its error is 8.3")
    ((_, text),) = [(item.term, item.text) for item in result.remarks]
    assert "%" not in text
    assert result.report_lines()[-2:] == ["  V     none", "  q    98.9%"]


def test_an_output_at_rest_does_not_run_away():
    """Noise, a constant and the last digit of a recorder are not movements that a model lacks."""
    t = np.linspace(0.0, 10.0, 200)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(200)
    still = {"phi": noise, "h": np.full(200, 0.3), "theta": np.where(np.sin(5.0 * t) > 0.9, 1.0, 0)}
    record = xr.Dataset({name: ("time", x) for name, x in {**still, "p": np.sin(t)}.items()})
    # the model holds them at values that are off by twice the noise
    residual = record + 0.002
    residual["p"] = 0.1 * record["p"]
    result = fit_with_residual(record, residual)
    assert result.unreproduced() == []
    assert result.remarks == []
    assert [line.split()[-1] for line in result.report_lines()[-4:]] == [*["rest"] * 3, "98.9%"]
    assert np.isnan(result.explained.sel(output="h"))
    # a model that moves a channel which the record holds is not at rest
    residual["phi"] = record["phi"] - 0.1 * np.sin(t)
    residual["h"] = record["h"] - 3.0 * t
    (line,) = fit_with_residual(record, residual).unreproduced()
    assert line.count("does not reproduce") == 2
    assert "the model moves h, and the record holds it constant" in line


def test_an_error_as_large_as_the_movement_is_unexplained_and_does_not_run_away():
    """A model that holds an output constant explains nothing; its error is the movement itself."""
    record = xr.Dataset({"p": ("time", np.sin(np.linspace(0.0, 10.0, 200)))})
    result = fit_with_residual(record, 1.2 * record)
    assert result.unreproduced() == []
    (remark,) = result.remarks
    assert "p: the model explains none of its movement; a term is missing" in remark.text
