"""The figures of LR-743: what is drawn against the database, the numbers of its table 2 and the
records.
"""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.cli.group import db as group
from aerodb.figures.lr743_set import build_up, ground_effect, polars, sheet
from aerodb.figures.lr743_set import envelope as trimmed
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import combine_coefficients, remove_moving_devices
from aerodb.figures.lr743_set.flown import (
    _sample_conditions,
    group_heights,
)
from aerodb.figures.lr743_set.sheet import draw_chart
from aerodb.update.correlation import covariance_between
from flightmech import terms
from flightmech.air import atmosphere
from flightmech.envelope.maps import configuration_text
from flightmech.errors import ParseError, SchemaError
from flightmech.units import DEGREE, G0

ALPHA = np.radians([-8.0, 0.0, 8.0, 16.0])
FLAP = np.radians([0.0, 20.0, 40.0])
FREE_AIR = 1e4


@pytest.fixture
def rich(small):
    """The small database with an elevator that alpha and flaps change, rates, drag and moments."""
    elevator = 0.5 + 0.1 * np.outer(FLAP, np.ones(4)) + np.outer(np.ones(3), 0.2 * ALPHA)
    more = {
        "CL/elevator": terms.make_term(
            elevator, {"delta_f": FLAP, "alpha": ALPHA}, ["delta_e"], stderr=0.03, source="datcom"
        ),
        "CL/alphadothat": terms.make_term(
            2.0, regressors=["alphadothat"], stderr=0.6, source="datcom"
        ),
        "CD/basic": terms.make_term(0.02, stderr=0.002, source="datcom"),
        "CD/induced": terms.make_term(
            0.05 * (0.2 + 5.0 * ALPHA) ** 2, {"alpha": ALPHA}, stderr=0.001, source="datcom"
        ),
        "Cm/basic": terms.make_term(-0.5 * ALPHA, {"alpha": ALPHA}, source="datcom"),
        "Cm/elevator": terms.make_term(-1.2, regressors=["delta_e"], source="datcom"),
    }
    return aerodb.replace_terms(small, more)


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.Aircraft(
        name="test",
        S=16.9,
        cbar=1.667,
        b=10.31,
        mass=2000.0,
        Ixx=1e4,
        Iyy=8e3,
        Izz=1.5e4,
        limits={"delta_e": (-0.35, 0.35)},
    )


