"""Files of caches, written atomically, with the SHA-256 of their content in front of it.

A write does not wait for the disk: a file that a power failure damaged counts as missing.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from flightmech.support.atomic_write import written_atomically

DIGEST = hashlib.sha256().digest_size
"""Bytes of the digest in front of the content."""


def read_checked(file: Path) -> memoryview | None:
    """Return the content of a file; None if the file is missing or damaged."""
    try:
        content = memoryview(file.read_bytes())
    except OSError:
        return None
    if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
        return None
    return content[DIGEST:]


def write_checked(file: Path, *parts: bytes | memoryview) -> str:
    """Write the parts of a content into a file, and return the hexadecimal digest of the content.

    Raises
    ------
    OSError
        The folder does not exist, or the file cannot be written.
    """
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    with written_atomically(file, durable=False) as unfinished, unfinished.open("wb") as stream:
        stream.writelines((digest.digest(), *parts))
    return digest.hexdigest()
