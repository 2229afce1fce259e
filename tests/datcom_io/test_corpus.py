"""The whole corpus against readings of its own: numbers, pages and tables found in the raw text by
other means than the reader's.

The reader cuts by columns; the regular expressions here know nothing of columns, layouts or decks.
"""

from __future__ import annotations

import functools
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

import datcom_io

ROOT = Path(__file__).parents[2]
SHARED = ROOT / ".." / "shared" / "data" / "datcom"
SHIPPED = sorted((ROOT / "data" / "t37" / "datcom").glob("*.out"))
CORPUS = SHIPPED + sorted(path for path in SHARED.glob("*/*.out") if path.parent.name != "t37")
needs_corpus = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the corpus ../shared/data/datcom is not there"
)

Lines = list[tuple[int, str]]

# a printed value has a decimal point; a number that is part of a word or stands before "=" belongs
# to a label
_NUMBER = (
    r"(?:[-+]|(?<![\w.]))(?:\d+\.\d*|\.\d+)(?:[EeDd][-+]?\d+|[-+]\d{3}(?!\d))?(?![\w.(*])(?! *=)"
)
_WORD = r"(?<![\w.*])(?:NDM|NA|NaN|\*{5,})(?![\w.*])"
_VALUE = re.compile(f"{_NUMBER}|{_WORD}")
_PAGE = re.compile(
    r"AUTOMATED STABILITY|THE FOLLOWING IS A LIST OF FINAL|EXTRAPOLATION MESSAGE|\*\*\*\* "
    r"(?:THE )?FOLLOWING ARE"
)
_CARDS = re.compile(r"1 +(?:CONERR|THE FOLLOWING IS A LIST OF ALL INPUT|END OF JOB)")
# "*** NDM PRINTED WHEN ..." speaks of cells, a line of nothing but asterisks is decoration, the
# heading of a tab table reads 0.0 always
_NO_VALUES = re.compile(r"\*{3} ?(?:NDM|NA) PRINTED|\*{40,} *$|\(TRIM TAB DEFL\. = 0\.0\)$")


def printed(path: Path) -> list[str]:
    return [line.rstrip("\r\x1a") for line in path.read_bytes().decode("latin-1").split("\n")]


def on_pages(lines: list[str]) -> Iterator[Lines]:
    """Yield the pages: from the program's name, or another title, to the next one or to the cards
    of a case.
    """
    page: Lines = []
    for number, line in enumerate(lines, 1):
        if _CARDS.match(line) or _PAGE.search(line):
            if page:
                yield page
            page = [(number, line)] if _PAGE.search(line) else []
        elif page:
            page.append((number, line))
    if page:
        yield page


def body(page: Lines) -> Lines:
    """Return a page from its flight-condition line on, or from the line after its heading where it
    has none.
    """
    anchor = next((k for k, (_, line) in enumerate(page) if "FLIGHT CONDITIONS" in line), None)
    if anchor is not None:
        return page[anchor + 4 :]
    start = next(
        (
            k
            for k, (_, line) in enumerate(page)
            if k and re.match(r"0|1\$| *$|.{20,}MACH NUMBER=|.*ABSCISSA", line)
        ),
        1,
    )
    return page[start:]


def values_by_line(lines: list[str]) -> dict[int, Counter[str]]:
    """Return the printed values of every line of every page, headings left out."""
    found = {}
    for page in on_pages(lines):
        for number, line in body(page):
            if not _NO_VALUES.search(line):
                found[number] = Counter(_VALUE.findall(line[1:]))
    return found


class Table(NamedTuple):
    """A table of rows: name in the reader's words, what opens it."""

    name: str
    opens: re.Pattern[str]


