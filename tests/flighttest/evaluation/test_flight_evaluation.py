"""The evaluation of a whole flight on a simulated one, from the command line; bad plans, bad sheets
and bad records by name.
"""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner
from glider_flight import LOADING, NAMES, PLAN, write_glider_flight

import flightmech
from flightmech.errors import IdentificationError, ParseError, SchemaError, UnknownName
from flighttest.cli.group import flight
from flighttest.flight_programme.evaluation.figures_of_merit import (
    FigureOfMerit,
    _mean_of_channel,
    judge_bounds,
    line_through,
)
from flighttest.flight_programme.evaluation.flight_evaluation import evaluate_flight
from flighttest.flight_programme.evaluation.mass_and_thrust import (
    deck_thrust,
    mass_after_burn,
    thrust_remarks,
)
from flighttest.flight_programme.evaluation.plan import (
    Bound,
    EvaluationPlan,
    SheetColumn,
    StraightLine,
    ThrustPoints,
    read_plan,
    read_sheet,
)


@pytest.fixture
def folder(tmp_path):
    """A flight with a Dutch roll at 20 s, kinematically exact."""
    write_glider_flight(tmp_path)
    return tmp_path


def call(*words):
    return CliRunner().invoke(flight, [str(word) for word in words], catch_exceptions=False)


def change(folder, old, new):
    text = (folder / "plan.toml").read_text()
    assert old in text
    (folder / "plan.toml").write_text(text.replace(old, new))
    return folder / "plan.toml"


