"""Section on an identified landing gear: constants, residuals, load of every wheel."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flighttest.submodels.landing_gear.result import IdentifiedGear
from pom.report.presentation.quantities import format_number
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

SAMPLES = 600  # drawn of one wheel


def landing_gear(name: str, gear: IdentifiedGear) -> Section:
    """Return the section of an identified landing gear.

    Parameters
    ----------
    name : str
        Name of the submodel.
    gear : IdentifiedGear
        Result of the identification.
    """
    loads_rms = f"rms {_describe_rms(gear.loads.fit.noise)} [N, N m]"
    techniques = [("wheel loads, tyres, brakes", EQUATION_ERROR, loads_rms)]
    if gear.flown is not None:
        rms = f"rms {_describe_rms(gear.flown.noise)} [SI]"
        techniques.append(("tyres and steering", OUTPUT_ERROR, rms))
    rows = []
    for key, constant in gear.constants.items():
        cells = estimate_cells(constant.value, constant.stderr)
        rows.append((key, *cells, constant.source))
    table = SectionTable(
        "Constants, SI; mirror images share theirs",
        ("constant", "estimate", "standard error", "source"),
        tuple(rows),
    )
    remarks = [f"{key} not determined: {why}" for key, why in gear.undetermined.items()]
    remarks += [units_in_text(remark.text) for remark in gear.remarks]
    return Section(
        name,
        tuple(techniques),
        grids=(table,),
        pictures=_draw_loads(name, gear),
        remarks=tuple(remarks),
    )


def _describe_rms(noise: xr.Dataset) -> str:
    """Return the rms over all records, by output."""
    # Standard errors (record, output).
    rms = np.sqrt(np.mean(noise["stderr"].values ** 2, axis=0))
    parts = []
    for output, value in zip(noise["output"].values, rms, strict=True):
        parts.append(f"{output} {format_number(float(value), 3)}")
    return ", ".join(parts)


def _draw_loads(name: str, gear: IdentifiedGear) -> tuple[Picture, ...]:
    """Draw the reconstructed load of every wheel over its compression."""
    wheels: list[str] = []
    for group in gear.groups:
        wheels.extend(group.names)
    panels = []
    for wheel in wheels:
        compressions, forces = [], []
        for record in gear.loads.loads:
            compressions.append(record["compression"].sel(wheel=wheel).values)
            forces.append(record["force"].sel(output=f"load.{wheel}").values)
        compression, load = np.concatenate(compressions), np.concatenate(forces)
        # Every n-th of the finite samples, about `SAMPLES` of them.
        finite = np.flatnonzero(np.isfinite(compression) & np.isfinite(load))
        samples = finite[:: max(1, len(finite) // SAMPLES)]
        line = SectionLine(100.0 * compression[samples], load[samples] / 1e3, "run-3", marks=True)
        panels.append(PanelOf(f"{wheel}, load in kN", "compression, cm", (line,)))
    if not panels:
        return ()
    description = f"Reconstructed load over compression of {', '.join(wheels)}"
    return (make_picture(name.replace(" ", "-"), panels, key=(), words=description),)
