"""Child process: stored states with random bits under a right seal; ``fmu_states_child.py FOLDER
STATE HEAD`` prints how many loaded.
"""

from __future__ import annotations

import hashlib
import random
import struct
import sys
from pathlib import Path

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave

TRIALS = 1500


def damaged(image: bytes, head: int, rng: random.Random) -> bytes:
    """Return an image with a few words behind its head replaced, and the SHA-256 that belongs to
    it.
    """
    found = bytearray(image)
    for _ in range(rng.choice([1, 1, 4, 200])):
        word = rng.choice(
            [0, 2**64 - 1, rng.getrandbits(64), rng.getrandbits(31), 0x7FF0000000000000]
        )
        struct.pack_into("<Q", found, rng.randrange(head, len(found) - 8), word)
    return bytes(found[:64]) + hashlib.sha256(found[128:]).hexdigest().encode() + bytes(found[128:])


def main(folder: str, state: str, head: str) -> None:
    """Load damaged states and fly on from those that are accepted."""
    model, image, rng = (
        fmpy.read_model_description(folder),
        Path(state).read_bytes(),
        random.Random(3),
    )
    fmu = FMU3Slave(
        guid=model.guid,
        unzipDirectory=folder,
        modelIdentifier=model.coSimulation.modelIdentifier,
        instanceName="x",
    )
    fmu.instantiate(logMessage=lambda *message: None)
    outputs = [
        v.valueReference
        for v in model.modelVariables
        if v.causality == "output" and not v.dimensions
    ]
    loaded = 0
    for _ in range(TRIALS):
        try:
            stored = fmu.deserializeFMUState(damaged(image, int(head), rng))
            fmu.setFMUState(stored)
            fmu.freeFMUState(stored)
            loaded += 1
            fmu.getFloat64(outputs)
            fmu.doStep(0.5, 0.02)
            fmu.getFloat64(outputs)
        except FMICallException:
            continue
    print(loaded)


if __name__ == "__main__":
    main(*sys.argv[1:])
