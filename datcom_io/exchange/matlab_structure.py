"""Structures of MATLAB's ``datcomimport`` in a MAT file: variables, breakpoints, scalars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from datcom_io.decks.namelists import DIMENSIONS
from datcom_io.exchange.matlab_fields import Units
from flightmech.errors import ParseError

_PART_OF_FLAG = {
    "body": "body",
    "wing": "wing",
    "htail": "horizontal",
    "vtail": "vertical",
    "vfin": "fin",
}
NUMERIC = "fiub"
"""Kinds of NumPy types that hold numbers."""
_REQUIRED_FIELDS = {"mach", "alpha", "dim"}

Structure = Mapping[str, np.ndarray]


def find_structures(file: str, content: Mapping[str, Any]) -> list[Structure]:
    """Return the structures of the one variable of a MAT file that holds them.

    Raises
    ------
    ParseError
        No variable, or several variables, with such structures.
    """
    candidates = {}
    for name, value in content.items():
        if not isinstance(value, np.ndarray):
            continue
        structures = _list_structures(value)
        if structures and all(structure.keys() >= _REQUIRED_FIELDS for structure in structures):
            candidates[name] = structures
    if len(candidates) != 1:
        names = ", ".join(name for name in candidates or content if not name.startswith("__"))
        problem = f"{len(candidates)} of them among the variables {names}"
        expected = (
            "one variable with structures that have the fields mach, alpha and dim, as "
            "datcomimport returns them"
        )
        raise ParseError(file, 0, problem, expected)
    return next(iter(candidates.values()))


def _list_structures(value: np.ndarray) -> list[Structure]:
    """Return the structures in a variable: a structure array, or a cell array of them."""
    # A cell array holds one structure per case.
    items = [value]
    if value.dtype.hasobject and not value.dtype.names:
        items = [item for item in value.ravel() if isinstance(item, np.ndarray)]
    structures: list[Structure] = []
    for item in items:
        if item.dtype.names:
            for record in item.ravel():
                structures.append({str(key): record[key] for key in record.dtype.names})
    return structures


class CaseStructure:
    """One structure with its breakpoints.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    number : int
        Number of the case from 1.
    structure : mapping of str to array
        Fields of the structure by name.
    """

    def __init__(self, file: str, number: int, structure: Structure):
        self.file = file
        self.number = number
        self.structure = structure
        self.machs = self.numbers("mach")
        self.alts = self.numbers("alt")
        self.alphas = self.numbers("alpha")
        self.deltas = self.numbers("delta")
        self.heights = self.numbers("grndht")
        self.loop = int(self.number_of("loop", 1))
        self.style = int(self.number_of("stype", 0))
        dim, deriv = self.text("dim").upper(), self.text("deriv").upper()
        if dim not in DIMENSIONS or deriv not in ("DEG", "RAD"):
            raise self.error(
                f"dim {dim!r} and deriv {deriv!r}",
                f"one of {' '.join(DIMENSIONS)}, and DEG or RAD, in any case",
            )
        # With altitudes the program has the pressure of a jet page in pounds per square foot.
        jet_pressure = "psi"
        if self.alts:
            jet_pressure = "psf"
        self.units = Units(dim, deriv, jet_pressure)
        self.parts = self._parts()
        self.device = "delta_f"
        if {"wing", "horizontal"} <= self.parts:
            self.device = "delta_e"
        self.grid_indices = self._grid_indices()

    def error(self, problem: str, expected: str) -> ParseError:
        """Return an error of this case."""
        return ParseError(self.file, 0, f"case {self.number}: {problem}", expected)

    def numbers(self, name: str) -> list[float]:
        """Return a row vector; empty when it is not there."""
        value = self.structure.get(name, np.empty(0))
        if value.dtype.kind not in NUMERIC:
            return []
        return [float(x) for x in np.ravel(value)]

    def number_of(self, name: str, default: float) -> float:
        """Return a scalar, the default when it is missing or not a finite number."""
        numbers = self.numbers(name)
        if numbers and np.isfinite(numbers[0]):
            return numbers[0]
        return default

    def text(self, name: str) -> str:
        """Return a text, an empty one when it is not there."""
        # MATLAB stores texts as arrays of characters.
        value = np.ravel(self.structure.get(name, np.empty(0)))
        if value.dtype.kind != "U" or not value.size:
            return ""
        return str(value[0]).strip()

    def attrs(self, name: str) -> dict[str, str | float]:
        """Return the attributes of the tree of the case."""
        attrs: dict[str, str | float] = {}
        for quantity, field, units in (
            ("S", "sref", "area"),
            ("cbar", "cbar", "length"),
            ("b", "blref", "length"),
        ):
            numbers = self.numbers(field)
            if numbers:
                attrs[quantity] = numbers[0] * self.units.factor(units)
        return {
            **attrs,
            "dim": self.units.dim,
            "deriv": self.units.deriv,
            "title": self.text("case"),
            "case": name,
            "file": self.file,
        }

    def _parts(self) -> frozenset[str]:
        """Return the parts of the aeroplane by the field ``config``."""
        config = self.structure.get("config")
        if config is None or not config.dtype.names or not config.size:
            return frozenset()
        # The flags may be logicals or numbers.
        record = config.ravel()[0]
        parts = set()
        for flag, part in _PART_OF_FLAG.items():
            if flag in config.dtype.names and np.any(record[flag]):
                parts.add(part)
        return frozenset(parts)

    def _grid_indices(self) -> list[tuple[int, int]]:
        """Return the indices of Mach number and altitude of each condition, in run order."""
        machs, alts = range(max(len(self.machs), 1)), range(max(len(self.alts), 1))
        indices = []
        # LOOP=2 has altitude outside, 3 has Mach number outside, 1 steps both together.
        if self.loop == 2:
            for j in alts:
                indices += [(i, j) for i in machs]
        elif self.loop == 3:
            for i in machs:
                indices += [(i, j) for j in alts]
        else:
            indices = [(i, min(i, len(alts) - 1)) for i in machs]
        return indices
