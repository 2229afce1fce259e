"""Outputs of the validity envelope: the look-up of Python, in single runs, lanes and FMUs; models
without one keep their bytes.
"""

import struct
import zlib
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.envelope.envelope import make_envelope
from flightmech.errors import SchemaError
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.fmu_export.description import describe_model
from flightmech.fmu_export.model_description import render_model_description
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.simulation.kernel import KernelModel, Simulation
from flightmech.simulation.model_block import envelope_section
from flightmech.terms import make_term

HEADER, ENTRY, ENVELOPE = 32, 16, 13
ALPHA = np.array([-0.2, -0.05, 0.0, 0.1, 0.22, 0.4])
MACH = np.array([0.1, 0.3, 0.5, 0.8])


def jet():
    """Return an aircraft without engines."""
    numbers = {"S": 17.0, "cbar": 1.67, "b": 10.3, "mass": 2300.0}
    inertia = {"Ixx": 10800.0, "Iyy": 8100.0, "Izz": 15100.0, "Ixz": 350.0}
    return flightmech.Aircraft(name="jet", **numbers, **inertia)


def database():
    """Return a database with a flown lift curve, and drag of a gear that no flight informed."""
    lift = np.add.outer(0.1 * MACH, 0.3 + 4.0 * ALPHA)
    terms = {
        "/CL/basic": make_term(lift, {"mach": MACH, "alpha": ALPHA}, stderr=0.01, source="flight"),
        "/CD/gear": make_term(0.03, regressors=["gear"], stderr=0.02, source="judgement"),
        "/Cm/elevator": make_term(
            [0.3, 0.0, -0.3], {"delta_e": [-0.3, 0.0, 0.3]}, stderr=0.01, source="flight"
        ),
    }
    db = xr.DataTree.from_dict(terms)
    db.attrs["force_axes"] = "stability"
    flown = np.linspace(0.0, 0.2, 60)
    samples = {"alpha": flown, "mach": 0.5 - flown, "beta": flown - 0.1, "gear": 0.0 * flown}
    db.attrs[FLOWN_STATES] = pack_states(gather_states([samples]))
    return db


DATABASE = database()
SIM = compile_with_envelope(jet(), DATABASE)


def random_start(rng):
    """Return start values and inputs."""
    values = {
        "init.V": rng.uniform(40.0, 280.0),
        "init.alpha": rng.uniform(-0.4, 0.6),
        "init.beta": rng.uniform(-0.3, 0.3),
        "init.h": 1500.0,
    }
    inputs = {"gear": rng.choice([0.0, 1.0]), "delta_e": rng.uniform(-0.4, 0.4)}
    return values, inputs


def flown(sim, values, inputs):
    run = Simulation(sim.model)
    u = np.zeros(len(sim.inputs))
    for name, value in inputs.items():
        u[sim.inputs.index(name)] = value
    for name, value in values.items():
        run.set_parameter(sim.parameters.index(name), value)
    run.set_inputs(u)
    run.initialize()
    return dict(zip(sim.outputs, run.outputs(), strict=True))


def test_look_up_is_that_of_python():
    rng = np.random.default_rng(4)
    regions = set()
    for _ in range(200):
        values, inputs = random_start(rng)
        y = flown(SIM, values, inputs)
        state = {name: y.get(f"applied.{name}", y.get(name)) for name in SIM.envelope.axes}
        state["gear"] = inputs["gear"]
        region, axis = SIM.envelope.look_up(state)
        assert (y["envelope.region"], y["envelope.axis"]) == (region, axis)
        regions.add(int(region))
    assert regions >= {2, 3}


@pytest.mark.parametrize(
    ("alpha", "gear", "expected"), [(0.1, 0.0, (0, 0)), (0.1, 1.0, (2, 5)), (0.5, 0.0, (3, 1))]
)
def test_known_regions(alpha, gear, expected):
    # Mach 0.4 at 1500 m, alpha 0.1: on the flown curve; with the gear; beyond the table at 0.4
    y = flown(SIM, {"init.V": 133.8, "init.alpha": alpha, "init.h": 1500.0}, {"gear": gear})
    assert (y["envelope.region"], y["envelope.axis"]) == expected


def test_lanes_have_the_bits_of_single_runs():
    record = xr.Dataset({"gear": ("time", [0.0, 0.0, 1.0, 1.0])}, {"time": [0.0, 0.1, 0.2, 0.3]})
    names = ["envelope.region", "envelope.axis"]
    alphas = np.linspace(-0.3, 0.5, 11)
    batch = flightmech.simulate_batch(SIM, record, {"init.alpha": alphas}, outputs=names)
    for k, alpha in enumerate(alphas):
        single = flightmech.simulate(SIM, record, {"init.alpha": alpha})
        for name in names:
            assert np.array_equal(batch[name].values[k], single[name].values)