@pytest.mark.nightly
def test_report_passes_and_writes_a_page(folder):
    done = call(
        "report",
        folder / "plan.toml",
        "-o",
        folder / "page.html",
        "--save",
        folder / "out",
        "--json",
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["verdict"] == "2 of 2 figures inside their bounds"
    assert found["figures"]["dutch_roll.period"]["value"] == pytest.approx(np.pi, rel=1e-3)
    assert [row["verdict"] for row in found["bounds"]] == ["inside", "inside"]
    assert sorted(file.name for file in (folder / "out").iterdir()) == ["record.nc"]
    page = (folder / "page.html").read_text()
    assert "2 of 2 figures inside their bounds" in page
    assert "dutch_roll.period" in page
    assert "<svg" in page
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.nightly
def test_a_figure_outside_its_bounds_is_exit_code_1(folder):
    done = call("report", change(folder, "3.1416 s", "3.5 s"))
    assert done.exit_code == 1
    assert "! dutch_roll.period" in done.stdout
    assert "1 of 2 figures inside their bounds" in done.stdout


def test_what_the_record_does_not_show_is_not_determined(folder):
    done = call(
        "report",
        change(folder, "window = [0.0, 15.0]\nchannels", "window = [-9.0, -1.0]\nchannels"),
    )
    assert done.exit_code == 1
    assert "! dutch_roll not determined: no motion: r moves by" in done.stdout
    assert "0 of 2 figures inside their bounds; not determined: dutch_roll" in done.stdout


@pytest.mark.slow
def test_a_wrong_sign_stops_the_evaluation_by_name(folder):
    (folder / "names.toml").write_text(NAMES.replace('p = "p"', 'p = { column = "p", sign = -1 }'))
    done = call("report", folder / "plan.toml", "-o", folder / "page.html")
    assert done.exit_code == 1
    assert "not evaluated: the record is not fit for it" in done.stdout
    assert "sign:p" in done.stdout
    assert "dutch_roll.period                  - (-) s" in done.stdout  # no confident number
    assert "sign:p" in (folder / "page.html").read_text()


@pytest.mark.nightly
def test_wrong_units_and_gaps_are_named(folder):
    (folder / "names.toml").write_text(
        NAMES.replace('r = "r"', 'r = { column = "r", unit = "deg/s" }').replace(
            'q = "q"', 'q = { column = "q", unit = "deg/s" }'
        )
    )
    done = call("report", folder / "plan.toml")
    assert done.exit_code == 1
    assert "unit:" in done.stdout or "inconsistent:" in done.stdout
    lines = (folder / "flight.csv").read_text().splitlines()
    (folder / "names.toml").write_text(NAMES)
    (folder / "flight.csv").write_text(
        "\n".join(lines[:302] + lines[382:]) + "\n"
    )  # 4 s are missing
    done = call("report", folder / "plan.toml")
    assert "gap:" in done.stdout


def test_all_mistakes_of_a_plan_come_at_once(folder):
    change(
        folder, 'window = [0.0, 15.0]\nchannels = ["r"]', 'windw = [0.0, 15.0]\nchannels = ["r"]'
    )
    with pytest.raises(
        SchemaError, match=r"(?s)window: missing.*windw: unknown key; near it: window"
    ):
        read_plan(folder / "plan.toml")
    (folder / "plan.toml").write_text(PLAN)
    with pytest.raises(
        SchemaError, match=r"bound 1: unknown figure 'dutch_roll.perod'; near it: dutch_roll.period"
    ):
        evaluate_flight(change(folder, "dutch_roll.period", "dutch_roll.perod"))
    (folder / "plan.toml").write_text(PLAN)
    with pytest.raises(SchemaError, match=r"mode.0.name: string should match pattern"):
        read_plan(change(folder, 'name = "dutch_roll"', 'name = "../roll"'))
    (folder / "plan.toml").write_text(PLAN)
    with pytest.raises(SchemaError, match="cannot be converted"):
        evaluate_flight(change(folder, "3.1416 s", "3.1416 m"))
    (folder / "plan.toml").write_text(PLAN)
    with pytest.raises(SchemaError, match=r"no file .*absent.csv; names are relative to the plan"):
        evaluate_flight(change(folder, "flight.csv", "absent.csv"))


def test_an_unknown_manoeuvre_is_reported_with_near_names(folder):
    found = evaluate_flight(change(folder, 'on = "dutch_roll"', 'on = "dutch_rol"'))
    assert found.refused["dutch_roll"].startswith(
        "unknown manoeuvre 'dutch_rol'; near it: dutch_roll"
    )
    assert not found.passed


def test_mass_and_centre_of_gravity_by_hand(folder):
    (folder / "plan.toml").write_text(PLAN.replace("[manoeuvres]", LOADING + "\n[manoeuvres]", 1))
    sheet = read_plan(folder / "plan.toml").loading
    aircraft = flightmech.read_aircraft(folder / "aircraft.toml")
    mass, x_cg_b = mass_after_burn(sheet, aircraft, np.array([0.0, 100.0 * 0.45359237]))
    assert mass == pytest.approx(np.array([2200.0, 2100.0]) * 0.45359237)
    stations = (
        np.array(
            [(1500 * 110 + 400 * 90 + 300 * 120) / 2200, (1500 * 110 + 400 * 90 + 200 * 120) / 2100]
        )
        * 0.0254
    )
    assert x_cg_b == pytest.approx(100 * 0.0254 + 0.25 * 1.5 - stations)
    with pytest.raises(SchemaError, match=r"fuel left is -.* check the unit of the fuel flow"):
        mass_after_burn(sheet, aircraft, np.array([400.0]))


def test_thrust_of_deck_points(tmp_path):
    from flightmech.air import P_SEA, T_SEA, atmosphere

    rng = np.random.default_rng(0)
    h, mach, flow = (
        rng.uniform(0.0, 8000.0, 30),
        rng.uniform(0.2, 0.6, 30),
        rng.uniform(0.02, 0.1, 30),
    )
    air = atmosphere(h)
    delta = np.asarray(air.p_static) / P_SEA
    corrected = flow / (delta * np.sqrt(np.asarray(air.temperature) / T_SEA))
    thrust = delta * (100.0 + 3e4 * corrected - 500.0 * mach)
    columns = {"h": h, "mach": mach, "delta_T": 0.0 * h, "fuel_flow": flow, "thrust": thrust}
    pd.DataFrame(columns).to_csv(tmp_path / "deck.csv", index=False)
    deck = ThrustPoints(
        file=tmp_path / "deck.csv", **{name: SheetColumn(column=name) for name in columns}
    )
    assert deck_thrust(deck, h, mach, np.asarray(air.temperature), flow) == pytest.approx(
        thrust, rel=1e-6
    )
    pd.DataFrame({**columns, "thrust": rng.uniform(0.0, 3000.0, 30)}).to_csv(
        tmp_path / "deck.csv", index=False
    )
    with pytest.raises(
        IdentificationError, match=r"reproduce the points within .* N only; check its units"
    ):
        deck_thrust(deck, h, mach, np.asarray(air.temperature), flow)


def test_thrust_beyond_the_points_of_the_deck_is_remarked(tmp_path):
    columns = {"h": [0.0, 3000.0], "mach": [0.2, 0.4], "delta_T": [0.0, 0.0]}
    columns |= {"fuel_flow": [0.05, 0.04], "thrust": [2e3, 2e3]}
    pd.DataFrame(columns).to_csv(tmp_path / "deck.csv", index=False)
    deck = ThrustPoints(
        file=tmp_path / "deck.csv", **{name: SheetColumn(column=name) for name in columns}
    )
    time = np.arange(100.0)
    channels = {"engine1.fuel_flow": 0.05 + 0.0 * time, "h_baro": 0.0 * time}
    channels |= {"mach": np.where(time < 50.0, 0.3, 0.6), "temperature": 288.15 + 0.0 * time}
    variables = {name: ("time", values) for name, values in channels.items()}
    record = xr.DataTree.from_dict({"all": xr.Dataset(variables, {"time": time})})
    aircraft = SimpleNamespace(engines=("left",))
    assert thrust_remarks(record, aircraft, deck, [(10.0, 40.0)]) == []
    (remark,) = thrust_remarks(record, aircraft, deck, [(10.0, 19.0), (60.0, 69.0)])
    assert (remark.term, remark.value) == ("engine1.thrust", 0.5)
    assert "Mach number is 0.3 ... 0.6, the points of deck.csv have 0.2 ... 0.4" in remark.text


def test_line_through_points_by_hand():
    points = pd.DataFrame({"alpha_vane": [0.0, 1.0, 2.0, 3.0], "CL": [1.1, 2.9, 5.1, 6.9]})
    found = line_through(StraightLine(name="lift", y="CL", x="alpha_vane"), points)
    # x mean 1.5, Sxx 5, Sxy 9.8, residuals +-0.08 and +-0.24: sum of squares 0.072 + ... = 0.128
    # less rounding
    rest = points["CL"] - (1.06 + 1.96 * points["alpha_vane"])
    assert found.slope == pytest.approx((1.96, np.sqrt(float((rest**2).sum()) / 2.0 / 5.0)))
    assert found.offset[0] == pytest.approx(1.06)
    assert found.root[0] == pytest.approx(-1.06 / 1.96)
    with pytest.raises(IdentificationError, match="3 points; 4 or more are needed"):
        line_through(StraightLine(name="lift", y="CL", x="alpha_vane"), points[:3])
    with pytest.raises(IdentificationError, match="no excitation, alpha_vane is 1 at all points"):
        line_through(
            StraightLine(name="lift", y="CL", x="alpha_vane"), points.assign(alpha_vane=1.0)
        )
    with pytest.raises(UnknownName, match="unknown mean 'alpha'; near it: alpha_vane"):
        line_through(StraightLine(name="lift", y="CL", x="alpha"), points)


def test_a_point_without_a_mean_is_no_point_of_a_line():
    points = pd.DataFrame({"alpha_vane": [0.0, 1.0, 2.0, 3.0, 4.0], "CL": [1, 3, 5, 7, np.nan]})
    with pytest.raises(IdentificationError, match="1 of 5 points have no mean of alpha_vane and"):
        line_through(StraightLine(name="lift", y="CL", x="alpha_vane"), points)


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [([359.0, 1.0, 0.0], 0.0), ([-179.0, 179.0, -177.0], -179.0), ([350.0, 10.0, np.nan], 0.0)],
)
def test_the_mean_heading_of_a_point_is_within_the_turn(degrees, expected):
    mean = np.rad2deg(_mean_of_channel("psi", np.radians(degrees)))
    assert (mean - expected + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)


