"""The description of an FMU, with what FMPy leaves out of it."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

_CAPABILITIES = ("canHandleVariableCommunicationStepSize", "canInterpolateInputs", "canBeInstantiatedOnlyOncePerProcess")


def read_description(path: str | Path) -> Any:
    """Return FMPy's model description of an FMU, which is not validated.

    FMPy 0.3 does not read the capabilities of a slave of FMI 1.0; here they are filled in.
    """
    from fmpy import read_model_description

    found = read_model_description(str(path), validate=False)
    if found.fmiVersion.startswith("1") and found.coSimulation is not None:
        with zipfile.ZipFile(path) as file:
            root = ElementTree.fromstring(file.read("modelDescription.xml"))
        given = root.find("Implementation//Capabilities")
        words = {} if given is None else given.attrib
        for name in _CAPABILITIES:
            setattr(found.coSimulation, name, words.get(name) in ("true", "1"))
    return found