@pytest.fixture(scope="module")
def flown_file(tmp_path_factory):
    """One clean doublet at Mach 0.3, one with flaps, a low pass, and three local estimates."""
    time = np.arange(0.0, 4.0, 0.2)
    alpha = np.radians(4.0 + 2.0 * np.sin(time))
    low = {"h_agl": 1.7, "delta_f": FLAP[2], "gear": 1.0, "h": 50.0}
    rows = [
        {
            "record": "run_1",
            "label": "doublet elevator",
            "h": 1500.0,
            "mach": 0.3,
            "mass": 2000.0,
            "h_agl": 1500.0,
        },
        {
            "record": "run_2",
            "label": "doublet elevator",
            "h": 1600.0,
            "mach": 0.25,
            "mass": 2100.0,
            "delta_f": FLAP[1],
        },
        {"record": "run_3", "label": "low_pass_steady", "mach": 0.15, "mass": 1900.0, **low},
    ]
    rest = {
        "start": 0.0,
        "end": 4.0,
        "CL": 0.5,
        "CD": 0.03,
        "alpha": 0.07,
        "delta_f": 0.0,
        "gear": 0.0,
        "speedbrake": 0.0,
        "h_agl": FREE_AIR,
    }
    manoeuvres = pd.DataFrame([{**rest, **row} for row in rows])
    parts = []
    for i, row in manoeuvres.iterrows():
        same = {
            name: row[name]
            for name in ("mach", "h", "h_agl", "delta_f", "gear", "speedbrake", "mass")
        }
        parts.append(
            pd.DataFrame(
                {
                    "manoeuvre": i,
                    "alpha": alpha,
                    "CL": 0.2 + 5.2 * alpha,
                    "phi": 0.1,
                    "Cl": -0.01,
                    "delta_e": 0.0,
                    **same,
                }
            )
        )
    means = {
        "alpha": 0.07,
        "mach": 0.3,
        "delta_f": 0.0,
        "gear": 0.0,
        "speedbrake": 0.0,
        "h_agl": FREE_AIR,
    }
    estimates = pd.DataFrame(
        [
            {
                "fit": "a",
                "coefficient": "CL",
                "term": "alpha",
                "estimate": 5.1,
                "stderr": 0.04,
                **means,
            },
            {
                "fit": "b",
                "coefficient": "CL",
                "term": "alpha",
                "estimate": 9.9,
                "stderr": 0.04,
                **means,
                "gear": 1.0,
            },
            {
                "fit": "a",
                "coefficient": "CL",
                "term": "delta_e",
                "estimate": 0.55,
                "stderr": 0.02,
                **means,
                "delta_f": FLAP[1],
            },
        ]
    )
    submodels = pd.DataFrame(
        [
            {
                "submodel": "column",
                "part": "slow motion",
                "technique": "type 2, equation error",
                "residual": "rms 3 N",
            }
        ]
    )
    ground = pd.DataFrame(
        [
            {
                "coefficient": "CL",
                "term": "1",
                "y_inf": 0.827,
                "k": 0.599,
                "k_stderr": 0.02,
                "s": -1.45,
                "s_stderr": 0.05,
                "correlation": -0.9,
            }
        ]
    ).assign(note="")
    tables = {
        "samples": pd.concat(parts),
        "manoeuvres": manoeuvres,
        "estimates": estimates,
        "submodels": submodels,
        "ground": ground,
    }
    nodes = {}
    for name, table in tables.items():
        columns = {c: table[c].to_numpy() for c in table}
        nodes[name] = xr.Dataset(
            {c: (name, v.astype(str) if v.dtype == object else v) for c, v in columns.items()}
        )
    file = tmp_path_factory.mktemp("flown") / "flown.nc"
    xr.DataTree.from_dict(nodes).to_netcdf(file, engine="h5netcdf")
    return file


@pytest.fixture(scope="module")
def flown(flown_file):
    return aerodb.figures.read_flown(flown_file)


def lines(chart, panel=0):
    return {line.label: line for line in chart.panels[panel].lines}


def points(chart, panel=0):
    return {item.label: item for item in chart.panels[panel].points}


def test_a_difference_has_the_standard_error_of_correlated_nodes(rich):
    """A chord over two nodes of one table is known better than its ends: their errors are
    correlated.
    """
    leaf = aerodb.terms(rich)["CL/basic"]
    value, stderr = combine_coefficients(
        rich, "CL", (1.0, {"alpha": ALPHA[2], "mach": 0.2}), (-1.0, {"alpha": 0.0, "mach": 0.2})
    )
    np.testing.assert_allclose(value, 5.0 * 8.0 * DEGREE)
    P = covariance_between(leaf, np.array([1, 2])[:, None], np.array([1, 2])[None, :])
    np.testing.assert_allclose(stderr, np.sqrt(P[0, 0] + P[1, 1] - 2.0 * P[0, 1]))
    assert stderr < np.hypot(0.05, 0.05)


def test_a_coefficient_in_a_term_is_that_of_the_conditions(rich):
    """A parabolic polar as a term over CL: drag follows the lift of each condition."""
    db = aerodb.replace_terms(
        rich, {"CD/of_lift": terms.make_term(np.array([0.0, 0.3]), {"CL": [0.0, 1.0]})}
    )
    value, _ = combine_coefficients(
        db, "CD", (1.0, {"alpha": ALPHA[2], "mach": 0.2}), (-1.0, {"alpha": ALPHA[1], "mach": 0.2})
    )
    lift = 5.0 * ALPHA[2]
    np.testing.assert_allclose(value, 0.05 * ((0.2 + lift) ** 2 - 0.04) + 0.3 * lift)


