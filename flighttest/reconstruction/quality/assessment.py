"""Assessment of the quality of a flight record by all checks.

The checks run in order. Each check works on channels without the mistakes that earlier checks
found.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SchemaError
from flighttest.reconstruction.problem.assembly import assemble_problem
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
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
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
from flighttest.reconstruction.quality.declarations.air_temperature import (
    climb_findings,
    explain_by_fahrenheit,
    temperature_findings,
)
from flighttest.reconstruction.quality.declarations.centre_of_gravity import centre_findings
from flighttest.reconstruction.quality.declarations.columns import (
    column_findings,
    pressure_height_findings,
)
from flighttest.reconstruction.quality.declarations.database_match import (
    gain_findings,
    reference_findings,
)
from flighttest.reconstruction.quality.declarations.geometry import geometry_findings, is_airship
from flighttest.reconstruction.quality.declarations.headings import heading_findings, with_headings
from flighttest.reconstruction.quality.declarations.inertia import (
    inertia_findings,
    product_findings,
)
from flighttest.reconstruction.quality.declarations.inertia_scale import exchange_findings
from flighttest.reconstruction.quality.declarations.rigging import rigging_findings
from flighttest.reconstruction.quality.declarations.weight import MASS_LEVEL, weight_findings
from flighttest.reconstruction.quality.engines.engines import engine_findings, lever_findings
from flighttest.reconstruction.quality.finding import (
    Finding,
    by_severity,
    late_channels,
    without_consequences,
    without_doubts,
    without_explained,
)
from flighttest.reconstruction.quality.instruments.instrument_sizes import (
    instrument_size_findings,
)
from flighttest.reconstruction.quality.instruments.positions import (
    position_findings,
    sensor_positions,
    side_findings,
)
from flighttest.reconstruction.quality.navigation.air_data_closure import (
    closure_findings,
    level_not_checked,
)
from flighttest.reconstruction.quality.navigation.airspeed_scale import airspeed_findings
from flighttest.reconstruction.quality.navigation.heading_reference import (
    compass_findings,
    heading_reference_findings,
)
from flighttest.reconstruction.quality.navigation.inertial_motion import MotionFits, fit_motion
from flighttest.reconstruction.quality.navigation.lever_arm import lever_arm_findings
from flighttest.reconstruction.quality.navigation.motion_delays import (
    Unchecked,
    delays_not_checked,
    merge_delays,
    motion_delays,
)
from flighttest.reconstruction.quality.record_notes import quality_remarks
from flighttest.reconstruction.quality.recording.changing_units import changing_unit_findings
from flighttest.reconstruction.quality.recording.clock_scale import (
    clock_findings,
    clock_scale,
    on_seconds,
)
from flighttest.reconstruction.quality.recording.control_ranges import control_range_findings
from flighttest.reconstruction.quality.recording.exchanged_surfaces import (
    answers_not_checked,
    exchanged_findings,
    with_surfaces,
    without_surfaces,
)
from flighttest.reconstruction.quality.recording.gap_jumps import gap_jumps
from flighttest.reconstruction.quality.recording.lost_samples import lost_not_checked, lost_samples
from flighttest.reconstruction.quality.recording.offsets import (
    gyro_findings,
    gyro_offsets,
    offset_findings,
    slip_not_checked,
    without_constant_errors,
    without_offsets,
)
from flighttest.reconstruction.quality.recording.smoothed_surfaces import (
    smoothed_surfaces,
    smoothing_findings,
)
from flighttest.reconstruction.quality.recording.staircases import staircase_findings
from flighttest.reconstruction.quality.recording.unit_mounting import (
    mounting_findings,
    unit_mounting,
)
from flighttest.reconstruction.quality.result import Quality
from flighttest.records.record import marked_manoeuvres
from flighttest.records.sensors.instruments import SPEEDS, Instruments, instruments_of
from flighttest.records.sensors.measurements import MeasuredChannels, demand_air_data, order_windows

RATE = 50.0  # Hz, of the path in the test of the reconstruction


def assess(
    record: xr.DataTree, aircraft: Aircraft | None = None, database: xr.DataTree | None = None
) -> Quality:
    """Return the quality of a flight record.

    Parameters
    ----------
    record : DataTree
        As `flighttest.read` returns it.
    aircraft : Aircraft, optional
        With its instruments: positions, noise and latency. Its geometry, inertia and mass are
        checked too. Without an aircraft, accelerometers and vanes are assumed at the c.g., and
        limits of common installations apply to delays.
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
    The order of the checks is: unit of the clock; clocks and samples of each channel; columns that
    stand for two channels; kinematics and air data, with the search for the mistake that explains a
    disagreement. The next checks use channels without such mistakes: headings, the aircraft file,
    scale errors, delays, responses to the controls, and excitation.

    References
    ----------
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for
       fixed-wing UAS, section IV.B.
    """
    specification = None
    if aircraft is not None and (aircraft.instruments or "instruments" in record.attrs):
        specification = instruments_of(aircraft, record.attrs)
    # clocks and samples
    scale = clock_scale(record)
    record = on_seconds(record, scale)
    faults = faults_of(record)
    sample_findings = flag_findings(faults)
    lost, lost_flags = lost_samples(record, faults)
    faults = pd.concat([faults, lost_flags], ignore_index=True)
    signals = resample_channels(record, faults)
    channels = channel_table(record)
    findings = clock_findings(scale) + sample_findings + lost
    findings += gap_jumps(record, faults)
    findings += channel_findings(record, channels, specification) + staircase_findings(record)
    # mistakes of columns, signs, units and axes
    shared, wrong = column_findings(record, signals)
    known = signals.without(wrong)
    turned, known = mounting_findings(unit_mounting(known), known)
    gyros = gyro_offsets(known)
    explanations, corrected, comparisons = find_mistakes(without_offsets(known, gyros))
    mistaken: list[str] = []
    for explanation in explanations:
        mistaken += explanation.repair.channels
    findings += shared + turned
    findings += gyro_findings(gyros, record)
    findings += lever_findings(record, signals)
    ranges, no_ranges = control_range_findings(signals, record)
    findings += ranges
    findings += heading_findings(record, corrected, mistaken)
    findings += pressure_height_findings(corrected)
    findings += temperature_findings(corrected, record)
    findings += kinematic_findings(explanations, comparisons, signals=corrected, record=record)
    # the aircraft file
    findings += instrument_size_findings(specification)
    positions = sensor_positions(specification, aircraft)
    if aircraft is not None:
        misplaced = position_findings(positions, aircraft)
        findings += misplaced
        # An impossible place would look like a delay of the channel. The c.g. is nearer.
        for finding in misplaced:
            for name in finding.channels:
                del positions[name]
    corrected_at_cg = at_cg(corrected, positions)
    kinematics = kinematic_table(corrected_at_cg)
    constant = offset_findings(kinematics, corrected_at_cg, record)
    recorded_at_cg = corrected_at_cg
    corrected_at_cg = without_constant_errors(recorded_at_cg, constant)
    findings += constant
    unseen = lost_not_checked(record) + slip_not_checked(kinematics, recorded_at_cg)
    unchecked = _append_rows(not_checked(corrected), unseen + no_ranges)
    if aircraft is not None:
        declared, reasons = _aircraft_findings(
            corrected_at_cg, aircraft, record=record, database=database, recorded=recorded_at_cg
        )
        findings += declared
        unchecked = _append_rows(unchecked, reasons)
    # accuracy, delays, controls
    motion = fit_motion(corrected_at_cg)
    usual_delays = find_lags(corrected_at_cg, positions)
    delays = merge_delays(usual_delays, motion_delays(motion, positions))
    lags = lag_findings(delays, specification, record)
    on_time = _undelayed(corrected_at_cg, delays, lags)
    exchanged = exchanged_findings(on_time, record)
    on_time, corrected = with_surfaces(on_time, exchanged), with_surfaces(corrected, exchanged)
    smoothed, alike = smoothed_surfaces(on_time)
    findings += smoothing_findings(smoothed)
    changing = changing_unit_findings(alike)
    findings += changing
    responses = control_responses(alike)
    unchecked = _append_rows(unchecked, answers_not_checked(responses, on_time))
    gains, no_gain = gain_findings(responses, alike, aircraft, database)
    unchecked = _append_rows(unchecked, no_gain)
    hands = pilot_to_surface(corrected)
    excitation, correlation = axis_excitation(corrected), input_correlations(corrected)
    findings += accuracy_findings(kinematics)
    findings += lags
    placed, no_place = lever_arm_findings(on_time, positions)
    findings += placed
    unchecked = _append_rows(unchecked, no_place)
    references, reasons = _reference_findings(
        motion, comparisons, on_time, record=record, late=late_channels(lags), placed=positions
    )
    findings = without_doubts(references, findings) + references
    unchecked = _append_rows(unchecked, reasons)
    findings = without_explained(findings)
    late = late_channels(findings)
    answers = answer_findings(responses, hands, corrected_at_cg, record, late)
    findings += exchanged + without_surfaces(answers, exchanged) + gains
    purpose = str(record.attrs.get("purpose", ""))
    findings += excitation_findings(
        excitation, correlation, corrected, marked_manoeuvres(record), purpose
    )
    findings += quality_remarks(corrected, channels, comparisons, signals, record)
    # A record is not sound if the reconstruction refuses it.
    if all(finding.severity == "note" for finding in findings):
        findings += _refusals(record, aircraft, specification)
    as_read = comparisons
    if explanations:
        as_read = compare_all(signals)
    return Quality(
        facts=_facts(record, signals, aircraft),
        findings=by_severity(without_consequences(with_headings(findings))),
        channels=channels,
        kinematics=kinematics,
        delays=delays,
        answers=responses,
        hands=hands,
        excitation=excitation,
        correlation=correlation,
        comparisons=comparisons,
        as_read=as_read,
        signals=signals,
        not_checked=unchecked,
        faults=faults,
    )


def _reference_findings(
    motion: MotionFits,
    comparisons: dict[str, RelationCheck],
    signals: ResampledChannels,
    *,
    record: xr.DataTree,
    late: set[str],
    placed: Collection[str],
) -> tuple[list[Finding], Unchecked]:
    """Return findings on heading, airspeed and air data, and what of them was not checked.

    Air data that do not follow from each other are reported before a scale of the airspeed, which
    would be the same mistake once more.
    """
    heading, no_heading = heading_reference_findings(motion, signals)
    closure = closure_findings(comparisons, signals, late)
    airspeed, no_airspeed = airspeed_findings(motion, signals, record)
    temperature, no_temperature = climb_findings(signals)
    compass, no_compass = compass_findings(signals)
    airspeed = explain_by_fahrenheit(airspeed, signals, record)
    findings = [*heading, *compass, *closure, *airspeed, *temperature]
    no_heading += no_compass
    unchecked = (
        delays_not_checked(motion, signals, placed) + no_heading + no_airspeed + no_temperature
    )
    return findings, unchecked + level_not_checked(comparisons, signals)


def _undelayed(
    signals: ResampledChannels, delays: pd.DataFrame, lags: list[Finding]
) -> ResampledChannels:
    """Return signals without the delays of late channels.

    Why: the sign of a surface looks reversed if the flow angle is late.
    """
    delay_of = delays.set_index("channel")["delay"]
    shifted = {}
    for name in late_channels(lags):
        if name in delay_of and name in signals.values:
            # the first of several delays of a channel
            delay = float(np.ravel(delay_of[name])[0])
            shifted[name] = np.interp(signals.time + delay, signals.time, signals[name])
    return signals.with_values(shifted)


def _aircraft_findings(
    signals: ResampledChannels,
    aircraft: Aircraft,
    record: xr.DataTree,
    database: xr.DataTree | None,
    recorded: ResampledChannels,
) -> tuple[list[Finding], Unchecked]:
    """Return findings on the aircraft file, and the checks of it that are not possible.

    The lift of the `recorded` vertical acceleration must agree with the mass too: its constant
    error may be an error of scale.
    """
    weight, no_weight = weight_findings(signals, aircraft, record, database)
    if not weight and "az_imu" in recorded:
        # the flow angles stay corrected: an offset of theirs changes the lift coefficient
        other = signals.with_values({"az_imu": recorded["az_imu"]})
        weight, _ = weight_findings(other, aircraft, record, database)
    product, no_product = product_findings(signals, aircraft)
    geometry = geometry_findings(aircraft)
    # The checks of the weight use S and b, which may be wrong.
    if any(finding.severity != "note" for finding in geometry):
        weight = []
    unchecked: Unchecked = []
    if no_weight:
        unchecked.append(("weight", "mass, and lift", (), no_weight))
    if not is_airship(aircraft):
        unchecked.append(("mass_level", "mass, to a tenth", (), MASS_LEVEL))
    if no_product:
        unchecked.append(("Ixz", "sign of Ixz, and pitching in rolls", (), no_product))
    findings = [*geometry, *inertia_findings(aircraft), *weight, *product]
    findings += side_findings(aircraft)
    findings += reference_findings(aircraft, database)
    findings += rigging_findings(signals, aircraft)
    for check in (exchange_findings, centre_findings, engine_findings):
        found, reasons = check(signals, aircraft)
        findings += found
        unchecked += reasons
    return findings, unchecked


def _append_rows(table: pd.DataFrame, rows: list[Any]) -> pd.DataFrame:
    if not rows:
        return table
    return pd.concat([table, pd.DataFrame(rows, columns=table.columns)], ignore_index=True)


def _refusals(
    record: xr.DataTree, aircraft: Aircraft | None, specification: Instruments | None
) -> list[Finding]:
    """Return the reason why the reconstruction refuses the complete record.

    With an aircraft the problem of the reconstruction is assembled. Without one the check covers
    the channels only.
    """
    # A record without accelerometers is not for a reconstruction. A note states what is absent.
    if not any("ax_imu" in leaf for leaf in record.children.values()):
        return []
    try:
        if aircraft is not None and specification is not None:
            assemble_problem(record, aircraft, rate=RATE)
        else:
            channels = MeasuredChannels(record, order_windows(record, None))
            demand_air_data(channels, _airspeed_channel(channels))
    except AeromatchError as error:
        problems = [str(error)]
        if isinstance(error, SchemaError):
            problems = error.problems
        text = f"the reconstruction refuses the whole record: {'; '.join(problems)}"
        remedy = "add what is missing, or reconstruct windows without the fault"
        severity = "error"
        if specification is None:
            severity = "warning"
        return [Finding(severity, "reconstruction", ("record",), text=text, remedy=remedy)]
    return []


def _airspeed_channel(channels: MeasuredChannels) -> str:
    """Return the first airspeed of a record, or q_c."""
    for name in ("q_c", *SPEEDS):
        if name in channels:
            return name
    return "q_c"


def _facts(
    record: xr.DataTree, signals: ResampledChannels, aircraft: Aircraft | None
) -> dict[str, Any]:
    """Return the facts about a record for the head of a report."""
    keys = ("title", "source_file", "start", "purpose")
    facts: dict[str, Any] = {key: str(record.attrs.get(key, "")) for key in keys}
    facts["aircraft"] = ""
    if aircraft is not None:
        facts["aircraft"] = aircraft.name
    facts["begin"] = float(signals.time[0])
    facts["end"] = float(signals.time[-1])
    facts["in_flight"] = float(signals.flying.mean())
    unmapped = str(record.attrs.get("unmapped", "")).split(", ")
    facts["columns_left_out"] = len([name for name in unmapped if name])
    return facts
