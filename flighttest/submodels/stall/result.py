"""Result of the identification of a stall: separation, terms, what is not identified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.separation import TARGETS, FlowSeparation
from flightmech.names import value_text
from flightmech.short_text import ShortText
from flightmech.terms import make_term
from flighttest.regression.expression_functions import Pieces
from flighttest.regression.separable.fit import SeparableFit
from flighttest.submodels.stall.flow import PER_NODE, SHARED, SeparationFlow, with_half_flow
from flighttest.submodels.stall.left_out import remark_shares
from flighttest.submodels.stall.model import SeparatedTerm, term_label

LEAST = {"X": 0.0, "X_lift": 0.25}
"""Value of a variable of the separation in fully separated flow."""
SEPARATION_POINT = "X is the separation point of a wing half in chords: 1 attached, 0 separated"
# Change of the attached flow of a database that is reported, in standard errors.
_SIGNIFICANT = 3.0
# On a path that was reconstructed from sensors with noise, two of five parameters were off by
# more than three standard errors, as was the asymmetry of two wings of a strip theory
# (docs/evidence/submodels.md).
_NOT_CONTAINED = (
    "standard errors do not contain the errors of alpha, of its rate and of p in the record, nor "
    "a separation of another form; not checked: those of tau2 and asymmetry can be several times "
    "larger on reconstructed paths and on other wings"
)


@dataclass(frozen=True)
class StallIdentification(ShortText):
    """A stall model from flight.

    Attributes
    ----------
    fit : SeparableFit
        Estimates of all coefficients and of the separation, with standard errors for coloured
        residuals.
    station, cbar : float
        Station of the wing halves and reference chord. [m]
    flow : SeparationFlow
        Axis and nodes of the configuration, and parameters that were fixed.
    attached : dict of str to tuple of str
        Terms of the attached flow by coefficient; all are estimated.
    separated : dict of str to tuple of SeparatedTerm
        Terms of the separated flow that are identified.
    not_identified : dict of str to str
        Parameters and terms that are not identified, and the reason.
    records : tuple of Dataset (time,)
        Records with the coefficients that were fitted: with a database, those on top of it.
    with_database : bool
        Whether the coefficients are those on top of a database.
    left_out : dict of str to float
        R2 of each coefficient on records that its terms were not fitted to (`left_out_shares`).
    """

    fit: SeparableFit
    station: float
    cbar: float
    flow: SeparationFlow
    attached: Mapping[str, tuple[str, ...]]
    separated: Mapping[str, tuple[SeparatedTerm, ...]]
    not_identified: Mapping[str, str]
    records: tuple[xr.Dataset, ...]
    with_database: bool
    left_out: Mapping[str, float]

    def value(self, parameter: str) -> tuple[float, float]:
        """Return a parameter of the separation and its standard error; zero of a fixed one."""
        if parameter in self.flow.fixed:
            return float(self.flow.fixed[parameter]), 0.0
        return self.fit.value(parameter)

    def term_value(self, coefficient: str, text: str) -> tuple[float, float]:
        """Return the coefficient of a term of the fit and its standard error."""
        return self.fit.value(term_label(coefficient, text, len(self.fit.models)))

    def tables(self) -> dict[str, xr.Dataset]:
        """Return the tables of the separation as term leaves with source ``flight``."""
        tables = {}
        for name in (*PER_NODE, *SHARED):
            pairs = np.array([self.value(label) for label in self.flow.names(name)])
            tabled = name in PER_NODE and len(self.flow.nodes) > 1
            axes = {self.flow.axis: list(self.flow.nodes)} if tabled else {}
            pairs[:, 1] = self._errors_of(self.flow.names(name), pairs[:, 1])
            values, errors = pairs.T if tabled else pairs[0]
            source = "judgement" if name in self.flow.fixed else "flight"
            comment = self.not_identified.get(name, "")
            tables[name] = make_term(values, axes, stderr=errors, source=source)
            if comment:
                tables[name].attrs["comment"] = f"not identified: {comment}"
        return tables

    def _errors_of(self, labels: Sequence[str], fitted: np.ndarray) -> np.ndarray:
        """Return standard errors; at a bound, which has none, that of the range of the search."""
        before = {}
        for model in self.fit.models:
            before.update({name: item.spread for name, item in model.parameters.items()})
        pairs = zip(labels, fitted, strict=True)
        return np.array([before[k] if np.isnan(error) else error for k, error in pairs])

    def separation(self, buffet: Mapping[str, xr.Dataset] | None = None) -> FlowSeparation:
        """Return the separation for an aircraft; `buffet` are its tables, which are not fitted."""
        order = {name: {**self.tables(), **(buffet or {})}.get(name) for name in TARGETS}
        return FlowSeparation(self.station, {k: v for k, v in order.items() if v is not None})

    def leaves(self) -> dict[str, xr.Dataset]:
        """Return the terms of the separated flow by name, ``CL/stall_alpha``."""
        leaves = {}
        for coefficient, terms in self.separated.items():
            for term in terms:
                value, stderr = self.term_value(coefficient, term.text)
                name = f"{coefficient}/{term.contribution}"
                leaves[name] = _term_leaf(term, value, stderr)
        return leaves

    def predict(self, record: xr.Dataset) -> xr.Dataset:
        """Return the separation and the fitted coefficients along a record.

        Parameters
        ----------
        record : Dataset (time,)
            As in `identify_stall`. With a database the coefficients are those on top of it.

        Returns
        -------
        Dataset (time,)
            The coefficients, ``X_left`` and ``X_right``.
        """
        record = with_half_flow(record, self.station, self.cbar)
        names = set(self.flow.parameters) - set(self.flow.fixed)
        values = {name: self.fit.value(name)[0] for name in names}
        time = record["time"].values
        pieces = Pieces([slice(0, len(time))], [float(np.median(np.diff(time)))])
        quantities = {str(name): item.values for name, item in record.data_vars.items()}
        flow = self.flow.evaluate(quantities, values, pieces)
        found = {name: ("time", flow[name].value) for name in ("X_left", "X_right")}
        for model in self.fit.models:
            own = {name: quantities[name] for name in model.variables}
            X, _ = model.columns(own, len(time), values, pieces)
            theta = [self.term_value(model.target, term)[0] for term in model.terms]
            found[model.target] = ("time", X @ np.array(theta))
        return xr.Dataset(found, {"time": time})

    @property
    def remarks(self) -> list[str]:
        """What restricts the use of the model."""
        remarks = [f"{name}: not identified: {why}" for name, why in self.not_identified.items()]
        remarks += [remark.text for remark in self.fit.convergence_remarks]
        remarks.append(_NOT_CONTAINED)
        remarks += remark_shares(self.left_out)
        targets = {model.target for model in self.fit.models}
        if "asymmetry" not in self.flow.fixed and "Cl" not in targets:
            remarks.append(
                "asymmetry: estimated without Cl: the lift of both halves together hardly shows it"
            )
        if self.with_database:
            for coefficient, term in self._attached_terms():
                value, stderr = self.term_value(coefficient, term)
                if abs(value) > _SIGNIFICANT * stderr:
                    remarks.append(
                        f"{coefficient}: {term}: the attached flow of the database is off by "
                        f"{value:.3g} ({stderr:.2g}); it is not changed, update it first"
                    )
        return remarks

    def _attached_terms(self) -> list[tuple[str, str]]:
        """Return coefficient and text of the estimated terms of the attached flow."""
        labels = []
        for model in self.fit.models:
            for term, shapes in model.shapes.items():
                if not shapes:
                    labels.append((model.target, term))
        return labels

    def as_dict(self) -> dict[str, Any]:
        """Return parameters, terms and remarks for JSON."""
        parameters = {}
        for name in self.flow.parameters:
            value, stderr = self.value(name)
            parameters[name] = {"value": value, "stderr": stderr}
        terms: dict[str, Any] = {}
        for coefficient, separated in self.separated.items():
            for term in separated:
                value, stderr = self.term_value(coefficient, term.text)
                terms[f"{coefficient}: {term.text}"] = {"value": value, "stderr": stderr}
        R2 = np.atleast_1d(self.fit.estimates.attrs["R2"]).tolist()
        return {
            "station": self.station,
            "axis": self.flow.axis,
            "nodes": list(self.flow.nodes),
            "parameters": parameters,
            "terms": terms,
            "R2": dict(zip((model.target for model in self.fit.models), R2, strict=True)),
            "R2_left_out": {k: None if np.isnan(v) else v for k, v in self.left_out.items()},
            "not_identified": dict(self.not_identified),
            "remarks": self.remarks,
        }

    def report(self) -> str:
        """Return the separation, the terms and the remarks as text."""
        lines = [
            "Flow separation: tau1 (cbar/V) dX/dt + X = (1 - tanh(a1 (alpha - tau2 (cbar/V) "
            "dalpha/dt - alpha_star)))/2",
            f"at {self.station:.3g} m from the plane of symmetry on both sides",
            SEPARATION_POINT,
        ]
        if len(self.flow.nodes) > 1:
            places = [value_text(self.flow.axis, node) for node in self.flow.nodes]
            lines.append(f"_0, _1 ... at {self.flow.axis} {', '.join(places)}")
        for name in self.flow.parameters:
            value, stderr = self.value(name)
            if name in self.flow.fixed:
                lines.append(f"{name:<14}{value:>12.5g}   fixed")
                continue
            text = f"{name:<14}{value:>12.5g}{stderr:>10.2g}"
            if name.startswith(("alpha_star", "asymmetry")):
                text += f"   {np.rad2deg(value):.2f} deg ({np.rad2deg(stderr):.2g})"
            lines.append(text)
        lines += ["", *self.fit.report().splitlines()]
        known = [f"{k} {v:.3f}" for k, v in self.left_out.items() if not np.isnan(v)]
        if known:
            lines.append(f"R2 on records that the terms were not fitted to: {', '.join(known)}")
        named = [f"! {text}" for text in self.remarks]
        return "\n".join([*lines, "", *named] if named else lines)


def _term_leaf(term: SeparatedTerm, value: float, stderr: float) -> xr.Dataset:
    """Return the leaf of a separated term: a table that ends at zero in attached flow."""
    assert not set(term.regressors) & {"X", "X_left", "X_right", "X_lift"}, "regressors vanish"
    if not term.loss:
        return make_term(value, regressors=term.regressors, stderr=stderr, source="flight")
    least = LEAST[term.loss]
    return make_term(
        [(1.0 - least) * value, 0.0],
        {term.loss: [least, 1.0]},
        term.regressors,
        stderr=[(1.0 - least) * stderr, 0.0],
        source="flight",
    )
