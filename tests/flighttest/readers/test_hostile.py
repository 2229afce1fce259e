"""Damaged files of every format: read, or refused with an error of the package; never another
exception, never endless.
"""

import gzip
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import chapter10, dataflash, ulog

import flighttest
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flighttest.records.readers.formats import csv_text, ulog_topics

T = np.arange(200) / 50
NAMES = '[imu]\nq = { column = ["q", "IMU/q", "imu/q", "bus.q"], unit = "rad/s" }\n'
DECODE = """
[decode.bus]
kind = "arinc429"
channel = 12
labels = "octal"
[decode.bus.parameters]
q = { label = "210", code = "bnr", bits = 15, range = 2048, unit = "1" }
[decode.ins]
kind = "mil1553"
channel = 3
rt = 5
subaddress = 1
direction = "transmit"
[decode.ins.parameters]
x = { word = 1, code = "twos" }
[decode.fti]
kind = "pcm"
channel = 7
word_bits = 16
frame_words = 4
[decode.fti.parameters]
x = { word = 3, code = "twos" }
[decode.a]
kind = "analog"
channel = 9
[decode.a.parameters]
x = { subchannel = 1, code = "twos" }
"""


def csv(path):
    path.write_text("time,q\n" + "".join(f"{t},{t}\n" for t in T))


def zipped(path):
    path.write_bytes(gzip.compress(b"time,q\n" + b"".join(f"{t},{t}\n".encode() for t in T)))


def matlab(path):
    scipy.io.savemat(path, {"t": T, "q": T, "imu": {"t": T, "q": T}}, do_compression=True)


def hdf5(path):
    with h5py.File(path, "w") as file:
        file["t"], file["q"] = T, T
        file.create_dataset("imu/q", data=T, compression="gzip")
        file["imu/t"] = T


def classic(path):
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("n", len(T))
        for name in ("t", "q"):
            file.createVariable(name, "d", ("n",))[:] = T


def px4(path):
    rows = [(int(1e6 * t) + 1, t) for t in T]
    path.write_bytes(
        ulog.written({("imu", 0): ([("uint64_t", "timestamp"), ("float", "q")], rows)})
    )


def ardupilot(path):
    rows = [(int(1e6 * t), t) for t in T]
    path.write_bytes(
        dataflash.written({"IMU": ("Qf", "TimeUS,q", "sE", "F0", rows)}, {"s": "s", "E": "rad/s"})
    )


def ch10(path):
    chapter10.fresh()
    out = []
    for k in range(20):
        rtc = 100_000 * k
        out.append(chapter10.arinc(12, rtc, [(0, 0, chapter10.bnr(0o210, 15, 2048.0, 1.0 * k))]))
        out.append(
            chapter10.bus_1553(3, rtc, [(rtc, 0, [chapter10.command(5, True, 1, 2), 0, 1, 2])])
        )
        out.append(chapter10.pcm(7, rtc, [(rtc, [1, 2, 3, 4])]))
        out.append(chapter10.analog(9, rtc, [(1,), (2,)]))
    path.write_bytes(b"".join(out))


WRITERS = {w.__name__: w for w in (csv, zipped, matlab, hdf5, classic, px4, ardupilot, ch10)}


def mutants(whole, seed, count):
    """Cuts, flipped bytes, zeroed and repeated stretches."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        raw = bytearray(whole)
        place = int(rng.integers(len(raw)))
        if i % 4 == 0:
            del raw[place:]
        elif i % 4 == 1:
            for at in rng.integers(len(raw), size=int(rng.integers(1, 12))):
                raw[at] ^= 1 << int(rng.integers(8))
        elif i % 4 == 2:
            raw[place : place + 64] = bytes(min(64, len(raw) - place))
        else:
            raw[place:place] = raw[: int(rng.integers(200))]
        yield bytes(raw)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.filterwarnings("ignore")
def test_damage_never_escapes(tmp_path, kind, mat_files_in_this_process):
    (tmp_path / "n.toml").write_text(NAMES + (DECODE if kind == "ch10" else ""))
    file = tmp_path / "f.bin"
    WRITERS[kind](file)
    whole = file.read_bytes()
    assert flighttest.read(file, tmp_path / "n.toml")["imu"].sizes["time"] > 15
    refused = 0
    for raw in mutants(whole, 7, 60):
        file.write_bytes(raw)
        try:
            flighttest.read(file, tmp_path / "n.toml")
        except AeromatchError:
            refused += 1
    assert refused > 0


def test_empty_and_unknown_files(tmp_path):
    (tmp_path / "f").write_bytes(b"")
    with pytest.raises(ParseError, match="an empty file"):
        flighttest.read(tmp_path / "f")
    (tmp_path / "f").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(ParseError, match="one of the formats"):
        flighttest.read(tmp_path / "f")
    with pytest.raises(FileNotFoundError):
        flighttest.read(tmp_path / "nowhere.csv")


def test_a_gzip_bomb_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_text, "_LARGEST_UNPACKED", 1000)
    path = tmp_path / "flight.csv.gz"
    path.write_bytes(gzip.compress(b"time [s],q [rad/s]\n" + b"0,0\n" * 250))
    with pytest.raises(ParseError, match="behind gzip; expected less; unpack it with gunzip"):
        flighttest.read(path)


def test_a_damaged_stamp_does_not_make_a_record_of_years(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("time [s],q [rad/s]\n0,0\n0.02,0\n0.04,0\n1e12,0\n")
    with pytest.raises(SchemaError, match=r"behind sample 2 at 0\.04 s is longer than the 2 days"):
        flighttest.read(path)


def test_a_clock_of_two_equal_stamps_is_refused(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("time [s],q [rad/s]\n0,0\n0,1\n")
    with pytest.raises(SchemaError, match="2 samples of one stamp; at least two stamps"):
        flighttest.read(path)


@pytest.mark.parametrize("size", [100, 1, 0xFFFF])
def test_formats_of_ulog_in_each_other_are_counted_before_they_are_listed(
    tmp_path, monkeypatch, size
):
    """Three kilobytes whose sixty formats require `size` to the power of sixty fields."""
    monkeypatch.setattr(ulog_topics, "MOST_FIELDS", 5000)
    formats = [f"a{k}:uint64_t timestamp;a{k + 1}[{size}] x;" for k in range(60)]
    # a topic of arrays of one element has some hundred fields; there are many topics
    content = [ulog.written({})]
    content += [ulog.message("F", text.encode()) for text in [*formats, "a60:float y;"]]
    content += [ulog.message("A", bytes(3) + b"a0")] * (1 if size > 1 else 100)
    (tmp_path / "a.ulg").write_bytes(b"".join(content))
    with pytest.raises(ParseError, match="more than 5000 fields"):
        flighttest.read(tmp_path / "a.ulg")
