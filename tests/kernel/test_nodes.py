"""Parts of tables as parameters: the same as a model compiled with the changed table."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import SimulationError, UnknownName
from flightmech.simulation.kernel import PARAMETER, Simulation
from flightmech.terms import make_term

HELD = {
    "init.V": 90.0,
    "init.h": 1500.0,
    "init.alpha": 0.06,
    "engine1.throttle": 0.6,
    "engine2.throttle": 0.6,
    "gear": 0.3,
    "delta_f": 0.2,
}


@pytest.fixture(scope="module")
def record() -> xr.Dataset:
    t = np.arange(0.0, 2.0, 0.02)
    return xr.Dataset(
        {"delta_e": ("time", -0.05 * np.sin(3.0 * t)), "delta_r": ("time", 0.04 * np.sin(2.0 * t))},
        {"time": t},
    )


def flown(sim, record, **extra):
    return flightmech.simulate(sim, record, HELD | extra)


def changed(content, name: str, table: str, change):
    """Return the content with one table of a term changed."""
    leaf = content[name].copy(deep=True)
    change(leaf[table].values)
    return content | {name: leaf}


def set_node(index, value):
    def change(values):
        values[index] = value

    return change


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameter", "name", "table", "index", "value"),
    [
        ("node.CL.basic[3,1]", "CL/basic", "value", (3, 1), 0.9),
        ("node.Cm.basic[2]", "Cm/basic", "value", (2,), 0.06),
        ("node.Cn.basic[2,0,0,1]", "Cn/basic", "value", (2, 0, 0, 1), 0.02),
        ("node.CD.gear.K1[0]", "CD/gear", "K1", (0,), 0.5),
        ("node.CL.qhat", "CL/qhat", "value", (), 9.0),
    ],
)
def test_a_node_is_a_parameter(
    parameter, name, table, index, value, sim, content, record, make_aircraft, make_tree
):
    counterpart = flightmech.compile(
        make_aircraft(), make_tree(changed(content, name, table, set_node(index, value)))
    )
    run = Simulation(sim.model)
    assert run.parameter(sim.model.find(PARAMETER, parameter)) == content[name][table].values[index]
    ours, theirs = flown(sim, record, **{parameter: value}), flown(counterpart, record)
    for channel in ("alpha", "theta", "p", "CL", "CD", "Cn"):
        # the two add the same numbers in another order
        np.testing.assert_allclose(
            ours[channel], theirs[channel], rtol=1e-10, atol=1e-12, err_msg=channel
        )
    assert float(abs(ours["theta"] - flown(sim, record)["theta"]).max()) > 1e-9


def test_scale_and_offset_of_a_table(sim, content, record, make_aircraft, make_tree):
    def change(values):
        values *= 1.1
        values += 0.003

    counterpart = flightmech.compile(
        make_aircraft(), make_tree(changed(content, "CD/basic", "value", change))
    )
    # offset and scale apply in this order whatever the order of the calls
    ours = flown(sim, record, **{"offset.CD.basic": 0.003, "table.CD.basic": 1.1})
    np.testing.assert_allclose(ours["V"], flown(counterpart, record)["V"], rtol=1e-12)


def test_the_last_value_of_a_node_holds(sim):
    run = Simulation(sim.model)
    i = sim.model.find(PARAMETER, "node.CL.basic[3,1]")
    first = run.parameter(i)
    run.set_parameter(i, 2.0)
    run.set_parameter(i, 3.0)
    assert run.parameter(i) == 3.0
    assert run.copy().parameter(i) == 3.0
    run.set_parameter(i, first)
    assert run.parameter(i) == first


@pytest.mark.parametrize(
    "name",
    [
        "node.CL.basic[6,0]",
        "node.CL.basic[3]",
        "node.CL.basic",
        "node.CL.nothing[0]",
        "table.CL.basic[0]",
        "node.CL.qhat.K1[0]",
    ],
)
def test_what_is_not_there_is_refused(name, sim, record):
    with pytest.raises(UnknownName, match=r"a table has node.CL.basic\[3,1\]"):
        flown(sim, record, **{name: 1.0})


def test_too_many_changes_are_refused(make_aircraft, make_tree):
    wide = make_term(np.zeros(300), {"alpha": np.linspace(-1.0, 1.0, 300)})
    sim = flightmech.compile(make_aircraft(), make_tree({"CL/basic": wide}))
    run = Simulation(sim.model)
    first = sim.model.find(PARAMETER, "node.CL.basic[0]")
    for i in range(256):
        run.set_parameter(first + i, 1.0)
    run.set_parameter(first, 2.0)
    with pytest.raises(SimulationError, match="more than 256 nodes, scales and offsets"):
        run.set_parameter(first + 256, 1.0)
    with pytest.raises(SimulationError, match="must be finite"):
        run.set_parameter(first, float("nan"))
    with pytest.raises(SimulationError, match="there is no parameter"):
        run.set_parameter(10**9, 1.0)
