"""A flight that identified the model of a case is named, whatever its file is called."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flightmech.flown_samples import FLOWN_SAMPLES, cut_windows, pack_windows
from pom.cases.case import read_case
from pom.probing import record_leak
from pom.status import status_of


def flight(seed):
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.02)
    walks = {}
    for name in ("p", "q", "r", "nz"):
        walks[name] = ("time", np.cumsum(generator.normal(size=time.size)))
    return xr.Dataset(walks, coords={"time": time})


def windows_of(states):
    channels = {str(name): item.values for name, item in states.data_vars.items()}
    return pack_windows(cut_windows("run_7: pitch", states["time"].values, channels))


@pytest.fixture
def remark(write_case, monkeypatch, tmp_path):
    """Return the remark on a flight and a model with these attributes of its database."""
    case = read_case(write_case())

    def find(states, attributes, source="datcom 64"):
        model = None
        if attributes is not None:
            described = {"CL/basic": {"source": source}}
            model = SimpleNamespace(meta={"database": attributes, "terms": described})
        monkeypatch.setattr(record_leak, "flown_model", lambda fmu: model)
        record_leak._read_windows.cache_clear()
        (found,) = record_leak.find_leaks(case, states, tmp_path / "m.fmu", "hash")
        return found

    return find


def test_the_flight_that_identified_is_a_leak(remark):
    found = remark(flight(1).isel(time=slice(100, 800)), {FLOWN_SAMPLES: windows_of(flight(1))})
    assert found.kind == "leak"
    assert "run_7: pitch" in found.text
    assert "a_case" in found.text


def test_another_flight_is_not(remark):
    found = remark(flight(2), {FLOWN_SAMPLES: windows_of(flight(1))})
    assert found.kind == "probe"
    assert "no samples shared" in found.text


@pytest.mark.parametrize(
    ("states", "words"),
    [
        (flight(1).isel(time=slice(100, 350)), "has 4.98 s of it, 5.4 s are needed"),
        (flight(1)[["p", "q"]], "has 2 of p, q, r, nz, 3 are needed"),
    ],
)
def test_a_flight_that_cannot_be_compared_is_not_called_another_one(remark, states, words):
    found = remark(states, {FLOWN_SAMPLES: windows_of(flight(1))})
    assert found.kind == "not_checked"
    assert words in found.text


@pytest.mark.parametrize(
    ("attributes", "kind", "words"),
    [
        (None, "not_checked", "not compared"),
        ({"history": "from_datcom: clean"}, "probe", "not from flight"),
        # the samples are missing or were taken out
        ({"history": "replace_terms: (identified from flight)"}, "departure", "has no samples"),
        ({"history": "identified from flight", FLOWN_SAMPLES: "damaged"}, "departure", "compile"),
    ],
)
def test_what_was_not_compared_is_stated(remark, attributes, kind, words):
    found = remark(flight(1), attributes)
    assert found.kind == kind
    assert words in found.text


def test_tables_from_flight_without_samples_and_history_are_a_departure(remark):
    found = remark(flight(1), {}, source="datcom 27, flight 21, judgement 16")
    assert found.kind == "departure"
    assert "the tables are from flight" in found.text


def test_the_statuses_have_an_order():
    groups = {"g": "pass"}
    assert status_of(groups, leak=True, record_error=True, departures=True) == "leak"
    assert status_of(groups, leak=True, not_driven=True) == "not_driven"
    assert status_of({"g": "fail"}, leak=True, not_driven=True) == "fail"
