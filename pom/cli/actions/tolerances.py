"""Functions that perform the commands of `pom.cli.tolerances`."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import click

from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.support.atomic_write import write_text
from flightmech.support.console import count_text, print_json, print_table
from flightmech.support.input_files import file_sha256
from pom.tolerances import rows
from pom.tolerances.band_sizes import table_size_texts
from pom.tolerances.channels import plain_id
from pom.tolerances.editions import different_rows
from pom.tolerances.own_tables import read_own_table
from pom.tolerances.rows import Row

SHIPPED = "aeromatch"
MOST_SIZES = 10  # of the printed remarks on widths
_SHIPPED_FILE = Path(rows.__file__).with_name("tolerances.csv")


@dataclass(frozen=True)
class _Edition:
    """One edition of one table; ``sha256`` is that of the whole table."""

    table: str
    sha256: str
    standard: str
    edition: str
    rows: tuple[Row, ...]

    @property
    def name(self) -> str:
        return f"{self.table}: {self.standard}, {self.edition}"

    def tests(self) -> dict[str, list[Row]]:
        """Return the rows by test; numbers as the FAA writes them, so that standards compare."""
        tests: dict[str, list[Row]] = {}
        for row in self.rows:
            tests.setdefault(plain_id(row["test_id"]), []).append(row)
        return tests


def list_tolerances(
    files: tuple[str, ...], compared: tuple[str, str] | None, copy: str | None, as_json: bool
) -> None:
    """Perform the command ``tolerances``."""
    editions = list(_editions_of(SHIPPED, file_sha256(_SHIPPED_FILE), rows.tolerance_rows()))
    problems = []
    sizes: list[str] = []
    for file in files:
        try:
            table = read_own_table(file)
        except SchemaError as error:
            # all files are checked before the first error is raised
            problems += [f"{error.what}: {text}" for text in error.problems]
            continue
        editions += _editions_of(Path(file).name, table.sha256, table.rows)
        sizes += [f"{Path(file).name}: {text}" for text in table_size_texts(table.rows)]
    if problems:
        raise SchemaError("tolerance tables", problems)
    for text in sizes[:MOST_SIZES]:
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    if len(sizes) > MOST_SIZES:
        more = f"{len(sizes) - MOST_SIZES} more tolerances of a size that is not usual"
        warnings.warn(more, AeromatchWarning, stacklevel=2)
    if copy is not None:
        write_text(copy, _SHIPPED_FILE.read_text(encoding="utf-8"))
    if compared is not None:
        _print_comparison(*(_select(editions, text) for text in compared), as_json=as_json)
    else:
        _print_editions(editions, as_json=as_json)
    if copy is not None and not as_json:
        click.echo(f"written: {copy}")


def _editions_of(table: str, sha256: str, all_rows: Sequence[Row]) -> Iterator[_Edition]:
    """Yield the editions of a table in the order of their first rows."""
    by_edition: dict[tuple[str, str], list[Row]] = {}
    for row in all_rows:
        by_edition.setdefault((row["standard"], row["edition"]), []).append(row)
    for (standard, edition), members in by_edition.items():
        yield _Edition(table, sha256, standard, edition, tuple(members))


def _select(editions: Sequence[_Edition], text: str) -> _Edition:
    """Return the only edition whose name holds all words of a text."""
    words = text.lower().split()
    fitting = []
    for item in editions:
        name = item.name.lower()
        if all(word in name for word in words):
            fitting.append(item)
    if len(fitting) != 1:
        hint = "give more of its words" if fitting else "give words of one name"
        raise UnknownName(text, [item.name for item in editions], "edition", hint)
    return fitting[0]


def _print_editions(editions: Sequence[_Edition], *, as_json: bool) -> None:
    documents: list[dict[str, Any]] = []
    for item in editions:
        counts = Counter(row["provenance"] for row in item.rows)
        documents.append(
            {
                "table": item.table,
                "sha256": item.sha256,
                "standard": item.standard,
                "edition": item.edition,
                "tests": len({row["test_id"] for row in item.rows}),
                "rows": len(item.rows),
                "provenance": dict(sorted(counts.items())),
            }
        )
    if as_json:
        print_json(documents)
        return
    lines = []
    for document in documents:
        counts_text = ", ".join(f"{n} {name}" for name, n in document["provenance"].items())
        head = [document[key] for key in ("table", "standard", "edition", "tests", "rows")]
        lines.append((*map(str, head), counts_text, document["sha256"][:12]))
    columns = ("table", "standard", "edition", "tests", "rows", "provenance", "sha256")
    print_table(columns, lines)


def _print_comparison(old: _Edition, new: _Edition, *, as_json: bool) -> None:
    """Print the rows that differ, and the tests that one edition lacks."""
    tests = old.tests(), new.tests()
    lines: list[Mapping[str, str]] = []
    for test in dict.fromkeys([*tests[0], *tests[1]]):
        if test not in tests[0] or test not in tests[1]:
            texts = [_test_text(members.get(test)) for members in tests]
            lines.append({"test": test, "criterion": "all", "old": texts[0], "new": texts[1]})
            continue
        for name, (before, after) in different_rows(tests[0][test], tests[1][test]):
            lines.append({"test": test, "criterion": name, "old": before, "new": after})
    if as_json:
        print_json({"old": old.name, "new": new.name, "differences": lines})
        return
    click.echo(f"old: {old.name}\nnew: {new.name}")
    columns = ("test", "criterion", "old", "new")
    if lines:
        print_table(columns, list(map(itemgetter(*columns), lines)))
    common = sum(test in tests[1] for test in tests[0])
    click.echo(
        f"{count_text(len(lines), 'difference')}; {count_text(common, 'test')} in both, "
        f"{len(tests[0]) - common} only in the old, {len(tests[1]) - common} only in the new"
    )


def _test_text(members: Sequence[Row] | None) -> str:
    """Return what an edition has of a test."""
    return "absent" if members is None else count_text(len(members), "row")
