"""Two databases joined by their standard errors, against the formulas by hand."""

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.update.correlation import prior_covariance
from flightmech import terms
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName

MACH = [0.2, 0.4]


@pytest.fixture
def flown(root):
    """Return new knowledge of two terms of the small database, on breakpoints of its own."""
    leaves = {
        "CL/qhat": terms.make_term(
            [9.0, 9.0], {"mach": [0.3, 0.5]}, ["qhat"], stderr=[1.0, 1.5], source="flight"
        ),
        "CL/flap": terms.make_term(
            [0.0, 0.25], {"delta_f": np.radians([0, 20])}, stderr=[0.0, 0.03], source="flight"
        ),
    }
    return aerodb.make_database(leaves, **{**root, "title": "flown"})


def test_node_by_node(small, flown):
    new = aerodb.edit.blend(small, flown, note="runs 1 to 4")
    qhat = aerodb.terms(new)["CL/qhat"]
    np.testing.assert_allclose(qhat["mach"], [0.2, 0.3, 0.4, 0.5])
    # 0.2: the prior alone; 0.3: 8.2 +- 2.05 with 9 +- 1; 0.4: 8.4 +- 2.1 with 9 +- 1.25; 0.5: the
    # new one alone
    joined = [
        (8.2 / 2.05**2 + 9.0) / (2.05**-2 + 1),
        (8.4 / 2.1**2 + 9 / 1.25**2) / (2.1**-2 + 1.25**-2),
    ]
    np.testing.assert_allclose(qhat["value"], [8.0, *joined, 9.0])
    np.testing.assert_allclose(
        qhat["stderr"], [2.0, (2.05**-2 + 1) ** -0.5, (2.1**-2 + 1.25**-2) ** -0.5, 1.5]
    )
    np.testing.assert_array_equal(qhat["source"], [0, 1, 1, 1])
    flap = aerodb.terms(new)["CL/flap"]
    np.testing.assert_allclose(
        flap["value"], [0.0, (0.2 / 0.04**2 + 0.25 / 0.03**2) / (0.04**-2 + 0.03**-2), 0.36]
    )
    np.testing.assert_array_equal(flap["source"], [0, 1, 0])
    assert new.attrs["history"].endswith(
        "blend: CL/qhat CL/flap with 'flown', inverse_variance (runs 1 to 4)"
    )
    assert qhat.attrs["history"].startswith("blend: inverse_variance, chi-square 0.1")
    assert list(aerodb.terms(new)) == list(aerodb.terms(small))


@pytest.mark.parametrize("rule", ["inverse_variance", "correlated"])
def test_another_rule_outside_is_stated(small, flown, rule):
    qhat = aerodb.terms(flown)["CL/qhat"].assign_attrs(outside="linear")
    linear = aerodb.replace_terms(flown, {"CL/qhat": qhat})
    with pytest.warns(
        AeromatchWarning, match=r"CL/qhat: the rule outside is 'hold' here, 'linear'"
    ):
        new = aerodb.terms(aerodb.edit.blend(small, linear, "CL/qhat", rule))["CL/qhat"]
    assert new.attrs.get("outside", "hold") == "hold"
    assert "the blend has 'hold'" in new.attrs["history"]


def test_a_standard_error_of_zero_means_exact(small, flown):
    exact = aerodb.terms(flown)["CL/qhat"]
    exact = aerodb.replace_terms(flown, {"CL/qhat": exact.assign(stderr=exact["stderr"] * 0.0)})
    qhat = aerodb.terms(aerodb.edit.blend(small, exact, "CL/qhat"))["CL/qhat"]
    np.testing.assert_array_equal(qhat["value"], [8.0, 9.0, 9.0, 9.0])
    np.testing.assert_array_equal(qhat["stderr"], [2.0, 0.0, 0.0, 0.0])
    turned = aerodb.terms(aerodb.edit.blend(exact, small, "CL/qhat"))["CL/qhat"]
    np.testing.assert_array_equal(turned["value"], qhat["value"])
    flap = aerodb.terms(flown)["CL/flap"]
    off = aerodb.replace_terms(flown, {"CL/flap": flap.assign(value=flap["value"] + 0.01)})
    with pytest.raises(
        SchemaError,
        match=r"CL/flap: both are exact \(standard error 0\) and differ at delta_f 0 deg and 0 "
        r"more nodes",
    ):
        aerodb.edit.blend(small, off)


