"""Result of the identification of a ground effect: table 2 of [LR743], K(h), compared forms.

References
----------
.. [LR743] Report LR-743, 1993, section 4.5.1, eq. (11), (13), (14), table 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.separable.fit import SeparableFit
from flighttest.submodels.ground_effect.structure import (
    HEIGHT,
    HeightTable,
    exponent_name,
    select_form,
    separable_spelling,
    times_height_power,
)

ORDER = ("none", "database", "k h^s, one s", "k h^s", "table")
# Default heights of a report, over the lowest height of the records.
_HEIGHTS = (1.0, 2.0, 5.0)


class GroundTerm(NamedTuple):
    """One row of table 2: y = k y_inf h^s with h in metres.

    The rolling moment has y = k h^s; its y_inf is NaN.
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
        Terms in free air.
    ground : tuple of str
        Terms whose ground effect is identified.
    not_identified : dict of str to str
        Terms whose ground effect is not identified, and the reason.
    fit : SeparableFit or None
        k h^s with an exponent for each term; None if no term is identified.
    common : SeparableFit or None
        k h^s with one exponent for all terms, [LR743] eq. (11).
    references : dict of str to float
        Free-air coefficients if these were fixed; empty if the fit contains them.
    table : HeightTable or None
        Tables over the height: of identified terms, and of others that lower the criterion.
    form : str
        The form with the best evidence: one of ``none``, ``database``, ``k h^s, one s``, ``k h^s``,
        ``table``.
    heights : (float, float)
        Lowest height of the records, and the height up to which the ground was searched. [m]
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
        fit, name = self._fit_of(term, common)
        ratio, y_inf = self._ratio_expression(fit, term, common)
        values, C = fit.derived(ratio, name)
        k_stderr, s_stderr = map(float, np.sqrt(np.diag(C)))
        return GroundTerm(
            term=term,
            y_inf=y_inf,
            k=float(values[0]),
            k_stderr=k_stderr,
            s=float(values[1]),
            s_stderr=s_stderr,
            correlation=float(C[0, 1] / (k_stderr * s_stderr)),
        )

    def factor(self, term: str, h, common: bool = False) -> xr.Dataset:
        """Return K(h) = k h^s of a term with its standard error.

        Parameters
        ----------
        term : str
            An identified term.
        h : array (h_agl,)
            Heights. Below the lowest height of the records the factor is constant. [m]
        common : bool
            Whether all terms have one exponent.

        Returns
        -------
        Dataset (h_agl,)
            ``K``, ``stderr``.
        """
        fit, name = self._fit_of(term, common)
        ratio, _ = self._ratio_expression(fit, term, common)
        h = np.asarray(h, float)
        expressions = [
            f"({ratio})*{max(height, self.heights[0])!r}^{name}" for height in h.tolist()
        ]
        values, C = fit.derived(*expressions)
        factors = xr.Dataset(
            {"K": (HEIGHT, values), "stderr": (HEIGHT, np.sqrt(np.diag(C)))}, {HEIGHT: h}
        )
        factors[HEIGHT].attrs = {"units": "m"}
        return factors

    def tabled(self, term: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return heights [m], K and its standard error of a term in the table over the height.

        Raises
        ------
        UnknownName
            A term that is not identified, or no table that the heights of the records determine.
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

    def _fit_of(self, term: str, common: bool) -> tuple[SeparableFit, str]:
        """Return the fit that contains a term, and the name of the exponent."""
        fit = self.common if common else self.fit
        if term not in self.ground or fit is None:
            raise UnknownName(
                term, self.ground, "ground term", f"{self.model.coefficient}: it is not identified"
            )
        return fit, "s" if common else exponent_name(term)

    def _ratio_expression(self, fit: SeparableFit, term: str, common: bool) -> tuple[str, float]:
        """Return k as an expression of the estimates, and the free-air coefficient."""
        product = f"[{times_height_power(term, 's' if common else None)}]"
        if term in self.references:
            return f"{product}/({self.references[term]!r})", self.references[term]
        if term in self.model.terms:
            spelling = separable_spelling(term)
            return f"{product}/[{spelling}]", fit.value(spelling)[0]
        return product, float("nan")


@dataclass(frozen=True)
class GroundEffect:
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
            }
        return {
            "held": self.held,
            "not_identified": self.not_identified,
            "coefficients": coefficients,
        }

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
            "Ground effect, y = k y_inf h^s; y = k h^s where there is no y_inf; h in metres",
            f"free-air terms {free_air}",
            f"{'':<14}{'y_inf':>10}{'k':>10}{'stderr':>9}{'s':>9}{'stderr':>9}{'corr.':>8}   K(h)",
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
    for row in result.rows():
        K = result.factor(row.term, at_heights)
        cells = []
        for h, k, stderr in zip(at_heights, K["K"].values, K["stderr"].values):
            cells.append(f"{h:.3g} m {k:.3f} ({stderr:.2g})")
        y_inf = "-" if np.isnan(row.y_inf) else f"{row.y_inf:.4g}"
        numbers = (
            f"{row.k:>10.4g}{row.k_stderr:>9.2g}{row.s:>9.3f}{row.s_stderr:>9.2g}"
            f"{row.correlation:>8.2f}"
        )
        lines.append(f"{name + ':' + row.term:<14}{y_inf:>10}{numbers}   {'  '.join(cells)}")
    for term, reason in result.not_identified.items():
        lines.append(f"{name + ':' + term:<14}k and s not identified: {reason}")
    return lines


def _evidence_lines(name: str, result: CoefficientOverGround) -> list[str]:
    """Return the comparison of the forms of one coefficient as lines of text."""
    lines = [f"{name}: {'form':<16}{'parameters':>12}{'rms':>11}{'BIC':>10}"]
    indent = " " * (len(name) + 2)
    for form, row in result.evidence.iterrows():
        numbers = f"{int(row['parameters']):>12}{row['rms']:>11.4g}{row['BIC']:>10.1f}"
        lines.append(f"{indent}{form!s:<16}{numbers}")
    terms = ""
    if result.table is not None and result.form == "table":
        terms = f" of {', '.join(result.table.terms)}"
    taken = f"taken: {result.form}{terms}, the simplest within 2 of the least criterion"
    return [*lines, f"{indent}{taken}"]
