"""Table of the manoeuvres in a record, from the movements of the controls and the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flightmech.units import DEGREE
from flighttest.flight_programme.manoeuvre_finding.commanded_surfaces import commanded_part
from flighttest.flight_programme.manoeuvre_finding.excursions import (
    Excursion,
    FoundManoeuvre,
    find_movements,
    find_oscillations,
    named_oscillations,
    step_inputs,
)
from flighttest.flight_programme.manoeuvre_finding.responses import find_phugoids, find_responses
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, resample_channels
from flighttest.records.record import find_channel_leaf
from flighttest.records.signals.record_flags import flags

# Channels that a figure shows for each control; the first that the record has.
_CONTROLS = {
    "elevator": ("delta_e",),
    "aileron": ("delta_a",),
    "rudder": ("delta_r",),
    "throttle": ("engine1.throttle", "engine1.n1"),
}
_MOTION = ("V", "V_cas", "phi", "beta_vane", "az_imu")
_COLOURS = ("#2a6f97", "#bc6c25")

SURFACES = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
# Smallest movement of a surface that counts: this angle, or this multiple of its noise.
LEAST_SURFACE = 0.6 * DEGREE
_NOISE = 8.0
# Clear movements are this multiple of the smallest. They are reported without a recognised input.
_CLEAR = 3.0
# Longest time between clear movements that form one unknown manoeuvre [s].
_UNKNOWN_PAUSE = 4.0
# An input with less confidence is unknown.
_DOUBTFUL = 0.25
_PULSES = ("pulse", "block")
# Longest time from a pulse of the elevator to the phugoid that it excites [s].
_BEFORE = 5.0
# Time before the first movement that belongs to an input [s].
_LEAD = 0.5
# Longest response after the last movement [s].
_RESPONSE = 8.0
# A step near another one is part of no input; the movements of a damper are such steps.
_UNKNOWN_NOTE = "no known test input: it does not rest around its steps"
COLUMNS = ["manoeuvre", "control", "start", "end", "note", "confidence"]


@dataclass(frozen=True)
class _SurfaceMovements:
    """Excursions of a surface in flight, and the smallest size that counts [rad]."""

    excursions: list[Excursion]
    least: float


def draw_manoeuvres(record: xr.DataTree, table: pd.DataFrame, target: str | Path) -> None:
    """Draw controls and motion over time, with the rows of the table shaded and numbered.

    Parameters
    ----------
    record : DataTree
        Flight record.
    table : DataFrame
        With the columns of `flighttest.records.marked_manoeuvres`.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).

    Raises
    ------
    SchemaError
        The format is not supported, or the record has neither a control nor a channel of motion.
    AeromatchError
        matplotlib is not installed.
    """
    demand_drawable(target)
    panels = _select_panels(record)
    if not panels:
        raise SchemaError(
            "figure", ["the record has no control and no channel of motion; extend the name map"]
        )
    figure = new_figure(16.0, 1.5 * len(panels) + 1.2)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (control, name) in zip(axes, panels, strict=True):
        _draw_channel(ax, record, name)
        for number, row in enumerate(table.itertuples(), start=1):
            _shade_manoeuvre(ax, row, control=control, number=number)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(str(record.attrs.get("title", "")), fontsize="medium")
    write_figure(figure, target, dpi=120)


def _select_panels(record: xr.DataTree) -> list[tuple[str, str]]:
    """Return control and channel of each panel; the control is empty for a channel of motion."""
    panels = []
    for control, names in _CONTROLS.items():
        recorded = [name for name in names if find_channel_leaf(record, name)]
        if recorded:
            panels.append((control, recorded[0]))
    for name in _MOTION:
        # the calibrated airspeed is drawn only if the true airspeed is missing
        if name == "V_cas" and find_channel_leaf(record, "V"):
            continue
        if find_channel_leaf(record, name):
            panels.append(("", name))
    return panels


def _draw_channel(ax: Any, record: xr.DataTree, name: str) -> None:
    signal = record[str(find_channel_leaf(record, name))].to_dataset()[name]
    unit, factor = signal.attrs.get("units", ""), 1.0
    if unit == "rad":
        unit, factor = "deg", np.degrees(1.0)
    ax.plot(signal["time"].values, factor * signal.values, color="black", linewidth=0.6)
    ax.set_ylabel(f"{name}\n[{unit}]", fontsize="small")
    ax.grid(linewidth=0.3)
    ax.margins(x=0.01)


def _shade_manoeuvre(ax: Any, row: Any, *, control: str, number: int) -> None:
    """Shade one row of the table in a panel, and name it in the panels of its controls."""
    colour = _COLOURS[number % 2]
    if not control:
        ax.axvspan(row.start, row.end, color=colour, alpha=0.1, linewidth=0)
        return
    has_control = control in str(row.control).split()
    # a row without a control is shaded in every panel
    if has_control or not row.control:
        ax.axvspan(row.start, row.end, color=colour, alpha=0.3, linewidth=0)
    if has_control:
        # names alternate between two heights, because rows may have the same start
        height = 0.98 if number % 2 else 0.5
        ax.annotate(
            f"{number} {row.manoeuvre}",
            (row.start, height),
            xycoords=("data", "axes fraction"),
            va="top",
            fontsize=6,
        )


def find_manoeuvres(record: xr.DataTree) -> pd.DataFrame:
    """Return the manoeuvres that the controls and the motion of a record show.

    Parameters
    ----------
    record : DataTree
        Flight record with channels of motion; its own marks are not used.  Surfaces are
        ``delta_e``, ``delta_a`` and ``delta_r``, levers ``engine1.throttle`` or, without them,
        ``engine1.n1``.  Where a damper moves a surface besides the pilot, ``pedal``, ``wheel`` or
        ``column`` show his inputs (`commanded_part`).

    Returns
    -------
    DataFrame
        Columns ``manoeuvre control start end note confidence``, as in
        `flighttest.records.marked_manoeuvres`, in order of time.

        ``confidence`` is 1 if sizes and durations agree exactly with the definition of the
        manoeuvre.  It is 0 at the largest deviation that is accepted.

        ``manoeuvre`` is one of ``3211 doublet pulse phugoid spiral sweep multisine
        pull_up_push_down steady_sideslip throttle_chop throttle_slam throttle_chop_and_slam
        power_change flaps_out flaps_in gear_out gear_in speedbrake_out speedbrake_in
        level_acceleration level_deceleration unknown``.  A clear fast movement of a surface that
        is none of the others is ``unknown``, with confidence 0.

        An input lasts from 0.5 s before its first movement to the end of the free response.  The
        response ends at the next movement of a surface, 8 s after the last movement at most. [s]

        A ``phugoid`` is a period of the phugoid with elevator and levers at rest, in which the
        speed oscillates.  It includes the pulse of the elevator that excites it.  A
        ``power_change`` is a chop or slam with constant power for 10 s after it, to which the
        aeroplane responds.  A ``spiral`` is 20 s in a bank with all controls at rest.

    Raises
    ------
    SchemaError
        The record has no channel of motion, or no control.

    References
    ----------
    .. [Jategaonkar2015] R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015,
       chapter 2.
    """
    signals = resample_channels(record, flags(record))
    _require_control(signals)
    surfaces = {
        control: _surface_movements(signals, name)
        for name, control in SURFACES.items()
        if name in signals
    }
    return _tabulate(_recognise(surfaces, signals), signals)


def _recognise(
    surfaces: Mapping[str, _SurfaceMovements], signals: ResampledChannels
) -> list[FoundManoeuvre]:
    """Return the manoeuvres of all kinds, with those that explain each other merged."""
    inputs = _find_inputs(surfaces)
    waves = _without_overlap(_find_waves(surfaces), inputs)

    # ailerons and rudder excite a phugoid too, so an input of these is not free motion
    lateral = [entry for entry in inputs if entry.control != "elevator"]
    phugoids = []
    for phugoid in _without_overlap(find_phugoids(signals), lateral):
        phugoids.append(_include_pulse(phugoid, inputs))
    # the pulse that excites a phugoid is a part of the phugoid
    pulses = [entry for entry in inputs if entry.kind == "pulse"]
    phugoid_pulses = [pulse for pulse in pulses if _overlaps_any(pulse, phugoids)]
    inputs = [entry for entry in inputs if entry not in phugoid_pulses]

    excursions = []
    for movements in surfaces.values():
        excursions += movements.excursions
    recognised = [*phugoids, *(_include_response(entry, excursions, signals) for entry in inputs)]
    recognised += [entry for entry in [*waves, *find_responses(signals)] if entry.kind != "unknown"]
    recognised = _drop_pull_ups(recognised, inputs)

    unknown = []
    for control, movements in surfaces.items():
        for entry in _find_unknown(control, movements):
            if not _is_explained(entry, recognised):
                unknown.append(entry)
    return [*recognised, *unknown]


def _require_control(signals: ResampledChannels) -> None:
    levers = [name for name in signals.values if name.endswith((".throttle", ".n1"))]
    if not levers and not set(SURFACES) & set(signals.values):
        raise SchemaError(
            "manoeuvres",
            [
                f"the record has no control channel; map at least one of {', '.join(SURFACES)}, "
                "or a lever such as engine1.throttle, in the name map"
            ],
        )


def named_by_response(record: xr.DataTree, marks: pd.DataFrame) -> pd.DataFrame:
    """Return marks with the pulses that excite a phugoid named ``phugoid``.

    A pulse of the elevator is a mark called ``pulse`` or ``block``.  It is renamed if a phugoid
    follows in the motion.

    Parameters
    ----------
    record : DataTree
        Flight record with channels of motion.
    marks : DataFrame
        ``manoeuvre control start end note``, as `flighttest.records.marked_manoeuvres` has them.
    """
    pulses = marks["manoeuvre"].isin(_PULSES) & (marks["control"] == "elevator")
    if not pulses.any():
        return marks
    signals = resample_channels(record, flags(record))
    phugoids = find_phugoids(signals)
    named = marks.copy()
    for number, row in enumerate(marks.to_dict("records")):
        if not pulses.iloc[number]:
            continue
        start, end = float(row["start"]), float(row["end"])
        for phugoid in phugoids:
            # the phugoid has to cover more than half of the mark
            common = min(end, phugoid.end) - max(start, phugoid.start)
            if common > 0.5 * (end - start):
                named.loc[named.index[number], "manoeuvre"] = "phugoid"
                break
    return named


def _surface_movements(signals: ResampledChannels, name: str) -> _SurfaceMovements:
    """Return the excursions of a surface in flight, and the smallest that counts.

    They are those of the part that the pilot commands, where more test inputs stand in it.
    """
    movements = _movements_of(signals, signals[name])
    commanded = commanded_part(signals, name)
    if commanded is None:
        return movements
    own = _movements_of(signals, commanded)
    control = SURFACES[name]
    is_clearer = _count_inputs(control, own) > _count_inputs(control, movements)
    return own if is_clearer else movements


def _count_inputs(control: str, movements: _SurfaceMovements) -> int:
    """Return the number of step inputs that are not doubtful."""
    entries = step_inputs(control, movements.excursions)
    return sum(entry.confidence > _DOUBTFUL for entry in entries)


def _movements_of(signals: ResampledChannels, x: np.ndarray) -> _SurfaceMovements:
    """Return the excursions of a deflection in flight, and the smallest that counts. [rad]"""
    # Standard deviation of white noise. The median of its magnitude is 0.674 standard deviations,
    # and a second difference has sqrt(6) times the standard deviation: 0.674 * 2.449 = 1.65.
    noise = float(np.median(np.abs(np.diff(x, 2)))) / 1.65
    least = max(LEAST_SURFACE, _NOISE * noise)
    excursions = []
    for movement in find_movements(signals.time, x, least):
        if signals.flying[np.searchsorted(signals.time, movement.middle)]:
            excursions.append(movement)
    return _SurfaceMovements(excursions, least)


def _find_inputs(surfaces: Mapping[str, _SurfaceMovements]) -> list[FoundManoeuvre]:
    """Return the step inputs of all surfaces that are not doubtful."""
    inputs = []
    for control, movements in surfaces.items():
        for entry in step_inputs(control, movements.excursions):
            reduced = _reduce_confidence(entry, surfaces)
            if reduced.confidence > _DOUBTFUL:
                inputs.append(reduced)
    return inputs


def _find_waves(surfaces: Mapping[str, _SurfaceMovements]) -> list[FoundManoeuvre]:
    """Return the oscillations of all surfaces as multisine, sweep or unknown."""
    oscillations = []
    for control, movements in surfaces.items():
        oscillations += find_oscillations(control, movements.excursions, 2.0 * movements.least)
    return named_oscillations(oscillations)


def _reduce_confidence(
    entry: FoundManoeuvre, surfaces: Mapping[str, _SurfaceMovements]
) -> FoundManoeuvre:
    """Return an input with less confidence if other surfaces move at the same time."""
    # largest movement of each surface during the input, in units of its smallest that counts
    largest = {}
    for control, movements in surfaces.items():
        sizes = [
            abs(part.size)
            for part in movements.excursions
            if part.start < entry.end and entry.start < part.end
        ]
        largest[control] = max(sizes, default=0.0) / movements.least
    others = [size for control, size in largest.items() if control != entry.control]
    ratio = max(others, default=0.0) / largest[entry.control]
    return replace(entry, confidence=entry.confidence * max(0.0, 1.0 - ratio**2))


def _include_pulse(phugoid: FoundManoeuvre, inputs: Sequence[FoundManoeuvre]) -> FoundManoeuvre:
    """Return a phugoid from the pulse of the elevator that excites it."""
    pulses = []
    for entry in inputs:
        is_pulse = (entry.kind, entry.control) == ("pulse", "elevator")
        if is_pulse and abs(phugoid.start - entry.end) < _BEFORE:
            pulses.append(entry)
    if not pulses:
        return phugoid
    return replace(phugoid, start=pulses[-1].start - _LEAD, confidence=pulses[-1].confidence)


def _include_response(
    entry: FoundManoeuvre, excursions: Sequence[Excursion], signals: ResampledChannels
) -> FoundManoeuvre:
    """Return an input with the quiet time before it and the free response after it."""
    later = [part.start for part in excursions if part.start > entry.end + signals.step]
    return replace(
        entry,
        start=max(entry.start - _LEAD, float(signals.time[0])),
        end=min([entry.end + _RESPONSE, float(signals.time[-1]), *later]),
    )


def _drop_pull_ups(
    recognised: Sequence[FoundManoeuvre], inputs: Sequence[FoundManoeuvre]
) -> list[FoundManoeuvre]:
    """Drop the pull-ups that are the response to a step input.

    The load factor of a 3-2-1-1 or of a doublet looks like the load factor of a pull-up.
    """
    stepped = [entry for entry in inputs if entry.kind != "pulse"]
    remaining = []
    for entry in recognised:
        if entry.kind != "pull_up_push_down" or not _overlaps_any(entry, stepped):
            remaining.append(entry)
    return remaining


def _find_unknown(control: str, movements: _SurfaceMovements) -> list[FoundManoeuvre]:
    """Return the clear fast movements of a surface; those close to each other are one row."""
    rows: list[FoundManoeuvre] = []
    for movement in movements.excursions:
        if not movement.fast or abs(movement.size) < _CLEAR * movements.least:
            continue
        if rows and movement.start - rows[-1].end < _UNKNOWN_PAUSE:
            rows[-1] = replace(rows[-1], end=movement.end)
        else:
            rows.append(
                FoundManoeuvre(
                    kind="unknown",
                    control=control,
                    start=movement.start,
                    end=movement.end,
                    confidence=0.0,
                )
            )
    return rows


def _overlap(first: FoundManoeuvre, second: FoundManoeuvre) -> bool:
    return first.start < second.end and second.start < first.end


def _overlaps_any(entry: FoundManoeuvre, entries: Sequence[FoundManoeuvre]) -> bool:
    return any(_overlap(entry, candidate) for candidate in entries)


def _without_overlap(
    entries: Sequence[FoundManoeuvre], excluded: Sequence[FoundManoeuvre]
) -> list[FoundManoeuvre]:
    """Return the entries that have no time in common with an excluded entry."""
    return [entry for entry in entries if not _overlaps_any(entry, excluded)]


def _is_explained(entry: FoundManoeuvre, recognised: Sequence[FoundManoeuvre]) -> bool:
    """Return whether a recognised manoeuvre of the same control overlaps a movement."""
    same_control = [peer for peer in recognised if entry.control in peer.control.split()]
    return _overlaps_any(entry, same_control)


def _tabulate(entries: Sequence[FoundManoeuvre], signals: ResampledChannels) -> pd.DataFrame:
    """Return the table of the manoeuvres, in order of time and within the record."""
    first, last = float(signals.time[0]), float(signals.time[-1])
    rows = []
    for entry in sorted(entries, key=lambda entry: entry.start):
        start, end = max(entry.start, first), min(entry.end, last)
        confidence = round(float(entry.confidence), 2)
        note = _UNKNOWN_NOTE if entry.kind == "unknown" else "found"
        rows.append((entry.kind, entry.control, round(start, 2), round(end, 2), note, confidence))
    return pd.DataFrame(rows, columns=COLUMNS)
