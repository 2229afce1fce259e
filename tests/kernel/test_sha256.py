"""The SHA-256 of the shell, by the processor's instructions and without them, against hashlib."""

from __future__ import annotations

import ctypes
import hashlib
import random
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip(
    "ziglang", reason="sha256.c is compiled on its own, which needs pip install aeromatch[dev]"
)

SOURCE = Path(__file__).parents[2] / "kernel" / "shell"
# the second function takes the first's place for the blocks; where there are no instructions both
# are the same
SHIM = """
#include "sha256.c"
void blocks_portable(uint32_t h[8], const unsigned char *bytes, size_t n) {
    absorb_portable(h, bytes, n);
}
void blocks_as_called(uint32_t h[8], const unsigned char *bytes, size_t n) { absorb(h, bytes, n); }
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("sha256")
    (folder / "shim.c").write_text(SHIM)
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-shared",
        "-fPIC",
        "-std=c11",
        "-O2",
        "-fno-sanitize=all",
        f"-I{SOURCE}",
    ]
    subprocess.run([*command, str(folder / "shim.c"), "-o", str(folder / "sha256.so")], check=True)
    return ctypes.CDLL(str(folder / "sha256.so"))


@pytest.mark.slow
def test_digest_of_every_length_up_to_three_blocks(library):
    noise = random.Random(1).randbytes(100_000)
    text = ctypes.create_string_buffer(65)
    for n in (*range(3 * 64 + 1), len(noise)):
        library.sha256_hex(noise[:n], ctypes.c_size_t(n), text)
        assert text.value.decode() == hashlib.sha256(noise[:n]).hexdigest(), n


def test_with_and_without_the_instructions(library):
    noise = random.Random(2).randbytes(64 * 50)
    found = []
    for name in ("blocks_portable", "blocks_as_called"):
        words = (ctypes.c_uint32 * 8)(*range(1, 9))
        getattr(library, name)(words, noise, ctypes.c_size_t(50))
        found.append(list(words))
    assert found[0] == found[1]
