"""Signature of a report: whether ``manifest.json`` is signed, and by a key that the reader knows.

The signature is the file of ``ssh-keygen -Y sign -n aeromatch``.  Hashes alone do not show who
wrote a report: whoever edits it can write all hashes anew.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from flightmech.errors import SimulationError
from pom.archive.origins import NAME

NAMESPACE = "aeromatch"
_SECONDS = 30.0


@dataclass(frozen=True)
class ReportSignature:
    """Who signed a report.

    Attributes
    ----------
    text : str
        The finding as a line.
    is_refused : bool
        Whether the reader gave his keys, and none of them signed this manifest.
    is_known : bool
        Whether a key of the reader signed it.
    """

    text: str
    is_refused: bool = False
    is_known: bool = False


def read_signature(
    folder: str | os.PathLike, signers: str | os.PathLike | None = None
) -> ReportSignature:
    """Return who signed a report.

    Parameters
    ----------
    folder : path
        Of the report.
    signers : path, optional
        File of allowed signers: name and public key in each line (``man ssh-keygen``).

    Raises
    ------
    SimulationError
        `signers` is given, and ssh-keygen is not installed or does not respond.
    """
    manifest = Path(folder) / NAME
    file = manifest.with_name(f"{NAME}.sig")
    if not file.is_file():
        text = f"not signed (no {file.name}): whoever edits this report can write all hashes anew"
        return ReportSignature(text, is_refused=signers is not None)
    if signers is None:
        return ReportSignature(
            f"signed ({file.name}), the key was not checked: give --signers FILE with the keys "
            f"that you know"
        )
    common = ["-f", os.fspath(signers), "-s", os.fspath(file)]
    found = _run(["-Y", "find-principals", *common], b"")
    name = found.stdout.decode(errors="replace").strip().partition("\n")[0]
    if found.returncode or not name:
        return ReportSignature(f"signed by none of the keys of {signers}", is_refused=True)
    # a key may stand on several lines, of which ssh-keygen names the first, also one for git alone
    content = manifest.read_bytes()
    for candidate in dict.fromkeys([name, *_list_signers(signers)]):
        words = ["-Y", "verify", *common, "-I", candidate, "-n", NAMESPACE]
        if not _run(words, content).returncode:
            return ReportSignature(f"signed by {candidate}, a key of {signers}", is_known=True)
    text = (
        f"the signature of {name} is not that of this {NAME}, or {signers} does not allow this key "
        f"the namespace {NAMESPACE}"
    )
    return ReportSignature(text, is_refused=True)


def _list_signers(signers: str | os.PathLike) -> Iterator[str]:
    """Yield the names in a file of allowed signers, without patterns."""
    for line in Path(signers).read_text(encoding="utf-8", errors="replace").splitlines():
        names = line.strip().partition(" ")[0].strip('"')
        if names.startswith("#"):
            continue
        for name in names.split(","):
            if name and not set(name) & set("*?!"):
                yield name


def _run(words: list[str], content: bytes) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(
            ["ssh-keygen", *words],
            input=content,
            capture_output=True,
            timeout=_SECONDS,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SimulationError(
            f"the signature cannot be checked, ssh-keygen: {error}; install OpenSSH, or leave "
            f"--signers out"
        ) from error
