"""An unpacked FMU and its description."""

from __future__ import annotations

import zipfile
from collections import deque
from copy import copy
from ctypes import byref, cdll
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

_CAPABILITIES = (
    "canHandleVariableCommunicationStepSize",
    "canInterpolateInputs",
    "canBeInstantiatedOnlyOncePerProcess",
)


_LARGEST = (
    64_000_000  # bytes of modelDescription.xml; 100 times those of models with 10 000 variables
)


def demand_size(path: str | Path, most: int) -> None:
    """Refuse an FMU whose files are larger, unpacked, than a limit; 0: any. [byte]

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
    """Return that an FMU has no library for this platform, with the platforms that it has one for;
    empty if it has one.

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
    held = sorted(
        {
            name.split("/")[1]
            for name in names
            if name.startswith("binaries/") and not name.endswith("/") and name.count("/") > 1
        }
    )
    if here in held:
        return ""
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    there = (
        f"a library for {', '.join(held)}"
        if held
        else "C sources and no library"
        if sources
        else "no library"
    )
    return (
        f"the FMU has {there}; this platform is {here}: export the FMU for {here}, or run it "
        f"on another machine"
    )


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


class UnpackedFmu:
    """An unpacked FMU.

    Parameters
    ----------
    path : str
        The FMU.
    folder : str
        Where it is unpacked.
    most : int
        Size that its files may have together, unpacked; 0: any. [byte]

    Raises
    ------
    ValueError
        They are larger, or the FMU has no library for this platform.

    Attributes
    ----------
    version : int
        Major version of FMI.
    exchange : bool
        Model exchange: there is no co-simulation, so an integrator of ours steps it.
    takes_records : bool
        The arrays ``replay.n replay.t replay.u replay.y``, as `flightmech.write_fmu` makes them,
        take a whole record in one step.
    most : int
        As given. [byte]
    messages : deque of str
        The last messages of the FMU in warnings and errors.
    """

    def __init__(self, path: str, folder: str, most: int = 0):
        from fmpy import extract

        demand_size(path, most)
        self.most = most
        self.description = read_description(path)
        if problem := platform_problem(path, self.description):
            raise ValueError(problem)
        self.folder = extract(path, folder)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.version = int(self.description.fmiVersion[0])
        self.exchange = self.description.coSimulation is None
        self.messages: deque[str] = deque(maxlen=8)
        self._kept: Any = None
        scalars = [v for v in self.description.modelVariables if not getattr(v, "dimensions", None)]
        self.inputs = [v for v in scalars if v.causality == "input"]
        self.outputs = [v for v in scalars if v.causality == "output"]
        sizes = self._columns("replay.u"), self._columns("replay.y")
        self.takes_records = (
            self.version == 3
            and not self.exchange
            and sizes == (len(self.inputs), len(self.outputs))
        )

    def open(self) -> Any:
        """Return a new instance of FMPy's class for the version and kind.

        Raises
        ------
        RuntimeError
            The FMU refuses.
        """
        from fmpy import fmi1, fmi2

        found = self._bound_again() if self.takes_records else self._bound()
        if self.version == 1:
            _repair_status(found)
            found.instantiate(functions=self._callbacks1(fmi1), loggingOn=True)
        elif self.version == 2:
            found.instantiate(callbacks=self._callbacks2(fmi2), loggingOn=True)
        else:
            found.instantiate(loggingOn=True, logMessage=self._log3)
        if not found.component:
            raise RuntimeError("the FMU gave no instance")
        return found

    def _bound(self) -> Any:
        """Return an object of FMPy's class, whose functions are those of the library, without an
        instance.
        """
        from fmpy import fmi1, fmi2, fmi3

        classes = {
            1: (fmi1.FMU1Slave, fmi1.FMU1Model),
            2: (fmi2.FMU2Slave, fmi2.FMU2Model),
            3: (fmi3.FMU3Slave, fmi3.FMU3Model),
        }
        kind = self.description.modelExchange if self.exchange else self.description.coSimulation
        return classes[self.version][self.exchange](
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=kind.modelIdentifier,
            instanceName="model",
        )

    def _bound_again(self) -> Any:
        """Return what `_bound` does; FMPy looks at the signatures of all functions once, which
        takes as long as a flight of some seconds.

        The library stays loaded.  That of an FMU that takes records holds nothing outside its
        instances; one of another origin is loaded anew for each of them.
        """
        if self._kept is None:
            self._kept = self._bound()
        found = copy(self._kept)
        found.dll = cdll.LoadLibrary(
            found.dll._name
        )  # a handle of its own, which the end of the instance gives back
        return found

    def _columns(self, name: str) -> int:
        """Return the number of columns of an array with one row per sample of ``replay.n``; 0:
        there is none.
        """
        variable = self.variables.get(name)
        dimensions = getattr(variable, "dimensions", None) or []
        rows = dimensions[0].variable if len(dimensions) == 2 else None
        return (dimensions[1].start or 0) if rows is not None and rows.name == "replay.n" else 0

    def _callbacks1(self, fmi1) -> Any:
        callbacks = fmi1.fmi1CallbackFunctions()
        callbacks.logger = fmi1.fmi1CallbackLoggerTYPE(
            lambda _, name, status, category, message: self._log(status, message)
        )
        callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(fmi1.calloc)
        callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(fmi1.free)
        callbacks.stepFinished = None
        return _with_formatted_messages(callbacks)

    def _callbacks2(self, fmi2) -> Any:
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
    """Return callbacks whose logger gets the finished text; FMPy's native proxy puts in the
    variadic arguments.
    """
    from fmpy.logging import addLoggerProxy

    addLoggerProxy(byref(callbacks))
    return callbacks


def _repair_status(instance: Any) -> None:
    """Have the functions of FMI 1.0 return their status.

    FMPy 0.3 declares the result of most of them as a text; a status other than zero would be read
    as an address.
    """
    from ctypes import c_char_p, c_int

    for name, function in instance._functions.items():
        if function.restype is c_char_p and not name.endswith(("Version", "TypesPlatform")):
            function.restype = c_int