TABLES = (
    Table("static", re.compile(r"0 ALPHA +CD +CL +CM +CN +CA +XCP +CLA")),
    Table("downwash", re.compile(r"0 +ALPHA +Q/QINF +EPSLON")),
    Table("dynamic", re.compile(r"0 +ALPHA +CLQ +CMQ")),
    Table("symflp", re.compile(r"0 +DELTA +D\(CL\) +D\(CM\)")),
    Table("dcdi", re.compile(r"0 +-+ INDUCED DRAG COEFFICIENT INCREMENT")),
    Table("asyflp_cn", re.compile(r"0 +-+YAWING MOMENT COEFFICIENT,CN")),
    Table("asyflp_roll", re.compile(r"0 +DELTAL +DELTAR +\(CL\)ROLL")),
    Table("trim", re.compile(r"0 +ALPHA +CL +CD +CM +DELTAT")),
    Table("trim_stabilizer", re.compile(r"0 +ALPHA +CD +CL +CM +HM +ALIHT")),
    Table("trim_stabilizer_aircraft", re.compile(r"0 +ALPHA +CD +CL *$")),
    Table("body", re.compile(r" +WETTED AREA +XCG +ZCG")),
    Table("coordinates", re.compile(r" +UPPER ABSCISSA +UPPER ORDINATE")),
    Table("vortex", re.compile(r" +2\*PI\*ALPHA\*V\*R +\(2\*PI")),
)
LINES = {
    "section": re.compile(
        r"0? +(?:IDEAL (?:ANGLE|LIFT)|ZERO LIFT|MACH ZERO|LEADING EDGE R|MAXIMUM "
        r"AIRF|DELTA-Y|CREST CRITICAL MACH =|LOCATION)"
        r"|0? +LIFT-CURVE-SLOPE ="
    ),
    "section_slope": re.compile(r"0 +MACH= "),
    "planform": re.compile(r"\+ "),
    "mac": re.compile(r" +XCG RELATIVE"),
    "interference": re.compile(r"0 +(?:CLA-B|SIDEWASH)"),
    "weight": re.compile(r"0\*\*\* (?:VEHICLE WEIGHT|LEVEL FLIGHT LIFT)"),
    "dump": re.compile(r" +[A-Z]+\( *\d+\)="),
}
KINDS = {
    "static": "CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP",
    "dynamic": "  DYNAMIC DERIVATIVES\n",
    "high-lift": "CHARACTERISTICS OF HIGH LIFT AND CONTROL DEVICES",
    "auxiliary": "CONFIGURATION AUXILIARY AND PARTIAL OUTPUT",
    "section": " SECTION DEFINITION\n",
    "hypersonic": "AERODYNAMIC CONTROL EFFECTIVENESS AT HYPERSONIC",
    "special": "TRANSVERSE-JET CONTROL EFFECTIVENESS",
    "final inputs": "LIST OF FINAL INPUTS FOR THIS CASE",
    "extrapolation": "EXTRAPOLATION MESSAGE SUMMARY",
}
_ROW = re.compile(
    r" +[-+]?\d*\.\d| +(?:NDM|NA) |0(?:\(DELTAL-DELTAR\)| +DELTA) *=|0? *ALPHA *$|0? *$"
)


def values_of_tables(lines: list[str]) -> tuple[Counter[str], Counter[str]]:
    """Return tables with a row, and values that are not blank, by kind of table."""
    tables, values = Counter(), Counter()
    for page in on_pages(lines):
        kind, found = "", 0
        for _, line in [*page, (0, "1")]:
            count = len(_VALUE.findall(line[1:]))
            opened = next((table.name for table in TABLES if table.opens.match(line)), "")
            if opened or not _ROW.match(line):
                tables[kind] += found > 0
                values[kind] += found
                kind, found = opened, 0
                values[
                    next((name for name, pattern in LINES.items() if pattern.match(line)), "")
                ] += count
            elif kind:
                found += count
    del tables[""], values[""]
    return +tables, +values


class Read(NamedTuple):
    path: Path
    lines: list[str]
    listing: datcom_io.Listing
    cells: pd.DataFrame


@functools.cache
def read(path: Path) -> Read:
    listing = datcom_io.read(path)
    return Read(path, printed(path), listing, listing.cells())


@pytest.fixture(scope="module", params=CORPUS, ids=lambda path: path.stem)
def one(request) -> Read:
    """Every listing in turn, read strictly."""
    return read(request.param)


@needs_corpus
def test_the_corpus_is_whole():
    assert len(CORPUS) == 59


@pytest.mark.nightly
def test_nothing_printed_is_lost_and_nothing_is_invented(one):
    wanted = values_by_line(one.lines)
    found = defaultdict(Counter)
    for number, text in zip(one.cells["line"].tolist(), one.cells["text"].tolist()):
        if _VALUE.fullmatch(text):
            found[number][text] += 1
    headings = {number for page in on_pages(one.lines) for number, _ in page} - wanted.keys()
    wrong = {
        number: (
            one.lines[number - 1].strip(),
            dict(wanted[number] - found[number]),
            dict(found[number] - wanted[number]),
        )
        for number in wanted.keys() | found.keys() - headings
        if wanted.get(number, Counter()) != found[number]
    }
    assert not wrong, f"{len(wrong)} lines, the first: {dict(list(wrong.items())[:5])}"


@pytest.mark.nightly
def test_every_text_stands_on_its_line(one):
    for number, text in set(zip(one.cells["line"].tolist(), one.cells["text"].tolist())):
        assert text in one.lines[number - 1]


@pytest.mark.slow
def test_every_line_is_understood(one):
    assert one.listing.unread == []
    assert [(page.kind, page.first) for page in one.listing.unparsed] == []


