"""What was found of the ground effect: table 2 of [LR743], the factor K(h), the forms compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.edit.ground_effect import in_ground_effect, with_height_table
from aerodb.edit.table_edits import delete_terms, replace_terms
from aerodb.store.schema import terms
from aerodb.update.posterior import without_posterior
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.separable.fit import SeparableFit
from flighttest.submodels.ground_effect.structure import (
    BANK,
    HEIGHT,
    HeightTable,
    exponent_name,
    select_form,
    separable_spelling,
    times_height_power,
)

ORDER = ("none", "database", "k h^s, one s", "k h^s", "table")


class GroundTerm(NamedTuple):
    """One row of table 2: y = k y_inf h^s, or y = k h^s for the rolling moment (y_inf NaN); h in
    metres.
    """

    term: str
    y_inf: float
    k: float
    k_stderr: float
    s: float
    s_stderr: float
    correlation: float


@dataclass(frozen=True)
class CoefficientOverGround:
    """One coefficient over the ground.

    Attributes
    ----------
    model : Model
        Free air.
    ground : tuple of str
        Terms whose ground effect is identified.
    not_identified : dict of str to str
        The others, and why.
    fit : SeparableFit or None
        k h^s with an exponent for each term; None where no term is identified.
    common : SeparableFit or None
        k h^s with one exponent for all, [LR743] eq. (11).
    references : dict of str to float
        Free-air coefficients where these were held; empty where the fit has them.
    table : HeightTable or None
        Terms free over the height: those identified, and others that lower the criterion.
    form : str
        The form that the evidence chooses: one of ``none``, ``database``, ``k h^s, one s``, ``k
        h^s``, ``table``.
    heights : (float, float)
        Lowest height flown, and the one up to which the ground was searched. [m]
    evidence : DataFrame
        Index form; ``parameters``, ``rms``, ``BIC``.
    """

    model: RegressionModel
    ground: tuple[str, ...]
    not_identified: Mapping[str, str]
    fit: SeparableFit | None
    common: SeparableFit | None
    references: Mapping[str, float]
    table: HeightTable | None
    form: str
    heights: tuple[float, float]
    evidence: pd.DataFrame

    def rows(self, common: bool = False) -> list[GroundTerm]:
        """Return table 2: one row per identified term."""
        return [self.row(term, common) for term in self.ground]

    def row(self, term: str, common: bool = False) -> GroundTerm:
        """Return k and s of a term.

        Raises
        ------
        UnknownName
            A term that is not identified.
        """
        fit, name = self._fit(term, common)
        ratio, y_inf = self._factor(fit, term, common)
        values, C = fit.derived(ratio, name)
        k, s = map(float, np.sqrt(np.diag(C)))
        return GroundTerm(
            term, y_inf, float(values[0]), k, float(values[1]), s, float(C[0, 1] / (k * s))
        )

    def factor(self, term: str, h, common: bool = False) -> xr.Dataset:
        """Return K(h) = k h^s of a term with its standard error.

        Parameters
        ----------
        term : str
        h : array (h_agl,)
            Heights; below the lowest that was flown the factor stays. [m]
        common : bool
            With one exponent for all terms.

        Returns
        -------
        Dataset (h_agl,)
            ``K``, ``stderr``.
        """
        fit, name = self._fit(term, common)
        ratio, _ = self._factor(fit, term, common)
        h = np.asarray(h, float)
        values, C = fit.derived(
            *(f"({ratio})*{max(one, self.heights[0])!r}^{name}" for one in h.tolist())
        )
        found = xr.Dataset(
            {"K": (HEIGHT, values), "stderr": (HEIGHT, np.sqrt(np.diag(C)))}, {HEIGHT: h}
        )
        found[HEIGHT].attrs = {"units": "m"}
        return found

    def tabled(self, term: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return heights [m], K and its standard error of a term as the table over the height has
        it.

        Raises
        ------
        UnknownName
            A term that is not identified, or no table that the heights flown determine.
        """
        known = self.table.terms if self.table else ()
        if self.table is None or term not in known:
            raise UnknownName(
                term,
                known,
                "ground term",
                f"{self.model.coefficient}: it has no table over the height",
            )
        row = known.index(term)
        free = self.references or dict(zip(self.model.terms, self.table.free.tolist()))
        scale = free.get(term, 1.0)
        return (
            self.table.heights,
            self.table.value[row] / scale,
            self.table.stderr[row] / abs(scale),
        )

    def _fit(self, term: str, common: bool) -> tuple[SeparableFit, str]:
        if term not in self.ground or (common and self.common is None):
            raise UnknownName(
                term, self.ground, "ground term", f"{self.model.coefficient}: it is not identified"
            )
        return (self.common, "s") if common else (self.fit, exponent_name(term))  # type: ignore[return-value]

    def _factor(self, fit: SeparableFit, term: str, common: bool) -> tuple[str, float]:
        """k as an expression of the estimates, and the free-air coefficient."""
        own = f"[{times_height_power(term, 's' if common else None)}]"
        if term in self.references:
            return f"{own}/({self.references[term]!r})", self.references[term]
        if term in self.model.terms:
            return f"{own}/[{separable_spelling(term)}]", fit.value(separable_spelling(term))[0]
        return own, float("nan")


