"""Remarks on the numbers and models of a project file: unusual, and mostly a mistake.

A match runs with them, so that an unusual project is possible.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
from aeromatch.planning.record_look import RecordLook
from aeromatch.project.project import Project
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ICE
from flightmech.errors import SchemaError
from flightmech.names import REDUCED_RATES
from flightmech.terms import list_model_variables
from flighttest.reconstruction.dynamics.error_sizes import error_size_remarks
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes
from flighttest.reconstruction.quality.instruments.instrument_sizes import (
    instrument_size_findings,
)
from flighttest.reconstruction.quality.instruments.positions import (
    position_findings,
    sensor_positions,
    side_findings,
)
from flighttest.records.sensors.instruments import instruments_of
from flighttest.regression.equation_error.least_squares import intercept_mask
from flighttest.regression.equation_error.model import RegressionModel
from pom.cases.case import PomCase
from pom.judging.departures import case_departures

_REDUCED = {rate: reduced for reduced, (rate, _) in REDUCED_RATES.items()}


# Regressors that only lift and pitching moment have.
_PITCH = {"alpha", "qhat"}
# Moment and surface of each control of a manoeuvre.
_MOMENT_OF = {
    "elevator": ("Cm", "delta_e"),
    "aileron": ("Cl", "delta_a"),
    "rudder": ("Cn", "delta_r"),
}


def project_remarks(project: Project) -> list[str]:
    """Return the remarks on the standard errors and on the models of the fits of a project.

    Parameters
    ----------
    project : Project

    Returns
    -------
    list of str
        One line each, with the position in the project file.
    """
    remarks = error_size_remarks(project.errors, "errors.")
    if project.gear is not None:
        remarks += error_size_remarks(project.gear.errors, "gear.errors.")
    return [*remarks, *_model_remarks(project), *_control_remarks(project)]


def case_statements(cases: Iterable[PomCase]) -> list[str]:
    """Return what case files alone make unusual, such as a start without trim or a wider band.

    Parameters
    ----------
    cases : iterable of PomCase

    Returns
    -------
    list of str
        The departures of `pom.judging.departures.case_departures`, a line each with its case.
    """
    lines = []
    for case in cases:
        for remark in case_departures(case):
            reason = _missing_reason(case, remark.quantity)
            lines.append(f"case {case.name}: {remark.text.removeprefix('departure: ')}{reason}")
    return lines


def _missing_reason(case: PomCase, name: str) -> str:
    """Return that a band of the case file has no rationale; empty for what needs none."""
    for criterion in case.criteria:
        is_explained = bool({criterion.name, criterion.channel} & case.rationale.keys())
        if criterion.name == name and criterion.provenance == "case file" and not is_explained:
            return "; no [rationale] states why"
    return ""


def purpose_gaps(project: Project, records: Mapping[str, bool]) -> list[str]:
    """Return what a match leaves undone for want of fits or of cases, one line each.

    Parameters
    ----------
    project : Project
    records : mapping of str to bool
        Records of the match, and whether each identifies something.
    """
    gaps = []
    if not any(records.values()) and not project.published:
        gaps.append(
            "no record identifies: the project has no fit, so every model keeps the a-priori "
            "aerodynamics; add [[fit]] with records and models to the project file, or correct "
            "what keeps 'aeromatch init' from drafting one"
        )
    if not project.cases:
        gaps.append(
            "no record proves: the project has no case, so the match writes no report; add a case "
            "with 'aeromatch pom init', or correct what keeps 'aeromatch init' from drafting one"
        )
    return gaps


def aircraft_remarks(aircraft: Aircraft) -> list[str]:
    """Return the remarks on engines and instruments of an aircraft, one line each."""
    remarks = [f"aircraft: {size.text}; {size.remedy}" for size in unusual_sizes(aircraft)]
    try:
        specification = instruments_of(aircraft, {}) if aircraft.instruments else None
    except SchemaError:
        # The look at each record reports a faulty instrument.
        specification = None
    places = sensor_positions(specification, aircraft)
    findings = position_findings(places, aircraft) + side_findings(aircraft)
    findings += instrument_size_findings(specification)
    for finding in findings:
        remarks.append(f"aircraft: {finding.text}; {finding.remedy}")
    return remarks


def ice_remarks(
    database: xr.DataTree, cases: Iterable[PomCase], looks: Mapping[str, RecordLook]
) -> list[str]:
    """Return the remarks on the setting of the ice, one line each.

    Parameters
    ----------
    database : DataTree
        Before the flights.
    cases : iterable of PomCase
    looks : mapping of str to RecordLook
        Of the records that fits or cases use, by name.

    Returns
    -------
    list of str
        Empty if the terms have ice and a flight has, or neither.
    """
    fitted = dict(_iced_fits(looks))
    variables: set[str] = set()
    for leaf in aerodb.terms(database).values():
        variables.update(list_model_variables(leaf))
    if ICE not in variables:
        remarks = []
        for name, largest in fitted.items():
            remarks.append(
                f"record {name}: {ICE} reaches {largest:.3g} in a fit, and no term depends on it: "
                f"the effect of the ice enters the clean tables; give the key ice, or leave the "
                f"record out of the fits"
            )
        return remarks
    if fitted or any(_is_iced(case, looks) for case in cases):
        return []
    return [
        f"ice: no fit and no case has {ICE} above 0, so every flight counts as clean; map the "
        f"column of the records with ice, or state it in [conditions] of the cases"
    ]


def _model_remarks(project: Project) -> Iterator[str]:
    """Yield the models without a constant, and those with rates that have a dimension."""
    models: list[tuple[str, str]] = []
    for fit in project.fit:
        models += [(f"fit {fit.name!r}", text) for text in fit.models]
    if project.ground_effect is not None:
        models += [("ground_effect.models", text) for text in project.ground_effect.models]
    for position, text in models:
        model = RegressionModel.parse(text)
        if not intercept_mask(model.terms).any():
            yield (
                f"{position}: {model} has no constant: its curve goes through zero, and all slopes "
                f"change; write {model.coefficient} = 1 + ..., or leave it so on purpose"
            )
        if model.coefficient == "Cl" and set(model.variables) >= _PITCH:
            yield (
                f"{position}: {model} has the regressors of lift: Cl is the rolling moment, and "
                f"lift is CL; write CL = ..., or leave it so on purpose"
            )
        for rate in model.variables:
            if rate in _REDUCED:
                yield (
                    f"{position}: {model} has the regressor {rate} with a dimension; the tables "
                    f"multiply {_REDUCED[rate]}, and a slope over {rate} holds at one airspeed "
                    f"only: write {_REDUCED[rate]}"
                )


def _control_remarks(project: Project) -> Iterator[str]:
    """Yield the moments without the surface that moves in the manoeuvres of their fit."""
    for fit in project.fit:
        # a manoeuvre is named by its kind and its controls: "doublet aileron rudder"
        moved: set[str] = set()
        for name in fit.manoeuvres:
            moved.update(name.split()[1:])
        variables: dict[str, set[str]] = {}
        for text in fit.models:
            model = RegressionModel.parse(text)
            variables.setdefault(model.coefficient, set()).update(model.variables)
        for control, (coefficient, surface) in _MOMENT_OF.items():
            if control not in moved or surface in variables.get(coefficient, {surface}):
                continue
            yield (
                f"fit {fit.name!r}: {coefficient} lacks {surface}, and the {control} moves in its "
                f"manoeuvres: its moment enters the other terms; write {coefficient} = ... + "
                f"{surface}"
            )


def _iced_fits(looks: Mapping[str, RecordLook]) -> Iterator[tuple[str, float]]:
    """Yield each record that a fit uses with ice, and its largest setting."""
    for name, look in looks.items():
        settings = [ranges[ICE][1] for ranges in look.ranges.values() if ICE in ranges]
        if settings and max(settings) > 0.0:
            yield name, max(settings)


def _is_iced(case: PomCase, looks: Mapping[str, RecordLook]) -> bool:
    """Return whether a case is flown with ice, by its conditions or its record."""
    if ICE in case.conditions:
        return case.conditions[ICE] > 0.0
    look = looks.get(Path(case.record).stem)
    states = look.windows.get(case.name) if look else None
    if states is None or ICE not in states:
        return False
    return bool(np.nanmax(states[ICE].values, initial=0.0) > 0.0)
