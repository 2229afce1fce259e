"""The choice of manoeuvres: against all choices there are, on fits of known information."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from aerodb.store.schema import make_database
from aerodb.update.expectation import Expectation
from aerodb.update.tabulation import tabulate
from flightmech import terms
from flightmech.errors import ParseError, SchemaError
from flighttest.flight_programme.planning import expected_range
from flighttest.flight_programme.planning.catalogue import WantedRow
from flighttest.flight_programme.planning.expected_range import draw_stderr, range_of_draws
from flighttest.flight_programme.planning.plan import nodes_of, plan_predicted_flights
from flighttest.flight_programme.planning.plan_files import expected_table
from flighttest.flight_programme.planning.selection import (
    Goal,
    bounds_of,
    select_manoeuvres,
    time_of,
)
from flighttest.flight_programme.planning.wanted_rows import RowGradients, read_rows, save_rows
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

DEG = np.pi / 180
ROOT = dict(
    title="test",
    aircraft="test",
    S=16.0,
    cbar=1.6,
    b=10.0,
    x_ref=0.0,
    y_ref=0.0,
    z_ref=0.0,
    force_axes="stability",
)
# manoeuvre: incidence, its amplitude, noise, time
MANOEUVRES = {
    ("slow", "long"): (8.0, 2.0, 0.004, 60.0),
    ("slow", "short"): (8.0, 2.0, 0.012, 20.0),
    ("fast", "long"): (2.0, 2.0, 0.004, 60.0),
    ("fast", "short"): (2.0, 2.0, 0.012, 20.0),
    ("fast", "level"): (2.0, 0.3, 0.004, 15.0),
}


@pytest.fixture(scope="module")
def prior():
    alpha = np.arange(-4, 17, 4.0) * DEG
    basic = terms.make_term(
        0.2 + 5.0 * alpha, {"alpha": alpha}, stderr=np.full(len(alpha), 0.05), source="datcom"
    )
    return make_database({"CL/basic": basic}, **ROOT)


def fit(item, seed):
    alpha, amplitude, noise, _ = MANOEUVRES[item]
    t = np.arange(0.0, 6.0, 0.05)
    x = (alpha + amplitude * np.sin(3.0 * t)) * DEG
    y = 0.2 + 5.0 * x + noise * np.random.default_rng(seed).normal(size=len(t))
    data = xr.Dataset({"alpha": ("time", x), "CL": ("time", y)}, {"time": t})
    return regress(RegressionModel.parse("CL = 1 + alpha"), data, f"{item[0]}: lift")


class Predicted(SimpleNamespace):
    """Flights in which every manoeuvre is a fit of its own."""

    def fits(self, items):
        return [self.known[item] for item in items]


def predicted(wanted):
    conditions = [SimpleNamespace(name=name, setup=30.0) for name in ("slow", "fast")]
    catalogue = SimpleNamespace(
        title="test", held=(), condition=conditions, wanted=wanted, wanted_row=(), fit=()
    )
    known = {item: fit(item, k) for k, item in enumerate(MANOEUVRES)}
    candidates = {
        item: SimpleNamespace(item=item, time=row[3], fuel=0.01 * row[3])
        for item, row in MANOEUVRES.items()
    }
    return Predicted(catalogue=catalogue, candidates=candidates, known=known, refused={})


def want(ratio, low=0.0, high=8.0, term="CL/basic"):
    return SimpleNamespace(
        term=term, within={"alpha": (low * DEG, high * DEG)}, stderr=None, ratio=ratio
    )


@pytest.mark.nightly
@pytest.mark.parametrize("ratio", [0.5, 0.3, 0.2, 0.1, 0.07])
def test_the_choice_is_the_shortest_of_all(prior, ratio):
    flights = predicted([want(ratio)])
    goal = Goal(flights, prior)
    chosen = select_manoeuvres(goal)
    enough = [
        c
        for n in range(6)
        for c in combinations(MANOEUVRES, n)
        if goal.missing(c) <= max(goal.missing(list(MANOEUVRES)), 1e-5)
    ]
    assert goal.missing(chosen) <= 1e-5
    assert time_of(flights, chosen) == min(time_of(flights, c) for c in enough)


@pytest.mark.slow
def test_what_no_manoeuvre_reaches_is_stated_and_does_not_count(prior):
    flights = predicted([want(0.2, 0.0, 16.0)])
    plan = plan_predicted_flights(flights, prior)
    states = plan.nodes.set_index("alpha")["state"]
    assert states[16 * DEG] == "unreachable"
    assert (states[[0.0, 4 * DEG, 8 * DEG]] == "reached").all()
    assert plan.order["clock"].iloc[-1] == pytest.approx(plan.time)
    assert "unreachable" in plan.report()


def test_what_is_flown_already_counts(prior):
    flights = predicted([want(0.2)])
    rest = plan_predicted_flights(flights, prior, flown=[flights.known["fast", "long"]])
    assert rest.time < plan_predicted_flights(flights, prior).time
    assert all(condition == "slow" for condition, _ in rest.items)


def test_wanted_terms_that_are_not_there(prior):
    flights = predicted([want(0.2, term="CL/qhat"), want(0.2, 30.0, 40.0)])
    flights.catalogue.wanted[1].within["mach"] = (0.1, 0.2)
    with pytest.raises(SchemaError) as caught:
        bounds_of(flights.catalogue, prior)
    assert len(caught.value.problems) == 3


def test_without_a_wanted_node_the_table_is_empty(prior):
    goal = SimpleNamespace(bounds={}, unreachable={}, stderr=lambda items: {})
    table = nodes_of(goal, [], prior)
    assert table.empty
    assert list(table.columns) == ["term", "before", "expected", "bound", "state"]


def row_of(ratio, ground=False):
    """A row whose miss is the lift at 2 and at 6 deg over a tolerance of 0.01."""
    weights = np.zeros((2, 6))
    weights[0, 1:3], weights[1, 2:4] = 0.5, 0.5
    functions = pd.DataFrame(
        {"criterion": ["nz", "nz"], "group": ["g1", "g1"], "time": [1.0, 2.0], "ground": False}
    )
    gradients = weights / 0.01
    if ground:
        ends = pd.DataFrame(
            {"criterion": ["CL"], "group": ["CL"], "time": [np.nan], "ground": True}
        )
        functions = pd.concat([functions, ends], ignore_index=True)
        gradients = np.concatenate([gradients, weights[:1]])
    wanted = WantedRow(row="2.c.10", condition="slow", manoeuvre="long", ratio=ratio)
    return RowGradients(wanted, functions, {"CL/basic": gradients})


def with_row(row):
    flights = predicted([])
    flights.catalogue.wanted_row = (row.wanted,)
    return flights


@pytest.mark.nightly
@pytest.mark.parametrize("ratio", [4.0, 1.5, 0.5])
def test_the_choice_for_a_row_is_the_shortest_of_all(prior, ratio):
    row = row_of(ratio)
    goal = Goal(with_row(row), prior, rows=[row])
    chosen = select_manoeuvres(goal)
    enough = [
        c
        for n in range(6)
        for c in combinations(MANOEUVRES, n)
        if goal.missing(c) <= max(goal.missing(list(MANOEUVRES)), 1e-5)
    ]
    assert goal.missing(chosen) <= 1e-5
    shortest = min(time_of(goal.prediction, c) for c in enough)
    assert time_of(goal.prediction, chosen) == shortest


def test_the_width_is_two_standard_errors_of_the_widest_instant(prior):
    row = row_of(1.0)
    goal = Goal(with_row(row), prior, rows=[row])
    items = list(MANOEUVRES)
    draws = goal.expectation.stderr_of(goal.prediction.fits(items), row.gradients)
    assert goal.widths(items)["2.c.10, slow, long"] == ("nz", pytest.approx(2.0 * draws.max()))


@pytest.mark.nightly
def test_a_row_beyond_all_manoeuvres_is_brought_near_to_what_they_reach(prior):
    row = row_of(0.01, ground=True)
    plan = plan_predicted_flights(with_row(row), prior, rows=[row])
    best = Goal(with_row(row), prior, rows=[row]).widths(list(MANOEUVRES))[row.wanted.name][1]
    (found,) = plan.rows.to_dict("records")
    assert found["state"] == "unreachable"
    assert best <= found["expected"] <= 1.05 * best * (1.0 + 1e-9)
    assert found["before"] > found["expected"]
    assert found["rests_on"] == "CL/basic 100 %"
    assert found["ground"].startswith("CL 0.")
    assert "unreachable" in plan.report()


def test_rows_are_stored_with_their_database(prior, tmp_path):
    row = row_of(1.0)
    catalogue = SimpleNamespace(wanted_row=(row.wanted.model_copy(update={"ratio": 0.3}),))
    save_rows([row], prior, tmp_path / "rows.nc")
    (back,) = read_rows(tmp_path / "rows.nc", catalogue, prior)
    assert back.wanted.ratio == 0.3
    np.testing.assert_array_equal(back.gradients["CL/basic"], row.gradients["CL/basic"])
    pd.testing.assert_frame_equal(back.functions, row.functions, check_dtype=False)
    other = prior.copy(deep=True)
    other["CL/basic/stderr"].values[0] *= 2.0
    with pytest.raises(SchemaError, match="another database"):
        read_rows(tmp_path / "rows.nc", catalogue, other)
    catalogue.wanted_row[0].events["release"] = 2.0
    with pytest.raises(SchemaError, match=r"no row 2\.c\.10"):
        read_rows(tmp_path / "rows.nc", catalogue, prior)
    with pytest.raises(SchemaError, match="pom spread"):
        Goal(with_row(row), prior)
    (tmp_path / "rows.nc").write_bytes(b"no file of this kind")
    with pytest.raises(ParseError):
        read_rows(tmp_path / "rows.nc", catalogue, prior)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_range_holds_for_aeroplanes_that_the_prior_describes(prior):
    """Draws of other seeds lie inside the range of 80 %, within the scatter of 20 draws, and so
    does what `tabulate` gives with estimates of an aeroplane.
    """
    fits = [fit(item, k) for k, item in enumerate(MANOEUVRES)]
    expectation = Expectation(prior)
    drawn = draw_stderr(expectation, fits, 60, seed=1)["CL/basic"]
    again = draw_stderr(expectation, fits, 60, seed=1)["CL/basic"]
    np.testing.assert_array_equal(drawn, again)
    low, _, high = range_of_draws(drawn)
    flown = expectation.flown(fits)["CL/basic"]
    others = draw_stderr(expectation, fits, 20, seed=2)["CL/basic"]
    inside = ((others >= low) & (others <= high))[:, flown]
    assert 0.7 < inside.mean() <= 1.0
    # achieved with these estimates: between the smallest and the largest of the draws
    achieved = tabulate(fits, prior)["CL/basic"]["stderr"].values
    assert (achieved >= 0.9 * drawn.min(axis=0))[flown].all()
    assert (achieved <= 1.1 * drawn.max(axis=0))[flown].all()
    # the table is known better than before, whatever the estimates
    assert (np.median(drawn, axis=0)[flown] < 0.05).all()


def test_the_range_is_that_of_80_percent_of_the_draws_widened_by_a_tenth():
    drawn = np.stack([np.arange(11.0), 10.0 * np.arange(11.0)], axis=1)
    drawn = np.insert(drawn, 3, np.nan, axis=0)  # a draw that failed
    expected = [[1.0 / 1.1, 10.0 / 1.1], [5.0, 50.0], [9.9, 99.0]]
    np.testing.assert_allclose(range_of_draws(drawn), expected)


class _FixedChoices:
    """Random numbers whose uniform ones are all the same."""

    def __init__(self, uniform):
        self.uniform = uniform
        self.standard_normal = np.random.default_rng(5).standard_normal

    def random(self, count):
        return np.full(count, self.uniform)


def test_a_drawn_table_without_regressor_never_has_the_shape_of_the_handbook(prior):
    fits = [fit(item, k) for k, item in enumerate(MANOEUVRES)]
    draws = expected_range._CoefficientDraws(Expectation(prior), "CL", fits)
    low, high = (draws._draw_estimates(_FixedChoices(share)) for share in (0.0, 0.999))
    np.testing.assert_array_equal(low, high)


@pytest.mark.nightly
def test_a_plan_states_the_range_of_wanted_nodes(prior):
    flights = predicted([want(0.2)])
    flights.catalogue.seed = 3
    plan = plan_predicted_flights(flights, prior, draws=20)
    assert plan.notes == []
    nodes = plan.nodes
    assert (nodes["low"] <= nodes["median"]).all()
    assert (nodes["median"] <= nodes["high"]).all()
    assert (nodes["high"] < nodes["before"]).all()
    assert "range of 80 %" in plan.report()
    table = expected_table(plan)
    assert list(table.columns) == ["term", "place", "expected", "low", "median", "high"]
    assert plan_predicted_flights(flights, prior).ranges == {}


@pytest.mark.slow
def test_draws_that_fail_are_counted_and_few_draws_give_no_range(prior, monkeypatch):
    flights = predicted([want(0.2)])
    flights.catalogue.seed = 3

    def drawn(failed):
        def draw(expectation, fits, count, seed):
            values = np.random.default_rng(1).uniform(
                0.01, 0.05, (count, *prior["CL/basic"]["value"].shape)
            )
            values[:failed] = np.nan
            return {"CL/basic": values}

        return draw

    monkeypatch.setattr(expected_range, "draw_stderr", drawn(3))
    plan = plan_predicted_flights(flights, prior, draws=30)
    assert "CL/basic" in plan.ranges
    assert plan.notes[0].startswith("range of CL/basic: 3 of 30 draws failed")
    assert plan.notes[0] in plan.report()
    monkeypatch.setattr(expected_range, "draw_stderr", drawn(15))
    plan = plan_predicted_flights(flights, prior, draws=30)
    assert plan.ranges == {}
    assert "15 of 30 draws failed" in plan.notes[0]
    assert "no range, 15 draws are less than 20" in plan.notes[0]
    assert "low" not in plan.nodes
