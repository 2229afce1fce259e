import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import chapter10 as ch10

import flighttest
from flightmech.errors import ParseError, SchemaError, UnknownName
from flighttest.records.readers.opening import recognise_recording

SECOND = 10_000_000  # ticks
START = 7 * SECOND
MOMENT = datetime(2024, 2, 29, 23, 59, 58, 230000)


def bus_packets():
    ch10.fresh()
    out = [ch10.setup(0), ch10.time(1, START, MOMENT)]
    for k in range(20):
        rtc = START + SECOND + k * SECOND // 10
        words = [
            (0, 0, ch10.bnr(0o210, 15, 2048.0, 250.0 + k)),
            (20_000, 0, ch10.bnr(0o325, 14, 180.0, -2.0 * k)),
            (20_000, 1, ch10.bnr(0o210, 15, 2048.0, 99.0)),
        ]
        out.append(ch10.arinc(12, rtc, words))
        theta, lat = (round(1.5 * k / 0.0054931640625)) & 0xFFFF, round(48.1 / 180 * 2**31)
        sent = [ch10.command(5, True, 1, 5), 0x2800, 7, theta, lat >> 16, lat & 0xFFFF, 0x8000 | k]
        received = [ch10.command(6, False, 2, 2), 100 + k, 200, 0x3000]
        faulty = [ch10.command(5, True, 1, 5), 0x2800, *[0xFFFF] * 5]
        messages = [
            (rtc + 50, 0, sent),
            (rtc + 900, 0, received),
            (rtc + 2000, 0x1000, faulty),
            (rtc + 3000, 0x0800, [*received, 0]),
        ]
        out.append(ch10.bus_1553(3, rtc, messages))
    return out


NAMES = """
[decode.adc]
kind = "arinc429"
channel = 12
bus = 0
labels = "octal"
[decode.adc.parameters]
tas = { label = "210", code = "bnr", bits = 15, range = 2048, unit = "kt" }
roll = { label = "325", code = "bnr", bits = 14, range = 180, unit = "deg" }
[decode.ins]
kind = "mil1553"
channel = 3
rt = 5
subaddress = 1
direction = "transmit"
[decode.ins.parameters]
theta = { word = 2, code = "twos", lsb = 0.0054931640625, unit = "deg" }
lat = { word = [3, 4], code = "twos", lsb = 8.381903171539307e-08, unit = "deg" }
down = { word = 5, code = "magnitude", unit = "m" }
low = { word = 5, code = "unsigned", bits = [0, 3], unit = "m" }
[decode.fcc]
kind = "mil1553"
channel = 3
rt = 6
subaddress = 2
direction = "receive"
[decode.fcc.parameters]
count = { word = 1, code = "unsigned", lsb = 0.5, offset = 1.0, unit = "deg" }
[air]
V = "adc.tas"
[roll]
phi = "adc.roll"
[ins]
theta = "ins/theta"
lat = "ins/lat"
h = "ins/down"
h_baro = "ins/low"
[fcc]
delta_e = "fcc"
"""


def recorded(tmp_path, packets, names):
    (tmp_path / "f.ch10").write_bytes(b"".join(packets))
    (tmp_path / "n.toml").write_text(names)
    return tmp_path / "f.ch10", tmp_path / "n.toml"


def test_buses_in_engineering_units(tmp_path):
    file, names = recorded(tmp_path, bus_packets(), NAMES)
    assert recognise_recording(file) == "chapter10"
    record = flighttest.read(file, names)
    k = np.arange(20)
    np.testing.assert_allclose(record["air/V"].values, (250.0 + k) * 1852 / 3600)
    np.testing.assert_allclose(np.degrees(record["roll/phi"].values), -2.0 * k, atol=180 / 2**15)
    # the clock begins with the first packet of data, here the time packet; gap times are from word
    # to word
    np.testing.assert_allclose(record["air/time"].values, 1.0 + 0.1 * k, atol=1e-9)
    np.testing.assert_allclose(record["roll/time"].values, 1.002 + 0.1 * k, atol=1e-9)
    np.testing.assert_allclose(np.degrees(record["ins/theta"].values), 1.5 * k, atol=0.0028)
    np.testing.assert_allclose(np.degrees(record["ins/lat"].values), 48.1, atol=1e-7)
    np.testing.assert_allclose(record["ins/h"].values, -k.astype(float))
    np.testing.assert_allclose(record["ins/h_baro"].values, k % 16)
    np.testing.assert_allclose(record["ins/time"].values, 1.000005 + 0.1 * k, atol=1e-9)
    np.testing.assert_allclose(np.degrees(record["fcc/delta_e"].values), 1.0 + 0.5 * (100 + k))
    assert record.attrs["start"] == "2024-02-29T23:59:58.230000Z"
    assert flighttest.records.faults(record) == []


def test_day_of_the_year_names_no_year(tmp_path):
    packets = bus_packets()
    packets[1] = ch10.time(1, START, MOMENT, dated=False)
    file, names = recorded(tmp_path, packets, NAMES)
    assert flighttest.read(file, names).attrs["start_day_of_year"] == "060T23:59:58.230000"


PCM = """
[decode.fti]
kind = "pcm"
channel = 7
word_bits = {bits}
frame_words = 8
counter = {{ word = 3, first = 0 }}
[decode.fti.parameters]
pot = {{ word = 4, code = "unsigned", bits = [0, 9], unit = "deg" }}
nz = {{ word = [5, 7], repeated = true, code = "twos", lsb = 0.01, unit = "g" }}
oil = {{ word = 6, frame = 2, frames = 4, code = "offset", unit = "Pa" }}
[c]
delta_e = "fti"
[n]
az_imu = "fti.nz"
[o]
p_static = "fti.oil"
"""


