"""The description of a test input as TOML, and the verb ``aeromatch flight design``."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from flightmech.errors import SchemaError
from flighttest.cli.group import flight
from flighttest.flight_programme.input_design.design import design_input
from flighttest.flight_programme.input_design.input_shapes import unit_step
from flighttest.flight_programme.input_design.specification import design_of
from flighttest.flight_programme.input_design.timetable import open_timetable
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.spin.polynomial_models import polynomial_database, read_polynomials

DATA = Path(__file__).parents[3] / "data" / "cz150"
DEG = np.pi / 180.0
MULTISINE = {
    "kind": "multisine",
    "period": "10 s",
    "band": ["0.2 Hz", "2 Hz"],
    "axis": {"delta_e": {"amplitude": "3 deg"}, "delta_r": {"amplitude": 0.05}},
}
DESIGN = """
title = "Elevator and rudder"
kind = "multisine"
period = "10 s"
band = ["0.2 Hz", "2 Hz"]
exclude = [["1.0 Hz", "1.1 Hz"]]
[axis.delta_e]
amplitude = "20 deg"
[axis.delta_r]
amplitude = "6 deg"
spectrum = [["0.2 Hz", 2.0], ["2 Hz", 1.0]]
"""
CONDITION = """
[condition]
kind = "climb"
fixed = { V = "50 ft/s", h = 345.0, beta = 0.0 }
unknowns = ["alpha", "gamma", "phi", "delta_e", "delta_a", "delta_r"]
margin = 0.8
[condition.limits]
alpha = ["-4 deg", "9 deg"]
nz = [0.3, 1.7]
[accuracy]
models = ["Cm = 1 + alpha + qhat + delta_e"]
memory = "0.2 s"
parameters = ["term.Cm.qhat"]
nuisance = ["bias.Cm"]
outputs = { alpha = "0.2 deg", q = "0.15 deg/s" }
"""


def test_a_multisine_in_si():
    signal = design_of(MULTISINE).signal()
    assert np.abs(signal["delta_e"].values).max() == pytest.approx(3.0 * DEG, rel=0.01)
    assert np.abs(signal["delta_r"].values).max() == pytest.approx(0.05, rel=0.01)
    assert signal.attrs["period"] == 10.0


def test_multisteps_follow_each_other():
    axes = {
        "delta_r": {"amplitude": "5 deg", "pattern": "doublet", "omega": "4 rad/s", "free": "2 s"},
        "delta_a": {"amplitude": "5 deg", "widths": [1, 2, 1], "step": "0.3 s"},
    }
    signal = design_of({"kind": "multistep", "axis": axes, "pause": "1 s"}).signal()
    moving = {name: np.flatnonzero(signal[name].values) / 50.0 for name in axes}
    assert moving["delta_r"].max() + 2.0 < moving["delta_a"].min()
    assert np.ptp(moving["delta_r"]) == pytest.approx(2.0 * unit_step("doublet", 4.0), abs=0.05)
    assert np.ptp(moving["delta_a"]) == pytest.approx(1.2, abs=0.05)


def test_no_axis_outruns_its_actuator():
    fast = design_of(MULTISINE).signal()
    limited = {
        **MULTISINE,
        "axis": {
            "delta_e": {"amplitude": "3 deg", "rate_limit": "10 deg/s"},
            "delta_r": {"amplitude": 0.05},
        },
    }
    slow = design_of(limited).signal()
    rate = np.abs(np.diff(slow["delta_e"].values)).max() * 50.0
    assert np.abs(np.diff(fast["delta_e"].values)).max() * 50.0 > 15.0 * DEG
    assert rate == pytest.approx(10.0 * DEG, rel=1e-9)
    assert slow["delta_r"].equals(fast["delta_r"])
    step = {"amplitude": "5 deg", "pattern": "doublet", "step": "0.5 s", "rate_limit": "60 deg/s"}
    with pytest.raises(
        SchemaError, match=r"edges of 8\.73 per second, rate_limit 1\.05; lengthen rise"
    ):
        design_of({"kind": "multistep", "axis": {"delta_e": step}}).signal()
    gentle = design_of(
        {"kind": "multistep", "axis": {"delta_e": {**step, "rise": "0.2 s"}}}
    ).signal()
    assert np.abs(gentle["delta_e"].values).max() == pytest.approx(5.0 * DEG)


def test_a_sweep():
    signal = design_of(
        {
            "kind": "sweep",
            "band": [0.1, 2.0],
            "axis": {"delta_e": {"amplitude": "2 deg", "duration": "60 s"}},
        }
    ).signal()
    assert signal.attrs["active_stop"] - signal.attrs["active_start"] == pytest.approx(
        60.02, abs=0.03
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"perod": 10.0}, "perod: unknown key; near it: period"),
        (
            {"axis": {"delta_e": {"amplitude": "3 m"}}},
            "delta_e: unit 'm' cannot be converted to 'rad'",
        ),
        ({"axis": {}}, "axis"),
        ({"period": None}, "period: missing"),
        ({"band": None}, r"axis\.delta_e\.band: missing"),
        ({"kind": "multistep"}, "give pattern or widths"),
        ({"kind": "sweep"}, r"axis\.delta_e\.duration: missing"),
        ({"condition": {"limits": {"alpha": "9 deg"}}}, r"alpha: expected \[lowest, highest\]"),
        ({"accuracy": {"parameters": ["term.Cm.qhat"]}}, "belong together"),
        ({"kind": "noise"}, "kind"),
    ],
)
def test_faults_are_named(change, text):
    content = {key: value for key, value in {**MULTISINE, **change}.items() if value is not None}
    with pytest.raises(SchemaError, match=text):
        design_of(content).signal()


def test_a_condition_needs_a_model_and_an_accuracy_a_condition():
    with pytest.raises(SchemaError, match="needs the a-priori model"):
        design_input(design_of({**MULTISINE, "condition": {}}))
    with pytest.raises(SchemaError, match="need a condition"):
        design_input(design_of({**MULTISINE, "accuracy": {"models": ["CL = 1 + alpha"]}}))


@pytest.fixture
def files(tmp_path):
    """The published glide of the CZ150 as a database, and two descriptions."""
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    fitted = {c: (p.model, p.estimates) for c, p in read_polynomials(DATA / "glide.csv").items()}
    model, estimates = fitted["Cm"]
    fitted["Cm"] = (
        RegressionModel("Cm", [t for t in model.terms if t != "qhat**3"]),
        np.delete(estimates, model.terms.index("qhat**3")),
    )
    aerodb.save(polynomial_database(fitted, aircraft, title="glide"), tmp_path / "glide.nc")
    (tmp_path / "two_axes.toml").write_text(DESIGN)
    (tmp_path / "limited.toml").write_text(DESIGN + CONDITION)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(flight, ["design", *map(str, arguments)])


def test_design_without_a_model(files):
    result = run(files / "two_axes.toml", "-o", files / "out")
    assert result.exit_code == 0, result.output
    assert "Elevator and rudder" in result.output
    assert sorted(file.name for file in (files / "out").iterdir()) == [
        "two_axes.csv",
        "two_axes.table",
    ]
    assert np.abs(
        open_timetable(files / "out" / "two_axes.table")["delta_e"].values
    ).max() == pytest.approx(20.0 * DEG, rel=0.01)


@pytest.mark.nightly
def test_design_inside_limits(files):
    model = ("--aircraft", DATA / "aircraft.toml", "--database", files / "glide.nc")
    result = run(files / "limited.toml", *model, "-o", files / "out", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    axes, response = (
        {row["axis" if "axis" in row else "quantity"]: row for row in found[key]}
        for key in ("axes", "response")
    )
    assert axes["delta_e"]["factor"] < 1.0
    assert response["nz"]["highest"] <= 1.0 + 0.8 * 0.7 + 1e-3
    assert response["alpha"]["highest"] <= 9.0 * DEG
    assert found["expected"]["Cm = 1 + alpha + qhat + delta_e"]["qhat"][
        "estimate"
    ] == pytest.approx(-9.1, rel=0.1)
    assert 0.0 < found["expected"]["output error (alpha q)"]["term.Cm.qhat"]["stderr"] < 0.2
    played = open_timetable(files / "out" / "limited.table")
    assert np.abs(played["delta_e"].values).max() == pytest.approx(
        axes["delta_e"]["peak"], rel=1e-9
    )
    assert (files / "out" / "limited_response.csv").is_file()
    text = run(files / "limited.toml", *model, "-o", files / "out").output
    assert "predicted response; each axis fitted alone" in text
    assert "std error" in text


def test_a_condition_without_model_files_is_a_usage_error(files):
    result = run(files / "limited.toml", "-o", files / "out")
    assert result.exit_code == 2
    assert "give --aircraft and --database" in result.output
