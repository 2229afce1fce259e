"""PX4 logs (ULog), one table per topic.

The first instance of a topic has the table ``topic``, further instances have ``topic.1`` ...
Fields keep their names (``xyz[0]``).  ULog states no units, so that the name map must state them.

A topic with an attitude quaternion ``q[0]`` ... ``q[3]`` (Hamilton, scalar first, body to
north-east-down) also has the columns ``roll``, ``pitch`` and ``yaw`` [rad].  The clock is the clock
of the autopilot in seconds.  The name map may choose `timestamp_sample`, the time of the
measurement, as the clock of a topic.  ``vehicle_status`` gives the flight modes.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    PX4,
    RecordedTable,
    Recording,
    decoding_errors,
    flight_mode_changes,
)

_MICRO = 1e-6
_STATUS = "vehicle_status"
# Dropouts that have a note each.
_MOST_DROPOUTS = 20


def read(path: Path, names: NameMap) -> Recording:
    """Return the topics of a PX4 log that the name map requires, or all of them without a map.

    Raises
    ------
    ParseError
        The file is damaged so that no topic can be read.
    """
    # only this format needs pyulog
    from flighttest.records.readers.formats.ulog_topics import BoundedLog

    topics = _requested_topics(names)
    # pyulog prints its warnings on standard output.
    with (
        decoding_errors(path, "a whole ULog file"),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        log = BoundedLog(str(path), None if topics is None else [*topics, _STATUS])
        tables: dict[str, RecordedTable] = {}
        for topic in sorted(log.data_list, key=lambda topic: (topic.name, topic.multi_id)):
            if len(topic.data.get("timestamp", ())):
                instance = f".{topic.multi_id}" if topic.multi_id else ""
                tables[f"{topic.name}{instance}"] = _topic_table(topic.data)

    modes = _flight_modes(tables.get(_STATUS))
    # The topic of the flight modes is a table only if the map reads it.
    if topics is not None and _STATUS not in topics:
        for name in list(tables):
            if name.partition(".")[0] == _STATUS:
                del tables[name]
    if not tables and not topics:
        raise ParseError(
            str(path),
            0,
            found="no logged topic",
            expected="a ULog file with data; logging may have stopped before it began",
        )
    facts = {"title": path.name.split(".")[0]}
    for key in ("sys_name", "ver_hw", "ver_sw_release"):
        if key in log.msg_info_dict:
            facts[f"px4_{key}"] = str(log.msg_info_dict[key])
    notes = tuple(_damage_notes(log))
    return Recording("ulog", tables, facts, notes=notes, modes=modes, modes_table=_STATUS)


def _flight_modes(status: RecordedTable | None) -> tuple[tuple[float, str], ...]:
    """Return the flight modes of the topic ``vehicle_status``."""
    if status is None or status.time is None or "nav_state" not in status.columns:
        return ()
    return flight_mode_changes(status.time, status.columns["nav_state"], PX4)


def _damage_notes(log: Any) -> list[str]:
    """Return notes on dropouts and damaged parts of a log."""
    notes = []
    for dropout in log.dropouts[:_MOST_DROPOUTS]:
        seconds = dropout.timestamp * _MICRO
        notes.append(f"logger dropped {dropout.duration:g} ms at {seconds:.6g} s")
    if len(log.dropouts) > _MOST_DROPOUTS:
        total = sum(dropout.duration for dropout in log.dropouts)
        notes.append(f"{len(log.dropouts)} dropouts of the logger in all, {total:g} ms")
    if log.file_corruption:
        notes.append("damaged parts of the log were skipped")
    return notes


def _requested_topics(names: NameMap) -> list[str] | None:
    """Return the topics that the map reads, without their instance; None for all topics."""
    # A column is topic/field or topic.instance/field.
    topics = {column.rpartition("/")[0].partition(".")[0] for column in names.requested_columns()}
    # A column without a topic belongs to the topic that has the name of its leaf.
    for leaf, channels in names.leaves.items():
        for channel in channels.values():
            if any("/" not in column for column in channel.columns):
                topics.add(leaf)
    topics.discard("")
    return sorted(topics) or None


def _topic_table(data: Mapping[str, np.ndarray]) -> RecordedTable:
    """Return the numbers of a topic over its time stamps."""
    columns, units = {}, {}
    for name, values in data.items():
        if name != "timestamp" and values.dtype.kind in "fiub":
            columns[name] = values
    # A name map names angles, and not the components of a quaternion.
    if {"q[0]", "q[1]", "q[2]", "q[3]"} <= set(columns) and "roll" not in columns:
        angles = quaternion_to_euler(
            columns["q[0]"], columns["q[1]"], columns["q[2]"], columns["q[3]"]
        )
        for name, values in zip(("roll", "pitch", "yaw"), angles, strict=True):
            columns[name] = values
            units[name] = "rad"
    if "timestamp_sample" in columns:
        units["timestamp_sample"] = "us"
    return RecordedTable(columns, units, data["timestamp"].astype(float) * _MICRO)


def quaternion_to_euler(w, x, y, z) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bank, pitch and heading of a quaternion from body to north-east-down. [rad]

    The scalar part is `w`.  The heading is between 0 and 2 pi.
    """
    w, x, y, z = (np.asarray(part, float) for part in (w, x, y, z))
    # Elements of the rotation matrix of the quaternion. The clip covers rounding at +-90 deg of
    # pitch.
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.mod(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), 2.0 * np.pi)
    return roll, pitch, yaw
