"""Ground effect of each coefficient from landings, low passes and free-air records together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from aerodb.store.evaluation import contributions
from aerodb.store.schema import terms
from flightmech.aircraft.controls import ICE
from flightmech.errors import IdentificationError, UnknownName
from flightmech.terms import SOURCES, list_model_variables
from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.regression.equation_error.samples import RegressionSamples, stack_samples
from flighttest.regression.uncertainty.collinearity import RANK
from flighttest.submodels.ground_effect.evidence import (
    RichestForm,
    fit_richest_form,
    misfit_of,
    rank_forms,
    schwarz_criterion,
)
from flighttest.submodels.ground_effect.law_search import ClosedForm, LawSearch
from flighttest.submodels.ground_effect.laws import EXPONENTS, HEIGHT, LAWS, POWER, HeightLaw
from flighttest.submodels.ground_effect.result import (
    CoefficientOverGround,
    GroundEffect,
    form_by_evidence,
)
from flighttest.submodels.ground_effect.structure import (
    ground_terms,
    height_breakpoints,
    with_heights,
)
from flighttest.submodels.ground_effect.tables import (
    HeightTable,
    TableSearch,
    least_squares_residual,
    table_regressors,
)

# Variables of the database that are zero if the records do not contain them.
AT_REST = ("delta_t", "delta_ta", "delta_tr", "gear", "speedbrake", "delta_f", ICE)
# Share of a term in a vanishing combination above which it takes part in it.
_SHARE = 1e-6


def identify_ground_effect(
    models: Sequence[RegressionModel],
    data: Sequence[xr.Dataset],
    ground: Mapping[str, Sequence[str]] | None = None,
    database: xr.DataTree | None = None,
    hold: bool = False,
    names: Sequence[str] | None = None,
    exponents: tuple[float, float] = EXPONENTS,
) -> GroundEffect:
    """Identify the ground effect of coefficients.

    The form is C_free (1 + K(h)) for each derivative, and K(h) (CL phi) for Cl, with K = k h^s or
    one of the other laws of `laws`, or a table.

    Parameters
    ----------
    models : sequence of Model
        The free-air terms of each coefficient, such as ``CL = 1 + alpha + qhat + delta_e``.
    data : sequence of Dataset (time,)
        Landings up to the touch-down, low passes and free-air records of *one* configuration, as
        from `coefficients`, with the height ``h_agl`` over the runway. A record without it is in
        free air. [SI]
    ground : mapping of str to sequence of str, optional
        Terms that the ground may change, by coefficient. Default: all terms of CL, CD and Cm, and
        ``CL*phi`` of Cl.
    database : DataTree, optional
        Database whose tables of ground effect take part in the comparison of forms.
    hold : bool
        Whether the free-air terms are fixed at `database`. Otherwise they are estimated.
    names : sequence of str, optional
        Names of the records, for texts.
    exponents : (low, high)
        Bounds of the exponents s.

    Returns
    -------
    GroundEffect

    Raises
    ------
    IdentificationError
        No record with a height, a height below zero, two models of a coefficient, or terms that the
        data cannot distinguish.
    UnknownName
        A coefficient or variable that database or data do not contain.

    Notes
    -----
    A ground term without information is deleted and the others are fitted again, the least
    significant first, as in [LR743] 4.5.  It is reported as *not identified*.  The criteria are
    those of `separable.identifiability` and `evidence`.  The height in h^s is in metres, which
    gives the unit of k.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.5.1, eq. (13), (14), table 2.
    """
    if hold and database is None:
        raise IdentificationError(
            "free-air terms are to be held, but there is no database to hold them at; give one"
        )
    requested = ground or {}
    _demand_models([model.coefficient for model in models], requested)
    # Names of the records for messages.
    labels = list(names or ())
    if names is None:
        labels = [f"record {number}" for number in range(1, len(data) + 1)]
    records = with_heights(data, labels)
    results = {}
    for model in models:
        name = model.coefficient
        candidates: tuple[str, ...] = ()
        if name in requested:
            candidates = tuple(RegressionModel(name, requested[name]).terms)
        identification = _CoefficientIdentification(
            model,
            candidates or ground_terms(model),
            records=records,
            database=database,
            hold=hold,
            exponents=exponents,
        )
        results[name] = identification.identify()
    return GroundEffect(results, held=hold)


def _demand_models(coefficients: Sequence[str], ground: Collection[str]) -> None:
    """Raise an error without one model of each coefficient, or for ground terms without a model."""
    if not coefficients or len(set(coefficients)) < len(coefficients):
        raise IdentificationError(
            f"models of {' '.join(coefficients) or 'nothing'}; give one of each coefficient"
        )
    for name in ground:
        if name not in coefficients:
            raise UnknownName(
                name, coefficients, "coefficient", "there are ground terms for it, but no model"
            )


def _flown_ranges(data: xr.Dataset, chosen: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return the smallest and largest value of each variable among chosen samples."""
    ranges = {}
    for name in map(str, data.data_vars):
        values = data[name].values
        if values.shape != chosen.shape or not np.isfinite(values[chosen]).any():
            continue
        own = values[chosen]
        ranges[name] = float(np.nanmin(own)), float(np.nanmax(own))
    return ranges


