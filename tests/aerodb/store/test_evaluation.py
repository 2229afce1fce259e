import numpy as np
import pytest

import aerodb
from flightmech.errors import OutOfRange, UnknownName


def test_contributions_by_hand(small):
    given = {"mach": 0.3, "alpha": np.radians([0.0, 4.0]), "qhat": 0.01, "delta_f": np.radians(30.0)}
    parts = aerodb.contributions(small, "CL", given)
    np.testing.assert_allclose(parts["basic"], 0.2 + 5.2 * np.radians([0.0, 4.0]), rtol=1e-14)
    np.testing.assert_allclose(parts["qhat"], 8.2 * 0.01, rtol=1e-14)
    np.testing.assert_allclose(parts["flap"], 0.28, rtol=1e-14)
    np.testing.assert_allclose(aerodb.evaluate(small, "CL", **given), sum(parts.values()), rtol=1e-14)


def test_a_coefficient_without_terms_is_zero(small):
    assert float(aerodb.evaluate(small, "CD")) == 0.0


def test_beyond_a_table_the_term_is_named(small):
    with pytest.raises(OutOfRange, match=r"CL/flap: delta_f = 0.8 lies outside 0 ... 0.698132 in 1 of 2 samples") as caught:
        aerodb.evaluate(small, "CL", mach=0.3, alpha=0.0, qhat=0.0, delta_f=np.array([0.1, 0.8]))
    np.testing.assert_array_equal(caught.value.mask, [False, True])
    held = aerodb.evaluate(small, "CL", outside="clamp", mach=0.3, alpha=0.0, qhat=0.0, delta_f=0.8)
    np.testing.assert_allclose(held, 0.56, rtol=1e-14)


def test_missing_conditions_and_unknown_coefficients_are_named(small):
    with pytest.raises(UnknownName, match=r"unknown condition 'qhat'.*the term CL/qhat needs it"):
        aerodb.evaluate(small, "CL", mach=0.3, alpha=0.0, delta_f=0.0)
    with pytest.raises(UnknownName, match="unknown coefficient 'CX'"):
        aerodb.evaluate(small, "CX")
