"""Tables changed by hand, against numbers worked out by hand."""

import numpy as np
import pytest

import aerodb
from flightmech import terms
from flightmech.errors import OutOfRange, SchemaError, UnknownName

DEG = np.radians(1.0)


def leaf(db, name):
    return aerodb.terms(db)[name]


@pytest.fixture
def geared(small):
    """Return a database whose undercarriage has a factor table and nodes of two sources."""
    K1 = terms.make_term([0.0, 1.0], {"gear": [0.0, 1.0]})["value"]
    gear = terms.make_term(
        [-0.02, -0.03, -0.05],
        {"alpha": [0.0, 0.1, 0.2]},
        K1=K1,
        stderr=[0.01, 0.01, 0.02],
        source="datcom",
    )
    gear["source"][:] = [0, 0, 1]
    return aerodb.replace_terms(small, {"CL/gear": gear})


def test_scale_by_a_number(small):
    new = aerodb.edit.scale(small, "CL/flap", 1.2, stderr=0.05, source="flight", note="run 21")
    flap = leaf(new, "CL/flap")
    np.testing.assert_allclose(flap["value"], [0.0, 0.24, 0.432])
    np.testing.assert_allclose(
        flap["stderr"], [0.0, np.hypot(1.2 * 0.04, 0.05 * 0.2), np.hypot(1.2 * 0.07, 0.05 * 0.36)]
    )
    np.testing.assert_array_equal(
        flap["source"], [0, 1, 1]
    )  # the node at zero deflection is as it was
    assert new.attrs["history"].endswith("\nscale: CL/flap by 1.2 +- 0.05 (run 21)")
    assert flap.attrs["history"] == "scale: by 1.2 +- 0.05 (run 21)"


def test_scale_by_a_table_over_an_axis_of_the_term(small):
    # CL/basic: alpha -8 0 8 16 deg; factor 1 at 4 deg, 2 at 12 deg, held outside
    new = leaf(
        aerodb.edit.scale(small, "CL/basic", [1.0, 2.0], {"alpha": [4 * DEG, 12 * DEG]}), "CL/basic"
    )
    np.testing.assert_allclose(np.degrees(new["alpha"]), [-8, 0, 4, 8, 12, 16])
    before = 0.2 + 5.0 * np.radians([-8, 0, 4, 8, 12, 16])
    np.testing.assert_allclose(new["value"].sel(mach=0.2), before * [1, 1, 1, 1.5, 2, 2])
    np.testing.assert_allclose(new["stderr"].sel(mach=0.2), 0.05 * np.array([1, 1, 1, 1.5, 2, 2]))
    np.testing.assert_array_equal(new["source"].sel(mach=0.2), [0, 0, 0, 2, 2, 2])


def test_scale_takes_patterns_and_new_axes(small):
    new = aerodb.edit.scale(small, "*/qhat", [1.0, 0.5], {"alpha": [0.0, 0.2]})
    assert leaf(new, "CL/qhat").sizes == {"mach": 2, "alpha": 2}
    np.testing.assert_allclose(leaf(new, "Cm/qhat")["value"], [-17.0, -8.5])
    assert "stderr" not in leaf(new, "Cm/qhat")
    assert leaf(new, "Cm/qhat").attrs["regressors"] == "qhat"
    assert new.attrs["history"].endswith("scale: CL/qhat Cm/qhat by 0.5 ... 1 over alpha")


def test_a_table_over_the_axis_of_a_factor_is_multiplied_into_one(geared):
    new = leaf(aerodb.edit.scale(geared, "CL/gear", [1.0, 3.0], {"gear": [0.0, 1.0]}), "CL/gear")
    assert "K1" not in new
    np.testing.assert_allclose(new["value"].sel(gear=1.0), [-0.06, -0.09, -0.15])
    np.testing.assert_allclose(new["stderr"].sel(gear=1.0), [0.03, 0.03, 0.06])
    assert not new["value"].sel(gear=0.0).any()


