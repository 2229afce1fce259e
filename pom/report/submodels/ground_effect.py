"""Section on an identified ground effect: factors, forms that were compared, curves."""

from __future__ import annotations

import numpy as np

from flighttest.submodels.ground_effect.result import GroundEffect
from pom.report.presentation.quantities import MISSING, format_number
from pom.report.submodels.section import (
    EQUATION_ERROR,
    PanelOf,
    Picture,
    Section,
    SectionLine,
    SectionTable,
    estimate_cells,
    make_picture,
)

HEIGHTS = (1.0, 2.0, 5.0)  # columns of the table, in multiples of the lowest height flown
POINTS = 60  # of a curve over the height
SHOWN = 10.0  # end of a curve, in lowest heights flown; above it K is small


def ground_effect_section(name: str, effect: GroundEffect) -> Section:
    """Return the section of an identified ground effect.

    Parameters
    ----------
    name : str
        Name of the submodel.
    effect : GroundEffect
        Result of the identification.
    """
    techniques = []
    for coefficient, fit in effect.coefficients.items():
        rms = f"rms {format_number(fit.evidence['rms'][fit.form], 3)}"
        techniques.append((f"{coefficient}, {fit.form}", EQUATION_ERROR, rms))
    remarks = effect.warnings
    for term, why in effect.not_identified.items():
        remarks.append(f"{term}: k and s not identified: {why}")
    return Section(
        name,
        tuple(techniques),
        grids=(_factor_table(effect), _form_table(effect)),
        pictures=_draw_factors(name, effect),
        remarks=tuple(remarks),
    )


def _factor_table(effect: GroundEffect) -> SectionTable:
    """Return the factors of every term, as LR-743 table 2."""
    rows = []
    for coefficient, fit in effect.coefficients.items():
        heights = [fit.heights[0] * multiple for multiple in HEIGHTS]
        for row in fit.rows():
            factor = fit.factor(row.term, heights)
            cells = []
            for height, value, stderr in zip(
                heights, factor["K"].values, factor["stderr"].values, strict=True
            ):
                cells.append(
                    f"{format_number(value, 3)} ± {format_number(stderr, 1)} "
                    f"at {format_number(height, 2)} m"
                )
            # A term that is zero in free air has no y_inf.
            y_inf = MISSING if np.isnan(row.y_inf) else format_number(row.y_inf, 4)
            rows.append(
                (
                    f"{coefficient}: {row.term}",
                    row.law,
                    y_inf,
                    *estimate_cells(row.k, row.k_stderr),
                    *estimate_cells(row.s, row.s_stderr),
                    format_number(row.correlation, 2),
                    *cells,
                )
            )
    free_air = "held at the database" if effect.held else "estimated along"
    caption = (
        f"y = y_inf K(h), and y = K(h) where there is no y_inf (LR-743 table 2); K by the law of "
        f"the row, h in metres; free-air terms {free_air}"
    )
    head = (
        "term",
        "law",
        "y_inf",
        "k",
        "standard error",
        "s, h0",
        "standard error",
        "correlation",
        *("K(h)",) * len(HEIGHTS),
    )
    return SectionTable(caption, head, tuple(rows))


def _form_table(effect: GroundEffect) -> SectionTable:
    """Return the forms that were compared, with their figures of merit."""
    rows = []
    for coefficient, fit in effect.coefficients.items():
        for form, row in fit.evidence.iterrows():
            chosen = ", taken" if form == fit.form else ""
            rows.append(
                (
                    f"{coefficient}: {form}{chosen}",
                    str(int(row["parameters"])),
                    format_number(row["rms"], 4),
                    format_number(row["BIC"], 3),
                )
            )
    caption = (
        "Forms compared on the same samples: the simplest within 2 of the least criterion is taken"
    )
    return SectionTable(caption, ("form", "parameters", "rms", "BIC"), tuple(rows))


def _draw_factors(name: str, effect: GroundEffect) -> tuple[Picture, ...]:
    """Draw the factor K of every term over the height, with one standard error."""
    panels, terms = [], []
    for coefficient, fit in effect.coefficients.items():
        # Heights are spaced by equal ratios, since K falls fast near the ground.
        heights = np.geomspace(fit.heights[0], SHOWN * fit.heights[0], POINTS)
        for term in fit.ground:
            factor = fit.factor(term, heights)
            curves = [SectionLine(heights, factor["K"].values, "run-3", factor["stderr"].values)]
            if fit.table is not None and term in fit.table.terms:
                nodes, values, stderr = fit.tabled(term)
                curves.append(SectionLine(nodes, values, "run-2", stderr))
            terms.append(f"{coefficient}: {term}")
            panels.append(
                PanelOf(
                    f"K of {terms[-1]}", "height of the moment reference point, m", tuple(curves)
                )
            )
    if not panels:
        return ()
    description = f"Factor K over the height of {', '.join(terms)}, with one standard error"
    key = (("run-3", "best law"), ("run-2", "table"))
    return (make_picture(name.replace(" ", "-"), panels, key=key, words=description),)
