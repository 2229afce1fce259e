"""IRIG 106 Chapter 10 packets after Chapter 11 of the standard (106-17): 11.2.1 header, 11.2.3.2
time, 11.2.2.1 PCM, 11.2.4.1 MIL-STD-1553, 11.2.5.1 analogue, 11.2.8.1 ARINC 429.
"""

import struct
from datetime import datetime

_SEQUENCE: dict[int, int] = {}


def packet(channel, kind, rtc, body, flags=0):
    """A packet with a 32-bit data checksum field; `rtc` in ticks of 100 ns."""
    number = _SEQUENCE[channel] = (_SEQUENCE.get(channel, -1) + 1) % 256
    padding = -(24 + len(body) + 4) % 4
    size = 24 + len(body) + padding + 4
    head = struct.pack(
        "<HHIIBBBB", 0xEB25, channel, size, len(body), 0x06, number, flags | 0b11, kind
    ) + rtc.to_bytes(6, "little")
    head += struct.pack("<H", sum(struct.unpack("<11H", head)) & 0xFFFF)
    checksum = sum(body[i] << 8 * (i % 4) for i in range(len(body))) & 0xFFFFFFFF
    return head + body + bytes(padding) + struct.pack("<I", checksum)


def fresh():
    _SEQUENCE.clear()


def _bcd(number, digits):
    return sum(int(d) << 4 * i for i, d in enumerate(reversed(f"{number:0{digits}d}")))


def time(channel, rtc, moment: datetime, dated=True):
    head = struct.pack("<I", 1 | (4 << 4) | (int(dated) << 9))
    words = [
        _bcd(moment.microsecond // 10000, 2) | _bcd(moment.second, 2) << 8,
        _bcd(moment.minute, 2) | _bcd(moment.hour, 2) << 8,
    ]
    if dated:
        words += [_bcd(moment.day, 2) | _bcd(moment.month, 2) << 8, _bcd(moment.year, 4)]
    else:
        words += [_bcd(moment.timetuple().tm_yday, 3)]
    return packet(channel, 0x11, rtc, head + struct.pack(f"<{len(words)}H", *words))


def setup(channel):
    return packet(channel, 0x01, 0, struct.pack("<I", 0) + b"G\\PN:TEST;\r\n")


def arinc(channel, rtc, words):
    """words: [(gap in ticks, bus, word)]."""
    body = struct.pack("<I", len(words))
    for gap, bus, word in words:
        body += struct.pack("<II", gap | bus << 24, word)
    return packet(channel, 0x38, rtc, body)


def bnr(label, bits, scale, value, ssm=3, sdi=0):
    """An ARINC 429 BNR word, label as octal number in the lowest byte, odd parity."""
    count = round(value / scale * (1 << bits)) & ((1 << (bits + 1)) - 1)
    return _odd(label | sdi << 8 | (count << (28 - bits)) & 0x1FFFFC00 | ssm << 29)


def bcd(label, digits, value):
    text = f"{abs(value):0{digits}d}"
    word = label | (3 if value < 0 else 0) << 29 | int(text[0]) << 26
    for i, digit in enumerate(text[1:], 1):
        word |= int(digit) << (26 - 4 * i)
    return _odd(word)


def discrete(label, bit, on):
    return _odd(label | int(on) << (bit - 1))


def _odd(word):
    word &= 0x7FFFFFFF
    return word | (0x80000000 if bin(word).count("1") % 2 == 0 else 0)


def bus_1553(channel, rtc, messages):
    """messages: [(tick, block status, words)]."""
    body = struct.pack("<I", len(messages))
    for tick, block, words in messages:
        body += (
            tick.to_bytes(8, "little")
            + struct.pack("<HHH", block, 0, 2 * len(words))
            + struct.pack(f"<{len(words)}H", *words)
        )
    return packet(channel, 0x19, rtc, body)


def command(rt, transmit, subaddress, count):
    return rt << 11 | int(transmit) << 10 | subaddress << 5 | count % 32


def pcm(channel, rtc, frames, word_bits=16, packed=True, wide=False):
    """frames: [(tick, words)]; the first bit of a frame is the most significant bit of its first
    16- or 32-bit word.
    """
    body = struct.pack("<I", 1 << 30 | 1 << 28 | int(wide) << 18 | (1 << 20 if packed else 1 << 21))
    for tick, words in frames:
        slot = word_bits if packed else 16 * -(-word_bits // 16)
        text = "".join(f"{word:0{slot}b}" for word in words)
        grain = 32 if wide else 16
        text += "0" * (-len(text) % grain)
        body += tick.to_bytes(8, "little") + bytes(4 if wide else 2)
        for i in range(0, len(text), grain):
            body += int(text[i : i + grain], 2).to_bytes(grain // 8, "little")
    return packet(channel, 0x09, rtc, body)


def analog(channel, rtc, samples, bits=16, mode=0):
    """samples: [(count of subchannel 1, count of subchannel 2, ...)]; mode 0 packed, 1 filler
    below, 3 filler above the sample.
    """
    total = len(samples[0])
    body = b"".join(
        struct.pack("<I", mode | (bits % 64) << 2 | (i + 1) << 8 | total << 16)
        for i in range(total)
    )
    slot = bits if mode == 0 else 16 * -(-bits // 16)
    text = ""
    for row in samples:
        for count in row:
            one = f"{count & ((1 << bits) - 1):0{bits}b}"
            text += one + "0" * (slot - bits) if mode == 1 else "0" * (slot - bits) + one
    text += "0" * (-len(text) % 16)
    body += b"".join(
        int(text[i : i + 16], 2).to_bytes(2, "little") for i in range(0, len(text), 16)
    )
    return packet(channel, 0x21, rtc, body)
