"""Plain technical English: words that must not return, in identifiers too, and what to write
instead.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = [
    "aerodb",
    "aeromatch",
    "benchmarks",
    "data",
    "datcom_io",
    "docs",
    "examples",
    "flightmech",
    "flighttest",
    "kernel",
    "pom",
    "tests",
]
ENDINGS = {".py", ".pyi", ".c", ".h", ".md", ".toml", ".html", ".j2", ".typ", ".css", ".js"}
NOT_READ = {Path(__file__).name, "CHANGELOG.md"}  # this list, and history

INSTEAD = {
    "told, untold, tell, tells, telling": "reported, stated, shown, distinguished",
    "said, says": "stated, states; a message, a text",
    "house, houses": "canonical or SI (names, units, signs); the package, the product",
    "seek, seeks, seeking, sought": "solve for, search, unknown",
    "stranger, strangers": "untrusted, third-party, foreign",
    "dear, dearer, cheap, cheaper, cheaply": "expensive, inexpensive, fast",
    "mend, mends, mended, mending": "correct, repair",
    "hang together, hangs together": "are (auto)correlated, are coupled",
    "hang on, hangs on": "depends on",
    "ask for, asks for, asked for, asking for": "requires, requests, specifies",
    "foretell, foretells, foretold": "predict",
    "sure, surer, surest, unsure": "certain, confident, uncertain",
    "twin, twins": "reference implementation, counterpart, copy",
    "swing, swings, swinging, swung": "oscillation, excursion",
    "whole or not at all": "atomically: completely or not at all",
    "what is left": "the remainder, the residual",
    "bent": "piecewise linear, curved, distorted",
    "beside": "next to, in addition to, outside",
    "closes": "explains (a share of a mismatch)",
    "indispensable": "required",
}
# file, or folder with a / at its end, and what may stand there: calls and messages of other
# programs, the field's own use, old files
ALLOWED = (
    ("flightmech/support/hdf5_seal.py", r"file\.seek"),
    ("flightmech/support/foreign_code/process.py", r"\.seek\("),
    ("aeromatch/delivery/package_opening.py", r"stream\.seek\("),
    ("kernel/shell/resource.c", r"\bfseek\(|SEEK_(?:SET|END)"),
    ("datcom_io/", r"(?i)twin[ _](?:vertical )?panels?"),
    ("tests/datcom_io/", r"(?i)twin[ _](?:vertical )?panels?"),
    ("kernel/fuzz/models.py", r"twin jet"),
    ("pom/archive/archive.py", r"``closes``|\"closes\""),
    ("tests/pom/report/test_exports.py", r"closes"),
)
PHRASES = {
    phrase: instead for phrases, instead in INSTEAD.items() for phrase in phrases.split(", ")
}
SINGLE = {phrase.encode() for phrase in PHRASES if " " not in phrase}
SEVERAL = [phrase.encode() for phrase in PHRASES if " " in phrase]
LETTERS = bytes(
    code if chr(code).isalpha() and code < 128 else ord(" ") for code in range(256)
).lower()


def words(text: bytes) -> list[bytes]:
    """Return the words of a text and of its identifiers, in lower case."""
    return text.translate(LETTERS).split()


def phrases(text: bytes) -> list[str]:
    """Return the words and phrases of the list that a text holds."""
    parts = words(text)
    line = b" %s " % b" ".join(parts)
    return sorted(
        hit.decode()
        for hit in [
            *SINGLE.intersection(parts),
            *(phrase for phrase in SEVERAL if b" %s " % phrase in line),
        ]
    )


def places(name: str, text: bytes) -> Iterator[str]:
    """Yield every place of a file where such a word stands, and what to write instead."""
    if not phrases(text):
        return
    allowed = [
        re.compile(pattern.encode())
        for place, pattern in ALLOWED
        if name == place or (place.endswith("/") and name.startswith(place))
    ]
    for number, line in enumerate(text.splitlines(), 1):
        for pattern in allowed:
            line = pattern.sub(b"", line)
        for phrase in phrases(line):
            yield f"{name}:{number}: {phrase!r}: {line.strip().decode()[:80]!r}; write: {PHRASES[phrase]}"


@pytest.mark.slow
def test_plain_words():
    files = [
        *ROOT.glob("*.md"),
        *ROOT.glob("*.py"),
        *(file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*"))),
    ]
    read = [file for file in files if file.suffix in ENDINGS and file.name not in NOT_READ]
    found = [
        place
        for file in read
        for place in places(file.relative_to(ROOT).as_posix(), file.read_bytes())
    ]
    assert not found, "\n".join(found)


def test_a_planted_word_is_found_with_what_to_write_instead():
    (place,) = places("pom/a.py", b"x = 1\n# The record tells it.\n")
    assert (
        place == "pom/a.py:2: 'tells': '# The record tells it.'; write: reported, stated, shown, "
        "distinguished"
    )
    assert [place.split(": ")[1] for place in places("a.py", b"def what_is_left(house_unit): "
        b"...\nTWIN = ask  for")] == [
        "'house'", "'what is left'", "'ask for'", "'twin'"
    ]  # fmt: skip
    assert not list(places("a.py", b"ensure closest swingby household betold"))


def test_what_is_allowed_in_one_file_is_not_in_another():
    line = b'file.seek(0)  # "TWIN VERTICAL PANEL"\n'
    assert [place.split(": ")[1] for place in places("datcom_io/a.py", line)] == ["'seek'"]
    assert [
        place.split(": ")[1] for place in places("flightmech/support/foreign_code/process.py", line)
    ] == ["'twin'"]
