"""Selection of terms by the prediction of left-out manoeuvres, and the spread of the models.

The result is a set of models with weights (`ModelComparison`). The best one is fitted as any other
model. How far its estimates move in the other models is a further error of them: the covariance of
the fit contains it, so that tables made from the fit inherit it [Buckland1997]_.

Parameters of polynomials are compared at the mean of the flown variables. The slope at zero of a
model with a square and of one without it are different quantities; their slopes at the mean are
not.

References
----------
.. [Buckland1997] Buckland, Burnham, Augustin, Model selection: an integral part of inference,
   Biometrics 53, 1997.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.model_structure.candidates import (
    CandidateEquations,
    candidate_equations,
)
from flighttest.regression.model_structure.hierarchy import TermHierarchy, add_factors
from flighttest.regression.model_structure.model_set import AllowedModel, ModelComparison
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.rating import Rating
from flighttest.regression.model_structure.selection import Selection, fit_selected_terms
from flighttest.regression.uncertainty.significance import CONFIDENCE


def select_by_prediction(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None = None,
    keep: Sequence[str] = ("1",),
    hierarchy: bool = True,
    name: str = "",
    weights: str = "equal",
    constraints: Sequence[str] = (),
) -> Selection:
    """Select terms by the prediction of manoeuvres, or blocks, that are left out.

    Parameters
    ----------
    coefficient, candidates, data, band, keep, hierarchy, name, weights, constraints
        As in `select_stepwise`.

    Returns
    -------
    Selection
        ``models`` is the set of models that the evidence allows. ``fit`` is that of the best one;
        its covariance contains the spread of the others, ``stderr_models`` is its root.

    Raises
    ------
    IdentificationError
        No candidate explains the coefficient, or a term to keep does not move.

    Notes
    -----
    With many candidates the 24 with the largest gain are compared (`choose_pool`). A band has
    blocks of frequencies in place of manoeuvres.
    """
    if hierarchy:
        candidates = add_factors(candidates, coefficient)
    problem = candidate_equations(
        coefficient, candidates, data, band=band, weights=weights, constraints=constraints
    )
    rules = TermHierarchy(problem, keep, is_free=not hierarchy)
    comparison = ModelComparison(problem, rules)
    models = comparison.allowed()
    best = models[0].terms
    basis, steps = OrthogonalBasis(problem.X, problem.z), []
    rating = Rating(problem)
    for j in best:
        basis.add(j)
        action = "kept" if j in rules.required else "chosen"
        steps.append(rating.make_row(action, problem.terms[j], basis=basis))
    found = fit_selected_terms(
        "prediction",
        problem,
        work=basis,
        rows=steps,
        keep=rules.required,
        data=data,
        name=name,
        drop=False,
    )
    fit = add_model_spread(found.fit, problem, models)
    fit.estimates.attrs.update(
        models=len(models),
        models_rated=comparison.prediction.rated,
        models_complete=int(comparison.is_complete),
    )
    return replace(found, fit=fit, models=_tabulate_models(problem, models))


def _tabulate_models(problem: CandidateEquations, models: Sequence[AllowedModel]) -> pd.DataFrame:
    """Return the models of a set as a table."""
    rows = []
    for model in models:
        terms = problem.model_terms(model.terms)
        if problem.band is not None:
            terms.insert(0, "1")
        rows.append(
            {
                "model": " + ".join(terms),
                "terms": len(terms),
                "rating": model.rating,
                "difference": model.difference,
                "stderr": model.stderr,
                "weight": model.weight,
            }
        )
    return pd.DataFrame(rows)


def add_model_spread(fit: Fit, problem: CandidateEquations, models: Sequence[AllowedModel]) -> Fit:
    """Return a fit whose covariance contains the spread of other models.

    Parameters
    ----------
    fit : Fit
        Fit of the first model.
    problem : CandidateEquations
    models : sequence of AllowedModel

    Returns
    -------
    Fit
        ``covariance``, ``stderr``, ``correlation``, ``t``, ``p_value`` and the interval contain the
        spread sum of w (theta_k - theta)(theta_k - theta)' over the models with their weights w;
        ``stderr_models`` is the root of its diagonal. F is that of the fit.
    """
    e = fit.estimates
    terms = [str(term) for term in e["term"].values]
    samples = problem.samples.data
    means = {str(name): float(samples[name].mean()) for name in samples.data_vars}
    centred = [_centred_parameters(problem, model.terms, means) for model in models]
    best = models[0].terms
    matrix = _centred_model(problem, terms, means).absolute()[1]
    spread = np.zeros((len(terms), len(terms)))
    for model, values in zip(models[1:], centred[1:]):
        change = [values.get(term, 0.0) - centred[0].get(term, 0.0) for term in terms]
        d = matrix[: len(terms)] @ np.array(change)
        if problem.ties is not None:
            d = problem.ties.project(best, terms, d)
        spread += model.weight * np.outer(d, d)
    covariance = e["covariance"].values + spread
    stderr = np.sqrt(np.diag(covariance))
    scale = np.where(stderr > 0.0, stderr, 1.0)
    old = e["stderr"].values
    ratio = np.where(stderr > 0.0, old / scale, 1.0)
    t = e["t"].values * ratio
    models_error = np.sqrt(np.diag(spread))
    # The interval has the normal quantile of the spread, as of a systematic error.
    quantile = scipy.stats.norm.ppf(0.5 + CONFIDENCE / 2.0)
    half = np.hypot(e["high"].values - e["estimate"].values, quantile * models_error)
    spread_name = {"long_name": "spread of the models that the evidence allows, one sigma"}
    changed = {
        "covariance": (("term", "term_"), covariance),
        "correlation": (("term", "term_"), covariance / np.outer(scale, scale)),
        "t": ("term", t),
        "p_value": ("term", 2.0 * scipy.stats.t.sf(np.abs(t), e["dof"].values), e["p_value"].attrs),
        "low": ("term", e["estimate"].values - half, e["low"].attrs),
        "high": ("term", e["estimate"].values + half, e["high"].attrs),
        "stderr": ("term", stderr, e["stderr"].attrs),
        "stderr_models": ("term", models_error, spread_name),
    }
    return replace(fit, estimates=e.assign(changed))


def _centred_model(
    problem: CandidateEquations, terms: Sequence[str], means: dict[str, float]
) -> RegressionModel:
    """Return a model in departures of its variables from their means."""
    model = RegressionModel(problem.coefficient, terms)
    return replace(model, reference={name: means[name] for name in model.variables})


def _centred_parameters(
    problem: CandidateEquations, model: Sequence[int], means: dict[str, float]
) -> dict[str, float]:
    """Return the parameters of a model at the mean of the variables, by the name of the term."""
    theta = np.linalg.lstsq(problem.X[list(model)].T, problem.z, rcond=None)[0]
    terms, theta = problem.expand(model, theta)
    absolute, matrix = _centred_model(problem, terms, means).absolute()
    # In a band the constant, and without hierarchy lower powers, are not in the model: zero.
    values = dict(zip(terms, theta))
    known = np.array([values.get(term, 0.0) for term in absolute.terms])
    return dict(zip(terms, np.linalg.lstsq(matrix, known, rcond=None)[0]))
