"""Whether the aircraft of a model is that of the case: lengths, moments of inertia and controls."""

from __future__ import annotations

from pathlib import Path

import flightmech
from flightmech.errors import AeromatchError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from pom.cases.case import PomCase
from pom.cases.case_facts import REVERSIBLE
from pom.cases.job import ReplayJob
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark

AIRCRAFT_PROBE = "lengths and moments of inertia of the model against the aircraft file"
"""Name of `compare_aircraft` in the remark that it was not made."""
INERTIA = 0.05
"""Relative difference of two moments of inertia from which on it is named."""
GEOMETRY = 1e-3
"""Relative difference of two reference lengths or areas that is rounding."""
_INERTIA = ("Ixx", "Iyy", "Izz")
_GEOMETRY = ("S", "cbar", "b")


def compare_aircraft(case: PomCase, model: SimModel, job: ReplayJob) -> tuple[RowRemark, ...]:
    """Return the departure of a model that is of another aircraft than the case.

    Quantities that record or conditions set are not compared.

    Parameters
    ----------
    case : PomCase
    model : SimModel
        Inside the FMU.
    job : ReplayJob
    """
    if not case.aircraft or not Path(case.aircraft).is_file():
        reason = f"no file {case.aircraft}" if case.aircraft else "the case names no aircraft file"
        return (unprobed_remark(AIRCRAFT_PROBE, reason, "aircraft"),)
    try:
        aircraft = flightmech.read_aircraft(case.aircraft)
    except AeromatchError:
        return (unprobed_remark(AIRCRAFT_PROBE, "a faulty aircraft file", "aircraft"),)
    held = {entry.name: entry.value for entry in model.entries(PARAMETER)}
    database = model.meta.get("database", {})
    pairs: dict[str, tuple[float, float, float]] = {}
    for name in _GEOMETRY:
        if name in database:
            pairs[name] = getattr(aircraft, name), float(database[name]), GEOMETRY
    for name in _INERTIA:
        parameter = f"mass.{name}"
        if parameter in held and parameter not in job.parameters:
            pairs[name] = getattr(aircraft, name), held[parameter], INERTIA
    differing = []
    for name, (stated, flown, limit) in pairs.items():
        if abs(flown - stated) > limit * abs(stated):
            differing.append(f"{name} {stated:.5g} and {flown:.5g}")
    if not differing:
        return ()
    text = (
        f"departure: the aircraft file of the case and the model differ (SI): "
        f"{', '.join(differing)}. Give the case the aircraft file that the model was compiled from"
    )
    return (RowRemark("departure", text, "aircraft"),)


def compare_controls(case: PomCase, model: SimModel) -> tuple[RowRemark, ...]:
    """Return the departure of a model whose surfaces load the pilot, against the facts of the case.

    Parameters
    ----------
    case : PomCase
    model : SimModel
        Inside the FMU.
    """
    if case.facts.get(REVERSIBLE) is not False:
        return ()
    hinges = [name for name in model.terms if name.startswith("Ch_")]
    if not hinges:
        return ()
    text = (
        f"departure: pilot forces are not judged, since {REVERSIBLE} is false in the facts of the "
        f"aircraft, and the model has hinge moments that load its circuits ({', '.join(hinges)}). "
        f"Correct [facts], or state why the model has them"
    )
    return (RowRemark("departure", text, REVERSIBLE),)