@pytest.mark.slow
def test_figures_1_and_2_set_databases_over_each_other(rich, flown):
    steeper = aerodb.replace_terms(
        rich,
        {"CL/basic": aerodb.terms(rich)["CL/basic"].assign(value=lambda leaf: 1.1 * leaf["value"])},
    )
    both = {"datcom": rich, "final": steeper}
    chart = build_up.lift_intercept_chart(both, flown)
    np.testing.assert_allclose(lines(chart)["datcom"].y, 0.2)
    np.testing.assert_allclose(lines(chart)["final"].y, 0.22)
    np.testing.assert_allclose(lines(chart)["datcom"].stderr[[0, -1]], 0.05)
    chart = build_up.lift_slope_chart(both, flown)
    np.testing.assert_allclose(
        np.interp([0.2, 0.3, 0.4], lines(chart)["datcom"].x, lines(chart)["datcom"].y),
        [5.0, 5.2, 5.4],
    )
    (estimate,) = chart.panels[0].points  # the one with gear is not of the clean aeroplane
    assert (estimate.x, estimate.y, estimate.stderr) == (0.3, 5.1, 0.04)


def test_figures_3_and_4_follow_flaps_and_angle_of_attack(rich, flown):
    chart = build_up.flap_increment({"datcom": rich}, None, "figure-03", "Fig. 3")
    by = lines(chart)
    assert list(by) == [r"$\delta_{f}$ = 20 deg", r"$\delta_{f}$ = 40 deg"]
    np.testing.assert_allclose(by[r"$\delta_{f}$ = 40 deg"].y, 0.36)
    np.testing.assert_allclose(by[r"$\delta_{f}$ = 20 deg"].stderr, 0.04)
    chart = build_up.elevator_chart({"final": rich}, flown, "figure-14", "Fig. 14")
    line = lines(chart)[r"$\delta_{f}$ = 20 deg"]
    np.testing.assert_allclose(line.y, 0.5 + 0.1 * FLAP[1] + 0.2 * np.radians(line.x))
    np.testing.assert_allclose(line.stderr[[0, -1]], 0.03)
    # The elevator rests in all manoeuvres: none requires a derivative.
    assert not chart.panels[0].points


def test_points_of_figure_14_are_flight_less_all_other_terms(rich, flown):
    """A local model that gives a part of the elevator's lift to alpha has the wrong derivative: the
    points of the figure are those of the whole coefficient, 0.06 above the database here.
    """
    samples = flown.samples.copy()
    step = samples.groupby("manoeuvre").cumcount().to_numpy()
    samples["delta_e"] = np.where(samples["manoeuvre"] < 2, 0.05 * np.sin(0.9 * step), 0.0)
    samples["qhat"], samples["time"] = 0.0, 0.2 * step
    conditions = _sample_conditions(rich, samples)
    database = aerodb.evaluate(
        rich, "CL", "clamp", **{**remove_moving_devices(rich, "CL"), **conditions}
    )
    samples["CL"] = database + 0.3 + 0.06 * samples["delta_e"]
    moved = dataclasses.replace(flown, samples=samples)
    chart = build_up.elevator_chart({"final": rich}, moved, "figure-14", "Fig. 14")
    clean, flaps = chart.panels[0].points
    assert (clean.member, flaps.member) == (0, 1)
    slope = 0.5 + 0.2 * np.average(samples["alpha"][:20], weights=samples["delta_e"][:20] ** 2)
    np.testing.assert_allclose(clean.y, slope + 0.06, atol=2e-3)
    assert any("less all other terms" in note for note in chart.notes)


