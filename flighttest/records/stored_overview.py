"""What `flight show` and `flight info` print of a record, as a file that this package wrote carries
it behind its content.

So neither NumPy nor HDF5 is imported to print it.  `flighttest.records.files` makes it of the file
as it was written.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from flightmech.support.hdf5_seal import read_if_sealed

OVERVIEW = "record 2"
"""Name of the rules by which records are read, checked for faults and listed; files carry what they gave, so that its number is raised
whenever `flight show` or `flight info` would print something else of the same file."""


def stored_overview(
    path: str | Path, part: Literal["listing", "contents"]
) -> dict[str, Any] | None:
    """Return what a sealed file states about itself: `flighttest.records.listing.record_listing` or
    `flighttest.records.contents`.

    Returns
    -------
    dict or None
        None for a file without it.

    Raises
    ------
    ParseError
        The file is damaged.
    """
    path = Path(path)
    whole = read_if_sealed(path, "a recording; write or copy it again")
    found = whole and (whole.overview(OVERVIEW) or {}).get(part)
    if not found:
        return None
    return (
        found
        | {"facts": add_file_name_facts(found["facts"], path.name)}
        | ({"file": path.name} if "file" in found else {})
    )


def add_file_name_facts(facts: Mapping[str, Any], file: str) -> dict[str, Any]:
    """Return the facts of a record, where those are None that the name of its file gives."""
    text = encodable_text(file)
    given = {"source_file": text, "title": text.split(".")[0]}
    return {key: given[key] if item is None else item for key, item in facts.items()}


def encodable_text(text: str) -> str:
    """Return a text that files can hold: bytes of a file's name that the encoding of the system
    does not know become question marks.
    """
    return text.encode("utf-8", "replace").decode()
