"""Lost samples of a flight record on the way to the states."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flighttest.reconstruction.flight_programme import save_path

T37 = Path(__file__).parents[3] / "data" / "t37"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(T37 / "aircraft.toml")


@pytest.fixture(scope="module")
def record():
    flight = "t37_21_val_short_period_full_flaps_gear_down.nc"
    return flighttest.read(T37 / "flight" / flight, T37 / "names.toml")


def changed(record, change):
    leaves = {f"/{name}": change(name, node.to_dataset()) for name, node in record.children.items()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=record.attrs), **leaves})


def test_blank_cells_of_all_channels_split_the_states(record, aircraft):
    def blank(_, data):
        return data.where((data["time"] <= 6.0) | (data["time"] >= 8.0))

    states = flighttest.reconstruct(changed(record, blank), aircraft).states
    assert np.diff(states["time"]).max() == pytest.approx(2.0)
    assert all(np.isfinite(states[name].values).all() for name in states.data_vars)


@pytest.mark.slow
def test_states_name_the_gaps_of_their_controls(record, aircraft, tmp_path):
    """The elevator doublet lies in the gap: the line across it hides 4 deg."""

    def without_rows(name, data):
        time = data["time"].values
        kept = (time < 5.3) | (time > 9.5) if name == "controls" else time > -1.0
        return data.isel(time=kept)

    path = flighttest.reconstruct(changed(record, without_rows), aircraft)
    save_path(path, tmp_path / "path.nc")
    states = flighttest.dynamics.open_path(tmp_path / "path.nc", described=False).states
    assert np.diff(states["time"]).max() < 0.1
    gaps = json.loads(states.attrs["channel_gaps"])
    ((start, stop),) = gaps["delta_e"]
    assert start == pytest.approx(5.3, abs=0.05)
    assert stop == pytest.approx(9.5, abs=0.05)
    assert "engine1.n1" not in gaps
    assert json.loads(flighttest.reconstruct(record, aircraft).states.attrs["channel_gaps"]) == {}