def test_a_band_is_whole_in_its_axes_or_the_figure_states_it():
    """The band of a flat line was cut on both sides: it has no range of its own."""
    x = np.linspace(0.0, 1.0, 11)
    flat = ChartLine("flat", x, np.full(11, 0.7), np.full(11, 0.1))
    wild = ChartLine("wild", x, x, np.where(x < 0.95, 0.02, 40.0))

    def chart(line):
        panel = ChartPanel("", [line])
        return Chart("x", "Fig. 4", "t", "l", "x", "y", panels=[panel])

    _, (low, high) = sheet._chart_limits(chart(flat))
    assert low < 0.6 < 0.8 < high
    assert not sheet._is_cut(chart(flat))
    _, (low, high) = sheet._chart_limits(chart(wild))
    assert -4.0 < low < 0.0 < 1.0 < high < 4.0
    assert sheet._is_cut(chart(wild))


def test_figure_15_holds_both_rates_and_one_line_where_flaps_change_nothing(rich):
    (line,) = build_up.pitch_rate({"final": rich}, None).panels[0].lines
    assert line.label == "all"
    np.testing.assert_allclose(line.y, 8.0 + 2.0)
    np.testing.assert_allclose(line.stderr, np.hypot(2.0, 0.6))


@pytest.fixture
def published(root):
    """Flap 40 deg of LR-743 table 2: y = k y_inf h^s."""

    def power(s):
        return terms.PowerFactor("h_agl", s, 1.0)

    found = {
        "CL/basic": terms.make_term(0.827 + 4.87 * ALPHA, {"alpha": ALPHA}),
        "CL/ground": terms.make_term(0.599 * 0.827, power=power(-1.45)),
        "CL/ground_alpha": terms.make_term(0.506 * 4.87, regressors=["alpha"], power=power(-1.75)),
        "Cl/ground": terms.make_term(-0.078, regressors=["CL", "phi"], power=power(-1.09)),
        "CD/basic": terms.make_term(0.1),
        "Cm/basic": terms.make_term(-0.5 * ALPHA, {"alpha": ALPHA}),
    }
    return aerodb.make_database(found, **{**root, "b": 14.35, "absent": ""})


def test_figures_16_and_17_have_the_numbers_of_table_2(published, monkeypatch):
    """Computed from the printed table: CL at alpha 5 deg, and the rolling moment per CL phi."""
    monkeypatch.setattr(ground_effect, "_SPANS", (1.7 / 14.35, 3.0 / 14.35, 8.5 / 14.35))
    by = lines(ground_effect.near_the_ground({"final": published}, None))
    assert list(by) == ["1.7 m", "3 m", "8.5 m", "free air"]
    lift = {label: float(np.interp(5.0, line.x, line.y)) for label, line in by.items()}
    np.testing.assert_allclose(list(lift.values()), [1.566, 1.384, 1.279, 1.252], atol=6e-4)
    by = lines(ground_effect.bank_near_the_ground({"final": published}, None))
    slopes = {label: np.polyfit(line.x, line.y, 1)[0] for label, line in by.items()}
    np.testing.assert_allclose(list(slopes.values()), [-0.0437, -0.0236, -0.0076, 0.0], atol=6e-5)


def test_low_passes_are_drawn_at_their_height(published, flown):
    chart = ground_effect.near_the_ground({"final": published}, flown)
    assert list(lines(chart)) == ["1.7 m", "free air"]
    samples = points(chart)["samples at 1.7 m"]
    np.testing.assert_allclose(samples.y, 0.2 + 5.2 * np.radians(samples.x))
    chart = ground_effect.bank_near_the_ground({"final": published}, flown)
    samples = points(chart)["samples at 1.7 m"]
    np.testing.assert_allclose(samples.y, -0.01)  # the database has no other term of Cl
    np.testing.assert_allclose(
        samples.x,
        0.1
        * (
            0.2
            + 5.2
            * np.radians(
                points(ground_effect.near_the_ground({"f": published}, flown))["samples at 1.7 m"].x
            )
        ),
    )


