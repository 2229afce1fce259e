"""Ground effect: table 2 of [LR743], K(h) over the height, the forms compared."""

from __future__ import annotations

import numpy as np

from flighttest.ground_effect import GroundEffect

from ..presentation.quantities import MISSING, number
from .section import EQUATION_ERROR, Curve, Grid, PanelOf, Section, estimate, picture

HEIGHTS = (1.0, 2.0, 5.0)  # in multiples of the lowest height flown
POINTS = 60  # of a curve over the height
SHOWN = 10.0  # of a curve: up to so many times the lowest height flown, beyond which K is small


def ground_effect(name: str, found: GroundEffect) -> Section:
    """Return the section of an identified ground effect."""
    held = "held at the database" if found.held else "estimated along"
    measures = tuple(
        (f"{coefficient}, {one.form}", EQUATION_ERROR, f"rms {number(one.evidence['rms'][one.form], 3)}")
        for coefficient, one in found.coefficients.items()
    )
    remarks = tuple(f"{term}: k and s not identified: {why}" for term, why in found.not_identified.items())
    return Section(name, measures, (_table_2(found, held), *_evidence(found)), _factors(name, found), remarks)


def _table_2(found: GroundEffect, held: str) -> Grid:
    rows = []
    for coefficient, one in found.coefficients.items():
        at = [one.heights[0] * m for m in HEIGHTS]
        for row in one.rows():
            K = one.factor(row.term, at)
            cells = [
                f"{number(k, 3)} ± {number(e, 1)} at {number(h, 2)} m"
                for h, k, e in zip(at, K["K"].values, K["stderr"].values, strict=True)
            ]
            y_inf = MISSING if np.isnan(row.y_inf) else number(row.y_inf, 4)
            rows.append(
                (
                    f"{coefficient}: {row.term}",
                    y_inf,
                    *estimate(row.k, row.k_stderr),
                    *estimate(row.s, row.s_stderr),
                    number(row.correlation, 2),
                    *cells,
                )
            )
    caption = f"y = k y_inf h^s, and y = k h^s where there is no y_inf (LR-743 table 2); h in metres; free-air terms {held}"
    head = ("term", "y_inf", "k", "standard error", "s", "standard error", "correlation", *("K(h)",) * len(HEIGHTS))
    return Grid(caption, head, tuple(rows))


def _evidence(found: GroundEffect) -> tuple[Grid, ...]:
    rows = tuple(
        (
            f"{coefficient}: {form}{', taken' if form == one.form else ''}",
            str(int(row["parameters"])),
            number(row["rms"], 4),
            number(row["BIC"], 3),
        )
        for coefficient, one in found.coefficients.items()
        for form, row in one.evidence.iterrows()
    )
    return (
        Grid(
            "Forms compared on the same samples: the simplest within 2 of the least criterion is taken",
            ("form", "parameters", "rms", "BIC"),
            rows,
        ),
    )


def _factors(name: str, found: GroundEffect):
    panels = []
    for coefficient, one in found.coefficients.items():
        for term in one.ground:
            h = np.geomspace(one.heights[0], SHOWN * one.heights[0], POINTS)
            K = one.factor(term, h)
            curves = [Curve(h, K["K"].values, "run-3", K["stderr"].values)]
            if one.form == "table" and one.table is not None and term in one.table.terms:
                nodes, value, stderr = one.tabled(term)
                curves.append(Curve(nodes, value, "run-2", stderr))
            panels.append(PanelOf(f"K of {coefficient}: {term}", "height of the moment reference point, m", tuple(curves)))
    words = f"Factor K over the height of {', '.join(panel.title.removeprefix('K of ') for panel in panels)}, with one standard error"
    return (picture(name.replace(" ", "-"), panels, (("run-3", "k h^s"), ("run-2", "table")), words),) if panels else ()
