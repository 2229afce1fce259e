"""A record under two names must not identify twice."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from aeromatch.planning.repeated_samples import (
    leaked_sample_problems,
    proving_samples,
    repeated_sample_problems,
    used_samples,
)

TIME = np.arange(0.0, 60.0, 0.1)


def record(seed, cut=0):
    noise = np.random.default_rng(seed).normal(size=(6, TIME.size))
    names = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
    channels = {name: ("time", row[cut:]) for name, row in zip(names, noise, strict=True)}
    return xr.DataTree.from_dict({"/imu": xr.Dataset(channels, coords={"time": TIME[cut:]})})


def samples(of, start=10.0, end=40.0, model="Cm = 1 + alpha"):
    fits = {"fit": SimpleNamespace(models=[model])}
    return used_samples(fits, of, {"fit": [(start, end)]})


@pytest.mark.parametrize("cut", [0, 50])
def test_a_copy_also_one_that_was_trimmed(cut):
    (line,) = repeated_sample_problems({"a": samples(record(1)), "b": samples(record(1, cut))})
    assert line.startswith("record b: 300 samples in its windows are samples of record a")
    assert "both identify Cm" in line
    assert "take one of both records out of the fits" in line


def test_other_flights_windows_and_coefficients_do_not_count_twice():
    first = samples(record(1))
    assert repeated_sample_problems({"a": first, "b": samples(record(2))}) == []
    assert repeated_sample_problems({"a": first, "b": samples(record(1), 40.0, 55.0)}) == []
    other = samples(record(1), model="Cl = 1 + beta")
    assert repeated_sample_problems({"a": first, "b": other}) == []


def test_a_record_without_inertial_channels():
    plain = xr.Dataset({"delta_e": ("time", TIME)}, coords={"time": TIME})
    found = samples(xr.DataTree.from_dict({"/controls": plain}))
    assert found["Cm"].size == 0
    assert repeated_sample_problems({"a": found, "b": found}) == []


def test_a_proof_that_was_cut_out_of_an_identifying_record():
    identifying = {"cruise": samples(record(1))}
    for cut, window, count in ((100, (12.0, 30.0), 1), (100, (45.0, 58.0), 0), (0, (0.0, 8.0), 0)):
        case = SimpleNamespace(name="pulse", window=window)
        proofs = {"check": proving_samples([case], record(1, cut))}
        problems = leaked_sample_problems(identifying, proofs)
        assert len(problems) == count
    proofs = {"check": proving_samples([SimpleNamespace(name="pulse", window=(12, 30))], record(1))}
    (line,) = leaked_sample_problems(identifying, proofs)
    assert line.startswith("case pulse: 181 samples of its record check are samples of record")
    # another flight, and the record itself, whose windows are compared by time
    other = {"check": proving_samples([case], record(2))}
    assert leaked_sample_problems(identifying, other) == []
    assert leaked_sample_problems({"check": identifying["cruise"]}, proofs) == []


def test_targets_of_the_same_windows_share_one_array():
    fits = {
        "pitch": SimpleNamespace(models=["Cm = 1 + alpha", "CY = beta", "CL = 1 + alpha"]),
        "drag": SimpleNamespace(models=["CD = 1 + alpha", "CL = 1 + alpha"]),
    }
    spans = {"pitch": [(10.0, 40.0)], "drag": [(45.0, 50.0)], "empty": []}
    found = used_samples(fits, record(1), spans)
    # a position without a window identifies nothing
    sizes = {name: array.size for name, array in found.items()}
    assert sizes == {"Cm": 300, "CL": 350, "CD": 50, "CY": 300}
    # so that a store has it once
    assert found["Cm"] is found["CY"]


def test_flights_without_common_samples_are_not_compared_in_pairs(monkeypatch):
    flights = {str(seed): samples(record(seed)) for seed in range(4)}
    proofs = {"4": proving_samples([SimpleNamespace(name="pulse", window=(12, 30))], record(4))}
    compared = []
    monkeypatch.setattr(np, "intersect1d", lambda *items, **_: compared.append(items))
    assert repeated_sample_problems(flights) == []
    assert leaked_sample_problems(flights, proofs) == []
    assert not compared
