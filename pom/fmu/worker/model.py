"""An unpacked FMU and its description."""

from __future__ import annotations

import zipfile
from collections import deque
from copy import copy
from ctypes import byref, c_char_p, c_int, cdll
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
from fmpy import extract, fmi1, fmi2, fmi3, read_model_description

_CAPABILITIES = (
    "canHandleVariableCommunicationStepSize",
    "canInterpolateInputs",
    "canBeInstantiatedOnlyOncePerProcess",
)
# Bytes of modelDescription.xml: 100 times those of a model with 10 000 variables.
_LARGEST = 64_000_000


def demand_unpacked_size(path: str | Path, most: int) -> None:
    """Raise if the unpacked files of an FMU are larger than a limit; 0: no limit. [byte]

    Raises
    ------
    ValueError
    """
    with zipfile.ZipFile(path) as file:
        size = sum(item.file_size for item in file.infolist())
    if most and size > most:
        raise ValueError(
            f"its files have {size / 1e6:.0f} MB unpacked, allowed are {most / 1e6:.0f} MB "
            f"(AEROMATCH_FMU_UNPACKED)"
        )


def platform_problem(path: str | Path, description: Any) -> str:
    """Return the text that an FMU has no library for this platform; empty if it has one.

    The text names the platforms of its libraries.

    Parameters
    ----------
    path : path
        The FMU.
    description : ModelDescription
        From `read_description`.
    """
    # FMI 3.0 names platforms by architecture and system, such as x86_64-linux.
    here = fmpy.platform
    if description.fmiVersion.startswith("3"):
        here = fmpy.platform_tuple
    with zipfile.ZipFile(path) as file:
        names = [name.replace("\\", "/") for name in file.namelist()]
    platforms: set[str] = set()
    for name in names:
        # A library is a file of a folder: binaries/PLATFORM/...
        is_file = not name.endswith("/") and name.count("/") > 1
        if name.startswith("binaries/") and is_file:
            platforms.add(name.split("/")[1])
    if here in platforms:
        return ""
    content = "no library"
    if platforms:
        content = f"a library for {', '.join(sorted(platforms))}"
    elif any(name.startswith("sources/") and name.endswith(".c") for name in names):
        content = "C sources and no library"
    return (
        f"the FMU has {content}; this platform is {here}: export the FMU for {here}, or run it "
        f"on another machine"
    )


def read_description(path: str | Path) -> Any:
    """Return FMPy's model description of an FMU, which is not validated.

    FMPy 0.3 does not read the capabilities of a slave of FMI 1.0. They are added here.
    """
    with zipfile.ZipFile(path) as file:
        size = file.getinfo("modelDescription.xml").file_size
    if size > _LARGEST:
        raise ValueError(f"modelDescription.xml has {size / 1e6:.0f} MB")
    description = read_model_description(str(path), validate=False)
    if description.fmiVersion.startswith("1") and description.coSimulation is not None:
        with zipfile.ZipFile(path) as file:
            root = ElementTree.fromstring(file.read("modelDescription.xml"))
        element = root.find("Implementation//Capabilities")
        for name in _CAPABILITIES:
            # A missing capability is false.
            text = None if element is None else element.get(name)
            setattr(description.coSimulation, name, text in ("true", "1"))
    return description


