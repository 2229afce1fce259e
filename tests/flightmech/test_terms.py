"""The term: construction, faults, evaluation against SciPy, linearity in the nodes."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.terms import (
    SOURCES,
    PowerFactor,
    basis,
    check_term,
    evaluate_term,
    list_model_variables,
    list_multipliers,
    list_regressors,
    make_term,
    power_factor,
    without_multipliers,
)

ALPHA, MACH = np.array([-0.1, 0.0, 0.2, 0.3]), np.array([0.2, 0.5, 0.8])


@pytest.fixture
def table() -> xr.Dataset:
    value = np.random.default_rng(1).normal(size=(4, 3))
    return make_term(
        value, {"alpha": ALPHA, "mach": MACH}, ["qhat"], stderr=0.1, source="datcom", comment="test"
    )


def test_a_leaf_carries_its_meaning(table):
    assert list_regressors(table) == ("qhat",)
    assert list_model_variables(table) == {"alpha", "mach", "qhat"}
    assert table["stderr"].shape == (4, 3)
    assert SOURCES[int(table["source"][0, 0])] == "datcom"
    assert table["alpha"].attrs["units"] == "rad"
    assert check_term(table) == []


def test_all_faults_are_reported_at_once():
    with pytest.raises(SchemaError) as caught:
        make_term(
            [1.0, np.nan],
            {"alpha": [0.2, 0.1]},
            ["alpha", "q", "nonsense"],
            outside="bounce",
            stderr=-1.0,
        )
    text = str(caught.value)
    for part in (
        "axis alpha does not rise: 0.2 is followed by 0.1",
        "1 NaN or infinite nodes of 2",
        "at most 2 are allowed",
        "'nonsense'",
        "'bounce'",
        "negative",
    ):
        assert part in text


def test_value_agrees_with_scipy(table):
    rng = np.random.default_rng(2)
    alpha, mach, qhat = (
        rng.uniform(-0.1, 0.3, 200),
        rng.uniform(0.2, 0.8, 200),
        rng.normal(size=200),
    )
    expected = (
        RegularGridInterpolator((ALPHA, MACH), table["value"].values)(np.stack([alpha, mach], 1))
        * qhat
    )
    np.testing.assert_allclose(
        evaluate_term(table, {"alpha": alpha, "mach": mach, "qhat": qhat}),
        expected,
        rtol=1e-13,
        atol=1e-14,
    )


def test_conditions_broadcast(table):
    found = evaluate_term(table, {"alpha": np.zeros((5, 1)), "mach": MACH, "qhat": 2.0})
    assert found.shape == (5, 3)
    np.testing.assert_allclose(found[3], 2.0 * table["value"].values[1], rtol=1e-15)


def test_contribution_is_linear_in_the_nodes(table):
    conditions = {
        "alpha": np.linspace(-0.1, 0.3, 30),
        "mach": np.linspace(0.8, 0.2, 30),
        "qhat": np.linspace(-1.0, 1.0, 30),
    }
    B = basis(table, conditions)
    assert B.shape == (30, 12)
    np.testing.assert_allclose(
        B @ table["value"].values.ravel(), evaluate_term(table, conditions), rtol=1e-14
    )


def test_factor_tables_multiply():
    gear = xr.DataArray([0.0, 3.0], coords={"gear": [0.0, 1.0]}, dims="gear")
    leaf = make_term(2.0, regressors=["alpha", "alpha"], K1=gear)
    assert evaluate_term(leaf, {"alpha": 0.5, "gear": 0.5}) == pytest.approx(2.0 * 0.25 * 1.5)


def test_outside_raises_or_follows_the_rule(table):
    beyond = {"alpha": [0.0, 0.4], "mach": 0.5, "qhat": 1.0}
    with pytest.raises(
        OutOfRange,
        match=r"alpha = 0.4 lies outside -0.1 ... 0.3 in 1 of 2 samples, first at sample 1",
    ) as caught:
        evaluate_term(table, beyond)
    assert caught.value.mask.tolist() == [False, True]
    end = float(table["value"].sel(alpha=0.3, mach=0.5))
    assert evaluate_term(table, beyond, outside="clamp")[1] == pytest.approx(end, rel=1e-14)
    slope = (end - float(table["value"].sel(alpha=0.2, mach=0.5))) / 0.1
    going_on = evaluate_term(table.assign_attrs(outside="linear"), beyond, outside="clamp")[1]
    assert going_on == pytest.approx(end + 0.1 * slope, rel=1e-12)


def test_missing_condition_is_named(table):
    with pytest.raises(UnknownName, match=r"unknown condition 'qhat'.*the term needs it"):
        evaluate_term(table, {"alpha": 0.0, "mach": 0.5})


@st.composite
def terms_and_conditions(draw):
    """A term of up to four axes, one of them perhaps a single breakpoint, and conditions that are
    scalars, records or grids.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    names = draw(st.lists(st.sampled_from(["mach", "alpha", "delta_f", "delta_e"]), unique=True))
    axes = {name: np.cumsum(0.3 + rng.random(draw(st.integers(1, 5)))) - 1.0 for name in names}
    gear = (
        xr.DataArray(rng.normal(size=3), coords={"gear": [0.0, 0.4, 1.0]}, dims="gear")
        if draw(st.booleans())
        else None
    )
    words = draw(st.lists(st.sampled_from(["qhat", "alpha", "beta"]), max_size=2))
    leaf = make_term(
        rng.normal(size=[len(p) for p in axes.values()]),
        axes,
        words,
        K1=gear,
        outside=draw(st.sampled_from(["hold", "linear"])),
    )
    shapes = st.sampled_from([(), (1,), (3,), (4, 1), (4, 3)])
    return leaf, {
        name: rng.normal(size=draw(shapes)) for name in sorted(list_model_variables(leaf))
    }


