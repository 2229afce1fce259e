"""The term swap finds the terms that were spoilt."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
import flightmech
import pom
from flightmech.errors import SchemaError, UnknownName
from flightmech.terms import make_term
from pom.cases.case import read_case
from pom.cases.job import job_of
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import flight_states
from pom.cli.actions.diagnose import _percent
from pom.diagnosis import joint_correction
from pom.diagnosis.corrected_model import correction_reasons
from pom.diagnosis.swap_runs import SwapBench
from pom.diagnosis.term_swaps import differing_terms, swap_terms
from pom.replaying.kernel_replay import replay_choices
from pom.report.models.diagnosis import cause_sentences

PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}


@pytest.fixture(scope="module")
def truth(trainer):
    return trainer.flight(trainer.database(), **PULSE)


@pytest.fixture
def case(write_case):
    return read_case(write_case())


def test_the_spoilt_term_explains_the_gap_alone(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, Cl_phat=0.8)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    assert list(table["stage"]) == [
        "prior",
        "final",
        "single",
        "single",
        "sequence",
        "without",
        "share",
        "share",
    ]
    assert table.loc[0, "verdict"] == "fail"
    assert table.loc[1, "verdict"] == "pass"
    assert table.loc[2, "term"] == "Cm/elevator"
    assert table.loc[2, "explained"] == pytest.approx(1.0, abs=0.02)
    assert table.loc[3, "explained"] == pytest.approx(
        0.0, abs=0.02
    )  # roll damping has no part in a short period
    assert table.loc[4, "verdict"] == "pass"
    assert list(table.loc[6:, "term"]) == ["Cm/elevator", "others"]
    assert table.loc[6, "explained"] == pytest.approx(1.0, abs=0.02)
    assert table.loc[5, "explained"] == pytest.approx(
        0.0, abs=0.02
    )  # the final model without it is the a-priori one
    assert pom.corrected_terms([table]) == ["Cm/elevator"]


def test_two_spoilt_terms_make_a_sequence_of_two(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.5, CL_basic=0.6)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    sequence = table[table["stage"] == "sequence"]
    assert set(sequence["term"]) == {"Cm/elevator", "CL/basic"}
    assert sequence.iloc[-1]["verdict"] == "pass"
    assert sequence.iloc[-1]["explained"] == pytest.approx(1.0, abs=0.02)


def test_a_swap_by_scales_is_the_swap_of_the_database(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.9)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth).set_index(["stage", "term"])
    job = job_of(case, flight_states(case, truth))
    outputs, _ = replay_choices(
        flightmech.compile(trainer.AIRCRAFT, swap_terms(prior, final, ["CL/basic"])), job
    )
    error = outputs["q"][0] - flight_states(case, truth)["q"].values
    expected = np.abs(error).max() / np.radians(2.0)
    assert table.loc[("single", "CL/basic"), "pitch_rate ratio"] == pytest.approx(
        expected, rel=1e-6
    )
    assert table.loc[("single", "CL/basic"), "pitch_rate mismatch"] == pytest.approx(
        np.sqrt(np.mean(error**2)) / np.radians(2.0), rel=1e-6
    )


def test_a_term_that_only_one_database_has_is_swapped_too(case, truth, trainer):
    final = trainer.database()
    prior = aerodb.delete_terms(final, ["Cm/alphadothat"])
    assert (
        aerodb.terms(swap_terms(final, prior, ["Cm/alphadothat"])).keys()
        == aerodb.terms(prior).keys()
    )
    assert differing_terms(prior, final) == ["Cm/alphadothat"]
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth).set_index("stage")
    assert table.loc["single", "explained"] == pytest.approx(1.0)
    back = pom.diagnose(case, final, prior, trainer.AIRCRAFT, truth).set_index("stage")
    assert np.isnan(back.loc["single", "explained"])  # the "final" one is the worse
    assert back.loc["single", "pitch_rate mismatch"] == pytest.approx(
        table.loc["prior", "pitch_rate mismatch"]
    )


def test_equal_databases_have_no_terms_to_swap(case, truth, trainer):
    db = trainer.database()
    table = pom.diagnose(case, db, trainer.database(), trainer.AIRCRAFT, truth)
    assert list(table["stage"]) == ["prior", "final"]
    assert pom.corrected_terms([table]) == []
    spoilt = trainer.scaled(db, Cm_elevator=0.6)
    missed = cause_sentences(pom.diagnose(case, spoilt, spoilt, trainer.AIRCRAFT, truth))
    assert (
        missed == "The a-priori model is out of tolerance. Nothing that this case feels differs "
        "between the two models."
    )


@pytest.mark.nightly
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_database_of_another_aeroplane_is_an_error(compensated, monkeypatch, jobs):
    _, cases, _, final, aircraft, flown = compensated
    monkeypatch.setattr(joint_correction, "LEAST_SHARE", 1)
    other = final.copy()
    other.attrs["S"] = 12.0
    with pytest.raises(
        SchemaError, match=r"S is 12 in the database and .* in the aircraft; they must agree"
    ):
        pom.diagnose_all(cases, other, final, aircraft, flown, jobs=jobs)


@pytest.mark.slow
def test_a_missing_rudder_is_found_behind_a_dutch_roll_that_is_not_there(write_case, trainer):
    doublet = [
        (0.0, 0.0),
        (2.0, 0.0),
        (2.06, 0.1),
        (3.0, 0.1),
        (3.06, -0.1),
        (4.0, -0.1),
        (4.06, 0.0),
    ]
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
    """All of the pitching moment too strong by one factor: each term alone makes it worse, all
    together explain the gap.
    """
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=1.6, Cm_basic=1.6, Cm_qhat=1.6, Cm_alphadothat=1.6)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    sequence = table[table["stage"] == "sequence"]
    assert sequence.iloc[-1]["verdict"] == "pass"
    assert set(sequence["term"]) <= {"Cm/elevator", "Cm/basic", "Cm/qhat", "Cm/alphadothat"}


def test_an_engine_before_the_flights_is_swapped_like_a_term(write_case, trainer):
    lever = xr.DataArray([0.0, 0.0, 1.0, 1.0], {"time": [0.0, 3.0, 4.0, 20.0]}, "time")
    strong, weak = (
        replace(
            trainer.AIRCRAFT,
            engines=tuple(
                replace(
                    e, thrust=make_term([500.0, full], {"throttle": [0.0, 1.0]}), time_constant=lag
                )
                for e in trainer.AIRCRAFT.engines
            ),
        )
        for full, lag in ((4500.0, 0.5), (2500.0, 3.0))
    )
    db = trainer.database()
    time = np.round(np.arange(0.0, 20.001, 0.02), 9)
    pushed = {f"engine{i}.throttle": ("time", lever.interp(time=time).values) for i in (1, 2)}
    start = {"init.V": 85.0, "init.h": 1500.0, "mode.engine": 0.0, "mode.trim": 2.0}
    flown = flightmech.simulate(
        flightmech.compile(strong, db), xr.Dataset(pushed, {"time": time}), start
    )
    controls = {name: flown[f"applied.{name}"] for name in ("delta_e", "delta_a", "delta_r")}
    throttle = {
        name: ("time", values[1] + float(flown["trim.throttle"][0]))
        for name, values in pushed.items()
    }
    found = flown.drop_vars(
        [n for n in flown if str(n).startswith(("applied.", "trim.", "out_of", "air."))]
        + ["lat", "lon"]
    )
    found = found.assign(**controls, **throttle, mass=2200.0, z_cg_b=0.2, delta_f=0.0, gear=0.0)
    path = write_case(
        id="2.c.1", more="[events]\nchange_start = 3.0\nchange_end = 4.0", case='shortened = "test"'
    )
    path.write_text(
        path.read_text()
        .replace('engine = "thrust"', 'engine = "throttle"')
        .replace("[1.0, 9.0]", "[0.0, 15.0]")
    )
    table = pom.diagnose(read_case(path), db, db, strong, found, weak).set_index("stage")
    assert table.loc["prior", "verdict"] == "fail"
    assert table.loc["single", "term"] == "engine/thrust"
    assert table.loc["single", "explained"] == pytest.approx(1.0)
    table = table.reset_index()
    assert pom.corrected_terms([table]) == ["engine/thrust"]
    assert list(table.loc[table["stage"] == "share", "term"]) == ["engine/thrust"]
    corrected = pom.corrected_aircraft(weak, strong, {"chop": table}, "trainer.toml")
    assert corrected.engines[0].time_constant == 0.5
    assert corrected.history.startswith(
        "engine/thrust: pom diagnose: from trainer.toml, needed by chop (alone 100 % of the gap"
    )
    assert pom.corrected_aircraft(strong, strong, {"chop": table}) is strong


def test_shares_of_two_terms_by_hand(case, truth, trainer):
    """Two orders: a term explains what it explains alone when it comes first, and what the other
    leaves when it comes last.
    """
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, Cm_qhat=0.5)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    alone = table[table["stage"] == "single"].set_index("term")
    share = table[table["stage"] == "share"].set_index("term")
    pair = table[table["stage"] == "pair"].iloc[0]
    for column in ("explained", "pitch_angle explained", "normal_acceleration explained"):
        for one, other in (("Cm/elevator", "Cm/qhat"), ("Cm/qhat", "Cm/elevator")):
            by_hand = 0.5 * (alone.loc[one, column] + 1.0 - alone.loc[other, column])
            assert share.loc[one, column] == pytest.approx(by_hand, rel=1e-9)
    assert set(pair["term"].split(" + ")) == {"Cm/elevator", "Cm/qhat"}
    assert pair["explained"] == pytest.approx(1.0)
    assert pair["interaction"] == pytest.approx(1.0 - alone["explained"].sum(), rel=1e-9)
    without = table[table["stage"] == "without"].set_index("term")
    for one, other in (("Cm/elevator", "Cm/qhat"), ("Cm/qhat", "Cm/elevator")):
        assert (
            without.loc[one, "explained"] == alone.loc[other, "explained"]
        )  # of two terms, one left out is the other alone
    assert (share["stderr"] == 0.0).all()
    assert set(share["verdict"]) == {"not_tested"}


@pytest.mark.slow
def test_the_waterfall_leads_from_one_mismatch_to_the_other(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.9, Cm_qhat=0.7, Cl_phat=0.5)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth, players=2)
    by = table.drop_duplicates("stage").set_index("stage")
    for criterion, prefix in (("", ""), ("pitch_rate", "pitch_rate ")):
        steps = pom.waterfall(table, criterion)
        assert steps["start"].iloc[0] == by.loc["prior", f"{prefix}mismatch"]
        assert steps["stop"].iloc[-1] == pytest.approx(
            by.loc["final", f"{prefix}mismatch"], abs=1e-12
        )
        assert (steps["start"].values[1:] == steps["stop"].values[:-1]).all()
    assert list(pom.waterfall(table)["term"])[-1] == "others"
    assert len(pom.waterfall(table)) == 3
    joined = pom.join_diagnoses(
        {"a_case": table}, [case], prior, final, {"a_case": trainer.AIRCRAFT}, {"a_case": truth}
    )["a_case"]
    rows = joined.query(
        "stage == 'joint'"
    )  # what it takes for the bias of the trim to come into its limits
    assert list(zip(rows["term"], rows["verdict"], strict=True)) == [
        ("", "limits_exceeded"),
        ("CL/basic", "fail"),
        ("Cm/qhat", "pass"),
    ]


def test_terms_are_ranked_per_criterion(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.8)
    found = pom.ranking(pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)).set_index(
        ["criterion", "rank"]
    )
    assert found.loc[("pitch_angle", 1), "term"] == "Cm/elevator"
    for criterion in ("", "pitch_angle", "pitch_rate", "normal_acceleration"):
        rows = found.loc[criterion]
        assert rows["explained"].sum() == pytest.approx(1.0)
        assert rows["change"].is_monotonic_increasing
        assert rows.loc[1, "change"] < 0.0


@pytest.mark.nightly
def test_many_terms_are_shared_by_sampled_orders_with_a_stated_error(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(
        final, Cm_elevator=0.6, CL_basic=0.8, Cm_qhat=0.6, Cm_basic=0.8, Cm_alphadothat=0.5
    )
    exact, sampled, again, other = (
        pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth, replays=replays, seed=seed)
        .query("stage == 'share'")
        .set_index("term")
        for replays, seed in ((32, 0), (31, 0), (31, 0), (31, 1))
    )
    assert (exact["stderr"] == 0.0).all()
    assert (sampled["stderr"] > 0.0).any()
    assert sampled["explained"].equals(again["explained"])
    assert not np.allclose(sampled["explained"], other["explained"][sampled.index])
    assert sampled["explained"].sum() == pytest.approx(1.0)
    assert (
        np.abs(sampled["explained"] - exact["explained"][sampled.index]) < 4.0 * sampled["stderr"]
    ).all()


def test_a_criterion_without_a_gap_has_no_shares(write_case, truth, trainer):
    path = write_case(more='[tolerance]\nbank_angle = { abs = "2 deg", channel = "phi" }')
    path.write_text(
        path.read_text().replace('bank_angle = { abs = "2 deg", channel = "phi" }', 'phi = "2 deg"')
    )
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.8)
    table = pom.diagnose(read_case(path), prior, final, trainer.AIRCRAFT, truth)
    assert table["phi explained"].isna().all()
    assert table.loc[table["stage"] == "share", "pitch_rate explained"].notna().all()


@pytest.mark.nightly
def test_groups_are_swapped_as_a_whole(write_case, trainer):
    down = [(0.0, 0.0), (2.0, 0.0), (2.06, 1.0), (20.0, 1.0)]
    final = trainer.database()
    prior = trainer.scaled(aerodb.delete_terms(final, ["Cm/gear"]), Cm_qhat=0.8, CL_qhat=0.8)
    final = aerodb.replace_terms(final, {"CL/gear": make_term(-0.02, regressors=["gear"])})
    truth = trainer.flight(final, gear=down)
    wanted = {"pitch damping and gear": ["C?/qhat", "*/gear"]}
    table = pom.diagnose(
        read_case(write_case()), prior, final, trainer.AIRCRAFT, truth, groups=wanted
    )
    rows = table[table["stage"] == "group"].set_index("term")
    assert set(rows.index) == {"CL/*", "Cm/*", "*(gear)", "pitch damping and gear"}
    assert rows.loc["pitch damping and gear", "explained"] == pytest.approx(1.0)
    job = job_of(read_case(write_case()), flight_states(read_case(write_case()), truth))
    outputs, _ = replay_choices(
        flightmech.compile(trainer.AIRCRAFT, swap_terms(prior, final, ["CL/gear", "Cm/gear"])), job
    )
    flown = flight_states(read_case(write_case()), truth)["q"].values
    worst = np.abs(outputs["q"][0] - flown).max() / np.radians(2.0)
    assert rows.loc["*(gear)", "pitch_rate ratio"] == pytest.approx(worst, rel=1e-6)
    with pytest.raises(UnknownName, match="unknown term or part that differs 'CY/gear'"):
        pom.diagnose(
            read_case(write_case()),
            prior,
            final,
            trainer.AIRCRAFT,
            truth,
            groups={"side": ["CY/gear"]},
        )


@pytest.mark.slow
def test_the_corrected_database_states_where_its_terms_come_from(case, truth, trainer):
    final = trainer.database()
    prior = trainer.scaled(
        aerodb.delete_terms(final, ["Cm/alphadothat"]), Cm_elevator=0.5, CL_basic=0.6, Cl_phat=0.8
    )
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth)
    corrected = pom.corrected_database(prior, final, {"short_period": table}, "final.nc")
    taken = pom.corrected_terms([table])
    assert set(differing_terms(corrected, prior)) == set(taken)
    assert {"Cm/elevator", "CL/basic"} <= set(taken)
    alone = table[table["stage"] == "single"].set_index("term").loc["CL/basic", "explained"]
    history = aerodb.terms(corrected)["CL/basic"].attrs["history"]
    assert (
        f"pom diagnose: from final.nc, needed by short_period (alone {100 * alone:.0f} % of "
        f"the gap, share" in history
    )
    assert history.endswith("replace_terms: replaced (term swap)")
    assert "term swap" in corrected.attrs["history"]
    assert "pom diagnose" not in aerodb.terms(corrected)["Cl/phat"].attrs.get("history", "")
    flown = pom.diagnose(case, corrected, final, trainer.AIRCRAFT, truth)
    assert flown.loc[0, "verdict"] == "pass"


@pytest.fixture
def compensated(write_case, trainer):
    """Arguments of `join_diagnoses`: an elevator and a stability too weak by one factor, and a gear
    that shows the stability alone.
    """
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, Cm_basic=0.6, Cl_phat=0.8)
    ramp = [(0.0, 0.0), (2.0, 0.0), (6.0, -0.04), (20.0, -0.04)]
    down = [(0.0, 0.0), (2.0, 0.0), (5.0, 1.0), (20.0, 1.0)]
    flown = {
        "elevator": trainer.flight(final, delta_e=ramp),
        "gear": trainer.flight(final, gear=down),
    }
    case = read_case(write_case())
    cases = [replace(case, name=name) for name in flown]
    found = {
        one.name: pom.diagnose(one, prior, final, trainer.AIRCRAFT, flown[one.name])
        for one in cases
    }
    return found, cases, prior, final, dict.fromkeys(flown, trainer.AIRCRAFT), flown


@pytest.mark.slow
def test_what_one_case_takes_makes_another_need_more(compensated):
    found, _, prior, final, *_ = compensated
    assert pom.corrected_terms(found.values()) == ["Cm/basic"]
    assert found["elevator"].loc[0, "verdict"] == "pass"
    joined = pom.join_diagnoses(*compensated)
    assert joined["gear"] is found["gear"]
    rows = joined["elevator"].query("stage == 'joint'")
    assert list(zip(rows["term"], rows["verdict"], strict=True)) == [
        ("", "fail"),
        ("Cm/elevator", "pass"),
    ]
    assert pom.diagnosis.joint_terms(joined) == {"elevator": ["Cm/elevator"]}
    assert set(pom.corrected_terms(joined.values())) == {"Cm/basic", "Cm/elevator"}
    corrected = pom.corrected_database(prior, final, joined)
    assert differing_terms(prior, corrected) == ["Cm/basic", "Cm/elevator"]
    history = aerodb.terms(corrected)["Cm/elevator"].attrs["history"]
    assert "added for elevator, which does not pass with only the terms that the cases" in history
    assert cause_sentences(joined["elevator"]).endswith(
        "With the sequences of all cases together the corrected model is out of tolerance "
        "here; Cm/elevator, added for this case, "
        "makes it pass."
    )


@pytest.mark.nightly
def test_all_cases_together_give_the_tables_of_each_alone_joined(compensated, monkeypatch):
    """Side by side, with the models and flights shared: the same rows, fewer flights."""
    found, cases, prior, final, aircraft, flown = compensated
    flights = []
    own = SwapBench._fly_group
    monkeypatch.setattr(
        SwapBench,
        "_fly_group",
        lambda bench, parts, choices: flights.extend(choices) or own(bench, parts, choices),
    )
    joined = pom.join_diagnoses(found, cases, prior, final, aircraft, flown)
    again = len(flights)
    flights.clear()
    for case in cases:
        pom.diagnose(case, prior, final, aircraft[case.name], flown[case.name])
    separate = len(flights) + again
    flights.clear()
    together = pom.diagnose_all(cases, prior, final, aircraft, flown, jobs=2)
    assert len(flights) < separate
    assert list(together) == list(joined)
    for name, table in together.items():
        pd.testing.assert_frame_equal(table, joined[name])


@pytest.mark.slow
def test_processes_give_what_threads_give(compensated, monkeypatch):
    """The benches come back without what their processes compiled, and are joined with the models
    of this one.
    """
    _, cases, prior, final, aircraft, flown = compensated
    threads = pom.diagnose_all(cases, prior, final, aircraft, flown, jobs=2)
    monkeypatch.setattr(joint_correction, "LEAST_SHARE", 1)
    processes = pom.diagnose_all(cases, prior, final, aircraft, flown, jobs=2)
    assert list(processes) == list(threads)
    for name, table in processes.items():
        pd.testing.assert_frame_equal(table, threads[name], check_exact=True)


@pytest.mark.slow
def test_nothing_is_added_where_the_union_passes(compensated, trainer):
    found, cases, prior, final, aircraft, flown = compensated
    assert pom.join_diagnoses(
        {"gear": found["gear"]}, cases[1:], prior, final, aircraft, flown
    ) == {"gear": found["gear"]}
    wrong = trainer.scaled(
        final, Cm_elevator=2.0
    )  # the final model fails the case as well: nothing can be reached
    table = pom.diagnose(cases[0], prior, wrong, trainer.AIRCRAFT, flown["elevator"])
    joined = pom.join_diagnoses({"elevator": table}, cases[:1], prior, wrong, aircraft, flown)
    assert joined["elevator"] is table


@pytest.mark.nightly
@pytest.mark.parametrize(
    "loops",
    [
        (),
        (
            PilotLoop("delta_a", "phi", gain=-1.0, limit=0.1),
            PilotLoop("delta_e", "theta", gain=-0.5, limit=0.1),
        ),
    ],
)
def test_the_verdicts_are_those_of_a_replay(case, truth, trainer, tmp_path, loops):
    """The same case by the FMU of the a-priori model, with the recorded controls and with a math
    pilot on top of them.
    """
    case = replace(
        case, drive=replace(case.drive, surfaces="pilot" if loops else "recorded", pilot=loops)
    )
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, CL_basic=0.9)
    table = pom.diagnose(case, prior, final, trainer.AIRCRAFT, truth).set_index("stage")
    fmu = flightmech.write_fmu(flightmech.compile(trainer.AIRCRAFT, prior), tmp_path / "prior.fmu")
    result = pom.replay(case, {"prior": fmu}, truth)
    assert result.failure == ""
    assert table.loc["prior", "verdict"] == result.status("prior")
    judged = result.verdict[result.verdict["verdict"].isin(["pass", "fail"])]
    assert len(judged) == (2 if loops else 3)  # what the pilot holds is not judged
    for row in judged.to_dict("records"):
        assert table.loc["prior", f"{row['criterion']} ratio"] == pytest.approx(
            row["worst_ratio"], rel=1e-4
        )


def test_a_footprint_has_no_mismatch_to_explain(case, truth, trainer):
    final = trainer.database()
    case = replace(case, reference="footprint")
    table = pom.diagnose(
        case, trainer.scaled(final, Cm_elevator=0.6), final, trainer.AIRCRAFT, truth
    )
    assert list(table["stage"]) == ["prior", "final", "single"]
    assert set(table["verdict"]) == {"not_tested"}
    assert table["explained"].isna().all()


def test_a_share_that_is_rounded_to_zero_has_no_sign():
    table = pd.DataFrame(
        {
            "stage": ["single", "share", "sequence"],
            "term": ["Cm/qhat"] * 3,
            "explained": [-0.002, -0.004, 1.0],
        }
    )
    text = correction_reasons({"case": table})["Cm/qhat"]
    assert text == "needed by case (alone 0 % of the gap, share 0 %)"
    assert _percent(-0.002) == "0 %"