def test_shift(small):
    new = leaf(
        aerodb.edit.shift(small, "CL/qhat", [0.0, 1.0], {"mach": [0.2, 0.3]}, stderr=[0.0, 0.5]),
        "CL/qhat",
    )
    np.testing.assert_allclose(new["mach"], [0.2, 0.3, 0.4])
    np.testing.assert_allclose(new["value"], [8.0, 8.2 + 1.0, 8.4 + 1.0])
    np.testing.assert_allclose(new["stderr"], [2.0, np.hypot(2.05, 0.5), np.hypot(2.1, 0.5)])
    np.testing.assert_array_equal(new["source"], [0, 2, 2])


def test_regrid_reports_its_error(small):
    alpha = [-8 * DEG, 8 * DEG, 16 * DEG]
    changed = leaf(small, "CL/basic").copy(deep=True)
    changed["value"][:, 1] += 0.01  # the node at 0 deg, which the new table does not have
    small = aerodb.replace_terms(small, {"CL/basic": changed})
    assert aerodb.edit.regrid_error(small, "CL/basic", {"alpha": alpha}) == pytest.approx(
        0.01, abs=1e-15
    )
    new = aerodb.edit.regrid(small, "CL/basic", {"alpha": alpha}, tolerance=0.0101)
    assert "differs by up to 0.01 at mach 0." in new.attrs["history"]
    assert (
        new.attrs["history"]
        .splitlines()[-1]
        .startswith(
            "regrid: CL/basic on alpha 3 for 4 breakpoints, differs by up to 0.01 at mach 0."
        )
    )
    with pytest.raises(
        OutOfRange,
        match=r"regrid CL/basic: .* differs from the old one by up to 0\.01 at mach 0\.\d, alpha "
        r"0 deg, allowed 0\.009",
    ):
        aerodb.edit.regrid(small, "CL/basic", {"alpha": alpha}, tolerance=0.009)


def test_the_error_of_a_regrid_counts_the_factor(geared):
    geared = aerodb.edit.scale(geared, "CL/gear", 1.0)
    assert aerodb.edit.regrid_error(geared, "CL/gear", {"alpha": [0.0, 0.2]}) == pytest.approx(
        0.005
    )
    halved = leaf(geared, "CL/gear")
    halved = aerodb.replace_terms(geared, {"CL/gear": halved.assign(K1=halved["K1"] * 0.5)})
    assert aerodb.edit.regrid_error(halved, "CL/gear", {"alpha": [0.0, 0.2]}) == pytest.approx(
        0.0025
    )


def test_regrid_keeps_sources_and_standard_errors(geared):
    new = leaf(
        aerodb.edit.regrid(geared, "CL/gear", {"alpha": [0.0, 0.05, 0.1, 0.15, 0.2]}), "CL/gear"
    )
    np.testing.assert_array_equal(
        new["source"], [0, 0, 0, 2, 1]
    )  # 0.15 lies between DATCOM and flight
    np.testing.assert_allclose(new["stderr"], [0.01, 0.01, 0.01, 0.015, 0.02])
    np.testing.assert_allclose(new["value"], [-0.02, -0.025, -0.03, -0.04, -0.05])
    assert new["K1"].equals(leaf(geared, "CL/gear")["K1"])


def test_degrees_that_come_to_radians_another_way_are_the_same_breakpoint(small):
    alpha = np.array([-8.0, 0.0, 8.0, 16.0]) * (np.pi / 180) * (1 + 2e-16)
    new = leaf(aerodb.edit.shift(small, "CL/basic", np.zeros(4), {"alpha": alpha}), "CL/basic")
    assert new.sizes["alpha"] == 4


def test_extend_grows_the_standard_error(small):
    flap = leaf(aerodb.edit.extend(small, "CL/flap", "delta_f", [50 * DEG, 60 * DEG]), "CL/flap")
    np.testing.assert_allclose(flap["value"], [0.0, 0.2, 0.36, 0.36, 0.36])
    np.testing.assert_allclose(flap["stderr"][3:], [np.hypot(0.07, 0.08), np.hypot(0.07, 0.16)])
    flap = leaf(
        aerodb.edit.extend(small, "CL/flap", "delta_f", [50 * DEG, 60 * DEG], "linear"), "CL/flap"
    )
    np.testing.assert_allclose(flap["value"][3:], [0.44, 0.52])
    np.testing.assert_allclose(
        flap["stderr"][3:], [np.hypot(1.5 * 0.07, 0.5 * 0.04), np.hypot(2 * 0.07, 0.04)]
    )
    new = aerodb.edit.extend(
        small, "CL/flap", "delta_f", [50 * DEG], [0.4], stderr=0.1, note="tunnel"
    )
    flap = leaf(new, "CL/flap")
    assert float(flap["value"][-1]) == 0.4
    assert float(flap["stderr"][-1]) == 0.1
    np.testing.assert_array_equal(flap["source"], [0, 0, 0, 2])
    assert new.attrs["history"].endswith(
        "extend: CL/flap in delta_f to 50 deg, given values (tunnel)"
    )


