"""What the author has changed in a drafted name map: the lines that a new draft keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aeromatch.drafting.name_map.name_rows import AS_WRITTEN, NameMapRow
from flighttest.records.readers.name_map import Channel, Clock, Facts, NameMap
from flighttest.records.readers.name_map_reading import read_names


@dataclass(frozen=True)
class AuthorMap:
    """Lines of a name map that its author has written or changed since the last draft.

    Attributes
    ----------
    names : NameMap
        These lines alone.
    removed : frozenset of str
        Columns of the lines that the author has removed.
    """

    names: NameMap
    removed: frozenset[str] = frozenset()

    def confirmed(self) -> dict[str, tuple[str, ...]]:
        """Return the columns of every quantity that the author has mapped."""
        columns: dict[str, tuple[str, ...]] = {}
        for channels in self.names.leaves.values():
            for name, channel in channels.items():
                columns[name] = channel.columns
        return columns

    def rows(self) -> list[NameMapRow]:
        """Return the lines of the channels as rows of a draft."""
        return rows_of_map(self.names)

    def extend(self, drafted: NameMap) -> NameMap:
        """Return a drafted map with these lines in place of its own."""
        leaves = {leaf: dict(channels) for leaf, channels in drafted.leaves.items()}
        for leaf, channels in self.names.leaves.items():
            leaves.setdefault(leaf, {}).update(channels)
        own = self.names
        return replace(
            own,
            leaves=leaves,
            clock=drafted.clock if own.clock == Clock() else own.clock,
            clocks={**drafted.clocks, **own.clocks},
            facts=Facts(**{**drafted.facts.stated(), **own.facts.stated()}),
            constants={**drafted.constants, **own.constants},
        )


def rows_of_map(names: NameMap) -> list[NameMapRow]:
    """Return the channels of an author's map as rows."""
    rows = []
    for leaf, channels in names.leaves.items():
        for name, channel in channels.items():
            row = NameMapRow(leaf, name, channel, unit=channel.unit or "", confidence=AS_WRITTEN)
            rows.append(row)
    return rows


def read_author_map(file: Path, drafted: Path) -> AuthorMap | None:
    """Return the lines of a name map that differ from its last draft.

    Parameters
    ----------
    file : Path
        Name map of the project; it need not exist.
    drafted : Path
        The same file as it was drafted.  Without it, all lines are those of the author.

    Returns
    -------
    AuthorMap or None
        None without a map.

    Raises
    ------
    SchemaError
        The map is faulty, with all problems.
    """
    if not file.exists():
        return None
    own = read_names(file)
    if not drafted.exists():
        return AuthorMap(own)
    before = read_names(drafted)
    leaves: dict[str, dict[str, Channel]] = {}
    for leaf, channels in own.leaves.items():
        changed = _changed_entries(channels, before.leaves.get(leaf, {}))
        if changed:
            leaves[leaf] = changed
    changes = AuthorMap(
        replace(
            own,
            leaves=leaves,
            clock=Clock() if own.clock == before.clock else own.clock,
            clocks=_changed_entries(own.clocks, before.clocks),
            facts=Facts(**_changed_entries(own.facts.stated(), before.facts.stated())),
            constants=_changed_entries(own.constants, before.constants),
        ),
        removed=frozenset(_columns_of(before) - _columns_of(own)),
    )
    return changes


def _changed_entries(own: Mapping[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    return {key: item for key, item in own.items() if before.get(key) != item}


def _columns_of(names: NameMap) -> set[str]:
    columns: set[str] = set()
    for channels in names.leaves.values():
        for channel in channels.values():
            columns.update(channel.columns)
    return columns