def test_consistency_by_hand(small, flown):
    frame = aerodb.edit.consistency(small, flown)
    row = frame.loc["CL/qhat"]  # node 0.3 of the new table lies within the old one
    expected = 0.8 / np.hypot(2.05, 1.0)
    assert (row.nodes, row.location) == (1, "mach 0.3")
    assert row.worst == pytest.approx(expected)
    assert row.chi2 == pytest.approx(expected**2)
    row = frame.loc["CL/flap"]  # the node at zero deflection is exact in both
    assert row.nodes == 1
    assert row.chi2 == pytest.approx((0.05 / 0.05) ** 2)
    assert row.probability == pytest.approx(0.31731, abs=1e-5)  # one standard error, both sides
    assert row.location == "delta_f 20 deg"


def test_a_warning_where_they_disagree(small, flown):
    flap = aerodb.terms(flown)["CL/flap"]
    far = aerodb.replace_terms(flown, {"CL/flap": flap.assign(value=flap["value"] * 2.0)})
    with pytest.warns(
        AeromatchWarning, match=r"CL/flap \(chi-square 36 of 1 nodes, 6 at delta_f 20 deg\)$"
    ):
        new = aerodb.edit.blend(small, far)
    assert aerodb.check(new) == []


def test_all_nodes_of_a_table_together(small):
    """Rule correlated: information at one node reaches its neighbours through the covariance of the
    prior.
    """
    alpha = np.radians([0.0, 8.0])
    other = terms.make_term(
        0.25 + np.outer([5.0, 5.4], alpha),
        {"mach": MACH, "alpha": alpha},
        stderr=0.02,
        source="flight",
    )
    other = aerodb.make_database({"CL/basic": other}, **small.attrs)
    new = aerodb.terms(aerodb.edit.blend(small, other, rule="correlated"))["CL/basic"]
    old = aerodb.terms(small)["CL/basic"]
    P = prior_covariance(old)
    H = np.zeros((4, 8))
    H[range(4), [1, 2, 5, 6]] = 1.0
    information = (
        np.linalg.inv(P) + H.T @ H / 0.02**2
    )  # information form; P of eight nodes can still be inverted
    step = np.linalg.solve(information, H.T @ np.full(4, 0.05) / 0.02**2)
    np.testing.assert_allclose((new["value"] - old["value"]).values.ravel(), step, atol=1e-9)
    np.testing.assert_allclose(
        new["stderr"].values.ravel(), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6
    )
    assert (new["value"] > old["value"]).all()
    row = aerodb.edit.consistency(small, other, rule="correlated").loc["CL/basic"]
    r = np.full(4, 0.05)
    assert row.chi2 == pytest.approx(r @ np.linalg.solve(H @ P @ H.T + 0.02**2 * np.eye(4), r))
    assert aerodb.edit.consistency(small, other).loc["CL/basic"].chi2 == pytest.approx(
        4 * 0.05**2 / (0.05**2 + 0.02**2)
    )


def test_a_number_is_one_observation_of_the_mean_of_a_table(small):
    one = aerodb.make_database(
        {"CL/qhat": terms.make_term(9.0, regressors=["qhat"], stderr=1.0, source="flight")},
        **small.attrs,
    )
    new = aerodb.terms(aerodb.edit.blend(small, one, rule="correlated"))["CL/qhat"]
    P, H = prior_covariance(aerodb.terms(small)["CL/qhat"]), np.full((1, 2), 0.5)
    information = np.linalg.inv(P) + H.T @ H / 1.0**2
    np.testing.assert_allclose(
        new["value"] - [8.0, 8.4], np.linalg.solve(information, H[0] * (9.0 - 8.2)), rtol=1e-9
    )
    np.testing.assert_allclose(
        new["stderr"], np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-9
    )
    row = aerodb.edit.consistency(small, one).loc["CL/qhat"]
    assert (row.nodes, row.location) == (1, "its only node")
    assert row.worst == pytest.approx(0.8 / np.hypot(2.05, 1.0))


@pytest.mark.parametrize("rule", ["inverse_variance", "correlated"])
def test_tables_that_do_not_meet_stand_side_by_side(small, rule):
    far = terms.make_term([9.0, 9.5], {"mach": [0.6, 0.7]}, ["qhat"], stderr=1.0, source="flight")
    far = aerodb.make_database({"CL/qhat": far}, **small.attrs)
    new = aerodb.terms(aerodb.edit.blend(small, far, rule=rule))["CL/qhat"]
    np.testing.assert_array_equal(new["value"], [8.0, 8.4, 9.0, 9.5])
    np.testing.assert_allclose(new["stderr"], [2.0, 2.1, 1.0, 1.0], rtol=1e-12)
    assert aerodb.edit.consistency(small, far, rule=rule).loc["CL/qhat"].to_list()[:3] == [
        0,
        0.0,
        1.0,
    ]


