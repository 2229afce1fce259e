"""Result of a selection: the steps, and the ordinary polynomial with its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.candidates import CandidateEquations
from flighttest.regression.model_structure.hierarchy import missing_damping
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis

# rms of a term over that of the coefficient below which the polynomial does not contain the term
NEGLIGIBLE = 1e-3
_MOST_IDLE = 10  # names of idle candidates in a report
_MOST_MODELS = 12  # models in a report


@dataclass(frozen=True)
class Selection(ShortText):
    """A selected model and the steps of its selection.

    Attributes
    ----------
    method : str
        ``prediction``, ``stepwise`` or ``orthogonal functions``.
    fit : Fit
        The selected terms as an ordinary polynomial by `regress` or `regress_frequency`, with
        coloured errors.
    steps : DataFrame
        One row per step: ``action`` (kept, taken, entered, removed, dropped, for another term),
        ``term``, ``F``, ``partial_correlation``, ``R2``, ``PSE`` (predicted squared error),
        ``PRESS``, ``terms``.
    functions : Dataset (function, term)
        The orthogonal functions in the order of their choice, named after the term that each of
        them adds: ``estimate``, ``stderr``, ``stderr_white``, ``share`` of the mean square
        explained, ``expansion`` (function, term) of each in terms.
    idle : tuple of str
        Candidates that did not move.
    models : DataFrame
        Models that the evidence allows, the best first, by `select_by_prediction`; empty for the
        other methods. ``model`` (text), ``terms`` (their number), ``rating`` (ln of the density of
        all left-out parts less the price of the terms), ``difference`` from the best, ``stderr`` of
        the difference, ``weight``.
    """

    method: str
    fit: Fit
    steps: pd.DataFrame
    functions: xr.Dataset
    idle: tuple[str, ...]
    models: pd.DataFrame = field(default_factory=pd.DataFrame)

    @property
    def model(self) -> RegressionModel:
        """The selected model."""
        return self.fit.model

    @property
    def estimates(self) -> xr.Dataset:
        """Estimates of the ordinary polynomial, as in `Fit`."""
        return self.fit.estimates

    def report(self, correlation: bool = False) -> str:
        """Return the steps and the final estimates as text.

        Parameters
        ----------
        correlation : bool
            Add the correlation matrix of the estimates.
        """
        lines = [
            f"{self.method}: {self.model}",
            f"{'step':<28}{'term':<24}{'F':>10}{'partial':>9}{'R2':>9}{'PSE':>11}{'PRESS':>11}"
            f"{'terms':>7}",
        ]
        for row in self.steps.itertuples():
            lines.append(
                f"{row.action:<28}{row.term:<24}{row.F:>10.1f}{row.partial_correlation:>9.3f}"
                f"{row.R2:>9.4f}{row.PSE:>11.3g}{row.PRESS:>11.3g}{row.terms:>7}"
            )
        if self.idle:
            names = list(self.idle[:_MOST_IDLE])
            if len(self.idle) > _MOST_IDLE:
                names.append("...")
            lines.append(f"candidates that do not move: {' '.join(names)}")
        return "\n".join([*lines, *self._model_lines(), "", self.fit.report(correlation)])

    def _model_lines(self) -> list[str]:
        """Return the models that the evidence allows as lines of text."""
        if self.models.empty:
            return []
        count = len(self.models)
        lines = ["", f"models that the evidence allows: {count}"]
        lines.append(f"{'weight':>7}{'worse by':>10}{'stderr':>8}  model")
        for row in self.models.head(_MOST_MODELS).itertuples():
            lines.append(
                f"{row.weight:>7.3f}{row.difference:>10.2f}{row.stderr:>8.2f}  {row.model}"
            )
        if count > _MOST_MODELS:
            rest = float(self.models["weight"].iloc[_MOST_MODELS:].sum())
            lines.append(f"{rest:>7.3f}{'':>18}  {count - _MOST_MODELS} more")
        return lines


def count_selections(selections: Sequence[Selection]) -> pd.DataFrame:
    """Count in how many selections each term was selected.

    The counts lead from single records to a common model. All records are then fitted with the
    terms of a share above one half and those that physics requires.

    Parameters
    ----------
    selections : sequence of Selection
        Selections of one coefficient, one per record.

    Returns
    -------
    DataFrame
        Index term, ``count`` and ``share`` (of the selections), the most frequent first.

    Raises
    ------
    IdentificationError
        Selections of different coefficients, or no selection.

    References
    ----------
    .. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin aerodynamic modeling for a fixed-wing
       aircraft, Fig. 6.
    """
    coefficients = {selection.model.coefficient for selection in selections}
    if len(coefficients) != 1:
        raise IdentificationError(
            f"selections of {', '.join(sorted(coefficients)) or 'nothing'} cannot be counted; give "
            f"those of one coefficient"
        )
    terms: list[str] = []
    for selection in selections:
        terms.extend(selection.model.terms)
    counts = pd.Series(terms).value_counts(sort=True)
    return pd.DataFrame({"count": counts, "share": counts / len(selections)}).rename_axis("term")


def fit_selected_terms(
    method: str,
    problem: CandidateEquations,
    work: OrthogonalBasis,
    rows: Sequence[dict[str, Any]],
    keep: Sequence[int],
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str,
    drop: bool,
) -> Selection:
    """Fit the selected terms as an ordinary polynomial.

    Parameters
    ----------
    method : str
    problem : CandidateEquations
    work : OrthogonalBasis
        Basis with the selected terms.
    rows : sequence of dict
        Steps of the selection.
    keep : sequence of int
        Candidates that stay regardless of their contribution.
    data, name
        As in `regress`.
    drop : bool
        Remove terms whose rms is below a thousandth of that of the coefficient.

    Raises
    ------
    IdentificationError
        No term was selected.
    """
    chosen = list(work.chosen)
    if {problem.terms[j] for j in chosen} <= {"1"}:
        raise IdentificationError(
            f"{name or problem.coefficient}: none of {len(problem.terms)} candidates explains "
            f"{problem.coefficient}; look at the excitation, or lower the threshold"
        )
    if drop:
        chosen = _drop_negligible(problem, work, keep)
    terms = problem.model_terms(chosen)
    texts = [] if problem.ties is None else problem.ties.texts(terms)
    if problem.band is None:
        model = RegressionModel(problem.coefficient, terms)
        fit = regress(model, data, name, constraints=texts)
    else:
        model = RegressionModel(problem.coefficient, ["1", *terms])
        fit = regress_frequency(
            model, data, problem.band, name=name, weights=problem.weights, constraints=texts
        )
    fit.estimates.attrs.update(selection=method, **missing_damping(problem))
    return Selection(
        method=method,
        fit=fit,
        steps=pd.DataFrame(rows),
        functions=_tabulate_functions(problem, work, fit),
        idle=problem.idle,
    )


def _drop_negligible(
    problem: CandidateEquations, basis: OrthogonalBasis, keep: Sequence[int]
) -> list[int]:
    """Return the selected candidates without negligible ones."""
    # rms of each term about its mean, over that of the coefficient
    size = np.abs(basis.estimates()) * np.std(problem.X[basis.chosen], axis=1) / np.std(problem.z)
    chosen = []
    for j, contribution in zip(basis.chosen, size):
        if contribution >= NEGLIGIBLE or j in keep or problem.terms[j] == "1":
            chosen.append(j)
    return chosen


def _tabulate_functions(
    problem: CandidateEquations, basis: OrthogonalBasis, fit: Fit
) -> xr.Dataset:
    """Return the orthogonal functions p = Q diag(R): each contains its term with the factor one."""
    names = [problem.terms[j] for j in basis.chosen]
    R = basis.triangle
    size = np.diag(R)
    s2 = basis.rss / max(1, len(problem.z) - len(names))
    # The colour of a function's residual is that of its term in the polynomial.
    e = fit.estimates
    # A constraint may give a term its number, without an error.
    white_stderr = e["stderr_white"].values
    is_free = white_stderr > 0.0
    ratios = np.where(is_free, e["stderr"].values / np.where(is_free, white_stderr, 1.0), 1.0)
    ratio_of = dict(zip(map(str, e["term"].values), ratios))
    colour = np.array([ratio_of.get(name, 1.0) for name in names])
    mean = problem.z.mean() if problem.band is None else 0.0
    total = float(((problem.z - mean) ** 2).sum())
    white = np.sqrt(s2) / size
    return xr.Dataset(
        {
            "estimate": ("function", np.array(basis.a) / size),
            "stderr": ("function", white * colour),
            "stderr_white": ("function", white),
            "share": ("function", np.array(basis.a) ** 2 / total),
            "expansion": (("function", "term"), (np.linalg.inv(R) * size).T),
        },
        coords={"function": [f"p{k}: {name}" for k, name in enumerate(names)], "term": names},
    )
