import numpy as np
import pytest
import xarray as xr

from flighttest.regression.combining.pooling import pool_fits
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.deletion_rule import apply_deletion_rule

MODEL = RegressionModel.parse("Cm = 1 + alpha + qhat + alphadothat + delta_e + delta_t")


def record(seed, noise=1e-3, counterpart=0.01):
    """delta_t moves but does nothing, alphadothat is qhat and a little of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 20, 0.02)

    def wave(size, low=1, high=12):
        k = np.arange(low, high)
        return (
            size
            * np.cos(2 * np.pi * np.outer(t, k) / 20 + rng.uniform(0, 2 * np.pi, len(k))).sum(
                axis=1
            )
            / np.sqrt(len(k))
        )

    d = {"alpha": wave(0.03), "qhat": wave(0.001), "delta_e": wave(0.04), "delta_t": wave(0.02)}
    d["alphadothat"] = 0.8 * d["qhat"] + counterpart * wave(0.001)
    d["Cm"] = (
        0.02
        - 0.7 * d["alpha"]
        - 20 * d["qhat"]
        - 7 * d["alphadothat"]
        - 1.0 * d["delta_e"]
        + noise * rng.normal(size=len(t))
    )
    return xr.Dataset({k: ("time", v) for k, v in d.items()}, coords={"time": t})


@pytest.mark.nightly
def test_each_term_meets_its_fate_and_keeps_its_numbers():
    fits = [regress(MODEL, record(seed), f"record {seed}") for seed in range(6)]
    fate = apply_deletion_rule(
        fits, {"delta_t": (-0.005, 0.01), "alpha": (-0.8, 0.1)}, regress(MODEL, record(99))
    )
    assert (
        fate.loc["alpha", "decision"]
        == fate.loc["delta_e", "decision"]
        == fate.loc["1", "decision"]
        == "identified"
    )
    assert fate.loc["delta_t", "decision"] == "a priori"
    assert set("ade") <= set(fate.loc["delta_t", "reasons"])
    assert fate.loc["delta_t", "contribution"] < 0.01
    assert fate.loc["delta_t", "prior_signal"] < 1
    assert fate.loc["delta_e", "validation_rise"] > 10
    assert fate.loc["alphadothat", "decision"] == "embedded"
    assert fate.loc["alphadothat", "into"] == "qhat"
    assert fate.loc["alphadothat", "vif"] > 10


@pytest.mark.slow
def test_without_a_prior_a_void_term_is_deleted():
    fate = apply_deletion_rule([regress(MODEL, record(seed)) for seed in range(4)])
    assert fate.loc["delta_t", "decision"] == "deleted"


@pytest.mark.slow
def test_a_collinear_term_that_is_determined_all_the_same_stays():
    fits = [regress(MODEL, record(seed, noise=1e-6)) for seed in range(4)]
    fate = apply_deletion_rule(fits)
    assert fate.loc["alphadothat", "vif"] > 10
    assert fate.loc["alphadothat", "decision"] == "identified"


@pytest.mark.slow
def test_fits_are_pooled_term_by_term():
    fits = [regress(MODEL, record(seed)) for seed in range(5)]
    pooled = pool_fits(fits)
    assert list(pooled.index) == list(MODEL.terms)
    assert abs(pooled.loc["alpha", "value"] + 0.7) < 3 * pooled.loc["alpha", "stderr"]
    assert (pooled["count"] == 5).all()