def test_exact_nodes_stay_with_the_correlated_rule(small, flown):
    flap = aerodb.terms(aerodb.edit.blend(small, flown, "CL/flap", "correlated"))["CL/flap"]
    assert float(flap["value"][0]) == 0.0
    assert float(flap["stderr"][0]) == 0.0
    assert float(flap["value"][2]) > 0.36  # moved with its neighbour


def test_factors_are_brought_together(small, flown):
    K1 = terms.make_term([0.0, 1.0], {"gear": [0.0, 1.0]})["value"]
    ours = aerodb.replace_terms(
        small,
        {
            "CL/gear": terms.make_term(
                [-0.02, -0.03], {"mach": MACH}, K1=K1, stderr=0.01, source="datcom"
            )
        },
    )
    one = terms.make_term(-0.03, K1=K1, stderr=0.01, source="flight")
    new = aerodb.terms(
        aerodb.edit.blend(ours, aerodb.replace_terms(flown, {"CL/gear": one}), "CL/gear")
    )["CL/gear"]
    np.testing.assert_allclose(new["value"], [-0.025, -0.03])
    assert new["K1"].equals(K1.to_dataset(name="K1")["K1"])
    other = terms.make_term([0.0, -0.03], {"gear": [0.0, 1.0]}, stderr=[0.0, 0.01], source="flight")
    new = aerodb.terms(
        aerodb.edit.blend(ours, aerodb.replace_terms(flown, {"CL/gear": other}), "CL/gear")
    )["CL/gear"]
    assert "K1" not in new
    np.testing.assert_allclose(new["value"].sel(gear=1.0), [-0.025, -0.03])


@pytest.mark.parametrize(
    ("names", "rule", "change", "error", "text"),
    [
        (
            "Cm/qhat",
            "inverse_variance",
            {},
            UnknownName,
            "unknown term 'Cm/qhat'; near it: CL/qhat; the other database does not have it",
        ),
        (None, "mean", {}, UnknownName, "unknown rule 'mean'"),
        (
            None,
            "inverse_variance",
            {"x_ref": -3.1},
            SchemaError,
            r"x_ref is -3\.0 here and -3\.1 there",
        ),
        (
            None,
            "inverse_variance",
            {"force_axes": "wind"},
            SchemaError,
            "force_axes is 'stability' here and 'wind' there",
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(small, flown, names, rule, change, error, text):
    with pytest.raises(error, match=text):
        aerodb.edit.blend(
            small,
            aerodb.make_database(aerodb.terms(flown), **{**flown.attrs, **change}),
            names,
            rule,
        )


def test_all_faults_at_once(small, flown):
    leaves = aerodb.terms(flown)
    bad = {
        "CL/qhat": leaves["CL/qhat"].drop_vars("stderr"),
        "CL/flap": leaves["CL/flap"].assign_attrs(regressors="alpha"),
    }
    with pytest.raises(SchemaError) as caught:
        aerodb.edit.blend(small, aerodb.replace_terms(flown, bad))
    assert caught.value.problems == [
        "CL/qhat: no stderr there; give one to every node",
        "CL/flap: regressors none here and alpha there; only tables of the same meaning can "
        "be joined",
    ]
    with pytest.raises(SchemaError, match="no term in common"):
        aerodb.edit.blend(
            small,
            aerodb.make_database({"CD/gear": terms.make_term(0.1, stderr=0.1)}, **small.attrs),
        )


def test_neither_tree_changes(small, flown):
    copies = small.copy(deep=True), flown.copy(deep=True)
    aerodb.edit.blend(small, flown)
    xr.testing.assert_identical(small, copies[0])
    xr.testing.assert_identical(flown, copies[1])


def test_the_same_numbers_twice_are_one_source(small, flown):
    with pytest.raises(SchemaError, match="the same numbers twice are one source") as caught:
        aerodb.edit.blend(flown, flown.copy(deep=True))
    assert caught.value.problems[0].startswith("CL/qhat, CL/flap: both databases")
    # one repeated term among others is named, and the others can be blended
    leaves = {"CL/flap": aerodb.terms(small)["CL/flap"]}
    other = aerodb.replace_terms(flown, leaves)
    with pytest.raises(SchemaError, match=r"^blend: 1 problem\n  - CL/flap: both"):
        aerodb.edit.blend(small, other)
    aerodb.edit.blend(small, other, "CL/qhat")
