"""An FMU as its description declares it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .file_state import FileState


@dataclass(frozen=True)
class Fmu:
    """Interface of an FMU: names and units (empty: not declared) of scalar numbers.

    Attributes
    ----------
    path : Path
    version : str
        FMI version.
    sha256 : str
        Of the file.
    inputs, outputs, parameters : dict of str to str
        Name to unit.
    settable : dict of str to str
        Variables that are no parameters but take a start value.
    exchange : bool
        Model exchange, for want of co-simulation.
    even : bool
        It takes steps of one length only.
    step : float
        That length; 0: any. [s]
    once : bool
        It can be instantiated only once in a process.
    state : FileState, optional
        Of the file when it was read.
    """

    path: Path
    version: str
    sha256: str
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, str]
    settable: Mapping[str, str] = field(default_factory=dict)
    exchange: bool = False
    even: bool = False
    step: float = 0.0
    once: bool = False
    state: FileState | None = None