def test_a_figure_without_a_number_is_not_determined():
    bound = Bound(of="delay.theta", low=-0.02, high=0.02, source="our limit")
    plan = EvaluationPlan(title="t", record="r.csv", aircraft="a.toml", bound=[bound])
    cases = [(0.01, 0.001, "inside"), (0.03, 0.001, "outside"), (np.nan, 0.001, "not determined")]
    # its error is larger than the distance between the bounds
    cases += [(0.01, 0.05, "not determined"), (0.03, 0.05, "outside"), (0.01, np.nan, "inside")]
    for value, error, verdict in cases:
        figures = {"delay.theta": FigureOfMerit(value, error, "s")}
        assert list(judge_bounds(plan, figures)["verdict"]) == [verdict]


def test_faulty_sheets_name_line_and_column(tmp_path):
    file = tmp_path / "sheet.csv"
    file.write_text("a,b\n1,2\n1\n")
    with pytest.raises(ParseError, match="line 3: found 1 cells; expected 2"):
        read_sheet(file)
    file.write_text("a,b\n1,two\n")
    with pytest.raises(ParseError, match="line 2: found 'two' in column b; expected a number"):
        SheetColumn(column="b").of(read_sheet(file), "m")
    with pytest.raises(UnknownName, match="unknown column 'c'"):
        SheetColumn(column="c").of(read_sheet(file), "m")
    with pytest.raises(SchemaError, match="column a: unit 'kg' cannot be converted to 'm'"):
        SheetColumn(column="a", unit="kg").of(read_sheet(file), "m")


