"""Records of a DAVE-ML file: header, variables, functions and check cases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded, Scattered


@dataclass(frozen=True)
class DaveProvenance:
    """Author and date of an item, its documents (refIDs) and its modifications (modIDs)."""

    authors: tuple[str, ...] = ()
    date: str = ""
    references: tuple[str, ...] = ()
    modifications: tuple[str, ...] = ()
    description: str = ""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a value or a table.

    Parameters
    ----------
    effect : str
        ``additive``, ``multiplicative``, ``percentage`` or ``absolute``.
    sigmas : float
        Standard deviations that a bound stands for; 0 for a uniform distribution.
    bounds : tuple of array or str
        One or two entries: an array, of one value or of the shape of the table, or the varID of
        the variable that holds it.
    """

    effect: str
    sigmas: float
    bounds: tuple[np.ndarray | str, ...]


@dataclass(frozen=True)
class DaveReference:
    """A document that the file refers to."""

    refID: str
    author: str
    title: str
    date: str
    accession: str = ""


@dataclass(frozen=True)
class Modification:
    """One entry of the modification record."""

    modID: str
    date: str
    authors: tuple[str, ...]
    description: str


@dataclass(frozen=True)
class Header:
    """The file header."""

    name: str = ""
    authors: tuple[str, ...] = ()
    date: str = ""
    version: str = ""
    description: str = ""
    references: tuple[DaveReference, ...] = ()
    modifications: tuple[Modification, ...] = ()


@dataclass(frozen=True, eq=False)
class DaveVariable:
    """A ``variableDef``; ``low`` and ``high`` limit its value, from whichever source."""

    varID: str
    name: str
    units: str
    line: int
    description: str = ""
    sign: str = ""
    axis_system: str = ""
    initial: float | None = None
    low: float = -np.inf
    high: float = np.inf
    calculation: mathml.Expression | None = None
    is_input: bool = False
    is_output: bool = False
    is_standard: bool = False
    uncertainty: Uncertainty | None = None
    provenance: DaveProvenance | None = None


@dataclass(frozen=True, eq=False)
class DaveFunction:
    """A table look-up of the variable ``output`` over the variables ``inputs``.

    ``index`` is the position of the function in the file.
    """

    name: str
    inputs: tuple[str, ...]
    output: str
    axes: tuple[FunctionAxis, ...]
    table: Gridded | Scattered
    line: int
    index: int
    description: str = ""
    uncertainty: Uncertainty | None = None
    provenance: DaveProvenance | None = None


@dataclass(frozen=True)
class Signal:
    """A value of a check case.

    Parameters
    ----------
    key : str
        Name of the variable, or its varID.
    is_varID : bool
        Whether the key is a varID.
    units : str
        Unit code of the value.
    value : float
        The value.
    tolerance : float
        Absolute tolerance; NaN if the file states none.
    """

    key: str
    is_varID: bool
    units: str
    value: float
    tolerance: float = np.nan


@dataclass(frozen=True)
class Shot:
    """A ``staticShot``: inputs, internal values and outputs of one check case."""

    name: str
    inputs: tuple[Signal, ...]
    internal: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