@dataclass(frozen=True)
class GroundEffect:
    """Ground effect of several coefficients.

    Attributes
    ----------
    coefficients : dict of str to CoefficientOverGround
    held : bool
        Whether the free-air terms were held at the database.
    """

    coefficients: Mapping[str, CoefficientOverGround]
    held: bool

    def __getitem__(self, coefficient: str) -> CoefficientOverGround:
        if coefficient not in self.coefficients:
            raise UnknownName(coefficient, self.coefficients, "coefficient")
        return self.coefficients[coefficient]

    @property
    def not_identified(self) -> dict[str, str]:
        """Ground terms that the data cannot see, as ``CL:qhat``, and why."""
        return {
            f"{name}:{term}": why
            for name, one in self.coefficients.items()
            for term, why in one.not_identified.items()
        }

    def report(self, heights: Sequence[float] = ()) -> str:
        """Return table 2 of [LR743], K(h), what is not identified, and the forms compared, as text.

        Parameters
        ----------
        heights : sequence of float, optional
            Heights at which K(h) is printed; without them the lowest flown, and twice and five
            times that. [m]
        """
        lines = ["Ground effect, y = k y_inf h^s; y = k h^s where there is no y_inf; h in metres"]
        lines.append(
            "free-air terms held at the database" if self.held else "free-air terms estimated along"
        )
        lines.append(
            f"{'':<14}{'y_inf':>10}{'k':>10}{'stderr':>9}{'s':>9}{'stderr':>9}{'corr.':>8}   K(h)"
        )
        for name, one in self.coefficients.items():
            lines += _printed(name, one, heights)
        for name, one in self.coefficients.items():
            lines += ["", *_evidence(name, one)]
        return "\n".join(lines)


def form_by_evidence(evidence: pd.DataFrame) -> str:
    """Return the form that the evidence chooses; of near equals the simplest, and the closed form
    before the table.
    """
    return select_form(evidence, ORDER)


def _printed(name: str, one: CoefficientOverGround, heights: Sequence[float]) -> list[str]:
    lines = []
    at = list(heights) or [one.heights[0] * m for m in (1.0, 2.0, 5.0)]
    for row in one.rows():
        K = one.factor(row.term, at)
        cells = "  ".join(
            f"{h:.3g} m {k:.3f} ({s:.2g})" for h, k, s in zip(at, K["K"].values, K["stderr"].values)
        )
        y_inf = "-" if np.isnan(row.y_inf) else f"{row.y_inf:.4g}"
        numbers = f"{row.k:>10.4g}{row.k_stderr:>9.2g}{row.s:>9.3f}{row.s_stderr:>9.2g}{row.correlation:>8.2f}"
        lines.append(f"{name + ':' + row.term:<14}{y_inf:>10}{numbers}   {cells}")
    lines += [
        f"{name + ':' + term:<14}k and s not identified: {why}"
        for term, why in one.not_identified.items()
    ]
    return lines


