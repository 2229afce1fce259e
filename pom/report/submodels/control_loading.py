"""Section on the control loading of one control: constants, force loops, free motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flighttest.submodels.control_loading.motion import (
    CUTOFF,
    control_signals,
    force_regressors,
    is_sliding,
)
from flighttest.submodels.control_loading.result import IdentifiedLoading
from flighttest.submodels.control_loading.simulation import SimulatedWindow
from pom.report.presentation.quantities import fixed_decimals, format_number
from pom.report.presentation.unit_sets import units_in_text
from pom.report.submodels.section import (
    EQUATION_ERROR,
    OUTPUT_ERROR,
    PanelOf,
    Picture,
    Section,
    SectionLine,
    SectionTable,
    estimate_cells,
    make_picture,
)

TOTALS = ("friction", "damping", "mass")  # constants with a value for both ends of the cable
MOST = 6  # windows of free motion that are drawn, those of the largest travel
LOOPS, CONTROL_POINTS = 4, 400  # dynamic pressures with a drawn loop, and samples of each
# Dynamic pressures that count as one: relative difference, and difference near zero [Pa].
ONE_SPEED, STILL = 0.1, 20.0
# Label of the travel, and factor from SI to its unit.
LABELS = {
    "column": ("column, cm", 100.0),
    "wheel": ("wheel, deg", 180.0 / np.pi),
    "pedal": ("pedal, cm", 100.0),
}


def control_loading(
    name: str,
    result: IdentifiedLoading,
    windows: Sequence[SimulatedWindow] = (),
    records: Sequence[xr.Dataset] = (),
) -> Section:
    """Return the section of one control.

    Parameters
    ----------
    name : str
        Name of the submodel.
    result : IdentifiedLoading
        Result of the identification.
    windows : sequence of SimulatedWindow
        Simulated free motion of the control.
    records : sequence of Dataset (time,)
        Records of the slow motion of the control.
    """
    remarks = []
    for first, second in result.collinear:
        remarks.append(
            f"{first} and {second} go together in every manoeuvre; only differences between "
            "manoeuvres separate them"
        )
    remarks += [units_in_text(remark.text) for remark in result.remarks]
    pictures = (
        *_draw_force_loops(name, result, records),
        *_draw_free_motion(name, result.loading.item, windows),
    )
    return Section(
        name,
        _residual_rows(result, windows),
        grids=_constant_tables(result),
        pictures=pictures,
        remarks=tuple(remarks),
    )


def _force_unit(item: str) -> str:
    """Return the unit of the force at the hand; that of a wheel is a moment."""
    return "N m" if item == "wheel" else "N"


def _residual_rows(
    result: IdentifiedLoading, windows: Sequence[SimulatedWindow]
) -> tuple[tuple[str, str, str], ...]:
    """Return part, technique and residual of every step of the identification."""
    sliding = result.slid.estimates.attrs
    unit = _force_unit(result.loading.item)
    rms = f"rms {format_number(sliding['residual_rms'], 3)} {unit}"
    rows = [("force at the hand", EQUATION_ERROR, f"{rms}, R² {fixed_decimals(sliding['R2'], 4)}")]
    if result.cable is not None:
        stretch_unit = "rad" if unit == "N m" else "m"
        rms = f"rms {format_number(result.cable.attrs['rms'], 2)} {stretch_unit}"
        rows.append(("stretch of the cable", EQUATION_ERROR, rms))
    if windows:
        misfits = [window.misfit()[0] for window in windows]
        least = fixed_decimals(100 * min(misfits), 0)
        largest = fixed_decimals(100 * max(misfits), 0)
        rms = f"rms {least} to {largest} % of the travel"
        technique = "check, not fitted" if result.response is None else OUTPUT_ERROR
        rows.append(("free motion, simulated", technique, rms))
    return tuple(rows)


def _constant_tables(result: IdentifiedLoading) -> tuple[SectionTable, SectionTable]:
    """Return the constants of the circuit, and the terms of the hinge moment."""
    loading = result.loading
    constants: list[tuple[str, ...]] = []
    hinge: list[tuple[str, ...]] = []
    # The name of a term of the hinge moment has a colon.
    for term in map(str, result.estimates["term"].values):
        cells = estimate_cells(*result.value(term))
        if ":" in term:
            hinge.append((term, *cells))
        else:
            constants.append((term.replace("_", " "), *cells))
    if result.cable is not None:
        for term in TOTALS:
            if term in loading.constants:
                constants.append((f"{term}, both ends", *estimate_cells(*result.total(term))))
    return (
        SectionTable(
            f"Constants of a circuit of order {result.order}, SI",
            ("constant", "estimate", "standard error"),
            tuple(constants),
        ),
        SectionTable(
            f"Hinge moment {loading.model}, per radian",
            ("term", "estimate", "standard error"),
            tuple(hinge),
        ),
    )


def _draw_force_loops(
    name: str, result: IdentifiedLoading, records: Sequence[xr.Dataset]
) -> tuple[Picture, ...]:
    """Draw the recorded and the identified force over the travel, by rising dynamic pressure."""
    loading = result.loading
    theta = result.slid.estimates["estimate"].values
    title, factor = LABELS[loading.item]
    loops = []
    for record in records:
        motion = control_signals(loading, record, CUTOFF)
        # Only samples in which the control slides.  Friction separates the two branches of a loop
        # by twice its value.
        sliding = is_sliding(loading, record, motion, CUTOFF)
        if not sliding.any():
            continue
        # Rows: travel, recorded force, identified force.
        samples = (
            factor * motion["travel"].values,
            motion[f"F_{loading.item}"].values,
            force_regressors(loading, motion) @ theta,
        )
        qbar = float(motion["qbar"].values[sliding].mean())
        loops.append((qbar, np.array(samples)[:, sliding]))

    panels = []
    for qbar, (travel, recorded, identified) in _choose_loops(loops):
        pressure = fixed_decimals(max(qbar, 0.0) / 1e3, 1)
        curves = (
            SectionLine(travel, recorded, "run-0", marks=True),
            SectionLine(travel, identified, "run-3", marks=True),
        )
        unit = _force_unit(loading.item)
        panels.append(PanelOf(f"force, {unit}; dynamic pressure {pressure} kPa", title, curves))
    if not panels:
        return ()
    description = (
        f"Force at the {loading.item} over its travel while it slides, recorded and by the "
        f"identified constants, at {len(panels)} speeds"
    )
    key = (("run-0", "recorded"), ("run-3", "identified"))
    return (make_picture(f"force-{name}", panels, key=key, words=description),)


def _choose_loops(loops: Sequence[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """Return dynamic pressure [Pa] and samples (3, sample) of at most `LOOPS` speeds, rising."""
    joined: list[tuple[float, np.ndarray]] = []
    for qbar, samples in sorted(loops, key=lambda loop: loop[0]):
        # A loop near the one before has its panel, which keeps its dynamic pressure.
        if joined and qbar - joined[-1][0] < ONE_SPEED * qbar + STILL:
            joined[-1] = joined[-1][0], np.hstack([joined[-1][1], samples])
        else:
            joined.append((qbar, samples))
    if not joined:
        return []
    # Evenly spaced positions from the lowest to the highest dynamic pressure.
    positions = np.unique(np.linspace(0, len(joined) - 1, LOOPS).round().astype(int))
    chosen = []
    for position in positions:
        qbar, samples = joined[position]
        step = max(1, samples.shape[1] // CONTROL_POINTS)
        chosen.append((qbar, samples[:, ::step]))
    return chosen


def _draw_free_motion(
    name: str, item: str, windows: Sequence[SimulatedWindow]
) -> tuple[Picture, ...]:
    """Draw the recorded and the simulated free motion in the windows of the largest travel."""
    if not windows:
        return ()
    title, factor = LABELS[item]
    panels = []
    for window in sorted(windows, key=lambda window: -np.ptp(window.travel[:, 0]))[:MOST]:
        time = window.time - window.time[0]
        # Columns of the travel: recorded, simulated.
        curves = (
            SectionLine(time, factor * window.travel[:, 0], "run-0"),
            SectionLine(time, factor * window.travel[:, 1], "run-3"),
        )
        panels.append(PanelOf(title, "time, s", curves))
    description = (
        f"Free motion of the {item}, recorded and simulated with the identified constants, "
        f"{len(panels)} of {len(windows)} windows"
    )
    key = (("run-0", "recorded"), ("run-3", "simulated"))
    return (make_picture(f"free-{name}", panels, key=key, words=description),)
