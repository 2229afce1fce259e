"""Thrust over fuel flow: coefficients put in, standard errors, points outside; the JT15D of the
Citation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError
from flighttest.submodels.engine.steady_points import fit_fuel_thrust

POINTS = (
    Path(__file__).parents[3]
    / ".."
    / "shared"
    / "data"
    / "flight"
    / "citation_phlab"
    / "jt15d4_thrust_points.csv"
)
TRUTH = np.array([-1000.0, 60000.0, -3000.0, -30000.0, 4000.0])


def points(count: int, noise: float, seed: int = 0) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    mach, h, w = (
        0.15 + 0.4 * rng.random(count),
        8000.0 * rng.random(count),
        0.05 + 0.08 * rng.random(count),
    )
    air = atmosphere(h)
    theta, delta = (
        np.asarray(air.temperature) / 288.15 * (1.0 + 0.2 * mach**2),
        np.asarray(air.p_static) / 101325.0,
    )
    X = np.column_stack([np.ones(count), w, mach, w * mach, mach**2])
    columns = {
        "fuel_flow": w * delta * np.sqrt(theta),
        "mach": mach,
        "h": h,
        "thrust": delta * (X @ TRUTH) + noise * rng.normal(size=count),
    }
    return xr.Dataset({name: ("point", x) for name, x in columns.items()})


def test_coefficients_come_back():
    np.testing.assert_allclose(fit_fuel_thrust(points(40, 0.0)).coefficients, TRUTH, rtol=1e-8)
    found = fit_fuel_thrust(points(200, 10.0))
    z = (found.coefficients - TRUTH) / np.sqrt(np.diag(found.covariance))
    assert np.abs(z).max() < 4.0
    assert found.rms == pytest.approx(10.0, rel=0.2)


def test_standard_error_of_a_prediction_covers_the_truth():
    truth = points(50, 0.0, seed=99)
    z = []
    for seed in range(40):
        predicted = fit_fuel_thrust(points(60, 10.0, seed)).predict(truth)
        z.append((predicted["thrust"] - truth["thrust"]) / predicted["stderr"])
    assert np.mean(np.abs(z) < 2.0) == pytest.approx(0.95, abs=0.06)  # 40 programmes


def test_points_outside_are_marked_and_few_points_refused():
    own = points(40, 1.0)
    far = own.isel(point=[0]).assign(mach=("point", [0.9]))
    assert not bool(fit_fuel_thrust(own).predict(far)["inside"][0])
    with pytest.raises(IdentificationError, match="at least 15"):
        fit_fuel_thrust(own.isel(point=slice(10)))
    with pytest.raises(IdentificationError, match="separate"):
        fit_fuel_thrust(own.assign(mach=0.0 * own["mach"] + 0.3))


@pytest.mark.skipif(not POINTS.exists(), reason="shared data not present: citation_phlab")
def test_jt15d_series_that_were_not_fitted_are_predicted():
    import pandas as pd

    table = pd.read_csv(POINTS)
    temperature = (
        np.asarray(atmosphere(table["hp_m"].values).temperature) + table["dT_isa_K"].values
    )
    columns = {
        "fuel_flow": table["fuel_flow_kgps"],
        "mach": table["mach"],
        "h": table["hp_m"],
        "thrust": table["net_thrust_N"],
    }
    data = xr.Dataset({name: ("point", x.values) for name, x in columns.items()}).assign(
        temperature=("point", temperature)
    )
    own = table["series"].isin(["static1", "static1_std"]).values
    found = fit_fuel_thrust(data.isel(point=own))
    error = found.predict(data.isel(point=~own))["thrust"] - data["thrust"].values[~own]
    assert found.rms < 8.0  # 7.5 N
    assert float(np.sqrt((error**2).mean())) < 5.0  # 4.6 N of 1809 N
    assert float(np.abs(error).max()) < 10.0  # 9.0 N
