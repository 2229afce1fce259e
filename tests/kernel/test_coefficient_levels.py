"""Terms that depend on coefficients: values of the same instant, in all force axes, with and
without implicit variables.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import axes, terms
from flightmech.build_up import evaluation_levels, term_level
from flightmech.errors import SchemaError
from flightmech.simulation.kernel import Simulation
from flightmech.terms import PowerFactor, make_term

ALPHA = np.array([-0.2, 0.0, 0.1, 0.3])
POLAR = make_term([0.05, 0.021, 0.03, 0.11], {"CL": [-0.5, 0.1, 0.6, 1.4]})
COUNT = ("CL", "CD", "CY", "Cl", "Cm", "Cn")


def implicit(name: str) -> dict[str, xr.Dataset]:
    """Terms that make a force depend on its own acceleration."""
    return {
        f"{name}/alphadothat": make_term(1.3, regressors=["alphadothat"]),
        "Cm/alphadothat": make_term(-4.0, regressors=["alphadothat"]),
    }


def content(force_axes: str) -> dict[str, xr.Dataset]:
    """A chain of three steps: lift (or axial and normal force), drag (or side force), moments."""
    common = {
        "CY/beta": make_term(-0.6, regressors=["beta"]),
        "Cl/ground": make_term(-0.05, regressors=["CL", "phi"]),
        "Cm/basic": make_term(0.03 - 0.7 * ALPHA, {"alpha": ALPHA}),
        "Cn/beta": make_term(
            [0.08, 0.1, 0.07], {"CL": [-0.2, 0.5, 1.0]}, ["beta"], outside="linear"
        ),
        "Cn/roll": make_term(0.02, regressors=["Cl", "Cl"]),
    }
    if force_axes == "body":
        return common | {
            "CZ/basic": make_term(-0.2 - 4.5 * ALPHA, {"alpha": ALPHA}),
            "CX/basic": make_term([0.1, -0.02, -0.03], {"CZ": [-1.2, -0.3, 0.4]}),
            "CY/normal": make_term(0.01, regressors=["CZ", "CX"]),
            "Cm/drag": make_term(0.4, regressors=["CD"]),
        }
    return common | {
        "CL/basic": make_term(0.25 + 4.8 * ALPHA, {"alpha": ALPHA}),
        "CD/basic": POLAR,
        "CD/induced": make_term(0.02, regressors=["CL", "CL"]),
        "CD/power": make_term(
            0.004,
            power=PowerFactor("CL", 1.5, 0.01),
            K1=xr.DataArray([1.0, 1.2], {"mach": [0.1, 0.8]}, ("mach",)),
        ),
        "Cm/drag": make_term([-0.1, 0.0, 0.2], {"CD": [0.01, 0.05, 0.2]}),
        "CY/drag": make_term(0.1, regressors=["CD", "beta"]),
    }


def by_hand(leaves, force_axes, at):
    """Coefficients of a database in its own axes, one after the other in the order of the chain."""
    order = ("CZ", "CX", "CY") if force_axes == "body" else ("CL", "CD", "CY")
    found = dict(at)
    for name in (*order, "Cl", "Cm", "Cn"):
        found[name] = sum(
            float(terms.evaluate_term(leaf, found, "clamp"))
            for key, leaf in leaves.items()
            if key.split("/")[0] == name
        )
        if name == "CX":
            found["CL"], found["CD"] = axes.lift_drag(found["CX"], found["CZ"], at["alpha"])
    return found


@pytest.mark.parametrize("own", [False, True], ids=["explicit", "implicit"])
@pytest.mark.parametrize("force_axes", ["stability", "wind", "body"])
def test_the_values_are_those_of_the_same_instant(force_axes, own, make_aircraft, make_tree, flown):
    leaves = content(force_axes) | (implicit("CZ" if force_axes == "body" else "CL") if own else {})
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(leaves, force_axes=force_axes))
    for alpha, beta, q in [(0.05, 0.1, 0.0), (0.21, -0.2, 0.3), (-0.15, 0.0, -0.2)]:
        y = flown(
            sim,
            init__V=90.0,
            init__alpha=alpha,
            init__beta=beta,
            init__q=q,
            init__phi=0.4,
            init__h=500.0,
        )
        at = {name: y[name] for name in ("alpha", "beta", "mach", "phi")} | {
            "alphadothat": y["alpha_dot"] * 1.67 / (2.0 * y["V"])
        }
        found = by_hand(leaves, force_axes, at)
        if force_axes == "wind":
            ca, sa = np.cos(y["beta"]), np.sin(y["beta"])
            found["CD"], found["CY"] = (
                found["CD"] * ca + found["CY"] * sa,
                -found["CD"] * sa + found["CY"] * ca,
            )
        np.testing.assert_allclose(
            [y[name] for name in COUNT], [found[name] for name in COUNT], rtol=2e-14, atol=1e-16
        )
        force = (
            y["qbar"]
            * 17.0
            * axes.stability_to_body([-found["CD"], found["CY"], -found["CL"]], y["alpha"])
        )
        np.testing.assert_allclose(
            np.array([y["ax"], y["ay"], y["az"]]) * 2300.0, force, rtol=1e-13, atol=1e-9
        )


def test_contributions_and_many_rows(make_aircraft, make_tree):
    """The model alone takes a coefficient as a given variable; a flight shows the contributions of
    its last derivative.
    """
    leaves = content("stability") | implicit("CL")
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(leaves))
    draw = np.random.default_rng(3).uniform
    columns = {name: draw(-0.3, 0.8, 200) for name in sim.variables}
    table = np.stack([columns[name] for name in sim.variables], axis=1)
    many, few = (
        Simulation(sim.model).evaluate(table)[1],
        Simulation(sim.model).evaluate(table[:5])[1],
    )
    assert (many[:5] == few).all()
    for name, leaf in leaves.items():
        np.testing.assert_allclose(
            many[:, sim.terms.index(name)],
            terms.evaluate_term(leaf, columns, "clamp"),
            rtol=1e-13,
            atol=1e-16,
        )
    flight = {"init.V": 80.0, "init.alpha": 0.1, "init.beta": 0.05, "init.phi": 0.2}
    y = flightmech.simulate(sim, xr.Dataset(coords={"time": [0.0, 0.5]}), flight, terms=True)
    for name in COUNT:
        parts = y["contribution"].sel(
            term=[term for term in sim.terms if term.startswith(name + "/")]
        )
        np.testing.assert_allclose(parts.sum("term"), y[name], rtol=1e-13)


def test_a_bias_and_a_changed_node_of_lift_change_the_drag(make_aircraft, make_tree, flown):
    leaves = {
        "CL/basic": make_term(0.4),
        "CD/basic": make_term([0.02, 0.06], {"CL": [0.0, 1.0]}),
        "CD/induced": make_term(0.05, regressors=["CL", "CL"]),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(leaves))
    assert flown(sim, init__V=90.0)["CD"] == pytest.approx(0.036 + 0.05 * 0.16, rel=1e-14)
    assert flown(sim, init__V=90.0, bias__CL=0.1)["CD"] == pytest.approx(
        0.04 + 0.05 * 0.25, rel=1e-14
    )
    run = Simulation(sim.model)
    for name, value in [("node.CD.basic[1]", 0.12), ("init.V", 90.0)]:
        run.set_parameter(sim.model.find(2, name), value)
    run.initialize()
    assert run.outputs()[sim.outputs.index("CD")] == pytest.approx(
        0.02 + 0.4 * 0.1 + 0.05 * 0.16, rel=1e-14
    )


@pytest.mark.parametrize(
    ("leaves", "text"),
    [
        (
            {
                "CL/a": make_term(0.1, regressors=["CD"]),
                "CD/b": make_term([0.0, 1.0], {"CL": [0.0, 1.0]}),
            },
            r"CL -> CD -> CL \(terms CD/b, CL/a\)",
        ),
        ({"CL/a": make_term(0.1, regressors=["CL"])}, r"CL -> CL \(terms CL/a\)"),
        (
            {
                "Cm/a": make_term(0.1, power=PowerFactor("Cn", 2.0, 0.1)),
                "Cn/b": make_term(1.0, regressors=["Cm"]),
            },
            "Cm -> Cn -> Cm|Cn -> Cm -> Cn",
        ),
        (
            {"CD/a": make_term(0.1, regressors=["CZ"])},
            "CD/a: depends on CZ, which a model with force_axes stability does not have",
        ),
        (
            {"CD/a": make_term(0.1, regressors=["CL", "dnz"])},
            "CD/a: depends on CL and on dnz, of which only one can be solved for",
        ),
        (
            {"Ch_e/a": make_term(0.1, regressors=["CL"])},
            "Ch_e/a: .*only terms of CL, CD, .* can depend on CL",
        ),
    ],
)
def test_what_has_no_order_is_refused(leaves, text, make_aircraft, make_tree):
    with pytest.raises(SchemaError, match=text):
        flightmech.compile(
            make_aircraft(engines=()),
            make_tree({"CL/basic": make_term(0.1), "CD/basic": make_term(0.02), **leaves}),
        )


def test_a_force_of_the_body_axes_cannot_depend_on_lift(make_aircraft, make_tree):
    leaves = {"CX/a": make_term(0.1, regressors=["CL"]), "CZ/a": make_term(0.1)}
    with pytest.raises(SchemaError, match="CX -> CX"):
        flightmech.compile(make_aircraft(engines=()), make_tree(leaves, force_axes="body"))


def test_levels():
    found, problems = evaluation_levels(content("stability"), "stability")
    assert not problems
    assert found == {"CL": 0, "CD": 1, "CY": 2, "Cl": 1, "Cm": 2, "Cn": 2}


def test_trim_and_linear_model_follow_the_polar(make_aircraft, make_tree):
    """CD(CL(alpha)) flies as the same drag written over alpha does."""
    knots = np.array([-0.1, 0.0, 0.1, 0.2, 0.3])
    lift = 0.2 + 4.5 * knots
    over_alpha = make_term(0.02 + 0.05 * lift**2, {"alpha": knots})
    over_lift = make_term(0.02 + 0.05 * lift**2, {"CL": lift})
    slopes = {
        "Cm/alpha": -0.7,
        "Cm/delta_e": -1.0,
        "CY/beta": -0.5,
        "Cl/phat": -0.4,
        "Cn/beta": 0.1,
    }
    rest = {"CL/basic": make_term(lift, {"alpha": knots})} | {
        name: make_term(k, regressors=[name.split("/")[1]]) for name, k in slopes.items()
    }
    one, two = (
        flightmech.compile(make_aircraft(), make_tree(rest | {"CD/polar": drag}))
        for drag in (over_alpha, over_lift)
    )
    flight = {"init.V": 90.0, "init.h": 1000.0, "mode.engine": 2.0}
    expected, found = (flightmech.linearisation.linearize(sim, flight) for sim in (one, two))
    np.testing.assert_allclose(
        found["y"], expected["y"], atol=1e-10
    )  # where the search of the trim ends
    np.testing.assert_allclose(found["A"], expected["A"], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("leaves", "shift", "text"),
    [
        (
            {"CL/a": make_term(0.1, regressors=["CD"]), "CD/a": make_term(0.1, regressors=["CL"])},
            0,
            "coefficients depend on each other in a loop",
        ),
        (
            {"CL/a": make_term(0.1), "CD/a": make_term([0.0, 1.0], {"CL": [0.0, 1.0]})},
            -1,
            "CL is not yet known where a table needs it",
        ),
        (
            {"CL/a": make_term(0.1), "CD/a": make_term([0.0, 1.0], {"CL": [0.0, 1.0]})},
            1,
            "term CD/a refers to a table outside its stage",
        ),
        (
            {"CL/a": make_term(0.1), "CD/a": make_term(0.1, regressors=["CZ"])},
            0,
            "term CD/a depends on a coefficient of other force axes",
        ),
    ],
)
def test_the_kernel_checks_the_order_by_itself(
    leaves, shift, text, make_aircraft, make_tree, monkeypatch
):
    """A block of another writer: what the compiler refuses, and tables looked up a level too early
    or too late.
    """

    def unchecked(found, force_axes):
        of, _ = evaluation_levels({term.name: term.leaf for term in found}, force_axes)
        return [
            term._replace(level=term_level(term.leaf, of, force_axes) + shift) for term in found
        ], []

    monkeypatch.setattr("flightmech.simulation.compiler._assign_levels", unchecked)
    with pytest.raises(SchemaError, match=text):
        flightmech.compile(make_aircraft(engines=()), make_tree(leaves))
