"""A printed term that is void: Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling, Table
2, pitching moment.

The cubic in the pitch rate, -0.132 +- 0.000 with qhat as printed, changes Cm by less than 1e-5.
Eight records of the nominal glide are simulated with the printed values, joined as the paper does
(median, scaled median absolute deviation), and the deletion rule must find that term and keep those
that carry the moment.
"""

import numpy as np
import pytest
import xarray as xr

from flighttest.regression.combining.joined_fits import join_fits
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.deletion_rule import apply_deletion_rule

PRINTED = {
    "1": 0.012,
    "alpha": -0.584,
    "qhat": -9.137,
    "delta_e": -0.764,
    "alpha**2": -1.636,
    "alpha**3": -3.116,
    "qhat**3": -0.132,
}
MODEL = RegressionModel("Cm", list(PRINTED))


def glide(seed):
    """Thirty seconds of multisines at 50 Hz: alpha 3 +- 4 deg, elevator +- 5 deg, pitch rate +- 40
    deg/s at 50 ft/s and 1.049 ft.
    """
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(1500)

    def multisine(size):
        k = np.arange(3, 45)
        return (
            size
            * np.cos(2 * np.pi * np.outer(t, k) / 30 + rng.uniform(0, 2 * np.pi, len(k))).sum(
                axis=1
            )
            / np.sqrt(len(k))
        )

    columns = {
        "alpha": 0.05 + multisine(0.05),
        "qhat": multisine(0.005),
        "delta_e": -0.03 + multisine(0.06),
    }
    data = xr.Dataset({name: ("time", x) for name, x in columns.items()}, coords={"time": t})
    return data.assign(
        Cm=(
            "time",
            MODEL.design(data) @ np.array(list(PRINTED.values())) + 0.004 * rng.normal(size=1500),
        )
    )


@pytest.fixture(scope="module")
def runs():
    return [regress(MODEL, glide(seed), f"run {seed}") for seed in range(8)]


@pytest.mark.slow
def test_the_cubic_in_the_pitch_rate_contributes_nothing(runs):
    rate = runs[0].data["qhat"].values
    assert np.abs(PRINTED["qhat**3"] * rate**3).max() < 1e-5
    verdict = apply_deletion_rule(runs)
    assert verdict.loc["qhat**3", "decision"] != "identified"
    for term in ("alpha", "qhat", "delta_e", "alpha**2"):
        assert verdict.loc[term, "decision"] == "identified", term


def test_the_median_gives_the_printed_values_back(runs):
    joined = join_fits(runs, "median").estimates
    for term in ("alpha", "qhat", "delta_e", "alpha**2"):
        row = joined.sel(term=term)
        # median and scatter of eight: the standard error itself is uncertain by 40 %
        assert float(row["estimate"]) == pytest.approx(PRINTED[term], abs=4 * float(row["stderr"]))
        assert float(row["scatter"]) < 0.3 * abs(PRINTED[term])
