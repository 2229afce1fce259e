"""A ULog file after the description at docs.px4.io, "ULog File Format": header, flag bits, formats,
information, subscriptions, data.
"""

import struct

CODES = {
    "uint64_t": "Q",
    "uint32_t": "I",
    "uint8_t": "B",
    "int32_t": "i",
    "float": "f",
    "double": "d",
}
SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def written(topics, dropouts=(), start=0):
    """topics: {(name, instance): (fields, rows)}; fields [(type, name)] with timestamp first and
    arrays as float[3]; rows flat.
    """
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start), message("B", bytes(40))]
    named = {name: fields for (name, _), (fields, _) in topics.items()}
    for name, fields in named.items():
        out.append(message("F", f"{name}:{''.join(f'{t} {n};' for t, n in fields)}".encode()))
    out.append(message("I", bytes([len("char[3] sys_name")]) + b"char[3] sys_name" + b"PX4"))
    for number, (name, instance) in enumerate(topics):
        out.append(message("A", struct.pack("<BH", instance, number) + name.encode()))
    events = []
    for number, (fields, rows) in enumerate(topics.values()):
        form = "<" + "".join(_code(t) for t, _ in fields)
        events += [
            (row[0], message("D", struct.pack("<H", number) + struct.pack(form, *row)))
            for row in rows
        ]
    events += [(at, message("O", struct.pack("<H", duration))) for at, duration in dropouts]
    for i, (_, event) in enumerate(sorted(events, key=lambda event: event[0])):
        if i % 200 == 0:
            out.append(message("S", SYNC))
        out.append(event)
    return b"".join(out)


def _code(kind):
    base, _, size = kind.partition("[")
    return f"{size.rstrip(']')}{CODES[base]}"
