"""Open project: content of its files, each read once until the file changes."""

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
from aeromatch.workbench.allowed_actions import PlaceholderFolders
from aeromatch.workbench.processes import WorkbenchJob
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import aircraft_files, read_aircraft
from flightmech.errors import UnknownName
from flightmech.support.figures import to_display_quantity
from flighttest.reconstruction.dynamics.saved_paths import open_path

FACTOR = 8
"""Number of samples of a level that a block of the next level joins."""


class Levels:
    """One channel with its levels of detail.

    Parameters
    ----------
    values : ndarray (samples,)
        Samples; NaN for a missing sample.
    """

    def __init__(self, values: np.ndarray) -> None:
        self.values = np.asarray(values, np.float64)
        self._levels: list[tuple[np.ndarray, np.ndarray]] = []

    def level(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest values of blocks of ``FACTOR ** number`` samples.

        The last block may be shorter.
        """
        if number == 0:
            return self.values, self.values
        # Each level is made from the one before.
        while len(self._levels) < number:
            low, high = self.level(len(self._levels))
            self._levels.append((_join_blocks(low, np.fmin), _join_blocks(high, np.fmax)))
        return self._levels[number - 1]


def _join_blocks(values: np.ndarray, extreme: np.ufunc) -> np.ndarray:
    if not len(values):
        return values
    return extreme.reduceat(values, np.arange(0, len(values), FACTOR))


def coarsest_level(samples: int, points: int) -> int:
    """Return the coarsest level that has at least `points` blocks for a number of samples.

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
    """Return channels of one clock inside a span of time, for a line on a screen.

    A line through the points looks like a line through all samples.

    Parameters
    ----------
    time : ndarray (samples,)
        Ascending clock. [s]
    channels : mapping of str to Levels
    start, stop : float
        Span of time.  One sample more on either side is returned. [s]
    points : int
        Points of the screen.  The result has at least as many blocks, if there are enough samples.

    Returns
    -------
    time : ndarray (n,)
    values : dict of str to ndarray (n,)
        All samples; or of each block the smallest value at its start and the largest value in its
        middle.
    """
    first = max(int(np.searchsorted(time, start)) - 1, 0)
    last = min(int(np.searchsorted(time, stop, side="right")) + 1, len(time))
    number = coarsest_level(max(last - first, 0), points)
    values = {}
    if number == 0:
        for name, channel in channels.items():
            values[name] = channel.values[first:last]
        return time[first:last], values
    size = FACTOR**number
    # The stop is rounded up to a full block.
    blocks = slice(first // size, -(-last // size))
    starts = np.arange(blocks.start, blocks.stop) * size
    middles = np.minimum(starts + size // 2, len(time) - 1)
    # Two points per block, in the order of time.
    times = np.column_stack([time[starts], time[middles]]).ravel()
    for name, channel in channels.items():
        low, high = channel.level(number)
        values[name] = np.column_stack([low[blocks], high[blocks]]).ravel()
    return times, values


def pack_traces(
    groups: Sequence[tuple[dict[str, object], np.ndarray, Mapping[str, np.ndarray]]],
) -> bytes:
    """Return traces as bytes for the page.

    Parameters
    ----------
    groups : sequence of (dict, ndarray, mapping of str to ndarray)
        Description, time and channels of every clock.

    Returns
    -------
    bytes
        Little-endian: length of the head as uint32, and the head as JSON.  Then the time of every
        group as float64, and each of its channels as float64.  Spaces after the head move the
        arrays to a multiple of 8 bytes.
    """
    heads, arrays = [], []
    for description, time, values in groups:
        heads.append({**description, "samples": len(time), "channels": list(values)})
        for array in (time, *values.values()):
            arrays.append(np.asarray(array, "<f8").tobytes())
    text = json.dumps(heads).encode()
    text += b" " * (-(len(text) + 4) % 8)
    return b"".join([len(text).to_bytes(4, "little"), text, *arrays])


T = TypeVar("T")
# Greatest number of stored items of a kind.
_MOST_ITEMS = 64

PATHS, FITS, MATCH = "paths", "fits", "match"
"""Folders of the working folder: reconstructed records, fits, and the results of a match."""


class OpenProject:
    """A project with its working folder and the content of both.

    Several threads may use an object at once.

    Parameters
    ----------
    project : Path
        Project file.
    work : Path
        Working folder with reconstructed records, fits, match, and log of the actions.

    Attributes
    ----------
    run : callable or None
        Method `Jobs.run` of the server.  Without a server, all work is done in this process.
    """

    def __init__(self, project: Path, work: Path) -> None:
        self.file, self.work = project.resolve(), work.resolve()
        self.places = PlaceholderFolders(self.file.parent, self.work)
        self.log = self.work / "actions.jsonl"
        self.run: Callable[[str, str, Sequence[str]], WorkbenchJob] | None = None
        # Items by key and state of their files; the item that was used last is at the end.
        self._items: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._lock = threading.Lock()
        # A lock for every item that a thread makes now.
        self._item_locks: dict[tuple[Any, ...], threading.Lock] = {}

    def kept(
        self,
        key: tuple[Any, ...],
        files: list[Path],
        make: Callable[[], T],
        most: int = _MOST_ITEMS,
    ) -> T:
        """Return the result of a function, stored as long as none of its files changes.

        Parameters
        ----------
        key : tuple
            Kind of the item, and what distinguishes it from others of its kind.
        files : list of Path
            Files on which the result depends.
        make : callable
            Function without arguments.
        most : int
            Greatest number of stored items of the kind.  Those that were used last stay.
        """
        states = [(str(file), *_file_state(file)) for file in files]
        full_key = (*key, *states)
        with self._lock:
            if full_key in self._items:
                self._items.move_to_end(full_key)
                return self._items[full_key]
            item_lock = self._item_locks.setdefault(full_key, threading.Lock())
        # Another thread that requests the same item waits for it, and then finds it stored.
        with item_lock:
            with self._lock:
                if full_key in self._items:
                    return self._items[full_key]
            item = make()
            with self._lock:
                self._items[full_key] = item
                self._remove_oldest(key[0], most)
                self._item_locks.pop(full_key, None)
            return item

    def _remove_oldest(self, kind: Any, most: int) -> None:
        """Remove items of a kind until there are at most ``most`` of them."""
        same_kind = [key for key in self._items if key[0] == kind]
        for key in same_kind[: max(len(same_kind) - most, 0)]:
            del self._items[key]

    @property
    def project(self) -> Project:
        """Project, from its file as it is now."""
        return self.kept(("project",), [self.file], lambda: read_project(self.file))

    @property
    def aircraft(self) -> Aircraft:
        """Aircraft of the project."""
        file = self.project.aircraft
        return self.kept(("aircraft",), self.aircraft_files, lambda: read_aircraft(file))

    @property
    def aircraft_files(self) -> list[Path]:
        """Aircraft file of the project, and the files of tables that it names."""
        file = self.project.aircraft
        return self.kept(("aircraft files",), [file], lambda: aircraft_files(file))

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
        """Return the file of a reconstructed record; the file need not exist."""
        self.flight(name)
        return self.work / PATHS / f"{name}.nc"

    def path(self, name: str) -> Any:
        """Return a reconstructed record (`flighttest.dynamics.SavedPath`).

        Raises
        ------
        FileNotFoundError
            The record has not been reconstructed.
        """
        file = self.path_file(name)
        if not file.exists():
            raise FileNotFoundError(2, "not reconstructed yet", str(file))
        return self.kept(("path",), [file], lambda: open_path(file))

    def levels(self, name: str, source: str) -> dict[str, DisplayedChannels]:
        """Return the channels of a record by clock; `source` is ``record`` or ``path``."""
        if source == "path":
            files = [self.path_file(name)]
            return self.kept(("levels", source), files, lambda: self._path_channels(name))
        files = self.record_files(name)
        return self.kept(("levels", source), files, lambda: self._record_channels(name))

    def _path_channels(self, name: str) -> dict[str, DisplayedChannels]:
        return {"path": DisplayedChannels(self.path(name).states)}

    def _record_channels(self, name: str) -> dict[str, DisplayedChannels]:
        """Return the channels of a record by the name of its time base."""
        channels = {}
        for leaf, node in self.record(name).children.items():
            channels[leaf] = DisplayedChannels(node.to_dataset())
        return channels


class DisplayedChannels(Mapping[str, Levels]):
    """Channels of one clock in display units.

    A channel is converted when it is drawn for the first time.
    """

    def __init__(self, data: xr.Dataset) -> None:
        self.time = data["time"].values
        self._variables = {}
        for name, variable in data.data_vars.items():
            # Numbers and truth values: float, int, unsigned, bool.
            if variable.dims == ("time",) and variable.dtype.kind in "fiub":
                self._variables[str(name)] = variable
        self._levels: dict[str, Levels] = {}

    def __getitem__(self, name: str) -> Levels:
        if name not in self._levels:
            values = self._variables[name].values.astype(float)
            displayed, _ = to_display_quantity(name, values)
            self._levels[name] = Levels(displayed)
        return self._levels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._variables)

    def __len__(self) -> int:
        return len(self._variables)


def _file_state(file: Path) -> tuple[int, int]:
    """Return time and size of a file, which change with its content; zeros without a file."""
    try:
        status = file.stat()
    except FileNotFoundError:
        return (0, 0)
    return (status.st_mtime_ns, status.st_size)
