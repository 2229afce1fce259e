"""The term: construction, faults, evaluation against SciPy, linearity in the nodes."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.terms import SOURCES, basis, check, evaluate, make, regressors, variables

ALPHA, MACH = np.array([-0.1, 0.0, 0.2, 0.3]), np.array([0.2, 0.5, 0.8])


@pytest.fixture
def table() -> xr.Dataset:
    value = np.random.default_rng(1).normal(size=(4, 3))
    return make(value, {"alpha": ALPHA, "mach": MACH}, ["qhat"], stderr=0.1, source="datcom", comment="test")


def test_a_leaf_carries_its_meaning(table):
    assert regressors(table) == ("qhat",)
    assert variables(table) == {"alpha", "mach", "qhat"}
    assert table["stderr"].shape == (4, 3)
    assert SOURCES[int(table["source"][0, 0])] == "datcom"
    assert table["alpha"].attrs["units"] == "rad"
    assert check(table) == []


def test_all_faults_are_told_at_once():
    with pytest.raises(SchemaError) as caught:
        make([1.0, np.nan], {"alpha": [0.2, 0.1]}, ["alpha", "q", "nonsense"], outside="bounce", stderr=-1.0)
    text = str(caught.value)
    for part in (
        "axis alpha does not rise: 0.2 is followed by 0.1",
        "1 NaN or infinite nodes of 2",
        "at most 2 are allowed",
        "'nonsense'",
        "'bounce'",
        "negative",
    ):
        assert part in text


def test_value_agrees_with_scipy(table):
    rng = np.random.default_rng(2)
    alpha, mach, qhat = rng.uniform(-0.1, 0.3, 200), rng.uniform(0.2, 0.8, 200), rng.normal(size=200)
    expected = RegularGridInterpolator((ALPHA, MACH), table["value"].values)(np.stack([alpha, mach], 1)) * qhat
    np.testing.assert_allclose(evaluate(table, {"alpha": alpha, "mach": mach, "qhat": qhat}), expected, rtol=1e-13, atol=1e-14)


def test_conditions_broadcast(table):
    found = evaluate(table, {"alpha": np.zeros((5, 1)), "mach": MACH, "qhat": 2.0})
    assert found.shape == (5, 3)
    np.testing.assert_allclose(found[3], 2.0 * table["value"].values[1], rtol=1e-15)


def test_contribution_is_linear_in_the_nodes(table):
    conditions = {"alpha": np.linspace(-0.1, 0.3, 30), "mach": np.linspace(0.8, 0.2, 30), "qhat": np.linspace(-1.0, 1.0, 30)}
    B = basis(table, conditions)
    assert B.shape == (30, 12)
    np.testing.assert_allclose(B @ table["value"].values.ravel(), evaluate(table, conditions), rtol=1e-14)


def test_factor_tables_multiply():
    gear = xr.DataArray([0.0, 3.0], coords={"gear": [0.0, 1.0]}, dims="gear")
    leaf = make(2.0, regressors=["alpha", "alpha"], K1=gear)
    assert evaluate(leaf, {"alpha": 0.5, "gear": 0.5}) == pytest.approx(2.0 * 0.25 * 1.5)


def test_outside_raises_or_follows_the_rule(table):
    beyond = {"alpha": [0.0, 0.4], "mach": 0.5, "qhat": 1.0}
    with pytest.raises(OutOfRange, match=r"alpha = 0.4 lies outside -0.1 ... 0.3 in 1 of 2 samples, first at sample 1") as caught:
        evaluate(table, beyond)
    assert caught.value.mask.tolist() == [False, True]
    end = float(table["value"].sel(alpha=0.3, mach=0.5))
    assert evaluate(table, beyond, outside="clamp")[1] == pytest.approx(end, rel=1e-14)
    slope = (end - float(table["value"].sel(alpha=0.2, mach=0.5))) / 0.1
    going_on = evaluate(table.assign_attrs(outside="linear"), beyond, outside="clamp")[1]
    assert going_on == pytest.approx(end + 0.1 * slope, rel=1e-12)


def test_missing_condition_is_named(table):
    with pytest.raises(UnknownName, match=r"unknown condition 'qhat'.*the term needs it"):
        evaluate(table, {"alpha": 0.0, "mach": 0.5})
