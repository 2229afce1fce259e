"""Result of the identification of a ground effect: table 2 of [LR743], K(h), compared forms.

References
----------
.. [LR743] Report LR-743, 1993, section 4.5.1, eq. (11), (13), (14), table 2.
.. [Kass1995] Kass, Raftery, Bayes factors, J. American Statistical Association 90, 1995.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.short_text import ShortText
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.ground_effect.evidence import NEAR, Misfit, select_form
from flighttest.submodels.ground_effect.law_search import ClosedForm
from flighttest.submodels.ground_effect.laws import HEIGHT, LAWS, POWER, separable_spelling
from flighttest.submodels.ground_effect.tables import ONE_FACTOR, SEPARATE, HeightTable

ORDER = (
    "none",
    "database",
    *(law.common_form() for law in LAWS),
    *(law.name for law in LAWS),
    ONE_FACTOR,
    SEPARATE,
)
# Difference of Schwarz's criterion from which on a law is refused, strong evidence in [Kass1995].
_REFUSED = 6.0
# Default heights of a report, over the lowest height of the records.
_HEIGHTS = (1.0, 2.0, 5.0)


class GroundTerm(NamedTuple):
    """One row of table 2: y = k y_inf h^s with h in metres.

    The rolling moment has y = k h^s; its y_inf is NaN. Of the other laws `s` is h0 [m].
    """

    term: str
    y_inf: float
    k: float
    k_stderr: float
    s: float
    s_stderr: float
    correlation: float
    law: str = POWER.name


@dataclass(frozen=True)
class CoefficientOverGround:
    """One coefficient over the ground.

    Attributes
    ----------
    model : Model
        Terms in free air.
    ground : tuple of str
        Terms whose ground effect is identified by the best closed form.
    not_identified : dict of str to str
        Terms whose ground effect is not identified, and the reason.
    closed : dict of str to ClosedForm
        Fits by the laws over the height with a shape parameter for each term, and with one for all
        terms as in [LR743] eq. (11). A law by which no term is identified is missing.
    best : str
        The closed form that is taken, or the one with the least criterion; empty without one.
    references : dict of str to float
        Free-air coefficients if these were fixed; empty if the fit contains them.
    tables : dict of str to HeightTable
        Tables over the height by form. A table of which no node is determined is missing.
    form : str
        The form with the best evidence: one of ``none``, ``database``, `closed`, `tables`.
    heights : (float, float)
        Lowest height of the records, and the height up to which the ground was searched. [m]
    evidence : DataFrame
        Index form; ``parameters``, ``rms``, ``BIC``.
    misfit : Misfit or None
        What the form leaves beyond the noise; None where the samples do not show it.
    flown : dict of str to (float, float)
        Smallest and largest value of the variables among the samples within `heights`. [SI]
    """

    model: RegressionModel
    ground: tuple[str, ...]
    not_identified: Mapping[str, str]
    closed: Mapping[str, ClosedForm]
    best: str
    references: Mapping[str, float]
    tables: Mapping[str, HeightTable]
    form: str
    heights: tuple[float, float]
    evidence: pd.DataFrame
    misfit: Misfit | None = None
    flown: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def table(self) -> HeightTable | None:
        """Table over the height if it is taken, else None."""
        return self.tables.get(self.form)

    @property
    def taken_terms(self) -> tuple[str, ...]:
        """Terms of the form that is taken; those of a database are not among them."""
        if self.table is not None:
            return self.table.terms
        return self.closed[self.form].terms if self.form in self.closed else ()

    @property
    def refuses_database(self) -> bool:
        """Whether the criterion of the database is worse than that of no ground effect."""
        criteria = self.evidence["BIC"]
        return "database" in criteria and criteria["database"] > criteria["none"] + NEAR

    @property
    def warnings(self) -> list[str]:
        """What is wrong with the form that is taken."""
        if self.misfit is None or not self.misfit.is_significant:
            return []
        return [f"{self.model.coefficient}: {self.misfit.describe()}"]

    def rows(self, form: str = "") -> list[GroundTerm]:
        """Return table 2: one row per term of a closed form, by default the best one."""
        name = form or self.best
        return [self.row(term, name) for term in self.closed[name].terms] if name else []

    def row(self, term: str, form: str = "") -> GroundTerm:
        """Return k and s of a term by a closed form, by default the best one.

        Raises
        ------
        UnknownName
            A term that is not identified, or a form that is not in `closed`.
        """
        one = self._closed_form(term, form)
        _, y_inf = self._ratio_expression(one, term)
        values, C = self._estimate(one, term)
        k_stderr, s_stderr = map(float, np.sqrt(np.diag(C)))
        return GroundTerm(
            term=term,
            y_inf=y_inf,
            k=float(values[0]),
            k_stderr=k_stderr,
            s=float(values[1]),
            s_stderr=s_stderr,
            correlation=float(C[0, 1] / (k_stderr * s_stderr)),
            law=one.law.name,
        )

    def factor(self, term: str, h, form: str = "") -> xr.Dataset:
        """Return K(h) of a term by a closed form with its standard error.

        Parameters
        ----------
        term : str
            An identified term.
        h : array (h_agl,)
            Heights. Below the lowest height of the records the factor is constant. [m]
        form : str
            One of `closed`; by default the best one.

        Returns
        -------
        Dataset (h_agl,)
            ``K``, ``stderr``.
        """
        one = self._closed_form(term, form)
        h = np.asarray(h, float)
        heights = np.maximum(h, self.heights[0]).tolist()
        values, C = self._estimate(one, term, heights)
        law_error = self._law_error(one, term, values, heights)
        stderr = np.hypot(np.sqrt(np.diag(C)), law_error)
        if one.common and one.law.name in self.closed:
            # An assumption does not make a factor more certain.
            apart = self.factor(term, h, one.law.name)
            stderr = np.maximum(stderr, apart["stderr"].values)
        return _make_factors(h, values, stderr)

    def taken_factor(self, term: str, h) -> xr.Dataset:
        """Return K(h) of a term by the form that is taken, as `factor`."""
        if self.table is None:
            return self.factor(term, h, self.form)
        h = np.asarray(h, float)
        heights, K, stderr = self.tabled(term)
        return _make_factors(h, np.interp(h, heights, K), np.interp(h, heights, stderr))

    def tabled(self, term: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return heights [m], K and its standard error of a term in the table over the height.

        Raises
        ------
        UnknownName
            A term that is not identified, or a form that is not a table.
        """
        terms = self.table.terms if self.table else ()
        if self.table is None or term not in terms:
            raise UnknownName(
                term,
                terms,
                "ground term",
                f"{self.model.coefficient}: it has no table over the height",
            )
        row = terms.index(term)
        # The factor is a ratio to the free-air coefficient; a term without one is its own factor.
        free_air = self.references or dict(zip(self.model.terms, self.table.free.tolist()))
        scale = free_air.get(term, 1.0)
        return (
            self.table.heights,
            self.table.value[row] / scale,
            self.table.stderr[row] / abs(scale),
        )

    def _closed_form(self, term: str, form: str) -> ClosedForm:
        """Return the closed form that contains a term."""
        name = form or self.best
        if name and name not in self.closed:
            raise UnknownName(name, self.closed, "closed form", self.model.coefficient)
        known = self.closed[name].terms if name else ()
        if term not in known:
            raise UnknownName(
                term, known, "ground term", f"{self.model.coefficient}: it is not identified"
            )
        return self.closed[name]

    def _estimate(
        self, one: ClosedForm, term: str, heights: Sequence[float] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return K at heights, or k and the shape parameter, of a term with their covariance."""
        ratio, _ = self._ratio_expression(one, term)
        shape = one.shape_name(term)
        expressions = [one.law.at(ratio, shape, height) for height in heights] or [ratio, shape]
        values, C = one.fit.derived(*expressions)
        if one.common and one.law.name in self.closed:
            # One shape parameter is an assumption, whose error the fit does not contain: terms that
            # differ by a sixth keep it, and are then 4.7 standard errors wrong.
            apart, _ = self._estimate(self.closed[one.law.name], term, heights)
            C = C + np.outer(values - apart, values - apart)
        return values, C

    def _law_error(self, one: ClosedForm, term: str, K: np.ndarray, heights: list) -> np.ndarray:
        """Return the standard error of K(h) by the choice of the law.

        It is the largest difference from a law that the samples do not refuse.
        """
        differences = [np.zeros(len(K))]
        for law in LAWS:
            names = [name for name in (law.name, law.common_form()) if name in self.closed]
            if law is one.law or not names or term not in self.closed[names[0]].terms:
                continue
            other = min(names, key=lambda name: self.evidence["BIC"][name])
            if self.evidence["BIC"][other] - self.evidence["BIC"][one.name] < _REFUSED:
                differences.append(self._estimate(self.closed[other], term, heights)[0] - K)
        return np.abs(differences).max(axis=0)

    def _ratio_expression(self, one: ClosedForm, term: str) -> tuple[str, float]:
        """Return k as an expression of the estimates, and the free-air coefficient."""
        product = f"[{one.regressor(term)}]"
        if term in self.references:
            return f"{product}/({self.references[term]!r})", self.references[term]
        if term in self.model.terms:
            spelling = separable_spelling(term)
            return f"{product}/[{spelling}]", one.fit.value(spelling)[0]
        return product, float("nan")


def _make_factors(h: np.ndarray, K: np.ndarray, stderr: np.ndarray) -> xr.Dataset:
    """Return factors over the height with their standard errors."""
    factors = xr.Dataset({"K": (HEIGHT, K), "stderr": (HEIGHT, stderr)}, {HEIGHT: h})
    factors[HEIGHT].attrs = {"units": "m"}
    return factors


@dataclass(frozen=True)
class GroundEffect(ShortText):
    """Ground effect of several coefficients.

    Attributes
    ----------
    coefficients : dict of str to CoefficientOverGround
        Results by coefficient.
    held : bool
        Whether the free-air terms were fixed at the database.
    """

    coefficients: Mapping[str, CoefficientOverGround]
    held: bool

    def __getitem__(self, coefficient: str) -> CoefficientOverGround:
        if coefficient not in self.coefficients:
            raise UnknownName(coefficient, self.coefficients, "coefficient")
        return self.coefficients[coefficient]

    @property
    def not_identified(self) -> dict[str, str]:
        """Ground terms without information, as ``CL:qhat``, and the reason."""
        reasons = {}
        for name, result in self.coefficients.items():
            for term, reason in result.not_identified.items():
                reasons[f"{name}:{term}"] = reason
        return reasons

    def as_dict(self) -> dict[str, Any]:
        """Return form, terms and evidence of each coefficient for JSON."""
        coefficients: dict[str, Any] = {}
        for name, result in self.coefficients.items():
            coefficients[name] = {
                "form": result.form,
                "heights": result.heights,
                "terms": [row._asdict() for row in result.rows()],
                "evidence": result.evidence.to_dict("index"),
                "misfit": vars(result.misfit) if result.misfit else None,
                "warnings": result.warnings,
            }
        return {
            "held": self.held,
            "not_identified": self.not_identified,
            "coefficients": coefficients,
        }

    @property
    def warnings(self) -> list[str]:
        """Forms that leave more than the noise, by coefficient."""
        warnings = []
        for result in self.coefficients.values():
            warnings += result.warnings
        return warnings

    def report(self, heights: Sequence[float] = ()) -> str:
        """Return table 2 of [LR743], K(h), terms without information, and compared forms as text.

        Parameters
        ----------
        heights : sequence of float, optional
            Heights at which K(h) is printed. Default: the lowest height of the records, and twice
            and five times this height. [m]
        """
        free_air = "held at the database" if self.held else "estimated along"
        lines = [
            "Ground effect y = y_inf K(h); y = K(h) where there is no y_inf; K by the law of the "
            "row, h in metres",
            f"free-air terms {free_air}",
            f"{'':<14}{'law':<15}{'y_inf':>10}{'k':>10}{'stderr':>9}{'s, h0':>9}{'stderr':>9}"
            f"{'corr.':>8}   K(h)",
        ]
        for name, result in self.coefficients.items():
            lines += _term_lines(name, result, heights)
        for name, result in self.coefficients.items():
            lines += ["", *_evidence_lines(name, result)]
        return "\n".join(lines)


def form_by_evidence(evidence: pd.DataFrame) -> str:
    """Return the form with the best evidence.

    Of nearly equal forms it is the simplest, and a closed form precedes the table.
    """
    return select_form(evidence, ORDER)


def _term_lines(name: str, result: CoefficientOverGround, heights: Sequence[float]) -> list[str]:
    """Return the rows of table 2 of one coefficient with K(h) as lines of text."""
    lines = []
    at_heights = list(heights) or [result.heights[0] * multiple for multiple in _HEIGHTS]
    if result.table is not None:
        for term in result.taken_terms:
            K = _factor_cells(result.taken_factor(term, at_heights))
            form = f"{result.form}, 0 from {result.table.end(term):.3g} m on"
            lines.append(f"{name + ':' + term:<14}{form:<70}{K}")
    for row in result.rows() if result.table is None else ():
        K = _factor_cells(result.factor(row.term, at_heights))
        y_inf = "-" if np.isnan(row.y_inf) else f"{row.y_inf:.4g}"
        numbers = (
            f"{row.k:>10.4g}{row.k_stderr:>9.2g}{row.s:>9.3f}{row.s_stderr:>9.2g}"
            f"{row.correlation:>8.2f}"
        )
        lines.append(f"{name + ':' + row.term:<14}{row.law:<15}{y_inf:>10}{numbers}   {K}")
    for term, reason in result.not_identified.items():
        if term not in result.taken_terms:
            lines.append(f"{name + ':' + term:<14}k and s not identified: {reason}")
    for warning in result.warnings:
        lines.append(f"! {warning}")
    return lines


def _factor_cells(factors: xr.Dataset) -> str:
    """Return K with its standard error at each height as text."""
    cells = []
    for h, k, stderr in zip(*(factors[key].values for key in (HEIGHT, "K", "stderr"))):
        cells.append(f"{h:.3g} m {k:.3f} ({stderr:.2g})")
    return "  ".join(cells)


def _evidence_lines(name: str, result: CoefficientOverGround) -> list[str]:
    """Return the comparison of the forms of one coefficient as lines of text."""
    lines = [f"{name}: {'form':<24}{'parameters':>12}{'rms':>11}{'BIC':>10}"]
    indent = " " * (len(name) + 2)
    for form, row in result.evidence.iterrows():
        numbers = f"{int(row['parameters']):>12}{row['rms']:>11.4g}{row['BIC']:>10.1f}"
        lines.append(f"{indent}{form!s:<24}{numbers}")
    terms = ""
    if result.table is not None:
        terms = f" of {', '.join(result.table.terms)}"
    taken = f"taken: {result.form}{terms}, the simplest within 2 of the least criterion"
    return [*lines, f"{indent}{taken}"]
