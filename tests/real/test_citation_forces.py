"""Column force of the Citation II at its steady points: what they show of the hinge moment, and
what not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightmech.units import DEGREE
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.regression import trim_forces

FOLDER = Path(__file__).parents[2] / ".." / "shared" / "data" / "flight" / "citation_phlab"
KNOT = 1852.0 / 3600.0


def points(flight: str, series: tuple[str, ...]) -> xr.Dataset:
    """Points of the sheets with a column force; on these, pull is negative."""
    file = FOLDER / f"stationary_{flight}.csv"
    if not file.exists():
        pytest.skip("needs ../shared/data/flight/citation_phlab")
    table = pd.read_csv(file)
    table = table[table["column_force_N"].notna() & table["series"].isin(series)]
    found = {
        "F_column": -table["column_force_N"],
        "qbar": 0.5 * 1.225 * (table["ias_kt"] * KNOT) ** 2,
        "alpha": table["alpha_deg"] * DEGREE,
        "delta_e": table["delta_e_deg"] * DEGREE,
    }
    return xr.Dataset({name: ("point", x.to_numpy(float)) for name, x in found.items()})


# geometry and gearing are not published: the product gearing S_hinge c_hinge Ch
LOADING = ControlLoading("column", -1.0, 1.0, 1.0, "Ch_e = 1 + alpha + delta_e")


@pytest.mark.parametrize(
    ("flight", "product"), [("20180312_1", -0.852), ("20200310_2", -0.834), ("20190305_2", -0.368)]
)
def test_a_displaced_cg_shows_the_hinge_moment_of_the_elevator_and_of_nothing_else(flight, product):
    found = trim_forces(LOADING, points(flight, ("trim", "cg")))
    assert float(found.estimates["estimate"].sel(term="Ch_e: delta_e")) == pytest.approx(
        product, abs=0.001
    )
    seen = found.determined()
    assert seen["Ch_e: delta_e"]
    assert not seen["offset"]
    assert not seen["Ch_e: alpha"]
    assert found.estimates.attrs["rms"] < 5.0
    assert (
        13.0 < found.estimates.attrs["friction_limit"] < 19.0
    )  # an upper bound: friction itself is not determined


@pytest.mark.parametrize("flight", ["20180312_1", "20190305_2", "20200310_2"])
def test_without_the_displaced_cg_nothing_is_determined(flight):
    found = trim_forces(LOADING, points(flight, ("trim",)))
    assert not any(found.determined().values())


def test_results_stand_a_perturbation_of_the_last_digits():
    data = points("20180312_1", ("trim", "cg"))
    rng = np.random.default_rng(1)
    moved = data * (
        1.0
        + 1e-12
        * xr.Dataset(
            {name: ("point", rng.normal(size=data.sizes["point"])) for name in data.data_vars}
        )
    )
    one, other = (trim_forces(LOADING, x).estimates for x in (data, moved))
    assert float((np.abs(one["estimate"] - other["estimate"]) / one["stderr"]).max()) < 1e-6
