import numpy as np
import pytest

import aerodb
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.terms import make_term


def test_contributions_by_hand(small):
    given = {
        "mach": 0.3,
        "alpha": np.radians([0.0, 4.0]),
        "qhat": 0.01,
        "delta_f": np.radians(30.0),
    }
    parts = aerodb.contributions(small, "CL", given)
    np.testing.assert_allclose(parts["basic"], 0.2 + 5.2 * np.radians([0.0, 4.0]), rtol=1e-14)
    np.testing.assert_allclose(parts["qhat"], 8.2 * 0.01, rtol=1e-14)
    np.testing.assert_allclose(parts["flap"], 0.28, rtol=1e-14)
    np.testing.assert_allclose(
        aerodb.evaluate(small, "CL", **given), sum(parts.values()), rtol=1e-14
    )


def test_a_coefficient_without_terms_is_zero(small):
    assert float(aerodb.evaluate(small, "CD")) == 0.0


def test_beyond_a_table_the_term_is_named(small):
    with pytest.raises(
        OutOfRange, match=r"CL/flap: delta_f = 0.8 lies outside 0 ... 0.698132 in 1 of 2 samples"
    ) as caught:
        aerodb.evaluate(small, "CL", mach=0.3, alpha=0.0, qhat=0.0, delta_f=np.array([0.1, 0.8]))
    np.testing.assert_array_equal(caught.value.mask, [False, True])
    held = aerodb.evaluate(small, "CL", outside="clamp", mach=0.3, alpha=0.0, qhat=0.0, delta_f=0.8)
    np.testing.assert_allclose(held, 0.56, rtol=1e-14)


def test_missing_conditions_and_unknown_coefficients_are_named(small):
    with pytest.raises(UnknownName, match=r"unknown condition 'qhat'.*the term CL/qhat needs it"):
        aerodb.evaluate(small, "CL", mach=0.3, alpha=0.0, delta_f=0.0)
    with pytest.raises(UnknownName, match="unknown coefficient 'CX'"):
        aerodb.evaluate(small, "CX")


def polar(root, force_axes="stability"):
    """Drag as a table over lift and a square of it, and a moment that depends on the drag."""
    axial, normal = ("CX", "CZ") if force_axes == "body" else ("CD", "CL")
    return aerodb.store.make_database(
        {
            f"{normal}/basic": make_term([0.1, 0.9], {"alpha": [0.0, 0.2]}),
            f"{axial}/polar": make_term([0.02, 0.05], {normal: [0.0, 1.0]}),
            f"{axial}/induced": make_term(0.1, regressors=[normal, normal]),
            "Cm/drag": make_term(2.0, regressors=["CD"]),
        },
        **root | {"force_axes": force_axes},
    )


def test_a_drag_polar_follows_the_lift(root):
    """CL = 0.5: CD = 0.035 + 0.1 CL^2 = 0.06, Cm = 2 CD; a lift that is given counts instead."""
    db = polar(root)
    assert float(aerodb.evaluate(db, "CD", alpha=0.1)) == pytest.approx(0.06, rel=1e-14)
    assert float(aerodb.evaluate(db, "Cm", alpha=0.1)) == pytest.approx(0.12, rel=1e-14)
    assert float(aerodb.evaluate(db, "Cm", CL=1.0)) == pytest.approx(0.3, rel=1e-14)
    assert aerodb.contributions(db, "CD", {"alpha": 0.1})["induced"] == pytest.approx(
        0.025, rel=1e-14
    )


def test_drag_of_a_database_in_body_axes(root):
    """CZ = 0.5, CX = 0.06 at 0.1 rad: CD = -CX cos - CZ sin."""
    db = polar(root, "body")
    expected = -0.06 * np.cos(0.1) - 0.5 * np.sin(0.1)
    assert float(aerodb.evaluate(db, "Cm", alpha=0.1)) == pytest.approx(2.0 * expected, rel=1e-14)


def test_a_loop_among_coefficients_is_refused_with_its_path(root):
    leaves = {
        "CL/flow": make_term(0.1, regressors=["Cm"]),
        "CD/polar": make_term(0.1, regressors=["CL", "CL"]),
        "Cm/drag": make_term(1.0, regressors=["CD"]),
    }
    with pytest.raises(
        SchemaError,
        match=r"CL -> CD -> Cm -> CL \(terms CD/polar, Cm/drag, CL/flow\): a coefficient cannot "
        r"depend on itself",
    ):
        aerodb.store.make_database(leaves, **root)


def test_a_polar_keeps_through_a_file_and_its_check_cases(root, tmp_path):
    db = aerodb.store.with_checks(polar(root), 5)
    aerodb.save(db, tmp_path / "polar.nc")
    back = aerodb.open(tmp_path / "polar.nc")
    assert not aerodb.check(back)
    assert back.identical(db)
