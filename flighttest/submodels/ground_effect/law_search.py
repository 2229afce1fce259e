"""Search for the terms that the ground changes, by one law over the height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.separable.fit import (
    SeparableFit,
    minimum_residual,
    regress_separable,
)
from flighttest.regression.separable_model import SeparableModel
from flighttest.submodels.ground_effect.evidence import NEAR, schwarz_criterion
from flighttest.submodels.ground_effect.laws import HeightLaw, model_over_ground

# Standard errors from zero that the size of an identified term must have.
_SIGNIFICANT = 2.0


@dataclass(frozen=True)
class ClosedForm:
    """Fit of the terms over the ground by one law.

    Attributes
    ----------
    law : HeightLaw
    terms : tuple of str
        Ground terms.
    common : bool
        Whether all terms have one shape parameter.
    fit : SeparableFit
    """

    law: HeightLaw
    terms: tuple[str, ...]
    common: bool
    fit: SeparableFit

    @property
    def name(self) -> str:
        """Name of the form."""
        return self.law.common_form() if self.common else self.law.name

    def shape_name(self, term: str) -> str:
        """Return the name of the shape parameter of a term."""
        return self.law.symbol if self.common else self.law.shape_name(term)

    def regressor(self, term: str) -> str:
        """Return a term times the law in the spelling of the fit."""
        return self.law.regressor(term, self.shape_name(term))

    @property
    def residual(self) -> np.ndarray:
        """Measured minus fitted coefficient, (samples,)."""
        return self.fit.residuals[self.fit.models[0].target]

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients and shape parameters."""
        return int(self.fit.estimates.sizes["term"])

    def criterion(self, n: float) -> float:
        """Return Schwarz's criterion for `n` independent samples."""
        return schwarz_criterion(self.residual, self.parameters, n)

    def design(self, data: xr.Dataset) -> np.ndarray:
        """Return the regressors along samples at the estimated shape parameters."""
        model = self.fit.models[0]
        shapes = {name: self.fit.value(name)[0] for name in model.parameters}
        return model.design(data, shapes)[0]


class LawSearch:
    """Fits of one coefficient over the ground by one law."""

    def __init__(
        self,
        law: HeightLaw,
        bounds: tuple[float, float],
        model: RegressionModel,
        records: Sequence[xr.Dataset],
        held: bool,
        lowest: float,
    ):
        self.law, self.bounds, self.model, self.held = law, bounds, model, held
        self.records, self.start = records, law.start(lowest)

    def first_values(self, ground: Sequence[str]) -> dict[str, float]:
        """Return the first value of each shape parameter, for a search without an earlier one."""
        if self.start is None:
            return {}
        names = [self.law.symbol, *map(self.law.shape_name, ground)]
        return dict.fromkeys(names, self.start)

    def separable(
        self, ground: Sequence[str], common: bool = False, starts: Mapping[str, float] | None = None
    ) -> SeparableModel:
        """Return the model of ground terms.

        `common` is whether all terms have one shape parameter, and `starts` has first values of
        shape parameters.
        """
        return model_over_ground(
            self.model,
            ground,
            law=self.law,
            bounds=self.bounds,
            held=self.held,
            common=common,
            starts=starts,
        )

    def fit(
        self, ground: Sequence[str], common: bool = False, starts: Mapping[str, float] | None = None
    ) -> ClosedForm:
        """Return the fit of ground terms; the arguments are those of `separable`."""
        fit = regress_separable(
            self.separable(ground, common, starts),
            self.records,
            f"{self.model.coefficient} over the ground",
        )
        return ClosedForm(self.law, tuple(ground), common, fit)

    def delete_terms(
        self, full: ClosedForm, none: np.ndarray, free_terms: int, n: float
    ) -> tuple[ClosedForm | None, dict[str, str]]:
        """Return the fit of the identified terms, and the deleted terms with the reason.

        Parameters
        ----------
        full : ClosedForm
            Fit of all ground terms.
        none : array (samples,)
            Residual without ground effect.
        free_terms : int
            Number of estimated free-air terms.
        n : float
            Number of independent samples.

        Notes
        -----
        Terms without information are deleted one by one, the least significant first. Then terms
        are deleted that do not lower Schwarz's criterion: of two terms that cancel each other both
        are large, and many standard errors from zero.
        """
        found: ClosedForm | None = full
        deleted: dict[str, str] = {}
        nothing = schwarz_criterion(none, free_terms, n)
        while found is not None:
            least, reason = self._least_term(found, nothing, n)
            if not reason:
                break
            deleted[least] = reason
            found = self._without(found, least)
        return found, deleted

    def _least_term(self, found: ClosedForm, nothing: float, n: float) -> tuple[str, str]:
        """Return the term with the least information and why it is deleted, or an empty text.

        `nothing` is the criterion without ground effect.
        """
        reasons = {term: _reason(found, term) for term in found.terms}
        unidentified = [term for term in found.terms if reasons[term]]
        if unidentified:
            least = min(unidentified, key=lambda term: _significance(found, term))
            return least, reasons[least]
        rises = {}
        for term in found.terms:
            ground, starts = self._remaining(found, term)
            value = nothing
            if ground:
                model = self.separable(ground, starts=starts)
                v = minimum_residual(model, self.records)
                value = schwarz_criterion(v, len(model.terms) + len(model.parameters), n)
            rises[term] = value - found.criterion(n)
        least = min(rises, key=lambda term: rises[term])
        if rises[least] > NEAR:
            return least, ""
        return least, (
            f"without it Schwarz's criterion rises by {rises[least]:.1f}, more than {NEAR:g} are "
            f"needed"
        )

    def _without(self, found: ClosedForm, term: str) -> ClosedForm | None:
        """Return the fit without a term; None without any term is left."""
        ground, starts = self._remaining(found, term)
        return self.fit(ground, starts=starts) if ground else None

    def _remaining(self, found: ClosedForm, term: str) -> tuple[list[str], dict[str, float]]:
        """Return the other terms, and the shape parameters from which their search starts."""
        ground = [name for name in found.terms if name != term]
        names = [self.law.shape_name(name) for name in ground]
        return ground, {name: found.fit.value(name)[0] for name in names}


def _significance(found: ClosedForm, term: str) -> float:
    """Return the size of a term over its standard error, for given shapes."""
    return float(found.fit.estimates["t"].sel(term=found.regressor(term)))


def _reason(found: ClosedForm, term: str) -> str:
    """Return why a ground term is not identified, or an empty text."""
    estimates = found.fit.estimates
    for name in (found.regressor(term), found.shape_name(term)):
        reason = str(estimates["why"].sel(term=name).values)
        if reason:
            return reason
    value, stderr = found.fit.value(found.regressor(term))
    if abs(value) > _SIGNIFICANT * stderr:
        return ""
    return f"k is {abs(value) / stderr:.1f} standard errors from zero, {_SIGNIFICANT:g} are needed"
