"""Terms of a database for an identified ground effect.

Records in flight end above the height of an aeroplane on its wheels: reconstructions lose the last
tenths of a second, and wheels touch before the legs are compressed.  Below the records each factor
grows as Prandtl's interference factor of the wing and its image.  This growth is theory, and is the
standard error of the term as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from aerodb.edit.ground_effect import in_ground_effect, with_height_table
from aerodb.edit.term_edits import delete_terms, replace_terms
from aerodb.store.identified_terms import stamp_identified
from aerodb.store.schema import terms
from aerodb.update.posterior import without_posterior
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
from flighttest.submodels.ground_effect.laws import (
    HEIGHT,
    POWER,
    PRANDTL_RANGE,
    interference_factor,
)
from flighttest.submodels.ground_effect.result import CoefficientOverGround, GroundEffect
from flighttest.submodels.ground_effect.structure import BANK

# Largest difference of a table from its law, as a share of the factor at its floor.
_TOLERANCE = 1e-3
# Nodes of a table below the records. The factor is within 1e-3 of its size between them.
_NODES_BELOW = 12
# Last node of a table, so that flight at height lies inside it. [m]
_FAR = 30_000.0
# Variables of the configuration or the condition. Only the other variables name a local term.
_CONFIGURATION = {
    "gear",
    "speedbrake",
    "delta_f",
    "delta_f_left",
    "delta_f_right",
    "i_h",
    "mach",
    "h",
    "alpha",
    "CT",
    "qbar",
    "x_cg",
}
# Variables that are estimated in one with another variable.
_TOGETHER = {"alphadothat": "qhat"}


def replace_ground_effect(
    database: xr.DataTree, found: GroundEffect, tables: bool = False
) -> xr.DataTree:
    """Return a database with the identified ground effect in place of its terms over height.

    Parameters
    ----------
    database : DataTree
        Database with the terms in free air. It is not changed.
    found : GroundEffect
        Result. Coefficients whose form is ``database`` keep their terms. With the form ``none``
        terms are deleted that the flights refuse; they stay where the flights do not
        contradict them.
    tables : bool
        Whether factors K(h) replace the closed form k h^s, for exports without formulas.

    Returns
    -------
    DataTree

    Raises
    ------
    SchemaError
        A factor to which no term of the database belongs, or a term without room for a factor.
    """
    new: dict[str, xr.Dataset] = {}
    old: list[str] = []
    for name, result in found.coefficients.items():
        if result.form == "database" or (result.form == "none" and not result.refuses_database):
            continue
        old += [term for term, leaf in _terms_of(database, name) if _is_over_height(leaf)]
        for contribution, leaf in ground_terms_of(result, database, tables).items():
            new[f"{name}/{contribution}"] = leaf
    note = "ground effect identified from flight"
    obsolete = [term for term in old if term not in new]
    remainder = delete_terms(database, obsolete, note) if obsolete else database
    new = {name: stamp_identified(leaf) for name, leaf in new.items()}
    return replace_terms(remainder, new, note) if new else remainder


def ground_terms_of(
    one: CoefficientOverGround, database: xr.DataTree, tables: bool = False
) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient over the ground by contribution, in its best form.

    Parameters
    ----------
    one : CoefficientOverGround
        Result of the coefficient.
    database : DataTree
        Database with the terms in free air.
    tables : bool
        Whether K(h) replaces k h^s.

    Returns
    -------
    dict of str to Dataset
        ``ground_<term in free air>``, of a part of it ``ground_<term>_alpha``; ``ground`` for the
        rolling moment of bank.
    """
    wheels = _Continuation(one.heights[0], float(database.attrs["b"]))
    name = one.model.coefficient
    free: dict[str, xr.Dataset] = {}
    for term, leaf in _terms_of(database, name):
        if not _is_over_height(leaf):
            # A multiple of a table was not estimated together with the table.
            free[term.partition("/")[2]] = without_posterior(leaf)
    ground = one.ground
    if one.table is not None:
        ground = one.table.terms
    leaves: dict[str, xr.Dataset] = {}
    for term in ground:
        if term == BANK:
            parts = {"ground": _terms.make_term(1.0, regressors=("CL", "phi"))}
        else:
            parts = dict(_free_air_parts(term, free))
        if not parts:
            raise SchemaError(
                "ground effect",
                [
                    f"{name}: no term of the database in free air belongs to {term}; it has "
                    f"{' '.join(free)}"
                ],
            )
        for label, leaf in parts.items():
            leaves[label] = _over_ground(leaf, one, term=term, wheels=wheels, tables=tables)
    return leaves


