"""The engine deck of the T-37 as `aeromatch flight engine` made it: power changes it was not fitted
to; thrust from equilibrium.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.propulsion.engine_deck import open_tables
from flighttest.records.signals.conditioning import cut
from flighttest.submodels.engine.bench import fly_deck
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.static_thrust import Polar, correct_deck
from flighttest.submodels.engine.steady_points import equilibrium_points
from flighttest.submodels.engine.tables import read_structure

DATA = Path(__file__).parents[3] / "data" / "t37"
RATE = 10.0  # Hz, of the engine channels


def recording(run: int) -> xr.Dataset:
    (path,) = (DATA / "flight").glob(f"t37_{run:02d}_*.nc")
    record = flighttest.read(path, DATA / "names.toml")
    return cut(
        record, 0.0, min(float(leaf["time"][-1]) for leaf in record.children.values()), rate=RATE
    )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("run", "thrust"),
    [
        (23, 25.0),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in [(24, 25.0), (25, 18.0), (27, 25.0)]
        ),
    ],
)
def test_records_that_were_not_fitted(run, thrust):
    """Found 21.8, 19.4, 14.6 and 21.9 N; the recorded thrust has 18 N of noise, and with one time
    constant 261 and 694 N were left.
    """
    record = engine_channels(
        recording(run), (1, 2), height=read_structure(DATA / "engine.toml").height
    )
    flown = fly_deck(read_aircraft(DATA / "aircraft.toml").engines[0].deck, record)
    for name, most in (("thrust", thrust), ("n2", 0.0025), ("n1", 0.006), ("fuel_flow", 0.0012)):
        assert float(np.sqrt(np.mean((flown[name] - record[name].values) ** 2))) < most, name


def test_deck_has_sources_and_standard_errors():
    tables = open_tables(DATA / "engine.nc")
    assert {
        "n2_command",
        "n2_up_limit",
        "n2_down_limit",
        "n1_up_limit",
        "corrected_thrust",
        "fuel_flow",
    } <= set(tables)
    assert all({"stderr", "source"} <= set(table) for table in tables.values())
    assert all((table["source"] == 1).all() for table in tables.values())  # flight
    thrust = tables["corrected_thrust"].sel(corrected_n2=0.95, mach=0.3, h=1500.0)
    assert (
        0.015 < float(thrust["stderr"] / thrust["value"]) < 0.03
    )  # 1.5 % of it the in-flight thrust computation


def equilibrium(run: int, prior: xr.Dataset, S: float) -> xr.Dataset:
    """Points of clean, steady flight without the recorded thrust; vanes as they were recorded."""
    record = recording(run)
    states = engine_channels(record, (1, 2), height="h_gps").drop_vars("thrust")
    states = states.assign(
        alpha=record["alpha_vane"], mass=record["mass"], ax=record["ax_imu"], az=record["az_imu"]
    )
    clean = (record["delta_f"] < 0.02) & (record["gear"] < 0.02) & (record["speedbrake"] < 0.02)
    calm = (abs(record["q"]) < 0.02) & (abs(record["p"]) < 0.05) & (abs(record["beta_vane"]) < 0.03)
    kept = (clean & calm).astype(float).coarsen(time=int(RATE), boundary="trim").min().values > 0.5
    return equilibrium_points(states, prior, S, engines=2).isel(point=kept)


@pytest.mark.slow
def test_thrust_from_equilibrium_needs_a_power_change():
    """A deck 7 % too low is found by chops and slams with a vague polar; flight at one power
    cannot.

    Found 1.067, 1.074 and 1.067 for 1.075; at one power the factors keep half of the standard error
    that was put in.
    """
    S = read_aircraft(DATA / "aircraft.toml").S
    prior = open_tables(DATA / "engine.nc")["corrected_thrust"].drop_vars("source")
    prior = prior.assign(value=0.93 * prior["value"], stderr=0.1 * abs(prior["value"]) + 1.0)
    vague = Polar(0.025, 0.12, 0.01, 0.06)
    runs = [equilibrium(run, prior, S) for run in (2, 3)]
    found = correct_deck(prior, equilibrium=xr.concat(runs, "point"), polar=vague, S=S, engines=2)
    for speed in (0.9, 0.95, 1.0):
        ratio, stderr = found.ratio(speed, 0.3, h=1500.0)
        assert ratio == pytest.approx(
            1.075, abs=0.03
        )  # vanes uncorrected: 0.1 deg of alpha is 37 N along the path, 1 % of the thrust
        assert stderr < 0.02
    assert not any("not separable" in text for text in found.remarks)
    level = runs[1].isel(
        point=np.abs(runs[1]["n2"].values - np.median(runs[1]["n2"].values)) < 0.01
    )
    alone = correct_deck(prior, equilibrium=level, polar=vague, S=S, engines=2)
    assert any("not separable" in text and "two power settings" in text for text in alone.remarks)
    assert float(alone.stderr.min()) > 0.03  # of 0.1 that was put in
