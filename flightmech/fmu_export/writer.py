"""A compiled model as a Functional Mock-up Unit: the kernel's libraries, the model block, and what the standard wants to know.

Writing needs no compiler: the libraries are those the package was built with, the aircraft is ``resources/model.bin``.
The same model gives the same bytes.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, distribution
from importlib.metadata import version as installed
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import SchemaError
from ..simulation.kernel import AXIS, LINEAR
from ..support.atomic_write import written_atomically
from .binaries import binaries, compiled
from .description import Description, describe
from .documentation import Axis, html
from .model_description import xml
from .plots import figures

if TYPE_CHECKING:
    from ..simulation.compiler import SimModel

VERSIONS = ("2.0", "3.0")


def write_fmu(sim: SimModel, path: str | os.PathLike[str], version: str = "2.0") -> Path:
    """Write a model as an FMU for co-simulation and model exchange; the file is written atomically (completely or not at all).

    Parameters
    ----------
    sim : SimModel
        From `compile`.
    path : path
        The FMU to write.
    version : {"2.0", "3.0"}
        FMI version.  FMI 2.0 takes derivatives of inputs; FMI 3.0 flies whole records in one step and runs on Linux on ARM, too.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SchemaError
        Unknown version, a term name that no importer takes, or no compiled kernel.
    """
    if version not in VERSIONS:
        raise SchemaError("FMU", [f"FMI version {version!r}; allowed: {', '.join(VERSIONS)}"])
    description = describe(sim, sha256(sim.block).hexdigest(), _tool())
    files = {
        "modelDescription.xml": xml(description, version),
        "resources/model.bin": sim.block,
        "documentation/index.html": _documentation(sim, description).encode(),
        **_license(),
        **binaries(compiled(), description.identifier, version),
    }
    with written_atomically(path) as part:
        part.write_bytes(_zip(files))
    return Path(path)


def _documentation(sim: SimModel, description: Description) -> str:
    axes = [Axis(row.name, row.units, row.low, row.high, "linear" if row.flags & LINEAR else "held") for row in sim.entries(AXIS)]
    return html(description, sim.terms, axes, sim.meta, figures(sim))


def _zip(files: Mapping[str, bytes]) -> bytes:
    """Return an archive whose bytes depend on the content only."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zf:
        for name in sorted(files):
            info = zipfile.ZipInfo(name)  # dated 1980-01-01
            info.create_system = 3  # Unix, on every system
            info.external_attr = (0o100755 if name.startswith("binaries/") else 0o100644) << 16
            zf.writestr(info, files[name], zipfile.ZIP_DEFLATED, 9)
    return archive.getvalue()


def _license() -> dict[str, bytes]:
    """Return the licence of the libraries, which whoever passes them on has to pass on as well."""
    try:
        text = distribution("aeromatch").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        text = None
    return {"documentation/licenses/aeromatch-kernel.txt": text.encode()} if text else {}


def _tool() -> str:
    try:
        return f"aeromatch {installed('aeromatch')}"
    except PackageNotFoundError:
        return "aeromatch"
