"""Calibrated standard errors and ratios of a-priori estimates."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from aerodb.prior.effect_to_terms import terms_of_effect
from aerodb.prior.prior_errors import (
    PriorErrors,
    choose_errors,
    describe_uncalibrated,
    method_class,
    read_calibration,
)
from aerodb.store.effects import Effect
from flightmech.errors import UnknownName

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "prior_calibration.py"


def test_table_has_the_aircraft_behind_each_figure():
    table = read_calibration()
    assert set(table["program"]) == {"DATCOM", "OptVL", "OptVL with body"}
    assert table["count"].between(3, 11).all()
    assert (table[["ratio", "factor"]] > 0.0).all(axis=None)
    assert table["term"].map(method_class).isin(["static", "dynamic", "control"]).all()
    lift = table.set_index(["program", "term"]).loc[("DATCOM", "CL/basic")]
    assert (lift["count"], lift["ratio"], lift["relative"]) == (11, 0.91, 0.092)


def test_calibrated_rules_replace_those_of_the_guide_where_there_is_a_figure():
    guide = choose_errors("guide", "DATCOM", None)
    rules = choose_errors("calibrated", "DATCOM", {"Cn/beta": (0.1, 0.0)})
    assert rules.terms["CL/basic"] == (0.092, 0.05)
    assert rules.terms["CL/flap"] == guide.terms["CL/flap"]
    # A figure of the project stays, and its term is not corrected.
    assert rules.terms["Cn/beta"] == (0.1, 0.0)
    assert "Cn/beta" not in rules.ratios
    assert guide.ratios == {}
    with pytest.raises(UnknownName, match="calibrated program"):
        choose_errors("calibrated", "AVL", None)
    with pytest.raises(UnknownName, match="kind of standard errors"):
        choose_errors("guessed", "DATCOM", None)


def test_the_slope_of_the_moment_is_corrected_about_zero_lift():
    alpha = np.radians([-4.0, 0.0, 4.0])
    mach = np.array([0.3, 0.9])
    axes = {"mach": mach, "alpha": alpha}
    lift = xr.DataArray(np.tile(5.0 * alpha + 0.2, (2, 1)), axes, ("mach", "alpha"))
    moment = 0.05 - 0.2 * lift
    rules = PriorErrors(
        {"CL/basic": (0.1, 0.0), "Cm/basic": (0.2, 0.02)},
        ratios={"CL/basic": 0.9, "Cm/basic": 0.5},
        stmach=0.95,
    )
    cover = {"mach": (0.3, 0.9), "alpha": (alpha[0], alpha[-1])}
    effect = Effect("basic", {"CL": lift, "Cm": moment})
    leaves = terms_of_effect(effect, rules, cover)
    value = leaves["Cm/basic"]["value"]
    assert value.sel(mach=0.3).values == pytest.approx(0.05 - 0.1 * lift.sel(mach=0.3).values)
    assert leaves["CL/basic"]["value"].sel(mach=0.3).values == pytest.approx(
        0.9 * lift.sel(mach=0.3).values
    )
    # Nothing is calibrated beyond Mach 0.6.
    assert value.sel(mach=0.9).values == pytest.approx(moment.sel(mach=0.9).values)
    # The standard error is that of the estimate, beyond Mach 0.6 with the bias seen below.
    expected = np.hypot(0.2 * moment, 0.02)
    stderr = leaves["Cm/basic"]["stderr"]
    assert stderr.sel(mach=0.3).values == pytest.approx(expected.sel(mach=0.3).values)
    beyond = np.hypot(expected, 0.5 * 0.2 * lift).sel(mach=0.9)
    assert stderr.sel(mach=0.9).values == pytest.approx(beyond.values)
    comment = leaves["Cm/basic"].attrs["comment"]
    assert "multiplied by 0.5" in comment
    assert "not calibrated beyond Mach 0.6" in comment
    plain = terms_of_effect(effect, PriorErrors(rules.terms, stmach=0.95), cover)
    assert plain["Cm/basic"]["value"].values == pytest.approx(moment.values)


def test_beyond_the_calibration_the_errors_are_at_least_those_of_the_guide():
    # The calibrated error of CL/qhat is 0.3, that of the guide 0.35; the ratio is 0.64.
    rules = choose_errors("calibrated", "DATCOM", None)
    mach = np.array([0.5, 0.6, 0.8, 1.2, 1.6])
    table = xr.DataArray(np.full(5, 4.0), {"mach": mach}, "mach")
    assert (rules.terms["CL/qhat"][0], rules.ratios["CL/qhat"]) == (0.3, 0.64)
    leaf = terms_of_effect(Effect("qhat", {"CL": table}, "qhat"), rules, {})["CL/qhat"]
    guide = np.array([0.35 * 2.0, 0.35 * 2.0, 0.35 * 1.5]) * 4.0  # factors of the regimes
    expected = [0.3 * 4.0, 0.3 * 4.0, *np.hypot(guide, 0.36 * 4.0)]
    assert leaf["stderr"].values == pytest.approx(expected)
    assert leaf["value"].values == pytest.approx([2.56, 2.56, 4.0, 4.0, 4.0])
    text = describe_uncalibrated(rules, table)
    assert text.startswith("Mach 0.8, 1.2, 1.6 (transonic, supersonic): not calibrated")
    assert describe_uncalibrated(rules, table.sel(mach=[0.5, 0.6])) == ""
    assert describe_uncalibrated(choose_errors("guide", "DATCOM", None), table) == ""


@pytest.mark.nightly
def test_errors_that_other_aircraft_calibrate_hold_the_values_of_each():
    """Two standard errors hold 90 to 98 % of all values, and 80 % of each class."""
    script = runpy.run_path(str(BENCHMARK))
    cases = script["read_cases"]()
    for program in ("DATCOM", "OptVL"):
        mine = cases[cases["program"] == program]
        assert mine["aircraft"].nunique() == 11
        tested = script["leave_one_out"](mine, corrected=True)
        inside = tested["z"].abs() <= 2.0
        assert 0.90 <= inside.mean() <= 0.98
        assert (inside.groupby(tested["method"]).mean() >= 0.80).all()
        # The ratio makes unseen values more probable, and the guide holds too few.
        carried = script["leave_one_out"](mine, corrected=False)
        assert tested["score"].mean() > carried["score"].mean()
        by_guide = (mine["published"] - mine["estimate"]).abs() <= 2.0 * mine["scale"]
        assert by_guide.mean() < 0.82


def test_table_is_that_of_the_script(tmp_path):
    script = runpy.run_path(str(BENCHMARK))
    cases = script["read_cases"]()
    table = read_calibration()
    for program, rows in table.groupby("program"):
        terms = script["fit_terms"](cases[cases["program"] == program], corrected=True)
        names = {script["QUANTITIES"][name][0]: name for name in terms.index}
        for row in rows.to_dict("records"):
            fitted = terms.loc[names[row["term"]]]
            assert (row["count"], row["ratio"]) == (fitted["count"], round(fitted["ratio"], 2))
            assert row["factor"] == round(fitted["factor"], 2)