class UnpackedFmu:
    """An unpacked FMU.

    Parameters
    ----------
    path : str
        The FMU.
    folder : str
        Folder for its files.
    most : int
        Largest size of all unpacked files; 0: no limit. [byte]

    Raises
    ------
    ValueError
        The files are larger, or the FMU has no library for this platform.

    Attributes
    ----------
    version : int
        Major version of FMI.
    exchange : bool
        Whether it has no co-simulation. `Exchange` then integrates its states.
    takes_records : bool
        Whether one step simulates a whole record, through the arrays ``replay.n replay.t replay.u
        replay.y`` of `flightmech.write_fmu`.
    most : int
        The parameter. [byte]
    messages : deque of str
        The last messages of the FMU in warnings and errors.
    """

    def __init__(self, path: str, folder: str, most: int = 0):
        demand_unpacked_size(path, most)
        self.most = most
        self.description = read_description(path)
        problem = platform_problem(path, self.description)
        if problem:
            raise ValueError(problem)
        self.folder = extract(path, folder)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.version = int(self.description.fmiVersion[0])
        self.exchange = self.description.coSimulation is None
        self.messages: deque[str] = deque(maxlen=8)
        # An object of FMPy's class without an instance, for `_copy_bound_class`.
        self._bound_class: Any = None
        self.inputs: list[Any] = []
        self.outputs: list[Any] = []
        for variable in self.description.modelVariables:
            # Only the arrays of a whole record have dimensions.
            if getattr(variable, "dimensions", None):
                continue
            if variable.causality == "input":
                self.inputs.append(variable)
            elif variable.causality == "output":
                self.outputs.append(variable)
        sizes = self._count_columns("replay.u"), self._count_columns("replay.y")
        has_arrays = sizes == (len(self.inputs), len(self.outputs))
        self.takes_records = self.version == 3 and not self.exchange and has_arrays

    def open(self) -> Any:
        """Return a new instance of FMPy's class for the version and kind.

        Raises
        ------
        RuntimeError
            The FMU refuses.
        """
        if self.takes_records:
            instance = self._copy_bound_class()
        else:
            instance = self._bind_class()
        if self.version == 1:
            _repair_status(instance)
            instance.instantiate(functions=self._callbacks1(), loggingOn=True)
        elif self.version == 2:
            instance.instantiate(callbacks=self._callbacks2(), loggingOn=True)
        else:
            instance.instantiate(loggingOn=True, logMessage=self._log3)
        if not instance.component:
            raise RuntimeError("the FMU gave no instance")
        return instance

    def _bind_class(self) -> Any:
        """Return an object of FMPy's class with the functions of the library, not instantiated."""
        classes = {
            1: (fmi1.FMU1Slave, fmi1.FMU1Model),
            2: (fmi2.FMU2Slave, fmi2.FMU2Model),
            3: (fmi3.FMU3Slave, fmi3.FMU3Model),
        }
        kind = self.description.coSimulation
        if self.exchange:
            kind = self.description.modelExchange
        return classes[self.version][self.exchange](
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=kind.modelIdentifier,
            instanceName="model",
        )

    def _copy_bound_class(self) -> Any:
        """Return a copy of one result of `_bind_class`.

        FMPy takes as long to bind the functions as a flight of some seconds takes. The library
        stays loaded. An FMU that takes records has no state outside its instances. The library of
        any other FMU is loaded again for every instance.
        """
        if self._bound_class is None:
            self._bound_class = self._bind_class()
        bound = copy(self._bound_class)
        # Each instance needs a handle of the library, which its end releases.
        bound.dll = cdll.LoadLibrary(bound.dll._name)
        return bound

    def _count_columns(self, name: str) -> int:
        """Return the columns of an array with one row per sample of ``replay.n``; 0 without it."""
        variable = self.variables.get(name)
        dimensions = getattr(variable, "dimensions", None) or []
        if len(dimensions) != 2:
            return 0
        rows, columns = dimensions
        if rows.variable is None or rows.variable.name != "replay.n":
            return 0
        return columns.start or 0

    def _callbacks1(self) -> Any:
        callbacks = fmi1.fmi1CallbackFunctions()
        callbacks.logger = fmi1.fmi1CallbackLoggerTYPE(
            lambda _, name, status, category, message: self._log(status, message)
        )
        callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(fmi1.calloc)
        callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(fmi1.free)
        callbacks.stepFinished = None
        return _with_formatted_messages(callbacks)

    def _callbacks2(self) -> Any:
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda _, name, status, category, message: self._log(status, message)
        )
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        return _with_formatted_messages(callbacks)

    def _log3(self, environment, status, category, message) -> None:
        self._log(status, message)

    def _log(self, status: int, message: bytes | None) -> None:
        if status > 0 and message:
            self.messages.append(message.decode("utf-8", "replace"))


def _with_formatted_messages(callbacks: Any) -> Any:
    """Return callbacks whose logger gets complete texts.

    The native proxy of FMPy inserts the variadic arguments of a message.
    """
    # not every platform has this library of FMPy
    from fmpy.logging import addLoggerProxy

    addLoggerProxy(byref(callbacks))
    return callbacks


def _repair_status(instance: Any) -> None:
    """Make the functions of FMI 1.0 return their status.

    FMPy 0.3 declares the result of most of them as a text. A status other than zero would be read
    as an address.
    """
    for name, function in instance._functions.items():
        if function.restype is c_char_p and not name.endswith(("Version", "TypesPlatform")):
            function.restype = c_int
