"""Signature of a report: whether ``manifest.json`` is signed, and by a key that the reader knows.

The signature is the file of ``ssh-keygen -Y sign -n aeromatch``.  Hashes alone do not show who
wrote a report: whoever edits it can write all hashes anew.
"""

from __future__ import annotations

import os
import subprocess
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
    checked = _run(["-Y", "verify", *common, "-I", name, "-n", NAMESPACE], manifest.read_bytes())
    if checked.returncode:
        text = f"the signature of {name} is not that of this {NAME}"
        return ReportSignature(text, is_refused=True)
    return ReportSignature(f"signed by {name}, a key of {signers}", is_known=True)


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