def test_extend_on_both_sides_and_across_other_axes(small):
    values = np.arange(4.0).reshape(2, 2)
    new = leaf(
        aerodb.edit.extend(small, "CL/basic", "alpha", [-12 * DEG, 20 * DEG], values, stderr=0.2),
        "CL/basic",
    )
    np.testing.assert_allclose(np.degrees(new["alpha"]), [-12, -8, 0, 8, 16, 20])
    np.testing.assert_array_equal(new["value"].isel(alpha=[0, -1]), values)
    new = leaf(aerodb.edit.extend(small, "CL/basic", "mach", [0.1, 0.6], "linear"), "CL/basic")
    np.testing.assert_allclose(new["value"].sel(mach=0.6), 0.2 + 5.8 * np.radians([-8, 0, 8, 16]))
    np.testing.assert_allclose(new["value"].sel(mach=0.1), 0.2 + 4.8 * np.radians([-8, 0, 8, 16]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edit", "error", "text"),
    [
        (
            lambda db: aerodb.edit.scale(db, "CL/flop", 2.0),
            UnknownName,
            "unknown term 'CL/flop'; near it: CL/flap",
        ),
        (lambda db: aerodb.edit.scale(db, "*/gear", 2.0), UnknownName, r"unknown term '\*/gear'"),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", [1.0, 2.0], {"alfa": [0.0, 1.0]}),
            UnknownName,
            "unknown quantity 'alfa'; near it: alpha",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", [1.0, 2.0], {"mach": [0.4, 0.2]}),
            SchemaError,
            "axis mach does not rise: 0.4 is followed by 0.2",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", [1.0, 2.0]),
            SchemaError,
            r"factor: 1 problem\n  - has the shape \(2,\); a number",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", [1.0], {"mach": [0.2, 0.4]}),
            SchemaError,
            r"has the shape \(1,\); its axes mach need \(2,\)",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", 1.0, stderr=[0.1]),
            SchemaError,
            "stderr has the shape",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", 1.0, stderr=-0.1),
            SchemaError,
            "stderr holds negative",
        ),
        (
            lambda db: aerodb.edit.scale(db, "CL/flap", 1.1, source="tunnel"),
            SchemaError,
            "source is 'tunnel'; allowed: datcom, flight, judgement",
        ),
        (lambda db: aerodb.edit.scale(db, "CL/flap", float("nan")), SchemaError, "NaN or infinite"),
        (
            lambda db: aerodb.edit.regrid(db, "CL/flap", {"mach": [0.2, 0.3]}),
            UnknownName,
            "unknown axis 'mach'; allowed: delta_f",
        ),
        (
            lambda db: aerodb.edit.regrid(db, "CL/flap", {"delta_f": [0.5, 0.1]}),
            SchemaError,
            "give finite numbers that rise",
        ),
        (
            lambda db: aerodb.edit.regrid(db, "CL/flap", {"delta_f": [0.0, 0.9]}),
            OutOfRange,
            r"delta_f = 0.9 lies outside 0 \.\.\. 0.698132; extend",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [0.3]),
            SchemaError,
            "must lie outside",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [1.0, 0.9]),
            SchemaError,
            "give finite numbers that rise",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [1.0], "cubic"),
            SchemaError,
            "how is 'cubic'; allowed: hold, linear",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [1.0], [0.4]),
            SchemaError,
            "give stderr= with the values",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [1.0], [0.4, 0.5], stderr=0.1),
            SchemaError,
            "give 1 numbers along delta_f",
        ),
        (
            lambda db: aerodb.edit.extend(db, "CL/flap", "delta_f", [1.0], stderr=-1.0),
            SchemaError,
            "negative",
        ),
        (lambda db: aerodb.delete_terms(db, "*"), SchemaError, "holds no term"),
    ],
)
def test_what_does_not_fit_is_refused(small, edit, error, text):
    copy = small.copy(deep=True)
    with pytest.raises(error, match=text):
        edit(small)
    assert small.identical(copy)


