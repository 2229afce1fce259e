"""The description of an FMU, with what FMPy leaves out of it."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

_CAPABILITIES = ("canHandleVariableCommunicationStepSize", "canInterpolateInputs", "canBeInstantiatedOnlyOncePerProcess")


_LARGEST = 64_000_000  # bytes of modelDescription.xml; 100 times those of models with 10 000 variables


def demand_size(path: str | Path, most: int) -> None:
    """Refuse an FMU whose files are larger, unpacked, than a limit; 0: any. [byte]

    Raises
    ------
    ValueError
    """
    with zipfile.ZipFile(path) as file:
        size = sum(item.file_size for item in file.infolist())
    if most and size > most:
        raise ValueError(f"its files have {size / 1e6:.0f} MB unpacked, allowed are {most / 1e6:.0f} MB (AEROMATCH_FMU_UNPACKED)")


def platform_problem(path: str | Path, description: Any) -> str:
    """Return that an FMU has no library for this platform, with the platforms that it has one for; empty if it has one.

    Parameters
    ----------
    path : path
        The FMU.
    description : ModelDescription
        From `read_description`.
    """
    import fmpy

    here = fmpy.platform_tuple if description.fmiVersion.startswith("3") else fmpy.platform
    with zipfile.ZipFile(path) as file:
        names = [name.replace("\\", "/") for name in file.namelist()]
    held = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and not name.endswith("/") and name.count("/") > 1})
    if here in held:
        return ""
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    there = f"a library for {', '.join(held)}" if held else "C sources and no library" if sources else "no library"
    return f"the FMU has {there}; this platform is {here}: export the FMU for {here}, or run it on another machine"


def read_description(path: str | Path) -> Any:
    """Return FMPy's model description of an FMU, which is not validated.

    FMPy 0.3 does not read the capabilities of a slave of FMI 1.0; here they are filled in.
    """
    from fmpy import read_model_description

    with zipfile.ZipFile(path) as file:
        size = file.getinfo("modelDescription.xml").file_size
    if size > _LARGEST:
        raise ValueError(f"modelDescription.xml has {size / 1e6:.0f} MB")
    found = read_model_description(str(path), validate=False)
    if found.fmiVersion.startswith("1") and found.coSimulation is not None:
        with zipfile.ZipFile(path) as file:
            root = ElementTree.fromstring(file.read("modelDescription.xml"))
        given = root.find("Implementation//Capabilities")
        words = {} if given is None else given.attrib
        for name in _CAPABILITIES:
            setattr(found.coSimulation, name, words.get(name) in ("true", "1"))
    return found