def test_what_is_missing_is_named(small, flown):
    for make, words in (
        (
            lambda: build_up.elevator_chart({"a": small}, None, "x", "Fig. 4"),
            "no term of CL depends on delta_e",
        ),
        (
            lambda: ground_effect.near_the_ground({"a": small}, None),
            "no term of CL depends on h_agl; it needs DATCOM cases with GRNDEF",
        ),
        (
            lambda: ground_effect.bank_near_the_ground({"a": small}, None),
            r"no term of Cl over h_agl and phi \(LR-743 eq. 14\)",
        ),
        (
            lambda: trimmed.polars_clean({"a": small}, {}, None),
            "it needs the aircraft of a: give --aircraft",
        ),
        (lambda: trimmed.elevator_sweep_chart({"a": small}, None), "no sweeps of flown manoeuvres"),
    ):
        with pytest.raises(NotDrawn, match=words):
            make()


def test_figure_9_has_stall_one_g_lines_test_points_and_excursions(rich, aircraft, flown):
    buffet = pd.DataFrame({"mach": [0.3, 0.4], "CL": [0.9, 0.7]})
    chart = trimmed.flight_envelope_chart({"final": rich}, {"final": aircraft}, flown, buffet)
    by = lines(chart)
    stall = by["stall, trimmed, power off (final)"]
    curve = flightmech.performance.polar(polars.trim_configuration(aircraft, rich, {}), 0.4)
    np.testing.assert_allclose(stall.y[-1], curve["CL"].max())
    level = by["1 g, 4900 ft, 2000 kg"]
    np.testing.assert_allclose(
        level.y * level.x**2, 2.0 * 2000.0 * G0 / (1.4 * atmosphere(1500.0).p_static * aircraft.S)
    )
    assert (by["buffet"].y == [0.9, 0.7]).all()
    point = points(chart)["test point, 4900 ft"]
    assert (point.x, point.y) == (0.3, 0.5)
    trace = points(chart)["samples of flight"]
    np.testing.assert_allclose(trace.y, flown.samples["CL"][flown.samples["manoeuvre"] == 0])


@pytest.mark.nightly
def test_one_g_lines_have_the_mass_and_the_configuration_that_was_flown(rich, aircraft, flown):
    """One line for each height and setting; at its Mach number the lift of the tables with the
    elevator in balance carries the weight.
    """
    rows = pd.concat(
        [flown.manoeuvres.assign(h=[1500.0, 1560.0, 50.0]), flown.manoeuvres.assign(h=1590.0)[:1]]
    )
    found, remarks = aerodb.figures.one_g_lines(rich, aircraft, rows)
    assert remarks == []
    assert list(found) == [
        "5100 ft, 2000 kg, clean",
        "5100 ft, 2100 kg, flaps 20 deg",
        "200 ft, 1900 kg, flaps 40 deg, gear",
    ]
    line = found["5100 ft, 2000 kg, clean"]
    assert (line.attrs["h"], line.attrs["mass"], line.attrs["configuration"]) == (
        1545.0,
        2000.0,
        "clean",
    )
    assert (line["mach"].values[0], line["mach"].values[-1]) == pytest.approx(
        (0.8 * 0.15, 1.15 * 0.3)
    )
    at = line.interp(mach=0.3)
    air, alpha, delta_e = atmosphere(1545.0), float(at["alpha"]), float(at["delta_e"])
    place = {"alpha": alpha, "delta_e": delta_e, "mach": 0.3}
    lift, drag = (combine_coefficients(rich, name, (1.0, place))[0] for name in ("CL", "CD"))
    carried = (
        0.5 * float(air.rho) * (0.3 * float(air.a_sound)) ** 2 * aircraft.S * np.hypot(lift, drag)
    )  # power off: the glide
    assert carried.item() == pytest.approx(
        2000.0 * G0, rel=2e-3
    )  # interpolated between points of the line
    far = aerodb.figures.one_g_lines(rich, aircraft, rows.assign(mass=1e6))
    assert far[0] == {}
    assert far[1][0] == "5100 ft, 1000000 kg, clean: no steady flight up to Mach 0.3"
    assert aerodb.figures.one_g_lines(rich, aircraft, rows.assign(mach=np.nan)) == ({}, [])