@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("wide", [True, False])
def test_pcm_frames(tmp_path, bits, packed, wide):
    ch10.fresh()
    mask = (1 << bits) - 1
    packets = []
    for k in range(10):
        rtc = START + k * SECOND // 10
        frames = []
        for j in range(4):
            n = 4 * k + j
            frames.append(
                (
                    rtc + j * SECOND // 40,
                    [
                        0xFE6B & mask,
                        0x2840 & mask,
                        j,
                        n,
                        -2 * n & mask,
                        (1 << (bits - 1)) + 10 + n,
                        -(2 * n + 1) & mask,
                        0,
                    ],
                )
            )
        packets.append(ch10.pcm(7, rtc, frames, bits, packed, wide))
    file, names = recorded(tmp_path, packets, PCM.format(bits=bits))
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.degrees(record["c/delta_e"].values), np.arange(40), atol=1e-9)
    np.testing.assert_allclose(record["c/time"].values, 0.025 * np.arange(40), atol=1e-9)
    np.testing.assert_allclose(record["n/az_imu"].values, -0.01 * 9.80665 * np.arange(80))
    np.testing.assert_allclose(
        record["n/time"].values[:4], 0.025 * np.array([4 / 8, 6 / 8, 12 / 8, 14 / 8]), atol=1e-9
    )
    np.testing.assert_allclose(record["o/p_static"].values, 10 + np.arange(2, 40, 4))


@pytest.mark.parametrize(("bits", "mode"), [(16, 0), (12, 0), (12, 1), (12, 3)])
def test_analogue_samples(tmp_path, bits, mode):
    ch10.fresh()
    rows = [(i, -i) for i in range(60)]
    packets = [
        ch10.analog(9, START + k * SECOND // 5, rows[20 * k : 20 * k + 20], bits, mode)
        for k in range(3)
    ]
    text = '[decode.a]\nkind = "analog"\nchannel = 9\n[decode.a.parameters]\n'
    text += 'force = { subchannel = 2, code = "twos", lsb = 0.5, unit = "N" }\n'
    file, names = recorded(tmp_path, packets, text + '[f]\nengine1.thrust = "a"\n')
    record = flighttest.read(file, names)
    np.testing.assert_allclose(record["f/engine1.thrust"].values, -0.5 * np.arange(60))
    np.testing.assert_allclose(record["f/time"].values, np.arange(60) / 100, atol=1e-9)


def test_missing_and_damaged_packets_are_reported(tmp_path):
    packets = bus_packets()
    damaged = bytearray(packets[10])
    damaged[4] ^= 0xFF  # its length, so the checksum of its header fails
    packets[10] = bytes(damaged)
    del packets[21]
    file, names = recorded(tmp_path, packets, NAMES)
    record = flighttest.read(file, names)
    found = " | ".join(flighttest.records.faults(record))
    assert "are not packets and were skipped" in found
    assert "channel 3: 1 packets missing by their sequence numbers" in found
    assert "channel 12: 1 packets missing" in found
    assert record["air"].sizes["time"] == 19


def test_end_that_was_cut_off(tmp_path):
    file, names = recorded(tmp_path, bus_packets(), NAMES)
    file.write_bytes(file.read_bytes()[:-17])
    assert (
        "the end of the file may be cut off"
        in flighttest.records.faults(flighttest.read(file, names))[0]
    )


def test_count_of_words_that_does_not_fit_its_packet(tmp_path):
    packets = bus_packets()
    body = (1000).to_bytes(4, "little") + bytes(24)
    packets.append(ch10.packet(12, 0x38, START + 4 * SECOND, body))
    packets.append(ch10.packet(3, 0x19, START + 4 * SECOND, body))
    file, names = recorded(tmp_path, packets, NAMES)
    found = " | ".join(flighttest.records.faults(flighttest.read(file, names)))
    assert "1000 ARINC 429 words do not fit its 28 bytes; left out" in found
    assert "cut off inside a MIL-STD-1553 message" in found


def test_without_a_table_of_words_the_channels_are_listed(tmp_path):
    file, _ = recorded(tmp_path, bus_packets(), NAMES)
    with pytest.raises(
        SchemaError, match=r"channel 3: MIL-STD-1553, 20 packets; channel 12: ARINC 429, 20 packets"
    ):
        flighttest.read(file)
    rows = flighttest.records.contents(file)["channels"]
    assert rows[1] == {"channel": 12, "content": "ARINC 429", "packets": 20, "labels": "210 325"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("channel = 12", "channel = 13", "unknown channel of ARINC 429 packets '13'; near it: 12"),
        ("rt = 5", "rt = 9", "rt 5 transmit subaddress 1"),
        ('label = "325"', 'label = "324"', "unknown ARINC 429 label '324'; near it: 325"),
    ],
)
def test_what_is_not_there(tmp_path, old, new, words):
    file, names = recorded(tmp_path, bus_packets(), NAMES.replace(old, new))
    with pytest.raises(UnknownName, match=words):
        flighttest.read(file, names)


def test_throughput_mode_is_refused(tmp_path):
    ch10.fresh()
    body = (1 << 19).to_bytes(4, "little") + bytes(64)
    file, names = recorded(tmp_path, [ch10.packet(7, 0x09, START, body)], PCM.format(bits=16))
    with pytest.raises(ParseError, match=r"PCM in throughput mode \(packet at byte 0\)"):
        flighttest.read(file, names)


def test_no_packet_at_all(tmp_path):
    file, names = recorded(tmp_path, [b"\x25\xeb" + bytes(200)], NAMES)
    with pytest.raises(ParseError, match="no packet with a valid header"):
        flighttest.read(file, names)
