import numpy as np
import pytest
import xarray as xr

from aerodb.prior.effect_to_terms import fill_unprinted_cells, terms_of_effect
from aerodb.prior.prior_errors import PriorErrors
from aerodb.store.effects import Effect

DEG = np.pi / 180
nan = np.nan
PRIOR = PriorErrors({"Cm/basic": (0.2, 0.02), "CL/flap": (0.2, 0.02)}, stmach=0.9)


def table(rows, mach=(0.2, 0.4, 0.6)):
    return xr.DataArray(
        np.array(rows, float),
        {"mach": list(mach), "alpha": np.array([0.0, 4.0, 8.0, 12.0]) * DEG},
        ("mach", "alpha"),
    )


def test_cells_beyond_the_print_are_held_for_their_mach_number_only():
    whole, printed, notes = fill_unprinted_cells(
        table([[1, 2, 3, nan], [1, 2, nan, nan], [1, 2, 4, nan]])
    )
    np.testing.assert_array_equal(whole, [[1, 2, 3], [1, 2, 2], [1, 2, 4]])
    np.testing.assert_array_equal(printed, [[1, 1, 1], [1, 1, 0], [1, 1, 1]])
    assert notes == [
        "alpha 12 deg not printed",
        "1 of 9 cells are not printed: value of the nearest printed alpha held there",
    ]


def test_a_gap_is_bridged():
    whole, printed, _ = fill_unprinted_cells(table([[1, nan, 3, 4], [1, 5, 3, 4], [1, 5, 3, 4]]))
    np.testing.assert_allclose(whole, [[1, 2, 3, 4], [1, 5, 3, 4], [1, 5, 3, 4]])
    np.testing.assert_array_equal(printed[:, 1], [False, True, True])


def test_a_transonic_row_is_cut_off():
    whole, _, notes = fill_unprinted_cells(
        table([[1, 2, 3, 4], [1, 2, 3, 4], [5, nan, nan, nan]], mach=(0.2, 0.4, 0.9))
    )
    np.testing.assert_array_equal(whole["mach"], [0.2, 0.4])
    assert notes == ["mach 0.9 not printed"]


def test_nothing_printed_makes_no_term():
    assert terms_of_effect(Effect("basic", {"Cm": table([[nan] * 4] * 3)}), PRIOR, {}) == {}


def test_mach_range_is_covered_and_every_node_states_where_it_comes_from():
    effect = Effect(
        "basic",
        {"Cm": table([[1, 2, 3, 4], [1, 2, 3, 4], [1, 2, 3, nan]])},
        references="x.out, lines 1-9",
    )
    leaf = terms_of_effect(effect, PRIOR, {"mach": (0.0, 0.8)})["Cm/basic"]
    np.testing.assert_array_equal(leaf["mach"], [0.0, 0.2, 0.4, 0.6, 0.8])
    np.testing.assert_array_equal(leaf["value"].sel(mach=0.0), leaf["value"].sel(mach=0.2))
    np.testing.assert_array_equal(leaf["value"].sel(mach=0.8), [1, 2, 3, 3])
    np.testing.assert_array_equal(
        leaf["source"], [[2, 2, 2, 2], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [2, 2, 2, 2]]
    )
    assert leaf.attrs["comment"].endswith("mach 0 0.8: value of the nearest one held")
    assert leaf.attrs["references"] == "x.out, lines 1-9"
    # the rule, and twice of it where held in alpha
    np.testing.assert_allclose(
        leaf["stderr"].sel(mach=0.2), np.hypot(0.2 * np.array([1, 2, 3, 4]), 0.02)
    )
    assert float(leaf["stderr"].sel(mach=0.6)[-1]) == pytest.approx(2 * np.hypot(0.6, 0.02))


def test_a_node_that_is_zero_by_definition_has_no_error():
    value = xr.DataArray([0.0, 0.2, 0.3], {"delta_f": [0.0, 0.3, 0.6]}, "delta_f")
    leaf = terms_of_effect(Effect("flap", {"CL": value}, zeros={"delta_f": [0.0]}), PRIOR, {})[
        "CL/flap"
    ]
    np.testing.assert_allclose(leaf["stderr"], [0.0, np.hypot(0.04, 0.02), np.hypot(0.06, 0.02)])


def test_alpha_range_is_covered_with_doubled_error():
    effect = Effect("basic", {"Cm": table([[1, 2, 3, nan]] * 3)})
    leaf = terms_of_effect(effect, PRIOR, {"alpha": (-4 * DEG, 12 * DEG)})["Cm/basic"]
    np.testing.assert_allclose(leaf["alpha"] / DEG, [-4, 0, 4, 8, 12])
    np.testing.assert_array_equal(leaf["value"].sel(mach=0.2), [1, 1, 2, 3, 3])
    np.testing.assert_array_equal(leaf["source"].sel(mach=0.2), [2, 0, 0, 0, 2])
    np.testing.assert_allclose(
        leaf["stderr"].sel(mach=0.2) / np.hypot(0.2 * np.array([1, 1, 2, 3, 3]), 0.02),
        [2, 1, 1, 1, 2],
    )
    assert (
        leaf.attrs["comment"]
        == "alpha 12 deg not printed; alpha -4 12 deg: value of the nearest one held"
    )