def test_partial_residuals_find_the_term_that_made_the_samples():
    """Samples by a known model: what all but one term leave is that term, where its regressors were
    excited; standard errors hold.
    """
    rng, time = np.random.default_rng(5), np.arange(0.0, 12.0, 0.1)
    true = {"CY/beta": -0.9, "CY/beta_flap": -0.4, "CY/basic": 0.003}
    db = aerodb.make_database(
        {
            "CY/beta": terms.make_term([true["CY/beta"]] * 2, {"alpha": np.array([-0.1, 0.3])},
                ["beta"]),
            "CY/beta_flap": terms.make_term(0.0, regressors=["beta", "delta_f"]),
            "CY/basic": terms.make_term(true["CY/basic"]),
        },
        title="x", aircraft="x", force_axes="stability", S=16.9, cbar=1.67, b=10.3, x_ref=0.0,
        y_ref=0.0, z_ref=0.0,
    )  # fmt: skip
    parts, rows = [], []
    for k, (flap, size) in enumerate(
        [(0.0, 0.05), (FLAP[1], 0.05), (FLAP[2], 0.1), (FLAP[2], 1e-4)]
    ):
        beta = size * np.sin(time)
        own = {
            "alpha": 0.06,
            "mach": 0.2,
            "h": 1500.0,
            "h_agl": FREE_AIR,
            "delta_f": flap,
            "gear": 0.0,
            "speedbrake": 0.0,
        }
        force = (
            true["CY/basic"]
            + (true["CY/beta"] + true["CY/beta_flap"] * flap) * beta
            + rng.normal(0.0, 1e-3, len(time))
        )
        force[3] = np.nan
        parts.append(pd.DataFrame({"manoeuvre": k, "time": time, "beta": beta, "CY": force, **own}))
        rows.append(
            {"record": f"run_{k}", "label": "doublet rudder", "CL": 0.5, "mass": 2000.0, **own}
        )
    flown = aerodb.figures.FlightData(
        "x", pd.concat(parts, ignore_index=True), pd.DataFrame(rows), *[pd.DataFrame()] * 3
    )
    found = aerodb.figures.partial_residuals(db, flown, "CY/beta_flap")
    assert found["record"].tolist() == [
        "run_1",
        "run_2",
    ]  # no flaps, and no sideslip, show nothing of it
    assert (abs(found["estimate"] - true["CY/beta_flap"]) < 3.0 * found["stderr"]).all()
    expected = [
        1e-3 / np.sqrt((flap**2 * size**2 * np.sin(time) ** 2).sum())
        for flap, size in ((FLAP[1], 0.05), (FLAP[2], 0.1))
    ]
    assert found["stderr"].to_numpy() == pytest.approx(expected, rel=0.35)
    assert found["delta_f"].to_numpy() == pytest.approx(FLAP[1:])
    whole = aerodb.figures.partial_residuals(db, flown, "CY/basic")
    assert len(whole) == 4  # a constant is excited by every sample
    assert whole["estimate"].iloc[0] == pytest.approx(true["CY/basic"], abs=4e-4)
    lacking = aerodb.figures.FlightData(
        "x", flown.samples.drop(columns="beta"), *[flown.manoeuvres] * 4
    )
    assert aerodb.figures.partial_residuals(db, lacking, "CY/basic").empty


def test_figure_10_draws_each_sweep_with_the_database_at_its_condition(rich, flown):
    chart = trimmed.elevator_sweep_chart({"final": rich}, flown)
    assert [panel.title for panel in chart.panels] == ["clean, 5100 ft", "flaps 20 deg, 5100 ft"]
    (line,) = chart.panels[0].lines
    assert line.label == "$M$ = 0.3"
    np.testing.assert_allclose(line.y, 0.2 + 5.2 * np.radians(line.x))
    (line,) = chart.panels[1].lines
    np.testing.assert_allclose(line.y, 0.4 + 5.1 * np.radians(line.x))
    swept, start = chart.panels[0].points
    np.testing.assert_allclose(
        np.radians(swept.x), flown.samples["alpha"][flown.samples["manoeuvre"] == 0]
    )
    assert (start.x[0], start.y[0]) == (swept.x[0], swept.y[0])


