"""One case at a time: the same cases as all at once, early, and nothing lost before a fault."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.arrays.frames import write_cells
from datcom_io.cells import OK, SUSPECT, read_cell
from datcom_io.printout.tables import PrintedTable
from flightmech.errors import ParseError

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"
ONE_BY_ONE = DATA / "t37_elevator_one_by_one.pdas.out"  # six runs
NAMES = [
    "aileron",
    "build",
    "clean",
    "elevator",
    "flaps",
    "ground",
    "ground_elevator",
    "ground_flap",
]


def outline(pages):
    """Return what distinguishes pages: kind, lines, tables with their lines, notes."""
    return [
        (
            page.kind,
            page.first,
            page.last,
            [(item.name, item.lines) for item in page.printed],
            page.notes,
        )
        for page in pages
    ]


def test_cases_are_those_of_the_whole_listing():
    whole = datcom_io.read(ONE_BY_ONE)
    cases = datcom_io.iterate(ONE_BY_ONE)
    found = list(cases)
    assert [case.name for case in found] == whole.case_names
    assert [outline(case.pages) for case in found] == [outline(case.pages) for case in whole]
    assert [case.messages for case in found] == [case.messages for case in whole]
    assert [case.deck for case in found] == [case.deck for case in whole]
    assert (cases.listing.runs, cases.listing.line_count, cases.listing.cases) == (
        6,
        whole.line_count,
        [],
    )


def test_faults_of_the_program_are_reported_case_by_case(elevator_lines):
    at = next(k for k, line in enumerate(elevator_lines) if "LIST OF ALL INPUT CARDS" in line)
    end = next(k for k, line in enumerate(elevator_lines) if "END OF JOB" in line)
    two_cases = [*elevator_lines[:end], *elevator_lines[at:]]
    drift = [
        [message.text for message in case.messages if message.text.startswith("D(CM) of")]
        for case in datcom_io.iterate(two_cases)
    ]
    assert [text[0].split(", all but")[0] for text in drift] == [
        "D(CM) of 44 deflections",
        "D(CM) of 45 deflections",
    ]
    assert [text[1].split(" conditions")[0] for text in drift] == ["D(CM) of 5", "D(CM) of 10"]


def test_a_case_comes_before_the_file_ends():
    lines = ONE_BY_ONE.read_text().split("\n")
    taken = 0

    def source():
        nonlocal taken
        for line in lines * 40:
            taken += 1
            yield line

    first = next(datcom_io.iterate(source()))
    assert first.deck.conditions() == [(0.15, 0.0)]
    assert taken < len(lines) * 40 / 4


@pytest.mark.slow
@pytest.mark.parametrize("end", range(190, 860, 67))
def test_the_error_carries_what_partial_reading_gives(elevator_lines, end):
    with pytest.raises(ParseError) as caught:
        datcom_io.read(elevator_lines[:end])
    partial = datcom_io.read(elevator_lines[:end], partial=True)
    assert isinstance(caught.value, datcom_io.DamagedListing)
    assert outline(caught.value.listing.pages) == outline(partial.pages)
    assert caught.value.listing.case_names == partial.case_names
    np.testing.assert_array_equal(caught.value.listing.cells()["value"], partial.cells()["value"])


def test_a_fault_after_complete_cases():
    lines = ONE_BY_ONE.read_text().split("\n")
    ends = [k for k, line in enumerate(lines) if "END OF JOB" in line]
    cut = lines[: ends[3] - 5]
    cases = datcom_io.iterate(cut)
    complete = [next(cases).name for _ in range(3)]
    with pytest.raises(datcom_io.DamagedListing) as caught:
        next(cases)
    base = "T-37 OWN DECK ELEVATOR, ONE RUN PER MACH NUMBER"
    assert complete == [base, f"{base} (2)", f"{base} (3)"]
    assert caught.value.listing.case_names == [f"{base} (4)"]
    with pytest.raises(datcom_io.DamagedListing) as caught:
        datcom_io.read(cut)
    assert caught.value.listing.case_names == [*complete, f"{base} (4)"]


def test_everything_behind_a_damaged_page_is_in_partial_reading_only(elevator_lines):
    lines = elevator_lines[:195] + elevator_lines[196:]  # a row of the first static table is lost
    with pytest.raises(datcom_io.DamagedListing) as caught:
        datcom_io.read(lines)
    partial = datcom_io.read(lines, partial=True)
    kept = caught.value.listing.pages
    assert outline(kept) == outline(partial.pages)[: len(kept)]
    assert [item.name for item in kept[-1].printed][:1] == ["downwash"]
    assert len(partial.pages) > len(kept)


def slow_cells(item):
    """Yield line, column, text, value and flag of every cell of a table or a group of values, one
    by one.
    """
    if isinstance(item, PrintedTable):
        for i, (row, line) in enumerate(zip(item.rows, item.lines)):
            for k, column in enumerate(item.columns):
                part = row[column.first - 1 : column.last]
                value, flag = read_cell(part)
                suspect = item.suspect is not None and item.suspect[i, k] and flag == OK
                yield line, column.name, part.strip(), value, SUSPECT if suspect else flag
    else:
        for line, label, text in zip(item.lines, item.labels, item.texts):
            yield line, label, text, *(read_cell(text) or (math.nan, 0))


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_cells_are_those_read_one_by_one(t37, name):
    listing = t37(f"t37_{name}.out")
    printed = [
        item
        for page in listing.pages
        for item in (page.conditions, *page.printed)
        if item is not None and item.given is None
    ]
    wanted = [cell for item in printed for cell in slow_cells(item)]
    cells = listing.cells()
    headings = cells["line"].isin(
        [
            item.across_line
            for item in printed
            if isinstance(item, PrintedTable) and item.across_line
        ]
    )
    assert not any(item.given is not None for page in listing.pages for item in page.printed)
    found = cells[~headings]
    assert found["line"].tolist() == [cell[0] for cell in wanted]
    assert found["column"].tolist() == [cell[1] for cell in wanted]
    assert found["text"].tolist() == [cell[2] for cell in wanted]
    np.testing.assert_array_equal(found["value"].to_numpy(), [cell[3] for cell in wanted])
    assert found["flag"].tolist() == [datcom_io.FLAGS[cell[4]] for cell in wanted]


def test_cells_of_one_case():
    listing = datcom_io.read(ONE_BY_ONE)
    cells = listing.cells()
    for case in listing:
        of_case = cells[cells["case"] == case.ordinal].reset_index(drop=True)
        alone = case.cells()
        assert list(alone.columns) == list(of_case.columns)
        for column in alone:
            np.testing.assert_array_equal(alone[column].to_numpy(), of_case[column].to_numpy())


@pytest.mark.slow
def test_cells_in_a_file(tmp_path):
    path = tmp_path / "cells.csv"
    count = write_cells(datcom_io.iterate(ONE_BY_ONE), path)
    cells = datcom_io.read(ONE_BY_ONE).cells()
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert count == len(rows) == len(cells)
    assert [row["text"] for row in rows] == cells["text"].tolist()
    assert [float(row["value"]) if row["value"] else None for row in rows] == [
        x if x == x else None for x in cells["value"]
    ]
    assert [float(row["delta"]) if row["delta"] else None for row in rows] == [
        x if x == x else None for x in cells["delta"]
    ]


def test_a_file_of_cells_is_whole_or_not_there(tmp_path):
    path = tmp_path / "cells.csv"
    path.write_text("as it was")
    cut = ONE_BY_ONE.read_text().split("\n")[:-200]
    with pytest.raises(ParseError):
        write_cells(datcom_io.iterate(cut), path)
    assert [file.name for file in tmp_path.iterdir()] == ["cells.csv"]
    assert path.read_text() == "as it was"


def test_rows_where_the_arithmetic_of_the_program_failed(elevator_lines):
    lines = list(elevator_lines)
    lines[187] = lines[187].replace("-0.613", "   NaN")  # line 188
    case = next(datcom_io.iterate(lines))
    assert [
        message.line for message in case.messages if message.text.startswith("1 row holds NaN")
    ] == [188]
    assert not any("NaN" in message.text for message in datcom_io.read(elevator_lines).messages)


def test_every_axis_of_a_layout_has_a_column():
    from datcom_io.arrays.frames import COLUMNS
    from datcom_io.printout.layouts import LAYOUTS

    axes = {column.quantity for layout in LAYOUTS for column in layout.columns[: layout.keys]}
    axes |= {layout.across.quantity for layout in LAYOUTS if layout.across}
    assert axes <= set(COLUMNS)
