import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech import terms
from flightmech.errors import AeromatchWarning, OutOfRange, UnknownName


def changed(small, name, **leaf):
    old = aerodb.terms(small)[name]
    axes = {axis: old[axis].values for axis in old["value"].dims}
    arguments = {
        "value": old["value"].values,
        "axes": axes,
        "regressors": terms.list_regressors(old),
        "stderr": old["stderr"].values,
        **leaf,
    }
    return aerodb.replace_terms(small, {name: terms.make_term(**arguments)})


def test_equal_databases_differ_nowhere(small):
    frame = aerodb.compare(small, small)
    assert list(frame.index) == ["CL/basic", "CL/qhat", "CL/flap", "Cm/qhat", "CL", "Cm"]
    assert (frame["found_in"] == "both").all()
    assert (frame["max_difference"] == 0).all()
    assert (frame["location"] == "").all()
    assert np.isnan(frame.loc["Cm/qhat", "max_in_stderr"])  # no standard error there


def test_largest_difference_where_and_in_standard_errors(small):
    frame = aerodb.compare(small, changed(small, "CL/flap", value=[0.0, 0.2, 0.29]))
    row = frame.loc["CL/flap"]
    assert row["max_difference"] == pytest.approx(-0.07)
    assert row["rms_difference"] == pytest.approx(0.07 / np.sqrt(3))
    assert row["max_in_stderr"] == pytest.approx(1.0)
    assert row["location"] == "delta_f 40 deg"


def test_nodes_of_both_are_looked_at(small):
    finer = changed(
        small,
        "CL/flap",
        value=[0.0, 0.15, 0.2, 0.36],
        axes={"delta_f": np.radians([0, 10, 20, 40])},
        stderr=0.01,
    )
    for a, b, sign in ((small, finer, 1.0), (finer, small, -1.0)):
        row = aerodb.compare(a, b).loc["CL/flap"]
        assert row["max_difference"] == pytest.approx(sign * 0.05)
        assert row["location"] == "delta_f 10 deg"


def test_terms_of_one_side_count_against_zero(small):
    more = aerodb.replace_terms(small, {"CL/gear": terms.make_term(-0.02, regressors=["gear"])})
    assert aerodb.compare(small, more).loc["CL/gear", ["found_in", "max_difference"]].tolist() == [
        "b",
        -0.02,
    ]
    assert aerodb.compare(more, small).loc["CL/gear", ["found_in", "max_difference"]].tolist() == [
        "a",
        0.02,
    ]


def test_factor_tables_and_new_axes_are_compared_as_a_whole(small):
    factor = xr.DataArray([0.0, 1.0], {"gear": [0.0, 1.0]}, "gear")
    geared = aerodb.replace_terms(
        small, {"CL/gear": terms.make_term([0.1, 0.2], {"mach": [0.2, 0.4]}, K1=factor)}
    )
    row = aerodb.compare(small, geared).loc["CL/gear"]
    assert row["max_difference"] == pytest.approx(0.2)
    assert row["location"] == "mach 0.4, gear 1"


def test_other_regressors_are_stated_and_not_compared(small):
    other = aerodb.replace_terms(
        small, {"CL/qhat": terms.make_term(1.0, regressors=["alphadothat"])}
    )
    row = aerodb.compare(small, other).loc["CL/qhat"]
    assert np.isnan(row["max_difference"])
    assert row["note"] == "regressors differ: qhat in a, alphadothat in b"


def test_coefficients_along_conditions(small):
    other = changed(small, "CL/qhat", value=[10.0, 10.4])
    given = {"mach": 0.3, "alpha": 0.0, "delta_f": 0.0, "qhat": np.array([0.0, 0.01, -0.02])}
    row = aerodb.compare(small, other, given).loc["CL"]
    assert row["max_difference"] == pytest.approx(-0.04)
    assert row["location"] == "sample 2: mach 0.3, alpha 0 deg, delta_f 0 deg"
    assert row["note"] == "3 samples"


