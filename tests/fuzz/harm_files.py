"""Ways to harm a file as files get harmed: bytes of any file, objects of an HDF5 file, words of a
text.

Every function takes the content and a source of random choices, and returns other content.
"""

from __future__ import annotations

import io
import random
import re
from collections.abc import Callable

import h5py
import numpy as np

Way = Callable[[bytes, random.Random], bytes]

MOST_HARMS = 4
STRETCH = 64
# texts that stand in the place of a number or a name
WORDS = (
    *("", "NaN", "-1", "0", "1e400", "1e308", "inf", "99999999999999999999", "true", "[]", "{}"),
    *("é٣", "\u2028", "x" * 3000, "../x", "a b", '"', "'", "#", "[[a]]", "1 furlong", "deg"),
)
# sizes of an array that has no memory behind it
SIZES = ((0,), (1,), (10**12,), (2**62,), (3, 0), (2, 2, 2), (10**6, 10**6))


def cut(content: bytes, choice: random.Random) -> bytes:
    """End anywhere."""
    return content[: choice.randrange(len(content) + 1)]


def flip(content: bytes, choice: random.Random) -> bytes:
    """Change single bits, most of them at the beginning, where sizes and names stand."""
    raw = bytearray(content)
    for _ in range(choice.choice((1, 3, 12, 60))):
        if raw:
            most = len(raw) if choice.random() < 0.5 else min(len(raw), 4096)
            raw[choice.randrange(most)] ^= 1 << choice.randrange(8)
    return bytes(raw)


def blank(content: bytes, choice: random.Random) -> bytes:
    """Put zeros or ones in the place of a stretch."""
    raw, at = bytearray(content), choice.randrange(len(content) + 1)
    size = min(choice.choice((1, 8, STRETCH, 4096)), len(raw) - at)
    raw[at : at + size] = choice.choice((b"\0", b"\xff")) * size
    return bytes(raw)


def insert(content: bytes, choice: random.Random) -> bytes:
    """Repeat a stretch at another place."""
    at, first = choice.randrange(len(content) + 1), choice.randrange(len(content) + 1)
    return content[:at] + content[first : first + choice.randrange(200)] + content[at:]


def lose(content: bytes, choice: random.Random) -> bytes:
    """Take out a stretch."""
    at = choice.randrange(len(content) + 1)
    return content[:at] + content[at + 1 + choice.randrange(200) :]


BYTES: tuple[Way, ...] = (cut, flip, flip, flip, blank, insert, lose)


def harm_bytes(content: bytes, choice: random.Random) -> bytes:
    """Harm bytes in one to four ways."""
    for _ in range(1 + choice.randrange(MOST_HARMS)):
        content = choice.choice(BYTES)(content, choice)
    return content


# ---- texts --------------------------------------------------------------------------------------

_WORD = re.compile(r"[-+]?[\w.]+")


def harm_text(content: bytes, choice: random.Random) -> bytes:
    """Replace, lose, double or exchange words and lines; one time in four harm bytes."""
    if choice.random() < 0.25:
        return harm_bytes(content, choice)
    text = content.decode("utf-8", "surrogateescape")
    for _ in range(1 + choice.randrange(MOST_HARMS)):
        text = choice.choice((_replace_word, _replace_word, _move_line, _change_lines))(
            text, choice
        )
    return text.encode("utf-8", "surrogateescape")


def _replace_word(text: str, choice: random.Random) -> str:
    words = list(_WORD.finditer(text))
    if not words:
        return text
    place = choice.choice(words)
    other = choice.choice(WORDS) if choice.random() < 0.7 else choice.choice(words)[0]
    return text[: place.start()] + other + text[place.end() :]


def _move_line(text: str, choice: random.Random) -> str:
    lines = text.split("\n")
    line = lines.pop(choice.randrange(len(lines)))
    lines.insert(choice.randrange(len(lines) + 1), line)
    return "\n".join(lines)


def _change_lines(text: str, choice: random.Random) -> str:
    lines = text.split("\n")
    first = choice.randrange(len(lines))
    last = first + 1 + choice.randrange(8)
    copies = choice.choice((0, 0, 2, 30))
    return "\n".join(lines[:first] + copies * lines[first:last] + lines[last:])


# ---- HDF5 ---------------------------------------------------------------------------------------


