"""Columns of a file that the name map gives to two channels, and pressure height of its pressure.

Two channels of one column are a warning.  They are an error if kinematics show that one of them, or
both, are not what the name map calls them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from itertools import combinations

import numpy as np
import xarray as xr

from flightmech.air import pressure_altitude
from flightmech.names import lookup
from flighttest.reconstruction.quality.checks.mistake_search import (
    GAIN,
    find_mistakes,
    total_disagreement,
)
from flighttest.reconstruction.quality.checks.relations import compare_all
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.headings import (
    CHANNEL_WORDS,
    mapped_channels,
    matching_words,
)
from flighttest.reconstruction.quality.finding import Finding, map_entry_of
from flighttest.records.readers.channel_correction import line_of

_SIDES = re.compile(r"^engine\d+\.|^gear\.\w+\.|_(left|right|nose)$")
_ALIKE = (
    {"vd", "hdot"},
    {"alpha", "alpha_vane"},
    {"beta", "beta_vane"},
    {"ax", "ax_imu"},
    {"ay", "ay_imu"},
    {"az", "az_imu"},
)
# relations that are about a channel; other relations only use it
_RELATIONS_OF = {
    "phi": ("phi_rate",),
    "theta": ("theta_rate",),
    "psi": ("psi_rate",),
    "p": ("phi_rate",),
    "q": ("theta_rate",),
    "r": ("psi_rate",),
    "ax_imu": ("force_x", "along"),
    "ay_imu": ("force_y",),
    "az_imu": ("force_z", "pull"),
    "vn": ("track_n",),
    "ve": ("track_e",),
    "vd": ("climb",),
    "alpha_vane": ("vane", "heave"),
    "beta_vane": ("slip",),
}
_SHORTEST = 5.0  # s of usable samples
_STATIC_ERROR = 0.03  # of the impact pressure, in static pressure
_IMPACT = 0.05  # of the static pressure: impact pressure of a record without it
_WEIGHT = 12.0  # Pa/m, of the air at sea level
_SEA_LEVEL = 101325.0  # Pa
_LOWEST = 1e3  # Pa, below which a static pressure is in another unit
_HEIGHT = 30.0  # m by which two pressure heights of one aeroplane may differ
_SCATTER = 15.0  # m
_UNIT_ERROR = 1500.0  # m beyond half the range of heights: a wrong unit

Pair = tuple[str, str]


def column_findings(
    record: xr.DataTree, signals: ResampledChannels
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the findings on columns that give two channels, and the wrong channels.

    Parameters
    ----------
    record : DataTree
        Its channels carry the column that they come from.
    signals : ResampledChannels
        As recorded.

    Returns
    -------
    findings : list of Finding
    wrong : tuple of str
        Channels that kinematics show to be wrong. All other checks leave them out.
    """
    findings: list[Finding] = []
    wrong: list[str] = []
    for first, second, relation in _shared_columns(record, signals):
        at_fault = _channels_at_fault(signals, (first, second))
        names = (first, second)
        if at_fault == (second,):
            names = (second, first)
        severity, text = "warning", f"{first} and {second} {relation}"
        if len(at_fault) == 1:
            severity = "error"
            text += f"; kinematics hold for {names[1]} and not for {names[0]}"
        elif at_fault:
            severity = "error"
            text += "; kinematics do not hold with both"
        elif {first, second} == {"h_baro", "h_gps"}:
            text += " (h_baro is pressure height, a satellite receiver gives geometric height)"
        remedy = (
            _line_with_matching_column(record, names[0])
            or f"give {names[0]} its own column in the name map, or leave it out"
        )
        findings.append(Finding(severity, "column", names, text, remedy=remedy))
        wrong += at_fault
    return findings, tuple(wrong)


def pressure_height_findings(signals: ResampledChannels) -> list[Finding]:
    """Return the finding on a pressure height that does not belong to the static pressure.

    It is a satellite height, or the altimeter has another setting.
    """
    if not {"h_baro", "p_static"} <= set(signals.values):
        return []
    mask = signals.mask(("h_baro", "p_static"))
    p_static = signals["p_static"][mask]
    if mask.sum() * signals.step < _SHORTEST or p_static.min() < _LOWEST:
        return []
    difference = signals["h_baro"][mask] - pressure_altitude(p_static)
    middle, scatter = float(np.median(difference)), float(np.std(difference))
    pressure = float(np.median(p_static))
    q_c = _IMPACT * pressure
    if "q_c" in signals:
        q_c = float(np.median(signals["q_c"][mask]))
    # height that corresponds to the error of the static port
    port_error = _STATIC_ERROR * q_c / (_WEIGHT * pressure / _SEA_LEVEL)
    if abs(middle) < _HEIGHT + port_error and scatter < _SCATTER + port_error:
        return []
    # the relation of the two channels finds a wrong unit
    if abs(middle) > 0.5 * float(np.ptp(signals["h_baro"][mask])) + _UNIT_ERROR:
        return []
    text = (
        f"h_baro differs from the pressure height of p_static by {middle:+.0f} m (scatter "
        f"{scatter:.0f} m): it is the height of a "
        "satellite receiver, or the altimeter was not set to 1013.25 hPa"
    )
    remedy = "map the column of pressure height, or leave h_baro out: p_static gives it"
    channels, evidence = ("h_baro", "p_static"), {"difference": middle, "scatter": scatter}
    return [Finding("warning", "definition", channels, text, remedy=remedy, evidence=evidence)]


