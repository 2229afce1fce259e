"""The quality of a flight record: every check in order, each with the mistakes undone that the ones
before it found.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, AeromatchWarning, SchemaError
from flightmech.units import DEGREE
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.quality.checks.clock_scale import (
    clock_findings,
    clock_scale,
    on_seconds,
)
from flighttest.reconstruction.quality.checks.control_findings import answer_findings
from flighttest.reconstruction.quality.checks.control_response import (
    control_responses,
    pilot_to_surface,
)
from flighttest.reconstruction.quality.checks.excitation import (
    axis_excitation,
    excitation_findings,
    input_correlations,
)
from flighttest.reconstruction.quality.checks.kinematic_consistency import (
    accuracy_findings,
    find_lags,
    kinematic_findings,
    kinematic_table,
    lag_findings,
)
from flighttest.reconstruction.quality.checks.mistake_search import find_mistakes
from flighttest.reconstruction.quality.checks.relations import compare_all, not_checked
from flighttest.reconstruction.quality.checks.samples import (
    channel_findings,
    channel_table,
    faults_of,
    flag_findings,
)
from flighttest.reconstruction.quality.checks.signals import (
    ResampledChannels,
    at_cg,
    resample_channels,
)
from flighttest.reconstruction.quality.declarations.air_temperature import temperature_findings
from flighttest.reconstruction.quality.declarations.columns import (
    column_findings,
    pressure_height_findings,
)
from flighttest.reconstruction.quality.declarations.geometry import geometry_findings
from flighttest.reconstruction.quality.declarations.headings import heading_findings, with_headings
from flighttest.reconstruction.quality.declarations.inertia import (
    inertia_findings,
    product_findings,
)
from flighttest.reconstruction.quality.declarations.weight import weight_findings
from flighttest.reconstruction.quality.finding import Finding, by_severity, without_consequences
from flighttest.reconstruction.quality.record_notes import quality_remarks
from flighttest.reconstruction.quality.result import Quality
from flighttest.records.record import manoeuvres
from flighttest.records.sensors.instruments import SPEEDS, Instruments, instruments_of
from flighttest.records.sensors.measurements import MeasuredChannels, demand_air_data, order_windows
from flighttest.records.signals.resampling import GAP

RATE = 50.0  # Hz, of the path that is set up to see whether the reconstruction takes a record


def assess(
    record: xr.DataTree, aircraft: Aircraft | None = None, database: xr.DataTree | None = None
) -> Quality:
    """Return what is right and wrong with a flight record.

    Parameters
    ----------
    record : DataTree
        As `flighttest.read` returns it.
    aircraft : Aircraft, optional
        With its instruments: places, noise and latency to judge by.  Without it accelerometers and
        vanes are taken to sit at the c.g. and habit judges delays.  Geometry, inertia and mass of
        it are checked too.
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
    In order: unit of the clock; clocks and samples of each channel; columns that stand for two channels; kinematics and air data, with the search for
    the mistake that explains what does not agree; then, with such mistakes undone, headings, the aircraft file, scale errors, delays,
    the answers to the controls, and excitation.

    References
    ----------
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for fixed-wing UAS, section IV.B.
    """
    stated = aircraft is not None and (aircraft.instruments or "instruments" in record.attrs)
    specification = instruments_of(aircraft, record.attrs) if stated else None
    scale = clock_scale(record)
    record = on_seconds(record, scale)
    faults = faults_of(record)
    signals = resample_channels(record, faults)
    table = channel_table(record)
    findings = clock_findings(scale) + flag_findings(faults)
    findings += channel_findings(record, table, specification)
    shared, wrong = column_findings(record, signals)
    explanations, corrected, comparisons = find_mistakes(signals.without(wrong))
    mistaken = [channel for explanation in explanations for channel in explanation.repair.channels]
    findings += (
        shared + heading_findings(record, corrected, mistaken) + pressure_height_findings(corrected)
    )
    findings += temperature_findings(corrected, record)
    findings += kinematic_findings(explanations, comparisons, corrected, record)
    places = _places(specification, aircraft)
    moved = at_cg(corrected, places)
    kinematics = kinematic_table(moved)
    unseen = not_checked(corrected)
    if aircraft is not None:
        of_aircraft, unseen = _of_aircraft(moved, aircraft, record, database, unseen)
        findings += of_aircraft
    delays = find_lags(moved, places)
    answered, followed = (
        control_responses(_on_time(moved, delays, specification, record)),
        pilot_to_surface(corrected),
    )
    excited, matrix = axis_excitation(corrected), input_correlations(corrected)
    purpose = str(record.attrs.get("purpose", ""))
    findings += accuracy_findings(kinematics)
    findings += lag_findings(delays, specification, record)
    late = {
        channel for finding in findings if finding.kind == "lag" for channel in finding.channels
    }
    findings += answer_findings(answered, followed, moved, record, late)
    findings += excitation_findings(excited, matrix, corrected, manoeuvres(record), purpose)
    findings += quality_remarks(corrected, table, comparisons, signals)
    if all(
        finding.severity == "note" for finding in findings
    ):  # nothing is called sound that the reconstruction refuses
        findings += _refusals(record, aircraft, specification)
    as_read = compare_all(signals) if explanations else comparisons
    findings = by_severity(without_consequences(with_headings(findings)))
    facts = _facts(record, signals, aircraft)
    return Quality(
        facts,
        findings,
        table,
        kinematics,
        delays,
        answered,
        followed,
        excited,
        matrix,
        comparisons,
        as_read,
        signals,
        unseen,
    )


def _on_time(
    signals: ResampledChannels,
    delays: pd.DataFrame,
    specification: Instruments | None,
    record: xr.DataTree,
) -> ResampledChannels:
    """Return signals whose late channels are put back on time: a late flow angle makes its surface
    look reversed.
    """
    late = {
        channel
        for finding in lag_findings(delays, specification, record)
        for channel in finding.channels
    }
    measured = delays.set_index("channel")["delay"]
    shifts = {
        name: float(np.ravel(measured[name])[0])
        for name in late
        if name in measured and name in signals.values
    }
    return signals.with_values(
        {
            name: np.interp(signals.time + by, signals.time, signals[name])
            for name, by in shifts.items()
        }
    )


def _of_aircraft(
    moved: ResampledChannels,
    aircraft: Aircraft,
    record: xr.DataTree,
    database: xr.DataTree | None,
    unseen: pd.DataFrame,
) -> tuple[list[Finding], pd.DataFrame]:
    """Return what is wrong with the aircraft file, and what is not checked with what of it is not."""
    weight, no_weight = weight_findings(moved, aircraft, record, database)
    product, no_product = product_findings(moved, aircraft)
    shape = geometry_findings(aircraft)
    if any(finding.severity != "note" for finding in shape):
        weight = []  # they judge by S and b, which are wrong
    rows = [
        ("weight", "mass, and lift", no_weight),
        ("Ixz", "sign of Ixz, and pitching in rolls", no_product),
    ]
    more = [(name, title, (), reason) for name, title, reason in rows if reason]
    table = (
        pd.concat([unseen, pd.DataFrame(more, columns=unseen.columns)], ignore_index=True)
        if more
        else unseen
    )
    return [*shape, *inertia_findings(aircraft), *weight, *product], table


def _refusals(
    record: xr.DataTree, aircraft: Aircraft | None, specification: Instruments | None
) -> list[Finding]:
    """Return why the reconstruction refuses the whole record: of an aircraft its problem is set up,
    without one channels are looked for.
    """
    if not any("ax_imu" in leaf for leaf in record.children.values()):
        return []  # no record for a reconstruction; the note on absent channels states it
    try:
        windows = order_windows(record, None)
        if aircraft is not None and specification is not None:
            assemble_problem(record, aircraft, specification, windows, RATE, None)
        else:
            channels = MeasuredChannels(record, windows)
            demand_air_data(
                channels, next((name for name in ("q_c", *SPEEDS) if name in channels), "q_c")
            )
    except AeromatchError as error:
        problems = error.problems if isinstance(error, SchemaError) else [str(error)]
        text = f"the reconstruction refuses the whole record: {'; '.join(problems)}"
        severity = "warning" if specification is None else "error"
        return [
            Finding(
                severity,
                "reconstruction",
                ("record",),
                text,
                "add what is missing, or reconstruct windows without the fault",
            )
        ]
    return []


def _places(specification: Instruments | None, aircraft: Aircraft | None) -> dict[str, np.ndarray]:
    """Return the places of accelerometers and vanes from the c.g. [m]"""
    if specification is None or aircraft is None:
        return {}
    cg = np.asarray(aircraft.cg, float)
    given = {
        name: specification.of(name).position for name in ("ax_imu", "alpha_vane", "beta_vane")
    }
    return {
        name: np.asarray(position, float) - cg
        for name, position in given.items()
        if position is not None
    }


def _facts(
    record: xr.DataTree, signals: ResampledChannels, aircraft: Aircraft | None
) -> dict[str, Any]:
    facts = {
        key: str(record.attrs.get(key, "")) for key in ("title", "source_file", "start", "purpose")
    }
    return {
        **facts,
        "aircraft": aircraft.name if aircraft is not None else "",
        "begin": float(signals.time[0]),
        "end": float(signals.time[-1]),
        "in_flight": float(signals.flying.mean()),
        "columns_left_out": len(
            [name for name in str(record.attrs.get("unmapped", "")).split(", ") if name]
        ),
    }


_SEEN = {
    "alpha": "alpha_vane",
    "beta": "beta_vane",
    "ax": "ax_imu",
    "ay": "ay_imu",
    "az": "az_imu",
    "h": "h_baro",
}
_PRESSURE = ("p_static", "q_c")  # they belong to pressure height, and h is geometric
_LEAST = 50  # samples of a stretch that is informative
_JOINT = ("excitation", "collinear")
_LEAF = "manoeuvre"
_CERTAIN_GAIN = (
    0.5  # disagreement that a mistake must explain in a manoeuvre, twice that of a whole flight
)
_MOVED = 1.0 * DEGREE  # of a surface, below which a manoeuvre does not determine its sign


def findings_of(states: xr.Dataset) -> list[Finding]:
    """Return what is wrong with the states and controls of a manoeuvre.

    Parameters
    ----------
    states : Dataset (time,)
        Canonical names, SI, at the c.g.; stretches between gaps are looked at one by one, and what
        one excites is excited.

    Returns
    -------
    list of Finding
        Signs, units and axes of what kinematics tie together; signs of the surfaces by the answer
        of the aeroplane; no excitation; inputs that move together.
    """
    time = states["time"].values
    edges = [
        0,
        *(np.flatnonzero(np.diff(time) > GAP * np.median(np.diff(time))) + 1).tolist(),
        len(time),
    ]
    stretches = [states.isel(time=slice(a, b)) for a, b in pairwise(edges) if b - a > _LEAST]
    found = [_of_stretch(stretch) for stretch in stretches]
    return [
        finding
        for findings in found
        for finding in findings
        if finding.kind not in _JOINT or finding.name in _in_all(found)
    ]


def _in_all(found: Sequence[Sequence[Finding]]) -> set[str]:
    """Return the names of the findings that every one of several lists holds."""
    return (
        set.intersection(*({finding.name for finding in findings} for findings in found))
        if found
        else set()
    )


def _of_stretch(states: xr.Dataset) -> list[Finding]:
    """Return the findings of a stretch without gaps."""
    record = _as_record(states)
    signals = resample_channels(
        record, pd.DataFrame(columns=["leaf", "channel", "kind", "start", "stop"])
    )
    explanations, corrected, comparisons = find_mistakes(signals)
    if any(
        sum(e.before) - sum(e.after) < _CERTAIN_GAIN for e in explanations
    ):  # seconds of small motion explain themselves by anything
        explanations, corrected, comparisons = [], signals, {}
    answered = control_responses(corrected)
    found = kinematic_findings(explanations, comparisons, corrected, record)
    found += answer_findings(
        answered[answered["movement"] > _MOVED], pilot_to_surface(corrected), corrected, record
    )
    found += excitation_findings(
        axis_excitation(corrected), input_correlations(corrected), corrected, manoeuvres(record), ""
    )
    return without_consequences(found)


def _as_record(states: xr.Dataset) -> xr.DataTree:
    """Return the states as a record whose sensors sit at the c.g., under the names of the channels
    that show them.
    """
    whole = [
        str(name)
        for name, x in states.data_vars.items()
        if x.dims == ("time",) and x.dtype.kind == "f" and x.notnull().any()
    ]
    leaf = states[[name for name in whole if name not in (*_SEEN.values(), *_PRESSURE)]]
    leaf = leaf.rename({name: seen for name, seen in _SEEN.items() if name in leaf})
    time = states["time"].values.astype(float)
    return xr.DataTree.from_dict(
        {f"/{_LEAF}": leaf.assign_attrs(rate=(len(time) - 1) / (time[-1] - time[0]))}
    )


def report_faults(
    flown: Sequence[xr.Dataset], names: Sequence[str], known: Sequence[str] = ()
) -> None:
    """Refuse manoeuvres whose signs, units or axes are wrong; warn of missing excitation and of
    inputs that move together.

    What no manoeuvre excites, and inputs that move together in all of them, are reported once.

    Parameters
    ----------
    flown : sequence of Dataset (time,)
    names : sequence of str
        What to call them.
    known : sequence of str
        Kinds of findings that are not reported: ``excitation`` where the fit itself refuses what
        does not move.

    Raises
    ------
    SchemaError
        With every error found, by name.

    Warns
    -----
    AeromatchWarning
        Each warning by name.
    """
    found = [findings_of(states) for states in flown]
    problems = [
        f"{name}: {finding.name}: {finding.text}; correct the name map and reconstruct again"
        for name, findings in zip(names, found)
        for finding in findings
        if finding.severity == "error"
    ]
    everywhere = _in_all(found)
    reported: set[str] = set()
    for name, finding in (
        (name, finding) for name, findings in zip(names, found) for finding in findings
    ):
        alone = (
            finding.kind not in _JOINT or finding.name in everywhere
        )  # what one manoeuvre lacks another may have
        if (
            finding.severity == "warning"
            and finding.kind not in known
            and alone
            and finding.name not in reported
        ):
            reported.add(finding.name)
            warnings.warn(
                f"{name}: {finding.name}: {finding.text}; {finding.remedy}",
                AeromatchWarning,
                stacklevel=2,
            )
    if problems:
        raise SchemaError("records", problems)