def test_an_axis_of_a_factor_is_named_as_such(geared):
    with pytest.raises(
        UnknownName,
        match=r"unknown axis 'gear'.*it belongs to a factor; put a changed leaf in with "
        r"replace_terms",
    ):
        aerodb.edit.regrid(geared, "CL/gear", {"gear": [0.0, 0.5, 1.0]})


def test_a_table_without_a_slope_is_not_extended_linearly(small):
    single = aerodb.replace_terms(
        small, {"CL/gear": terms.make_term([0.1], {"mach": [0.2]}, stderr=0.05)}
    )
    with pytest.raises(SchemaError, match="mach has one breakpoint and no slope"):
        aerodb.edit.extend(single, "CL/gear", "mach", [0.4], "linear")
    with pytest.raises(SchemaError, match="the term has no standard errors; leave stderr= out"):
        aerodb.edit.extend(
            aerodb.replace_terms(small, {"CL/gear": terms.make_term([0.1], {"mach": [0.2]})}),
            "CL/gear",
            "mach",
            [0.4],
            stderr=0.1,
        )
    held = leaf(aerodb.edit.extend(single, "CL/gear", "mach", [0.1, 0.4]), "CL/gear")
    np.testing.assert_allclose(held["value"], [0.1, 0.1, 0.1])
    np.testing.assert_allclose(held["stderr"], 0.05)


def test_one_node_is_set(small):
    new = aerodb.edit.set_nodes(
        small,
        "CL/basic",
        {"alpha": 8 * DEG, "mach": 0.4},
        1.25,
        stderr=0.02,
        source="flight",
        note="run 7",
    )
    old, basic = leaf(small, "CL/basic"), leaf(new, "CL/basic")
    there = {"alpha": 2, "mach": 1}
    assert basic["value"][there] == 1.25
    assert basic["stderr"][there] == 0.02
    assert basic["source"][there] == 1
    for table, changed in (("value", 1), ("stderr", 1), ("source", 1)):
        assert int((basic[table] != old[table]).sum()) == changed
    was = float(old["value"][there])
    assert new.attrs["history"].endswith(
        f"\nset_nodes: CL/basic at mach 0.4, alpha 8 deg to 1.25 +- 0.02, was {was:g} (run 7)"
    )
    assert aerodb.store.undo_edits(new).identical(small)


def test_a_row_of_nodes_is_set_and_keeps_its_standard_errors(small):
    new = leaf(aerodb.edit.set_nodes(small, "CL/basic", {"alpha": 0.0}, 0.3), "CL/basic")
    np.testing.assert_array_equal(new["value"].sel(alpha=0.0), [0.3, 0.3])
    np.testing.assert_array_equal(new["stderr"], leaf(small, "CL/basic")["stderr"])


def test_a_node_that_is_not_there_or_a_number_that_cannot_be_is_refused(small):
    with pytest.raises(
        OutOfRange,
        match="no breakpoint at alpha 3 deg; there are -8 deg, 0 deg, 8 deg, 16 deg; regrid",
    ):
        aerodb.edit.set_nodes(small, "CL/basic", {"alpha": 3 * DEG}, 0.3)
    with pytest.raises(UnknownName, match="unknown axis 'beta'"):
        aerodb.edit.set_nodes(small, "CL/basic", {"beta": 0.0}, 0.3)
    with pytest.raises(
        SchemaError,
        match=r"(?s)value is nan; give a finite number.*stderr is -1.0; give zero or more",
    ):
        aerodb.edit.set_nodes(small, "CL/basic", {}, np.nan, stderr=-1.0)
    with pytest.raises(SchemaError, match="source is 'guess'"):
        aerodb.edit.set_nodes(small, "CL/basic", {}, 0.3, source="guess")
    with pytest.raises(SchemaError, match="has no standard errors; leave stderr= out"):
        aerodb.edit.set_nodes(small, "Cm/qhat", {}, 0.3, stderr=0.1)
