"""Blocks: any bytes are safe, a wrong block states what is wrong; the same model gives the same
bytes.
"""

from __future__ import annotations

import pickle
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flightmech
from flightmech.errors import SchemaError
from flightmech.simulation.kernel import KernelModel, Simulation

SECTIONS = (
    "geometry",
    "inputs",
    "outputs",
    "parameters",
    "states",
    "variables",
    "axes",
    "points",
    "bundles",
    "nodes",
    "terms",
    "items",
    "strings",
)


def section(block: bytes, name: str) -> tuple[int, int]:
    """Offset and count of a section."""
    return struct.unpack_from("<2Q", block, 32 + 16 * SECTIONS.index(name))


def patched(block: bytes, offset: int, data: bytes, seal: bool = True) -> bytes:
    """The block with other bytes, and with a right CRC unless reported otherwise."""
    changed = block[:offset] + data + block[offset + len(data) :]
    return (
        changed[:24] + struct.pack("<I", zlib.crc32(changed[28:])) + changed[28:]
        if seal
        else changed
    )


def fly(model: KernelModel) -> None:
    """Use a model that was accepted: nothing may crash, whatever the numbers."""
    run = Simulation(model)
    u = np.zeros(model.count(0))
    try:
        run.set_inputs(u)
        run.initialize()
        run.step(0.0, 0.02, u, u)
        run.outputs()
        run.evaluate(np.full((3, model.count(4)), 0.1))
    except flightmech.errors.SimulationError:
        pass


def test_same_model_same_bytes(sim, content, make_aircraft, make_tree):
    shuffled = dict(sorted(content.items(), reverse=True))
    assert flightmech.compile(make_aircraft(), make_tree(shuffled)).block == sim.block


def test_model_survives_pickling(sim):
    counterpart = pickle.loads(pickle.dumps(sim))
    assert counterpart.block == sim.block
    assert counterpart.outputs == sim.outputs


def test_a_flipped_bit_is_found(sim):
    rng = np.random.default_rng(1)
    for offset in rng.integers(0, len(sim.block), 100):
        changed = patched(
            sim.block,
            int(offset),
            bytes([sim.block[offset] ^ (1 << int(rng.integers(8)))]),
            seal=False,
        )
        with pytest.raises(SchemaError):
            KernelModel(changed)