class _CoefficientIdentification:
    """Identification of one coefficient over the ground."""

    def __init__(
        self,
        model: RegressionModel,
        ground: Sequence[str],
        records: Sequence[xr.Dataset],
        database: xr.DataTree | None,
        hold: bool,
        exponents: tuple[float, float],
    ):
        self.model, self.ground, self.hold, self.exponents = model, tuple(ground), hold, exponents
        self.database: _DatabaseParts | None = None
        if database is not None:
            self.database = _database_parts(database, model.coefficient, records)
        self.records = list(records)
        if hold and self.database is not None:
            # Fixed free-air terms are subtracted, and only the ground effect is estimated.
            self.records = _subtract_parts(records, model.coefficient, self.database.free)

    def identify(self) -> CoefficientOverGround:
        """Return identified terms, terms without information, and the form of best evidence."""
        samples = stack_samples(self.model.coefficient, self.variables, self.records, self.model)
        h = samples.data[HEIGHT].values
        lowest = float(h.min())
        searches = self.full_searches(lowest)
        richest = self.richest_form(samples, [full for _, full in searches])
        # Forms compared: no effect, powers of the height, and tables over it.
        forms = self.linear_forms(samples)
        none, free_terms = forms["none"][0], self.free_air_regressors(samples).shape[1]
        closed: dict[str, ClosedForm] = {}
        deleted: dict[HeightLaw, dict[str, str]] = {}
        for search, full in searches:
            found, deleted[search.law] = search.delete_terms(full, none, free_terms, richest.n)
            if found is None:
                continue
            closed[found.name] = found
            # Terms may share one exponent, which saves parameters.
            if len(found.terms) > 1:
                starts = search.first_values(found.terms)
                common = search.fit(found.terms, common=True, starts=starts)
                closed[common.name] = common
        for form, fit in closed.items():
            forms[form] = fit.residual, fit.parameters
        tables = self.tables(samples, none, richest.n)
        for name, table in tables.items():
            forms[name] = table.residual, table.parameters
        # The criterion charges each form for its parameters.
        evidence = rank_forms(forms, richest.n)
        form = form_by_evidence(evidence)
        residual, _ = forms[form]
        best = _best_closed(closed, form, richest.n)
        law = best.law if best else POWER
        identified = best.terms if best else ()
        taken = set[str]().union(*(fit.terms for fit in closed.values()))
        taken.update(*(table.terms for table in tables.values()))
        top = float(height_breakpoints(h)[-1])
        return CoefficientOverGround(
            model=self.model,
            ground=identified,
            not_identified=deleted[law],
            closed=closed,
            best=best.name if best else "",
            references=self.references(taken),
            tables=tables,
            form=form,
            heights=(lowest, top),
            evidence=evidence,
            misfit=misfit_of(form, residual, int(evidence["parameters"][form]), richest),
            flown=_flown_ranges(samples.data, h <= top),
        )

    def full_searches(self, lowest: float) -> list[tuple[LawSearch, ClosedForm]]:
        """Return the search by each law with the fit of all ground terms.

        `lowest` is the lowest height of the records [m]. A law other than the power law is left out
        where the data do not determine its fit.
        """
        searches = []
        for law in LAWS:
            bounds = law.bounds(lowest, self.exponents)
            search = LawSearch(
                law, bounds, self.model, records=self.records, held=self.hold, lowest=lowest
            )
            try:
                full = search.fit(self.ground, starts=search.first_values(self.ground))
            except IdentificationError:
                if law is POWER:
                    raise
                continue
            searches.append((search, full))
        return searches

    def richest_form(self, samples: RegressionSamples, full: Sequence[ClosedForm]) -> RichestForm:
        """Return the fit of tables of all ground terms, together with the fits by all laws."""
        h = samples.data[HEIGHT].values
        ground = term_regressors(self.ground, samples.data).T
        tables = table_regressors(ground, h, height_breakpoints(h))
        X = np.hstack(
            [self.free_air_regressors(samples), tables, *(one.design(samples.data) for one in full)]
        )
        return fit_richest_form(X, samples.data[self.model.coefficient].values, samples)

    @property
    def variables(self) -> list[str]:
        """Variables of all forms, so that all forms have the same samples."""
        names = [*dict.fromkeys([*self.model.terms, *self.ground])]
        return [*RegressionModel(self.model.coefficient, names).variables, HEIGHT]

    def free_air_regressors(self, samples: RegressionSamples) -> np.ndarray:
        """Return the regressors of the estimated free-air terms, (samples, terms)."""
        if self.hold:
            return np.zeros((samples.data.sizes["sample"], 0))
        return self.model.design(samples.data)

    def linear_forms(self, samples: RegressionSamples) -> dict[str, tuple[np.ndarray, int | None]]:
        """Return residual and number of parameters without ground effect and of the database."""
        name, X = self.model.coefficient, self.free_air_regressors(samples)
        forms: dict[str, tuple[np.ndarray, int | None]] = {
            "none": (least_squares_residual(X, samples.data[name].values), X.shape[1])
        }
        if self.database is not None:
            parts = _subtract_parts(self.records, name, self.database.over_ground)
            z = stack_samples(name, self.variables, parts, self.model).data[name].values
            # A database from these flights has no number of parameters, see `rank_forms`.
            count = None if self.database.from_flight else X.shape[1]
            forms["database"] = least_squares_residual(X, z), count
        return forms

    def tables(
        self, samples: RegressionSamples, none: np.ndarray, n: float
    ) -> dict[str, HeightTable]:
        """Return the tables over the height by form; none where they lower no criterion.

        `none` is the residual without ground effect, and `n` the number of independent samples.
        """
        X, h = self.free_air_regressors(samples), samples.data[HEIGHT].values
        values, ambiguous = self.held_coefficients()
        held = {term: y for term, y in values.items() if term not in ambiguous}
        search = TableSearch(
            X,
            self.model.terms,
            ground=self.ground,
            regressors=term_regressors(self.ground, samples.data).T,
            samples=samples,
            h=h,
            z=samples.data[self.model.coefficient].values,
            heights=height_breakpoints(h),
            n=n,
            held=held,
        )
        separate = search.separate(schwarz_criterion(none, X.shape[1], n))
        found = (search.one_factor(), separate)
        return {table.form: table for table in found if table is not None}

    def references(self, ground: Collection[str]) -> dict[str, float]:
        """Return the free-air coefficients of fixed terms, from the database along the records.

        Raises
        ------
        IdentificationError
            The records do not determine the coefficient of a term of `ground`.
        """
        values, undetermined = self.held_coefficients()
        ambiguous = sorted(undetermined & set(ground))
        if ambiguous:
            raise IdentificationError(
                f"{self.model.coefficient}: the records do not determine the free-air coefficient "
                f"of {', '.join(ambiguous)}, to which the ground effect is a ratio; add a record "
                f"that moves the free-air terms apart, or leave one out"
            )
        return values

    def held_coefficients(self) -> tuple[dict[str, float], set[str]]:
        """Return the free-air coefficients of fixed terms, and those that are not determined.

        They come from the database along the records. Estimated terms have none.
        """
        if not self.hold or self.database is None:
            return {}, set()
        name = self.model.coefficient
        records = []
        for record, part in zip(self.records, self.database.free):
            records.append(record.assign({name: ("time", part)}))
        samples = stack_samples(name, self.model.variables, records, self.model)
        X = self.model.design(samples.data)
        theta = np.linalg.lstsq(X, samples.data[name].values, rcond=None)[0]
        coefficients = dict(zip(self.model.terms, map(float, theta)))
        return coefficients, _undetermined_terms(X, self.model.terms)


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


