"""Modes and trim slope of the published Citation II derivatives against the flown ones.

Derivatives, inertia and flown modes: README of ../shared/data/flight/citation_phlab (course
assignment 2019 v1.3; its own fits of the records).  Pitch rates there are divided by V, here by 2V.
The derivatives belong to stability axes, so the lift at alpha zero is set to the weight: body axes
are then stability axes.
"""

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.air import atmosphere
from flightmech.terms import make_term
from flightmech.units import G0

LATERAL = {
    "CY": {"beta": -0.75, "phat": -0.0304, "rhat": 0.8495, "delta_r": 0.23},
    "Cl": {"beta": -0.1026, "phat": -0.7109, "rhat": 0.2376, "delta_a": -0.2309, "delta_r": 0.0344},
    "Cn": {"beta": 0.1348, "phat": -0.0602, "rhat": -0.2061, "delta_a": -0.012, "delta_r": -0.0939},
}
PITCH = {
    "": 0.0297,
    "alpha": -0.5626,
    "qhat": 2 * -8.7942,
    "alphadothat": 2 * 0.178,
    "delta_e": -1.1642,
}
LIFT, DRAG, OSWALD = 5.084, 0.04, 0.8
FLOWN = {
    2018: (3.10, 0.110, -0.480),
    2020: (3.06, 0.097, -0.445),
}  # Dutch roll: period, damping ratio; slope of elevator over alpha


def at(citation, year, motion):
    """Return mass, speed, height and temperature offset at the start of a motion."""
    record, start = citation.record(year), citation.start(year, motion)
    air = record["adc"].to_dataset().sel(time=start, method="nearest")
    computed = record["computed"].to_dataset().sel(time=start, method="nearest")
    h, temperature = float(air["h_baro"]), float(air["temperature"])
    standard = atmosphere(h)
    V = (
        float(air["mach"])
        * float(standard.a_sound)
        * np.sqrt(temperature / float(standard.temperature))
    )
    return float(computed["mass"]), V, h, temperature - float(standard.temperature)


def published(aircraft, mass, V, h, delta_T):
    """Return aircraft and database of the published numbers with the lift of this flight at alpha
    zero.
    """
    CL = mass * G0 / (0.5 * float(atmosphere(h, delta_T).rho) * V**2 * aircraft.S)
    k = aircraft.S / (np.pi * aircraft.b**2 * OSWALD)
    drag = {"": DRAG + k * CL**2, "alpha": 2 * k * CL * LIFT, "alpha alpha": k * LIFT**2}
    numbers = {**LATERAL, "CL": {"": CL, "alpha": LIFT}, "CD": drag, "Cm": PITCH}
    b2, c2 = aircraft.b**2, aircraft.cbar**2
    inertia = {
        "Ixx": 0.019 * mass * b2,
        "Iyy": 1.3925 * mass * c2,
        "Izz": 0.042 * mass * b2,
        "Ixz": 0.002 * mass * b2,
    }
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0))
    craft = flightmech.Aircraft(
        "published", aircraft.S, aircraft.cbar, aircraft.b, mass, **inertia, engines=(engine,)
    )
    leaves = {
        f"/{c}/{words.replace(' ', '_') or 'basic'}": make_term(x, regressors=words.split())
        for c, d in numbers.items()
        for words, x in d.items()
    }
    return craft, xr.DataTree.from_dict(leaves)


@pytest.mark.slow
@pytest.mark.parametrize("year", FLOWN)
def test_dutch_roll(citation, year):
    """The assignment warns that its derivatives are to be corrected from flight; 10 % of the
    period, 0.04 of the damping ratio.
    """
    mass, V, h, delta_T = at(citation, year, "dutch_roll")
    craft, db = published(citation.aircraft(), mass, V, h, delta_T)
    found = flightmech.characteristics(craft, db, {"V": V, "h": h, "delta_T": delta_T})
    (row,) = (row for _, row in found.modes.iterrows() if row["mode"] == "Dutch roll")
    period, ratio, _ = FLOWN[year]
    assert row["period"] == pytest.approx(period, rel=0.10)
    assert row["damping_ratio"] == pytest.approx(ratio, abs=0.04)


