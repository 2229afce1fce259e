"""Readings of a predicted flight, from a steady turn in closed form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flighttest.flight_programme.planning.pilot import PredictedFlight
from flighttest.flight_programme.planning.predicted_record import predicted_record

T37 = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"


def test_each_vane_is_at_its_own_position():
    """A vane 1 m ahead of the c.g. sees w - 0.1 m/s, and one 6 m ahead sees v + 0.6 m/s."""
    aircraft = read_aircraft(T37)
    instruments = {name: item for name, item in aircraft.instruments.items() if name != "vanes"}
    for name, ahead in (("alpha_vane", 1.0), ("beta_vane", 6.0)):
        position = list(np.add(aircraft.cg, (ahead, 0.0, 0.0)))
        instruments[f"probe {name}"] = {
            "position": position,
            "noise": {name: 1e-9},
            "bias_sigma": {name: 1e-3},
        }
    aircraft = replace(aircraft, instruments=instruments)
    t = np.arange(0.0, 2.0, 0.02)
    rest = ("p", "p_dot", "q_dot", "r_dot", "ax", "ay", "az", "phi", "theta", "psi")
    values = dict.fromkeys((*rest, "vn", "ve", "vd", "h", "V_cas", "mach"), 0.0)
    values |= {"u": 50.0, "v": 1.0, "w": 2.0, "q": 0.1, "r": 0.1}
    values |= {"V": 50.0, "p_static": 1e5, "temperature": 288.0}
    motion = xr.Dataset(
        {name: ("time", np.full(len(t), value)) for name, value in values.items()}, {"time": t}
    )
    record = predicted_record(PredictedFlight(motion, []), aircraft, "turn")
    alpha = record["probe alpha_vane"]["alpha_vane"].values
    beta = record["probe beta_vane"]["beta_vane"].values
    np.testing.assert_allclose(alpha, np.arctan2(2.0 - 0.1, 50.0), atol=1e-7)
    np.testing.assert_allclose(beta, np.arctan2(1.0 + 0.6, 50.0), atol=1e-7)
