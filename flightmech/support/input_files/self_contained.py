"""HDF5 files whose numbers lie elsewhere are refused: the hash of such a file certifies nothing, and it can read any file of the user."""

from __future__ import annotations

import os
from typing import Any

from ...errors import ParseError

MOST_GROUPS = 5000
"""Groups of a file; one of this program has some hundred at most."""


def demand_self_contained(path: str | os.PathLike) -> None:
    """Check that an HDF5 or netCDF-4 file holds its numbers itself, each group once.

    A file that HDF5 cannot open, or that is damaged, passes: whoever reads it reports that.

    Raises
    ------
    ParseError
        The first external or symbolic link, external storage, virtual dataset, circle of groups, or more than `MOST_GROUPS` groups.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:  # as all readers do: HDF5 refuses to open one file in two ways at once
            fault = _fault(file)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError):
        return
    if fault:
        raise ParseError(os.fspath(path), 0, fault, "a file that holds its numbers itself; copy them into it")


def _fault(file: Any) -> str:
    """Return what is wrong with the links and datasets of a file; empty when nothing is."""
    from h5py import h5d, h5g, h5l, h5o

    waiting = [("", file.id)]
    seen = {h5o.get_info(file.id).addr}
    while waiting:
        above, group = waiting.pop()
        links: list[tuple[bytes, int]] = []
        group.links.iterate(lambda name, link, links=links: links.append((name, link.type)), info=True)
        for name, kind in links:
            place = f"{above}/{name.decode('utf-8', 'surrogateescape')}"
            if kind == h5l.TYPE_EXTERNAL:
                return f"{place} is a link into another file, {os.fsdecode(group.links.get_val(name)[0])}"
            if kind != h5l.TYPE_HARD:
                return f"{place} is a symbolic link"
            item = h5o.open(group, name)
            if isinstance(item, h5d.DatasetID) and item.get_offset() is None:  # else its numbers lie there, in one piece
                plan = item.get_create_plist()
                if plan.get_layout() == h5d.VIRTUAL or plan.get_external_count():
                    return f"{place} keeps its numbers in another file"
            if isinstance(item, h5g.GroupID):
                address = h5o.get_info(item).addr
                if address in seen:
                    return f"the group {place} is linked to more than once"
                seen.add(address)
                waiting.append((place, item))
                if len(seen) > MOST_GROUPS:
                    return f"more than {MOST_GROUPS} groups"
    return ""
