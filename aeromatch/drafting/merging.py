"""A new draft of a file that its author may have edited since the last draft.

What the author has changed stays.  Everything else becomes as the new draft has it.  A key that
both have changed keeps the value of the author, and is reported.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

import pandas as pd
import tomlkit
from tomlkit.items import AoT, Table

from flightmech.support.toml_quantities import CONFIRM

_ABSENT = object()


@dataclass(frozen=True)
class MergedText:
    """Text of a file, and the keys where the author's value differs from a new draft."""

    text: str
    kept: tuple[str, ...] = ()


def merge_toml(drafted: str, own: str, new: str) -> MergedText:
    """Return the author's TOML file with the news of a draft.

    Parameters
    ----------
    drafted : str
        File as it was drafted last; empty if it is not known, so that every key is the author's.
    own : str
        File as it is now.
    new : str
        New draft.

    Raises
    ------
    ParseError
        The file of the author is not TOML (from its reader, before this call).

    Examples
    --------
    >>> own = 'mass = 900\\nb = 10\\n'
    >>> merged = merge_toml('mass = "?"\\nb = 10\\n', own, 'mass = "?"\\nb = 11\\n')
    >>> merged.text, merged.kept
    ('mass = 900\\nb = 11\\n', ())
    """
    document = tomlkit.parse(own)
    kept: list[str] = []
    before = tomlkit.parse(drafted).unwrap()
    _merge_tables(before, document, tomlkit.parse(new), (), kept)
    return MergedText(tomlkit.dumps(document), tuple(kept))


def _merge_tables(
    before: Mapping[str, Any],
    own: MutableMapping[str, Any],
    new: Mapping[str, Any],
    place: tuple[str, ...],
    kept: list[str],
) -> None:
    """Change a table of the author's file to the new draft, except what the author has changed."""
    for key in list(own):
        if key in new or key not in before:
            continue
        # The draft has dropped an entry.
        if _plain(own[key]) == before[key]:
            del own[key]
        else:
            kept.append(".".join((*place, key)))
    for key, item in new.items():
        drafted = before.get(key, _ABSENT)
        here = (*place, key)
        if key not in own:
            if drafted is _ABSENT:
                own[key] = item
            elif drafted != _plain(item):
                kept.append(".".join(here))
            continue
        present = own[key]
        if isinstance(present, Table) and isinstance(item, Table):
            inner = drafted if isinstance(drafted, Mapping) else {}
            _merge_tables(inner, present, item, here, kept)
        elif _plain(present) == _plain(item):
            # The author has confirmed the drafted value with an option.
            if CONFIRM in _comment(present) and CONFIRM not in _comment(item):
                _take_comment(present, _comment(item))
        elif isinstance(present, AoT) and isinstance(item, AoT) and _have_names(present, item):
            _merge_named_tables(drafted, present, item, here, kept)
        elif _plain(present) == drafted:
            comment = _comment(item)
            own[key] = item
            # tomlkit keeps the old comment if the new value has none
            _take_comment(own[key], comment)
        elif drafted != _plain(item):
            kept.append(".".join(here))


def _comment(item: Any) -> str:
    """Return the comment behind a value; empty for a truth value or a table in parts."""
    trivia = getattr(item, "trivia", None)
    return "" if trivia is None or isinstance(item, Table | AoT) else trivia.comment


def _take_comment(item: Any, comment: str) -> None:
    """Set the comment behind a value; an empty text removes it."""
    trivia = getattr(item, "trivia", None)
    if trivia is not None and not isinstance(item, Table | AoT):
        trivia.comment = comment
        trivia.comment_ws = (trivia.comment_ws or "   ") if comment else ""


def _merge_named_tables(
    drafted: Any, own: AoT, new: AoT, place: tuple[str, ...], kept: list[str]
) -> None:
    """Merge a list of tables with names, such as ``[[fit]]``, table by table."""
    before = {item["name"]: item for item in drafted} if isinstance(drafted, list) else {}
    names = {item["name"]: item for item in new}
    # From the end, because entries are removed. What the author changed stays.
    for position in reversed(range(len(own))):
        item = own[position]
        if item["name"] not in names and _plain(item) == before.get(item["name"]):
            del own[position]
    present = {item["name"]: item for item in own}
    for name, item in names.items():
        here = (*place, str(name))
        if name in present:
            _merge_tables(before.get(name, {}), present[name], item, here, kept)
        elif name not in before:
            own.append(item)
        elif before[name] != _plain(item):
            kept.append(".".join(here))


def is_other_flight(drafted: str, new: str) -> bool:
    """Return whether two drafts of a case replay different records or windows.

    The edits of an author then belong to another flight than the new draft.
    """
    cases = [tomlkit.parse(text).unwrap().get("case", {}) for text in (drafted, new)]
    flights = [(case.get("record"), case.get("window")) for case in cases]
    return flights[0] != flights[1]


def _have_names(*lists: AoT) -> bool:
    tables = itertools.chain(*lists)
    return all("name" in table for table in tables)


def _plain(item: Any) -> Any:
    return item.unwrap() if hasattr(item, "unwrap") else item


def merge_manoeuvres(drafted: str, own: str, new: str) -> MergedText:
    """Return the author's table of manoeuvres with the records that it does not have.

    Parameters
    ----------
    drafted, own, new : str
        CSV texts with a column ``record``, as of `merge_toml`.

    Notes
    -----
    The rows of a record are kept or replaced together, because marks of one record depend on each
    other.
    """
    before, present, news = (_rows_by_record(text) for text in (drafted, own, new))
    rows: dict[str, pd.DataFrame] = {}
    kept: list[str] = []
    for record in dict.fromkeys([*present, *news]):
        is_own = not _is_same(present.get(record), before.get(record))
        if is_own and not _is_same(present.get(record), news.get(record)):
            if not _is_same(before.get(record), news.get(record)):
                kept.append(record)
            chosen = present.get(record)
        else:
            chosen = news.get(record)
        if chosen is not None:
            rows[record] = chosen
    if not rows:
        return MergedText(new, tuple(kept))
    return MergedText(pd.concat(rows.values()).to_csv(index=False), tuple(kept))


def edited_records(drafted: str, own: str) -> set[str]:
    """Return the records whose rows differ between a drafted table and that of the author."""
    before, present = _rows_by_record(drafted), _rows_by_record(own)
    records = {*before, *present}
    return {name for name in records if not _is_same(before.get(name), present.get(name))}


def _rows_by_record(text: str) -> dict[str, pd.DataFrame]:
    if not text.strip():
        return {}
    head = text.splitlines()[0]
    # A spreadsheet may have saved the table with semicolons and decimal commas.
    separator = ";" if ";" in head and "," not in head else ","
    table = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False, sep=separator)
    table.columns = table.columns.str.strip()
    for name in table.columns.intersection(["start", "end", "confidence"]):
        table[name] = table[name].str.replace(",", ".", regex=False)
    return {str(name): rows for name, rows in table.groupby("record", sort=False)}


def _is_same(first: pd.DataFrame | None, second: pd.DataFrame | None) -> bool:
    if first is None or second is None:
        return first is second
    return first.reset_index(drop=True).equals(second.reset_index(drop=True))
