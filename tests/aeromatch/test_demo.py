"""The whole job on the shipped example."""

import json

import pytest
import short_demo

import aerodb
import flightmech
import pom
from pom.report.chapters import restore_chapters

MATCHED = ("pass", "pass_with_departures")
EXPECTED = {
    "short_period": "pass",
    "roll_response": "not_tested",
    "power_chop": "pass_with_departures",
    "power_chop_lever": "pass_with_departures",
    "power_slam": "pass_with_departures",
    "normal_takeoff": "not_tested",
    "phugoid": "pass",
    "dutch_roll": "pass",
    "spiral": "pass_with_departures",
    "flap_change": "pass_with_departures",
    "gear_change": "pass_with_departures",
    "landing": "not_tested",
    "rudder_response": "pass",
    "stick_free_short_period": "pass",
    "wheel_force": "pass",
    "dutch_roll_pedals_free": "pass_with_departures",
    "stick_force_per_g": "pass",
    "brake_stop": "pass_with_departures",
    "taxi_turn": "invalid",
}
"""Status of the final model: pilot forces are not recorded in three cases, eight depart from their
rows (configuration, length of the record, weight, brakes, track, one direction, cycles)."""
SHORT = {name: EXPECTED[name] for name in short_demo.CASES}


@pytest.fixture(params=["short", pytest.param("whole", marks=pytest.mark.nightly)])
def either(request):
    """Return folder, process and expected status of the short and of the whole demo."""
    if request.param == "short":
        return *request.getfixturevalue("demo"), SHORT
    return *request.getfixturevalue("whole_demo"), EXPECTED


@pytest.mark.slow
def test_the_final_model_has_the_status_that_an_evaluator_gives(either):
    _, run, expected = either
    cases = json.loads(run.stdout)["cases"]
    assert {case["name"]: case["status"]["final"] for case in cases} == expected


@pytest.mark.slow
def test_the_demo_writes_what_it_promises(either):
    folder, run, expected = either
    assert run.returncode == 0, run.stderr
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    models = {
        f"{name}{kind}"
        for name in ("datcom", "corrected", "final")
        for kind in (".nc", ".fmu", ".toml", "_engine1.nc")
    }
    results = json.loads((folder / "report" / "results.json").read_text())["results"]
    assert len(results) == len(expected)
    report = {
        "report.html",
        "report.pdf",
        "results.json",
        "results.nc",
        "results.xml",
        "manifest.json",
    }
    report |= {f"csv/{item['case']['name']}.csv" for item in results}
    assert names == models | {"flown.nc"} | {f"report/{name}" for name in report}
    assert {item.state for item in pom.verify(folder / "report")} == {"same"}
    for name in ("datcom", "corrected", "final"):
        assert aerodb.check(aerodb.open(folder / f"{name}.nc")) == []


@pytest.mark.slow
def test_flight_makes_the_model_better(either):
    _, run, _ = either
    outcome = json.loads(run.stdout)
    passes = {
        name: sum(case["status"][name] in MATCHED for case in outcome["cases"])
        for name in ("datcom", "corrected", "final")
    }
    assert passes["datcom"] < min(passes["corrected"], passes["final"])
    assert all(
        case["status"]["corrected"] in MATCHED
        for case in outcome["cases"]
        if case["status"]["final"] in MATCHED
    )
    assert len(outcome["corrected_terms"]) < 0.5 * outcome["differing"]  # found 31 of 99
    added = [name for names in outcome["joint_terms"].values() for name in names]
    assert set(added) < set(outcome["corrected_terms"])
    assert sorted(
        name for names in outcome["corrected_submodels"].values() for name in names
    ) == sorted(outcome["corrected_terms"])
    assert {"aerodynamics", "engine"} <= set(outcome["corrected_submodels"])
    assert all(case["failure"] == "" for case in outcome["cases"])


@pytest.mark.slow
def test_the_demo_ranks_the_wrong_terms_over_all_cases(either):
    folder, run, _ = either
    ranking = json.loads(run.stdout)["ranking"]
    assert ranking[0].startswith("Over all cases the a-priori model is most likely wrong in C")
    chapters = restore_chapters(pom.read_archive(folder / "report").chapters)
    assert list(chapters.ranking_text) == ranking
    first, *steps, last = chapters.ranking.rows
    assert (first[0], last[0]) == ("a priori", "final model")
    named = {row[0] for row in steps}
    assert 2 <= len(named) == len(steps)
    assert named <= {name for name in aerodb.terms(aerodb.open(folder / "final.nc"))}
    # The final model, the last row, matches more cases than the a-priori one.
    assert float(last[-2]) < float(first[-2])


@pytest.mark.nightly
def test_the_final_model_flies_by_force(whole_demo):
    """What only the identified control loading can give: the column force of a turn, the motion
    after a pulse of force.
    """
    folder, run = whole_demo
    cases = {case["name"]: case["status"] for case in json.loads(run.stdout)["cases"]}
    for name in (
        "stick_free_short_period",
        "wheel_force",
        "dutch_roll_pedals_free",
        "stick_force_per_g",
    ):
        # the record of the Dutch roll holds fewer cycles than its row requires
        assert cases[name]["final"] == EXPECTED[name]
        assert cases[name]["datcom"] not in ("pass", "pass_with_departures")
    terms = aerodb.terms(aerodb.open(folder / "final.nc"))
    assert (
        float(terms["Ch_e/alpha"]["value"]) < 0.0 < float(terms["Ch_r/beta"]["value"])
    )  # the surfaces trail in the wind
    assert float(terms["Ch_e/delta_t"]["stderr"]) > 0.0
    craft = flightmech.read_aircraft(folder / "final.toml")
    assert "identified from flight" in craft.history
    apriori = flightmech.read_aircraft(folder / "datcom.toml")
    assert all(
        craft.circuits[name].friction != apriori.circuits[name].friction
        for name in ("column", "wheel", "pedal")
    )


@pytest.mark.nightly
def test_the_final_model_brakes_and_turns_on_the_runway(whole_demo):
    folder, run = whole_demo
    cases = {case["name"]: case["status"] for case in json.loads(run.stdout)["cases"]}
    # it stops where the flight does, and off the flown track
    assert cases["brake_stop"]["final"] == "pass_with_departures"
    assert cases["brake_stop"]["datcom"] not in MATCHED
    # the rate of turn of the record is never steady: no band of the case file replaces the row
    assert set(cases["taxi_turn"].values()) == {"invalid"}
    gear = {
        contact.name: contact
        for contact in flightmech.read_aircraft(folder / "final.toml").gear.contacts
    }
    assert gear["left"].stiffness == gear["right"].stiffness > gear["nose"].stiffness > 0.0
    assert 0.0 < gear["left"].rolling < 0.05  # dry concrete: 0.01 to 0.03
    assert gear["left"].brake_friction > gear["nose"].brake_friction == 0.0


@pytest.mark.slow
def test_every_step_is_reported_on_its_own_line(either):
    _, run, expected = either
    lines = [line for line in run.stderr.splitlines() if not line.startswith("warning: ")]
    steps = [line for line in lines if " ... " in line]
    # the whole demo also identifies control loading, ground effect and landing gear
    assert len(steps) == (14 if expected is EXPECTED else 11)
    assert all(line.endswith(" s") for line in steps)
