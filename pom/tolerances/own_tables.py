"""Tolerance tables of the user: CSV files with the columns of ``tolerances.csv``, checked row by
row.

A table that is not read as its author meant it gives a wrong pass without a word.  So every cell
that a judgement depends on is checked, and all problems of a file are reported at once.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.units import parse_unit
from pom.tolerances import rows as shipped
from pom.tolerances.channels import (
    CHANNELS,
    MODE_CHANNELS,
    SCALAR_UNITS,
    TRAVEL,
    limit_to_si_factor,
    plain_id,
)
from pom.tolerances.conditions import is_relation, satisfies_relation

Row = shipped.Row

QUANTITIES = ("absolute", "percent", "percent_times_n_plus_1", "floor", "none")
RULES = ("single", "greater_of", "lesser_of")
BASES = ("ref_local", "ref_peak", "ref_scalar", "range_max", "first_overshoot")
PROVENANCES = ("verified", "partial", "memory")
_NEEDED = ("standard", "edition", "test_id", "title", "parameter", "group", "measure", "quantity")
# Columns that make a row one of its kind; two equal rows are an error of the file.
_KEY = (
    *("standard", "edition", "test_id", "parameter", "group", "measure"),
    *("applies_from", "applies_to", "condition"),
)
_BOUND = re.compile(r"\w+?([+-]\d+(\.\d+)?\w+)?")
_SWEEPS = ("curve", "breakout", "force_increment")
_MODES = ("period", "t_half", "damping_ratio")
_MOST_PROBLEMS = 40  # printed; a file of another kind has one for every cell


@dataclass(frozen=True)
class OwnTable:
    """A tolerance table of the user.

    Attributes
    ----------
    path : str
        The file.
    sha256 : str
        Hash of the bytes that were read.
    rows : tuple of mapping
        Rows in the order of the file, with the columns of ``tolerances.csv``.
    """

    path: str
    sha256: str
    rows: tuple[Row, ...]

    def holds(self, standard: str, edition: str) -> bool:
        """Return whether the table has rows of an edition."""
        return any((row["standard"], row["edition"]) == (standard, edition) for row in self.rows)

    def excerpt(self, id: str, standard: str, edition: str) -> dict[str, Any]:
        """Return what a case keeps of the table, so that its report needs no file.

        Returns
        -------
        dict
            ``file`` (name), ``sha256``, ``rows`` of the test, ``tests`` (title by number) of the
            edition.

        Raises
        ------
        UnknownName
            The table has no such standard, edition or test.
        """
        rows = shipped.rows_of_test(id, standard, edition, self.rows)
        tests = {}
        for row in self.rows:
            if (row["standard"], row["edition"]) == (standard, edition):
                tests[row["test_id"]] = row["title"]
        return {
            "file": Path(self.path).name,
            "sha256": self.sha256,
            "rows": [dict(row) for row in rows],
            "tests": tests,
        }


def read_own_table(path: str | Path) -> OwnTable:
    """Read and check a tolerance table.

    Parameters
    ----------
    path : path
        CSV file, UTF-8, comma, with the columns of ``pom/tolerances/tolerances.csv`` in any order.

    Raises
    ------
    SchemaError
        With every problem: columns, empty cells, unknown measures, units, widths, equal rows.
    """
    content = Path(path).read_bytes()
    what = f"tolerance table {path}"
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SchemaError(what, [f"not UTF-8 text ({error}); save it as CSV in UTF-8"]) from None
    reader = csv.DictReader(io.StringIO(text, newline=""))
    problems = list(_column_problems(reader.fieldnames or []))
    if problems:
        raise SchemaError(what, problems)
    rows: list[Row] = []
    lines: dict[tuple[str, ...], int] = {}
    try:
        for row in reader:
            label = f"line {reader.line_num}"
            if None in row or None in row.values():
                problems.append(
                    f"{label}: another number of cells than the head; quote a cell that holds a "
                    f"comma"
                )
                continue
            row = {name: cell.strip() for name, cell in row.items()}
            key = tuple(row[name] for name in _KEY)
            if key in lines:
                problems.append(
                    f"{label}: the same row as line {lines[key]} ({', '.join(_KEY)}); remove one, "
                    f"or state what is different"
                )
            lines.setdefault(key, reader.line_num)
            name = f"{label}, {row['test_id']} {row['parameter']}"
            problems += [f"{name}: {text}" for text in _row_problems(row)]
            rows.append(row)
    except csv.Error as error:
        problems.append(f"line {reader.line_num}: {error}; save the table as CSV again")
    if not rows and not problems:
        problems.append("no rows below the head")
    if len(problems) > _MOST_PROBLEMS:
        more = len(problems) - _MOST_PROBLEMS
        problems = [*problems[:_MOST_PROBLEMS], f"and {more} more problems"]
    if problems:
        raise SchemaError(what, problems)
    return OwnTable(str(path), hashlib.sha256(content).hexdigest(), tuple(rows))


def _column_problems(columns: Sequence[str]) -> Iterator[str]:
    """Yield the problems of the head of a table."""
    allowed = list(shipped.tolerance_rows()[0])
    if len(columns) == 1 and (";" in columns[0] or "\t" in columns[0]):
        yield f"the head is one cell {columns[0][:40]!r} ...; separate the cells by commas"
        return
    for name in columns:
        if name not in allowed:
            yield str(UnknownName(name, allowed, "column"))
        elif list(columns).count(name) > 1:
            yield f"column {name} comes twice; keep one"
    missing = [name for name in allowed if name not in columns]
    if missing:
        yield (
            f"columns {', '.join(missing)} are missing; the head must have all of "
            f"{', '.join(allowed)} (`aeromatch pom tolerances --write FILE.csv` writes an example)"
        )


def _row_problems(row: Row) -> Iterator[str]:
    """Yield the problems of one row."""
    empty = [name for name in _NEEDED if not row[name]]
    if empty:
        yield f"{', '.join(empty)}: empty; every row needs a value"
        return
    known = {item["measure"] for item in shipped.tolerance_rows()}
    if row["measure"] not in known:
        yield f"measure: {UnknownName(row['measure'], known, 'measure')}"
        return
    parameters = {item["parameter"] for item in shipped.tolerance_rows()} | set(CHANNELS)
    if row["parameter"] not in parameters:
        yield f"parameter: {UnknownName(row['parameter'], parameters, 'parameter')}"
        return
    for name, allowed in {
        "quantity": QUANTITIES,
        "rule": ("", *RULES),
        "percent_base": ("", *BASES),
        "provenance": PROVENANCES,
        "kind": tuple(sorted({item["kind"] for item in shipped.tolerance_rows()})),
    }.items():
        if row[name] not in allowed:
            yield f"{name}: {row[name]!r}; allowed are {', '.join(filter(None, allowed))}"
            return
    if row["measure"] == "demonstration" and row["parameter"] != "demonstration":
        yield (
            f"measure: demonstration judges nothing, and {row['parameter']} is judged; give its "
            "measure"
        )
        return
    yield from _width_problems(row)
    yield from _bound_problems(row)
    yield from _control_problems(row)


def _width_problems(row: Row) -> Iterator[str]:
    """Yield the problems of the one or two widths of a row, and of the rule that joins them."""
    if row["quantity"] == "none":
        filled = [name for name in ("lower", "upper", "alt_quantity", "alt_upper") if row[name]]
        if filled:
            yield f"{', '.join(filled)}: filled, but quantity is none; state the quantity"
        return
    has_two = bool(row["alt_quantity"])
    if has_two != (row["rule"] in ("greater_of", "lesser_of")):
        yield (
            f"rule: {row['rule']!r} with {'two widths' if has_two else 'one width'}; give "
            f"{'greater_of or lesser_of' if has_two else 'single'}"
        )
    if row["alt_measure"] and row["alt_measure"] != row["measure"]:
        yield (
            f"alt_measure: {row['alt_measure']!r}, the measure is {row['measure']!r}; both widths "
            f"are of one measure: give two rows of one group for two measures"
        )
    yield from _limit_problems(row, "")
    if has_two:
        if row["alt_quantity"] not in ("absolute", "percent"):
            yield f"alt_quantity: {row['alt_quantity']!r}; allowed are absolute, percent"
            return
        yield from _limit_problems(row, "alt_")
    elif row["alt_upper"] or row["alt_lower"]:
        yield "alt_upper: filled, but alt_quantity is empty; state the quantity, or empty both"
    # A percentage refers to a flight value, which the base names.
    is_percent = "percent" in row["quantity"] or row["alt_quantity"] == "percent"
    if is_percent and not row["percent_base"]:
        yield f"percent_base: empty; a percentage needs one of {', '.join(BASES)}"


def _limit_problems(row: Row, prefix: str) -> Iterator[str]:
    """Yield the problems of one width: a positive number, symmetric, in a unit of the channel."""
    quantity, unit = row[f"{prefix}quantity"], row[f"{prefix}unit"]
    if quantity == "floor":
        return
    values = []
    for side in ("lower", "upper"):
        cell = row[f"{prefix}{side}"]
        try:
            values.append(float(cell))
        except ValueError:
            yield f"{prefix}{side}: {cell!r} is not a number; write digits with a decimal point"
            return
    lower, upper = values
    if not 0.0 < upper < math.inf:
        yield f"{prefix}upper: {upper:g}; a half width is positive and finite"
    elif lower != -upper:
        yield (
            f"{prefix}lower: {lower:g} with {prefix}upper {upper:g}; bands are symmetric: give "
            f"{-upper:g}, or two rows"
        )
    if "percent" in quantity:
        if unit != "%":
            yield f"{prefix}unit: {unit!r}; a percentage has the unit %"
        return
    channel = shipped.channel_of_row(row)
    try:
        if channel or row["measure"] in SCALAR_UNITS:
            limit_to_si_factor(row["measure"], channel, unit)
        elif unit:
            parse_unit(unit)
    except AeromatchError as error:
        yield f"{prefix}unit: {error}"


def _bound_problems(row: Row) -> Iterator[str]:
    """Yield the problems of the events and conditions of a row."""
    for name in ("applies_from", "applies_to"):
        if row[name] and not _BOUND.fullmatch(row[name]):
            yield f"{name}: {row[name]!r}; write an event, with a shift such as input_start-5s"
    for word in filter(None, row["condition"].split(";")):
        if re.search("[<>=]", word) is None:
            if not re.fullmatch(r"\w+", word):
                yield f"condition: {word!r}; words of letters, digits and _, joined by ;"
            continue
        if not is_relation(word):
            yield (
                f"condition: {word!r}; a relation begins with speed, groundspeed or distance, such "
                f"as groundspeed<40kt"
            )
        elif not word.endswith("_or_initial_buffet"):
            try:
                satisfies_relation(word, 0.0)
            except AeromatchError as error:
                yield f"condition: {word!r}: {error}"


def _control_problems(row: Row) -> Iterator[str]:
    """Yield a problem if the program does not read from the number which control a sweep moves."""
    number = plain_id(row["test_id"])
    if row["measure"] in _SWEEPS and number not in TRAVEL:
        yield (
            f"test_id: {row['test_id']!r} with measure {row['measure']}; the number selects the "
            f"control of a sweep: {', '.join(TRAVEL)}"
        )


def needs_mode_channel(row: Row) -> bool:
    """Return whether a case has to name the channel of a mode, since the number does not."""
    return row["measure"] in _MODES and plain_id(row["test_id"]) not in MODE_CHANNELS
