"""The Citation 500 simulation (AE4320, noise free): its recorded surfaces are commands, about 0.075
s ahead of what acts (README).
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat

import flighttest

FILES = Path(__file__).parents[2] / ".." / "shared" / "data" / "flight" / "citation500_sim"
pytestmark = pytest.mark.skipif(
    not FILES.is_dir(),
    reason="the Citation 500 simulation (../shared/data/flight/citation500_sim) is not here",
)
COLUMNS = {
    "p": "p", "q": "q", "r": "r", "phi": "phi", "theta": "theta", "psi": "psi", "ax_imu": "Ax",
    "ay_imu": "Ay", "az_imu": "Az",
    "vn": "u_n", "ve": "v_n", "vd": "w_n", "V": "vtas", "alpha_vane": "alpha", "beta_vane": "beta",
    "delta_e": "de", "delta_a": "da", "delta_r": "dr",
}  # fmt: skip


def quality(name):
    raw = {
        key: np.ravel(value)
        for key, value in loadmat(FILES / f"{name}.mat").items()
        if key[0] != "_" and key != "string"
    }
    data = xr.Dataset(
        {name: ("time", raw[theirs][:-1]) for name, theirs in COLUMNS.items()},
        {"time": raw["t"][:-1]},
        {"rate": 100.0},
    )
    return flighttest.assess(
        xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": name}), "/all": data})
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "surface"), [("de3211_1", "delta_e"), ("da3211_2", "delta_a")])
def test_recorded_surfaces_are_commands(name, surface):
    found = quality(name)
    lead = found.answers.set_index("surface").loc[surface, "lead"]
    assert lead == pytest.approx(0.075, abs=0.03)  # a lag of 1/13.37 s, taken here as a delay
    assert all(row.disagreement < 0.1 for row in found.kinematics.itertuples())
