"""Reference quantities and control effects of a database against aircraft file and record."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
import flightmech
import flighttest
from flightmech import terms
from flighttest.reconstruction.quality.checks.control_response import control_responses
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.declarations.database_match import (
    gain_findings,
    reference_findings,
)

STEP = 0.02  # s of the simulated flight
V, P_STATIC, TEMPERATURE = 80.0, 84300.0, 278.0
CG = (0.4, 0.0, -0.3)  # m from the reference point: ahead of it and above
SLOPES = {  # 1/rad; the effect of each surface on its axis, and what reaches it over arm and Ixz
    "CL": {"delta_e": 0.45},
    "CY": {"delta_a": 0.06, "delta_r": 0.25},
    "Cl": {"beta": -0.1, "phat": -0.45, "delta_a": -0.14, "delta_r": 0.02},
    "Cm": {"alpha": -0.9, "qhat": -12.0, "delta_e": -1.1},
    "Cn": {"beta": 0.12, "rhat": -0.15, "delta_a": 0.012, "delta_r": -0.08},
}
SURFACES = ("delta_e", "delta_a", "delta_r")
T37 = Path(__file__).parents[4] / "data" / "t37"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(T37 / "aircraft.toml")


@pytest.fixture(scope="module")
def signals():
    name = "t37_10_multisine_clean_5kft.nc"
    record = flighttest.read(T37 / "flight" / name, T37 / "names.toml")
    return resample_channels(record, faults_of(record))


def database(aircraft, elevator=-1.1):
    known = {"stderr": 0.05, "source": "datcom", "comment": "by hand"}
    leaves = {
        "CL/basic": terms.make_term(0.3, **known),
        "Cm/elevator": terms.make_term(elevator, regressors=["delta_e"], **known),
        "Cm/altitude": terms.make_term([0.0, 0.01], {"h": [0.0, 1e4]}, **known),
    }
    reference = aircraft.reference or (0.0, 0.0, 0.0)
    return aerodb.make_database(
        leaves, title="one", aircraft="T-37", S=aircraft.S, cbar=aircraft.cbar, b=aircraft.b,
        x_ref=reference[0], y_ref=reference[1], z_ref=reference[2], force_axes="stability",
    )  # fmt: skip


def simulated_flight(aircraft):
    """Return the record of a linear model that is written out here, apart from the product."""
    time = STEP * np.arange(3000)
    rng = np.random.default_rng(3)
    moved = {
        "alpha": 0.05 + 0.02 * np.sin(2.0 * time),
        "beta": 0.03 * np.sin(1.3 * time),
    }
    for name in ("delta_e", "delta_a", "delta_r"):
        # sums of sines up to 1.6 Hz, each at its own frequencies
        frequency = 0.3 + 0.1 * (np.arange(12) + rng.random(12))
        sines = np.sin(2.0 * np.pi * np.outer(time, frequency) + 6.28 * rng.random(12))
        moved[name] = 0.01 * sines.sum(axis=1)
    C = {name: sum(slopes.get(x, 0.0) * moved[x] for x in moved) for name, slopes in SLOPES.items()}
    qS = 0.5 * P_STATIC / (287.05287 * TEMPERATURE) * V**2 * aircraft.S
    c, b = aircraft.cbar, aircraft.b
    x, _, z = CG
    sin, cos = np.sin(moved["alpha"]), np.cos(moved["alpha"])
    # Seen from the c.g. the reference point is x behind and z above: lift pitches down, side force
    # yaws left and rolls right.
    L = qS * (b * C["Cl"] + z * C["CY"])
    M = qS * (c * C["Cm"] - x * C["CL"] * cos - z * C["CL"] * sin)
    N = qS * (b * C["Cn"] - x * C["CY"])
    damping = qS / (2.0 * V) * np.array([b**2 * -0.45, c**2 * -12.0, b**2 * -0.15])
    Ixx, Iyy, Izz, Ixz = aircraft.Ixx, aircraft.Iyy, aircraft.Izz, aircraft.Ixz
    determinant = Ixx * Izz - Ixz**2
    rates = np.zeros((len(time), 3))
    for k in range(len(time) - 1):
        l, m, n = np.array([L[k], M[k], N[k]]) + damping * rates[k]
        p_dot = (Izz * l + Ixz * n) / determinant
        r_dot = (Ixz * l + Ixx * n) / determinant
        rates[k + 1] = rates[k] + STEP * np.array([p_dot, m / Iyy, r_dot])
    columns = dict(zip("pqr", rates.T, strict=True)) | moved
    columns["alpha_vane"], columns["beta_vane"] = columns.pop("alpha"), columns.pop("beta")
    for name, value in (("V", V), ("p_static", P_STATIC), ("temperature", TEMPERATURE)):
        columns[name] = np.full(len(time), value)
    data = {name: ("time", values) for name, values in columns.items()}
    leaf = xr.Dataset(data, {"time": time}, {"rate": 1.0 / STEP})
    return xr.DataTree.from_dict({"/": xr.Dataset(), "/air": leaf})


def linear_database(aircraft):
    leaves = {}
    for coefficient, slopes in SLOPES.items():
        for name, slope in slopes.items():
            known = {"stderr": 0.05, "source": "datcom", "comment": "by hand"}
            leaf = terms.make_term(slope, regressors=[name], **known)
            leaves[f"{coefficient}/{name}"] = leaf
    return aerodb.make_database(
        leaves, title="linear", aircraft="T-37", S=aircraft.S, cbar=aircraft.cbar, b=aircraft.b,
        x_ref=0.0, y_ref=0.0, z_ref=0.0, force_axes="stability",
    )  # fmt: skip


@pytest.mark.slow
def test_the_right_database_has_the_effect_of_every_surface(aircraft):
    # c.g. away from the reference point, and a large product of inertia
    aircraft = replace(aircraft, cg=CG, Ixz=3000.0)
    record = simulated_flight(aircraft)
    signals = resample_channels(record, faults_of(record))
    answers = control_responses(signals)
    db = linear_database(aircraft)
    findings, (row,) = gain_findings(answers, signals, aircraft, db)
    assert findings == []
    right = {"delta_e": 1.0, "delta_a": 1.0, "delta_r": 1.0}
    assert ratios_in(row[3]) == pytest.approx(right, abs=0.02)
    # effect of a slow elevator; the filters of the check take some of it
    qS = 0.5 * P_STATIC / (287.05287 * TEMPERATURE) * V**2 * aircraft.S
    slow = qS * (-1.1 * aircraft.cbar - 0.4 * 0.45) / aircraft.Iyy
    effect = answers.set_index("surface")["effect"]
    assert effect["delta_e"] / slow == pytest.approx(0.94, abs=0.02)
    # a wrong c.g. or roll-yaw coupling: (1.1 cbar + 0.18)/(1.1 cbar - 0.18) is 1.22
    for changes, expected in (
        ({"cg": (-0.4, 0.0, -0.3)}, {"delta_e": 1.22, "delta_a": 1.01, "delta_r": 1.29}),
        ({"cg": (0.4, 0.0, 0.9)}, {"delta_e": 0.99, "delta_a": 1.05, "delta_r": 1.10}),
        ({"Ixz": -3000.0}, {"delta_e": 1.0, "delta_a": 0.97, "delta_r": 0.93}),
        ({"Izz": 1.5 * aircraft.Izz}, {"delta_e": 1.0, "delta_a": 1.01, "delta_r": 1.53}),
    ):
        _, (row,) = gain_findings(answers, signals, replace(aircraft, **changes), db)
        assert ratios_in(row[3]) == pytest.approx(expected, abs=0.02), changes


def ratios_in(text):
    """Return the ratio of each surface in a reason."""
    words = re.findall(r"(delta_\w) has (\S+) \(", text)
    return {surface: float(ratio) for surface, ratio in words}


def test_reference_quantities(aircraft):
    db = database(aircraft)
    assert reference_findings(aircraft, db) == []
    assert reference_findings(aircraft, None) == []
    (finding,) = reference_findings(replace(aircraft, S=1.15 * aircraft.S), db)
    assert finding.name == "geometry:S"
    assert f"{1.15 * aircraft.S:.5g} and {aircraft.S:.5g}" in finding.text
    moved = (aircraft.reference[0] + 0.1, *aircraft.reference[1:])
    (finding,) = reference_findings(replace(aircraft, reference=moved), db)
    assert finding.channels == ("reference",)


def test_an_effect_that_the_motion_does_not_explain_well_is_not_a_gain(signals, aircraft):
    """An alpha vane that is late or disturbed changes the effect of the elevator."""
    answers = control_responses(signals)
    elevator = answers[answers["surface"] == "delta_e"]
    db = database(aircraft, -2.75)
    (finding,), _ = gain_findings(elevator, signals, aircraft, db)
    assert finding.evidence["ratio"] < 0.45
    findings, (row,) = gain_findings(elevator.assign(R2=0.93), signals, aircraft, db)
    assert findings == []
    assert ratios_in(row[3])["delta_e"] == pytest.approx(finding.evidence["ratio"], abs=0.01)


def test_gain_of_a_surface(signals, aircraft):
    answers = control_responses(signals)
    elevator = answers[answers["surface"] == "delta_e"]
    findings, (row,) = gain_findings(elevator, signals, aircraft, database(aircraft))
    assert findings == []
    assert "delta_e has" in row[3]
    (finding,), _ = gain_findings(elevator, signals, aircraft, database(aircraft, -5.0))
    assert finding.name == "scale:delta_e+q"
    unseen, (row,) = gain_findings(answers, signals, None, None)
    assert unseen == []
    assert "--database" in row[3]
    assert gain_findings(pd.DataFrame(columns=answers.columns), signals, aircraft, None) == ([], [])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["p_static", "temperature", "alpha_vane"])
def test_a_channel_without_a_valid_sample_is_as_one_that_is_not_recorded(aircraft, name):
    aircraft = replace(aircraft, cg=CG, Ixz=3000.0)
    record = simulated_flight(aircraft)
    record["air"][name].values[:] = np.nan
    signals = resample_channels(record, faults_of(record))
    findings, (row,) = gain_findings(
        control_responses(signals), signals, aircraft, linear_database(aircraft)
    )
    assert findings == []
    if name == "temperature":
        # that of the standard atmosphere; the zeros of the column were read as 100 K: a gain of
        # 0.36
        assert ratios_in(row[3]) == pytest.approx(dict.fromkeys(SURFACES, 1.0), abs=0.02)
    else:
        assert f"no valid sample of {name}" in row[3]
        assert ratios_in(row[3]) == {}


def test_only_valid_samples_give_the_gain(aircraft):
    aircraft = replace(aircraft, cg=CG, Ixz=3000.0)
    record = simulated_flight(aircraft)
    signals = resample_channels(record, faults_of(record))
    answers = control_responses(signals)
    db = linear_database(aircraft)
    right = dict.fromkeys(SURFACES, 1.0)

    def invalid(part):
        # the value of a failed sensor, marked as not valid
        values = {**signals.values, "temperature": np.where(part, 100.0, signals["temperature"])}
        return replace(signals, values=values, good={**signals.good, "temperature": ~part})

    findings, (row,) = gain_findings(answers, invalid(signals.time > 25.0), aircraft, db)
    assert findings == []
    assert ratios_in(row[3]) == pytest.approx(right, abs=0.02)
    # two seconds show no effect
    findings, (row,) = gain_findings(answers, invalid(signals.time > 2.0), aircraft, db)
    assert findings == []
    assert "delta_e: the samples with airspeed, air and angle of attack do not give" in row[3]
    outside = {**signals.good, "V": signals.time < 2.0, "temperature": signals.time > 3.0}
    _, (row,) = gain_findings(answers, replace(signals, good=outside), aircraft, db)
    assert "no time in flight with valid samples of all of V, p_static, temperature" in row[3]
