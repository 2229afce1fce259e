"""Remarks on the numbers and models of a project file: unusual, and mostly a mistake.

A match runs with them, so that an unusual project is possible.
"""

from __future__ import annotations

from collections.abc import Iterator

from aeromatch.project.project import Project
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.names import REDUCED_RATES
from flighttest.reconstruction.dynamics.error_sizes import error_size_remarks
from flighttest.reconstruction.quality.declarations.positions import (
    position_findings,
    sensor_positions,
)
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes
from flighttest.reconstruction.quality.instrument_sizes import (
    instrument_size_findings,
)
from flighttest.records.sensors.instruments import instruments_of
from flighttest.regression.equation_error.least_squares import intercept_mask
from flighttest.regression.equation_error.model import RegressionModel

_REDUCED = {rate: reduced for reduced, (rate, _) in REDUCED_RATES.items()}


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
    return [*remarks, *_model_remarks(project)]


def aircraft_remarks(aircraft: Aircraft) -> list[str]:
    """Return the remarks on engines and instruments of an aircraft, one line each."""
    remarks = [f"aircraft: {size.text}; {size.remedy}" for size in unusual_sizes(aircraft)]
    try:
        specification = instruments_of(aircraft, {}) if aircraft.instruments else None
    except SchemaError:
        # The look at each record reports a faulty instrument.
        specification = None
    places = sensor_positions(specification, aircraft)
    findings = position_findings(places, aircraft) + instrument_size_findings(specification)
    for finding in findings:
        remarks.append(f"aircraft: {finding.text}; {finding.remedy}")
    return remarks


def _model_remarks(project: Project) -> Iterator[str]:
    """Yield the models without a constant, and those with rates that have a dimension."""
    models = []
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
        for rate in model.variables:
            if rate in _REDUCED:
                yield (
                    f"{position}: {model} has the regressor {rate} with a dimension; the tables "
                    f"multiply {_REDUCED[rate]}, and a slope over {rate} holds at one airspeed "
                    f"only: write {_REDUCED[rate]}"
                )
