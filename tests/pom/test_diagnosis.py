"""The term swap finds the terms that were spoilt."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
import pom
from flightmech.terms import make
from pom.case import read_case
from pom.diagnosis import differing, fly, swap_terms
from pom.drive import job_of
from pom.flight import flight_states

PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}


@pytest.fixture(scope="module")
def truth(trainer):
    return trainer.flight(trainer.database(), **PULSE)


@pytest.fixture
def case(write_case):
    return read_case(write_case())


def test_the_spoilt_term_closes_the_gap_alone(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, Cl_phat=0.8)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    assert list(table["stage"]) == ["prior", "final", "single", "single", "sequence"]
    assert table.loc[0, "verdict"] == "fail"
    assert table.loc[1, "verdict"] == "pass"
    assert table.loc[2, "term"] == "Cm/elevator"
    assert table.loc[2, "closes"] == pytest.approx(1.0, abs=0.02)
    assert table.loc[3, "closes"] == pytest.approx(0.0, abs=0.02)  # roll damping has no part in a short period
    assert table.loc[4, "verdict"] == "pass"
    assert pom.corrected_terms([table]) == ["Cm/elevator"]


def test_two_spoilt_terms_make_a_sequence_of_two(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.5, CL_basic=0.6)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    assert set(table.loc[table["stage"] == "sequence", "term"]) == {"Cm/elevator", "CL/basic"}
    assert table.iloc[-1]["verdict"] == "pass"
    assert table.iloc[-1]["closes"] == pytest.approx(1.0, abs=0.02)


def test_a_swap_by_scales_is_the_swap_of_the_database(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.9)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth).set_index(["stage", "term"])
    job = job_of(case, flight_states(case, truth))
    outputs, _ = fly(flightmech.compile(trainer.AIRCRAFT, swap_terms(prior, final, ["CL/basic"])), job)
    error = outputs["q"] - flight_states(case, truth)["q"].values
    expected = np.abs(error).max() / np.radians(2.0)
    assert table.loc[("single", "CL/basic"), "pitch_rate ratio"] == pytest.approx(expected, rel=1e-6)
    assert table.loc[("single", "CL/basic"), "pitch_rate miss"] == pytest.approx(np.sqrt(np.mean(error**2)) / np.radians(2.0), rel=1e-6)


def test_a_term_that_only_one_database_has_is_swapped_too(case, truth, trainer):
    final = trainer.database()
    prior = aerodb.delete_terms(final, ["Cm/alphadothat"])
    assert aerodb.terms(swap_terms(final, prior, ["Cm/alphadothat"])).keys() == aerodb.terms(prior).keys()
    assert differing(prior, final) == ["Cm/alphadothat"]
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth).set_index("stage")
    assert table.loc["single", "closes"] == pytest.approx(1.0)
    back = pom.diagnose(case, final, prior, trainer.AIRCRAFT, truth).set_index("stage")
    assert np.isnan(back.loc["single", "closes"])  # the "final" one is the worse
    assert back.loc["single", "pitch_rate miss"] == pytest.approx(table.loc["prior", "pitch_rate miss"])


def test_equal_databases_have_no_terms_to_swap(case, truth, trainer):
    db = trainer.database()
    table = pom.diagnose(case, db, trainer.database(), trainer.AIRCRAFT, truth)
    assert list(table["stage"]) == ["prior", "final"]
    assert pom.corrected_terms([table]) == []


def test_a_missing_rudder_is_found_behind_a_dutch_roll_that_is_not_there(write_case, trainer):
    doublet = [(0.0, 0.0), (2.0, 0.0), (2.06, 0.1), (3.0, 0.1), (3.06, -0.1), (4.0, -0.1), (4.06, 0.0)]
    final = trainer.database()
    truth = trainer.flight(final, delta_r=doublet)
    path = write_case("2.d.7", more="[events]\ninput_end = 4.2")
    path.write_text(path.read_text().replace("window = [1.0, 9.0]", "window = [1.0, 19.9]"))
    prior = trainer.scaled(aerodb.delete_terms(final, ["Cn/rudder", "CY/rudder"]), Cl_rhat=0.9)
    table = pom.diagnose(read_case(path), prior, final, trainer.AIRCRAFT, truth)
    assert table.loc[0, "verdict"] == "fail"
    assert np.isnan(table.loc[0, "period ratio"])
    assert table.loc[1, "verdict"] == "pass"
    assert pom.corrected_terms([table]) == ["Cn/rudder"]


def test_a_term_that_helps_only_with_another_is_found(case, truth, trainer):
    """All of the pitching moment too strong by one factor: each term alone makes it worse, all together close the gap."""
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=1.6, Cm_basic=1.6, Cm_qhat=1.6, Cm_alphadothat=1.6)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    chosen = table.loc[table["stage"] == "sequence", "term"]
    assert table.iloc[-1]["verdict"] == "pass"
    assert set(chosen) <= {"Cm/elevator", "Cm/basic", "Cm/qhat", "Cm/alphadothat"}


def test_an_engine_before_the_flights_is_swapped_like_a_term(write_case, trainer):
    lever = xr.DataArray([0.0, 0.0, 1.0, 1.0], {"time": [0.0, 3.0, 4.0, 20.0]}, "time")
    strong, weak = (
        replace(
            trainer.AIRCRAFT,
            engines=tuple(
                replace(e, thrust=make([500.0, full], {"throttle": [0.0, 1.0]}), time_constant=lag) for e in trainer.AIRCRAFT.engines
            ),
        )
        for full, lag in ((4500.0, 0.5), (2500.0, 3.0))
    )
    db = trainer.database()
    time = np.round(np.arange(0.0, 20.001, 0.02), 9)
    pushed = {f"engine{i}.throttle": ("time", lever.interp(time=time).values) for i in (1, 2)}
    start = {"init.V": 85.0, "init.h": 1500.0, "mode.engine": 0.0, "mode.trim": 2.0}
    flown = flightmech.simulate(flightmech.compile(strong, db), xr.Dataset(pushed, {"time": time}), start)
    controls = {name: flown[f"applied.{name}"] for name in ("delta_e", "delta_a", "delta_r")}
    throttle = {name: ("time", values[1] + float(flown["trim.throttle"][0])) for name, values in pushed.items()}
    found = flown.drop_vars([n for n in flown if str(n).startswith(("applied.", "trim.", "out_of", "air."))] + ["lat", "lon"])
    found = found.assign(**controls, **throttle, mass=2200.0, z_cg_b=0.2, delta_f=0.0, gear=0.0)
    path = write_case(id="2.c.1", more="[events]\nchange_start = 3.0\nchange_end = 4.0", case='shortened = "test"')
    path.write_text(path.read_text().replace('engine = "thrust"', 'engine = "throttle"').replace("[1.0, 9.0]", "[0.0, 15.0]"))
    table = pom.diagnose(read_case(path), db, db, strong, found, weak).set_index("stage")
    assert table.loc["prior", "verdict"] == "fail"
    assert table.loc["single", "term"] == "engine/thrust"
    assert table.loc["single", "closes"] == pytest.approx(1.0)
    assert pom.corrected_terms([table.reset_index()]) == ["engine/thrust"]