def _evidence(name: str, one: CoefficientOverGround) -> list[str]:
    lines = [f"{name}: {'form':<16}{'parameters':>12}{'rms':>11}{'BIC':>10}"]
    for form, row in one.evidence.iterrows():
        lines.append(
            f"{'':<{len(name) + 2}}{form!s:<16}{int(row['parameters']):>12}{row['rms']:>11.4g}{row['BIC']:>10.1f}"
        )
    of = (
        f" of {', '.join(one.table.terms)}" if one.table is not None and one.form == "table" else ""
    )
    return [
        *lines,
        f"{'':<{len(name) + 2}}taken: {one.form}{of}, the simplest within 2 of the least criterion",
    ]


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
_TOGETHER = {"alphadothat": "qhat"}  # estimated in one


def replace_ground_effect(
    database: xr.DataTree, found: GroundEffect, tables: bool = False
) -> xr.DataTree:
    """Return a database with the identified ground effect in the place of the terms over height
    that it had.

    Parameters
    ----------
    database : DataTree
        With the terms in free air; it is left as it is.
    found : GroundEffect
        Coefficients whose evidence chose ``database`` or ``none`` keep what they have.
    tables : bool
        Write factors K(h) in place of the closed form k h^s, for exports that take no formula.

    Returns
    -------
    DataTree

    Raises
    ------
    SchemaError
        A factor to which no term of the database belongs, or a term without room for it.
    """

    new: dict[str, xr.Dataset] = {}
    old: list[str] = []
    for name, one in found.coefficients.items():
        if one.form in ("none", "database"):
            continue
        old += [
            term
            for term, leaf in terms(database).items()
            if term.startswith(f"{name}/") and HEIGHT in _terms.list_model_variables(leaf)
        ]
        new |= {
            f"{name}/{contribution}": leaf
            for contribution, leaf in ground_terms_of(one, database, tables).items()
        }
    note = "ground effect identified from flight"
    gone = [term for term in old if term not in new]
    left = delete_terms(database, gone, note) if gone else database
    return replace_terms(left, new, note) if new else left