def test_difference_in_the_standard_errors_of_both(small):
    """Nodes 0, 20, 40 deg: differences 0, 0, -0.07; standard errors 0.07 in a, 0.03 in b at the
    last one.
    """
    row = aerodb.compare(
        small, changed(small, "CL/flap", value=[0.0, 0.2, 0.29], stderr=[0.0, 0.04, 0.03])
    ).loc["CL/flap"]
    assert row["max_in_stderr"] == pytest.approx(1.0)
    assert row["max_in_stderr_b"] == pytest.approx(0.07 / 0.03)
    assert row["max_in_stderr_difference"] == pytest.approx(0.07 / np.hypot(0.07, 0.03))
    assert row["rms_in_stderr_difference"] == pytest.approx(
        0.07 / np.hypot(0.07, 0.03) / np.sqrt(2)
    )  # the node without error is left out
    assert (row["value_a"], row["value_b"]) == pytest.approx((0.36, 0.29))


def test_coefficients_over_the_grid_of_both(small):
    """CL of the small database: 2 Mach numbers x 4 alphas, with two more flap settings and two
    pitch rates in turn: 8 (1 + 2 + 2).
    """
    frame = aerodb.compare(small, changed(small, "CL/flap", value=[0.0, 0.2, 0.29]))
    assert frame.attrs["grid"]["CL"] == (
        "mach 0.2 ... 0.4 (2) x alpha -8 ... 16 deg (4) with, in turn, delta_f 0 ... 40 deg "
        "(3), qhat -0.005 ... 0.005 (2)"
    )
    row = frame.loc["CL"]
    assert row["note"] == "40 conditions"
    assert row["location"] == "mach 0.2, alpha -8 deg, delta_f 40 deg"
    assert row["max_difference"] == pytest.approx(-0.07)
    assert row["rms_difference"] == pytest.approx(0.07 * np.sqrt(8 / 40))
    # there CL/basic has 0.05, CL/flap 0.07 and CL/qhat nothing, as the pitch rate is zero
    assert row["max_in_stderr"] == pytest.approx(0.07 / np.hypot(0.05, 0.07))
    assert (
        frame.loc["Cm", "note"]
        == "3 conditions; 1 term of a without standard error; 1 term of b without standard error"
    )


def test_ice_and_separation_count_and_other_variables_are_named(small):
    """Ice of one database has its whole effect; a speed of a spool has no usual range."""
    added = {
        "CL/ice": terms.make_term(-0.3, regressors=["device.ice.setting"]),
        "CL/stall": terms.make_term(0.2, regressors=["X_lift"]),
        "CL/spool": terms.make_term(0.1, regressors=["engine1.n2"]),
    }
    b = aerodb.replace_terms(small, added)
    row = aerodb.compare(small, b).loc["CL"]
    # attached flow with and without ice, the other settings in turn
    assert row["max_difference"] == pytest.approx(0.2)
    assert row["note"].startswith("56 conditions; engine1.n2 taken as 0; ")
    iced = aerodb.replace_terms(small, {"CL/ice": added["CL/ice"]})
    assert aerodb.compare(small, iced).loc["CL", "max_difference"] == pytest.approx(-0.3)


def test_the_grid_lies_where_both_have_tables(small):
    higher = changed(
        small, "CL/basic", axes={"mach": [0.3, 0.6], "alpha": np.radians([-8.0, 0.0, 8.0, 16.0])}
    )
    higher = changed(higher, "CL/qhat", axes={"mach": [0.3, 0.6]})
    assert aerodb.compare(small, higher).attrs["grid"]["CL"].startswith("mach 0.3 ... 0.4 (2) x")
    beyond = changed(
        changed(
            small,
            "CL/basic",
            axes={"mach": [0.5, 0.6], "alpha": np.radians([-8.0, 0.0, 8.0, 16.0])},
        ),
        "CL/qhat",
    )
    beyond = changed(beyond, "CL/qhat", axes={"mach": [0.5, 0.6]})
    row = aerodb.compare(small, beyond).loc["CL"]
    assert np.isnan(row["max_difference"])
    assert row["note"] == "no common range of mach"


