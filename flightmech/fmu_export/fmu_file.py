"""Writer of a compiled model as a Functional Mock-up Unit.

An FMU contains the libraries of the kernel, the model block and the files of the standard.  Writing
does not need a compiler: the libraries come from the installed package, and the aircraft is
``resources/model.bin``.  The same model gives the same bytes.
"""

from __future__ import annotations

import io
import os
import struct
import zipfile
from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, distribution
from importlib.metadata import version as installed
from pathlib import Path

from flightmech.errors import SchemaError
from flightmech.fmu_export.description import Description, describe_model
from flightmech.fmu_export.documentation import PageAxis, render_documentation
from flightmech.fmu_export.model_description import render_model_description
from flightmech.fmu_export.term_plots import make_term_figures
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS, LINEAR
from flightmech.simulation.kernel_library import FOLDER, SUFFIX
from flightmech.support.atomic_write import written_atomically

FMI2_FOLDER = {
    "x86_64-linux": "linux64",
    "x86_64-windows": "win64",
    "x86_64-darwin": "darwin64",
    "aarch64-darwin": "darwin64",
}

# Mach-O universal binary: big-endian header of <mach-o/fat.h>.
_FAT_MAGIC = 0xCAFEBABE
# Type and subtype of the processor, <mach/machine.h>.
_PROCESSOR = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}
_ALIGNMENT = 14  # power of two to which each library is aligned


def find_libraries(folder: Path = FOLDER) -> dict[str, bytes]:
    """Return the compiled libraries for FMUs by platform, such as ``x86_64-linux``.

    Raises
    ------
    SchemaError
        The folder contains no library.
    """
    libraries = {}
    for suffix in SUFFIX.values():
        for path in sorted(folder.glob(f"*/aeromatch_fmu{suffix}")):
            libraries[path.parent.name] = path.read_bytes()
    if not libraries:
        raise SchemaError(
            "FMU",
            [
                f"no compiled kernel under {folder}; install the package, or run 'python "
                f"hatch_build.py' in a checkout"
            ],
        )
    return libraries


def place_libraries(
    libraries: Mapping[str, bytes], identifier: str, version: str
) -> dict[str, bytes]:
    """Return the files of the folder ``binaries`` by their path in the FMU.

    Parameters
    ----------
    libraries : mapping of str to bytes
        Libraries by platform, from `find_libraries`.
    identifier : str
        Model identifier: importers search for this file name.
    version : {"2.0", "3.0"}
        FMI version.

    Raises
    ------
    SchemaError
        The FMI version has no folder for any of the libraries.
    """
    files = {}
    if version == "3.0":
        for platform, data in libraries.items():
            files[f"binaries/{platform}/{identifier}{_suffix(platform)}"] = data
        return files

    supported = {name: data for name, data in libraries.items() if name in FMI2_FOLDER}
    if not supported:
        raise SchemaError(
            "FMU", [f"FMI 2.0 has no folder for {', '.join(libraries)}; write FMI 3.0"]
        )
    # FMI 2.0 has one folder for macOS, so that libraries of several processors become one file.
    # Both platforms then have the same path below.
    mac = {name: data for name, data in supported.items() if name in _PROCESSOR}
    if len(mac) > 1:
        supported |= dict.fromkeys(mac, join_universal(mac))
    for platform, data in supported.items():
        files[f"binaries/{FMI2_FOLDER[platform]}/{identifier}{_suffix(platform)}"] = data
    return files


def join_universal(libraries: Mapping[str, bytes]) -> bytes:
    """Return the macOS libraries of several processors joined into one universal binary."""
    # The header has one entry per library: processor, offset, size. Libraries follow, aligned.
    step = 1 << _ALIGNMENT
    header, body = struct.pack(">II", _FAT_MAGIC, len(libraries)), b""
    offset = step
    for name, data in sorted(libraries.items()):
        processor, subtype = _PROCESSOR[name]
        entry = (processor, subtype, offset, len(data), _ALIGNMENT)
        header += struct.pack(">IIIII", *entry)
        body += data + bytes(-len(data) % step)
        offset = step + len(body)
    return header.ljust(step, b"\0") + body


def _suffix(name: str) -> str:
    return SUFFIX[name.split("-")[1]]


