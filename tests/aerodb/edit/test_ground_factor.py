import numpy as np
import pytest

import aerodb
from flightmech import terms
from flightmech.errors import SchemaError

H, ALPHA = [1.0, 3.0, 20.0], [0.0, 0.1, 0.2, 0.3]


def test_a_product_is_found_again():
    K, increment = np.array([1.0, 0.4, 0.0]), np.array([0.1, 0.15, 0.2, 0.22])
    leaf = terms.make_term(
        np.outer(K, increment),
        {"h_agl": H, "alpha": ALPHA},
        ["delta_e"],
        stderr=0.02,
        source="datcom",
        history="built",
    )
    split, worst = aerodb.transform.factor_table(leaf, "h_agl")
    assert worst == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(split["K1"], K, atol=1e-14)
    np.testing.assert_allclose(split["value"], increment, atol=1e-14)
    assert terms.check_term(split) == []
    assert terms.list_regressors(split) == ("delta_e",)
    np.testing.assert_allclose(split["stderr"], 0.02)
    assert split.attrs["history"].splitlines() == [
        "built",
        f"factored: K1 over h_agl, largest difference {worst:.4g}",
    ]
    given = {"h_agl": 2.2, "alpha": 0.17, "delta_e": 0.1}
    assert terms.evaluate_term(split, given) == pytest.approx(terms.evaluate_term(leaf, given))


def test_what_is_no_product_states_how_far_it_is_off():
    value = np.array([[1.0, 1.2, 1.4, 1.6], [0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 0.0, 0.0]])
    leaf = terms.make_term(value.T, {"alpha": ALPHA, "h_agl": H}, stderr=0.1)
    split, worst = aerodb.transform.factor_table(leaf, "h_agl")
    product = np.outer(split["value"], split["K1"])
    assert worst == pytest.approx(np.abs(product - value.T).max())
    assert worst > 0.05
    np.testing.assert_allclose(split["stderr"], np.hypot(0.1, worst))


@pytest.mark.nightly
def test_the_ground_effect_of_the_t37_is_nearly_a_product(t37_db):
    """LR-743 (11) writes K_GE(h) times an increment; of the computed lift increments, up to 0.404,
    the product is off by at most 0.0285.
    """
    split, worst = aerodb.transform.factor_table(aerodb.terms(t37_db)["CL/ground"], "h_agl")
    assert worst == pytest.approx(0.0284, abs=1e-4)
    assert float(split["K1"][0]) == 1.0
    np.testing.assert_allclose(split["K1"][-2:], 0.0, atol=1e-15)


def test_only_a_table_over_the_axis_and_another_can_be_split():
    with pytest.raises(
        SchemaError,
        match="needs a table over h_agl and another axis, without K1; this one goes over alpha",
    ):
        aerodb.transform.factor_table(terms.make_term([1.0, 2.0], {"alpha": [0.0, 0.1]}), "h_agl")
