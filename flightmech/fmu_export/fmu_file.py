"""A compiled model as a Functional Mock-up Unit: the kernel's libraries, the model block, and what
the standard wants to know.

Writing needs no compiler: the libraries are those the package was built with, the aircraft is
``resources/model.bin``. The same model gives the same bytes.
"""

from __future__ import annotations

import io
import os
import re
import struct
import zipfile
from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, distribution
from importlib.metadata import version as installed
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flightmech.errors import ParseError, SchemaError
from flightmech.fmu_export.description import Description, describe_model
from flightmech.fmu_export.documentation import PageAxis, make_term_figures, render_documentation
from flightmech.fmu_export.model_description import render_model_description
from flightmech.simulation.kernel import AXIS, FOLDER, LINEAR, SUFFIX
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files import file_kind

if TYPE_CHECKING:
    from flightmech.simulation.compiler import SimModel

FMI2_FOLDER = {
    "x86_64-linux": "linux64",
    "x86_64-windows": "win64",
    "x86_64-darwin": "darwin64",
    "aarch64-darwin": "darwin64",
}

# Mach-O universal binary: big-endian header, <mach-o/fat.h>; processor types of <mach/machine.h>,
# alignment 2**14
_FAT_MAGIC = 0xCAFEBABE
_PROCESSOR = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}
_ALIGNMENT = 14


def find_libraries(folder: Path = FOLDER) -> dict[str, bytes]:
    """Return the libraries for FMUs that are found, by platform such as ``x86_64-linux``.

    Raises
    ------
    SchemaError
        When there is none.
    """
    found = {
        path.parent.name: path.read_bytes()
        for suffix in SUFFIX.values()
        for path in sorted(folder.glob(f"*/aeromatch_fmu{suffix}"))
    }
    if not found:
        raise SchemaError(
            "FMU",
            [
                f"no compiled kernel under {folder}; install the package, or run 'python "
                f"hatch_build.py' in a checkout"
            ],
        )
    return found


def place_libraries(
    libraries: Mapping[str, bytes], identifier: str, version: str
) -> dict[str, bytes]:
    """Return the files of the folder ``binaries`` by their place in the FMU.

    Parameters
    ----------
    libraries : mapping of str to bytes
        Libraries by platform, from `find_libraries`.
    identifier : str
        Model identifier: the file name that importers look for.
    version : {"2.0", "3.0"}
        FMI version.

    Raises
    ------
    SchemaError
        When FMI `version` has no folder for any of the libraries.
    """
    if version == "3.0":
        return {
            f"binaries/{name}/{identifier}{_suffix(name)}": data for name, data in libraries.items()
        }
    known = {name: data for name, data in libraries.items() if name in FMI2_FOLDER}
    if not known:
        raise SchemaError(
            "FMU", [f"FMI 2.0 has no folder for {', '.join(libraries)}; write FMI 3.0"]
        )
    mac = {name: data for name, data in known.items() if name in _PROCESSOR}
    if len(mac) > 1:
        known = {name: data for name, data in known.items() if name not in mac} | {
            next(iter(mac)): join_universal(mac)
        }
    return {
        f"binaries/{FMI2_FOLDER[name]}/{identifier}{_suffix(name)}": data
        for name, data in known.items()
    }


def join_universal(libraries: Mapping[str, bytes]) -> bytes:
    """Return the macOS libraries of several processors joined into one universal binary."""
    step = 1 << _ALIGNMENT
    header, body = struct.pack(">II", _FAT_MAGIC, len(libraries)), b""
    offset = step
    for name, data in sorted(libraries.items()):
        header += struct.pack(">IIIII", *_PROCESSOR[name], offset, len(data), _ALIGNMENT)
        body += data + bytes(-len(data) % step)
        offset = step + len(body)
    return header.ljust(step, b"\0") + body


def _suffix(name: str) -> str:
    return SUFFIX[name.split("-")[1]]


