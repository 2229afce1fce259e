"""Tables against SciPy: values, ends, single points, independence of history."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import flightmech
from flightmech.simulation.kernel import Simulation
from flightmech.terms import make_term

NAMES = ("alpha", "beta", "mach", "delta_e")


def evaluate(sim: flightmech.SimModel, **columns) -> np.ndarray:
    """Coefficients (n, 6) at model variables given by name; others are zero."""
    v = np.zeros((len(next(iter(columns.values()))), len(sim.variables)))
    for name, values in columns.items():
        v[:, sim.variables.index(name)] = values
    return Simulation(sim.model).evaluate(v)[0]


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_random_grids_agree_with_scipy(count, make_aircraft, make_tree):
    rng = np.random.default_rng(count)
    points = {name: np.cumsum(rng.uniform(0.05, 1.0, rng.integers(2, 9))) for name in NAMES[:count]}
    tables = {f"CL/t{i}": rng.normal(size=[len(p) for p in points.values()]) for i in range(7)}
    sim = flightmech.compile(
        make_aircraft(),
        make_tree({name: make_term(value, points) for name, value in tables.items()}),
    )
    x = {name: rng.uniform(p[0], p[-1], 300) for name, p in points.items()}
    v = np.stack([x[name] if name in x else np.zeros(300) for name in sim.variables], axis=1)
    found = Simulation(sim.model).evaluate(v)[1][:, [sim.terms.index(name) for name in tables]]
    at = np.stack(list(x.values()), axis=1)
    expected = np.stack(
        [RegularGridInterpolator(tuple(points.values()), value)(at) for value in tables.values()],
        axis=1,
    )
    assert (
        np.abs(found - expected).max() < 1e-14 * np.abs(expected).max() * 2**count
    )  # 2**count rounded products


def test_hold_keeps_the_end_and_linear_goes_on(make_aircraft, make_tree):
    points = np.array([0.0, 1.0, 3.0])
    content = {
        "CL/held": make_term([1.0, 2.0, 8.0], {"alpha": points}),
        "CD/linear": make_term([1.0, 2.0, 8.0], {"alpha": points}, outside="linear"),
    }
    sim = flightmech.compile(make_aircraft(), make_tree(content))
    CL, CD = evaluate(sim, alpha=[-1.0, 0.0, 3.0, 5.0])[:, :2].T
    assert CL.tolist() == [1.0, 1.0, 8.0, 8.0]
    assert CD.tolist() == [0.0, 1.0, 8.0, 14.0]


def test_axis_of_one_point_is_a_constant(make_aircraft, make_tree):
    sim = flightmech.compile(
        make_aircraft(),
        make_tree({"CL/one": make_term([[3.0, 5.0]], {"mach": [0.4], "alpha": [0.0, 1.0]})}),
    )
    assert evaluate(sim, alpha=[0.0, 0.5, 1.0], mach=[0.1, 0.4, 0.9])[:, 0].tolist() == [
        3.0,
        4.0,
        5.0,
    ]


def test_value_at_a_breakpoint_is_the_node(make_aircraft, make_tree):
    points = np.linspace(-0.3, 0.4, 8)
    nodes = np.sin(points * 9.0)
    sim = flightmech.compile(
        make_aircraft(), make_tree({"CL/t": make_term(nodes, {"alpha": points})})
    )
    assert evaluate(sim, alpha=points)[:, 0].tolist() == nodes.tolist()


def test_result_does_not_depend_on_the_way_there(make_aircraft, make_tree):
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.uniform(0.1, 1.0, 40))
    sim = flightmech.compile(
        make_aircraft(), make_tree({"CL/t": make_term(rng.normal(size=40), {"alpha": points})})
    )
    x = rng.uniform(points[0] - 1.0, points[-1] + 1.0, 500)
    order = np.argsort(x)
    assert (evaluate(sim, alpha=x)[order, 0] == evaluate(sim, alpha=x[order])[:, 0]).all()


def test_nan_stays_nan_and_harms_nothing(make_aircraft, make_tree):
    sim = flightmech.compile(
        make_aircraft(), make_tree({"CL/t": make_term([1.0, 2.0, 8.0], {"alpha": [0.0, 1.0, 3.0]})})
    )
    found = evaluate(sim, alpha=[0.5, np.nan, np.inf, 0.5])[:, 0]
    assert np.isnan(found[1])
    assert found[[0, 2, 3]].tolist() == [1.5, 8.0, 1.5]


def test_same_axes_share_a_bundle_other_breakpoints_do_not(make_aircraft, make_tree):
    content = {
        "CL/a": make_term([0.0, 1.0], {"alpha": [0.0, 1.0]}),
        "CD/b": make_term([0.0, 1.0], {"alpha": [0.0, 1.0]}),
        "Cm/c": make_term([0.0, 1.0], {"alpha": [0.0, 2.0]}),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(content))
    assert sim.axes == ("alpha", "alpha")


@pytest.mark.parametrize("outside", ["hold", "linear"])
def test_many_rows_at_once_give_the_numbers_of_single_rows(
    outside, content, make_aircraft, make_tree
):
    """Blocks of 64 rows go through columns, few rows through the tables of a flight; narrow and
    wide bundles, powers, special terms.
    """
    rng = np.random.default_rng(9)
    points = {name: np.cumsum(rng.uniform(0.05, 1.0, 5)) for name in NAMES}
    grids = {f"CD/{kind}{i}": list(points)[:i] for kind in ("a", "b", "c") for i in range(5)} | {
        f"Cn/alone{i}": list(points)[-i:] for i in (1, 2, 3)
    }
    more = {
        name: make_term(
            rng.normal(size=[len(points[axis]) for axis in axes]),
            {axis: points[axis] for axis in axes},
            outside=outside,
        )
        for name, axes in grids.items()
    }
    powers = {
        "CL": ("h_agl", -1.5),
        "CD": ("h_agl", -1.5),
        "CY": ("h_agl", 0.7),
        "Cl": ("mach", 0.7),
        "Cm": ("h_agl", -1.5),
    }
    for head, (variable, exponent) in powers.items():  # one that follows itself, and others between
        more[f"{head}/powered"] = make_term(0.3).assign_attrs(
            power=variable, exponent=exponent, floor=0.5
        )
    sim = flightmech.compile(make_aircraft(), make_tree({**content, **more}))
    v = rng.uniform(-1.5, 4.0, (150, len(sim.variables)))
    v[3, 0], v[70, 1], v[90, 2] = np.nan, np.inf, -np.inf
    together = Simulation(sim.model).evaluate(v)
    alone, run = [Simulation(sim.model).evaluate(row[None]) for row in v], Simulation(sim.model)
    in_turn = [run.evaluate(row[None]) for row in v]
    for found, rows, later in zip(
        together, zip(*alone, strict=True), zip(*in_turn, strict=True), strict=True
    ):
        assert np.array_equal(found, np.concatenate(rows), equal_nan=True)
        assert np.array_equal(found, np.concatenate(later), equal_nan=True)
        assert np.isfinite(found).sum() > 0.9 * found.size


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [True, False])
def test_tables_that_are_zero_in_a_cell_come_back(numbers, content, make_aircraft, make_tree):
    """Flights pass over tables whose cell has zeros only, ground effect aloft; rows at once do not.
    Narrow bundles of all sizes.
    """
    rng = np.random.default_rng(4)
    points = {
        "h_agl": np.array([0.0, 1.0, 2.0, 3.0]),
        "alpha": np.array([0.0, 1.0, 2.0]),
        "beta": np.array([-1.0, 1.0]),
        "mach": np.array([0.0, 2.0]),
    }
    more = {}
    for axes in range(1, 5):
        for count, head in enumerate(("CL", "CD", "Cm", "CY"), 1):
            names = list(points)[:axes] if count < 4 else list(points)[-axes:]
            grid = {name: points[name] + 0.01 * count * (name == "h_agl") for name in names}
            for i in range(count):
                value = rng.normal(size=[len(p) for p in grid.values()])
                if "h_agl" in grid:
                    value[2:] = 0.0
                more[f"{head}/aloft{axes}{i}"] = make_term(value, grid)
    sim = flightmech.compile(make_aircraft(), make_tree({**content, **more}))
    v = np.zeros((400, len(sim.variables)))
    ranges = {"h_agl": (-0.5, 6.0), "alpha": (-0.5, 2.5), "beta": (-1.2, 1.2), "mach": (0.0, 2.1)}
    for name, (low, high) in ranges.items():
        v[:, sim.variables.index(name)] = rng.uniform(low, high, len(v))
        if not numbers:
            v[rng.integers(0, len(v), 20), sim.variables.index(name)] = np.nan
    run = Simulation(sim.model)
    together, in_turn = Simulation(sim.model).evaluate(v), [run.evaluate(row[None]) for row in v]
    for found, rows in zip(together, zip(*in_turn, strict=True), strict=True):
        assert np.array_equal(found, np.concatenate(rows), equal_nan=True)
    if numbers:
        ground = [
            sim.terms.index(name) for name, leaf in more.items() if "h_agl" in leaf["value"].dims
        ]
        h = v[:, sim.variables.index("h_agl")]
        assert (together[1][h > 2.05][:, ground] == 0.0).all()
        assert (together[1][h < 1.95][:, ground] != 0.0).all()
