import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.figures.curve_families import curve_family, difference_surface, supporting_samples
from flightmech import terms
from flightmech.errors import SchemaError, UnknownName
from flightmech.units import DEGREE


@pytest.fixture
def other(small):
    """The small database with other lift: 0.1 less at alpha 16 deg, from flight there, no Mach
    number 0.4.
    """
    leaf = aerodb.terms(small)["CL/basic"].isel(mach=[0])
    leaf["value"] = leaf["value"] - [0.0, 0.0, 0.0, 0.1]
    leaf["source"] = leaf["source"].copy(data=np.array([[0, 0, 0, 1]], np.uint8))
    return aerodb.replace_terms(small, {"CL/basic": leaf})


def test_curves_pass_through_the_nodes(small, other):
    f = curve_family({"a": small, "b": other}, "CL/basic")
    assert (f.over, f.by, f.members, f.held, f.regressors) == ("alpha", "mach", (0.2, 0.4), {}, ())
    curve = f.curves["a"][1]
    np.testing.assert_allclose(np.interp(8 * DEGREE, curve.x, curve.y), 0.2 + 5.4 * 8 * DEGREE)
    np.testing.assert_allclose(np.interp(8 * DEGREE, curve.x, curve.stderr), 0.05)
    np.testing.assert_array_equal(curve.node_x, np.radians([-8.0, 0.0, 8.0, 16.0]))
    np.testing.assert_array_equal(f.curves["b"][0].node_source, [0, 0, 0, 1])
    assert f.curves["b"][1] is None  # its table ends at Mach 0.2


def test_members_that_repeat_are_left_out(small):
    flat = aerodb.replace_terms(
        small,
        {
            "CL/basic": terms.make_term(
                [[0.1, 0.3]] * 3, {"mach": [0.2, 0.3, 0.4], "alpha": [0.0, 0.2]}
            )
        },
    )
    assert curve_family({"a": flat}, "CL/basic").members == (0.2,)


def test_other_variables_are_held_where_the_term_is_largest(small):
    value = np.zeros((3, 2, 3))
    value[1:, :, :] = 0.02
    value[2, :, :] = 0.05
    axes = {"delta_f": np.radians([0.0, 20.0, 40.0]), "alpha": [0.0, 0.1], "mach": [0.1, 0.2, 0.3]}
    db = aerodb.replace_terms(small, {"CD/flap": terms.make_term(value, axes)})
    f = curve_family({"a": db}, "CD/flap", by="mach")
    assert f.held == {"delta_f": pytest.approx(40 * DEGREE)}
    assert curve_family({"a": db}, "CD/flap").held == {"mach": 0.2}  # the middle one
    assert curve_family({"a": db}, "CD/flap", at={"mach": 0.25}).held == {"mach": 0.25}


def test_a_coefficient_is_the_sum_of_its_terms_at_rest(small):
    f = curve_family({"a": small}, "CL", at={"delta_f": 20 * DEGREE})
    assert (f.over, f.by, f.held) == ("alpha", "mach", {"delta_f": 20 * DEGREE, "qhat": 0.0})
    curve = f.curves["a"][0]
    np.testing.assert_allclose(np.interp(0.0, curve.x, curve.y), 0.2 + 0.2)
    np.testing.assert_allclose(np.interp(0.0, curve.x, curve.stderr), np.hypot(0.05, 0.04))
    assert len(curve.node_x) == 0
    by_flap = curve_family({"a": small}, "CL", by="delta_f", at={"mach": 0.4})
    np.testing.assert_allclose(by_flap.members, np.radians([0.0, 20.0, 40.0]))


def test_factor_tables_are_axes_too(small):
    factor = xr.DataArray([1.0, 0.0], {"h_agl": [1.0, 20.0]}, "h_agl")
    db = aerodb.replace_terms(
        small, {"CL/ground": terms.make_term([0.1, 0.2], {"alpha": [0.0, 0.1]}, K1=factor)}
    )
    f = curve_family({"a": db}, "CL/ground")
    assert (f.by, f.members) == ("h_agl", (1.0, 20.0))
    np.testing.assert_allclose(f.curves["a"][0].y[[0, -1]], [0.1, 0.2])
    np.testing.assert_array_equal(f.curves["a"][1].y, 0.0)


def test_flight_samples_belong_to_the_nearest_member(small):
    f = curve_family({"a": small}, "CL/basic")
    flown = {"alpha": np.array([0.01, 0.02, np.nan]), "mach": np.array([0.22, 0.38, 0.2])}
    np.testing.assert_array_equal(supporting_samples(flown, f, 0), [0.01])
    np.testing.assert_array_equal(supporting_samples(flown, f, 1), [0.02])
    assert len(supporting_samples(None, f, 0)) == 0
    whole = curve_family({"a": small}, "CL")
    assert (
        len(supporting_samples({**flown, "delta_f": 35 * DEGREE}, whole, 0)) == 0
    )  # flown with flaps, drawn without


def test_surface_is_last_less_first(small, other):
    s = difference_surface({"a": small, "b": other}, "CL/basic")
    at_16 = s.difference[:, -1]
    assert at_16[0] == pytest.approx(-0.1)
    assert np.isnan(at_16[-1])  # b has no Mach 0.4
    assert s.stderr[0, 0] == pytest.approx(0.05)


def test_what_cannot_be_drawn_is_stated(small, other):
    both = {"a": small, "b": other}
    with pytest.raises(UnknownName, match="unknown term 'CL/flop'; near it: CL/flap"):
        curve_family(both, "CL/flop")
    with pytest.raises(UnknownName, match="unknown coefficient 'CN'"):
        curve_family(both, "CN")
    with pytest.raises(
        UnknownName,
        match="unknown axis 'delta_f'; allowed: mach; CL/basic has curves by these, over alpha",
    ):
        curve_family(both, "CL/basic", by="delta_f")
    with pytest.raises(UnknownName, match="unknown axis 'beta'"):
        curve_family(both, "CL/basic", over="beta")
    with pytest.raises(
        UnknownName,
        match="unknown variable 'mach'; allowed: none; CL/basic is held at values of these",
    ):
        curve_family(both, "CL/basic", at={"mach": 0.3})
    with pytest.raises(
        SchemaError, match="Cm/qhat: 1 problem\n  - has no axis and therefore no curve"
    ):
        curve_family(both, "Cm/qhat")
    swapped = aerodb.replace_terms(
        small, {"CL/qhat": terms.make_term([1.0, 2.0], {"mach": [0.2, 0.4]}, ["alphadothat"])}
    )
    with pytest.raises(
        SchemaError,
        match="regressors differ: a has qhat, b has alphadothat; compare the coefficient CL "
        "instead",
    ):
        curve_family({"a": small, "b": swapped}, "CL/qhat")
    with pytest.raises(SchemaError, match="has the one axis mach; a map needs two"):
        difference_surface(both, "CL/qhat")
    with pytest.raises(SchemaError, match="is in a only; a difference needs two"):
        difference_surface({"a": small}, "CL/basic")