def _shared_columns(
    record: xr.DataTree, signals: ResampledChannels
) -> Iterator[tuple[str, str, str]]:
    """Yield pairs of channels of one column, or of columns with the same samples."""
    users: dict[str, list[str]] = defaultdict(list)
    column_of: dict[str, str] = {}
    for name, attrs in mapped_channels(record):
        users[attrs["column"]].append(name)
    for column, names in users.items():
        column_of |= dict.fromkeys(names, column)
        for first, second in combinations(names, 2):
            if not _is_same_quantity(first, second):
                yield first, second, f"are read from one column, {_heading_of(column)}"
    # A recorder may write one signal into two columns.
    for first, second in combinations(sorted(set(column_of) & set(signals.values)), 2):
        comparable = lookup(first).units == lookup(second).units
        if not comparable or _is_same_quantity(first, second):
            continue
        columns = column_of[first], column_of[second]
        if columns[0] != columns[1] and _has_equal_samples(signals[first], signals[second]):
            headings = f"{_heading_of(columns[0])} and {_heading_of(columns[1])}"
            yield first, second, f"have the same samples, in columns {headings}"


def _heading_of(column: str) -> str:
    return repr(column.rpartition("/")[2])


def _line_with_matching_column(record: xr.DataTree, name: str) -> str:
    """Return the line of the name map with the unmapped column that has the words of a channel.

    The result is empty unless there is exactly one such column.
    """
    leaf, channel, _ = map_entry_of(record, name)
    if channel is None or name not in CHANNEL_WORDS:
        return ""
    table = record[leaf][name].attrs["column"].rpartition("/")[0]
    unmapped = re.split(rf"(?:^| ){re.escape(table)}/", str(record.attrs.get("unmapped", "")))[1:]
    matching = [column for column in unmapped if matching_words(column, name) == "own"]
    if len(matching) != 1:
        return ""
    return f"{line_of(name, channel.changed(column=matching[0]))}   # in [{leaf}] of the name map"


def _is_same_quantity(first: str, second: str) -> bool:
    """Return whether two channels may share a column, such as two engines with one lever."""
    return _SIDES.sub("", first) == _SIDES.sub("", second) or {first, second} in _ALIKE


def _has_equal_samples(x: np.ndarray, y: np.ndarray) -> bool:
    return float(np.ptp(x)) > 0.0 and bool(np.array_equal(x, y))


def _channels_at_fault(signals: ResampledChannels, pair: Pair) -> tuple[str, ...]:
    """Return the channel of a pair that breaks kinematics alone; both if it may be either."""
    first, second = pair
    if not set(pair) <= set(signals.values):
        return ()
    explanations, _, checks = find_mistakes(signals)
    concerns_pair = any(
        set(pair) & set(explanation.repair.channels) for explanation in explanations
    )
    if not concerns_pair and all(check.consistent for check in checks.values()):
        return ()
    # mistakes of other channels must not count
    explanations, _, _ = find_mistakes(signals.without(pair))
    for explanation in explanations:
        signals = explanation.repair.apply(signals)
    remainder = total_disagreement(signals.without(pair))
    if total_disagreement(signals) - remainder < GAIN:
        return ()
    with_first = total_disagreement(signals.without((second,))) - remainder
    with_second = total_disagreement(signals.without((first,))) - remainder
    worse = _worse_channel(pair, with_first, with_second)
    if worse:
        return worse
    if with_first > GAIN or with_second > GAIN:
        return pair
    # a relation that reads both counts for the channel that it is about
    disagreement = {
        name: check.disagreement
        for name, check in compare_all(signals).items()
        if not check.consistent
    }
    sums = []
    for name in pair:
        relations = _RELATIONS_OF.get(name, ())
        sums.append(sum(disagreement.get(relation, 0.0) for relation in relations))
    return _worse_channel(pair, sums[0], sums[1]) or pair


def _worse_channel(pair: Pair, of_first: float, of_second: float) -> tuple[str, ...]:
    """Return the channel that disagrees if the other one does not."""
    if abs(of_first - of_second) < GAIN or min(of_first, of_second) > GAIN:
        return ()
    if of_first > of_second:
        return (pair[0],)
    return (pair[1],)