# of a structured name (FMI 2.0.2, section 2.2.9), without quotes
_PART = r"[A-Za-z_]\w*(?:\[\d+(?:,\d+)*\])?"
_PLAIN_NAME = re.compile(rf"{_PART}(?:\.{_PART})*|der\({_PART}(?:\.{_PART})*(?:,\d+)?\)", re.ASCII)


def read_fmu(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what an FMU of any vendor states about itself.

    Returns
    -------
    dict
        ``model``, ``fmi``, ``token``, ``platforms`` (those that it has a library for), ``platform``
        of this machine, ``runs_here``, ``variables`` (list of dict: ``name causality variability
        type unit display_unit start description``) and ``findings``, the problems that FMPy's
        validation sees.

    Raises
    ------
    ParseError
        The file is no FMU.
    """
    import fmpy

    try:
        model = fmpy.read_model_description(str(path), validate=False)
        platforms = sorted(fmpy.supported_platforms(str(path)))
    except Exception as error:  # FMPy raises plain exceptions
        kind = file_kind(path)
        found = f"a damaged FMU ({error})" if kind.startswith("a zip") else kind
        raise ParseError(
            str(path),
            0,
            found,
            "an FMU: a zip archive with a modelDescription.xml of FMI 1.0, 2.0 or 3.0",
        ) from error
    return {
        "model": model.modelName,
        "fmi": model.fmiVersion,
        "token": model.guid,
        "platforms": platforms,
        "platform": fmpy.platform,
        "runs_here": fmpy.platform in platforms,
        "variables": [_row(v) for v in model.modelVariables],
        "findings": _findings(str(path), [v.name for v in model.modelVariables]),
    }


def _findings(path: str, names: Iterable[str]) -> list[str]:
    """Return what FMPy's validation finds; it parses every name by a grammar, for 2 ms each, which
    plain names are known to follow.
    """
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError
    from fmpy.validation import validate_fmu

    if _has_backslashes(path) or not all(map(_PLAIN_NAME.fullmatch, names)):
        return validate_fmu(path)
    try:
        read_model_description(
            path, validate=True, validate_variable_names=False, validate_model_structure=True
        )
    except ValidationError as error:
        return error.problems
    except Exception as error:  # as `validate_fmu` does
        return [str(error)]
    return []


def _has_backslashes(path: str) -> bool:
    """Return whether names of files in an archive have the separator of Windows."""
    if not os.path.isfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return any("\\" in file.orig_filename for file in archive.filelist)


def _row(v: Any) -> dict[str, Any]:
    return {
        "name": v.name,
        "causality": v.causality,
        "variability": v.variability,
        "type": v.type,
        "unit": v.unit,
        "display_unit": v.displayUnit,
        "start": v.start,
        "description": v.description,
    }


VERSIONS = ("2.0", "3.0")


def write_fmu(sim: SimModel, path: str | os.PathLike[str], version: str = "2.0") -> Path:
    """Write a model as an FMU for co-simulation and model exchange; the file is written atomically
    (completely or not at all).

    Parameters
    ----------
    sim : SimModel
        From `compile`.
    path : path
        The FMU to write.
    version : {"2.0", "3.0"}
        FMI version.  FMI 2.0 takes derivatives of inputs; FMI 3.0 flies whole records in one step
        and runs on Linux on ARM, too.

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
    description = describe_model(sim, sha256(sim.block).hexdigest(), _tool())
    files = {
        "modelDescription.xml": render_model_description(description, version),
        "resources/model.bin": sim.block,
        "documentation/index.html": _documentation(sim, description).encode(),
        **_license(),
        **place_libraries(find_libraries(), description.identifier, version),
    }
    with written_atomically(path) as part:
        part.write_bytes(_zip(files))
    return Path(path)


def _documentation(sim: SimModel, description: Description) -> str:
    axes = [
        PageAxis(row.name, row.units, row.low, row.high, "linear" if row.flags & LINEAR else "held")
        for row in sim.entries(AXIS)
    ]
    return render_documentation(description, sim.terms, axes, sim.meta, make_term_figures(sim))


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
