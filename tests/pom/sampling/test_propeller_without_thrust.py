"""Terms of the slipstream along a record that has the speed of the propeller and no thrust."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import aerodb
from flightmech import terms
from flightmech.aircraft import Engine, Propeller
from flightmech.errors import UnknownName
from pom.cases.case import read_case
from pom.diagnosis import screening
from pom.diagnosis.sampling.shares import contribution_changes, flown_conditions
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench
from pom.diagnosis.tuning.tuner import Tuner
from pom.replaying.replay_case import plan_of

CT_PROP, DIAMETER, SPEED = 0.1, 2.0, 200.0  # [1, m, rad s-1]
PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}


def powered(trainer, share: float = 1.0):
    """Return the database of the trainer with a moment of the slipstream, with standard errors."""
    leaf = terms.make_term(0.05 * share, regressors=["CT"])
    leaf = leaf.assign(stderr=0.0 * leaf["value"] + 0.01)
    return aerodb.replace_terms(trainer.database(), {"Cm/power": leaf})


@pytest.fixture(scope="module")
def aircraft(trainer):
    # thrust until J 2
    J = np.array([0.0, 3.0])
    tables = {
        "CT_prop": terms.make_term(CT_PROP * (1.0 - J / 2.0), {"J": J}),
        "CP_prop": terms.make_term(0.13 * (1.0 - J / 2.3), {"J": J}),
        "shaft_power": terms.make_term([0.0, 3e5], {"throttle": [0.0, 1.0]}),
    }
    engine = Engine((0.0, 0.0, 0.0), propeller=Propeller(tables, DIAMETER, 2.0, 280.0))
    return replace(trainer.AIRCRAFT, engines=(engine,))


@pytest.fixture(scope="module")
def states(trainer):
    flown = trainer.flight(trainer.database(), duration=9.5, **PULSE)
    flown = flown.drop_vars([name for name in flown if str(name).startswith("engine")])
    speed = 0.0 * flown["V"] + SPEED
    return flown.assign({"engine1.rpm": speed})


@pytest.fixture
def case(write_case):
    path = write_case()
    path.write_text(path.read_text().replace('engine = "thrust"', 'engine = "rpm"'))
    return read_case(path)


def test_thrust_coefficient_is_that_of_the_propeller(trainer, states, aircraft):
    db = powered(trainer)
    leaves = {"Cm/power": aerodb.terms(db)["Cm/power"]}
    CT = flown_conditions(db, leaves, states, aircraft)["CT"]
    # T = CT_prop rho n^2 D^4 with J = V / (n D)
    n = SPEED / (2.0 * np.pi)
    CT_prop = CT_PROP * (1.0 - states["V"] / (n * DIAMETER) / 2.0)
    thrust = CT_prop * states["rho"] * n**2 * DIAMETER**4
    expected = (thrust / (states["qbar"] * aircraft.S)).values
    assert CT[[0, -1]] == pytest.approx(expected[[0, -1]], rel=1e-2)
    assert CT.min() > 0.005
    nodes = {"Cm/power": np.array([0.06])}
    changes = contribution_changes(db, nodes, states, False, aircraft)
    assert changes["Cm/power"][0] == pytest.approx(0.01 * CT)
    with pytest.raises(UnknownName, match="nor qbar and the thrust of its engines"):
        flown_conditions(db, leaves, states)


def test_a_tuning_moves_the_term(trainer, case, states, aircraft):
    tuner = Tuner.of(
        [plan_of(case, states)],
        powered(trainer),
        aircraft=aircraft,
        requested=None,
        evidence=None,
        rationale={},
        jobs=1,
    )
    assert tuner.directions.nodes.keys() == {"Cm/power"}


def test_a_diagnosis_leaves_idle_terms_out(trainer, case, states, aircraft):
    spoilt = trainer.scaled(powered(trainer, 1.001), Cm_elevator=0.6, Cm_qhat=0.8)
    models = SwapModels.of(spoilt, powered(trainer), (aircraft, aircraft))
    bench = SwapBench.of(case, models, states)
    screening.screen_idle_terms(bench)
    assert "Cm/power" in bench.idle
