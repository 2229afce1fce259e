"""FMUs of a model with flow separation: names, states, stored states, bits of the direct call."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.validation import validate_fmu

import flightmech
from flightmech.aircraft.separation import FlowSeparation
from flightmech.terms import make_term

VERSIONS = ("2.0", "3.0")
TRACE = ("alpha", "p", "phi", "CL", "stall.X_left", "stall.X_right", "stall.buffet_rms")
CONDITION = {"init.V": 60.0, "init.h": 3000.0, "init.alpha": 0.2, "init.p": 0.05}


@pytest.fixture(scope="module")
def stalling(plain_aircraft, plain) -> flightmech.SimModel:
    tables = {
        "a1": make_term(25.0),
        "alpha_star": make_term([0.26, 0.24], {"delta_f": [0.0, 0.6]}),
        "asymmetry": make_term(0.01),
        "tau1": make_term(6.0),
        "tau2": make_term(8.0),
        "buffet_rms": make_term([2.0, 0.4, 0.0], {"X": [0.2, 0.9, 1.0]}),
        "buffet_frequency": make_term(60.0),
        "buffet_damping": make_term(0.1),
    }
    return plain(
        plain_aircraft(stall=FlowSeparation(2.4, tables)),
        CL={"stall": make_term([-3.0, 0.0], {"X_lift": [0.25, 1.0]}, ["alpha"])},
        Cl={"stall": make_term(0.5, regressors=["X_lift_diff", "alpha"])},
    )


@pytest.fixture(scope="module")
def files(stalling, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("stalling")
    return {v: flightmech.write_fmu(stalling, folder / f"v{v[0]}.fmu", v) for v in VERSIONS}


@pytest.fixture(scope="module")
def unpacked(files) -> dict[str, Path]:
    return {
        v: Path(fmpy.extract(str(path), str(path.with_suffix("")))) for v, path in files.items()
    }


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_the_standard_finds_nothing_and_the_states_have_names(files, unpacked, version):
    assert validate_fmu(str(files[version])) == []
    model = fmpy.read_model_description(str(unpacked[version]))
    names = {variable.name for variable in model.modelVariables}
    assert {"state.X_left", "state.X_right", "stall.X_left", "stall.station"} <= names
    assert {"der(state.X_left)", "der(state.X_right)"} <= names
    assert {"stall.buffet_rms", "term.stall.alpha_star"} <= names


TIME = 0.02 * np.arange(161)
PULL = -0.1 - 0.1 * np.minimum(TIME, 2.0)


def fly(one, first: int, last: int) -> list[list[float]]:
    """Pull through the stall with some aileron, from one sample of the time to another."""
    rows = []
    for k in range(first, last):
        one.set({"delta_e": float(PULL[k]), "delta_a": 0.02})
        one.step(TIME[k], TIME[k + 1] - TIME[k])
        rows.append(one.get(*TRACE))
    return rows


@pytest.mark.parametrize("version", VERSIONS)
def test_a_serialised_state_gives_the_same_bits_in_another_instance(unpacked, third_party, version):
    one = third_party(unpacked[version]).open().start({"mode.trim": 0, **CONDITION})
    two = third_party(unpacked[version]).open()
    fly(one, 0, 60)
    kept = one.fmu.serializeFMUState(one.fmu.getFMUState())
    two.fmu.setFMUState(two.fmu.deserializeFMUState(kept))
    first, second = fly(one, 60, 160), fly(two, 60, 160)
    assert first == second
    separated = np.array(first)[:, 4:6]
    assert separated.min() < 0.3
    assert (separated[:, 0] != separated[:, 1]).all()


def test_both_standards_and_the_direct_call_agree_to_the_bit(stalling, unpacked, third_party):
    rows = {}
    for version in VERSIONS:
        one = third_party(unpacked[version]).open().start({"mode.trim": 0, **CONDITION})
        rows[version] = fly(one, 0, 160)
    assert rows["2.0"] == rows["3.0"]
    moves = {"delta_e": ("time", PULL), "delta_a": ("time", np.full(TIME.size, 0.02))}
    record = xr.Dataset(moves, {"time": TIME})
    direct = flightmech.simulate(stalling, record, {"mode.trim": 0, **CONDITION}, hold="zero")
    found = np.stack([direct[name].values[1:] for name in TRACE], axis=1)
    other = np.array(rows["2.0"])
    assert (found == other).all()
