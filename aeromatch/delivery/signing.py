"""Signatures of data packages: Ed25519 over the manifest, which has the hashes of all files."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from aeromatch.delivery.places import MANIFEST, SIGNATURE
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import written_atomically

FORMAT = "aeromatch signature of a data package, format 1"
# A signature of a package is not one of another text.
_CONTEXT = FORMAT.encode() + b"\n"
# Largest file of a signature or a key. [byte]
_LARGEST = 10_000


@dataclass(frozen=True)
class PackageSignature:
    """State of the signature of a package.

    Attributes
    ----------
    state : str
        ``none``, ``known`` (by a trusted key), ``unknown`` (by another key) or ``broken``.
    text : str
        The state in words, with the fingerprint of the key.
    """

    state: str
    text: str


def make_key(path: Path) -> tuple[Path, str]:
    """Write a new private key, and the public key next to it with the suffix ``.pub``.

    A private key without its public key is what an interrupted run leaves: the public key is then
    written from it.

    Returns
    -------
    public : Path
    fingerprint : str

    Raises
    ------
    SchemaError
        The public key exists, or the private file is not a key.
    """
    public = path.with_name(path.name + ".pub")
    # before the first file is written
    _demand_absent(public)
    if path.exists():
        key = read_private_key(path)
    else:
        key = Ed25519PrivateKey.generate()
        with written_atomically(path, before=_demand_absent) as part:
            _write_secret(part, key)
    with written_atomically(public, before=_demand_absent) as part:
        part.write_bytes(
            key.public_key().public_bytes(
                serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
            )
        )
    return public, fingerprint_of(key.public_key())


def _demand_absent(file: Path) -> None:
    if file.exists():
        raise SchemaError(str(file), ["exists; give a new name, a key is not overwritten"])


def _write_secret(path: Path, key: Ed25519PrivateKey) -> None:
    """Write a private key to a file that only its owner may read, from its first byte on."""
    private_text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as stream:
        stream.write(private_text)


def fingerprint_of(key: Ed25519PublicKey) -> str:
    """Return the first 16 characters of the SHA-256 of a public key."""
    return hashlib.sha256(_raw_bytes(key)).hexdigest()[:16]


def _raw_bytes(key: Ed25519PublicKey) -> bytes:
    return key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)


def read_private_key(path: Path) -> Ed25519PrivateKey:
    """Read a private key of `make_key`, or of ``openssl genpkey -algorithm ed25519``.

    Raises
    ------
    SchemaError
        The file is not such a key, or is encrypted.
    """
    try:
        key = serialization.load_pem_private_key(_read_small(path), password=None)
    except TypeError:
        fault = "is encrypted; give a key without a password"
        raise SchemaError(str(path), [fault]) from None
    except (ValueError, UnsupportedAlgorithm):
        raise SchemaError(str(path), [_wrong_key("private")]) from None
    if not isinstance(key, Ed25519PrivateKey):
        raise SchemaError(str(path), [_wrong_key("private")])
    return key


def read_public_key(path: Path) -> Ed25519PublicKey:
    """Read a public key; errors as `read_private_key`."""
    try:
        key = serialization.load_pem_public_key(_read_small(path))
    except (ValueError, UnsupportedAlgorithm):
        raise SchemaError(str(path), [_wrong_key("public")]) from None
    if not isinstance(key, Ed25519PublicKey):
        raise SchemaError(str(path), [_wrong_key("public")])
    return key


def _wrong_key(kind: str) -> str:
    return f"not a {kind} key of Ed25519 in PEM; `aeromatch package key` writes one"


def _read_small(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(_LARGEST)


def signature_text(manifest: bytes, key: Ed25519PrivateKey) -> str:
    """Return the file of a signature. Equal manifest and key give the same text."""
    content = {
        "content": FORMAT,
        "public_key": base64.b64encode(_raw_bytes(key.public_key())).decode(),
        "signature": base64.b64encode(key.sign(_CONTEXT + manifest)).decode(),
    }
    return json.dumps(content, indent=1, sort_keys=True) + "\n"


def check_signature(folder: Path, trusted: Sequence[Path] = ()) -> PackageSignature:
    """Return the state of the signature of a package.

    Parameters
    ----------
    folder : Path
    trusted : sequence of Path
        Public keys of known makers.

    Raises
    ------
    SchemaError
        A trusted key cannot be read.
    """
    known = {}
    for path in trusted:
        key = read_public_key(path)
        known[_raw_bytes(key)] = path.name
    file = folder / SIGNATURE
    if not file.is_file():
        return PackageSignature("none", "not signed")
    try:
        content = json.loads(_read_small(file))
        if content["content"] != FORMAT:
            raise ValueError(content["content"])
        raw = base64.b64decode(content["public_key"], validate=True)
        key = Ed25519PublicKey.from_public_bytes(raw)
        signature = base64.b64decode(content["signature"], validate=True)
        key.verify(signature, _CONTEXT + (folder / MANIFEST).read_bytes())
    except InvalidSignature:
        return PackageSignature("broken", f"the signature does not fit {MANIFEST}")
    except (ValueError, KeyError, TypeError, RecursionError):
        return PackageSignature("broken", f"{SIGNATURE} is not a signature of a data package")
    if raw in known:
        text = f"signed by the known key {known[raw]} ({fingerprint_of(key)})"
        return PackageSignature("known", text)
    return PackageSignature("unknown", f"signed by an unknown key ({fingerprint_of(key)})")
