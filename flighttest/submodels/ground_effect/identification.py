"""Ground effect of each coefficient from landings, low passes and free-air records together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from aerodb.store.evaluation import contributions
from aerodb.store.schema import terms
from flightmech.errors import IdentificationError, UnknownName
from flightmech.terms import SOURCES, list_model_variables
from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.regression.equation_error.samples import RegressionSamples, stack_samples
from flighttest.regression.separable.fit import SeparableFit, regress_separable
from flighttest.regression.uncertainty.collinearity import RANK
from flighttest.submodels.ground_effect.result import (
    CoefficientOverGround,
    GroundEffect,
    form_by_evidence,
)
from flighttest.submodels.ground_effect.structure import (
    EXPONENTS,
    HEIGHT,
    HeightTable,
    exponent_name,
    ground_terms,
    height_breakpoints,
    height_table,
    independent_samples,
    model_over_ground,
    rank_forms,
    schwarz_criterion,
    times_height_power,
    with_heights,
)

# Share of a term in a vanishing combination above which it takes part in it.
_SHARE = 1e-6
AT_REST = ("delta_t", "delta_ta", "delta_tr", "gear", "speedbrake", "delta_f")


def identify_ground_effect(
    models: Sequence[RegressionModel],
    data: Sequence[xr.Dataset],
    ground: Mapping[str, Sequence[str]] | None = None,
    database: xr.DataTree | None = None,
    hold: bool = False,
    names: Sequence[str] | None = None,
    exponents: tuple[float, float] = EXPONENTS,
) -> GroundEffect:
    """Identify the ground effect of coefficients as C_free (1 + k h^s) per derivative, and k h^s
    (CL phi) of Cl.

    Parameters
    ----------
    models : sequence of Model
        The free-air terms of each coefficient, such as ``CL = 1 + alpha + qhat + delta_e``.
    data : sequence of Dataset (time,)
        Landings up to the touch-down, low passes and free-air records of *one* configuration, as
        `coefficients` returns them, with the height ``h_agl`` over the runway; a record without it
        counts as free air. [SI]
    ground : mapping of str to sequence of str, optional
        Terms that the ground may change, by coefficient; without it all terms of CL, CD and Cm, and
        ``CL*phi`` of Cl.
    database : DataTree, optional
        Its tables of ground effect take part in the comparison of forms.
    hold : bool
        Take the free-air terms from `database` as they are; otherwise they are estimated along.
    names : sequence of str, optional
        Of the records, for texts.
    exponents : (low, high)
        Bounds of the exponents s.

    Returns
    -------
    GroundEffect

    Raises
    ------
    IdentificationError
        No record with a height, one that goes below zero, two models of a coefficient, or terms
        that the data cannot distinguish.
    UnknownName
        A coefficient or variable that database or data do not hold.

    Notes
    -----
    A ground term that the data cannot see is deleted and the others are fitted again, the least significant first, as
    [LR743] 4.5 does; it is listed as *not identified*.  What is identified, and how the forms are compared, stands in
    `separable.identifiability` and `evidence`.  h^s counts metres, and k with it.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.5.1, eq. (13), (14), table 2.
    """
    if hold and database is None:
        raise IdentificationError(
            "free-air terms are to be held, but there is no database to hold them at; give one"
        )
    coefficients = [model.coefficient for model in models]
    if not coefficients or len(set(coefficients)) < len(coefficients):
        raise IdentificationError(
            f"models of {' '.join(coefficients) or 'nothing'}; give one of each coefficient"
        )
    for name in ground or {}:
        if name not in coefficients:
            raise UnknownName(
                name, coefficients, "coefficient", "there are ground terms for it, but no model"
            )
    labels = list(names) if names is not None else [f"record {k + 1}" for k in range(len(data))]
    records = with_heights(data, labels)
    found = {}
    for model in models:
        terms = (
            tuple(RegressionModel(model.coefficient, ground[model.coefficient]).terms)
            if ground and model.coefficient in ground
            else None
        )
        one = _Coefficient(model, terms or ground_terms(model), records, database, hold, exponents)
        found[model.coefficient] = one.identified()
    return GroundEffect(found, held=hold)


class _Coefficient:
    """One coefficient on its way from records to identified terms."""

    def __init__(
        self,
        model: RegressionModel,
        ground: Sequence[str],
        records,
        database,
        hold: bool,
        exponents: tuple[float, float],
    ):
        self.model, self.ground, self.hold, self.exponents = model, tuple(ground), hold, exponents
        self.database = (
            None if database is None else _database_parts(database, model.coefficient, records)
        )
        self.records = records
        if hold and self.database is not None:
            self.records = _less(records, model.coefficient, self.database.free)

    def identified(self) -> CoefficientOverGround:
        """Terms that the data can see, those that they cannot, and the form that the evidence
        chooses.
        """
        name = self.model.coefficient
        fit, left, deleted = self.reduced()
        common = self.fit(left, common=True) if len(left) > 1 else None
        samples = stack_samples(name, self.wanted, self.records, self.model)
        h = samples.data[HEIGHT].values
        forms = self.closed_forms(samples, fit, common)
        n = independent_samples(forms["k h^s" if fit else "none"][0], samples)
        table = self.table(samples, left, forms["none"][0], n)
        if table is not None:
            forms["table"] = table.residual, table.parameters
        evidence = rank_forms(forms, n)
        heights = float(h.min()), float(height_breakpoints(h)[-1])
        return CoefficientOverGround(
            self.model,
            left,
            deleted,
            fit,
            common,
            self.references({*left, *(table.terms if table is not None else ())}),
            table,
            form_by_evidence(evidence),
            heights,
            evidence,
        )

    def fit(
        self, ground: Sequence[str], common: bool = False, starts: Mapping[str, float] | None = None
    ) -> SeparableFit:
        """Fit one form of the model."""
        separable = model_over_ground(self.model, ground, self.hold, common, self.exponents, starts)
        return regress_separable(
            separable, self.records, f"{self.model.coefficient} over the ground"
        )

    def reduced(self) -> tuple[SeparableFit | None, tuple[str, ...], dict[str, str]]:
        """Delete what the data cannot see, the least significant term first."""
        left = self.ground
        deleted: dict[str, str] = {}
        starts: dict[str, float] = {}
        while left:
            fit = self.fit(left, starts=starts)
            e = fit.estimates
            reasons = {term: _why(fit, term) for term in left}
            unseen = [term for term in left if reasons[term]]
            if not unseen:
                return fit, left, deleted
            least = min(unseen, key=lambda term: float(e["t"].sel(term=times_height_power(term))))
            deleted[least] = reasons[least]
            left = tuple(term for term in left if term != least)
            starts = {exponent_name(term): fit.value(exponent_name(term))[0] for term in left}
        return None, left, deleted

    @property
    def wanted(self) -> list[str]:
        """Variables that every form needs, so that all have the same samples."""
        terms = [*dict.fromkeys([*self.model.terms, *self.ground])]
        return [*RegressionModel(self.model.coefficient, terms).variables, HEIGHT]

    def free_terms(self, samples: RegressionSamples) -> np.ndarray:
        """Regressors of the free-air terms that are estimated along, (samples, terms)."""
        return (
            np.zeros((samples.data.sizes["sample"], 0))
            if self.hold
            else self.model.design(samples.data)
        )

    def closed_forms(
        self, samples: RegressionSamples, fit: SeparableFit | None, common
    ) -> dict[str, tuple[np.ndarray, int | None]]:
        """Residual and number of parameters of each form but the table."""
        name, X = self.model.coefficient, self.free_terms(samples)
        found: dict[str, tuple[np.ndarray, int | None]] = {
            "none": (_rest(X, samples.data[name].values), X.shape[1])
        }
        for form, one in (("k h^s", fit), ("k h^s, one s", common)):
            if one is not None:
                found[form] = one.residuals[name], one.estimates.sizes["term"]
        if self.database is not None:
            rest = (
                stack_samples(
                    name,
                    self.wanted,
                    _less(self.records, name, self.database.over_ground),
                    self.model,
                )
                .data[name]
                .values
            )
            found["database"] = _rest(X, rest), None if self.database.from_flight else X.shape[1]
        return found

    def table(
        self, samples: RegressionSamples, left: Sequence[str], rest: np.ndarray, n: float
    ) -> HeightTable | None:
        """Tables over the height of the terms identified, and of others that lower the criterion;
        None where there are none.
        """
        h, z, X = (
            samples.data[HEIGHT].values,
            samples.data[self.model.coefficient].values,
            self.free_terms(samples),
        )
        found, least = None, schwarz_criterion(rest, X.shape[1], n)
        for chosen in (left, *((*left, term) for term in self.ground if term not in left)):
            candidate = tuple(dict.fromkeys((*(found.terms if found else ()), *chosen)))
            if not candidate:
                continue
            try:
                trial = height_table(
                    X,
                    candidate,
                    term_regressors(candidate, samples.data).T,
                    h,
                    z,
                    samples,
                    height_breakpoints(h),
                )
            except IdentificationError:
                continue
            if (own := schwarz_criterion(trial.residual, trial.parameters, n)) < least:
                found, least = trial, own
        return found

    def references(self, ground: Collection[str]) -> dict[str, float]:
        """Return the free-air coefficients of held terms, from the database along the records.

        Raises
        ------
        IdentificationError
            The records do not determine the coefficient of a term of `ground`.
        """
        if not self.hold or self.database is None:
            return {}
        name = self.model.coefficient
        records = []
        for record, part in zip(self.records, self.database.free):
            records.append(record.assign({name: ("time", part)}))
        samples = stack_samples(name, self.model.variables, records, self.model)
        X = self.model.design(samples.data)
        ambiguous = sorted(_undetermined_terms(X, self.model.terms) & set(ground))
        if ambiguous:
            raise IdentificationError(
                f"{name}: the records do not determine the free-air coefficient of "
                f"{', '.join(ambiguous)}, to which the ground effect is a ratio; add a record that "
                f"moves the free-air terms apart, or leave one out"
            )
        theta = np.linalg.lstsq(X, samples.data[name].values, rcond=None)[0]
        return dict(zip(self.model.terms, map(float, theta)))


def _undetermined_terms(X: np.ndarray, terms: Sequence[str]) -> set[str]:
    """Return the terms of combinations that vanish along the records X (samples, terms)."""
    length = np.linalg.norm(X, axis=0)
    moving = np.flatnonzero(length > 0.0)
    _, s, Vt = np.linalg.svd(X[:, moving] / length[moving], full_matrices=len(X) < len(moving))
    sizes = np.pad(s, (0, len(Vt) - len(s)))
    vanishing = Vt[sizes < RANK * s[0]]
    # Least squares divides the coefficients of such a combination at will.
    takes_part = (np.abs(vanishing) > _SHARE).any(axis=0)
    return {terms[k] for k in moving[takes_part]}


def _rest(X: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Residual of least squares."""
    return z - X @ np.linalg.lstsq(X, z, rcond=None)[0] if X.shape[1] else z


