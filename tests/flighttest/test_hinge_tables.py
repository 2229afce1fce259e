"""Hinge moments as tables over Mach number."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import AeromatchWarning, SchemaError
from flighttest.regression.equation_error import least_squares
from flighttest.remarks import is_forbidden
from flighttest.submodels.control_loading.hinge_terms import make_hinge_terms
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.result import IdentifiedLoading
from flighttest.submodels.control_loading.table_coverage import find_unsupported

NODES = (0.2, 0.35, 0.6)


def loading(model: str, **options) -> ControlLoading:
    constants = ("offset", "friction", "damping", "mass")
    return ControlLoading("column", -1.8, 2.2, 0.33, model, constants, **options)


def test_values_at_the_nodes_have_the_covariance_of_the_estimates():
    table = loading("Ch_e = 1 + delta_e", over=("mach", NODES))
    assert len(table.model.terms) == 6
    names = list(table.names)
    rng = np.random.default_rng(3)
    theta, root = rng.normal(size=len(names)), rng.normal(size=(len(names), len(names)))
    estimates = least_squares.regression_estimates(
        names,
        theta,
        root @ root.T,
        np.full(len(names), np.nan),
        ([], np.zeros((len(names), 0))),
        {},
    )
    leaves = make_hinge_terms(IdentifiedLoading(table, None, None, estimates))
    assert set(leaves) == {"Ch_e/basic", "Ch_e/delta_e"}
    # The model at a condition on each node, with delta_e 0 and 1.
    air = xr.Dataset({"mach": ("time", np.array(NODES)), "delta_e": ("time", np.zeros(3))})
    X0 = table.model.design(air)
    X1 = table.model.design(air.assign(delta_e=("time", np.ones(3)))) - X0
    for name, X in (("Ch_e/basic", X0), ("Ch_e/delta_e", X1)):
        rows = np.hstack([np.zeros((3, 4)), X])
        assert leaves[name]["value"].values == pytest.approx(rows @ theta)
        expected = np.sqrt(np.einsum("ij,jk,ik->i", rows, root @ root.T, rows))
        assert leaves[name]["stderr"].values == pytest.approx(expected)
        assert leaves[name]["mach"].values == pytest.approx(NODES)


TRUE = np.array([-0.20, -0.26, -0.42])


def identify(nodes, machs=(0.2, 0.28, 0.35, 0.45, 0.6)):
    """Force of slow sweeps whose hinge moment has a kink at Mach 0.35."""
    driven, time = [], np.arange(0.0, 20.0, 0.02)
    for mach in machs:
        s = 0.08 * np.sin(2.0 * np.pi * time / 10.0)
        rate = np.gradient(s, time)
        delta, qbar = -1.8 * s, 70000.0 * mach**2
        slope = np.interp(mach, NODES, TRUE)
        F = 3.0 + 12.0 * np.sign(rate) + 30.0 * rate + 1.8 * qbar * 2.2 * 0.33 * slope * delta
        channels = {"F_column": F, "column": s, "delta_e": delta, "qbar": qbar, "mach": mach}
        columns = {name: ("time", np.broadcast_to(x, time.shape)) for name, x in channels.items()}
        driven.append(xr.Dataset(columns, {"time": time}))
    table = ControlLoading(
        "column",
        -1.8,
        2.2,
        0.33,
        "Ch_e = delta_e",
        ("offset", "friction", "damping"),
        over=("mach", nodes),
    )
    return identify_control_loading(table, driven, order=2)


def test_a_table_over_mach_is_identified():
    found = identify(NODES)
    assert not is_forbidden(found.remarks)
    leaf = make_hinge_terms(found)["Ch_e/delta_e"]
    assert leaf["value"].values == pytest.approx(TRUE, rel=2e-3)
    assert (leaf["stderr"].values < 2e-3).all()


def test_samples_beyond_the_nodes_are_an_error():
    """The fit continues its line up to Mach 0.6, the database holds the value at 0.3."""
    found = identify((0.2, 0.3))
    (remark,) = [one for one in found.remarks if one.kind == "range"]
    assert remark.severity == "error"
    assert remark.text.startswith("60% of the samples lie beyond the nodes 0.2 to 0.3")
    with pytest.warns(AeromatchWarning, match="beyond the nodes"):
        make_hinge_terms(found)


def test_a_node_without_samples_has_an_error_of_its_size():
    """Nobody has flown at Mach 0.9: a small standard error there would be that of a straight
    line.
    """
    found = identify((0.2, 0.35, 0.9))
    (remark,) = [one for one in found.remarks if one.kind == "range"]
    assert remark.text.startswith("no samples near the node mach 0.9: the samples have mach 0.2 to")
    with pytest.warns(AeromatchWarning, match="no samples near the node mach 0.9"):
        leaf = make_hinge_terms(found)["Ch_e/delta_e"]
    assert leaf["stderr"].values[-1] >= abs(leaf["value"].values[-1])
    assert (leaf["stderr"].values[:-1] < 2e-3).all()


def test_nodes_are_reached_by_samples_near_them():
    speeds = np.array([0.2, 0.4, 0.6])
    assert not find_unsupported((0.2, 0.35, 0.6), speeds).any()
    assert not find_unsupported((0.18, 0.4, 0.63), speeds).any()
    assert list(find_unsupported((0.1, 0.4, 0.8), speeds)) == [True, False, True]
    # between two speeds: a gap without samples
    gap = np.array([0.2, 0.3, 0.8, 0.9])
    assert list(find_unsupported((0.2, 0.5, 0.6, 0.9), gap)) == [False, True, True, False]
    assert find_unsupported((0.2, 0.3), np.array([np.nan])).all()


def test_nodes_and_variables_are_checked():
    with pytest.raises(SchemaError, match="two or more, rising"):
        loading("Ch_e = 1 + delta_e", over=("mach", (0.5, 0.2)))
    with pytest.raises(SchemaError, match="is in a term"):
        loading("Ch_e = 1 + mach*delta_e", over=("mach", NODES))
