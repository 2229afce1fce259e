"""DAVE-ML model with evaluation over arrays and comparison with its check cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.elements import (
    DaveFunction,
    DaveVariable,
    Header,
    Shot,
    Signal,
)
from aerodb.exchange.daveml.document.units import convert_between, same_units
from flightmech.errors import OutOfRange, SchemaError, UnitError, UnknownName

# Relative tolerance of internal values. The format states none, and NASA's outputs have 1e-6.
_INTERNAL_TOLERANCE = 1e-6
_LEAST_SIZE = 1e-3  # lower limit of the size of an internal value
# Roundings of the printed value that are allowed in addition to the tolerance.
_ROUNDINGS = 4.0
_CHECK_COLUMNS = (
    "shot",
    "kind",
    "variable",
    "expected",
    "found",
    "tolerance",
    "passed",
    "note",
)


@dataclass(frozen=True, eq=False)
class DaveModel:
    """The content of a DAVE-ML file.

    Parameters
    ----------
    file : str
        Name of the file.
    header : Header
        Title, authors, references, modifications.
    variables : dict of str to DaveVariable
        By varID, in the order of the file.
    functions : dict of str to DaveFunction
        By the varID of their output.
    order : tuple of str
        varIDs in an order in which they can be computed.
    shots : tuple of Shot
        The check data.
    notes : tuple of str
        Remarks on deprecated, ambiguous or corrected parts of the file.
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
        names = []
        for varID, variable in self.variables.items():
            has_value = self._is_computed(variable) or variable.initial is not None
            if variable.is_input or not has_value:
                names.append(varID)
        return tuple(names)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """varIDs of the outputs: marked as such, or computed and not used by another variable.

        This is the rule of the reference manual.
        """
        used: set[str] = set()
        for function in self.functions.values():
            used.update(function.inputs)
        for variable in self.variables.values():
            if variable.calculation is not None:
                used.update(mathml.expression_variables(variable.calculation))
        names = []
        for varID, variable in self.variables.items():
            is_final = self._is_computed(variable) and varID not in used
            if variable.is_output or is_final:
                names.append(varID)
        return tuple(names)

    def find(self, name: str) -> DaveVariable:
        """Return the variable of a varID, or the one of this name.

        Raises
        ------
        UnknownName
            No variable has the name, or several have it.
        """
        if name in self.variables:
            return self.variables[name]
        matches = [variable for variable in self.variables.values() if variable.name == name]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise UnknownName(
                name,
                (variable.varID for variable in matches),
                "varID",
                f"{len(matches)} variables of the file have this name",
            )
        raise UnknownName(name, self.variables, "variable", f"of {self.file}")

    def signal(self, signal: Signal) -> DaveVariable:
        """Return the variable of a signal; a name takes precedence over an equal varID.

        If several variables have the name, the unit of the signal decides: the variable in the same
        unit, or else the only one whose unit can be converted.

        Raises
        ------
        UnknownName
            As `find`; also if the units leave several variables of one name, or none.
        """
        named = []
        if not signal.is_varID:
            named = [item for item in self.variables.values() if item.name == signal.key]
        if not named:
            return self.find(signal.key)
        if len(named) == 1:
            return named[0]
        # From the narrowest criterion to the widest: same code, same unit, same quantity.
        equal = [item for item in named if item.units.strip() == signal.units.strip()]
        alike = [item for item in named if same_units(signal.units, item.units)]
        convertible = [item for item in named if convert_between(signal.units, item.units)]
        candidates = equal or alike or convertible
        if len(candidates) == 1:
            return candidates[0]
        listed = ", ".join(f"{item.varID} in {item.units or 'no unit'}" for item in named)
        text = (
            f"{listed} have this name, the signal is in {signal.units or 'no unit'}; give "
            f"signalUnits of one of them, or its varID"
        )
        raise UnknownName(signal.key, (item.varID for item in named), "signal", text)

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
        value = factor * signal.value
        # The sum with a zero offset would change the sign of a negative zero.
        if offset:
            value = value + offset
        tolerance = abs(factor) * signal.tolerance
        return replace(signal, units=variable.units, value=value, tolerance=tolerance)

    def evaluate(self, inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the outputs of the model.

        Parameters
        ----------
        inputs : mapping of str to array
            By varID or by name, in the units of the file, broadcast against each other.  An input
            with an initial value may be left out, and a constant may have another value.

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
        values = self._compute(inputs, self.order)
        return {varID: values[varID].copy() for varID in self.outputs}

    def rests_on(self, names: Iterable[str]) -> set[str]:
        """Return the varIDs from which variables are computed, and the variables themselves."""
        needed: set[str] = set()
        stack = list(names)
        while stack:
            varID = stack.pop()
            if varID in needed:
                continue
            needed.add(varID)
            calculation = self.variables[varID].calculation
            if calculation is not None:
                stack += mathml.expression_variables(calculation)
            if varID in self.functions:
                stack += self.functions[varID].inputs
        return needed

    def values(self, names: Iterable[str], inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the variables and all variables they are computed from, by varID.

        Inputs, units and errors are those of `evaluate`.
        """
        needed = self.rests_on(names)
        return self._compute(inputs, [varID for varID in self.order if varID in needed])

    def check(self) -> pd.DataFrame:
        """Run every shot of the check data.

        Returns
        -------
        DataFrame
            One row per output and internal value: ``shot kind variable expected found tolerance
            passed note``.  An output has the tolerance of the file.  An internal value has none in
            the file, and 1e-6 of its size is allowed.
        """
        return pd.DataFrame(self._check_rows, columns=list(_CHECK_COLUMNS))

    def _is_computed(self, variable: DaveVariable) -> bool:
        return variable.calculation is not None or variable.varID in self.functions

    def _compute(self, inputs: Mapping[str, Any], order: Iterable[str]) -> dict[str, np.ndarray]:
        """Return the variables in `order` by varID, of the broadcast shape of the inputs."""
        arrays = {self.find(name).varID: np.asarray(item, float) for name, item in inputs.items()}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        values: dict[str, np.ndarray] = {}
        # All branches of a piecewise are evaluated. An unused branch may divide by zero.
        with np.errstate(all="ignore"):
            for varID in order:
                variable = self.variables[varID]
                value = self._compute_variable(variable, arrays, values, shape=shape)
                if np.isfinite((variable.low, variable.high)).any():
                    value = np.clip(value, variable.low, variable.high)
                values[varID] = np.broadcast_to(value, shape)
        return values

    def _compute_variable(
        self,
        variable: DaveVariable,
        inputs: Mapping[str, np.ndarray],
        values: Mapping[str, np.ndarray],
        shape: tuple[int, ...],
    ) -> np.ndarray:
        """Return a variable before its limits are applied."""
        varID = variable.varID
        if self._is_computed(variable):
            if varID in inputs:
                raise SchemaError(
                    f"inputs of {self.file}", [f"{varID} is computed by the model; leave it out"]
                )
            if variable.calculation is not None:
                return mathml.evaluate_mathml(variable.calculation, values)
            function = self.functions[varID]
            samples = [values[name].ravel() for name in function.inputs]
            return function.table.look_up(function.axes, samples).reshape(shape)
        if varID in inputs:
            return inputs[varID]
        if variable.initial is None:
            raise UnknownName(
                varID,
                inputs,
                "input",
                f"{self.file} needs {varID} ({variable.name}, in {variable.units or 'no unit'})",
            )
        return np.asarray(variable.initial)

    @cached_property
    def _check_rows(self) -> list[tuple[Any, ...]]:
        """The rows of `check`."""
        rows: list[tuple[Any, ...]] = []
        # Consecutive shots with the same inputs are evaluated in one pass. If one of them fails,
        # each is evaluated alone.
        for _, shots in groupby(self.shots, _input_key):
            group = list(shots)
            try:
                rows += self._run_shots(group)
            except (UnknownName, SchemaError, OutOfRange):
                for shot in group:
                    rows += self._run_shot(shot)
        return rows

    def _run_shot(self, shot: Shot) -> list[tuple[Any, ...]]:
        try:
            return self._run_shots([shot])
        except (UnknownName, SchemaError, OutOfRange) as error:
            return [(shot.name, "shot", "", np.nan, np.nan, np.nan, False, str(error))]

    def _run_shots(self, shots: Sequence[Shot]) -> list[tuple[Any, ...]]:
        """Return the rows of shots with the same inputs."""
        inputs: list[dict[str, tuple[Signal, str]]] = []
        for shot in shots:
            signals = {}
            for signal in shot.inputs:
                signals[self.signal(signal).varID] = self._convert_or_note(signal)
            inputs.append(signals)
        arrays = {}
        for varID in inputs[0]:
            arrays[varID] = np.array([signals[varID][0].value for signals in inputs])
        all_values = self._compute(arrays, self.order)
        rows: list[tuple[Any, ...]] = []
        for i, shot in enumerate(shots):
            values = {}
            for varID, value in all_values.items():
                values[varID] = np.broadcast_to(value, len(shots))[i]
            # An input whose unit cannot be converted is a fault of the shot.
            for varID, (signal, note) in inputs[i].items():
                if note:
                    number = signal.value
                    rows.append((shot.name, "input", varID, number, number, np.nan, False, note))
            for signal in shot.internal:
                rows.append((shot.name, "internal", *self._compare_signal(signal, values)))
            for signal in shot.outputs:
                rows.append((shot.name, "output", *self._compare_signal(signal, values)))
        return rows

    def _compare_signal(self, signal: Signal, values: Mapping[str, np.ndarray]) -> tuple[Any, ...]:
        """Return variable, expected, found, tolerance, passed and note of a signal."""
        try:
            varID = self.signal(signal).varID
        except UnknownName as error:
            return signal.key, signal.value, np.nan, signal.tolerance, False, str(error)
        computed = float(values[varID])
        converted, note = self._convert_or_note(signal)
        expected, tolerance = converted.value, converted.tolerance
        allowed = tolerance
        if np.isnan(tolerance):
            allowed = _INTERNAL_TOLERANCE * max(abs(expected), _LEAST_SIZE)
        # The tolerance of some files is as small as one rounding of the printed values, which is
        # allowed in addition.
        allowed = allowed + _ROUNDINGS * np.spacing(abs(expected))
        passed = abs(computed - expected) <= allowed and not note
        return varID, expected, computed, tolerance, bool(passed), note

    def _convert_or_note(self, signal: Signal) -> tuple[Signal, str]:
        """Return a signal in the unit of its variable, or unchanged with the reason."""
        try:
            return self.converted(signal), ""
        except UnitError as error:
            return signal, str(error)


def _input_key(shot: Shot) -> tuple[tuple[str, str], ...]:
    return tuple((signal.key, signal.units) for signal in shot.inputs)
