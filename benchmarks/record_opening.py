"""Opening a flight of 90 minutes, 60 channels at 50 Hz (270 000 samples, 130 MB as numbers) in
every format; ratios within one run.

Peers read the raw numbers only: `pandas.read_csv` the CSV, scipy the MATLAB file, h5py the netCDF
files, pyulog and asammdf their own. `flighttest.read` does that and maps, calibrates, changes
units, settles the clock, and looks for missing, held and spiked samples in every channel.  Times
are the best of REPEATS, with the file in the page cache; CPU time as well as that of the clock, for
machines that others use too.

python benchmarks/record_opening.py [MINUTES]
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pandas as pd
import scipy.io
import xarray as xr

import flighttest
from flightmech.names import VOCABULARY
from flightmech.support.console import print_table
from flighttest.records.readers.name_map import Channel, NameMap

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "flighttest"))
from recorders import dataflash, ulog

CHANNELS, RATE, REPEATS = 59, 50, 3


def flight(minutes: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Clock and channels of a noisy flight, rounded as a recorder does."""
    rng = np.random.default_rng(0)
    t = np.arange(round(minutes * 60 * RATE)) / RATE
    names = [name for name in VOCABULARY if name not in ("time", "delta_a_left", "delta_a_right")][
        :CHANNELS
    ]
    return t, {
        name: np.round(10 * np.sin(t / (i + 3)) + rng.normal(0, 0.1, len(t)), 4)
        for i, name in enumerate(names)
    }


def best(work: Callable[[], object]) -> tuple[float, float]:
    """Shortest of some runs: clock and CPU, with that of child processes. [s]"""
    clocks, cpus = [], []
    for _ in range(REPEATS):
        begin, used = time.perf_counter(), sum(os.times()[:4])
        work()
        clocks.append(time.perf_counter() - begin)
        cpus.append(sum(os.times()[:4]) - used)
    return min(clocks), min(cpus)


def mapping(columns: dict[str, str]) -> NameMap:
    """All channels, each in the unit of the vocabulary."""
    return NameMap(
        {
            "all": {
                name: Channel(column=column, unit=VOCABULARY[name].units)
                for name, column in columns.items()
            }
        }
    )


def write_csv(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    pd.DataFrame({"time": t, **data}).to_csv(path, index=False)
    return mapping({name: name for name in data})


def write_netcdf(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    xr.Dataset({name: ("time", x) for name, x in data.items()}, {"time": t}).to_netcdf(
        path, engine="h5netcdf"
    )
    return mapping({name: name for name in data})


def write_packed(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    coding = {
        name: {
            "dtype": "i4",
            "scale_factor": 1e-4,
            "_FillValue": -(2**31),
            "zlib": True,
            "complevel": 1,
        }
        for name in data
    }
    xr.Dataset({name: ("time", x) for name, x in data.items()}, {"time": t}).to_netcdf(
        path, engine="h5netcdf", encoding=coding
    )
    return mapping({name: name for name in data})


def write_matlab(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    scipy.io.savemat(path, {"t": t, **{f"c{i}": x for i, x in enumerate(data.values())}})
    return mapping({name: f"c{i}" for i, name in enumerate(data)})


def write_ulog(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    fields = [("uint64_t", "timestamp"), *(("float", f"c{i}") for i in range(CHANNELS))]
    rows = np.column_stack([np.round(1e6 * t) + 1, *data.values()]).tolist()
    path.write_bytes(
        ulog.written({("flight", 0): (fields, [(int(row[0]), *row[1:]) for row in rows])})
    )
    return mapping({name: f"flight/c{i}" for i, name in enumerate(data)})


def write_dataflash(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    """Fifteen channels to a message: a format has sixteen characters."""
    names, messages, columns = list(data), {}, {}
    for k in range(0, CHANNELS, 15):
        part = names[k : k + 15]
        rows = np.column_stack([np.round(1e6 * t), *(data[name] for name in part)]).tolist()
        heads = ",".join(f"f{i}" for i in range(len(part)))
        messages[f"M{k}"] = (
            "Q" + "f" * len(part),
            f"TimeUS,{heads}",
            "s" * 16,
            "F" + "-" * 15,
            [(int(row[0]), *row[1:]) for row in rows],
        )
        columns.update({name: f"M{k}/f{i}" for i, name in enumerate(part)})
    path.write_bytes(dataflash.written(messages))
    return NameMap(_by_message(columns))


def _by_message(columns: dict[str, str]) -> dict[str, dict[str, Channel]]:
    leaves: dict[str, dict[str, Channel]] = {}
    for name, column in columns.items():
        leaves.setdefault(column.split("/")[0], {})[name] = Channel(
            column=column, unit=VOCABULARY[name].units
        )
    return leaves


def write_mdf(path: Path, t: np.ndarray, data: dict[str, np.ndarray]) -> NameMap:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append(
            [Signal(x, t, name=f"c{i}") for i, x in enumerate(data.values())], acq_name="flight"
        )
        file.save(path, overwrite=True)
    return mapping({name: f"flight/c{i}" for i, name in enumerate(data)})


def _h5py(path: Path) -> None:
    with h5py.File(path) as file:
        for name in file:
            file[name][()]


def _asammdf(path: Path) -> None:
    from asammdf import MDF

    with MDF(path) as file:
        file.select([(None, 0, i) for i in range(1, CHANNELS + 1)])


def _pyulog(path: Path) -> None:
    from pyulog import ULog

    ULog(str(path))


FORMATS: dict[str, tuple[str, Callable[..., NameMap], str, Callable[[Path], object] | None]] = {
    "CSV": ("f.csv", write_csv, "pandas.read_csv", pd.read_csv),
    "netCDF-4": ("f.nc", write_netcdf, "h5py", _h5py),
    "netCDF-4, 32-bit integers, zlib": ("g.nc", write_packed, "h5py", _h5py),
    "MATLAB v5": ("f.mat", write_matlab, "scipy.io.loadmat", scipy.io.loadmat),
    "MDF4": ("f.mf4", write_mdf, "asammdf select", _asammdf),
    "ULog": ("f.ulg", write_ulog, "pyulog", _pyulog),
    "DataFlash": ("f.bin", write_dataflash, "", None),
}


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 90.0
    t, data = flight(minutes)
    rows = []
    with TemporaryDirectory() as folder:
        for kind, (name, write, peer, raw) in FORMATS.items():
            path = Path(folder) / name
            names = write(path, t, data)
            ours, cpu = best(partial(flighttest.read, path, names))
            theirs = best(partial(raw, path))[0] if raw else None
            size = path.stat().st_size / 1e6
            ratio = ("", "") if theirs is None else (f"{theirs:.2f}", f"{ours / theirs:.2f}")
            rows.append((kind, f"{size:.0f}", f"{ours:.2f}", f"{cpu:.2f}", peer, *ratio))
            path.unlink()
    title = (
        f"{len(t)} samples of {CHANNELS} channels and the clock ({minutes:g} minutes at {RATE} Hz)"
    )
    heads = ["format", "MB", "read [s]", "CPU [s]", "peer, raw numbers only", "peer [s]", "ratio"]
    print_table(heads, rows, title, right=["MB", "read [s]", "CPU [s]", "peer [s]", "ratio"])


if __name__ == "__main__":
    main()