def _terms_of(database: xr.DataTree, coefficient: str) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield the terms of a coefficient by name."""
    for term, leaf in terms(database).items():
        if term.startswith(f"{coefficient}/"):
            yield term, leaf


def _is_over_height(leaf: xr.Dataset) -> bool:
    """Return whether a term depends on the height over the ground."""
    return HEIGHT in _terms.list_model_variables(leaf)


def _free_air_parts(term: str, free: dict[str, xr.Dataset]) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield the terms in free air, or parts of them, that a term of the local model represents."""
    for name, leaf in free.items():
        variables = _terms.list_model_variables(leaf)
        movers = sorted({_TOGETHER.get(v, v) for v in variables - _CONFIGURATION})
        if movers:
            if "*".join(movers) == term:
                yield f"ground_{name}", leaf
            continue
        # A static term: its value at zero angle of attack is the local constant, the remainder
        # belongs to the local slope.
        has_slope = "alpha" in _terms.list_regressors(leaf)
        if term == "1" and not has_slope:
            yield f"ground_{name}", _at_zero_alpha(leaf)
        if term == "alpha" and has_slope:
            yield f"ground_{name}_alpha", leaf
        elif term == "alpha" and "alpha" in variables:
            yield f"ground_{name}_alpha", _less_zero_alpha(leaf)


