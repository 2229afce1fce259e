"""An output-error fit from its specification: files opened, records checked, the fit made, and reported."""

from __future__ import annotations

from flightmech.simulation.model_files import compile_files

from ...dynamics.force_coefficients import between
from ...dynamics.saved_paths import open_states
from ...quality.manoeuvre_assessment import report_faults
from ..time_domain import output_error, uniform_step
from .result import Performed
from .specification import Specification


def perform(specification: Specification) -> Performed:
    """Make an output-error fit.

    Parameters
    ----------
    specification : Specification

    Returns
    -------
    Performed

    Raises
    ------
    SchemaError
        Records whose signs, units or axes are wrong, by name; unknowns without a start.
    ParseError, UnknownName, OutOfRange, IdentificationError
        As `output_error`, and for files and windows.

    Warns
    -----
    AeromatchWarning
        Records without excitation, inputs that move together.
    """
    sim = compile_files(str(specification.aircraft), str(specification.database))
    records = []
    for table in specification.record:
        states = open_states(table.file)
        records.append((between(states, *table.window) if table.window else states).assign_attrs(record=table.file.stem))
        uniform_step(records[-1]["time"].values.astype(float), table.file.name)
    report_faults(records, [table.file.name for table in specification.record])
    unknowns, held = specification.unknowns(sim), specification.held(sim)
    fit = output_error(sim, records, unknowns, specification.outputs, held, specification.noise, iterations=specification.iterations)
    return Performed(specification, sim, tuple(records), fit)