def test_shares_of_the_difference_along_a_record(small):
    """Flap -0.07, -0.07 and pitch rate 0, +0.02 make -0.07, -0.05; mean square 0.0037."""
    other = changed(
        changed(small, "CL/flap", value=[0.0, 0.2, 0.29]), "CL/qhat", value=[10.0, 10.4]
    )
    given = xr.Dataset(
        {"qhat": ("time", [0.0, 0.01]), "mach": 0.2, "alpha": 0.0, "delta_f": np.radians(40.0)},
        {"time": [4.0, 4.12]},
    )
    frame = aerodb.compare(small, other, given)
    assert frame.loc["CL/flap", "share"] == pytest.approx(0.0042 / 0.0037)
    assert frame.loc["CL/qhat", "share"] == pytest.approx(-0.0005 / 0.0037)
    assert frame.loc["CL/flap", "rms_left"] == pytest.approx(0.02 / np.sqrt(2))
    assert frame.loc["CL/qhat", "rms_left"] == pytest.approx(0.07)
    assert frame.loc[["CL/basic", "CL/qhat", "CL/flap"], "share"].sum() == pytest.approx(1.0)
    assert frame.loc["CL/qhat", "max_difference"] == pytest.approx(0.02)  # regressor included
    assert frame.loc["CL/qhat", "location"] == "time 4.12 s: mach 0.2, qhat 0.01"
    assert frame.loc["CL", "rms_difference"] == pytest.approx(np.sqrt(0.0037))
    assert np.isnan(frame.loc["Cm/qhat", "share"])  # Cm does not differ at all


def test_terms_with_other_regressors_meet_along_a_record(small):
    other = aerodb.replace_terms(
        small, {"Cm/qhat": terms.make_term(-10.0, regressors=["alphadothat"])}
    )
    given = {"qhat": 0.01, "alphadothat": 0.02, "mach": 0.3, "alpha": 0.0, "delta_f": 0.0}
    assert aerodb.compare(small, other, given).loc["Cm/qhat", "max_difference"] == pytest.approx(
        -0.2 + 0.17
    )


def test_samples_with_nan_are_left_out_and_those_beyond_a_table_counted(small):
    other = changed(small, "CL/flap", value=[0.0, 0.2, 0.29])
    delta_f = np.radians([0.0, np.nan, 50.0])
    frame = aerodb.compare(
        small, other, {"mach": 0.3, "alpha": 0.0, "delta_f": delta_f, "qhat": 0.0}
    )
    assert frame.loc["CL", "note"] == "2 samples, 1 more with NaN left out"
    row = frame.loc["CL/flap"]
    assert (
        row["note"] == "1 of 2 samples beyond the table of a; 1 of 2 samples beyond the table of b"
    )
    assert row["location"] == "sample 2: delta_f 50 deg"
    with pytest.raises(
        OutOfRange, match="no sample of 1 has a number in all of alpha, delta_f, mach, qhat"
    ):
        aerodb.compare(small, other, {"mach": 0.3, "alpha": np.nan, "delta_f": 0.0, "qhat": 0.0})
    with pytest.raises(UnknownName, match="unknown condition 'qhat'"):
        aerodb.compare(small, other, {"mach": 0.3, "alpha": 0.0, "delta_f": 0.0})


def test_other_references_are_stated(small):
    other = small.copy()
    other.attrs["S"] = 20.0
    with pytest.warns(
        AeromatchWarning,
        match=r"do not refer to the same: S 16.9 in a, 20.0 in b; the numbers are compared as "
        r"they stand",
    ):
        aerodb.compare(small, other)


@pytest.mark.parametrize("along", [None, {"mach": 0.3, "delta_f": 0.1, "qhat": 0.01, "alpha": 0.0}])
def test_what_equal_values_do_not_show_is_named(small, along):
    linear = aerodb.terms(small)["CL/flap"].assign_attrs(outside="linear")
    qhat = aerodb.terms(small)["CL/qhat"]
    other = {"CL/flap": linear, "CL/qhat": qhat.assign(stderr=10.0 * qhat["stderr"])}
    frame = aerodb.compare(small, aerodb.replace_terms(small, other), along)
    assert (frame["max_difference"] == 0.0).all()
    assert "the rule outside is 'hold' in a, 'linear' in b" in frame.loc["CL/flap", "note"]
    assert "the standard errors differ" in frame.loc["CL/qhat", "note"]
    assert "differ" not in frame.loc["CL/basic", "note"]