def _at_zero_alpha(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term at zero angle of attack, or at the end of its table next to zero."""
    if "alpha" not in leaf["value"].dims:
        return leaf
    alpha = float(np.clip(0.0, leaf["alpha"].values[0], leaf["alpha"].values[-1]))
    numbers = leaf.drop_vars("source", errors="ignore")
    value = numbers.interp(alpha=alpha).drop_vars("alpha")
    return value.assign({name: value[name].astype(float) for name in value.data_vars})


def _less_zero_alpha(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term less its value at zero angle of attack."""
    if "alpha" not in leaf["value"].dims:
        raise SchemaError(
            "ground effect",
            ["alpha is an axis of a factor K1 or K2; multiply it into the table first"],
        )
    difference = leaf.drop_vars("source", errors="ignore").copy()
    value = leaf["value"] - _at_zero_alpha(leaf)["value"]
    difference["value"] = value.transpose(*leaf["value"].dims)
    return difference


class _Continuation:
    """Continuation of factors from the lowest height of the records down to the wheels.

    Parameters
    ----------
    floor : float
        Lowest height of the records. [m]
    span : float
        Span. [m]
    """

    def __init__(self, floor: float, span: float):
        self.floor, self.span = floor, span
        low, high = PRANDTL_RANGE
        self.lowest = min(low * span, floor)
        if floor > high * span:
            # Theory has no factor for these records.
            self.lowest = floor

    def growth(self, height: float) -> float:
        """Return the ratio of a factor at a height to that at the floor."""
        if height >= self.floor or self.lowest == self.floor:
            return 1.0
        return interference_factor(height / self.span) / interference_factor(self.floor / self.span)

    def power_floor(self, exponent: float) -> float:
        """Return the height at which a power of the height ends.

        The power is continued as far as it grows no more than theory has it.
        """
        ratio = self.growth(self.lowest)
        return max(self.floor * ratio ** (1.0 / exponent), self.lowest)

    def continued(self, heights: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a table of a factor with nodes below the floor."""
        below = np.linspace(self.lowest, self.floor, _NODES_BELOW + 1)[:-1]
        below = below[below < self.floor]
        grown = [self.growth(height) * K[0] for height in below]
        return np.concatenate([below, heights]), np.concatenate([grown, K])


def _over_ground(
    leaf: xr.Dataset, one: CoefficientOverGround, term: str, wheels: _Continuation, tables: bool
) -> xr.Dataset:
    """Return a term in free air times its factor over the ground.

    The factor is a power of the height or a table over it.
    """
    floor, top = one.heights
    growth = wheels.growth(wheels.lowest)
    if one.table is not None:
        heights, K, stderr = one.tabled(term)
        leaf = _with_factor(leaf, *wheels.continued(heights, K))
        share = _relative_error(K, stderr)
    else:
        row = one.row(term, one.form)
        at_floor = one.factor(term, [floor], one.form)
        share = _relative_error(at_floor["K"].values, at_floor["stderr"].values)
        if row.law == POWER.name:
            end = wheels.power_floor(row.s)
            growth = (end / floor) ** row.s
            leaf = in_ground_effect(leaf, row.k, row.s, end)
            if tables:
                leaf = with_height_table(leaf, top)
        else:
            # The kernel has no other law in closed form.
            leaf = _with_factor(leaf, *wheels.continued(*_tabulate_law(one, term)))
            leaf["K1" if HEIGHT in leaf["K1"].dims else "K2"].attrs["formula"] = row.law
    dims, shape = leaf["value"].dims, leaf["value"].shape
    # The errors of term, factor and growth are independent.
    share = float(np.hypot(share, 1.0 - 1.0 / growth))
    free_stderr = leaf["stderr"].values if "stderr" in leaf else 0.0
    largest = 1.0
    if "K1" in leaf and HEIGHT in leaf["K1"].dims:
        largest = float(np.abs(leaf["K1"].values).max())
    size = leaf["value"].values * largest
    leaf = leaf.assign(stderr=(dims, np.hypot(free_stderr, share * np.abs(size))))
    source = np.full(shape, _terms.SOURCES.index("judgement"), np.uint8)
    source[_flown_nodes(leaf, one.flown)] = _terms.SOURCES.index("flight")
    leaf = leaf.assign(source=(dims, source))
    leaf["source"].attrs = dict(_terms.SOURCE_ATTRS)
    return leaf.assign_attrs(
        references="[LR743] eq. (14)" if term == BANK else "[LR743] eq. (13)",
        comment=_comment(one, term, growth),
    )


def _flown_nodes(leaf: xr.Dataset, flown: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Return the nodes that the samples over the ground reach with half a cell.

    At all others the factor is taken over from those: no landing showed it there.
    """
    dims, is_flown = leaf["value"].dims, np.ones(leaf["value"].shape, bool)
    for k, axis in enumerate(map(str, dims)):
        points = leaf[axis].values.astype(float)
        if axis not in flown or len(points) == 1:
            continue
        low, high = flown[axis]
        middle = 0.5 * (points[1:] + points[:-1])
        # the outer cells have no end: beyond the table its end is used
        starts, ends = np.append(-np.inf, middle), np.append(middle, np.inf)
        is_reached = (ends >= low) & (starts <= high)
        is_flown &= is_reached.reshape([-1 if j == k else 1 for j in range(len(dims))])
    return is_flown


def _tabulate_law(one: CoefficientOverGround, term: str) -> tuple[np.ndarray, np.ndarray]:
    """Return heights and K(h) of a closed form, linear between them within the tolerance."""
    floor, top = one.heights
    count = 2
    while True:
        points = np.geomspace(floor, top, count)
        # The ends are exact, without the rounding of the logarithm.
        points[[0, -1]] = floor, top
        middle = 0.5 * (points[1:] + points[:-1])
        K = one.factor(term, points, one.form)["K"].values
        chord = 0.5 * (K[1:] + K[:-1])
        error = np.abs(chord - one.factor(term, middle, one.form)["K"].values).max()
        if error <= _TOLERANCE * abs(K[0]):
            return points, K
        count *= 2


def _relative_error(K: np.ndarray, stderr: np.ndarray) -> float:
    """Return the relative standard error of a factor where the factor is largest."""
    k = int(np.argmax(np.abs(K)))
    return float(stderr[k] / abs(K[k])) if K[k] else 0.0


def _with_factor(leaf: xr.Dataset, heights: np.ndarray, K: np.ndarray) -> xr.Dataset:
    """Return a term times a table over the height.

    Above the records the factor falls to zero within their highest height, and stays zero: flight
    far above the ground does not leave the table.
    """
    beyond = [2.0 * heights[-1], _FAR] if K[-1] else [_FAR]
    heights, K = np.append(heights, beyond), np.append(K, np.zeros(len(beyond)))
    name = next((key for key in ("K1", "K2") if key not in leaf), None)
    if name is None:
        raise SchemaError(
            "ground effect", ["a term with two factors has no room for one over the height"]
        )
    coordinate = HEIGHT, heights, quantity_attributes(HEIGHT)
    return leaf.assign({name: xr.DataArray(K, {HEIGHT: coordinate}, HEIGHT)})


def _comment(one: CoefficientOverGround, term: str, growth: float) -> str:
    """Return the comment of a term: heights, form and numbers."""
    note = f"identified from {one.heights[0]:.3g} m up, form: {one.form}"
    if growth > 1.0:
        note += (
            f"; below, theory (Prandtl's interference factor): {growth:.3g} times as large at the "
            f"wheels, and this growth as a standard error"
        )
    if one.table is not None:
        return f"{note}; zero from {one.table.end(term):.3g} m on"
    row = one.row(term, one.form)
    shape = "s" if row.law == POWER.name else "h0"
    return (
        f"{note}; k {row.k:.4g} ({row.k_stderr:.2g}), {shape} {row.s:.4g} ({row.s_stderr:.2g}), "
        f"correlation {row.correlation:.2f}, h in metres"
    )
