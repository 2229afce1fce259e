import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.update.correlation import prior_covariance
from aerodb.update.standard_errors import standard_errors
from flightmech import terms
from flightmech.errors import UnknownName


def test_a_node_has_its_own_standard_error():
    leaf = terms.make_term(
        [1.0, 2.0, 2.5], {"alpha": np.radians([0.0, 8.0, 12.0])}, stderr=[0.1, 0.2, 0.3]
    )
    B = terms.basis(leaf, {"alpha": leaf["alpha"].values})
    np.testing.assert_allclose(standard_errors(B, leaf), [0.1, 0.2, 0.3], rtol=1e-12)


def test_between_nodes_their_correlation_counts():
    """Nodes 8 deg apart with one constant error: correlation 1/2 + 1/2 exp(-(8/5)^2 / 2) = 0.639;
    half way sqrt((1 + 0.639)/2) of it.
    """
    leaf = terms.make_term([1.0, 1.0], {"alpha": np.radians([0.0, 8.0])}, stderr=0.1)
    correlation = 0.5 + 0.5 * np.exp(-0.5 * (8 / 5) ** 2)
    B = terms.basis(leaf, {"alpha": np.radians([4.0])})
    np.testing.assert_allclose(
        standard_errors(B, leaf), 0.1 * np.sqrt(0.5 + 0.5 * correlation), rtol=1e-12
    )


def test_errors_proportional_to_the_value_cancel_where_the_sign_changes():
    """An effectiveness wrong by a factor has no error at zero deflection."""
    leaf = terms.make_term(
        [-0.4, -0.2, 0.2, 0.4],
        {"delta_t": np.radians([-20.0, -10.0, 10.0, 20.0])},
        stderr=[0.04, 0.02, 0.02, 0.04],
    )
    assert np.allclose(
        standard_errors(terms.basis(leaf, {"delta_t": np.array([0.0])}), leaf), 0.0, atol=1e-6
    )


def test_corners_give_what_the_whole_covariance_gives():
    rng = np.random.default_rng(1)
    axes = {
        "mach": [0.2, 0.4],
        "alpha": np.radians([0.0, 3.0, 8.0]),
        "delta_e": np.radians([-10.0, 0.0, 10.0]),
    }
    leaf = terms.make_term(
        rng.normal(size=(2, 3, 3)), axes, ["qhat"], stderr=rng.uniform(0.0, 1.0, (2, 3, 3))
    )
    given = {name: rng.uniform(x[0], x[-1], 40) for name, x in axes.items()} | {
        "qhat": rng.normal(size=40)
    }
    B = terms.basis(leaf, given)
    whole = np.sqrt(np.diag(B.toarray() @ prior_covariance(leaf) @ B.toarray().T))
    np.testing.assert_allclose(standard_errors(B, leaf), whole, rtol=1e-10)


def test_many_samples_go_through_in_parts():
    leaf = terms.make_term([1.0, 2.0], {"alpha": [0.0, 0.1]}, stderr=0.1)
    x = np.linspace(0.0, 0.1, 10_001)
    found = standard_errors(terms.basis(leaf, {"alpha": x}), leaf)
    assert found[0] == pytest.approx(0.1)
    assert found[-1] == pytest.approx(0.1)
    assert (found > 0.08).all()


def test_terms_of_a_coefficient_are_independent(small):
    given = {"mach": 0.2, "alpha": 0.0, "delta_f": np.radians(40.0), "qhat": np.array([0.0, 0.02])}
    found = aerodb.update.standard_error(small, "CL", given)
    np.testing.assert_allclose(
        found, [np.hypot(0.05, 0.07), np.sqrt(0.05**2 + 0.07**2 + (2.0 * 0.02) ** 2)], rtol=1e-12
    )
    assert aerodb.update.standard_error(small, "Cm", {"qhat": 0.01}) == 0.0  # states none
    with pytest.raises(UnknownName, match="unknown coefficient 'CN'"):
        aerodb.update.standard_error(small, "CN", given)


def test_a_table_without_errors_and_factors():
    factor = xr.DataArray([0.0, 1.0], {"gear": [0.0, 1.0]}, "gear")
    leaf = terms.make_term(0.3, stderr=0.1, K1=factor)
    np.testing.assert_allclose(
        standard_errors(terms.basis(leaf, {"gear": np.array([0.0, 0.5, 1.0])}), leaf),
        [0.0, 0.05, 0.1],
    )
