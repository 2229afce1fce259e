"""The levels of drive on the T-37 and its control circuits, and a math pilot who holds the wings of
a wrong model.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerodb
import flightmech
from flightmech import terms
from pom.cases.case import driven_quantities, read_case
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import flight_states, recorded_states
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import plan_of, replay
from pom.replaying.run_remarks import pilot_activity

CASES = Path(__file__).parents[3] / "data" / "t37" / "cases"
COCKPIT = ("column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal")
DRIVES = sorted((CASES / "drives").glob("*.toml"))


@pytest.fixture(scope="module")
def short_period(trainer, tmp_path_factory):
    """The short period of the T-37 with what its circuits give for stick and pedals, and an FMU of
    the trainer's terms in the T-37.
    """
    case = read_case(CASES / "21_short_period.toml")
    aircraft = flightmech.read_aircraft(case.aircraft)
    dry = dict.fromkeys(("friction", "stiction", "hinge_friction", "preload"), 0.0)
    loose = {name: replace(circuit, **dry) for name, circuit in aircraft.circuits.items()}
    aircraft = replace(
        aircraft, circuits=loose
    )  # friction and preload would leave stick and wheel anywhere in their bands
    hinges = {
        "Ch_e/alpha": terms.make_term(-0.1, regressors=["alpha"]),
        "Ch_e/delta": terms.make_term(-0.4, regressors=["delta_e"]),
    }
    db = trainer.database()
    x, y, z = aircraft.reference
    root = {
        **db.attrs,
        "S": aircraft.S,
        "cbar": aircraft.cbar,
        "b": aircraft.b,
        "x_ref": x,
        "y_ref": y,
        "z_ref": z,
    }
    sim = flightmech.compile(aircraft, aerodb.make_database({**aerodb.terms(db), **hinges}, **root))
    place = tmp_path_factory.mktemp("drives") / "model.fmu"
    flightmech.write_fmu(sim, place)
    states = flight_states(case, recorded_states(case))
    outputs, failures = replay_choices(sim, plan_of(case, states).job)
    assert failures == [""]
    return (
        case,
        states.assign({name: ("time", outputs[f"applied.{name}"][0]) for name in COCKPIT}),
        place,
    )


@pytest.mark.slow
def test_the_stick_moves_the_model_as_its_surfaces_did(short_period):
    """The travel is what the circuit gave for the recorded surfaces; given as the record it brings
    them back, over the elastic cable.
    """
    case, states, fmu = short_period
    by = {
        level: replay(replace(case, drive=replace(case.drive, surfaces=level)), {"m": fmu}, states)
        for level in ("recorded", "cockpit", "force")
    }
    pitch = {
        level: np.degrees(result.signals["theta"].sel(run="m").values)
        for level, result in by.items()
    }
    assert np.ptp(pitch["recorded"]) > 5.0
    assert (
        np.abs(pitch["cockpit"] - pitch["recorded"]).max() < 0.05
    )  # the cable oscillates at the steps of the recorder
    assert (
        np.abs(pitch["force"] - pitch["recorded"]).max() < 0.4
    )  # 0.23: the force of its inertia, from samples of 20 ms
    forced = by["force"].trim["m"]
    assert abs(forced["trim.F_column"]) < 1.0
    assert forced["F_column"] == pytest.approx(
        forced["trim.F_column"] + by["force"].trim.loc["F_column", "flight"], abs=0.1
    )  # sample or line


@pytest.mark.nightly
def test_a_glider_flies_without_a_drive(trainer):
    """Without thrust the aircraft decelerates by its drag; trim and replay need no engine."""
    case = read_case(CASES / "21_short_period.toml")
    case = replace(case, drive=replace(case.drive, engine="none"))
    aircraft = replace(flightmech.read_aircraft(case.aircraft), engines=(), fuel=None)
    x, y, z = aircraft.reference
    size = {"S": aircraft.S, "cbar": aircraft.cbar, "b": aircraft.b}
    root = {**trainer.database().attrs, **size, "x_ref": x, "y_ref": y, "z_ref": z}
    db = aerodb.make_database(aerodb.terms(trainer.database()), **root)
    sim = flightmech.compile(aircraft, db)
    job = plan_of(case, flight_states(case, recorded_states(case))).job
    assert not [name for name in job.inputs if name.startswith("engine")]
    assert "mode.engine" not in job.parameters
    outputs, failures = replay_choices(sim, job)
    assert failures == [""]
    speed = outputs["V"][0]
    assert np.isfinite(speed).all()
    assert speed[-1] < speed[0]


def test_what_drives_is_not_judged_and_what_it_moves_is():
    case = read_case(CASES / "21_short_period.toml")
    for level, names in (
        ("cockpit", {"column", "wheel", "pedal"}),
        ("force", {"F_column", "F_wheel", "F_pedal"}),
    ):
        found = driven_quantities(replace(case, drive=replace(case.drive, surfaces=level)))
        assert names <= found
        assert "delta_e" not in found
        assert "delta_f" in found


@pytest.mark.parametrize("file", DRIVES, ids=lambda file: file.stem)
def test_shipped_drives_are_sound(file):
    case = read_case(file)
    assert case.drive.surfaces in ("cockpit", "pilot")
    assert any(c.applies for c in case.criteria)


@pytest.mark.slow
def test_a_math_pilot_holds_the_wings_and_leaves_the_pitch_alone(write_case, trainer, tmp_path):
    """A model with 30 % too much aileron ends nearly 2 degrees off in bank; with the pilot a
    quarter of that, and pitch as it was.
    """
    truth = trainer.flight(
        trainer.database(),
        delta_e=[(0.0, 0.0), (2.0, 0.0), (2.06, -0.03), (4.0, -0.03), (4.06, 0.0)],
        delta_a=[(0.0, 0.0), (3.0, 0.0), (3.06, -0.02), (4.0, -0.02), (4.06, 0.0)],
    )
    sim = flightmech.compile(trainer.AIRCRAFT, trainer.scaled(trainer.database(), Cl_aileron=1.3))
    flightmech.write_fmu(sim, tmp_path / "wrong.fmu")
    free = read_case(write_case())
    loops = (
        PilotLoop("delta_a", "phi", -0.5, np.radians(3.0)),
        PilotLoop("delta_a", "p", -0.2, np.radians(2.0)),
    )
    held = replace(free, drive=replace(free.drive, surfaces="pilot", pilot=loops))
    flown = {
        case.drive.surfaces: replay(case, {"wrong": tmp_path / "wrong.fmu"}, truth)
        for case in (free, held)
    }

    def off(result, name):
        return float(
            np.degrees(
                np.abs(
                    result.signals[name].sel(run="wrong") - result.signals[name].sel(run="flight")
                )
            ).max()
        )

    assert off(flown["recorded"], "phi") > 1.5
    assert off(flown["pilot"], "phi") < 0.3 * off(flown["recorded"], "phi")
    assert flown["pilot"].status("wrong") == flown["recorded"].status("wrong") == "pass"
    (row,) = pilot_activity(flown["pilot"]).to_dict("records")
    assert (row["run"], row["control"]) == ("wrong", "delta_a")
    assert (
        0.0 < row["largest"] < np.radians(1.0)
    )  # against the 30 % of 1.15 deg, less what the loop leaves
    moved = flown["pilot"].signals["delta_a"]
    bias = float(flown["pilot"].trim.loc["trim.delta_a", "wrong"])
    difference = moved.sel(run="wrong") - moved.sel(run="flight")
    assert float(np.abs(difference).max()) == pytest.approx(
        abs(row["largest"] + bias), rel=0.02
    )  # what the aileron did, trim and all
    direct, _ = replay_choices(
        sim, plan_of(held, truth).job, channels=["phi"]
    )  # the same loops around the kernel itself
    assert (
        np.abs(direct["phi"][0] - flown["pilot"].signals["phi"].sel(run="wrong").values).max()
        < 1e-9
    )
