"""A DAVE-ML model: variables, functions, check data; evaluated over arrays and checked against its
own shots.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded, Scattered
from aerodb.exchange.daveml.document.units import convert_between, same_units
from flightmech.errors import OutOfRange, SchemaError, UnitError, UnknownName

_INTERNAL_TOLERANCE = (
    1e-6  # relative; the format gives internal values no tolerance, NASA's outputs carry 1e-6
)


@dataclass(frozen=True)
class DaveProvenance:
    """Who made something, when, after which documents and in which modifications; references are
    refIDs and modIDs of the header.
    """

    authors: tuple[str, ...] = ()
    date: str = ""
    references: tuple[str, ...] = ()
    modifications: tuple[str, ...] = ()
    description: str = ""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Spread of a value: ``effect`` additive, multiplicative, percentage or absolute; ``sigmas`` 0
    for a uniform distribution.

    ``bounds`` holds one or two entries: an array, of one value or of the shape of the table, or the
    varID of the variable that holds it.
    """

    effect: str
    sigmas: float
    bounds: tuple[np.ndarray | str, ...]


@dataclass(frozen=True)
class DaveReference:
    """A document the file refers to."""

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
    """A ``variableDef``; ``low`` and ``high`` limit its value, however it came about."""

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
    """A table look-up that gives the variable ``output`` from the variables ``inputs``; ``place``
    counts the functions of the file.
    """

    name: str
    inputs: tuple[str, ...]
    output: str
    axes: tuple[FunctionAxis, ...]
    table: Gridded | Scattered
    line: int
    place: int
    description: str = ""
    uncertainty: Uncertainty | None = None
    provenance: DaveProvenance | None = None


@dataclass(frozen=True)
class Signal:
    """A value of a check case: ``key`` is a name, or a varID; ``tolerance`` is absolute, NaN when
    the file gives none.
    """

    key: str
    is_varID: bool
    units: str
    value: float
    tolerance: float = np.nan


@dataclass(frozen=True)
class Shot:
    """A ``staticShot``."""

    name: str
    inputs: tuple[Signal, ...]
    internal: tuple[Signal, ...]
    outputs: tuple[Signal, ...]