def test_model_without_an_envelope_keeps_its_bytes():
    plain = flightmech.compile(jet(), DATABASE)
    without = DATABASE.copy()
    del without.attrs[FLOWN_STATES]
    assert plain.block == flightmech.compile(jet(), without).block
    assert plain.block == compile_with_envelope(jet(), without).block
    assert plain.envelope is None
    assert SIM.outputs[:-2] == plain.outputs
    assert struct.unpack_from("<I", plain.block, 28) == (ENVELOPE,)


def test_motion_does_not_depend_on_the_envelope():
    plain = flightmech.compile(jet(), DATABASE)
    values, inputs = random_start(np.random.default_rng(1))
    with_it, without = flown(SIM, values, inputs), flown(plain, values, inputs)
    assert {name: with_it[name] for name in without} == without


def test_envelope_of_a_database_without_states_rests_on_the_nodes():
    without = DATABASE.copy()
    del without.attrs[FLOWN_STATES]
    sim = flightmech.compile(jet(), without, make_envelope(without))
    # on the flown curve and off it: the nodes are all from flight
    for speed in (133.8, 200.0):
        y = flown(sim, {"init.V": speed, "init.alpha": 0.1, "init.h": 1500.0}, {})
        assert y["envelope.region"] == 0


def changed(place, data):
    """Return the block with other bytes and a right checksum."""
    block = bytearray(SIM.block)
    block[place : place + len(data)] = data
    block[24:28] = struct.pack("<I", zlib.crc32(bytes(block[28:])))
    return bytes(block)


START = struct.unpack_from("<Q", SIM.block, HEADER + ENTRY * ENVELOPE)[0]


@pytest.mark.parametrize(
    ("place", "data", "message"),
    [
        (START, struct.pack("<I", 65), "too many region tables"),
        (START, struct.pack("<I", 60), "region table"),
        (START + 8, struct.pack("<I", 9), "too many axes"),
        (START + 12, struct.pack("<I", 999), "unknown axis"),
        (START + 16, struct.pack("<I", 10**8), "edges of a region table"),
        (START + 16, struct.pack("<I", 2**32 - 1), "edges of a region table"),
        (HEADER + ENTRY * ENVELOPE + 8, struct.pack("<Q", 16), "region table"),
        (HEADER + ENTRY * ENVELOPE + 8, struct.pack("<Q", 0), "an envelope needs"),
        (HEADER + ENTRY * ENVELOPE, struct.pack("<Q", 2**40), "section envelope"),
    ],
)
def test_faulty_section_is_refused(place, data, message):
    with pytest.raises(SchemaError, match=message):
        KernelModel(changed(place, data))


@pytest.mark.nightly
def test_any_byte_of_the_section_is_safe():
    """A block is refused, or flies with a region and an axis that fit into their bits."""
    size = len(envelope_section(SIM.block))
    rng = np.random.default_rng(7)
    accepted = 0
    for _ in range(300):
        data = rng.integers(0, 256, 4, dtype=np.uint8).tobytes()
        block = changed(START + int(rng.integers(0, size - 4)), data)
        try:
            sim = flightmech.SimModel(block)
            y = flown(sim, {"init.V": 133.8}, {})
        except SchemaError:
            continue
        accepted += 1
        assert 0 <= y["envelope.region"] <= 3
        assert 0 <= y["envelope.axis"] <= 63
    assert accepted > 100


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_model_description_states_the_codes(version):
    xml = ET.fromstring(render_model_description(describe_model(SIM, "token", "tool"), version))
    texts = {item.get("name"): item.get("description") for item in xml.iter() if item.get("name")}
    assert "0 flown, 1 between flown points, 2 a-priori, 3 extrapolated" in texts["envelope.region"]
    assert "0 none, 1 alpha, 2 beta, 3 mach, 4 delta_f" in texts["envelope.axis"]


def test_a_model_with_tanks_has_the_outputs_of_the_envelope_in_the_order_of_the_kernel():
    """Groups of the tanks follow that of the envelope."""
    engine = Engine((0.0, 0.0, 0.0), feed=("left",))
    tank = Tank((0.0, -2.0, 0.0), 200.0, name="left", content=100.0)
    craft = replace(jet(), engines=(engine,), fuel=Fuel(100.0, tanks=(tank,)))
    sim = compile_with_envelope(craft, DATABASE)
    plain = flightmech.compile(craft, DATABASE)
    added = set(sim.outputs) - set(plain.outputs)
    assert added == {"envelope.region", "envelope.axis"}
    y = flightmech.simulate(sim, xr.Dataset(coords={"time": [0.0, 0.1]}), {"init.V": 120.0})
    assert float(y["tank.left.fuel"][-1]) == float(y["fuel"][-1]) == 100.0
    assert float(y["envelope.region"][-1]) in range(4)