@pytest.mark.nightly
@given(terms_and_conditions())
def test_evaluation_is_the_linear_map_without_its_matrix(case):
    leaf, conditions = case
    shape = np.broadcast_shapes((), *(np.shape(x) for x in conditions.values()))
    B, nodes = basis(leaf, conditions, "clamp"), leaf["value"].values.ravel()
    found = evaluate_term(leaf, conditions, "clamp")
    assert found.shape == shape
    # a few dozen operations on the largest of the summands, of the table and of its factors, which
    # may cancel
    whole, factors = (
        leaf.drop_vars(["K1", "K2"], errors="ignore"),
        [name for name in ("K1", "K2") if name in leaf],
    )
    everywhere = {name: np.broadcast_to(x, shape).ravel() for name, x in conditions.items()}
    largest = abs(basis(whole, everywhere, "clamp")) @ np.abs(nodes)
    for name in factors:
        factor = leaf[[name]].rename({name: "value"}).assign_attrs(regressors="")
        largest = largest * (
            abs(basis(factor, everywhere, "clamp")) @ np.abs(factor["value"].values.ravel())
        )
    rounding = 1e-13 * largest
    assert (np.abs(found.ravel() - B @ nodes) <= rounding).all()


def test_evaluation_of_a_long_record_crosses_its_blocks(table):
    n = 20_001
    along = {
        "alpha": np.linspace(-0.1, 0.3, n),
        "mach": np.linspace(0.8, 0.2, n),
        "qhat": np.ones(n),
    }
    np.testing.assert_allclose(
        evaluate_term(table, along),
        basis(table, along) @ table["value"].values.ravel(),
        rtol=1e-13,
        atol=1e-15,
    )


def test_places_found_once_serve_the_next_term(table):
    places: dict = {}
    conditions = {"alpha": np.array([0.1, 0.25]), "mach": 0.4, "qhat": 1.0}
    first = evaluate_term(table, conditions, places=places)
    assert len(places) == 2
    other = make_term([1.0, 2.0, 3.0, 4.0], {"alpha": ALPHA})
    np.testing.assert_array_equal(
        evaluate_term(other, conditions, places=places), evaluate_term(other, conditions)
    )
    np.testing.assert_array_equal(evaluate_term(table, conditions, places=places), first)
    assert len(places) == 2
    with pytest.raises(OutOfRange):
        evaluate_term(make_term([1.0, 2.0], {"alpha": [0.0, 0.2]}), conditions, places=places)


