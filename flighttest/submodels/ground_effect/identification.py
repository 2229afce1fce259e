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

# Variables of the database that are zero if the records do not contain them.
AT_REST = ("delta_t", "delta_ta", "delta_tr", "gear", "speedbrake", "delta_f")
# Standard errors from zero that k of an identified term must have.
_SIGNIFICANT = 2.0
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

    The form is C_free (1 + k h^s) for each derivative, and k h^s (CL phi) for Cl.

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
        name = self.model.coefficient
        fit, identified, deleted = self.delete_terms()
        common = None
        if len(identified) > 1:
            common = self.fit(identified, common=True)
        samples = stack_samples(name, self.variables, self.records, self.model)
        h = samples.data[HEIGHT].values
        forms = self.closed_forms(samples, fit, common)
        n = independent_samples(forms["k h^s" if fit else "none"][0], samples)
        table = self.table(samples, identified, residual=forms["none"][0], n=n)
        if table is not None:
            forms["table"] = table.residual, table.parameters
        evidence = rank_forms(forms, n)
        tabled = table.terms if table is not None else ()
        return CoefficientOverGround(
            model=self.model,
            ground=identified,
            not_identified=deleted,
            fit=fit,
            common=common,
            references=self.references({*identified, *tabled}),
            table=table,
            form=form_by_evidence(evidence),
            heights=(float(h.min()), float(height_breakpoints(h)[-1])),
            evidence=evidence,
        )

    def fit(
        self, ground: Sequence[str], common: bool = False, starts: Mapping[str, float] | None = None
    ) -> SeparableFit:
        """Return the fit of one form of the model."""
        separable = model_over_ground(
            self.model,
            ground,
            held=self.hold,
            common=common,
            exponents=self.exponents,
            starts=starts,
        )
        return regress_separable(
            separable, self.records, f"{self.model.coefficient} over the ground"
        )

    def delete_terms(self) -> tuple[SeparableFit | None, tuple[str, ...], dict[str, str]]:
        """Return fit, identified terms, and deleted terms with the reason.

        Terms without information are deleted one by one, the least significant first.
        """
        ground = self.ground
        deleted: dict[str, str] = {}
        starts: dict[str, float] = {}
        while ground:
            fit = self.fit(ground, starts=starts)
            reasons = {term: _reason(fit, term) for term in ground}
            unidentified = [term for term in ground if reasons[term]]
            if not unidentified:
                return fit, ground, deleted
            t = fit.estimates["t"]
            least = min(unidentified, key=lambda term: float(t.sel(term=times_height_power(term))))
            deleted[least] = reasons[least]
            ground = tuple(term for term in ground if term != least)
            # The next search starts from the exponents of this fit.
            exponents = [exponent_name(term) for term in ground]
            starts = {name: fit.value(name)[0] for name in exponents}
        return None, ground, deleted

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

    def closed_forms(
        self, samples: RegressionSamples, fit: SeparableFit | None, common: SeparableFit | None
    ) -> dict[str, tuple[np.ndarray, int | None]]:
        """Return residual and number of parameters of each form except the table."""
        name, X = self.model.coefficient, self.free_air_regressors(samples)
        forms: dict[str, tuple[np.ndarray, int | None]] = {
            "none": (_residual(X, samples.data[name].values), X.shape[1])
        }
        for form, closed in (("k h^s", fit), ("k h^s, one s", common)):
            if closed is not None:
                forms[form] = closed.residuals[name], closed.estimates.sizes["term"]
        if self.database is not None:
            parts = _subtract_parts(self.records, name, self.database.over_ground)
            z = stack_samples(name, self.variables, parts, self.model).data[name].values
            # A database from these flights has no number of parameters, see `rank_forms`.
            count = None if self.database.from_flight else X.shape[1]
            forms["database"] = _residual(X, z), count
        return forms

    def table(
        self,
        samples: RegressionSamples,
        identified: Sequence[str],
        residual: np.ndarray,
        n: float,
    ) -> HeightTable | None:
        """Return tables over the height of identified terms, and of terms that lower the criterion.

        Without such terms return None. `residual` is that of the model without ground effect, and
        `n` the number of independent samples.
        """
        X = self.free_air_regressors(samples)
        h, z = samples.data[HEIGHT].values, samples.data[self.model.coefficient].values
        best, least = None, schwarz_criterion(residual, X.shape[1], n)
        extensions = [tuple(identified)]
        extensions += [(*identified, term) for term in self.ground if term not in identified]
        for extension in extensions:
            accepted = best.terms if best else ()
            candidate = tuple(dict.fromkeys((*accepted, *extension)))
            if not candidate:
                continue
            try:
                trial = height_table(
                    X,
                    candidate,
                    ground=term_regressors(candidate, samples.data).T,
                    h=h,
                    z=z,
                    samples=samples,
                    heights=height_breakpoints(h),
                )
            except IdentificationError:
                continue
            criterion = schwarz_criterion(trial.residual, trial.parameters, n)
            if criterion < least:
                best, least = trial, criterion
        return best

    def references(self, ground: Collection[str]) -> dict[str, float]:
        """Return the free-air coefficients of fixed terms, from the database along the records.

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


def _residual(X: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the residual of least squares."""
    if not X.shape[1]:
        return z
    return z - X @ np.linalg.lstsq(X, z, rcond=None)[0]


def _reason(fit: SeparableFit, term: str) -> str:
    """Return why a ground term is not identified, or an empty text."""
    for name in (times_height_power(term), exponent_name(term)):
        reason = str(fit.estimates["why"].sel(term=name).values)
        if reason:
            return reason
    value, stderr = fit.value(times_height_power(term))
    if abs(value) > _SIGNIFICANT * stderr:
        return ""
    return f"k is {abs(value) / stderr:.1f} standard errors from zero, {_SIGNIFICANT:g} are needed"


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