@dataclass(frozen=True, eq=False)
class DaveModel:
    """The content of a DAVE-ML file.

    Parameters
    ----------
    file : str
        Name of the file.
    header : Header
        Title, authors, references, modifications.
    variables : dict of str to Variable
        By varID, in the order of the file.
    functions : dict of str to Function
        By the varID of their output.
    order : tuple of str
        varIDs in an order in which they can be computed.
    shots : tuple of Shot
        The check data.
    notes : tuple of str
        What in the file is deprecated, ambiguous or was put right while reading.
    """

    file: str
    header: Header
    variables: dict[str, DaveVariable]
    functions: dict[str, DaveFunction]
    order: tuple[str, ...]
    shots: tuple[Shot, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """varIDs of the inputs: marked as such, or neither constant nor computed."""
        return tuple(
            varID
            for varID, variable in self.variables.items()
            if variable.is_input or not self._computed(variable)
        )

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """varIDs of the outputs: marked as such, or computed and used by nothing else (the rule of
        the reference manual).
        """
        used = {name for function in self.functions.values() for name in function.inputs}
        used |= {
            name
            for v in self.variables.values()
            if v.calculation is not None
            for name in mathml.expression_variables(v.calculation)
        }
        final = {varID for varID in (*self.functions, *self._calculated) if varID not in used}
        return tuple(
            varID
            for varID, variable in self.variables.items()
            if variable.is_output or varID in final
        )

    def find(self, name: str) -> DaveVariable:
        """Return the variable of a varID, or the one of this name.

        Raises
        ------
        UnknownName
            There is none, or the name belongs to several.
        """
        if name in self.variables:
            return self.variables[name]
        found = [variable for variable in self.variables.values() if variable.name == name]
        if len(found) == 1:
            return found[0]
        if found:
            raise UnknownName(
                name,
                (v.varID for v in found),
                "varID",
                f"{len(found)} variables of the file have this name",
            )
        raise UnknownName(name, self.variables, "variable", f"of {self.file}")

    def signal(self, signal: Signal) -> DaveVariable:
        """Return the variable of a signal; its name counts before a varID that is the same word.

        Of several variables with the name the one in the units of the signal is taken, else the one
        whose units can be converted.

        Raises
        ------
        UnknownName
            As `find`; also when the units leave several variables of one name, or none.
        """
        named = (
            []
            if signal.is_varID
            else [variable for variable in self.variables.values() if variable.name == signal.key]
        )
        if len(named) < 2:
            return named[0] if named else self.find(signal.key)
        equal = [variable for variable in named if variable.units.strip() == signal.units.strip()]
        alike = [variable for variable in named if same_units(signal.units, variable.units)]
        convertible = [
            variable for variable in named if convert_between(signal.units, variable.units)
        ]
        found = equal or alike or convertible
        if len(found) == 1:
            return found[0]
        listed = ", ".join(
            f"{variable.varID} in {variable.units or 'no unit'}" for variable in named
        )
        text = (
            f"{listed} have this name, the signal is in {signal.units or 'no unit'}; give "
            f"signalUnits of one of them, or its varID"
        )
        raise UnknownName(signal.key, (variable.varID for variable in named), "signal", text)

    def converted(self, signal: Signal) -> Signal:
        """Return a signal with value and tolerance in the units of its variable.

        Raises
        ------
        UnknownName
            As `signal`.
        UnitError
            Its units are those of another quantity.
        """
        variable = self.signal(signal)
        scale = convert_between(signal.units, variable.units)
        if scale is None:
            raise UnitError(
                f"given in {signal.units}, the variable is in {variable.units or 'no unit'}: "
                "no conversion between them; correct signalUnits"
            )
        factor, offset = scale
        return replace(
            signal,
            units=variable.units,
            value=factor * signal.value + offset if offset else factor * signal.value,
            tolerance=abs(factor) * signal.tolerance,
        )

    def evaluate(self, inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the outputs of the model.

        Parameters
        ----------
        inputs : mapping of str to array
            By varID or by name, in the units of the file, broadcast against each other.  An input
            with an initial value may be left out, and a constant may be given another value.

        Returns
        -------
        dict of str to array (broadcast shape of the inputs)
            By varID, in the units of the file.  NaN where a calculation has no value.

        Raises
        ------
        UnknownName
            An input that the file does not have, or one that is missing.
        SchemaError
            A value for a variable that the model computes.
        OutOfRange
            An input between the points of an ungridded table.
        """
        values = self._values(inputs)
        return {varID: values[varID].copy() for varID in self.outputs}

    def rests_on(self, wanted: Iterable[str]) -> set[str]:
        """Return the varIDs that variables are computed from, themselves included."""
        found: set[str] = set()
        waiting = list(wanted)
        while waiting:
            varID = waiting.pop()
            if varID not in found:
                found.add(varID)
                calculation = self.variables[varID].calculation
                waiting += (
                    mathml.expression_variables(calculation) if calculation is not None else ()
                )
                waiting += self.functions[varID].inputs if varID in self.functions else ()
        return found

    def values(self, wanted: Iterable[str], inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return all variables that the wanted ones rest on, by varID; inputs, units and errors as
        `evaluate`.
        """
        needed = self.rests_on(wanted)
        return self._values(inputs, [varID for varID in self.order if varID in needed])

    def check(self) -> pd.DataFrame:
        """Run every shot of the check data.

        Returns
        -------
        DataFrame
            One row per output and internal value: ``shot kind variable expected found tolerance
            passed note``.  Outputs are judged by the tolerance of the file, internal values, which
            have none, by 1e-6 of their size.
        """

        return pd.DataFrame(
            self._checked,
            columns=[
                "shot",
                "kind",
                "variable",
                "expected",
                "found",
                "tolerance",
                "passed",
                "note",
            ],
        )

    @property
    def _calculated(self) -> list[str]:
        return [
            varID for varID, variable in self.variables.items() if variable.calculation is not None
        ]

    def _computed(self, variable: DaveVariable) -> bool:
        return (
            variable.calculation is not None
            or variable.varID in self.functions
            or variable.initial is not None
        )

    def _values(
        self, inputs: Mapping[str, Any], order: Iterable[str] | None = None
    ) -> dict[str, np.ndarray]:
        given = {self.find(name).varID: np.asarray(item, float) for name, item in inputs.items()}
        shape = np.broadcast_shapes(*(np.shape(item) for item in given.values()))
        values: dict[str, np.ndarray] = {}
        with np.errstate(
            all="ignore"
        ):  # branches of a piecewise that do not count may divide by zero
            for varID in self.order if order is None else order:
                variable = self.variables[varID]
                value = self._raw(variable, given, values, shape)
                if np.isfinite((variable.low, variable.high)).any():
                    value = np.clip(value, variable.low, variable.high)
                values[varID] = np.broadcast_to(value, shape)
        return values

    def _raw(
        self,
        variable: DaveVariable,
        given: Mapping,
        values: Mapping[str, np.ndarray],
        shape: tuple[int, ...],
    ) -> np.ndarray:
        varID = variable.varID
        if variable.calculation is not None or varID in self.functions:
            if varID in given:
                raise SchemaError(
                    f"inputs of {self.file}", [f"{varID} is computed by the model; leave it out"]
                )
            if variable.calculation is not None:
                return mathml.evaluate_mathml(variable.calculation, values)
            function = self.functions[varID]
            flat = [values[name].ravel() for name in function.inputs]
            return function.table.look_up(function.axes, flat).reshape(shape)
        if varID in given:
            return given[varID]
        if variable.initial is None:
            raise UnknownName(
                varID,
                given,
                "input",
                f"{self.file} needs {varID} ({variable.name}, in {variable.units or 'no unit'})",
            )
        return np.asarray(variable.initial)

    @cached_property
    def _checked(self) -> list[tuple]:
        """The rows of `check`; shots with the same inputs are run together, unless that fails."""
        groups = [
            list(group)
            for _, group in groupby(
                self.shots, lambda shot: tuple((s.key, s.units) for s in shot.inputs)
            )
        ]
        rows: list[tuple] = []
        for group in groups:
            try:
                rows += self._run(group)
            except (UnknownName, SchemaError, OutOfRange):
                rows += [row for shot in group for row in self._run_alone(shot)]
        return rows

    def _run_alone(self, shot: Shot) -> list[tuple]:
        try:
            return self._run([shot])
        except (UnknownName, SchemaError, OutOfRange) as error:
            return [(shot.name, "shot", "", np.nan, np.nan, np.nan, False, str(error))]

    def _run(self, shots: Sequence[Shot]) -> list[tuple]:
        given = [
            {self.signal(signal).varID: self._readable(signal) for signal in shot.inputs}
            for shot in shots
        ]
        together = self._values(
            {varID: np.array([inputs[varID][0].value for inputs in given]) for varID in given[0]}
        )
        rows: list[tuple] = []
        for i, (shot, inputs) in enumerate(zip(shots, given, strict=True)):
            values = {
                varID: np.broadcast_to(value, len(shots))[i] for varID, value in together.items()
            }
            for varID, (signal, note) in inputs.items():
                if note:
                    rows.append(
                        (shot.name, "input", varID, signal.value, signal.value, np.nan, False, note)
                    )
            for kind, signals in (("internal", shot.internal), ("output", shot.outputs)):
                rows += [(shot.name, kind, *self._judged(signal, values)) for signal in signals]
        return rows

    def _judged(self, signal: Signal, values: Mapping[str, np.ndarray]) -> tuple:
        try:
            varID = self.signal(signal).varID
        except UnknownName as error:
            return signal.key, signal.value, np.nan, signal.tolerance, False, str(error)
        found, (due, note) = float(values[varID]), self._readable(signal)
        allowed = (
            _INTERNAL_TOLERANCE * max(abs(due.value), 1e-3)
            if np.isnan(due.tolerance)
            else due.tolerance
        )
        # one rounding of the printed values is allowed in addition to the tolerance, which some
        # files make as small as that
        passed = abs(found - due.value) <= allowed + 4.0 * np.spacing(abs(due.value)) and not note
        return varID, due.value, found, due.tolerance, bool(passed), note

    def _readable(self, signal: Signal) -> tuple[Signal, str]:
        """Return a signal in the units of its variable, or as it stands with the reason why it
        cannot be converted.
        """
        try:
            return self.converted(signal), ""
        except UnitError as error:
            return signal, str(error)
