"""Expressions of the channels of a record, formed on one clock and kept for the screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from aeromatch.workbench.channels.dimensions import (
    Dimension,
    dimension_of_channel,
)
from aeromatch.workbench.channels.expressions import ChannelExpression
from aeromatch.workbench.opened import Levels, OpenProject
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import WRAPPED, lookup
from flightmech.units import from_si, parse_unit

PATH, RESIDUAL = "path", "residual"
"""Leaves of the reconstructed states, and of the residuals of the reconstruction."""

# Greatest number of expressions of which the samples stay in memory.
_MOST_SIGNALS = 24
_TURN = 2.0 * np.pi  # [rad]
_GAP = 1.5  # of the usual step of a clock, from which on nothing is interpolated


@dataclass(frozen=True)
class ChannelSignal:
    """An expression of channels of a record, in its display unit.

    Attributes
    ----------
    text : str
    time : ndarray (samples,)
        [s]
    levels : Levels
        Samples with their levels of detail. [unit]
    unit : str
        Empty if a channel has no known unit.
    remarks : tuple of str
    turn : float
        Full turn of an angle that jumps by it, as recorded; zero for others. [unit]
    """

    text: str
    time: np.ndarray
    levels: Levels
    unit: str
    remarks: tuple[str, ...]
    turn: float = 0.0

    @property
    def values(self) -> np.ndarray:
        """All samples. [unit]"""
        return self.levels.values

    @property
    def continuous(self) -> np.ndarray:
        """All samples, of an angle counted through its full turns. [unit]"""
        return unwrap(self.values, self.turn) if self.turn else self.values

    def interpolated(self, times: np.ndarray) -> np.ndarray:
        """Return the samples on another clock, of an angle within its recorded turn. [unit]"""
        moved = interpolate(self.time, self.continuous, times)
        return _wrap_as(moved, self.values, self.turn) if self.turn else moved


def signal_of(opened: OpenProject, record: str, text: str) -> ChannelSignal:
    """Return an expression of channels of a record, formed once while its files are unchanged.

    A channel is named alone (``q``) or with its leaf (``imu.q``); ``path.q`` is reconstructed,
    ``residual.alpha_vane`` is what the reconstruction leaves over.

    Raises
    ------
    ParseError, UnknownName, SchemaError
        As `ChannelExpression`; a name that several leaves have.
    """
    expression = ChannelExpression(text)
    files = [*opened.record_files(record), opened.path_file(record)]
    key = ("signal", expression.text)
    return opened.kept(key, files, lambda: _form_signal(opened, record, expression), _MOST_SIGNALS)


def leaves_of(opened: OpenProject, record: str) -> dict[str, xr.Dataset]:
    """Return the clocks of a record by leaf, with those of its reconstruction, in SI."""
    leaves = {}
    for leaf, node in opened.record(record).children.items():
        leaves[str(leaf)] = node.to_dataset()
    if opened.path_file(record).exists():
        leaves[PATH] = opened.path(record).states
        residuals = residuals_of(opened, record)
        if residuals is not None:
            leaves[RESIDUAL] = residuals
    return leaves


def residuals_of(opened: OpenProject, record: str) -> xr.Dataset | None:
    """Return the residuals of a reconstruction, measured less estimated reading. [SI]"""
    file = opened.path_file(record)
    return opened.kept(("residuals",), [file], lambda: _read_residuals(file))


def _read_residuals(file: Path) -> xr.Dataset | None:
    try:
        with xr.open_dataset(
            file, group="residuals", engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as data:
            return data.load()
    # A path of another program has its states alone.
    except (OSError, KeyError, ValueError):
        return None


def _form_signal(opened: OpenProject, record: str, expression: ChannelExpression) -> ChannelSignal:
    leaves = leaves_of(opened, record)
    places = {name: find_channel(name, leaves) for name in expression.names}
    clock_leaf = _fastest_leaf(leaves, [leaf for leaf, _ in places.values()])
    time = leaves[clock_leaf]["time"].values.astype(float)
    channels: dict[str, tuple[np.ndarray, Dimension | None]] = {}
    remarks, moved, counted = [], [], []
    first_reading: dict[str, np.ndarray] = {}
    for name, (leaf, channel) in places.items():
        own = leaves[leaf]
        values = own[channel].values.astype(float)
        own_time = own["time"].values.astype(float)
        # A channel alone is drawn as recorded. Sums, slopes and means of its jumps have no meaning.
        is_counted = _is_wrapped(leaf, channel) and not expression.is_channel
        if is_counted:
            recorded, values = values, unwrap(values, _TURN)
            if not np.array_equal(recorded, values, equal_nan=True):
                counted.append(name)
        if not np.array_equal(own_time, time):
            values = interpolate(own_time, values, time)
            moved.append(name)
        if is_counted:
            values = _bring_near(values, first_reading.setdefault(channel, values))
        channels[name] = values, dimension_of_channel(channel)
    if moved:
        remarks.append(f"{', '.join(moved)}: interpolated linearly to the clock of {clock_leaf}")
    if counted:
        remarks.append(f"{', '.join(counted)}: counted through full turns")
    term = expression.evaluate(time, channels)
    unit, values = _to_display(term.dimension, term.values, [c for _, c in places.values()])
    if term.dimension is None:
        unknown = [name for name, (_, dimension) in channels.items() if dimension is None]
        remarks.append(f"the unit is not known: {', '.join(unknown)} is not in the vocabulary")
    if not np.isfinite(values).any():
        remarks.append("no sample has a value")
    is_angle = expression.is_channel and _is_wrapped(*places[expression.names[0]])
    turn = float(from_si(_TURN, unit)) if is_angle else 0.0
    return ChannelSignal(
        expression.text, time, Levels(values), unit=unit, remarks=tuple(remarks), turn=turn
    )


def find_channel(name: str, leaves: Mapping[str, xr.Dataset]) -> tuple[str, str]:
    """Return leaf and channel of a name.

    Raises
    ------
    UnknownName
        No leaf has the channel.
    SchemaError
        Several clocks of the recording have a channel of this name.
    """
    leaf, _, channel = name.partition(".")
    if leaf in leaves and _is_channel(leaves[leaf], channel):
        return leaf, channel
    recorded = []
    for candidate, data in leaves.items():
        if candidate not in (PATH, RESIDUAL) and _is_channel(data, name):
            recorded.append(candidate)
    if len(recorded) > 1:
        texts = " or ".join(f"{candidate}.{name}" for candidate in recorded)
        raise SchemaError("expression", [f"{name} is in several clocks; write {texts}"])
    if recorded:
        return recorded[0], name
    if PATH in leaves and _is_channel(leaves[PATH], name):
        return PATH, name
    raise UnknownName(name, list_channels(leaves), "channel")


def list_channels(leaves: Mapping[str, xr.Dataset]) -> list[str]:
    """Return the channels with their leaves."""
    found = []
    for leaf, data in leaves.items():
        found += [f"{leaf}.{name}" for name in data.data_vars if _is_channel(data, str(name))]
    return found


def _is_channel(data: xr.Dataset, name: str) -> bool:
    """Return whether a name is a channel of numbers over time."""
    return name in data and data[name].dims == ("time",) and data[name].dtype.kind in "fiub"


def _fastest_leaf(leaves: Mapping[str, xr.Dataset], used: list[str]) -> str:
    """Return the clock with the shortest usual step, so that no channel is thinned out."""

    def usual_step(leaf: str) -> float:
        time = leaves[leaf]["time"].values
        return float(np.median(np.diff(time))) if len(time) > 1 else np.inf

    return min(dict.fromkeys(used), key=usual_step)


def interpolate(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return samples on another clock by straight lines.

    Values outside of the samples, across a gap, or next to a missing sample are NaN.
    """
    if len(time) < 2:
        return np.full(len(grid), np.nan)
    out = np.interp(grid, time, values, left=np.nan, right=np.nan)
    step = np.diff(time)
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    is_sample = (time[after] == grid) | (time[after - 1] == grid)
    out[(step[after - 1] > _GAP * float(np.median(step))) & ~is_sample] = np.nan
    return out