def _best_closed(closed: Mapping[str, ClosedForm], form: str, n: float) -> ClosedForm | None:
    """Return the closed form that is taken, or the one with the least criterion."""
    if not closed:
        return None
    return closed.get(form) or min(closed.values(), key=lambda one: one.criterion(n))


def _subtract_parts(
    records: Sequence[xr.Dataset], name: str, parts: Sequence[np.ndarray]
) -> list[xr.Dataset]:
    """Return records less a part of their coefficient."""
    differences = []
    for record, part in zip(records, parts):
        differences.append(record.assign({name: ("time", record[name].values - part)}))
    return differences


class _DatabaseParts(NamedTuple):
    """Parts of a coefficient along the records by a database.

    Attributes
    ----------
    free, over_ground : list of array (time,)
        Sum of the terms in free air, and of the terms over the ground, by record.
    from_flight : bool
        Whether a node of the terms over the ground has its value from flight.
    """

    free: list[np.ndarray]
    over_ground: list[np.ndarray]
    from_flight: bool


def _database_parts(
    database: xr.DataTree, coefficient: str, records: Sequence[xr.Dataset]
) -> _DatabaseParts:
    """Return the parts of a coefficient along the records."""
    flight = SOURCES.index("flight")
    over_ground, from_flight = set(), False
    for name, leaf in terms(database).items():
        if name.startswith(f"{coefficient}/") and HEIGHT in list_model_variables(leaf):
            over_ground.add(name.partition("/")[2])
            if "source" in leaf and (leaf["source"].values == flight).any():
                from_flight = True
    free, near_ground = [], []
    for record in records:
        size = record.sizes["time"]
        missing = {name: 0.0 for name in AT_REST if name not in record}
        conditions: Any = record.assign(missing)
        parts = contributions(database, coefficient, conditions, outside="clamp")
        # Index 0: terms in free air, 1: terms over the ground.
        sums = [np.zeros(size), np.zeros(size)]
        for name, part in parts.items():
            k = int(name in over_ground)
            sums[k] = sums[k] + np.broadcast_to(part, (size,))
        free.append(sums[0])
        near_ground.append(sums[1])
    return _DatabaseParts(free, near_ground, from_flight)