def _why(fit: SeparableFit, term: str) -> str:
    """Why a ground term is not identified; an empty text when it is."""
    e = fit.estimates
    for name in (times_height_power(term), exponent_name(term)):
        if text := str(e["why"].sel(term=name).values):
            return text
    value, stderr = fit.value(times_height_power(term))
    return (
        ""
        if abs(value) > 2.0 * stderr
        else f"k is {abs(value) / stderr:.1f} standard errors from zero, 2 are needed"
    )


def _less(
    records: Sequence[xr.Dataset], name: str, parts: Sequence[np.ndarray]
) -> list[xr.Dataset]:
    """Records whose coefficient has a part taken off."""
    return [
        one.assign({name: ("time", one[name].values - part)}) for one, part in zip(records, parts)
    ]


class _Database(NamedTuple):
    """What a database states of a coefficient along the records: in free air, what its terms over
    the ground add, and whether any node of these comes from flight.
    """

    free: list[np.ndarray]
    over_ground: list[np.ndarray]
    from_flight: bool


def _database_parts(
    database: xr.DataTree, coefficient: str, records: Sequence[xr.Dataset]
) -> _Database:

    leaves = {
        name: leaf
        for name, leaf in terms(database).items()
        if name.startswith(f"{coefficient}/") and HEIGHT in list_model_variables(leaf)
    }
    over_ground = {name.partition("/")[2] for name in leaves}
    flight = SOURCES.index("flight")
    flown = any(
        (leaf["source"].values == flight).any() for leaf in leaves.values() if "source" in leaf
    )
    free, near = [], []
    for one in records:
        size = one.sizes["time"]
        conditions: Any = one.assign({name: 0.0 for name in AT_REST if name not in one})
        parts = contributions(database, coefficient, conditions, outside="clamp")
        sums = [np.zeros(size), np.zeros(size)]
        for name, part in parts.items():
            sums[name in over_ground] = sums[name in over_ground] + np.broadcast_to(part, (size,))
        free.append(sums[0])
        near.append(sums[1])
    return _Database(free, near, flown)
