"""`find_manoeuvres`: the table of what was flown, from the movements of the controls and the
motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flightmech.units import DEGREE
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

_CONTROLS = {
    "elevator": ("delta_e",),
    "aileron": ("delta_a",),
    "rudder": ("delta_r",),
    "throttle": ("engine1.throttle", "engine1.n1"),
}
_MOTION = ("V", "V_cas", "phi", "beta_vane", "az_imu")
_COLOURS = ("#2a6f97", "#bc6c25")


def draw_manoeuvres(record: xr.DataTree, table: pd.DataFrame, target: str | Path) -> None:
    """Draw controls and motion over time with the manoeuvres shaded and numbered as the rows of the
    table.

    Parameters
    ----------
    record : DataTree
        Flight record.
    table : DataFrame
        With the columns of `flighttest.manoeuvres`.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).

    Raises
    ------
    SchemaError
        A format that is not drawn; a record without any control or channel of motion.
    AeromatchError
        matplotlib is not installed.
    """
    demand_drawable(target)
    shown = [
        (label, found) for label, names in _CONTROLS.items() if (found := _first(record, names))
    ]
    shown += [
        ("", name)
        for name in _MOTION
        if find_channel_leaf(record, name)
        and not (name == "V_cas" and find_channel_leaf(record, "V"))
    ]
    if not shown:
        raise SchemaError(
            "figure", ["the record has no control and no channel of motion; extend the name map"]
        )
    figure = new_figure(16.0, 1.5 * len(shown) + 1.2)
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (label, name) in zip(axes, shown, strict=True):
        _draw(ax, record, name)
        for number, row in enumerate(table.itertuples(), start=1):
            if not label or label in str(row.control).split() or not row.control:
                ax.axvspan(
                    row.start,
                    row.end,
                    color=_COLOURS[number % 2],
                    alpha=0.3 if label else 0.1,
                    linewidth=0,
                )
            if label and label in str(row.control).split():
                place = (
                    row.start,
                    0.98 if number % 2 else 0.5,
                )  # in turn, since rows may share their start
                ax.annotate(
                    f"{number} {row.manoeuvre}",
                    place,
                    xycoords=("data", "axes fraction"),
                    va="top",
                    fontsize=6,
                )
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(str(record.attrs.get("title", "")), fontsize="medium")
    write_figure(figure, target, dpi=120)


def _first(record: xr.DataTree, names: tuple[str, ...]) -> str | None:
    return next((name for name in names if find_channel_leaf(record, name)), None)


def _draw(ax, record: xr.DataTree, name: str) -> None:
    signal = record[str(find_channel_leaf(record, name))].to_dataset()[name]
    units = signal.attrs.get("units", "")
    shown, factor = ("deg", np.degrees(1.0)) if units == "rad" else (units, 1.0)
    ax.plot(signal["time"].values, factor * signal.values, color="black", linewidth=0.6)
    ax.set_ylabel(f"{name}\n[{shown}]", fontsize="small")
    ax.grid(linewidth=0.3)
    ax.margins(x=0.01)


SURFACES = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
_LEAST = 0.6 * DEGREE  # smallest movement of a surface that counts
_NOISE = 8.0  # and standard deviations of its noise
_CLEAR = 3.0  # times the smallest: movements that are reported even when no input is recognised
_DOUBTFUL = 0.25  # an input with less confidence is unknown
_PULSES = ("pulse", "block")
_BEFORE = 5.0  # s from a pulse to the rest of the elevator after it
_LEAD = 0.5  # s before the first movement
_RESPONSE = 8.0  # s after the last movement, unless a control moves earlier
COLUMNS = ["manoeuvre", "control", "start", "end", "note", "confidence"]


def find_manoeuvres(record: xr.DataTree) -> pd.DataFrame:
    """Return the manoeuvres that the controls and the motion of a record show.

    Parameters
    ----------
    record : DataTree
        Flight record with channels of motion; its own marks are not used.  Surfaces are
        ``delta_e``, ``delta_a`` and ``delta_r``, levers ``engine1.throttle`` or, without them,
        ``engine1.n1``.

    Returns
    -------
    DataFrame
        ``manoeuvre control start end note confidence`` in order of time, as `flighttest.manoeuvres`
        has them; ``confidence`` is 1 where sizes and durations agree with the definition of the
        manoeuvre exactly, and goes to 0 at the largest deviation that is still accepted.
        ``manoeuvre`` is one of ``3211 doublet pulse phugoid spiral sweep multisine
        pull_up_push_down steady_sideslip throttle_chop throttle_slam throttle_chop_and_slam
        power_change flaps_out flaps_in gear_out gear_in speedbrake_out speedbrake_in
        level_acceleration level_deceleration unknown``; unknown are clear fast movements of a
        surface that are none of these, with confidence 0.  An input lasts from 0.5 s before its
        first movement to the end of the free response: the next movement of a surface, 8 s after
        the last at most. [s]  A period of the phugoid with elevator and levers at rest, in which
        the speed oscillates, is a ``phugoid``, with the pulse of the elevator that began it; a chop
        or slam with constant power for 10 s after it, to which the aeroplane responds, a
        ``power_change``; 20 s in a bank with all controls at rest a ``spiral``.

    Raises
    ------
    SchemaError
        No channel of motion, or no control.

    References
    ----------
    .. [Jategaonkar2015] R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter 2.
    """
    signals = resample_channels(record, flags(record))
    levers = [name for name in signals.values if name.endswith((".throttle", ".n1"))]
    if not levers and not set(SURFACES) & set(signals.values):
        raise SchemaError(
            "manoeuvres",
            [f"no control; map one of {', '.join(SURFACES)}, or a lever such as engine1.throttle"],
        )
    moved = {SURFACES[name]: _excursions(signals, name) for name in SURFACES if name in signals}
    inputs = [
        _alone(one, moved)
        for control, (parts, _) in moved.items()
        for one in step_inputs(control, parts)
    ]
    inputs = [one for one in inputs if one.confidence > _DOUBTFUL]
    waves = named_oscillations(
        [
            one
            for control, (parts, least) in moved.items()
            for one in find_oscillations(control, parts, 2.0 * least)
        ]
    )
    waves = [one for one in waves if not any(_overlap(one, other) for other in inputs)]
    parts = [part for parts, _ in moved.values() for part in parts]
    lateral = [one for one in inputs if one.control != "elevator"]
    slow = [
        _with_pulse(one, inputs)
        for one in find_phugoids(signals)
        if not any(_overlap(one, other) for other in lateral)
    ]
    inputs = [
        one
        for one in inputs
        if one.kind != "pulse" or not any(_overlap(one, other) for other in slow)
    ]
    known = [*slow, *(_with_response(one, parts, signals) for one in inputs)]
    known += [one for one in [*waves, *find_responses(signals)] if one.kind != "unknown"]
    stepped = [
        one for one in inputs if one.kind != "pulse"
    ]  # their load factor is that of a pull-up too
    known = [
        one
        for one in known
        if one.kind != "pull_up_push_down" or not any(_overlap(one, other) for other in stepped)
    ]
    unknown = [
        one
        for control, (parts, least) in moved.items()
        for one in _unknown(control, parts, least)
        if _new(one, known)
    ]
    return _table([*known, *unknown], signals)


def named_by_response(record: xr.DataTree, marks: pd.DataFrame) -> pd.DataFrame:
    """Return marks with pulses of the elevator, called ``pulse`` or ``block``, named ``phugoid``
    where the motion after them is one.

    Parameters
    ----------
    record : DataTree
        Flight record with channels of motion.
    marks : DataFrame
        ``manoeuvre control start end note``, as `flighttest.manoeuvres` has them.
    """
    pulses = marks["manoeuvre"].isin(_PULSES) & (marks["control"] == "elevator")
    if not pulses.any():
        return marks
    signals = resample_channels(record, flags(record))
    slow = find_phugoids(signals)
    named = marks.copy()
    for number, row in enumerate(marks.to_dict("records")):
        start, end = float(row["start"]), float(row["end"])
        if pulses.iloc[number] and any(
            min(end, one.end) - max(start, one.start) > 0.5 * (end - start) for one in slow
        ):
            named.loc[named.index[number], "manoeuvre"] = "phugoid"
    return named


def _with_pulse(one: FoundManoeuvre, inputs: Sequence[FoundManoeuvre]) -> FoundManoeuvre:
    """Return a phugoid with the pulse of the elevator that began it."""
    before = [
        other
        for other in inputs
        if (other.kind, other.control) == ("pulse", "elevator")
        and abs(one.start - other.end) < _BEFORE
    ]
    if not before:
        return one
    return replace(one, start=before[-1].start - _LEAD, confidence=before[-1].confidence)


def _excursions(signals: ResampledChannels, name: str) -> tuple[list[Excursion], float]:
    """Return the excursions of a surface in flight, and the smallest that counts."""
    x = signals[name]
    noise = (
        float(np.median(np.abs(np.diff(x, 2)))) / 1.65
    )  # of white noise: the median is 0.674 standard deviations, times sqrt(6)
    least = max(_LEAST, _NOISE * noise)
    found = [
        one
        for one in find_movements(signals.time, x, least)
        if signals.flying[np.searchsorted(signals.time, one.middle)]
    ]
    return found, least


def _alone(
    one: FoundManoeuvre, moved: Mapping[str, tuple[list[Excursion], float]]
) -> FoundManoeuvre:
    """Return an input with its confidence reduced by what the other surfaces do meanwhile, in units
    of the smallest movement.
    """
    largest = {
        control: max(
            (abs(part.size) for part in parts if part.start < one.end and one.start < part.end),
            default=0.0,
        )
        / least
        for control, (parts, least) in moved.items()
    }
    others = max((size for control, size in largest.items() if control != one.control), default=0.0)
    return replace(
        one, confidence=one.confidence * max(0.0, 1.0 - (others / largest[one.control]) ** 2)
    )


def _with_response(
    one: FoundManoeuvre, moved: Sequence[Excursion], signals: ResampledChannels
) -> FoundManoeuvre:
    """Return an input with its quiet start and the free response after it."""
    later = [part.start for part in moved if part.start > one.end + signals.step]
    end = min([one.end + _RESPONSE, float(signals.time[-1]), *later])
    return FoundManoeuvre(
        one.kind, one.control, max(one.start - _LEAD, float(signals.time[0])), end, one.confidence
    )


def _unknown(control: str, parts: Sequence[Excursion], least: float) -> list[FoundManoeuvre]:
    """Return clear fast movements, those close to each other as one."""
    found: list[FoundManoeuvre] = []
    for one in parts:
        if not one.fast or abs(one.size) < _CLEAR * least:
            continue
        if found and one.start - found[-1].end < 4.0:
            found[-1] = FoundManoeuvre("unknown", control, found[-1].start, one.end, 0.0)
        else:
            found.append(FoundManoeuvre("unknown", control, one.start, one.end, 0.0))
    return found


def _overlap(one: FoundManoeuvre, other: FoundManoeuvre) -> bool:
    return one.start < other.end and other.start < one.end


def _new(one: FoundManoeuvre, known: Sequence[FoundManoeuvre]) -> bool:
    """Return whether no known manoeuvre accounts for a movement: one of the same control, or any
    that is moved for its own sake.
    """
    return not any(_overlap(one, other) and one.control in other.control.split() for other in known)


def _table(found: Sequence[FoundManoeuvre], signals: ResampledChannels) -> pd.DataFrame:
    first, last = float(signals.time[0]), float(signals.time[-1])
    rows = [
        (
            one.kind,
            one.control,
            round(max(one.start, first), 2),
            round(min(one.end, last), 2),
            "found",
            round(float(one.confidence), 2),
        )
        for one in sorted(found, key=lambda one: one.start)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)
