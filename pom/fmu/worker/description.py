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
