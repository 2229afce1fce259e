"""DAVE-ML functions that no product of tables gives: sampled within a bound, or refused."""

import re

import numpy as np
import pytest
from daveml_files import (
    ALPHAS,
    MACHS,
    RUDDERS,
    apply,
    ci,
    cn,
    in_file,
    made,
    one,
    states,
    table,
    values,
    variable,
)

import aerodb
from aerodb.exchange.daveml.document.reading import read
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

LIMITED = {name: variable(name) for name in ("T", "U", "W")}
SAMPLED = [
    (apply("times", cn(0.1), apply("sin", apply("times", cn(0.05), ci("AL")))),
     table("T", values(4), AL=ALPHAS), {"alpha"}),
    # one variable limited by another, as a body flap by the elevator
    (apply("times", cn(0.02), apply("min", ci("AL"), apply("times", cn(0.5), ci("RUD")))),
     table("T", values(4), AL=ALPHAS)
     + table("U", values(3), RUD=RUDDERS), {"alpha", "delta_r"}),
    # tables of one variable multiplied, with a factor that stays exact
    (apply("times", ci("T"), ci("U"), ci("EL")), table("T", values(4), AL=ALPHAS)
     + table("U", values(4), AL=[-10.0, 5.0, 12.0, 25.0]), {"alpha"}),
    (apply("times", ci("T"), apply("divide", cn(0.1), apply("plus", ci("XMACH"), cn(1.0)))),
     table("T", values(12), AL=ALPHAS, XMACH=MACHS), {"alpha", "mach"}),
    (ci("T"), table("T", values(4), AL=(ALPHAS, 'interpolate="cubicSpline"')), {"alpha"}),
    (ci("T"), table("T", values(4), MEAN=ALPHAS) + table("U", values(4), AL=ALPHAS)
     + table("W", values(3), RUD=RUDDERS), {"alpha", "delta_r"}),
]  # fmt: skip


@pytest.mark.nightly
@pytest.mark.parametrize(("math", "functions", "over"), SAMPLED)
def test_what_no_table_gives_is_sampled_within_the_bound_and_states_it(
    tmp_path, math, functions, over
):
    more = variable(
        "mean",
        made(apply("times", cn(0.5), apply("plus", ci("AL"), ci("RUD"))), ""),
        "MEAN",
        units="deg",
    )
    sum_of_both = apply("plus", apply("times", ci("AL"), cn(0.01)), math)
    used = "".join(
        text
        for name, text in LIMITED.items()
        if f'output="{name}"' in functions or f'varID="{name}"' in functions
    )
    path = one(tmp_path, sum_of_both, used + more, functions)
    with pytest.raises(SchemaError, match="put them onto tables with sample="):
        aerodb.exchange.import_daveml(path)
    db = aerodb.exchange.import_daveml(path, sample=0.02)
    leaves = aerodb.terms(db)
    sampled = {name: leaf for name, leaf in leaves.items() if "sampled" in leaf.attrs}
    assert {str(axis) for leaf in sampled.values() for axis in leaf.dims} == over
    assert float(leaves["CL/alpha"]["value"]) == pytest.approx(
        0.01 / DEGREE, rel=1e-12
    )  # what is exact stays exact
    assert re.search(
        r"CL differs from the file by at most [\d.e-]+ at 5000 states, allowed 0.02",
        db.attrs["history"],
    )
    random, count = np.random.default_rng(5), 4000
    ends = {"alpha": (-10, 25), "mach": (0.3, 2.0), "delta_r": (0, 30), "delta_e": (-20, 20)}
    state = states(count) | {
        n: random.uniform(*e, count) * (1.0 if n == "mach" else DEGREE) for n, e in ends.items()
    }
    gap = np.abs(
        aerodb.evaluate(db, "CL", outside="clamp", **state)
        - read(path).evaluate(in_file(state))["OUT"]
    )
    assert 1e-9 < gap.max() <= 0.02