_WORDS = {"": "blank", "NDM": "NDM", "NA": "NA", "NaN": "nan"}


@pytest.mark.nightly
def test_values_and_flags_are_those_of_the_text(one):
    kinds = one.cells[["text", "flag", "value"]].drop_duplicates()
    for text, flag, value in kinds.itertuples(index=False):
        if (
            not text.strip("*") and len(text) > 2
        ):  # two asterisks mark a variable outside of its chart
            assert (flag, np.isnan(value)) == ("overflow", True)
        elif text in _WORDS:
            assert (flag, np.isnan(value)) == (_WORDS[text], True)
        elif re.fullmatch(_NUMBER, text):
            assert value == float(text)
            assert flag in (
                ("sentinel",) if 0.0 < abs(value) < 1e-28 * 1.001 else ("ok", "suspect")
            )
        else:
            assert (flag, np.isnan(value) or value == int(text)) == ("ok", True)


def test_pages_by_kind(one):
    text = "\n".join(line.rstrip() for line in one.lines) + "\n"
    found = Counter(page.kind for page in one.listing.pages)
    assert {kind: found[kind] for kind in KINDS} == {
        kind: text.count(words) for kind, words in KINDS.items()
    }


@pytest.mark.nightly
def test_tables_and_values_by_kind(one):
    tables, values = values_of_tables(one.lines)
    found = Counter(table.name for page in one.listing.pages for table in page.tables)
    names = [table.name for table in TABLES]
    assert {name: found[name] for name in names} == {name: tables[name] for name in names}
    cells = Counter(
        table
        for table, text in zip(one.cells["table"].tolist(), one.cells["text"].tolist())
        if _VALUE.fullmatch(text)
    )
    assert {name: cells[name] for name in (*names, *LINES)} == {
        name: values[name] for name in (*names, *LINES)
    }


_UNDER_HEADINGS = ("static", "downwash", "dynamic", "symflp")


def columns_by_place(lines: list[str]) -> dict[int, list[tuple[str, str]]]:
    """Return heading word and text of every value of a table, by line: each value belongs to the
    nearest heading word.
    """
    openings = {table.name: table.opens for table in TABLES if table.name in _UNDER_HEADINGS}
    found: dict[int, list[tuple[str, str]]] = {}
    heading: list[tuple[float, str]] = []
    for number, line in enumerate(lines, 1):
        if any(opens.match(line) for opens in openings.values()):
            words = re.finditer(r"\S+(?: \S+)*", line[1:])
            heading = [((word.start() + word.end()) / 2, word[0]) for word in words]
        elif heading and not _ROW.match(line):
            heading = []
        elif heading and (values := list(_VALUE.finditer(line[1:]))):
            middles = [(value.start() + value.end()) / 2 for value in values]
            names = [min(heading, key=lambda word: abs(word[0] - middle))[1] for middle in middles]
            found[number] = [(name, value[0]) for name, value in zip(names, values)]
    return found


@pytest.mark.nightly
def test_values_stand_under_their_headings(one):
    wanted = columns_by_place(one.lines)
    rows = one.cells[one.cells["table"].isin(_UNDER_HEADINGS) & (one.cells["text"] != "")]
    found = defaultdict(list)
    for number, column, text in rows[["line", "column", "text"]].itertuples(index=False):
        found[number].append((column, text))
    assert found.keys() == wanted.keys()
    assert [number for number in wanted if found[number] != wanted[number]] == []


def same(ours: pd.DataFrame, other: pd.DataFrame, columns: tuple[str, ...], where: str) -> None:
    for column in columns:
        assert ours[column].tolist() == other[column].tolist(), f"{where}: {column}"
    np.testing.assert_array_equal(ours["value"], other["value"])


def in_bodies(lines: list[str], change) -> list[str]:
    """Return the lines, those below the headings of the pages changed."""
    changed = list(lines)
    for page in on_pages(lines):
        for number, line in body(page):
            changed[number - 1] = change(line)
    return changed


def without_exponent_letter(line: str) -> str:
    return re.sub(r"(\d)E([+-])(\d\d)", r"\g<1>\g<2>0\3", line)


def without_leading_zero(line: str) -> str:
    line = re.sub(r"(?<=[ =])0(\.\d)(?!\d* *=)", r" \1", line)
    return re.sub(r"-0(\.\d)", r" -\1", line)


def without_control_column(lines: list[str], new_page: str) -> list[str]:
    found = []
    for line in lines:
        control, text = line[:1], line[1:]
        found += {"1": [new_page + text], "0": ["", text]}.get(control, [text])
    return found


