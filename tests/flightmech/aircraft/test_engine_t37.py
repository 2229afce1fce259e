"""The engine deck of the T-37 against power changes that it was not fitted to."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from flightmech.aircraft.systems.engine_deck import Deck, open_tables

DATA = Path(__file__).parents[3] / "data" / "t37"


@pytest.fixture(scope="module")
def study():
    """``make_engine.py`` as a module."""
    spec = importlib.util.spec_from_file_location("make_engine", DATA / "make_engine.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_engine"] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("name", "thrust"), [("t37_23_val_power_chop", 30.0), ("t37_24_val_power_slam", 60.0)])
def test_power_changes_that_were_not_fitted(study, name, thrust):
    """Found 23 and 46 N; the recorded thrust has 18 N of noise, and with one time constant 261 and 694 N were left."""
    run = study.read(DATA / "flight" / f"{name}.nc")
    assert run.number > study.FITTED
    deck = Deck(open_tables(DATA / "engine.nc"))
    found = study.residuals([run], deck, 5.33)  # the air of the programme is 5.33 K warmer than standard
    assert study.rms(found, "thrust") < thrust
    assert study.rms(found, "n2") < 0.005
    assert study.rms(found, "n1") < 0.008
    assert study.rms(found, "fuel_flow") < 0.0015
    assert np.ptp(run.data["thrust"]) > 1300.0