def test_the_grid_of_a_sampled_function_is_chosen_or_given(tmp_path):
    path = one(tmp_path, apply("sin", apply("times", cn(0.05), ci("AL"))))
    with pytest.raises(
        SchemaError,
        match=r"no table and no limit states how far alpha goes; give grid=\{'alpha': \(low, "
        r"high\)\}",
    ):
        aerodb.exchange.import_daveml(path, sample=1e-3)
    ranged = aerodb.terms(
        aerodb.exchange.import_daveml(path, sample=1e-3, grid={"alpha": (-0.2, 0.4)})
    )["CL/basic"]
    assert ranged["alpha"].values[[0, -1]].tolist() == [-0.2, 0.4]
    assert ranged.sizes["alpha"] > 5
    given = aerodb.terms(
        aerodb.exchange.import_daveml(path, sample=0.2, grid={"alpha": [-0.2, 0.1, 0.4]})
    )["CL/basic"]
    assert given["alpha"].values.tolist() == [-0.2, 0.1, 0.4]
    assert given["value"].values == pytest.approx(
        np.sin(0.05 * np.degrees([-0.2, 0.1, 0.4])), rel=1e-14
    )
    with pytest.raises(
        SchemaError,
        match=r"(?s)sample=0.001 is not kept; give more breakpoints with grid=.*CL differs from "
        r"OUT by 0\.0",
    ):
        aerodb.exchange.import_daveml(path, sample=1e-3, grid={"alpha": [-0.2, 0.1, 0.4]})
    with pytest.raises(ValueError, match="give sample=, the largest difference allowed"):
        aerodb.exchange.import_daveml(path, grid={"alpha": (-0.2, 0.4)})


def test_jumps_and_functions_of_too_many_variables_cannot_be_sampled(tmp_path):
    jump = (
        f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(1.0))}</piece>"
        f"<otherwise>{cn(2.0)}</otherwise></piecewise>"
    )
    with pytest.raises(SchemaError, match=r"cannot be sampled: it jumps near beta = 0\.01745"):
        aerodb.exchange.import_daveml(one(tmp_path, jump), sample=1e-3, grid={"beta": (-0.2, 0.3)})
    many = apply("sin", apply("plus", *(ci(name) for name in ("AL", "BE", "XMACH", "RUD", "EL"))))
    ranges = dict.fromkeys(("alpha", "beta", "mach", "delta_r", "delta_e"), (0.0, 0.1))
    with pytest.raises(
        SchemaError,
        match="it depends on alpha, beta, delta_e, delta_r, mach; a table has at most 4 axes",
    ):
        aerodb.exchange.import_daveml(one(tmp_path, many), sample=1e-3, grid=ranges)


@pytest.mark.slow
def test_surfaces_of_a_lifting_body_are_sampled_and_the_powers_of_alpha_stay_exact(tmp_path):
    """Cubics in alpha over tables of the mean of two elevons, and of a body flap that the elevon
    limits.
    """
    surfaces = ("WEL", "WER", "FLAP")
    variables = "".join(
        variable(name, "<isInput/>", name, units="deg", minValue="-30", maxValue="30")
        for name in surfaces
    )
    mean = apply("times", cn(0.5), apply("plus", ci("WEL"), ci("WER")))
    variables += variable("mean", made(mean, ""), "DE", units="deg")
    variables += variable(
        "limited",
        made(apply("min", ci("FLAP"), apply("plus", ci("WEL"), cn(20.0))), ""),
        "BF",
        units="deg",
    )
    points, functions, total = [-30.0, -15.0, 0.0, 15.0, 30.0], "", []
    for name, surface, size in (("E", "DE", 0.3), ("B", "BF", 0.05)):
        cubic = ci(f"{name}3")
        for i in range(4):
            variables += variable(f"{name}{i}")
            shape = (
                np.outer(np.tanh(np.array(points) / 25.0), 1.0 / (1.0 + np.array(MACHS)))
                * size
                * 0.03**i
            )
            functions += table(
                f"{name}{i}", shape.ravel().tolist(), **{surface: points, "XMACH": MACHS}
            )
        for i in (2, 1, 0):
            cubic = apply("plus", ci(f"{name}{i}"), apply("times", ci("AL"), cubic))
        total.append(cubic)
    path = one(tmp_path, apply("plus", *total), variables, functions)
    with pytest.warns(AeromatchWarning, match="WEL is device"):
        db = aerodb.exchange.import_daveml(path, sample=0.02, grid={"alpha": (-0.15, 0.45)})
    leaves = aerodb.terms(db)
    assert {leaf.attrs["regressors"] for leaf in leaves.values()} == {
        "",
        "alpha",
        "alpha alpha",
    }  # alpha is not a sampled axis
    random, count = np.random.default_rng(3), 3000
    state = {
        f"device.{name}.deflection": random.uniform(-30, 30, count) * DEGREE for name in surfaces
    }
    state |= {"alpha": random.uniform(-0.15, 0.45, count), "mach": random.uniform(0.3, 2.0, count)}
    given = {name: state[f"device.{name}.deflection"] / DEGREE for name in surfaces}
    expected = read(path).values(
        ["OUT"], given | {"AL": state["alpha"] / DEGREE, "XMACH": state["mach"]}
    )["OUT"]
    gap = np.abs(aerodb.evaluate(db, "CL", outside="clamp", **state) - expected).max()
    assert 1e-6 < gap <= 0.02
    assert np.abs(expected).max() > 0.4
