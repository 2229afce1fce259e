"""Parts of a DAVE-ML model that no product of tables gives, put onto tables within a bound."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import reduce

import numpy as np

from aerodb.exchange.daveml import export_checks as sample_states
from aerodb.exchange.daveml import piecewise_linear, polynomials
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.terms import Factors, unify_rules
from aerodb.exchange.daveml.vocabulary import REDUCED, file_unit_conversion
from aerodb.exchange.sampling import Function, SamplingError, largest_difference, tabulate_function
from flightmech.terms import MAX_AXES, evaluate_term, make_term

_FIRST = 5  # breakpoints of an axis whose table has its two ends only
_RATES = {rate for rate, _ in REDUCED.values()} - {
    "p",
    "q",
    "r",
}  # what the simulation knows as reduced rates only


class Sampler:
    """Tables in the place of functions of a model.

    Parameters
    ----------
    model : DaveModel
        The model.
    mine : mapping of str to str
        Quantity of each input, by varID.
    bound : float
        Largest difference of a table from its function, times the usual size of what multiplies it.
        [1]
    grid : mapping of str to sequence of float
        By quantity: two numbers, the range in which breakpoints are chosen; or more, the
        breakpoints themselves. [SI]

    Attributes
    ----------
    sums : dict of str to Sum
        Variables by varID as far as they are known; at first those that are exact.
    box : dict of str to (low, high)
        Range of every axis that was sampled. [SI]
    """

    def __init__(
        self,
        model: DaveModel,
        mine: Mapping[str, str],
        sums: Mapping[str, Sum],
        bound: float,
        grid: Mapping[str, Collection[float]],
    ):
        self.model, self.mine, self.sums, self.bound = model, mine, dict(sums), bound
        self.given = {
            name: np.unique(np.asarray(list(points), float)) for name, points in grid.items()
        }
        self.box: dict[str, tuple[float, float]] = {}

    def variable(self, varID: str, weight: float) -> Sum:
        """Return a variable of the model as a table over the quantities it rests on; `weight` is
        the size of what multiplies it.
        """
        return self._table(varID, (varID,), lambda values: values[varID], weight)

    def expression(self, expression: mathml.Expression, label: str, weight: float) -> Sum:
        """Return an expression as a table; `label` is the variable it belongs to."""
        names = tuple(mathml.expression_variables(expression))
        return self._table(
            f"part of {label}",
            names,
            lambda values: mathml.evaluate_mathml(expression, values),
            weight,
        )

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the range of every quantity as far as it is known: where it was sampled, given, or
        covered by tables. [SI]
        """
        found: dict[str, tuple[float, float]] = {}
        for name in self.mine.values():
            try:
                points = self._start(name, ())
            except Inexact:
                continue
            found[name] = float(points[0]), float(points[-1])
        return {**found, **self.box}

    def magnitude(self, one: Sum) -> float:
        """Return the size that a sum does not exceed: tables at their largest node, variables at
        the end of their range.
        """
        total = 0.0
        for (grids, powers), coefficient in one.products.items():
            largest = [float(np.abs(grid.values).max(initial=0.0)) for grid in grids]
            total += abs(coefficient) * float(
                np.prod(largest + [self._size(name) ** abs(power) for name, power in powers])
            )
        return total

    def _size(self, quantity: str) -> float:
        try:
            return float(np.abs(self._start(quantity, ())).max())
        except Inexact:  # what no table is over has a usual range
            return sample_states.typical_size(quantity)

    def joined(
        self, grids: list[MultilinearTable], powers: Mapping[str, int], factor: float
    ) -> Iterator[Factors]:
        """Yield a product, a number apart, with the factors that share variables on one table, then
        with all of them on one.

        Raises
        ------
        Inexact
            They depend on more variables than a table has axes.
        """
        counts = [name for grid in grids for name in grid.variables]
        clash = {name for name in counts if counts.count(name) > 1} | {
            name for name, power in powers.items() if power < 0
        }
        for chosen in ([clash] if clash else []) + [{*counts, *powers}]:
            mine = [grid for grid in grids if chosen & set(grid.variables)]
            own = {name: power for name, power in powers.items() if name in chosen}
            rest = {name: power for name, power in powers.items() if name not in chosen}
            others = [grid for grid in grids if grid not in mine]
            yield (
                [
                    *others,
                    self._product(
                        mine,
                        own,
                        self.magnitude(Sum({(tuple(others), tuple(rest.items())): factor})),
                    ),
                ],
                rest,
            )

    def _table(
        self,
        what: str,
        names: Iterable[str],
        of_values: Callable[[Mapping], np.ndarray],
        weight: float,
    ) -> Sum:
        model, needed = self.model, self.model.rests_on(names)
        inputs = {varID: name for varID, name in self.mine.items() if varID in needed}
        scales = {
            varID: file_unit_conversion(model.variables[varID], name)
            for varID, name in inputs.items()
        }
        unknown = [
            v
            for v in model.inputs
            if v in needed and v not in inputs and model.variables[v].initial is None
        ]
        if unknown or _RATES & set(inputs.values()):
            of = unknown or sorted(_RATES & set(inputs.values()))
            raise Inexact(
                f"{what} cannot be sampled: it depends on {', '.join(of)}, which can be no axis"
            )

        def function(at: Mapping[str, np.ndarray]) -> np.ndarray:
            given = {
                varID: factor * at[inputs[varID]] + offset
                for varID, (factor, offset) in scales.items()
            }
            return np.asarray(of_values(model.values(names, given)), float)

        starts = {name: self._start(name, needed) for name in sorted(set(inputs.values()))}
        return polynomials.make_table_sum(self._sampled(what, function, starts, weight))

    def _product(
        self, grids: list[MultilinearTable], powers: Mapping[str, int], weight: float
    ) -> MultilinearTable:
        leaves = []
        for grid in grids:
            outside, (table,) = unify_rules([grid])
            leaves.append(
                make_term(
                    table.values,
                    {axis.variable: axis.points for axis in table.axes},
                    outside=outside,
                )
            )
        own: dict[str, list[np.ndarray]] = {}
        for grid in grids:
            for axis in grid.axes:
                own.setdefault(axis.variable, []).append(axis.points)
        starts = {
            name: self._within(name, reduce(np.union1d, points)) for name, points in own.items()
        }
        starts |= {
            name: self._start(name, set(self.model.order)) for name in powers if name not in starts
        }

        def function(at: Mapping[str, np.ndarray]) -> np.ndarray:
            factors = [evaluate_term(leaf, at, "clamp") for leaf in leaves]
            return reduce(
                np.multiply,
                [*factors, *(at[name] ** float(power) for name, power in powers.items())],
            )

        words = [grid.label or "a table" for grid in grids] + [
            f"{name}^{power}" for name, power in powers.items()
        ]
        return self._sampled(" x ".join(words), function, dict(sorted(starts.items())), weight)

    def _sampled(
        self, what: str, function: Function, starts: Mapping[str, np.ndarray], weight: float
    ) -> MultilinearTable:
        if len(starts) > MAX_AXES:
            raise Inexact(
                f"{what} cannot be sampled: it depends on {', '.join(starts)}; a table has "
                f"at most {MAX_AXES} axes"
            )

        def finite(at: Mapping[str, np.ndarray]) -> np.ndarray:
            found = function(at)
            if not np.isfinite(found).all():
                raise Inexact(
                    f"{what} cannot be sampled: it is not finite everywhere; narrow the "
                    f"range with grid="
                )
            return found

        fixed = [name for name in starts if len(self.given.get(name, ())) > 2]
        try:
            table = tabulate_function(finite, starts, self.bound / max(weight, 1e-12), fixed)
        except SamplingError as error:
            raise Inexact(f"{what} cannot be sampled: {error}") from None
        for name, points in starts.items():
            low, high = self.box.get(name, (points[0], points[-1]))
            self.box[name] = float(max(low, points[0])), float(min(high, points[-1]))
        note = (
            f"{what} sampled on {' x '.join(map(str, table.shape))} nodes: largest difference "
            f"seen {largest_difference(finite, table):.2g}"
        )
        return MultilinearTable(
            tuple(GridAxis(str(name), table[name].values) for name in table.dims),
            table.values,
            None,
            what,
            note=note,
        )

    def _start(self, quantity: str, needed: Collection[str]) -> np.ndarray:
        """Return the breakpoints of the tables that a function rests on, with the ends of all
        tables over the quantity.
        """
        own, all_points = [], []
        for function in self.model.functions.values():
            for name, axis in zip(function.inputs, function.axes, strict=True):
                places = self._places(quantity, name, axis.points)
                all_points += places
                own += places if function.output in needed else []
        return self._within(
            quantity, np.unique([*own, *((min(all_points), max(all_points)) if all_points else ())])
        )

    def _places(self, quantity: str, name: str, points: np.ndarray) -> list[float]:
        """Return where an input of a function passes breakpoints, if it is a piecewise-linear
        function of the quantity.
        """
        try:
            variable, inner = polynomials.as_piecewise_linear(self.sums[name])
        except (KeyError, Inexact):
            return []
        return (
            piecewise_linear.find_preimages(points, inner)[0].tolist()
            if variable == quantity
            else []
        )

    def _within(self, quantity: str, points: np.ndarray) -> np.ndarray:
        """Return breakpoints as the caller gives them, or inside the range that he or the file
        gives.
        """
        given = self.given.get(quantity, np.zeros(0))
        if len(given) > 2:
            return given
        ends = given if len(given) == 2 else self._limits(quantity, points)
        if len(ends) < 2 or not ends[0] < ends[1]:
            raise Inexact(
                f"no table and no limit states how far {quantity} goes; give "
                f"grid={{{quantity!r}: (low, high)}}"
            )
        found = np.union1d(points[(points > ends[0]) & (points < ends[1])], ends)
        return found if len(found) > 2 else np.linspace(found[0], found[-1], _FIRST)

    def _limits(self, quantity: str, points: np.ndarray) -> np.ndarray:
        """Return the range of the tables, and inside the limits of the input; the limits themselves
        where there is no table.
        """
        varID = next((v for v, name in self.mine.items() if name == quantity), None)
        low, high = -np.inf, np.inf
        if varID is not None:
            variable, (factor, offset) = (
                self.model.variables[varID],
                file_unit_conversion(self.model.variables[varID], quantity),
            )
            low, high = sorted(
                ((variable.low - offset) / factor, (variable.high - offset) / factor)
            )
        ends = np.clip([points[0], points[-1]], low, high) if len(points) else np.array([low, high])
        return ends if np.isfinite(ends).all() else np.zeros(0)
