import numpy as np
import pytest

import aerodb
from flightmech import terms


def changed(small, name, **leaf):
    old = aerodb.terms(small)[name]
    axes = {axis: old[axis].values for axis in old["value"].dims}
    arguments = {"value": old["value"].values, "axes": axes, "regressors": terms.regressors(old), "stderr": old["stderr"].values, **leaf}
    return aerodb.replace_terms(small, {name: terms.make(**arguments)})


def test_equal_databases_differ_nowhere(small):
    frame = aerodb.compare(small, small)
    assert list(frame.index) == ["CL/basic", "CL/qhat", "CL/flap", "Cm/qhat"]
    assert (frame["found_in"] == "both").all()
    assert (frame["max_difference"] == 0).all()
    assert np.isnan(frame.loc["Cm/qhat", "max_in_stderr"])  # no standard error there


def test_largest_difference_where_and_in_standard_errors(small):
    frame = aerodb.compare(small, changed(small, "CL/flap", value=[0.0, 0.2, 0.29]))
    row = frame.loc["CL/flap"]
    assert row["max_difference"] == pytest.approx(-0.07)
    assert row["rms_difference"] == pytest.approx(0.07 / np.sqrt(3))
    assert row["max_in_stderr"] == pytest.approx(1.0)
    assert row["location"] == "delta_f 40 deg"


def test_nodes_of_both_are_looked_at(small):
    finer = changed(small, "CL/flap", value=[0.0, 0.15, 0.2, 0.36], axes={"delta_f": np.radians([0, 10, 20, 40])}, stderr=0.01)
    for a, b, sign in ((small, finer, 1.0), (finer, small, -1.0)):
        row = aerodb.compare(a, b).loc["CL/flap"]
        assert row["max_difference"] == pytest.approx(sign * 0.05)
        assert row["location"] == "delta_f 10 deg"


def test_terms_of_one_side_count_against_zero(small):
    more = aerodb.replace_terms(small, {"CL/gear": terms.make(-0.02, regressors=["gear"])})
    assert aerodb.compare(small, more).loc["CL/gear", ["found_in", "max_difference"]].tolist() == ["b", -0.02]
    assert aerodb.compare(more, small).loc["CL/gear", ["found_in", "max_difference"]].tolist() == ["a", 0.02]


def test_factor_tables_and_new_axes_are_compared_as_a_whole(small):
    import xarray as xr

    factor = xr.DataArray([0.0, 1.0], {"gear": [0.0, 1.0]}, "gear")
    geared = aerodb.replace_terms(small, {"CL/gear": terms.make([0.1, 0.2], {"mach": [0.2, 0.4]}, K1=factor)})
    row = aerodb.compare(small, geared).loc["CL/gear"]
    assert row["max_difference"] == pytest.approx(0.2)
    assert row["location"] == "mach 0.4, gear 1"


def test_other_regressors_are_said_and_not_compared(small):
    other = aerodb.replace_terms(small, {"CL/qhat": terms.make(1.0, regressors=["alphadothat"])})
    row = aerodb.compare(small, other).loc["CL/qhat"]
    assert np.isnan(row["max_difference"])
    assert row["note"] == "regressors differ: qhat in a, alphadothat in b"


def test_coefficients_along_conditions(small):
    other = changed(small, "CL/qhat", value=[10.0, 10.4])
    given = {"mach": 0.3, "alpha": 0.0, "delta_f": 0.0, "qhat": np.array([0.0, 0.01, -0.02])}
    row = aerodb.compare(small, other, given).loc["CL"]
    assert row["found_in"] == "conditions"
    assert row["max_difference"] == pytest.approx(-0.04)
    assert row["location"] == "sample 2"
