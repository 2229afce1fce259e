"""A project that is open: its files as they are now, each read once until it changes."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr

import flighttest
from aeromatch.project.project import Project, read_project
from aeromatch.workbench.actions import PlaceholderFolders
from aeromatch.workbench.processes import WorkbenchJob
from flightmech.aircraft.aircraft import Aircraft, read_aircraft
from flightmech.errors import UnknownName
from flightmech.support.figures import to_display_quantity
from flighttest.reconstruction.dynamics.saved_paths import open_path

FACTOR = 8
"""Samples of a level that one block of the next level joins."""


class Levels:
    """One channel with its levels.

    Parameters
    ----------
    values : ndarray (samples,)
        NaN where there is no sample.
    """

    def __init__(self, values: np.ndarray) -> None:
        self.values = np.asarray(values, np.float64)
        self._levels: list[tuple[np.ndarray, np.ndarray]] = []

    def level(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest values of blocks of ``FACTOR ** number`` samples; the last
        block may be shorter.
        """
        while len(self._levels) < number:
            low, high = self._levels[-1] if self._levels else (self.values, self.values)
            self._levels.append((_blocks(low, np.fmin), _blocks(high, np.fmax)))
        return self._levels[number - 1] if number else (self.values, self.values)


def _blocks(values: np.ndarray, join: np.ufunc) -> np.ndarray:
    if not len(values):
        return values
    return join.reduceat(values, np.arange(0, len(values), FACTOR))


def coarsest_level(samples: int, points: int) -> int:
    """Return the coarsest level that still has at least `points` blocks for so many samples.

    Examples
    --------
    >>> coarsest_level(1000, 1000), coarsest_level(8000, 1000), coarsest_level(63_999, 1000)
    (0, 1, 1)
    """
    number = 0
    while samples >= points * FACTOR ** (number + 1):
        number += 1
    return number


