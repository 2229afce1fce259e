"""An ArduPilot log after AP_Logger's LogStructure.h: FMT describes itself and every other message;
UNIT, MULT and FMTU give the units.
"""

import struct

CODES = {
    "Q": "Q",
    "f": "f",
    "B": "B",
    "b": "b",
    "c": "h",
    "C": "H",
    "L": "i",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "H": "H",
    "M": "B",
    "d": "d",
    "e": "i",
}
SCALES = {"c": 100, "C": 100, "e": 100, "L": 1e7}
FMT, UNIT, MULT, FMTU = 128, 129, 130, 131


def head(kind):
    return bytes([0xA3, 0x95, kind])


def described(kind, name, form, columns):
    length = 3 + struct.calcsize("<" + "".join(CODES[c] for c in form))
    return head(FMT) + struct.pack(
        "<BB4s16s64s", kind, length, name.encode(), form.encode(), columns.encode()
    )


def row(kind, form, values):
    values = [round(v * SCALES[c]) if c in SCALES else v for c, v in zip(form, values, strict=True)]
    return head(kind) + struct.pack("<" + "".join(CODES[c] for c in form), *values)


def written(messages, units=None):
    """messages: {name: (format, columns, unit ids, multiplier ids, rows)}, the first column TimeUS;
    units {id: label}.
    """
    out = [
        described(FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        described(UNIT, "UNIT", "QbZ", "TimeUS,Id,Label"),
        described(MULT, "MULT", "Qbd", "TimeUS,Id,Mult"),
        described(FMTU, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    ]
    kinds = {name: 140 + i for i, name in enumerate(messages)}
    for name, (form, columns, _, _, _) in messages.items():
        out.append(described(kinds[name], name, form, columns))
    for letter, label in (units or {}).items():
        out.append(row(UNIT, "QbZ", (0, ord(letter), label.encode())))
    for letter, factor in {"F": 1e-6, "0": 1.0, "B": 1e-2, "C": 1e-3}.items():
        out.append(row(MULT, "Qbd", (0, ord(letter), factor)))
    for name, (_, _, ids, factors, _) in messages.items():
        out.append(row(FMTU, "QBNN", (0, kinds[name], ids.encode(), factors.encode())))
    rows = [
        (values[0], row(kinds[name], form, values))
        for name, (form, _, _, _, rows) in messages.items()
        for values in rows
    ]
    return b"".join(out + [part for _, part in sorted(rows, key=lambda part: part[0])])
