"""What cannot act is not evaluated: no bit of a flight may show it."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.simulation.kernel import PARAMETER, Simulation
from flightmech.terms import PowerFactor, make_term

TIME = np.arange(0.0, 6.01, 0.02)
START = {"init.V": 110.0, "init.h": 60.0, "mode.trim": 1}


def as_table(name: str, value: float, further: list[str]) -> xr.Dataset:
    """The term `value` times a switch, as a table over the switch, which is never left out: the
    same bits.
    """
    return make_term([0.0, value], {name: [0.0, 1.0]}, further)


def as_regressor(name: str, value: float, further: list[str]) -> xr.Dataset:
    return make_term(value, regressors=[name, *further])


@pytest.fixture(scope="module")
def switched(make_aircraft, make_tree, content):
    """The jet with terms of flaps, brake and wheels that a function makes."""
    return lambda make_leaf: flightmech.compile(
        make_aircraft(), make_tree(content | _of_switches(make_leaf))
    )


def _of_switches(make_leaf) -> dict[str, xr.Dataset]:
    return {
        "CL/flaps": make_leaf("delta_f", 0.5, []),
        "CD/brake": make_leaf("speedbrake", 0.0625, []),
        "Cm/brake": make_leaf("speedbrake", -0.03125, []),
        "Cl/flaps": make_leaf("delta_f", 0.25, ["beta"]),
        "Cn/wheels": make_leaf("gear", 0.125, ["rhat"]),
    }


def moved() -> xr.Dataset:
    """Flaps, brake and wheels that leave zero and come back, each at times of its own."""
    out = {
        "delta_f": np.clip(TIME - 1.0, 0.0, 0.5) - np.clip(TIME - 4.0, 0.0, 0.5),
        "speedbrake": 1.0 * ((TIME > 0.5) & (TIME < 2.0)),
        "gear": np.clip(TIME - 3.0, 0.0, 1.0),
        "delta_r": 0.02 * np.sin(TIME),
    }
    return xr.Dataset({name: ("time", value) for name, value in out.items()}, {"time": TIME})


def flickering() -> xr.Dataset:
    """The same, but for the brake, which is in at every other sample: fewer evaluations than any
    wait.
    """
    brake = np.where(np.arange(TIME.size) % 2, moved()["speedbrake"].values, 0.0)
    return moved().assign(speedbrake=("time", brake))


@pytest.mark.slow
@pytest.mark.parametrize("inputs", [moved, flickering])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_term_that_is_switched_off_comes_back(switched, scale, inputs):
    """A multiplier of zero leaves its terms out; the same terms as tables, which stay, give the
    same bits.
    """
    scales = {f"term.{name}": scale for name in ("CL.flaps", "Cm.brake", "Cl.flaps")}
    of_terms, of_tables = (
        flightmech.simulate(switched(way), inputs(), START | scales)
        for way in (as_regressor, as_table)
    )
    assert float(of_terms["CL"].max() - of_terms["CL"].min()) > 0.1
    compared = set(of_terms.data_vars) - {"out_of_range"}  # the tables have ends
    assert [
        name
        for name in compared
        if of_terms[name].values.tobytes() != of_tables[name].values.tobytes()
    ] == []


def test_contributions_of_terms_that_are_left_out(switched):
    """A term that is off contributes zero, one that is on what its table gives."""
    found = flightmech.simulate(switched(as_regressor), moved(), START, terms=True)
    assert (
        found["contribution"].sel(term="CD/brake").values == 0.0625 * moved()["speedbrake"].values
    ).all()


MORE = {
    "CL/more": make_term([0.0, 0.5], {"alpha": [-0.5, 0.5]}),
    "Cm/more": make_term(0.25, regressors=["qhat"]),
    "CD/implicit": make_term(0.125, regressors=["alphadothat"]),
    "Ch_e/more": make_term(0.5, regressors=["alpha"]),
    "Ch_r/more": make_term([-0.25, 0.25], {"delta_r": [-0.5, 0.5]}),
}
"""Terms of every kind of target: with and without others, in a table, with an implicit variable."""


@pytest.fixture(scope="module")
def with_circuits(make_aircraft, make_tree, content):
    """The jet with column and pedals, and a model of it with further terms."""
    circuits = {
        "column": Circuit((-0.15, 0.2), 6.0, inertia=1.0, damping=10.0),
        "pedal": Circuit((-0.1, 0.1), 8.0, inertia=0.5, damping=20.0),
    }
    controls = {
        "delta_e": ControlGeometry(1.5, 0.35, -1.2),
        "delta_r": ControlGeometry(0.6, 0.3, -2.5),
    }
    aircraft, own = (
        make_aircraft(circuits=circuits, controls=controls),
        content | {"Ch_e/delta": make_term(-0.1, regressors=["delta_e"])},
    )
    return lambda more: flightmech.compile(aircraft, make_tree(own | more))


@pytest.mark.parametrize("driven", [0, 2])
def test_a_term_of_scale_zero_is_as_none(with_circuits, driven):
    start = START | {"mode.controls": driven}
    scales = {f"term.{name.replace('/', '.')}": 0.0 for name in MORE}
    none = flightmech.simulate(with_circuits({}), moved(), start)
    zero = flightmech.simulate(with_circuits(MORE), moved(), start | scales, terms=True)
    assert [
        name
        for name in none.data_vars
        if none[name].values.tobytes() != zero[name].values.tobytes()
    ] == []
    assert not zero["contribution"].sel(term=list(MORE)).values.any()


def test_a_scale_that_becomes_zero_between_derivatives(sim, start):
    """All terms of a coefficient go and come back."""
    run = start(sim, init__V=110.0, init__h=2000.0)
    u = np.where(np.array(sim.inputs) == "delta_r", 0.05, 0.0)
    scales = [i for i, name in enumerate(sim.parameters) if name.startswith("term.Cn.")]
    whole = run.derivative(run.state, u)
    for i in scales:
        run.set_parameter(i, 0.0)
    none = run.derivative(run.state, u)
    assert abs(none[12] - whole[12]) > 1e-3
    for i in scales:
        run.set_parameter(i, 1.0)
    assert run.derivative(run.state, u).tobytes() == whole.tobytes()


def test_scales_that_become_zero_between_outputs(with_circuits, start, flown):
    """The hinge moment of a surface that no term is left of is zero, not what it was."""
    sim, flight = (
        with_circuits(MORE),
        {"init__V": 110.0, "init__h": 2000.0, "init__alpha": 0.1, "delta_r": 0.05},
    )
    run = start(sim, **flight)
    forces = [sim.outputs.index(name) for name in ("column.F_aer", "pedal.F_aer")]
    assert abs(run.outputs()[forces]).min() > 1.0
    for name in MORE:
        run.set_parameter(sim.parameters.index(f"term.{name.replace('/', '.')}"), 0.0)
    left = flown(with_circuits({}), **flight)
    assert run.outputs()[forces].tolist() == [left["column.F_aer"], left["pedal.F_aer"]]
    assert left["pedal.F_aer"] == 0.0


def test_contributions_of_scales_that_become_zero(with_circuits, start):
    sim = with_circuits(MORE)
    run = start(sim, init__V=110.0, init__h=2000.0, init__alpha=0.1)
    time, more = (
        np.array([0.0, 0.02]),
        [sim.terms.index(name) for name in ("CL/more", "Ch_e/more", "Ch_r/more")],
    )
    u = np.tile(np.where(np.array(sim.inputs) == "delta_r", 0.05, 0.0), (2, 1))

    def contributions() -> np.ndarray:
        return run.record(time, u, False, np.array([0]), True)[1][0, more]

    assert contributions().all()
    for name in MORE:
        run.set_parameter(sim.parameters.index(f"term.{name.replace('/', '.')}"), 0.0)
    time += 0.02
    assert not contributions().any()


def test_what_was_looked_up_before_does_not_matter(sim, start):
    """Tables whose axes stand still are kept: in any order of states each has the bits of a
    simulation that sees it first.
    """
    rng = np.random.default_rng(2)
    first = start(sim, init__V=110.0, init__h=30.0)
    x, n = first.state, len(sim.inputs)
    states = [
        np.concatenate([x[:3], x[3:6] * (1.0 + 0.02 * rng.standard_normal(3)), x[6:]])
        for _ in range(3)
    ]
    inputs = [
        np.zeros(n),
        np.where(np.array(sim.inputs) == "delta_f", 0.3, 0.0),
        rng.uniform(0.0, 0.2, n),
    ]
    used = first.copy()
    for pick in rng.integers(0, 3, (60, 2)):
        at, u = states[pick[0]], inputs[pick[1]]
        assert used.derivative(at, u).tobytes() == first.copy().derivative(at, u).tobytes()


@pytest.mark.parametrize("changed", ["node.CL.elevator[1]", "table.Cn.basic", "offset.Cm.elevator"])
def test_a_table_that_is_changed_between_derivatives(sim, start, changed):
    run = start(sim, init__V=110.0, init__h=2000.0)
    u = np.where(np.array(sim.inputs) == "delta_e", 0.05, 0.0)
    before = run.derivative(run.state, u)
    index = sim.model.find(PARAMETER, changed)
    old = run.parameter(index)
    run.set_parameter(index, old + 0.01)
    assert run.derivative(run.state, u).tobytes() != before.tobytes()
    run.set_parameter(index, old)
    assert run.derivative(run.state, u).tobytes() == before.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("gamma", [-0.0095, -0.2])
@pytest.mark.parametrize("exponent", [-7.5, -1.5, 0.5, 9.0])
def test_a_power_in_a_step_is_that_of_whole_derivatives(
    make_aircraft, make_tree, content, exponent, gamma
):
    """The later slopes find a power from that of the first by a series where the height changes by
    less than 4e-4 of it, here 3.5e-4.  1e-9 m of a position, its rounding, are 3e-10 m/s after the
    step; the term of the series in u^3 is 2e-9 m/s.
    """
    low = make_term(0.5 * 30.0**-exponent, power=PowerFactor("h_agl", exponent, 1.0))
    sim = flightmech.compile(make_aircraft(), make_tree(content | {"CL/low": low}))
    run = Simulation(sim.model)
    for name, value in {"init.V": 110.0, "init.h": 30.0, "init.gamma": gamma}.items():
        run.set_parameter(sim.parameters.index(name), value)
    run.initialize()
    u, h, x = np.zeros(len(sim.inputs)), 0.01, run.state
    other = run.copy()
    k1 = other.derivative(x, u)
    k2 = other.derivative(x + 0.5 * h * k1, u)
    k3 = other.derivative(x + 0.5 * h * k2, u)
    k4 = other.derivative(x + h * k3, u)
    run.step(0.0, h, u, u)
    expected = h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    assert run.state[3:13] - x[3:13] == pytest.approx(expected[3:13], rel=0.0, abs=4e-10)