def test_the_mask_has_a_place_for_every_sample(table):
    with pytest.raises(OutOfRange, match="in 3 of 3 samples") as caught:
        evaluate_term(table, {"alpha": [0.0, 0.1, 0.2], "mach": 0.9, "qhat": 1.0})
    assert caught.value.mask.tolist() == [True, True, True]


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            lambda leaf: leaf["alpha"].attrs.update(units="deg"),
            r"axis alpha is given in 'deg', a term holds 'rad': convert the breakpoints",
        ),
        (
            lambda leaf: leaf["alpha"].attrs.update(units="furlong"),
            r"axis alpha is given in 'furlong'",
        ),
        (
            lambda leaf: leaf["source"].__setitem__((0, 0), 7),
            r"source holds codes other than 0 datcom, 1 flight, 2 judgement",
        ),
        (
            lambda leaf: leaf.__setitem__("value", leaf["value"].astype(object)),
            "value holds object; numbers are needed",
        ),
        (
            lambda leaf: leaf.__setitem__("stderr", leaf["stderr"].astype(str)),
            "stderr holds <U32; numbers are needed",
        ),
        (
            lambda leaf: leaf.attrs.update(final=True),
            "attribute final is a bool; only text and numbers survive",
        ),
    ],
)
def test_a_leaf_that_contradicts_the_vocabulary_or_holds_no_numbers(table, change, fault):
    change(table)
    assert [text for text in check_term(table) if fault in text], check_term(table)
    assert len(check_term(table)) == 1


def test_another_spelling_of_the_same_unit_is_no_fault():
    leaf = make_term([1.0, 2.0], {"V": [50.0, 100.0]})
    leaf["V"].attrs["units"] = "m/s"
    assert check_term(leaf) == []


@pytest.fixture
def ground() -> xr.Dataset:
    """Lift slope over ground, [LR743] table 2: 0.506 times 4.87, exponent -1.75; the floor of 2 m
    is ours.
    """
    flap = {"delta_f": [0.0, 0.7]}
    return make_term(
        [2.0, 0.506 * 4.87], flap, ["alpha"], power=PowerFactor("h_agl", -1.75, 2.0), stderr=0.1
    )


def test_a_power_multiplies_the_table(ground):
    at = {"delta_f": 0.7, "alpha": 0.1, "h_agl": np.array([3.0, 2.0, 0.5, -1.0])}
    at_the_floor = 0.506 * 4.87 * 0.1 * 2.0**-1.75
    expected = [0.506 * 4.87 * 0.1 * 3.0**-1.75, at_the_floor, at_the_floor, at_the_floor]
    np.testing.assert_allclose(evaluate_term(ground, at), expected, rtol=1e-14)  # rounding
    np.testing.assert_allclose(basis(ground, at) @ ground["value"].values, expected, rtol=1e-14)
    assert list_model_variables(ground) == {"delta_f", "alpha", "h_agl"}
    assert power_factor(ground) == PowerFactor("h_agl", -1.75, 2.0)


def test_a_bare_leaf_keeps_its_table_and_other_attributes(ground):
    assert list_multipliers(ground) == ("alpha", "max(h_agl, 2)^-1.75")
    alone = without_multipliers(ground.assign_attrs(comment="kept"))
    assert power_factor(alone) is None
    assert list_multipliers(alone) == ()
    assert alone.attrs["comment"] == "kept"
    assert power_factor(ground) is not None  # the leaf itself is untouched
    np.testing.assert_allclose(evaluate_term(alone, {"delta_f": 0.0}), 2.0, rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"power": "height"}, "power: unknown quantity 'height'"),
        ({"exponent": "steep"}, "attribute exponent is 'steep'; a finite number is needed"),
        ({"exponent": np.inf}, "attribute exponent is inf; a finite number is needed"),
        ({"exponent": -1450.0}, "attribute exponent is -1450; allowed: -10 to 10"),
        ({"floor": 0.0}, "attribute floor is 0; it must be positive"),
        ({"power": ""}, "attribute exponent and floor without power"),
    ],
)
def test_faults_of_a_power(ground, change, fault):
    assert fault in " ".join(check_term(ground.assign_attrs(change)))


def test_a_power_without_exponent_or_floor(ground):
    for key in ("exponent", "floor"):
        lacking = ground.copy()
        del lacking.attrs[key]
        assert check_term(lacking) == [
            f"power h_agl: attribute {key} is None; a finite number is needed"
        ]


def test_checks_and_basis_of_a_term_make_no_data_array(monkeypatch):
    """A match does both thousands of times, and each DataArray takes longer than its check."""
    nodes = {"alpha": np.array([0.0, 0.1, 0.2])}
    leaf = make_term([0.1, 0.5, 0.9], nodes, ["delta_e"], stderr=0.01, source="datcom")
    at = {"alpha": np.array([0.05, 0.15]), "delta_e": np.array([1.0, 2.0])}

    def refuse(leaf, key):
        raise AssertionError(f"a DataArray of {key!r}")

    monkeypatch.setattr(xr.Dataset, "__getitem__", refuse)
    assert check_term(leaf) == []
    np.testing.assert_allclose(basis(leaf, at).toarray(), [[0.5, 0.5, 0.0], [0.0, 1.0, 1.0]])
