"""Parts that differ in constants only are chosen by parameters, with the bits of a compiled model
of their own.
"""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.controls import MOST
from flightmech.terms import make_term
from pom.diagnosis.swap_models import SwapModels

T37 = Path(__file__).parents[3] / "data" / "t37"


@pytest.fixture(scope="module")
def pair(trainer):
    """The trainer on the legs of the T-37, and with another lag of its engines, before and after
    its flights.
    """
    gears = [
        flightmech.read_aircraft(T37 / f"{name}.toml").gear for name in ("apriori", "aircraft")
    ]
    engines = [
        tuple(
            replace(
                e, thrust=make_term([200.0, 2000.0], {"throttle": [0.0, 1.0]}), time_constant=lag
            )
            for e in trainer.AIRCRAFT.engines
        )
        for lag in (3.0, 0.5)
    ]
    return tuple(
        replace(trainer.AIRCRAFT, gear=gear, engines=engine)
        for gear, engine in zip(gears, engines, strict=True)
    )


@pytest.fixture(scope="module")
def models(trainer, pair):
    final = trainer.database()
    return SwapModels.of(trainer.scaled(final, Cm_elevator=0.6), final, pair)


def rolled(sim, parameters):
    time = np.arange(0.0, 3.001, 0.02)
    hit = np.where(time > 1.0, 1.0, 0.0)
    inputs = {
        "brake_left": ("time", hit),
        "engine1.throttle": ("time", hit),
        "gear": ("time", np.ones_like(time)),
    }
    start = {
        "init.V": 30.0,
        "mode.trim": 3.0,
        "mode.engine": 0.0,
        "steering.rudder": 0.0,
        "delta_nw": 0.02,
        **parameters,
    }
    return flightmech.simulate(sim, xr.Dataset(inputs, {"time": time}), start)


def test_legs_steering_runway_and_a_lag_are_constants(models):
    assert models.parts == (
        "engine/thrust",
        "gear/nose",
        "gear/left",
        "gear/right",
        "gear/steering",
        "gear/runway",
    )
    assert set(models.constants) == set(models.parts)  # of the engines the lag alone
    before, after = models.constants["gear/runway"]
    assert before.keys() == after.keys() == {"runway.mu_dry"}
    assert before != after


@pytest.mark.nightly
def test_a_choice_by_parameters_is_the_model_compiled_with_these_parts(models):
    plain = models.compiled(())
    unlike = rolled(plain, models.choice(()))
    terms = {name: value for name, value in models.choice(()).items() if name.startswith("term.")}
    for names in (
        *combinations(models.constants, 1),
        ("gear/nose", "gear/right"),
        tuple(models.constants),
    ):
        assert models.compiled_parts(names) == frozenset()
        chosen, own = rolled(plain, models.choice(names)), rolled(models.compiled(names), terms)
        xr.testing.assert_identical(chosen, own)
        assert not chosen.equals(unlike), names


def test_what_is_not_constant_has_a_model_of_its_own(trainer, pair):
    tabled = replace(
        pair[1],
        engines=tuple(
            replace(e, thrust=make_term([0.0, 9e3], {"mach": [0.0, 1.0]})) for e in pair[1].engines
        ),
    )
    models = SwapModels.of(trainer.database(), trainer.database(), (pair[0], tabled))
    assert "engine/thrust" not in models.constants
    assert models.compiled_parts(models.parts) == {"engine/thrust"}
    assert models.compiled(models.compiled_parts(models.parts)) is not models.compiled(())


@pytest.mark.slow
def test_a_constant_that_states_no_limit_has_a_model_of_its_own(trainer):
    """The kernel takes such a number as the model has it, and refuses to set it."""
    limited = flightmech.read_aircraft(T37 / "aircraft.toml")
    name, circuit = next(iter(limited.circuits.items()))
    circuits = [{name: replace(circuit, trim_limit=limit)} for limit in (50.0, MOST)]
    pair = [replace(trainer.AIRCRAFT, controls=limited.controls, circuits=one) for one in circuits]
    for one in (pair, pair[::-1]):
        models = SwapModels.of(trainer.database(), trainer.database(), tuple(one))
        assert models.parts == (f"circuit/{name}",)
        sim = models.compiled(models.compiled_parts(models.parts))
        still = xr.Dataset(coords={"time": [0.0, 0.1]})
        flown = flightmech.simulate(
            sim, still, {"init.V": 100.0, "init.h": 1000.0, **models.choice(models.parts)}
        )
        assert np.isfinite(flown["V"].values).all()