def _is_wrapped(leaf: str, channel: str) -> bool:
    """Return whether a channel is an angle that jumps by a full turn; a residual does not."""
    return channel in WRAPPED and leaf != RESIDUAL


def unwrap(values: np.ndarray, turn: float) -> np.ndarray:
    """Return an angle counted through its full turns; a missing sample interrupts nothing."""
    out = values.copy()
    valid = np.isfinite(values)
    out[valid] = np.unwrap(values[valid], period=turn)
    return out


def _wrap_as(values: np.ndarray, recorded: np.ndarray, turn: float) -> np.ndarray:
    """Return an angle within the turn of a recorder: 0 to 360 deg, or -180 to 180 deg."""
    if np.array_equal(unwrap(recorded, turn), recorded, equal_nan=True):
        return values
    # A recording with jumps comes near the upper end of its turn.
    low = 0.0 if np.nanmax(recorded) > 0.75 * turn else -0.5 * turn
    return low + np.mod(values - low, turn)


def _bring_near(values: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return a second reading of an angle, moved by full turns to within half a turn of the first.

    Where the reference is missing the turns of the sample before it count.
    """
    turns = np.round((values - reference) / _TURN)
    known = np.flatnonzero(np.isfinite(turns))
    if not len(known):
        return values
    before = np.clip(np.searchsorted(known, np.arange(len(turns)), side="right") - 1, 0, None)
    return values - _TURN * turns[known[before]]


def _to_display(
    dimension: Dimension | None, values: np.ndarray, channels: list[str]
) -> tuple[str, np.ndarray]:
    """Return unit and values of a result.

    The unit is that of the first channel of the same dimension; a difference of temperatures stays
    in kelvin, because the other scales have an offset.
    """
    if dimension is None:
        return "", values
    for channel in channels:
        if dimension_of_channel(channel) == dimension:
            unit = lookup(channel).display_units
            if parse_unit(unit)[2] == 0.0:
                return unit, from_si(values, unit)
    unit = dimension.unit()
    return unit, from_si(values, unit) if _is_unit(unit) else values


def _is_unit(unit: str) -> bool:
    return unit in ("deg", "deg/s", "deg/s2", "deg s")