def test_truncated_and_extended_blocks(sim):
    for length in (0, 1, 31, 32, 200, len(sim.block) // 2, len(sim.block) - 1):
        with pytest.raises(SchemaError, match=r"too few|truncated"):
            KernelModel(sim.block[:length])
    with pytest.raises(SchemaError, match=r"truncated or extended"):
        KernelModel(sim.block + b"\0")


@pytest.mark.parametrize(
    ("offset", "data", "text"),
    [
        (0, b"AMKERNEK", "does not begin with AMKERNEL"),
        (8, struct.pack("<I", 1), "format 1, this library reads format 2; compile the model again"),
        (12, struct.pack("<I", 0x04030201), "endian mark is 04030201"),
        (28, struct.pack("<I", 12), "12 sections, expected 13 or 14"),
    ],
)
def test_wrong_headers_state_what_is_wrong(offset, data, text, sim):
    with pytest.raises(SchemaError, match=text):
        KernelModel(patched(sim.block, offset, data))


@pytest.mark.parametrize(
    ("name", "inside", "data", "text"),
    [
        ("points", 8, struct.pack("<d", 1e9), "does not rise"),
        ("points", 0, struct.pack("<d", float("nan")), "breakpoint that is not finite"),
        ("nodes", 16, struct.pack("<d", float("inf")), "table node is not finite"),
        ("axes", 0, struct.pack("<I", 9999), "axis 0 has no variable"),
        ("axes", 8, struct.pack("<I", 2**31), "breakpoints outside the block"),
        ("bundles", 0, struct.pack("<I", 5), "wrong number of axes"),
        ("bundles", 4, struct.pack("<I", 77), "axis that is not in its stage"),
        (
            "bundles",
            20,
            struct.pack("<I", 2**20),
            "wrong number of axes or tables|nodes outside the block",
        ),
        ("bundles", 32, struct.pack("<Q", 2**60), "nodes outside the block"),
        ("terms", 0, struct.pack("<I", 2**31), "term 0 has no name"),
        ("terms", 16, struct.pack("<I", 10**6), "table outside its stage"),
        ("terms", 20, struct.pack("<I", 999), "unknown variable"),
        ("terms", 28, struct.pack("<I", 60), "has target 60"),
        ("geometry", 0, struct.pack("<d", -1.0), "S, cbar and b must be positive"),
        ("geometry", 32, struct.pack("<I", 3), "force axes 3"),
        ("parameters", 16, struct.pack("<d", float("nan")), "not finite or not in order"),
        ("inputs", 0, struct.pack("<I", 0xFFFFFFFF), "text outside the string table"),
        ("terms", 32, struct.pack("<I", 999), "power of an unknown variable"),
        ("items", 0, struct.pack("<I", 99), "item 0 has a wrong group or name"),
        ("items", 8, struct.pack("<I", 0), "core and weather must be there once"),
    ],
)
def test_wrong_records_state_what_is_wrong(name, inside, data, text, sim):
    with pytest.raises(SchemaError, match=text):
        KernelModel(patched(sim.block, section(sim.block, name)[0] + inside, data))


def test_sections_must_lie_inside(sim):
    for i in range(len(SECTIONS)):
        for entry in (
            struct.pack("<2Q", 2**63, 1),
            struct.pack("<2Q", 64, 2**61),
            struct.pack("<2Q", 65, 1),
        ):
            with pytest.raises(SchemaError):
                KernelModel(patched(sim.block, 32 + 16 * i, entry))


@pytest.mark.nightly
@settings(max_examples=3 * settings.default.max_examples, deadline=None)
@given(data=st.data())
def test_hostile_blocks_with_a_right_checksum_do_not_crash(data, sim):
    block = sim.block
    for _ in range(data.draw(st.integers(1, 4))):
        if data.draw(st.booleans()):
            offset, _ = section(block, data.draw(st.sampled_from(SECTIONS)))
            offset = min(offset + 4 * data.draw(st.integers(0, 60)), len(block) - 8)
        else:
            offset = data.draw(st.integers(28, len(block) - 8))
        word = data.draw(
            st.sampled_from(
                [
                    b"\0\0\0\0",
                    b"\xff\xff\xff\xff",
                    b"\1\0\0\0",
                    b"\0\0\xf0\x7f",
                    b"\0\0\0\x80",
                    b"\7\0\0\0",
                ]
            )
        )
        block = patched(block, offset, word)
    try:
        model = KernelModel(block)
    except SchemaError:
        return
    fly(model)


@settings(max_examples=settings.default.max_examples, deadline=None)
@given(st.binary(max_size=600))
def test_any_bytes_are_refused(data):
    with pytest.raises(SchemaError):
        KernelModel(data)
    with pytest.raises(SchemaError):
        KernelModel(b"AMKERNEL" + data)


def test_the_library_itself_refuses_what_it_cannot_solve_for(sim):
    """As the compiler does: a table over, or a product of, alphadothat, betadothat and dnz."""
    axes, terms = (section(sim.block, name)[0] for name in ("axes", "terms"))
    implicit = [sim.variables.index(name) for name in ("alphadothat", "dnz")]
    aero = next(i for i, name in enumerate(sim.axes) if name == "alpha")
    with pytest.raises(SchemaError, match="dnz cannot be a table axis; it may be a regressor only"):
        KernelModel(patched(sim.block, axes + 24 * aero, struct.pack("<I", implicit[1])))
    record = terms + 48 * sim.terms.index("Cm/elevator")
    with pytest.raises(
        SchemaError,
        match="term Cm/elevator has two of alphadothat, betadothat, dnz; only one can be solved "
        "for",
    ):
        KernelModel(patched(sim.block, record + 20, struct.pack("<2I", *(1 + i for i in implicit))))