@pytest.mark.slow
def test_polars_are_trimmed_and_carry_the_errors_of_lift_and_drag(rich, aircraft, flown):
    chart = trimmed.drag_polars({"final": rich}, {"final": aircraft}, flown)
    assert [panel.title for panel in chart.panels] == [
        rf"$\delta_{{f}}$ = {flap} deg" for flap in (0, 20, 40)
    ]
    line = lines(chart)["$M$ = 0.2"]
    at = polars.trim_configuration(aircraft, rich, {})
    expected = flightmech.performance.polar(at, 0.2)
    np.testing.assert_allclose(line.y, np.interp(line.x, expected["CL"], expected["CD"]))
    assert (line.stderr[np.isfinite(line.stderr)] > np.hypot(0.002, 0.0005)).all()
    assert (points(chart)["test point, gear up"].x, points(chart)["test point, gear up"].y) == (
        0.5,
        0.03,
    )
    classic = trimmed.polars_clean({"final": rich}, {"final": aircraft}, flown)
    np.testing.assert_allclose(lines(classic)["$M$ = 0.2"].x, line.y)
    np.testing.assert_allclose(lines(classic)["$M$ = 0.2"].y, line.x)


def test_names_of_configurations_and_heights(flown):
    assert [configuration_text(row.to_dict()) for _, row in flown.manoeuvres.iterrows()] == [
        "clean",
        "flaps 20 deg",
        "flaps 40 deg, gear",
    ]
    np.testing.assert_allclose(group_heights(flown.manoeuvres), [1550.0, 1550.0, 50.0])


def test_a_sheet_draws_the_chart():
    x = np.array([0.0, 1.0, 2.0])
    line = ChartLine("$M$ = 0.3", x, x**2, np.full(3, 0.1), 0)
    other = ChartLine("$M$ = 0.5", x, 2.0 * x, np.zeros(3), 1)
    estimate = FlightPoints(
        "local estimate", np.array([1.0]), np.array([1.5]), np.array([0.2]), "estimate", 1
    )
    trace, sample = (
        FlightPoints(kind, x, x / 2.0, np.zeros(3), kind) for kind in ("trace", "sample")
    )
    panel = ChartPanel("a", [line, other], points=[estimate, trace, sample], by="$M$")
    chart = Chart("x", "Fig. 99", "title", "line", "x [1]", "y [1]", [panel])
    figure = draw_chart(chart, "T-37", ["Data: here."])
    (axes,) = figure.axes
    drawn = {item.get_label(): item for item in axes.lines}
    np.testing.assert_allclose(drawn["$M$ = 0.3"].get_ydata(), x**2)
    assert drawn["$M$ = 0.3"].get_color() != drawn["$M$ = 0.5"].get_color()
    band = (
        next(item for item in axes.collections if item.get_label() == "$M$ = 0.3 error")
        .get_paths()[0]
        .vertices
    )
    np.testing.assert_allclose([band[:, 1].min(), band[:, 1].max()], [-0.1, 4.1])
    assert (drawn["trace"].get_linestyle(), drawn["sample"].get_marker()) == ("-", ".")
    for label in ("trace", "sample"):
        np.testing.assert_allclose(drawn[label].get_ydata(), x / 2.0)
    bar = next(item for item in axes.containers if item.get_label() == "local estimate")
    np.testing.assert_allclose(bar.lines[2][0].get_segments()[0][:, 1], [1.3, 1.7])
    assert {item.get_text() for item in figure.legends[0].get_texts()} == {
        "local estimate",
        "trace",
        "sample",
        "one standard error",
    }
    assert {"0.3", "0.5"} <= {item.get_text() for item in axes.texts}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [1]", "y [1]")
    words = [item.get_text() for item in figure.texts]
    assert words[0] == "T-37: title (LR-743 Fig. 99)"
    assert words[-1] == "Data: here."
    figure.set_dpi(200)
    assert all(
        item.get_window_extent().x1 < figure.bbox.width for item in [*axes.texts, *figure.texts]
    )


