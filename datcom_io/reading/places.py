"""FILE:CASE: a listing, or one case of it by its name, a part of the name, or its number."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from ..listing import Case, Listing
from .reader import read

_SIGN = b"CONERR - INPUT ERROR CHECKING"  # the program begins every run with it


class Place(NamedTuple):
    """A listing and one of its cases; without case the whole listing."""

    file: Path
    case: str = ""


def place_of(text: str, folder: str | os.PathLike[str] = ".") -> Place:
    """Return the file and the case that ``FILE`` or ``FILE:CASE`` names.

    Parameters
    ----------
    text : str
        Names of files and of cases may hold colons: the file is the longest part before a colon that is one.
    folder : path
        Where a relative path begins.

    Raises
    ------
    FileNotFoundError
        Neither the text nor a part of it before a colon is a file.
    """
    file = Path(folder, text)
    if file.is_file():
        return Place(file)
    for end in reversed([k for k, letter in enumerate(text) if letter == ":"]):
        file = Path(folder, text[:end])
        if file.is_file():
            return Place(file, text[end + 1 :].strip())
    raise FileNotFoundError(2, "there is no such file; write FILE, or FILE:CASE for one case of it", text)


def listings_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the print files of the program in a folder, by name; they are recognised by their content.

    Raises
    ------
    FileNotFoundError
        There is none.
    """
    files = [path for path in sorted(Path(folder).iterdir()) if path.is_file() and _SIGN in path.read_bytes().replace(b"\0", b"")]
    if not files:
        raise FileNotFoundError(2, "no listing of Digital DATCOM in this folder; run the decks first (aeromatch datcom run)", str(folder))
    return files


def read_place(place: str | Place) -> Listing | Case:
    """Return the listing of a place, or the one case of it that the place names.

    Raises
    ------
    FileNotFoundError
        No such file.
    UnknownName
        No case, or several cases, of that name.
    ParseError
        The listing is damaged, or it is none.
    """
    place = place_of(place) if isinstance(place, str) else place
    listing = read(place.file)
    return listing[place.case] if place.case else listing