def decimate_channels(
    time: np.ndarray, channels: Mapping[str, Levels], start: float, stop: float, points: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return channels of one clock inside a span of time, so that a line through the points looks
    as through all samples.

    Parameters
    ----------
    time : ndarray (samples,)
        Ascending. [s]
    channels : mapping of str to Levels
    start, stop : float
        One sample more on either side is taken. [s]
    points : int
        Of the screen: at least so many blocks, where there are so many samples.

    Returns
    -------
    time : ndarray (n,)
    values : dict of str to ndarray (n,)
        All samples, or of each block the smallest value at its start and the largest in its middle.
    """
    first = max(int(np.searchsorted(time, start)) - 1, 0)
    last = min(int(np.searchsorted(time, stop, side="right")) + 1, len(time))
    number = coarsest_level(max(last - first, 0), points)
    if number == 0:
        return time[first:last], {
            name: channel.values[first:last] for name, channel in channels.items()
        }
    size = FACTOR**number
    blocks = slice(first // size, -(-last // size))
    starts = np.arange(blocks.start, blocks.stop) * size
    middle = np.minimum(starts + size // 2, len(time) - 1)
    places = np.column_stack([time[starts], time[middle]]).ravel()
    found = {
        name: np.column_stack([part[blocks] for part in channel.level(number)]).ravel()
        for name, channel in channels.items()
    }
    return places, found


def pack_traces(
    groups: Sequence[tuple[dict[str, object], np.ndarray, Mapping[str, np.ndarray]]],
) -> bytes:
    """Return traces as bytes for the page.

    Parameters
    ----------
    groups : sequence of (about, time, values)
        One per clock.

    Returns
    -------
    bytes
        Little-endian: length of the head as uint32, the head (JSON, padded by spaces so that the
        arrays begin at a multiple of 8), then of every group the time as float64 and each channel
        as float64.
    """
    head = [
        {**about, "samples": len(time), "channels": list(values)} for about, time, values in groups
    ]
    text = json.dumps(head).encode()
    text += b" " * (-(len(text) + 4) % 8)
    arrays = [
        np.asarray(part, "<f8").tobytes()
        for _, time, values in groups
        for part in (time, *values.values())
    ]
    return b"".join([len(text).to_bytes(4, "little"), text, *arrays])


T = TypeVar("T")
_KEPT = 64  # of each kind: a project's records and what was made of them

PATHS, FITS, MATCH = "paths", "fits", "match"
"""Folders of the working folder: reconstructed records, fits, and the outcome of a match."""


class OpenProject:
    """A project, its working folder and what was read of both; safe to use from several threads.

    Parameters
    ----------
    project : Path
        Project file.
    work : Path
        Working folder: paths, fits, match, the log of the actions.

    Attributes
    ----------
    run : callable or None
        `Jobs.run` of the server that it is open in; without one all is done in this process.
    """

    def __init__(self, project: Path, work: Path) -> None:
        self.file, self.work = project.resolve(), work.resolve()
        self.places = PlaceholderFolders(self.file.parent, self.work)
        self.log = self.work / "actions.jsonl"
        self.run: Callable[[str, str, Sequence[str]], WorkbenchJob] | None = None
        self._kept: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._lock = threading.Lock()
        self._making: dict[tuple[Any, ...], threading.Lock] = {}

    def kept(
        self, key: tuple[Any, ...], files: list[Path], make: Callable[[], T], most: int = _KEPT
    ) -> T:
        """Return what `make` gives, made once as long as none of the files changes.

        Of the kind ``key[0]`` the `most` last used are kept.
        """
        state = (*key, *((str(file), *_state(file)) for file in files))
        with self._lock:
            if state in self._kept:
                self._kept.move_to_end(state)
                return self._kept[state]
            making = self._making.setdefault(state, threading.Lock())
        with making:
            with self._lock:
                if state in self._kept:
                    return self._kept[state]
            found = make()
            with self._lock:
                self._kept[state] = found
                alike = [one for one in self._kept if one[0] == key[0]]
                for one in alike[: max(len(alike) - most, 0)]:
                    del self._kept[one]
                self._making.pop(state, None)
            return found

    @property
    def project(self) -> Project:
        """The project as its file is now."""
        return self.kept(("project",), [self.file], lambda: read_project(self.file))

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft of the project."""
        return self.kept(
            ("aircraft",), [self.project.aircraft], lambda: read_aircraft(self.project.aircraft)
        )

    def flight(self, name: str) -> Path:
        """Return the file of a flight record.

        Raises
        ------
        UnknownName
        """
        flights = self.project.flights
        if name not in flights:
            raise UnknownName(name, flights, "record")
        return flights[name]

    def record(self, name: str) -> xr.DataTree:
        """Return a flight record."""
        file, names = self.flight(name), self.project.names
        return self.kept(("record",), self.record_files(name), lambda: flighttest.read(file, names))

    def record_files(self, name: str) -> list[Path]:
        """Return the file of a flight record and, if the project has one, its name map."""
        files = [self.flight(name)]
        if self.project.names:
            files.append(self.project.names)
        return files

    def path_file(self, name: str) -> Path:
        """Return the file of a reconstructed record, which need not be there."""
        self.flight(name)
        return self.work / PATHS / f"{name}.nc"

    def path(self, name: str) -> Any:
        """Return a reconstructed record (`flighttest.dynamics.SavedPath`).

        Raises
        ------
        FileNotFoundError
            It has not been reconstructed.
        """
        file = self.path_file(name)
        if not file.exists():
            raise FileNotFoundError(2, "not reconstructed yet", str(file))
        return self.kept(("path",), [file], lambda: open_path(file))

    def levels(self, name: str, source: str) -> dict[str, DisplayedChannels]:
        """Return the channels of a record by clock; `source` is ``record`` or ``path``."""
        if source == "path":
            file = self.path_file(name)
            return self.kept(
                ("levels", source),
                [file],
                lambda: {"path": DisplayedChannels(self.path(name).states)},
            )

        def by_leaf() -> dict[str, DisplayedChannels]:
            leaves = self.record(name).children.items()
            return {leaf: DisplayedChannels(node.to_dataset()) for leaf, node in leaves}

        return self.kept(("levels", source), self.record_files(name), by_leaf)


class DisplayedChannels(Mapping[str, Levels]):
    """The channels of one clock in display units, each converted when it is first drawn."""

    def __init__(self, data: xr.Dataset) -> None:
        self.time = data["time"].values
        self._items = {
            str(name): item
            for name, item in data.data_vars.items()
            if item.dims == ("time",) and item.dtype.kind in "fiub"
        }
        self._made: dict[str, Levels] = {}

    def __getitem__(self, name: str) -> Levels:
        if name not in self._made:
            self._made[name] = Levels(
                to_display_quantity(name, self._items[name].values.astype(float))[0]
            )
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


def _state(file: Path) -> tuple[int, int]:
    """Return what changes when a file does; it may be absent."""
    try:
        found = file.stat()
    except FileNotFoundError:
        return (0, 0)
    return (found.st_mtime_ns, found.st_size)
