"""Control loading: constants, hinge moments, and the free motion that they give next to the recorded one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flighttest.control_loading import IdentifiedLoading
from flighttest.control_loading.forward import Flown
from flighttest.control_loading.motion import CUTOFF, design, signals, sliding

from ..presentation.quantities import fixed, number
from .section import EQUATION_ERROR, Curve, Grid, PanelOf, Picture, Section, estimate, picture

TOTALS = ("friction", "damping", "mass")
MOST = 6  # windows of free motion that are drawn, those of the largest travel
LOOPS, CONTROL_POINTS = 4, 400  # speeds whose force over the travel is drawn, and samples of each
ONE_SPEED, STILL = 0.1, 20.0  # dynamic pressures that count as one: relative, and about zero [Pa]
LABELS = {"column": ("column, cm", 100.0), "wheel": ("wheel, deg", 180.0 / np.pi), "pedal": ("pedal, cm", 100.0)}


def control_loading(name: str, found: IdentifiedLoading, flown: Sequence[Flown] = (), driven: Sequence[xr.Dataset] = ()) -> Section:
    """Return the section of one control; `flown` its simulated free motion, `driven` the records of its slow motion."""
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
    return Section(name, tuple(measures), grids, (*_force_loops(name, found, driven), *_free_motion(name, loading.item, flown)), remarks)


def _force_loops(name: str, found: IdentifiedLoading, driven: Sequence[xr.Dataset]) -> tuple[Picture, ...]:
    """Return the force at the hand over the travel, recorded and by the identified constants, the dynamic pressure rising.

    Samples in which the control slides: friction makes the two branches of a loop, its half width.
    """
    loading, loops = found.loading, []
    theta = found.slid.estimates["estimate"].values
    (title, factor), unit = LABELS[loading.item], "N m" if loading.item == "wheel" else "N"
    for one in driven:
        moved = signals(loading, one, CUTOFF)
        used = sliding(loading, one, moved, CUTOFF)
        if used.any():
            rows = factor * moved["travel"].values, moved[f"F_{loading.item}"].values, design(loading, moved) @ theta
            loops.append((float(moved["qbar"].values[used].mean()), np.array(rows)[:, used]))
    chosen = _of_speeds(loops)
    panels = [
        PanelOf(
            f"force, {unit}; dynamic pressure {fixed(max(qbar, 0.0) / 1e3, 1)} kPa",
            title,
            tuple(Curve(rows[0], force, css, marks=True) for force, css in zip(rows[1:], ("run-0", "run-3"), strict=True)),
        )
        for qbar, rows in chosen
    ]
    words = (
        f"Force at the {loading.item} over its travel while it slides, recorded and by the identified constants, at {len(panels)} speeds"
    )
    return (picture(f"force-{name}", panels, (("run-0", "recorded"), ("run-3", "identified")), words),) if panels else ()


def _of_speeds(loops: Sequence[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """Return dynamic pressure and samples (3, sample) of a few speeds, from the lowest to the highest; near ones joined."""
    joined: list[tuple[float, np.ndarray]] = []
    for qbar, rows in sorted(loops, key=lambda loop: loop[0]):
        if joined and qbar - joined[-1][0] < ONE_SPEED * qbar + STILL:
            joined[-1] = joined[-1][0], np.hstack([joined[-1][1], rows])
        else:
            joined.append((qbar, rows))
    chosen = [joined[k] for k in np.unique(np.linspace(0, len(joined) - 1, LOOPS).round().astype(int))] if joined else []
    return [(qbar, rows[:, :: max(1, rows.shape[1] // CONTROL_POINTS)]) for qbar, rows in chosen]


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