REWRITTEN = {
    "DOS": (lambda lines: [line + "\r\n" for line in lines] + ["\x1a"], ("line", "text")),
    "trailing blanks stripped": (lambda lines: [line.rstrip() for line in lines], ("line", "text")),
    "form feeds for column 1": (lambda lines: without_control_column(lines, "\f"), ("text",)),
    "no column 1": (lambda lines: without_control_column(lines, ""), ("text",)),
    "no exponent letter": (lambda lines: in_bodies(lines, without_exponent_letter), ("line",)),
    "no leading zero": (lambda lines: in_bodies(lines, without_leading_zero), ("line",)),
}
_SMALL = [path for path in CORPUS if path.stat().st_size < 100_000]


@pytest.mark.nightly
@pytest.mark.parametrize("how", REWRITTEN)
def test_other_ways_to_write_the_same(how):
    rewrite, columns = REWRITTEN[how]
    for path in _SMALL:
        wanted = read(path)
        listing = datcom_io.read(rewrite(wanted.lines))
        same(
            listing.cells(),
            wanted.cells,
            (*columns, "case", "page", "table", "column", "flag"),
            path.name,
        )
        assert listing.unread == [], path.name
        assert [case.deck.namelists for case in listing] == [
            case.deck.namelists for case in wanted.listing
        ], path.name


def last_place(text: str) -> float:
    digits, _, exponent = text.partition("E")
    return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


# faults of the program where its two builds differ: what may differ, as (table, column)
DIFFERENT = {
    "control_tab": {("symflp", "D(CM)"), ("dcdi", "D(CDI)")},
    "propeller_nan": {("static", name) for name in ("CD", "CL", "CM", "CN", "CA", "XCP")},
}
BUILDS = [path for path in CORPUS if path.with_suffix(".pdas.out") in CORPUS]


@pytest.mark.parametrize("path", BUILDS, ids=lambda path: path.stem)
def test_both_builds_of_the_program_agree(path):
    ours, other = read(path).cells, read(path.with_suffix(".pdas.out")).cells
    other = other[
        ~other["page"].str.contains("AT HYPERSONIC SPEEDS")
    ]  # one build prints nothing there
    for column in ("case", "page", "table", "column"):
        assert ours[column].tolist() == other[column].tolist()
    pairs = zip(
        *(frame[name].tolist() for frame in (ours, other) for name in ("table", "column", "text"))
    )
    different = {
        (table, column) for table, column, a, _, _, b in pairs if a != b and not close(a, b)
    }
    assert different == DIFFERENT.get(path.stem, set())


def close(a: str, b: str) -> bool:
    """Return whether two numbers agree to one unit of their last place: compilers round
    differently.
    """
    if not (re.fullmatch(_NUMBER, a) and re.fullmatch(_NUMBER, b)):
        return False
    return abs(float(a) - float(b)) <= 1.0001 * max(last_place(a), last_place(b))


@needs_corpus
def test_saved_cases_hold_what_the_cases_before_gave():
    found = read(SHARED / "save_cascade" / "save_cascade.out")
    blocks = re.split(r"LIST OF ALL INPUT CARDS FOR THIS CASE", "\n".join(found.lines))[1:-1]
    assert len(blocks) == len(found.listing) == 6
    given: set[str] = set()
    for block, case in zip(blocks, found.listing):  # every case but the last has a SAVE card
        names = re.findall(r"^  \$([A-Z]+) ", block.partition("INPUT DIMENSIONS")[0], re.MULTILINE)
        if device := {"SYMFLP", "ASYFLP"}.intersection(names):
            given = given - {"SYMFLP", "ASYFLP"} | device
        given |= set(names) - {"SYMFLP", "ASYFLP"}
        assert case.deck.namelists.keys() == given
    assert [len(case.deck.namelists) for case in found.listing] == [5, 6, 6, 8, 8, 8]
    fifth = found.listing[4].deck
    assert (
        fifth.schedule("FLTCON", "MACH", "NMACH"),
        fifth.schedule("FLTCON", "ALSCHD", "NALPHA"),
    ) == ([0.25], [0.0, 2.0, 4.0, 6.0])
    assert fifth.value("FLTCON", "NALT") == 1.0  # given in the first case only
    assert fifth.values("SYNTHS", "XCG") == [6.3]  # first case
    assert fifth.values("SYNTHS", "XH") == [11.31]  # fourth case


@pytest.mark.slow
@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_the_deck_alone_states_what_the_listing_states(path):
    deck = datcom_io.read_deck(
        path.with_name(path.name.removesuffix(".out").removesuffix(".pdas") + ".inp")
    )
    assert [case.meaning() for case in deck] == [case.deck.meaning() for case in read(path).listing]