def test_a_file_without_its_columns_is_refused(tmp_path):
    file = tmp_path / "flown.nc"
    xr.DataTree.from_dict({"samples": xr.Dataset({"alpha": ("samples", [0.1])})}).to_netcdf(
        file, engine="h5netcdf"
    )
    with pytest.raises(ParseError, match="a file without samples/manoeuvre, samples/mach"):
        aerodb.figures.read_flown(file)
    with pytest.raises(
        FileNotFoundError, match=r"`aeromatch match` writes flown\.nc next to its databases"
    ):
        aerodb.figures.read_flown(tmp_path / "nowhere.nc")


@pytest.mark.nightly
def test_the_verb_writes_the_set_and_states_what_is_missing(
    small, flown_file, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        "aerodb.figures.lr743_set.report_set.draw_chart",
        lambda chart, name, notes: (chart.title, notes),
    )
    monkeypatch.setattr(
        "aerodb.figures.lr743_set.report_set.save_figure",
        lambda figure, path: path.write_text(repr(figure)),
    )
    aerodb.save(small, tmp_path / "small.nc")
    folder = tmp_path / "set"
    words = [str(tmp_path / "small.nc"), "--lr743", "--flown", str(flown_file), "-o", str(folder)]
    run = CliRunner().invoke(group, ["figures", *words])
    assert run.exit_code == 0, run.output
    names = [
        "figure-01",
        "figure-02",
        "figure-03",
        "figure-10",
        "figure-12",
        "figure-13",
        "figure-15",
    ]
    assert sorted(path.name for path in folder.iterdir()) == [
        *(f"{name}.svg" for name in names),
        "table-1.csv",
        "table-2.csv",
    ]
    assert f"Data: {tmp_path / 'small.nc'}, {flown_file}." in (folder / "figure-01.svg").read_text()
    assert "Fig. 4 cannot be drawn: no term of CL depends on delta_e" in run.output
    assert f"written: 9 of 16 in {folder}" in run.output
    assert (
        (folder / "table-2.csv")
        .read_text()
        .splitlines()[1]
        .startswith("CL,1,0.827,0.599,0.02,-1.45")
    )
    again = CliRunner().invoke(group, ["figures", *words])
    assert isinstance(again.exception, SchemaError)
    assert "is there and not empty" in str(again.exception)
    monkeypatch.setattr(
        "aerodb.figures.lr743_set.report_set.lr743_charts",
        lambda *_: [("Fig. 9", "envelope", raising)],
    )
    run = CliRunner().invoke(group, ["figures", *words[:-1], str(tmp_path / "new"), "--json"])
    found = {item["number"]: item for item in json.loads(run.stdout)["figures"]}
    assert found["Table 1"]["file"].endswith("table-1.csv")
    assert (found["Fig. 9"]["file"], found["Fig. 9"]["missing"]) == (None, "it needs an aircraft")


def raising():
    raise NotDrawn("it needs an aircraft")


def test_the_verb_refuses_other_input(small, tmp_path):
    def call(*words):
        return CliRunner().invoke(group, ["figures", *map(str, words), "-o", str(tmp_path / "new")])

    aerodb.save(small, tmp_path / "small.nc")
    assert "give --lr743" in call(tmp_path / "small.nc").output
    assert (
        "holds no datcom.nc and no final.nc; name a folder that `aeromatch match` wrote"
        in call(tmp_path, "--lr743").output
    )
    assert (
        "give one folder that `aeromatch match` wrote, one database"
        in call(tmp_path, tmp_path / "small.nc", "--lr743").output
    )
    (tmp_path / "buffet.csv").write_text("mach,lift\n0.3,0.9\n")
    run = call(tmp_path / "small.nc", "--lr743", "--buffet", tmp_path / "buffet.csv")
    assert "a table with the columns mach and CL" in str(run.exception)
