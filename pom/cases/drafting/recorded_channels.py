"""Channels and listed manoeuvres of a raw record or of a reconstructed path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

import flighttest
from pom.cases.drafting.event_detection import Recorded, RecordedManoeuvre
from pom.cases.reference_states import read_path_states


def recorded_channels(record: Path, names: Path | None) -> Recorded:
    """Return the channels of a raw record or of a reconstructed path.

    Raises
    ------
    ParseError, SchemaError, UnknownName
        As `flighttest.read`: the file is not a record, or its columns need a name map.
    """
    states = read_path_states(str(record))
    if states is not None:
        # A reconstructed path has one clock and canonical names.
        time = states["time"].values.astype(float)
        channels = {}
        for name, item in states.data_vars.items():
            if item.dims == ("time",):
                channels[str(name)] = (time, item.values.astype(float))
        return Recorded(channels, (float(time[0]), float(time[-1])))
    tree = flighttest.read(str(record), names=str(names) if names else None)
    return Recorded(
        _finite_channels(tree),
        _reconstruction_span(tree),
        manoeuvres=_read_manoeuvres(tree),
        latitude=tree.attrs.get("latitude"),
    )


def _finite_channels(tree: xr.DataTree) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return time and finite samples of every channel."""
    channels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for leaf in tree.children.values():
        node = leaf.to_dataset()
        for name, item in node.data_vars.items():
            # The search for movements needs finite samples.
            is_finite = np.isfinite(item.values.astype(float))
            if item.dims == ("time",) and is_finite.any():
                channels[str(name)] = (
                    node["time"].values[is_finite].astype(float),
                    item.values[is_finite].astype(float),
                )
    return channels


def _reconstruction_span(tree: xr.DataTree) -> tuple[float, float]:
    """Return the time that a reconstruction covers: of the gyros, else of all channels. [s]"""
    clocks, gyro_clocks = [], []
    for leaf in tree.children.values():
        clock = leaf["time"].to_numpy()
        clocks.append(clock)
        if "p" in leaf:
            gyro_clocks.append(clock)
    # A reconstruction integrates the gyros, so it starts and ends with them.
    clocks = gyro_clocks or clocks
    return max(float(clock[0]) for clock in clocks), min(float(clock[-1]) for clock in clocks)


def _read_manoeuvres(tree: xr.DataTree) -> list[RecordedManoeuvre]:
    manoeuvres = []
    for row in flighttest.records.marked_manoeuvres(tree).to_dict("records"):
        manoeuvres.append(
            RecordedManoeuvre(
                start=float(row["start"]),
                end=float(row["end"]),
                control=str(row.get("control", "")),
                word=str(row["manoeuvre"]),
            )
        )
    return manoeuvres