def harm_hdf5(content: bytes, choice: random.Random) -> bytes:
    """Change objects of a sound file, so that it is sound HDF5 with other content; or its bytes.

    One time in three only bytes are harmed, one time in five both.
    """
    kind = choice.random()
    if kind > 1 / 3:
        content = _change_objects(content, choice)
    if kind < 8 / 15:
        content = harm_bytes(content, choice)
    return content


def _change_objects(content: bytes, choice: random.Random) -> bytes:
    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        for _ in range(1 + choice.randrange(MOST_HARMS)):
            names: list[str] = ["/"]
            file.visit(names.append)
            try:
                choice.choice(OBJECTS)(file, choice.choice(names), choice)
            except (KeyError, ValueError, TypeError, OSError, RuntimeError, MemoryError):
                continue  # HDF5 refuses the change, or it follows one without memory behind it
    return stream.getvalue()


def _remove(file: h5py.File, name: str, choice: random.Random) -> None:
    if name != "/":
        del file[name]


def _rename(file: h5py.File, name: str, choice: random.Random) -> None:
    other = choice.choice(("time", "x", "é", "a/b/c", "value", "states", "q", "alpha"))
    if name != "/":
        file.move(name, name.rpartition("/")[0] + "/" + other)


def _link(file: h5py.File, name: str, choice: random.Random) -> None:
    """Put a link in the place of an object: to nothing, to the root, to another file."""
    if name == "/":
        return
    del file[name]
    links = (h5py.SoftLink("/gone"), file["/"], h5py.ExternalLink("other.nc", "/"))
    file[name] = choice.choice(links)


def _replace(file: h5py.File, name: str, choice: random.Random) -> None:
    """Put another dataset in the place of an object."""
    shape = choice.choice(SIZES)
    if name == "/":
        return
    attributes = dict(file[name].attrs) if choice.random() < 0.5 else {}
    old = file[name][()] if isinstance(file[name], h5py.Dataset) else np.zeros(3)
    del file[name]
    way = choice.randrange(7)
    if way == 0:
        file.create_dataset(name, shape, "f8", chunks=tuple(min(n or 1, 1000) for n in shape))
    elif way == 1:
        file[name] = h5py.Empty(choice.choice(("f8", "S3")))
    elif way == 2:
        file[name] = np.zeros(4, choice.choice(("S5", "c16", "f2", "?", "i1", "u8", "V7")))
    elif way == 3:
        file[name] = np.zeros(4, [("a", "f8"), ("b", "S3")])
    elif way == 4:
        file[name] = ["a", "é", ""]
    elif way == 5:
        file[name] = choice.choice((np.nan, np.inf, 0.0, -1e308)) + np.zeros_like(old, "f8")
    else:
        file[name] = old[choice.choice((slice(None, None, -1), slice(0, 1), slice(0, 0)))]
    for key, value in attributes.items():
        if not isinstance(value, np.ndarray) or value.dtype.kind != "O":
            file[name].attrs[key] = value


def _attribute(file: h5py.File, name: str, choice: random.Random) -> None:
    """Lose an attribute or give it another value."""
    attributes = file[name].attrs
    names = [*attributes]
    if not names:
        return
    key = choice.choice(names)
    values = ("", "x", "[1", "{}", "é", 1, -1.5, np.nan, np.zeros(3), b"\xff\xfe", h5py.Empty("f8"))
    values += (np.zeros((2, 2), "S3"), np.zeros(2, [("a", "f8")]), "x" * 10000)
    del attributes[key]
    if choice.random() < 0.8:
        attributes[key] = choice.choice(values)


def _values(file: h5py.File, name: str, choice: random.Random) -> None:
    """Change single numbers of a dataset."""
    item = file[name]
    if not isinstance(item, h5py.Dataset) or not item.size or item.dtype.kind not in "fiu":
        return
    values = item[()].reshape(-1) if item.shape else np.array([item[()]])
    odd = (np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0) if item.dtype.kind == "f" else (0, 1, 100)
    for _ in range(choice.choice((1, 5, 50))):
        values[choice.randrange(len(values))] = choice.choice(odd)
    item[...] = values.reshape(item.shape)


OBJECTS = (_remove, _rename, _link, _replace, _replace, _replace, _attribute, _attribute, _values)
