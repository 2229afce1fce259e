"""PX4 logs (ULog): one table per topic, ``topic`` for its first instance and ``topic.1`` ... for
the others.

Fields keep their names (``xyz[0]``); ULog states no units, so the name map does.  A topic with an
attitude quaternion ``q[0]`` ... ``q[3]`` (Hamilton, scalar first, body to north-east-down) also
gets ``roll``, ``pitch`` and ``yaw`` [rad].  The clock is the autopilot's, in seconds;
`timestamp_sample`, the time of the measurement, can be chosen as the clock of a topic in the name
map.  ``vehicle_status`` gives the flight modes.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flightmech.errors import ParseError
from flighttest.records.readers.bus_words import Arinc429
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


def read(path: Path, names: NameMap) -> Recording:
    """Return the topics of a PX4 log that the name map requires, or all of them without a map.

    Raises
    ------
    ParseError
        The file is damaged so that no topic can be read.
    """
    from pyulog import ULog

    with (
        decoding_errors(path, "a whole ULog file"),
        contextlib.redirect_stdout(io.StringIO()),
    ):  # pyulog prints what it meets
        wanted = _topics(names)
        log = ULog(str(path), None if wanted is None else [*wanted, _STATUS])
        tables = {}
        for part in sorted(log.data_list, key=lambda part: (part.name, part.multi_id)):
            if len(part.data.get("timestamp", ())):
                tables[part.name if part.multi_id == 0 else f"{part.name}.{part.multi_id}"] = (
                    _table(part.data)
                )
    status = tables.get(_STATUS)
    modes: tuple[tuple[float, str], ...] = ()
    if status is not None and status.time is not None and "nav_state" in status.columns:
        modes = flight_mode_changes(status.time, status.columns["nav_state"], PX4)
    if wanted is not None and _STATUS not in wanted:
        tables = {
            name: table for name, table in tables.items() if name.partition(".")[0] != _STATUS
        }
    if not tables and not wanted:
        raise ParseError(
            str(path),
            0,
            "no logged topic",
            "a ULog file with data; logging may have stopped before it began",
        )
    gone = [
        f"logger dropped {drop.duration:g} ms at {drop.timestamp * _MICRO:.6g} s"
        for drop in log.dropouts[:20]
    ]
    if len(log.dropouts) > 20:
        gone.append(
            f"{len(log.dropouts)} dropouts of the logger in all, "
            f"{sum(drop.duration for drop in log.dropouts):g} ms"
        )
    if log.file_corruption:
        gone.append("damaged parts of the log were skipped")
    facts = {"title": path.name.split(".")[0]}
    facts.update(
        {
            f"px4_{key}": str(log.msg_info_dict[key])
            for key in ("sys_name", "ver_hw", "ver_sw_release")
            if key in log.msg_info_dict
        }
    )
    return Recording("ulog", tables, facts, tuple(gone), modes)


def _topics(names: NameMap) -> list[str] | None:
    """Return the topics that the map names, without their instance."""
    columns = [
        column
        for leaf in names.leaves.values()
        for channel in leaf.values()
        for column in channel.columns
    ]
    columns += [names.utc.column] if names.utc else []
    columns += [
        spec.column for spec in names.decode.values() if isinstance(spec, Arinc429) and spec.column
    ]
    topics = {column.rpartition("/")[0].partition(".")[0] for column in columns}
    topics |= {
        leaf
        for leaf, channels in names.leaves.items()
        if any("/" not in c for one in channels.values() for c in one.columns)
    }
    topics.discard("")
    return sorted(topics) or None


def _table(data: Mapping[str, np.ndarray]) -> RecordedTable:
    columns = {
        name: values
        for name, values in data.items()
        if name != "timestamp" and values.dtype.kind in "fiub"
    }
    units = {}
    if {"q[0]", "q[1]", "q[2]", "q[3]"} <= set(columns) and "roll" not in columns:
        columns.update(
            zip(
                ("roll", "pitch", "yaw"),
                quaternion_to_euler(*(columns[f"q[{i}]"] for i in range(4))),
                strict=True,
            )
        )
        units = {"roll": "rad", "pitch": "rad", "yaw": "rad"}
    if "timestamp_sample" in columns:
        units["timestamp_sample"] = "us"
    return RecordedTable(columns, units, data["timestamp"].astype(float) * _MICRO)


def quaternion_to_euler(w, x, y, z) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bank, pitch and heading of a quaternion body to north-east-down, scalar first; heading
    0 ... 2 pi. [rad]
    """
    w, x, y, z = (np.asarray(part, float) for part in (w, x, y, z))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.mod(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), 2.0 * np.pi)
    return roll, pitch, yaw