VERSIONS = ("2.0", "3.0")
BLOCK = "resources/model.bin"
"""Path of the model block in an FMU."""


def write_fmu(sim: SimModel, path: str | os.PathLike[str], version: str = "2.0") -> Path:
    """Write a model as an FMU for co-simulation and model exchange.

    The file is written atomically (completely or not at all).

    Parameters
    ----------
    sim : SimModel
        From `compile`.
    path : path
        The FMU to write.
    version : {"2.0", "3.0"}
        FMI version.  FMI 2.0 accepts derivatives of inputs.  FMI 3.0 replays complete records in
        one step and also runs on Linux on ARM.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SchemaError
        Unknown version, a term name that is not an FMI name, or no compiled kernel.
    """
    if version not in VERSIONS:
        raise SchemaError("FMU", [f"FMI version {version!r}; allowed: {', '.join(VERSIONS)}"])
    description = describe_model(sim, sha256(sim.block).hexdigest(), _tool_name())
    files = {
        **make_program_files(sim, version),
        "documentation/index.html": document_model(sim, description).encode(),
        **_license_files(),
    }
    with written_atomically(path) as part:
        part.write_bytes(_make_archive(files))
    return Path(path)


def make_program_files(sim: SimModel, version: str) -> dict[str, bytes]:
    """Return the files of an FMU that determine its answer, by their path in the FMU."""
    description = describe_model(sim, sha256(sim.block).hexdigest(), _tool_name())
    return {
        "modelDescription.xml": render_model_description(description, version),
        BLOCK: sim.block,
        **place_libraries(find_libraries(), description.identifier, version),
    }


def is_unaltered(path: str | os.PathLike[str]) -> bool:
    """Return whether an FMU is, but for its documentation, what `write_fmu` writes of its block.

    Libraries, description and block are compared byte by byte with those of this installation. Such
    an FMU flies its block by this kernel.  An FMU of another version of the program, of another
    program, or with a further file is not unaltered.
    """
    with zipfile.ZipFile(path) as archive:
        names = [item.filename for item in archive.infolist() if not item.is_dir()]
        if BLOCK not in names or len(set(names)) < len(names):
            return False
        sim = SimModel(archive.read(BLOCK))
        given = {name for name in names if not name.startswith("documentation/")}
        for version in VERSIONS:
            try:
                files = make_program_files(sim, version)
            except SchemaError:
                # the version has no library of this platform
                continue
            if given == files.keys() and _has_contents(archive, files):
                return True
    return False


def _has_contents(archive: zipfile.ZipFile, files: Mapping[str, bytes]) -> bool:
    # a file of another size needs no reading
    sizes = {name: archive.getinfo(name).file_size for name in files}
    if any(sizes[name] != len(content) for name, content in files.items()):
        return False
    return all(archive.read(name) == content for name, content in files.items())


def document_model(sim: SimModel, description: Description) -> str:
    """Return the documentation page of a model."""
    axes = []
    for row in sim.entries(AXIS):
        outside = "linear" if row.flags & LINEAR else "held"
        axes.append(PageAxis(row.name, row.units, row.low, row.high, outside=outside))
    return render_documentation(
        description, sim.terms, axes=axes, meta=sim.meta, figures=make_term_figures(sim)
    )


def _make_archive(files: Mapping[str, bytes]) -> bytes:
    """Return an archive whose bytes depend on the content only."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zf:
        for name in sorted(files):
            # The date is 1980-01-01 and the system is Unix, whatever machine writes the file.
            info = zipfile.ZipInfo(name)
            info.create_system = 3
            mode = 0o100755 if name.startswith("binaries/") else 0o100644
            info.external_attr = mode << 16  # the upper 16 bits are the Unix file mode
            zf.writestr(info, files[name], compress_type=zipfile.ZIP_DEFLATED, compresslevel=9)
    return archive.getvalue()


def _license_files() -> dict[str, bytes]:
    """Return the licence of the libraries, which every copy of an FMU must contain."""
    try:
        text = distribution("aeromatch").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        return {}
    if not text:
        return {}
    return {"documentation/licenses/aeromatch-kernel.txt": text.encode()}


def _tool_name() -> str:
    try:
        return f"aeromatch {installed('aeromatch')}"
    except PackageNotFoundError:
        return "aeromatch"
