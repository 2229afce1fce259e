"""Control loading: constants, hinge moments, and the free motion that they give next to the recorded one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flighttest.control_loading import IdentifiedLoading
from flighttest.control_loading.forward import Flown

from ..presentation.quantities import fixed, number
from .section import EQUATION_ERROR, Curve, Grid, PanelOf, Picture, Section, estimate, picture

TOTALS = ("friction", "damping", "mass")
MOST = 6  # windows of free motion that are drawn, those of the largest travel
LABELS = {"column": ("column, cm", 100.0), "wheel": ("wheel, deg", 180.0 / np.pi), "pedal": ("pedal, cm", 100.0)}


def control_loading(name: str, found: IdentifiedLoading, flown: Sequence[Flown] = ()) -> Section:
    """Return the section of one control; `flown` its simulated free motion."""
    loading, sliding = found.loading, found.slid.estimates.attrs
    unit = "N m" if loading.item == "wheel" else "N"
    measures = [("force at the hand", EQUATION_ERROR, f"rms {number(sliding['residual_rms'], 3)} {unit}, R² {fixed(sliding['R2'], 4)}")]
    if found.cable is not None:
        measures.append(
            ("stretch of the cable", EQUATION_ERROR, f"rms {number(found.cable.attrs['rms'], 2)} {'rad' if unit == 'N m' else 'm'}")
        )
    if flown:
        rms = [one.misfit()[0] for one in flown]
        measures.append(
            ("free motion, simulated", "check, not fitted", f"rms {fixed(100 * min(rms), 0)} to {fixed(100 * max(rms), 0)} % of the travel")
        )
    names = [str(term) for term in found.estimates["term"].values]
    constants = tuple((n.replace("_", " "), *estimate(*found.value(n))) for n in names if ":" not in n)
    totals = tuple((f"{n}, both ends", *estimate(*found.total(n))) for n in TOTALS if n in loading.constants and found.cable is not None)
    hinge = tuple((n, *estimate(*found.value(n))) for n in names if ":" in n)
    head = ("", "estimate", "standard error")
    grids = (
        Grid(f"Constants of a circuit of order {found.order}, SI", ("constant", *head[1:]), constants + totals),
        Grid(f"Hinge moment {loading.model}, per radian", ("term", *head[1:]), hinge),
    )
    remarks = tuple(
        f"{a} and {b} go together in every manoeuvre; only differences between manoeuvres separate them" for a, b in found.collinear
    )
    return Section(name, tuple(measures), grids, _free_motion(name, loading.item, flown), remarks)


def _free_motion(name: str, item: str, flown: Sequence[Flown]) -> tuple[Picture, ...]:
    if not flown:
        return ()
    title, factor = LABELS[item]
    panels = []
    for one in sorted(flown, key=lambda one: -np.ptp(one.travel[:, 0]))[:MOST]:
        time = one.time - one.time[0]
        curves = tuple(Curve(time, factor * one.travel[:, k], css) for k, css in enumerate(("run-0", "run-3")))
        panels.append(PanelOf(title, "time, s", curves))
    words = f"Free motion of the {item}, recorded and simulated with the identified constants, {len(panels)} of {len(flown)} windows"
    return (picture(f"free-{name}", panels, (("run-0", "recorded"), ("run-3", "simulated")), words),)