def test_trim_slope(citation):
    """Elevator over alpha along the trim curve; the thrust line is taken through the c.g. and Mach
    effects are none.
    """
    mass, V, h, delta_T = at(citation, 2018, "phugoid")
    craft, db = published(citation.aircraft(), mass, V, h, delta_T)
    curve = flightmech.characteristics(craft, db, {"V": V, "h": h, "delta_T": delta_T}).trim.dropna(
        "V"
    )
    slope = np.polyfit(curve["alpha"], curve["delta_e"], 1)[0]
    assert slope == pytest.approx(FLOWN[2018][2], rel=0.02)


@pytest.mark.slow
def test_stability_of_the_published_model(citation):
    """h_n = 0.25 - Cm_alpha/CL_alpha and the roll mode b^2 rho S V Cl_p / (4 Ixx), by the
    textbook.
    """
    mass, V, h, delta_T = at(citation, 2018, "aperiodic_roll")
    craft, db = published(citation.aircraft(), mass, V, h, delta_T)
    found = flightmech.characteristics(craft, db, {"V": V, "h": h, "delta_T": delta_T})
    assert found.table.loc["neutral_point_fixed", "value"] == pytest.approx(
        0.25 + 0.5626 / LIFT, abs=0.005
    )
    roll = next(row for _, row in found.modes.iterrows() if row["mode"] == "roll")
    rho = float(atmosphere(h, delta_T).rho)
    assert -roll["real"] == pytest.approx(
        rho * V * craft.S * craft.b**2 * 0.7109 / (4 * craft.Ixx), rel=0.1
    )  # coupled to beta and yaw


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("year", "period", "ratio"),
    [(2018, 3.07, 0.120), pytest.param(2020, 3.09, 0.102, marks=pytest.mark.slow)],
)
def test_linear_output_error_finds_the_flown_dutch_roll(citation, year, period, ratio):
    """Bank and rates alone: elements are correlated, their mode is sharp.  Pinned as seen; 2 % and
    0.02 of the flown mode.
    """
    mass, V, h, delta_T = at(citation, year, "dutch_roll")
    sim = flightmech.compile(*published(citation.aircraft(), mass, V, h, delta_T))
    point = {"init.V": V, "init.h": h, "env.delta_T": delta_T}
    linear = flightmech.linearize(
        sim, point, ("beta", "p", "r", "phi"), ("delta_a", "delta_r"), ("p", "r", "phi")
    )
    model = flighttest.maximum_likelihood.linear_model(
        linear.drop_vars(["u", "y"])
    )  # constants of the record are drift and start
    at_start = model.at({})
    unknowns = {
        f"A[{a},{b}]": float(at_start.A[i, j])
        for i, a in ((1, "p"), (2, "r"))
        for j, b in enumerate(("beta", "p", "r"))
    }
    unknowns |= {f"B[{a},delta_r]": float(at_start.B[i, 1]) for i, a in ((1, "p"), (2, "r"))}
    unknowns |= dict.fromkeys(
        [*(f"init.{name}" for name in model.states), "drift.p", "drift.r"], 0.0
    )
    fit = flighttest.maximum_likelihood.linear_output_error(
        model, citation.path(year, "dutch_roll", -3.0, 16.0).states, unknowns
    )
    assert fit.estimates.attrs["converged"] == 1
    # bank and roll rate share a disturbance, through which an estimate moves the outputs by 1.3 and
    # 0.6 %
    assert fit.warnings == ()
    mode = next(x for x in np.linalg.eigvals(model.at(fit.parameters).A) if x.imag > 0.0)
    assert 2.0 * np.pi / mode.imag == pytest.approx(period, abs=0.01)
    assert -mode.real / abs(mode) == pytest.approx(ratio, abs=0.002)
    assert (period, ratio) == (
        pytest.approx(FLOWN[year][0], rel=0.02),
        pytest.approx(FLOWN[year][1], abs=0.02),
    )
