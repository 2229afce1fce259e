"""What a separable regression found: estimates of coefficients and shape parameters, as text and as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName

from ..expressions.expression import Scope
from ..expressions.reading import parse
from ..expressions.separable_model import SeparableModel
from ..uncertainty import collinearity


@dataclass(frozen=True)
class SeparableFit:
    """Estimates of models that are nonlinear in few parameters.

    Attributes
    ----------
    name : str
    models : tuple of SeparableModel
        One per measured quantity.
    estimates : Dataset (term, term_, error)
        All coefficients (of several quantities as ``CL: alpha``), then the shape parameters: ``estimate``, ``stderr``
        (coloured residuals), ``stderr_white``, ``stderr_systematic``, ``covariance``, ``correlation``, ``systematic`` as in
        `Fit`; ``t``, ``narrowed``, ``identified``, ``why`` as in `identifiability`; ``condition_index`` (component) and
        ``proportion`` (component, term).  NaN for the errors of a parameter at a bound.
    data : dict of str to Dataset (sample,)
        The samples used, by quantity.
    residuals : dict of str to array (sample,)
        Measured minus fitted, by quantity.
    """

    name: str
    models: tuple[SeparableModel, ...]
    estimates: xr.Dataset
    data: Mapping[str, xr.Dataset]
    residuals: Mapping[str, np.ndarray]

    def value(self, parameter: str) -> tuple[float, float]:
        """Return an estimate and its standard error.

        Raises
        ------
        UnknownName
            No such coefficient or parameter.
        """
        known = [str(term) for term in self.estimates["term"].values]
        if parameter not in known:
            raise UnknownName(parameter, known, "coefficient or parameter")
        one = self.estimates.sel(term=parameter)
        return float(one["estimate"]), float(one["stderr"])

    def derived(self, *texts: str) -> tuple[np.ndarray, np.ndarray]:
        """Return functions of the estimates and their covariance, by first-order propagation.

        Parameters
        ----------
        *texts : str
            Expressions of the estimates; a coefficient is written as its term in brackets:
            ``"[alpha*h_agl^s] / [alpha]"``.

        Returns
        -------
        values : array (texts,)
        covariance : array (texts, texts)
            NaN where an estimate without standard error takes part.

        Raises
        ------
        UnknownName
            A name that is no estimate.
        ParseError
            What is no expression.
        """
        names = [str(term) for term in self.estimates["term"].values]
        scope = Scope({}, dict(zip(names, self.estimates["estimate"].values)))
        found = [parse(text).at(scope) for text in texts]
        G = np.array([[float(one.by.get(name, 0.0)) for name in names] for one in found])
        C = self.estimates["covariance"].values
        unknown = np.isnan(np.diag(C))
        covariance = G @ np.where(unknown[:, None] | unknown, 0.0, C) @ G.T
        lost = (G[:, unknown] != 0.0).any(axis=1)
        covariance[lost] = covariance[:, lost] = np.nan
        return np.array([float(one.value) for one in found]), covariance

    @property
    def remarks(self) -> list[str]:
        """Parameters that the data cannot see, and those that they hardly distinguish, in words."""
        e = self.estimates
        found = [f"{term}: not identified: {why}" for term, why in zip(e["term"].values, e["why"].values) if why]
        found += [f"condition index {index:.0f}: hardly distinguishable are {words}" for index, words in collinearity.pairs(e)]
        return found

    def report(self) -> str:
        """Return the estimates as a text table."""
        e, a = self.estimates, self.estimates.attrs
        fitted = zip(self.models, np.atleast_1d(a["R2"]), np.atleast_1d(a["residual_rms"]), a["units"].split("; "))
        lines = [f"{self.name}: {self.models[0]}" if self.name and len(self.models) == 1 else self.name]
        lines = [line for line in lines if line] or [str(self.models[0])]
        lines += [f"{model.target} [{unit}]: R2 {R2:.4f}, residual rms {rms:.3g}" for model, R2, rms, unit in fitted]
        lines.append(f"samples {a['samples']}, manoeuvres {a['manoeuvres']}")
        wide = max(len(str(term)) for term in e["term"].values) + 2
        lines.append(f"{'parameter':<{wide}}{'estimate':>12}{'stderr':>10}{'white':>10}{'system.':>10}{'t':>9}{'narrowed':>10}")
        for k, term in enumerate(e["term"].values):
            errors = "".join(_cell(float(e[name][k]), 10, ".2g") for name in ("stderr", "stderr_white", "stderr_systematic"))
            t, narrowed = _cell(float(e["t"][k]), 9, ".1f"), _cell(float(e["narrowed"][k]), 10, ".3f")
            lines.append(f"{term!s:<{wide}}{float(e['estimate'][k]):>12.5g}{errors}{t}{narrowed}")
        return "\n".join([*lines, *(f"! {text}" for text in self.remarks)])


def _cell(value: float, width: int, form: str) -> str:
    return f"{'-' if np.isnan(value) else format(value, form):>{width}}"
