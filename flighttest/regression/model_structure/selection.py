"""What a selection chose, step by step, and the ordinary polynomial with its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.combining.pooling import pool_fits
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.candidates import CandidateEquations
from flighttest.regression.uncertainty.collinearity import VIF


NEGLIGIBLE = 1e-3  # rms of a term over that of the coefficient below which it is dropped in the end


@dataclass(frozen=True)
class Selection:
    """A chosen model and how it came about.

    Attributes
    ----------
    method : str
        ``stepwise`` or ``orthogonal functions``.
    fit : Fit
        The chosen terms as an ordinary polynomial by `regress` or `regress_frequency`, with
        coloured errors.
    steps : DataFrame
        One row per step: ``action`` (kept, taken, entered, removed, dropped, for another term),
        ``term``, ``F``, ``partial_correlation``, ``R2``, ``PSE`` (predicted squared error),
        ``PRESS``, ``terms``.
    functions : Dataset (function, term)
        The orthogonal functions in the order taken, one named after the term that came with it:
        ``estimate``, ``stderr``, ``stderr_white``, ``share`` of the mean square explained,
        ``expansion`` (function, term) of each in terms.
    idle : tuple of str
        Candidates that did not move.
    """

    method: str
    fit: Fit
    steps: pd.DataFrame
    functions: xr.Dataset
    idle: tuple[str, ...]

    @property
    def model(self) -> RegressionModel:
        """The chosen model."""
        return self.fit.model

    @property
    def estimates(self) -> xr.Dataset:
        """Estimates of the ordinary polynomial; names as everywhere."""
        return self.fit.estimates

    def report(self, correlation: bool = False) -> str:
        """Return the steps and the final estimates as text, with their correlation matrix on
        demand.
        """
        lines = [
            f"{self.method}: {self.model}",
            f"{'step':<28}{'term':<24}{'F':>10}{'partial':>9}{'R2':>9}{'PSE':>11}{'PRESS':>11}{'terms':>7}",
        ]
        for row in self.steps.itertuples():
            lines.append(
                f"{row.action:<28}{row.term:<24}{row.F:>10.1f}{row.partial_correlation:>9.3f}{row.R2:>9.4f}{row.PSE:>11.3g}{row.PRESS:>11.3g}"
                f"{row.terms:>7}"
            )
        if self.idle:
            lines.append(
                f"candidates that do not move: "
                f"{' '.join(self.idle[:10])}{' ...' if len(self.idle) > 10 else ''}"
            )
        return "\n".join([*lines, "", self.fit.report(correlation)])


def count_selections(selections: Sequence[Selection]) -> pd.DataFrame:
    """Count in how many selections each term was chosen: the way from single records to a common
    model.

    Parameters
    ----------
    selections : sequence of Selection
        Of one coefficient, one per record.

    Returns
    -------
    DataFrame
        Index term, ``count`` and ``share`` (of the selections), most often chosen first.  Terms of
        a share above one half, and those physics requires, make the model that all records are then
        fitted with.

    Raises
    ------
    IdentificationError
        Selections of different coefficients, or none.

    References
    ----------
    .. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin aerodynamic modeling for a fixed-wing aircraft, Fig. 6.
    """

    if len(found := {one.model.coefficient for one in selections}) != 1:
        raise IdentificationError(
            f"selections of {', '.join(sorted(found)) or 'nothing'} cannot be counted; give "
            f"those of one coefficient"
        )
    counts = pd.Series([term for one in selections for term in one.model.terms]).value_counts(
        sort=True
    )
    return pd.DataFrame({"count": counts, "share": counts / len(selections)}).rename_axis("term")


def fit_selected_terms(
    method: str,
    problem: CandidateEquations,
    work: OrthogonalBasis,
    rows: Sequence[dict],
    keep: Sequence[int],
    data,
    name: str,
    drop: bool,
) -> Selection:
    """Turn the terms taken into an ordinary polynomial and fit it.

    Parameters
    ----------
    method : str
    problem : Equations
    work : Working
        With the terms taken.
    rows : sequence of dict
        The steps.
    keep : sequence of int
        Candidates that stay whatever they contribute.
    data, name
        As in `regress`.
    drop : bool
        Leave out terms whose rms is below a thousandth of that of the coefficient.

    Raises
    ------
    IdentificationError
        Nothing was chosen.
    """

    terms = [problem.terms[j] for j in work.taken]
    if not [term for term in terms if term != "1"]:
        raise IdentificationError(
            f"{name or problem.coefficient}: none of {len(problem.terms)} candidates "
            f"explains {problem.coefficient}; "
            "look at the excitation, or lower the threshold"
        )
    if drop:
        size = np.abs(work.estimates()) * np.std(problem.X[work.taken], axis=1) / np.std(problem.z)
        terms = [
            term
            for term, s, j in zip(terms, size, work.taken)
            if s >= NEGLIGIBLE or j in keep or term == "1"
        ]
    if problem.band is not None:
        terms = ["1", *terms]
    model = RegressionModel(problem.coefficient, terms)
    fit = (
        regress(model, data, name)
        if problem.band is None
        else regress_frequency(model, data, problem.band, name, weights=problem.weights)
    )
    return Selection(method, fit, pd.DataFrame(rows), _functions(problem, work, fit), problem.idle)


def _functions(problem: CandidateEquations, work: OrthogonalBasis, fit: Fit) -> xr.Dataset:
    """The orthogonal functions p = Q diag(R), so that each holds its own term once."""
    names = [problem.terms[j] for j in work.taken]
    R = work.triangle
    size = np.diag(R)
    s2 = work.rss / max(1, len(problem.z) - len(names))
    fitted = dict(
        zip(
            map(str, fit.estimates["term"].values),
            fit.estimates["stderr"].values / fit.estimates["stderr_white"].values,
        )
    )
    colour = np.array([fitted.get(name, 1.0) for name in names])
    total = float(((problem.z - (problem.z.mean() if problem.band is None else 0.0)) ** 2).sum())
    white = np.sqrt(s2) / size
    return xr.Dataset(
        {
            "estimate": ("function", np.array(work.a) / size),
            "stderr": ("function", white * colour),
            "stderr_white": ("function", white),
            "share": ("function", np.array(work.a) ** 2 / total),
            "expansion": (("function", "term"), (np.linalg.inv(R) * size).T),
        },
        coords={"function": [f"p{k}: {name}" for k, name in enumerate(names)], "term": names},
    )
