"""Section on identified propellers and their engines: estimates, coefficients, dynamics."""

from __future__ import annotations

import numpy as np

from flighttest.submodels.engine.propellers.result import PropellerFit
from pom.report.presentation.quantities import format_number
from pom.report.presentation.unit_sets import units_in_text
from pom.report.submodels.section import (
    EQUATION_ERROR,
    OUTPUT_ERROR,
    Section,
    SectionTable,
    estimate_cells,
)

# Advance ratios of the table of coefficients.
_RATIOS = 5


def propeller_section(name: str, fit: PropellerFit) -> Section:
    """Return the section of identified propellers and engines.

    Parameters
    ----------
    name : str
        Name of the submodel.
    fit : PropellerFit
        Result of the identification.
    """
    residuals = []
    for equation, noise in fit.estimate.noise.items():
        count = len(fit.estimate.residuals[equation])
        unit = "m/s2" if equation == "force" else "of the largest"
        residuals.append(f"{equation} {format_number(noise, 3)} {unit}, {count} points")
    techniques = [("thrust, power and drag", EQUATION_ERROR, "; ".join(residuals))]
    grids = [_estimates(fit), _coefficients(fit)]
    if fit.dynamics is not None:
        scatter = fit.dynamics.search.noise["stderr"].isel(manoeuvre=0)
        words = []
        for output, value in zip(scatter["output"].values, scatter.values, strict=True):
            words.append(f"{output} {format_number(float(value), 3)}")
        techniques.append(("shaft, governor and lever", OUTPUT_ERROR, "; ".join(words)))
        rows = []
        for key, (value, stderr) in fit.dynamics.values.items():
            source = "flight" if fit.dynamics.determined[key] else "as a priori"
            rows.append((key.replace("_", " "), *estimate_cells(value, stderr), source))
        head = ("constant or factor of a table", "estimate", "standard error", "source")
        grids.append(SectionTable("Shaft, governor and lever, SI", head, tuple(rows)))
    remarks = [units_in_text(remark.text) for remark in fit.remarks]
    if fit.separability is not None:
        rho = format_number(fit.separability.correlation, 3)
        error = format_number(100.0 * fit.separability.posterior_error, 2)
        remarks.insert(
            0,
            f"Correlation of thrust and drag by the flown points: {rho}; standard error of the "
            f"thrust with the a-priori values: {error} %.",
        )
    return Section(name, tuple(techniques), grids=tuple(grids), remarks=tuple(remarks))


def _estimates(fit: PropellerFit) -> SectionTable:
    """Return the unknowns with their a-priori standard errors."""
    errors = np.sqrt(np.diag(fit.estimate.covariance))
    rows = []
    for (name, unknown), stderr in zip(fit.equations.unknowns.items(), errors, strict=True):
        prior = format_number(unknown.stderr, 3)
        cells = estimate_cells(fit.value[name], float(stderr))
        rows.append((name.replace("_", " "), *cells, prior))
    head = ("unknown", "estimate", "standard error", "a-priori standard error")
    return SectionTable("Corrections of the a-priori tables, polar, instruments", head, tuple(rows))


def _coefficients(fit: PropellerFit) -> SectionTable:
    """Return the coefficients over the flown advance ratios."""
    flown = fit.equations.shapes["CT_prop"]
    J = np.linspace(flown.low, flown.high, _RATIOS)
    angle = fit.typical_blade_angle()
    thrust, power = (fit.coefficient(name, J, angle) for name in ("CT_prop", "CP_prop"))
    rows = []
    for k, x in enumerate(J):
        rows.append(
            (
                format_number(float(x), 3),
                *estimate_cells(float(thrust[0][k]), float(thrust[1][k])),
                *estimate_cells(float(power[0][k]), float(power[1][k])),
            )
        )
    head = ("J", "CT prop", "standard error", "CP prop", "standard error")
    return SectionTable("Coefficients over the flown advance ratios", head, tuple(rows))