def ground_terms_of(
    one: CoefficientOverGround, database: xr.DataTree, tables: bool = False
) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient over the ground by contribution, in the form that the
    evidence chose.

    Parameters
    ----------
    one : CoefficientOverGround
    database : DataTree
        With the terms in free air.
    tables : bool
        K(h) in place of k h^s.

    Returns
    -------
    dict of str to Dataset
        ``ground_<term in free air>``, of a part of it ``ground_<term>_alpha``; ``ground`` for the
        rolling moment of bank.
    """

    name = one.model.coefficient
    free = {  # a multiple of a table is not one more table that was estimated with it
        term.partition("/")[2]: without_posterior(leaf)
        for term, leaf in terms(database).items()
        if term.startswith(f"{name}/") and HEIGHT not in _terms.list_model_variables(leaf)
    }
    found: dict[str, xr.Dataset] = {}
    for term in one.table.terms if one.form == "table" and one.table is not None else one.ground:
        parts = (
            {"ground": _terms.make_term(1.0, regressors=("CL", "phi"))}
            if term == BANK
            else dict(_parts(term, free))
        )
        if not parts:
            raise SchemaError(
                "ground effect",
                [
                    f"{name}: no term of the database in free air belongs to {term}; it has "
                    f"{' '.join(free)}"
                ],
            )
        found |= {label: _over_ground(leaf, one, term, tables) for label, leaf in parts.items()}
    return found


def _parts(term: str, free: dict[str, xr.Dataset]) -> Iterator[tuple[str, xr.Dataset]]:
    """Terms in free air, or parts of them, that a term of the local model stands for."""
    for name, leaf in free.items():
        variables = _terms.list_model_variables(leaf)
        movers = sorted({_TOGETHER.get(v, v) for v in variables - _CONFIGURATION})
        if movers:
            if "*".join(movers) == term:
                yield f"ground_{name}", leaf
            continue
        sloped = "alpha" in _terms.list_regressors(leaf)
        if term == "1" and not sloped:
            yield f"ground_{name}", _at_zero(leaf)
        if term == "alpha" and (sloped or "alpha" in variables):
            yield f"ground_{name}_alpha", leaf if sloped else _beyond_zero(leaf)


def _at_zero(leaf: xr.Dataset) -> xr.Dataset:
    """A term at zero angle of attack."""
    if "alpha" not in leaf["value"].dims:
        return leaf
    at = float(np.clip(0.0, leaf["alpha"].values[0], leaf["alpha"].values[-1]))
    kept = leaf.drop_vars("source", errors="ignore")
    found = kept.interp(alpha=at).drop_vars("alpha")
    return found.assign({name: found[name].astype(float) for name in found.data_vars})


def _beyond_zero(leaf: xr.Dataset) -> xr.Dataset:
    """A term less its value at zero angle of attack."""
    if "alpha" not in leaf["value"].dims:
        raise SchemaError(
            "ground effect",
            ["alpha is an axis of a factor K1 or K2; multiply it into the table first"],
        )
    found = leaf.drop_vars("source", errors="ignore").copy()
    found["value"] = (leaf["value"] - _at_zero(leaf)["value"]).transpose(*leaf["value"].dims)
    return found


def _over_ground(
    leaf: xr.Dataset, one: CoefficientOverGround, term: str, tables: bool
) -> xr.Dataset:
    """A term in free air times its factor over the ground, as a power of the height or as a table
    over it.
    """
    floor, top = one.heights
    if one.form == "table":
        heights, K, stderr = one.tabled(term)
        leaf = _with_factor(leaf, heights, K)
        share = _share(K, stderr)
    else:
        common = one.form == "k h^s, one s"
        row = one.row(term, common)
        at_floor = one.factor(term, [floor], common)
        share = _share(at_floor["K"].values, at_floor["stderr"].values)
        leaf = in_ground_effect(leaf, row.k, row.s, floor)
        leaf = with_height_table(leaf, top) if tables else leaf
    own = leaf["stderr"].values if "stderr" in leaf else 0.0
    size = leaf["value"].values * float(
        np.abs(leaf["K1"].values).max() if "K1" in leaf and HEIGHT in leaf["K1"].dims else 1.0
    )
    leaf = leaf.assign(stderr=(leaf["value"].dims, np.hypot(own, share * np.abs(size))))
    leaf = leaf.assign(
        source=(
            leaf["value"].dims,
            np.full(leaf["value"].shape, _terms.SOURCES.index("flight"), np.uint8),
        )
    )
    leaf["source"].attrs = dict(_terms.SOURCE_ATTRS)
    return leaf.assign_attrs(
        references="[LR743] eq. (14)" if term == BANK else "[LR743] eq. (13)",
        comment=_comment(one, term),
    )


def _share(K: np.ndarray, stderr: np.ndarray) -> float:
    """Relative standard error of a factor where it is largest."""
    at = int(np.argmax(np.abs(K)))
    return float(stderr[at] / abs(K[at])) if K[at] else 0.0


def _with_factor(leaf: xr.Dataset, heights: np.ndarray, K: np.ndarray) -> xr.Dataset:
    """A term times a table over the height."""
    name = next((key for key in ("K1", "K2") if key not in leaf), None)
    if name is None:
        raise SchemaError(
            "ground effect", ["a term with two factors has no room for one over the height"]
        )
    return leaf.assign(
        {name: xr.DataArray(K, {HEIGHT: (HEIGHT, heights, quantity_attributes(HEIGHT))}, HEIGHT)}
    )


def _comment(one: CoefficientOverGround, term: str) -> str:
    note = f"identified from {one.heights[0]:.3g} m up, form: {one.form}"
    if one.form == "table":
        return note
    row = one.row(term, one.form == "k h^s, one s")
    return (
        f"{note}; k {row.k:.4g} ({row.k_stderr:.2g}), s {row.s:.4g} ({row.s_stderr:.2g}), "
        f"correlation {row.correlation:.2f}, h in metres"
    )
