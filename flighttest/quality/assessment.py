"""The quality of a flight record: every check in order, each with the mistakes undone that the ones before it found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, SchemaError

from ..reconstruction.problem.assembly import assemble
from ..records.record import manoeuvres
from ..sensors.instruments import SPEEDS, Instruments, instruments_of
from ..sensors.measurements import Channels, demand_air_data, windows_of
from .checks.control_response import answer_findings, answers, hands
from .checks.delays import lag_findings, lags
from .checks.excitation import correlations, excitation, excitation_findings
from .checks.kinematic_findings import accuracy_findings, kinematic_findings, kinematic_table
from .checks.mistake_search import explain
from .checks.notes import remarks
from .checks.relations import compare_all, not_checked
from .checks.samples import channel_findings, channel_table, faults_of, flag_findings
from .checks.signals import Signals, at_cg, signals_of
from .declarations.aircraft import geometry_findings, inertia_findings
from .declarations.columns import column_findings, heading_findings, pressure_height_findings, with_headings
from .declarations.product_of_inertia import product_findings
from .declarations.weight import weight_findings
from .finding import Finding, by_severity, without_consequences
from .result import Quality

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft


RATE = 50.0  # Hz, of the path that is set up to see whether the reconstruction takes a record


def assess(record: xr.DataTree, aircraft: Aircraft | None = None, database: xr.DataTree | None = None) -> Quality:
    """Return what is right and wrong with a flight record.

    Parameters
    ----------
    record : DataTree
        As `flighttest.read` returns it.
    aircraft : Aircraft, optional
        With its instruments: places, noise and latency to judge by.  Without it accelerometers and vanes are taken to sit at the c.g.
        and habit judges delays.  Geometry, inertia and mass of it are checked too.
    database : DataTree, optional
        A-priori database of the aircraft: the weight is compared with its lift.

    Returns
    -------
    Quality

    Raises
    ------
    SchemaError
        The record holds no channel of motion, or the instruments of the aircraft are not complete.

    Notes
    -----
    In order: clocks and samples of each channel; columns that stand for two channels; kinematics and air data, with the search for
    the mistake that explains what does not agree; then, with such mistakes undone, headings, the aircraft file, scale errors, delays,
    the answers to the controls, and excitation.

    References
    ----------
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for fixed-wing UAS, section IV.B.
    """
    stated = aircraft is not None and (aircraft.instruments or "instruments" in record.attrs)
    specification = instruments_of(aircraft, record.attrs) if stated else None
    faults = faults_of(record)
    signals = signals_of(record, faults)
    table = channel_table(record)
    findings = flag_findings(faults) + channel_findings(record, table, specification)
    shared, wrong = column_findings(record, signals)
    explanations, corrected, comparisons = explain(signals.without(wrong))
    mistaken = [channel for explanation in explanations for channel in explanation.repair.channels]
    findings += shared + heading_findings(record, corrected, mistaken) + pressure_height_findings(corrected)
    findings += kinematic_findings(explanations, comparisons, corrected, record)
    places = _places(specification, aircraft)
    moved = at_cg(corrected, places)
    kinematics = kinematic_table(moved)
    unseen = not_checked(corrected)
    if aircraft is not None:
        of_aircraft, unseen = _of_aircraft(moved, aircraft, record, database, unseen)
        findings += of_aircraft
    delays = lags(moved, places)
    answered, followed = answers(_on_time(moved, delays, specification, record)), hands(corrected)
    excited, matrix = excitation(corrected), correlations(corrected)
    purpose = str(record.attrs.get("purpose", ""))
    findings += accuracy_findings(kinematics)
    findings += lag_findings(delays, specification, record)
    late = {channel for finding in findings if finding.kind == "lag" for channel in finding.channels}
    findings += answer_findings(answered, followed, moved, record, late)
    findings += excitation_findings(excited, matrix, corrected, manoeuvres(record), purpose)
    findings += remarks(corrected, table, comparisons, signals)
    if all(finding.severity == "note" for finding in findings):  # nothing is called sound that the reconstruction refuses
        findings += _refusals(record, aircraft, specification)
    as_read = compare_all(signals) if explanations else comparisons
    findings = by_severity(without_consequences(with_headings(findings)))
    facts = _facts(record, signals, aircraft)
    return Quality(facts, findings, table, kinematics, delays, answered, followed, excited, matrix, comparisons, as_read, signals, unseen)


def _on_time(signals: Signals, delays: pd.DataFrame, specification: Instruments | None, record: xr.DataTree) -> Signals:
    """Return signals whose late channels are put back on time: a late flow angle makes its surface look reversed."""
    late = {channel for finding in lag_findings(delays, specification, record) for channel in finding.channels}
    measured = delays.set_index("channel")["delay"]
    shifts = {name: float(np.ravel(measured[name])[0]) for name in late if name in measured and name in signals.values}
    return signals.with_values({name: np.interp(signals.time + by, signals.time, signals[name]) for name, by in shifts.items()})


def _of_aircraft(
    moved: Signals, aircraft: Aircraft, record: xr.DataTree, database: xr.DataTree | None, unseen: pd.DataFrame
) -> tuple[list[Finding], pd.DataFrame]:
    """Return what is wrong with the aircraft file, and what is not checked with what of it is not."""
    weight, no_weight = weight_findings(moved, aircraft, record, database)
    product, no_product = product_findings(moved, aircraft)
    shape = geometry_findings(aircraft)
    if shape:
        weight = []  # they judge by S and b, which are wrong
    rows = [("weight", "mass, and lift", no_weight), ("Ixz", "sign of Ixz, and pitching in rolls", no_product)]
    more = [(name, title, (), reason) for name, title, reason in rows if reason]
    table = pd.concat([unseen, pd.DataFrame(more, columns=unseen.columns)], ignore_index=True) if more else unseen
    return [*shape, *inertia_findings(aircraft), *weight, *product], table


def _refusals(record: xr.DataTree, aircraft: Aircraft | None, specification: Instruments | None) -> list[Finding]:
    """Return why the reconstruction refuses the whole record: of an aircraft its problem is set up, without one channels are looked for."""
    if not any("ax_imu" in leaf for leaf in record.children.values()):
        return []  # no record for a reconstruction; the note on absent channels states it
    try:
        windows = windows_of(record, None)
        if aircraft is not None and specification is not None:
            assemble(record, aircraft, specification, windows, RATE, None)
        else:
            channels = Channels(record, windows)
            demand_air_data(channels, next((name for name in ("q_c", *SPEEDS) if name in channels), "q_c"))
    except AeromatchError as error:
        problems = error.problems if isinstance(error, SchemaError) else [str(error)]
        text = f"the reconstruction refuses the whole record: {'; '.join(problems)}"
        severity = "warning" if specification is None else "error"
        return [Finding(severity, "reconstruction", ("record",), text, "add what is missing, or reconstruct windows without the fault")]
    return []


def _places(specification: Instruments | None, aircraft: Aircraft | None) -> dict[str, np.ndarray]:
    """Return the places of accelerometers and vanes from the c.g. [m]"""
    if specification is None or aircraft is None:
        return {}
    cg = np.asarray(aircraft.cg, float)
    given = {name: specification.of(name).position for name in ("ax_imu", "alpha_vane", "beta_vane")}
    return {name: np.asarray(position, float) - cg for name, position in given.items() if position is not None}


def _facts(record: xr.DataTree, signals: Signals, aircraft: Aircraft | None) -> dict[str, Any]:
    facts = {key: str(record.attrs.get(key, "")) for key in ("title", "source_file", "start", "purpose")}
    return {
        **facts,
        "aircraft": aircraft.name if aircraft is not None else "",
        "begin": float(signals.time[0]),
        "end": float(signals.time[-1]),
        "in_flight": float(signals.flying.mean()),
        "columns_left_out": len([name for name in str(record.attrs.get("unmapped", "")).split(", ") if name]),
    }