@pytest.mark.nightly
def test_modes_on_the_command_line(folder):
    base = [
        "modes",
        folder / "flight.csv",
        20.0,
        35.0,
        "--names",
        folder / "names.toml",
        "--channel",
        "r",
    ]
    found = json.loads(call(*base, "--json").stdout)
    assert found["period"]["value"] == pytest.approx(np.pi, rel=1e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(0.0995, abs=1e-3)
    assert "period" in call(*base).stdout
    with pytest.raises(UnknownName, match="unknown channel 'rr'"):
        call(*base[:-1], "rr")
    wrong = folder / "wrong.toml"
    shutil.copy(folder / "names.toml", wrong)
    wrong.write_text(NAMES.replace('phi = "phi"', 'phi = { column = "phi", sign = -1 }'))
    with pytest.warns(flightmech.errors.AeromatchWarning, match="sign:phi"):
        call("modes", folder / "flight.csv", 20.0, 35.0, "--names", wrong, "--channel", "phi")


@pytest.mark.slow
def test_a_motion_that_must_not_be_used_has_no_figure_inside_its_bounds(folder, monkeypatch):
    monkeypatch.setattr("flighttest.submodels.aircraft_properties.eigenmotion.PURE", 1.1)
    done = call("report", folder / "plan.toml", "-o", folder / "page.html", "--json")
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert found["verdict"] == "0 of 2 figures inside their bounds; not to be used: dutch_roll"
    assert found["bounds"][0]["verdict"] == "not determined"
    assert found["remarks"]["dutch_roll"][0]["kind"] == "no excitation"
    assert "no excitation: the oscillation explains" in (folder / "page.html").read_text()


@pytest.mark.slow
def test_modes_on_a_quiet_stretch_end_with_exit_code_1(tmp_path):
    """Noise that lasts a second: an oscillation explains more than half of it in twelve seconds,
    and none is there.
    """
    rng, r = np.random.default_rng(9), [0.0]
    for _ in range(119):
        r.append(0.9 * r[-1] + 0.01 * rng.standard_normal())
    rows = [f"{0.1 * k:.1f},{x:.9g}" for k, x in enumerate(r)]
    (tmp_path / "quiet.csv").write_text("\n".join(["t,r", "s,rad s-1", *rows]) + "\n")
    (tmp_path / "names.toml").write_text('[time]\ncolumn = "t"\n[ahrs]\nr = "r"\n')
    base = [
        "modes",
        tmp_path / "quiet.csv",
        0.0,
        11.9,
        "--names",
        tmp_path / "names.toml",
        "--channel",
        "r",
    ]
    done = call(*base)
    assert done.exit_code == 1
    assert "!! no excitation: the oscillation explains" in done.stdout
    found = call(*base, "--json")
    assert found.exit_code == 1
    assert json.loads(found.stdout)["remarks"][0]["severity"] == "error"
