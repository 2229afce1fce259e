"""Departures of a case from the printed row and from normal practice.

A pass of a case that departs is a ``pass_with_departures``.  Every departure is a remark of the
kind ``departure``, so that terminal, page, index and files state it.  All are found from the
criteria of the case and the tolerance table, so a stored report shows those of an older case as
well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import xarray as xr

from flightmech import read_aircraft
from flightmech.air import atmosphere
from flightmech.aircraft.controls import ICE
from flightmech.errors import AeromatchError, UnknownName
from flightmech.names import lookup, value_text
from flightmech.quantities import time_text
from flightmech.units import from_si
from pom.cases.case import PomCase
from pom.cases.case_file import FORCES, INITIAL, INPUTS, MASS, TRAVEL, WIND
from pom.cases.pilot import shortest_error
from pom.cases.reference_states import RECORD_SPAN
from pom.cases.resolve import SEGMENTS
from pom.judging.applicability import reason_not_judged
from pom.tolerances import rows
from pom.tolerances.band_sizes import limit_ratio, row_size_text, size_text, unit_hint, width_ratio
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import plain_words, quantity_words
from pom.tolerances.criteria import PARTS, Band, Criterion, Limit
from pom.tolerances.editions import RESTS_ON, different_rows

SAME = 1e-3  # relative difference of a condition from the record that is rounding
_LEAST = {"rad": 0.1, "rad s-1": 0.1, "m": 1.0, "m s-1": 1.0, "kg m2": 1.0}
"""By unit: sizes below which `SAME` is of this size, not of the recorded value. [SI]"""
# latitude and longitude change no response
# a held nose-wheel command lets pedals or tiller steer, as their calibration requires
_HELD = {*INPUTS, *TRAVEL, *FORCES, ICE}
_WATCHED = {*INITIAL, *MASS, *WIND, *_HELD} - {"lat", "lon", "delta_nw"}
MODAL = ("period", "t_half", "damping_ratio")  # measures of an oscillation
LEAST_TEMPERATURE = 1.0  # [K] our number: twice the usual error of a recorded temperature
SLACK = 0.5  # [s] a case may stop that much before the end of the record
_ROUNDING = 1e-9  # relative: conversions of units round
_SAME_TIME = 1e-9  # [s]


def case_departures(case: PomCase) -> tuple[RowRemark, ...]:
    """Return the departures that the case file alone shows: bands, windows, groups and share."""
    remarks: list[RowRemark] = []
    usual = rows.usual_fraction(case.reference, case.edition)
    if case.fraction > usual:
        text = f"{case.fraction:g} of the tolerance is applied, the rule has {usual:g}"
        remarks.append(_departure(text, "fraction"))
    remarks += _own_table_departures(case)
    printed = _printed_criteria(case)
    for criterion in case.criteria:
        row = printed.get(criterion.name)
        is_own = criterion.provenance == "case file" and criterion.applies
        if row is not None and is_own:
            remarks += _row_departures(case, criterion, row)
        if row is not None and criterion.measure in MODAL and criterion.applies:
            remarks += _mode_departure(criterion, row)
        if criterion.parameter in case.absent:
            text = (
                f"{criterion.name} is left out by case.absent; a fact of the aircraft belongs in "
                f"[facts] without of its file"
            )
            remarks.append(_departure(text, criterion.name))
    remarks += _untrimmed_departure(case)
    return (*remarks, *_driven_departures(case), *_piloted_departures(case))


def _untrimmed_departure(case: PomCase) -> Iterator[RowRemark]:
    """Yield the departure of a case whose model starts without trim."""
    if case.drive.trim is False and not case.is_demonstration:
        text = (
            "the model starts at the recorded state without trim (drive.trim = false), so that no "
            "trim bias shows its forces and moments at the start"
        )
        yield _departure(text, "drive.trim")


def _mode_departure(criterion: Criterion, row: Criterion) -> Iterator[RowRemark]:
    """Yield the departure of a mode that is measured on another channel than usual."""
    if row.channel and criterion.channel and criterion.channel != row.channel:
        text = (
            f"{criterion.name} is measured on {criterion.channel} by case.mode_channel, usual is "
            f"{row.channel}"
        )
        yield _departure(text, criterion.name)


_AXES = {
    "2.c.": ("delta_e", "column", "F_column", "throttle", "thrust"),
    "2.d.": ("delta_a", "delta_r", "wheel", "pedal", "F_wheel", "F_pedal"),
}
"""Controls of the axis of a test, by the start of its number."""


def _piloted_departures(case: PomCase) -> Iterator[RowRemark]:
    """Yield the loops of a math pilot that damp or drive the mode that a row judges."""
    if not any(item.applies and item.measure in MODAL for item in case.criteria):
        return
    controls = next((own for start, own in _AXES.items() if case.id.startswith(start)), ())
    for loop in case.drive.pilot:
        if loop.control.rpartition(".")[2] in controls:
            text = (
                f"the math pilot moves the {quantity_words(loop.control)} in the axis of the mode "
                f"that is judged, which is then not a free response"
            )
            yield _departure(text, loop.control)


def _driven_departures(case: PomCase) -> Iterator[RowRemark]:
    """Yield the rows that are not judged because the record drives their quantity.

    An alternative of such a row can pass, and the row would not be missed.
    """
    if case.reference == "footprint":
        return
    for criterion in case.criteria:
        if not criterion.applies or not criterion.parameter:
            continue
        reason = reason_not_judged(case, criterion)
        if "is driven by the record" in reason:
            yield _departure(f"{criterion.name} is not judged: {reason}", criterion.name)


def _departure(text: str, quantity: str) -> RowRemark:
    return RowRemark("departure", f"departure: {text}", quantity)


def printed_texts(case: PomCase) -> dict[str, str]:
    """Return the printed tolerance of every row with a band of the case file, by name."""
    own = {c.name for c in case.criteria if c.provenance == "case file" and c.parameter}
    if not own:
        return {}
    printed = _printed_criteria(case)
    return {name: printed[name].band.text for name in own & printed.keys()}


def _printed_criteria(case: PomCase) -> dict[str, Criterion]:
    """Return the rows of the table as criteria with the printed window, by name."""
    try:
        table_rows = case.printed_rows()
    except UnknownName:
        return {}
    printed = {}
    for row, name in zip(table_rows, rows.names_of(table_rows), strict=True):
        printed[name] = rows.make_criterion(row, name, case.window, case.features)
    return printed


def _own_table_departures(case: PomCase) -> Iterator[RowRemark]:
    """Yield the departures of a table of the user from the shipped table of the same edition.

    A company table has a name of its own, and only a width of another size departs.  A table under
    the name of a regulation has its rows; where it does not, the reader must see both.
    """
    if not case.table:
        return
    own = case.printed_rows()
    try:
        shipped = rows.rows_of_test(case.id, case.standard, case.edition)
    except UnknownName:
        # a width in a wrong unit is a mistake under any name
        for row, name in zip(own, rows.names_of(own), strict=True):
            if size := row_size_text(row, name):
                yield _departure(f"{size} ({case.table['file']})", name)
        return
    file = case.table["file"]
    printed = dict(zip(rows.names_of(shipped), shipped, strict=True))
    applied = dict(zip(rows.names_of(own), own, strict=True))
    for name, texts in different_rows(shipped, own):
        old, new = texts
        if name in printed and name in applied:
            row, own_row = printed[name], applied[name]
            criterion = rows.make_criterion(own_row, name, case.window, case.features)
            # a narrower band of an otherwise equal row is stricter, so it needs no word
            same_rest = all(row[key] == own_row[key] for key in RESTS_ON)
            if same_rest and is_within_printed(criterion, rows.band_of(row)):
                continue
        text = f"{name} {new} in {file}, {old} in the table of this edition that aeromatch has"
        yield _departure(text, name)


def size_departures(case: PomCase) -> Iterator[str]:
    """Yield the tolerances of a case that are many times as wide or as narrow as the printed ones.

    The widths are those of the case file, and those of a table of the user.
    """
    printed = _printed_criteria(case)
    for criterion in case.criteria:
        row = printed.get(criterion.name)
        if row is not None and criterion.provenance == "case file" and criterion.applies:
            yield from filter(None, [size_text(criterion, [row.band])])
    if case.table:
        own = case.printed_rows()
        for table_row, name in zip(own, rows.names_of(own), strict=True):
            yield from filter(None, [row_size_text(table_row, name)])


def _row_departures(case: PomCase, own: Criterion, row: Criterion) -> Iterator[RowRemark]:
    """Yield the departures of a row with a band, window or group of the case file."""
    if not is_within_printed(own, row.band):
        times = width_ratio(own, row.band)
        # limits of another kind have no ratio, so the common one may be equal
        is_wider = times is not None and times > 1.0 + _ROUNDING
        ratio = f", {times:.3g} times as wide{unit_hint(times)}" if is_wider and times else ""
        printed = f"printed {row.band.text}" if row.band.limits else "its number was not read"
        text = f"tolerance of {plain_words(own.name)} {own.band.text}, {printed}{ratio}"
        yield _departure(text, own.name)
    start, stop = _clip(_asked_window(case, own), case.window)
    if own.window[0] > start + _SAME_TIME or own.window[1] < stop - _SAME_TIME:
        text = (
            f"{plain_words(own.name)} is judged in {time_text(own.window[0])} ... "
            f"{time_text(own.window[1])} s, the "
            f"row in {time_text(start)} ... {time_text(stop)} s"
        )
        yield _departure(text, own.name)
    if own.group != row.group:
        others = [
            plain_words(c.name)
            for c in case.criteria
            if c.group == own.group and c.name != own.name
        ]
        if others:
            text = (
                f"{plain_words(own.name)} is an alternative of {', '.join(others)}, in the table "
                f"it is not"
            )
            yield _departure(text, own.name)


def is_within_printed(criterion: Criterion, printed: Band) -> bool:
    """Return whether the band of a criterion is never wider than a printed one.

    A percentage and a width in a unit cannot be compared without the flight: false.
    """
    band = criterion.band

    def least(own: Limit) -> list[bool]:
        # for every printed limit: whether `own` is within it
        return [_is_smaller(criterion, own, limit, printed) for limit in printed.limits]

    table = [least(own) for own in band.limits]
    if not table or not table[0]:
        return False
    # w = max or min of the limits; own width <= printed width for every flight value:
    # max <= max: every own limit is within a printed one;  min <= max: one is within one;
    # max <= min: all within all;  min <= min: every printed limit has an own one within it.
    own_least = band.rule == "lesser_of"
    if printed.rule == "lesser_of":
        columns = list(zip(*table, strict=True))
        return all(map(any if own_least else all, columns))
    rows_within = map(any, table)
    return any(rows_within) if own_least else all(rows_within)


def _is_smaller(criterion: Criterion, own: Limit, limit: Limit, printed: Band) -> bool:
    """Return whether a limit is of the same kind as a printed one and not larger."""
    ratio = limit_ratio(criterion, own, limit, printed)
    return ratio is not None and ratio <= 1.0 + _ROUNDING


def _asked_window(case: PomCase, criterion: Criterion) -> tuple[float, float]:
    """Return the window that a row requires between its events. [s]"""
    times = []
    defaults = case.window
    if criterion.measure in SEGMENTS:
        defaults = (
            case.events.get("segment_start", defaults[0]),
            case.events.get("segment_end", defaults[1]),
        )
    for bound, default in zip(criterion.bounds, defaults, strict=True):
        try:
            times.append(float(rows.bound_time(bound, case.events, default)))
        except UnknownName:
            times.append(default)
    start, stop = times
    for word in criterion.condition.split(";"):
        # a part of a manoeuvre ends at its events
        first, last = (case.events.get(event) for event in PARTS.get(word, ("", "")))
        start = start if first is None else max(start, first)
        stop = stop if last is None else min(stop, last)
    return start, stop


def _clip(window: tuple[float, float], limits: tuple[float, float]) -> tuple[float, float]:
    return max(window[0], limits[0]), min(window[1], limits[1])


def record_departures(case: PomCase, states: xr.Dataset) -> tuple[RowRemark, ...]:
    """Return the departures that need the record.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time)
        Of `flight_states`, with the attribute `RECORD_SPAN`.
    """
    shortened = _shortened_departure(case, states.attrs.get(RECORD_SPAN))
    return (
        *shortened,
        *_overrides(case, states),
        *_unrecorded(case, states),
        *_left_out_wind(case, states),
    )


def _left_out_wind(case: PomCase, states: xr.Dataset) -> Iterator[RowRemark]:
    """Yield the wind of the record that a case in calm air leaves out."""
    if case.wind != "none" or not {"wind_n", "wind_e"} <= set(states):
        return
    north, east = (np.nanmean(states[name].values) for name in ("wind_n", "wind_e"))
    speed = float(np.hypot(north, east))
    if speed > _LEAST["m s-1"]:
        text = (
            f"calm air by drive.wind, the record has a mean wind of "
            f"{float(from_si(speed, 'kt')):.3g} kt"
        )
        yield _departure(text, "wind")


def _unrecorded(case: PomCase, states: xr.Dataset) -> Iterator[RowRemark]:
    """Yield conditions that no record shows: mass properties, held inputs and temperature.

    Mass properties are compared with the aircraft file.  An input at zero is at rest.
    """
    given = {name: value for name, value in case.conditions.items() if name not in states}
    stated = _stated_masses(case) if any(name in MASS for name in given) else {}
    for name, value in given.items():
        if name in stated and abs(value - stated[name]) > SAME * max(abs(stated[name]), 1.0):
            shown = [value_text(name, item, ".5g") for item in (value, stated[name])]
            text = (
                f"'{name}' ({lookup(name).long_name}) is {shown[0]} by the conditions of the case, "
                f"the aircraft file has {shown[1]}"
            )
            yield _departure(text, name)
        elif name in _HELD & _WATCHED and value != 0.0:
            text = (
                f"'{name}' ({lookup(name).long_name}) is held at {value_text(name, value, '.5g')} "
                f"by the conditions of the case; the record does not show it"
            )
            yield _departure(text, name)
    if "delta_T" not in given or not {"h", "temperature"} <= set(states):
        return
    # Deviation of the recorded air from the standard atmosphere, at the start.
    h, T = (float(np.atleast_1d(states[name].values)[0]) for name in ("h", "temperature"))
    recorded = T - float(atmosphere(h).temperature)
    if abs(given["delta_T"] - recorded) > LEAST_TEMPERATURE:
        text = (
            f"'delta_T' is {given['delta_T']:.3g} K by the conditions of the case, the record has "
            f"{recorded:.3g} K"
        )
        yield _departure(text, "delta_T")


def _stated_masses(case: PomCase) -> dict[str, float]:
    """Return the mass properties of the aircraft file by canonical name; empty without a file."""
    try:
        aircraft = read_aircraft(case.aircraft)
    except (AeromatchError, OSError):
        # the reader of the aircraft reports a missing or damaged file
        return {}
    x, y, z = aircraft.cg
    masses = {"x_cg_b": x, "y_cg_b": y, "z_cg_b": z}
    for name in MASS:
        if name not in masses:
            masses[name] = float(getattr(aircraft, name))
    return masses


def _overrides(case: PomCase, states: xr.Dataset) -> Iterator[RowRemark]:
    """Yield the conditions of the case file that contradict the record or add a wind to it."""
    for name, value in case.conditions.items():
        if name not in _WATCHED:
            continue
        recorded = 0.0
        if name in states:
            values = np.atleast_1d(states[name].values).astype(float)
            # the wind acts all the time, a state or a mass at the start
            recorded = float(np.nanmean(values) if name in WIND else values[0])
            if name in _HELD:
                # a held input replaces the whole record: its largest difference counts
                recorded = float(values[np.nanargmax(np.abs(values - value))])
        elif name not in WIND:
            continue
        size = max(abs(recorded), _LEAST.get(lookup(name).units, 0.0))
        if abs(shortest_error(name, value - recorded)) <= SAME * size:
            continue
        shown = [value_text(name, item, ".5g") for item in (value, recorded)]
        # the path has the mass of the aircraft file where none is recorded
        source = "flight path" if name in MASS else "record"
        text = (
            f"'{name}' ({lookup(name).long_name}) is {shown[0]} by the conditions of the case, the "
            f"{source} has {shown[1]}"
        )
        yield _departure(text, name)


def _shortened_departure(case: PomCase, span: Iterable[float] | None) -> Iterator[RowRemark]:
    """Yield the departure of a window that is shorter than the rows require.

    A record that is called short and is not has another text.
    """
    if not case.shortened or span is None:
        return
    asked = [_asked_window(case, c) for c in case.criteria if c.applies]
    if not asked:
        return
    # Window that all rows together require, and the part of it that the record holds.
    start, stop = np.min(asked, axis=0)[0], np.max(asked, axis=0)[1]
    first, last = span
    held = max(start, first), min(stop, last)
    if start >= case.window[0] - _SAME_TIME and stop <= case.window[1] + _SAME_TIME:
        return
    if case.window[0] <= held[0] + SLACK and case.window[1] >= held[1] - SLACK:
        text = (
            f"the record holds {time_text(held[0], 4)} ... {time_text(held[1], 4)} s of the "
            f"{time_text(start, 4)} ... "
            f"{time_text(stop, 4)} s that the rows require ({case.shortened})"
        )
        yield _departure(text, "window")
        return
    text = (
        f"the window {time_text(case.window[0])} ... {time_text(case.window[1])} s is called short "
        f"({case.shortened}), but the record holds {time_text(held[0], 4)} ... "
        f"{time_text(held[1], 4)} s of the "
        f"{time_text(start, 4)} ... {time_text(stop, 4)} s that the rows require"
    )
    yield _departure(text, "window")
