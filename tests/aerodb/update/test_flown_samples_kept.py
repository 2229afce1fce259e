"""A database keeps the samples of the fits that entered it, through every edit."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
from aerodb.store.schema import make_database
from aerodb.store.undo_history import undo_edits
from aerodb.update.tabulation_report import Tabulation, pack_flown_samples
from flightmech.flown_samples import FLOWN_SAMPLES, unpack_windows

ROOT = {"title": "test", "aircraft": "test", "S": 16.0, "cbar": 1.6, "b": 10.0}
ROOT |= {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability"}


def leaf(value):
    return xr.Dataset({"value": ((), value), "stderr": ((), 2.0)}, attrs={"regressors": "qhat"})


@pytest.fixture
def flown():
    """Return the samples of one fit over two windows."""
    generator = np.random.default_rng(4)
    time = np.concatenate([np.arange(0.0, 8.0, 0.02), np.arange(20.0, 30.0, 0.02)])
    walks = {name: np.cumsum(generator.normal(size=time.size)) for name in ("p", "q", "r", "nz")}
    data = xr.Dataset({name: ("sample", item) for name, item in {**walks, "time": time}.items()})
    return pack_flown_samples([("run_1: pitch", data), ("published", xr.Dataset())])


@pytest.fixture
def database(flown):
    empty = pd.DataFrame()
    prior = make_database({"Cm/qhat": leaf(-12.0)}, **ROOT)
    tables = Tabulation(
        {"Cm/qhat": leaf(-10.0)}, empty, points=empty, compatibility=empty, flown_samples=flown
    )
    return aerodb.replace_terms(prior, tables, note="identified from flight")


def test_the_samples_stay_through_edits_files_and_undo(database, flown, tmp_path):
    assert len(unpack_windows(flown)) == 2
    assert database.attrs[FLOWN_SAMPLES] == flown
    scaled = aerodb.edit.scale(database, "Cm/qhat", 1.1)
    aerodb.save(scaled, tmp_path / "a.nc")
    assert aerodb.open(tmp_path / "a.nc").attrs[FLOWN_SAMPLES] == flown
    assert undo_edits(scaled).attrs[FLOWN_SAMPLES] == flown


def test_a_long_text_survives_a_file(database, tmp_path):
    # 64 kB is the largest attribute of old HDF5 files
    long = database.copy()
    long.attrs[FLOWN_SAMPLES] = "x" * 300_000
    aerodb.save(long, tmp_path / "a.nc")
    assert aerodb.open(tmp_path / "a.nc").attrs[FLOWN_SAMPLES] == "x" * 300_000


def test_a_blend_rests_on_the_flights_of_both(database, flown):
    prior = make_database({"Cm/qhat": leaf(-12.0)}, **ROOT)
    assert FLOWN_SAMPLES not in prior.attrs
    assert aerodb.edit.blend(prior, database, "Cm/qhat").attrs[FLOWN_SAMPLES] == flown
