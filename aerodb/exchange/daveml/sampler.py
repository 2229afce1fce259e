"""Sampling of the inexact parts of a DAVE-ML model on tables, within an error bound."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import reduce
from typing import Any

import numpy as np

from aerodb.exchange.daveml import export_checks as sample_states
from aerodb.exchange.daveml import piecewise_linear, polynomials
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.terms import Factors, unify_rules
from aerodb.exchange.daveml.vocabulary import file_unit_conversion
from aerodb.exchange.sampling import Function, SamplingError, largest_difference, tabulate_function
from aerodb.exchange.spelling import spell
from flightmech.names import REDUCED_RATES
from flightmech.terms import MAX_AXES, evaluate_term, make_term

_FIRST = 5  # initial breakpoints of an axis whose tables state its two ends only
_LEAST_WEIGHT = 1e-12  # avoids a division by zero if the other factors vanish
# Rates that the simulation has as reduced rates only. A table cannot have them as an axis.
_RATES = {rate for rate, _ in REDUCED_RATES.values()} - {"p", "q", "r"}


class Sampler:
    """Tables that replace functions of a model.

    Parameters
    ----------
    model : DaveModel
        The model.
    quantities : mapping of str to str
        Quantity of each input, by varID.
    sums : mapping of str to Sum
        Variables with an exact sum, by varID.
    bound : float
        Largest difference of a table from its function, times the usual size of the factors that
        multiply it.  [1]
    grid : mapping of str to sequence of float
        By quantity: two numbers, the range in which breakpoints are chosen; or more, the
        breakpoints themselves. [SI]

    Attributes
    ----------
    sums : dict of str to Sum
        Sums of the variables by varID: the exact sums, and the approximations made so far.
    box : dict of str to (low, high)
        Range of every axis that was sampled. [SI]
    """

    def __init__(
        self,
        model: DaveModel,
        quantities: Mapping[str, str],
        sums: Mapping[str, Sum],
        bound: float,
        grid: Mapping[str, Collection[float]],
    ):
        self.model, self.quantities, self.bound = model, quantities, bound
        self.sums = dict(sums)
        self.grid = {
            name: np.unique(np.asarray(list(points), float)) for name, points in grid.items()
        }
        self.box: dict[str, tuple[float, float]] = {}

    def variable(self, varID: str, weight: float) -> Sum:
        """Return a variable as a table over its quantities; `weight` is the size of its factors."""
        return self._sample_values(varID, (varID,), lambda values: values[varID], weight=weight)

    def expression(self, expression: mathml.Expression, label: str, weight: float) -> Sum:
        """Return an expression as a table; `label` is the variable that contains it."""
        names = tuple(mathml.expression_variables(expression))

        def evaluate(values: Mapping[str, Any]) -> np.ndarray:
            return mathml.evaluate_mathml(expression, values)

        return self._sample_values(f"part of {label}", names, evaluate, weight=weight)

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the range (low, high) of each quantity with samples or tables. [SI]"""
        ranges: dict[str, tuple[float, float]] = {}
        for name in self.quantities.values():
            try:
                points = self._initial_points(name, ())
            except Inexact:
                continue
            ranges[name] = float(points[0]), float(points[-1])
        return {**ranges, **self.box}

    def magnitude(self, expression: Sum) -> float:
        """Return an upper bound of a sum: largest nodes of tables, largest values of variables."""
        total = 0.0
        for (grids, powers), coefficient in expression.products.items():
            sizes = [float(np.abs(grid.values).max(initial=0.0)) for grid in grids]
            for name, power in powers:
                sizes.append(self._quantity_size(name) ** abs(power))
            total += abs(coefficient) * float(np.prod(sizes))
        return total

    def _quantity_size(self, quantity: str) -> float:
        try:
            return float(np.abs(self._initial_points(quantity, ())).max())
        except Inexact:
            # No table has the quantity as an axis, so its usual size applies.
            return sample_states.typical_size(quantity)

    def joined(
        self, grids: list[MultilinearTable], powers: Mapping[str, int], factor: float
    ) -> Iterator[Factors]:
        """Yield a product with joined factors: those that share variables, then all of them.

        Parameters
        ----------
        grids : list of MultilinearTable
            Tables of the product.
        powers : mapping of str to int
            Powers of the variables of the product.
        factor : float
            Number that multiplies the product.

        Raises
        ------
        Inexact
            The factors depend on more variables than a table has axes.
        """
        axis_names: list[str] = []
        for grid in grids:
            axis_names += grid.variables
        # Two tables of one variable, or a negative power, cannot be factors of a term.
        conflicts = {name for name in axis_names if axis_names.count(name) > 1}
        conflicts |= {name for name, power in powers.items() if power < 0}
        choices = [{*axis_names, *powers}]
        if conflicts:
            choices.insert(0, conflicts)
        for names in choices:
            selected = [grid for grid in grids if names & set(grid.variables)]
            remaining = [grid for grid in grids if grid not in selected]
            selected_powers: dict[str, int] = {}
            remaining_powers: dict[str, int] = {}
            for name, power in powers.items():
                target = selected_powers if name in names else remaining_powers
                target[name] = power
            # The error of the new table is multiplied by the remaining factors.
            others = Sum({(tuple(remaining), tuple(remaining_powers.items())): factor})
            table = self._sample_product(selected, selected_powers, self.magnitude(others))
            yield [*remaining, table], remaining_powers

    def _sample_values(
        self,
        label: str,
        names: Iterable[str],
        evaluate: Callable[[Mapping[str, Any]], np.ndarray],
        weight: float,
    ) -> Sum:
        """Return a function of variables of the model, sampled over its quantities."""
        model, needed = self.model, self.model.rests_on(names)
        inputs = {varID: name for varID, name in self.quantities.items() if varID in needed}
        scales = {
            varID: file_unit_conversion(model.variables[varID], name)
            for varID, name in inputs.items()
        }
        self._demand_axes(label, needed, inputs)

        def function(states: Mapping[str, np.ndarray]) -> np.ndarray:
            file_inputs = {}
            for varID, (factor, offset) in scales.items():
                file_inputs[varID] = factor * states[inputs[varID]] + offset
            return np.asarray(evaluate(model.values(names, file_inputs)), float)

        starts = {name: self._initial_points(name, needed) for name in sorted(set(inputs.values()))}
        return polynomials.make_table_sum(
            self._sample_function(label, function, starts, weight=weight)
        )

    def _demand_axes(self, label: str, needed: set[str], inputs: Mapping[str, str]) -> None:
        """Raise if a function depends on an input that cannot be an axis of a table."""
        invalid = []
        for varID in self.model.inputs:
            has_value = varID in inputs or self.model.variables[varID].initial is not None
            if varID in needed and not has_value:
                invalid.append(varID)
        invalid = invalid or sorted(_RATES & set(inputs.values()))
        if invalid:
            raise Inexact(
                f"{label} cannot be sampled: it depends on {', '.join(invalid)}, which can be no "
                f"axis"
            )

    def _sample_product(
        self, grids: list[MultilinearTable], powers: Mapping[str, int], weight: float
    ) -> MultilinearTable:
        """Return a product of tables and powers as one table."""
        leaves = []
        axis_points: dict[str, list[np.ndarray]] = {}
        for grid in grids:
            outside, (table,) = unify_rules([grid])
            axes = {axis.variable: axis.points for axis in table.axes}
            leaves.append(make_term(table.values, axes, outside=outside))
            for axis in grid.axes:
                axis_points.setdefault(axis.variable, []).append(axis.points)
        # The first breakpoints are those of all tables, so that the product is exact on them.
        starts = {}
        for name, points in axis_points.items():
            starts[name] = self._limit_points(name, reduce(np.union1d, points))
        for name in powers:
            if name not in starts:
                starts[name] = self._initial_points(name, set(self.model.order))

        def function(states: Mapping[str, np.ndarray]) -> np.ndarray:
            factors = [evaluate_term(leaf, states, "clamp") for leaf in leaves]
            for name, power in powers.items():
                factors.append(states[name] ** float(power))
            return reduce(np.multiply, factors)

        labels = [grid.label or "a table" for grid in grids]
        labels += [f"{name}^{power}" for name, power in powers.items()]
        ordered_starts = dict(sorted(starts.items()))
        return self._sample_function(" x ".join(labels), function, ordered_starts, weight=weight)

    def _sample_function(
        self, label: str, function: Function, starts: Mapping[str, np.ndarray], weight: float
    ) -> MultilinearTable:
        """Return a function of quantities as a table; `starts` are its first breakpoints."""
        if len(starts) > MAX_AXES:
            raise Inexact(
                f"{label} cannot be sampled: it depends on {', '.join(starts)}; a table has "
                f"at most {MAX_AXES} axes"
            )

        def finite_function(states: Mapping[str, np.ndarray]) -> np.ndarray:
            values = function(states)
            if not np.isfinite(values).all():
                raise Inexact(
                    f"{label} cannot be sampled: it is not finite everywhere; narrow the "
                    f"range with {spell('grid=', '--grid')}"
                )
            return values

        # Breakpoints of the caller are not refined. The weight converts the bound of a coefficient
        # to a bound of the function.
        fixed = [name for name in starts if len(self.grid.get(name, ())) > 2]
        bound = self.bound / max(weight, _LEAST_WEIGHT)
        try:
            table = tabulate_function(finite_function, starts, bound, fixed=fixed)
        except SamplingError as error:
            raise Inexact(f"{label} cannot be sampled: {error}") from None
        for name, points in starts.items():
            # Several tables may have the same axis. The result is valid where all of them are.
            low, high = self.box.get(name, (points[0], points[-1]))
            self.box[name] = float(max(low, points[0])), float(min(high, points[-1]))
        note = (
            f"{label} sampled on {' x '.join(map(str, table.shape))} nodes: largest difference "
            f"seen {largest_difference(finite_function, table):.2g}"
        )
        axes = tuple(GridAxis(str(name), table[name].values) for name in table.dims)
        return MultilinearTable(axes, table.values, label=label, note=note)

    def _initial_points(self, quantity: str, needed: Collection[str]) -> np.ndarray:
        """Return the first breakpoints along a quantity, from the tables of the `needed` variables.

        The ends of all other tables over the quantity are added.
        """
        needed_points: list[float] = []
        all_points: list[float] = []
        for function in self.model.functions.values():
            for name, axis in zip(function.inputs, function.axes, strict=True):
                points = self._points_over_quantity(quantity, name, axis.points)
                all_points += points
                if function.output in needed:
                    needed_points += points
        # The range of the quantity is that of all tables.
        if all_points:
            needed_points += [min(all_points), max(all_points)]
        return self._limit_points(quantity, np.unique(needed_points))

    def _points_over_quantity(self, quantity: str, name: str, points: np.ndarray) -> list[float]:
        """Return the values of the quantity at which an input of a function is at a breakpoint."""
        try:
            variable, inner = polynomials.as_piecewise_linear(self.sums[name])
        except (KeyError, Inexact):
            return []
        if variable != quantity:
            return []
        return piecewise_linear.find_preimages(points, inner)[0].tolist()

    def _limit_points(self, quantity: str, points: np.ndarray) -> np.ndarray:
        """Return the breakpoints of `grid`, or the breakpoints inside the range of the quantity."""
        requested = self.grid.get(quantity, np.zeros(0))
        if len(requested) > 2:
            return requested
        ends = requested if len(requested) == 2 else self._range_of_tables(quantity, points)
        if len(ends) < 2 or not ends[0] < ends[1]:
            raise Inexact(
                f"no table and no limit states how far {quantity} goes; give "
                + spell(f"grid={{{quantity!r}: (low, high)}}", f"--grid {quantity}='LOW HIGH UNIT'")
            )
        # The ends of the range are always breakpoints.
        inside = points[(points > ends[0]) & (points < ends[1])]
        limited = np.union1d(inside, ends)
        if len(limited) > 2:
            return limited
        return np.linspace(limited[0], limited[-1], _FIRST)

    def _range_of_tables(self, quantity: str, points: np.ndarray) -> np.ndarray:
        """Return the range of the tables inside the limits of the input; empty if it is unknown."""
        low, high = -np.inf, np.inf
        for varID, name in self.quantities.items():
            if name == quantity:
                variable = self.model.variables[varID]
                factor, offset = file_unit_conversion(variable, quantity)
                # A negative factor exchanges the limits.
                limits = (variable.low - offset) / factor, (variable.high - offset) / factor
                low, high = sorted(limits)
                break
        # Without any table the limits of the input are the range.
        ends = np.array([low, high])
        if len(points):
            ends = np.clip([points[0], points[-1]], low, high)
        if not np.isfinite(ends).all():
            return np.zeros(0)
        return ends
