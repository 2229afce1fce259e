"""Listings, decks and recordings from which a project is drafted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from datcom_io.reading.reader import listings_in
from flightmech.errors import SchemaError
from flightmech.support.file_kinds import packed_kind
from flightmech.support.input_files import regular_files

FILES = ("aircraft.toml", "names.toml", "manoeuvres.csv", "aeromatch.toml")
RECORD_SUFFIXES = (
    ".csv",
    ".gz",
    ".nc",
    ".h5",
    ".hdf5",
    ".mat",
    ".ulg",
    ".bin",
    ".mdf",
    ".mf4",
    ".dat",
)
DECK_SUFFIXES = (".inp", ".dcm", ".dat", ".deck")
# Suffixes of files that may be recordings, and are taken only if they are named.
_NAMED_ONLY = (".txt", ".tsv", ".asc", ".log", ".prn", ".csv~")
# Bytes that show the kind of an archive.
_PACKED_HEAD = 512
# Bytes at the start of a file in which a deck has its first namelist.
_DECK_HEAD = 100_000


@dataclass(frozen=True)
class Sources:
    """Listings, decks and recordings of a project, and remarks on files that are not read."""

    listings: tuple[Path, ...]
    decks: tuple[Path, ...]
    records: tuple[Path, ...]
    ignored: tuple[str, ...] = ()


def sources_of(datcom: Sequence[Path], records: Sequence[Path]) -> Sources:
    """Return the files of the given paths; a folder gives all its listings, decks and recordings.

    Raises
    ------
    SchemaError
        The paths have no listing, deck or recording.
    """
    listings: list[Path] = []
    decks: list[Path] = []
    for path in datcom:
        listings_of_path = _find_listings(path)
        listings += listings_of_path
        for file in _files_of(path):
            if file not in listings_of_path and _is_deck(file, is_named=path.is_file()):
                decks.append(file)
    recordings: list[Path] = []
    for path in records:
        for file in _files_of(path):
            if file not in listings + decks and _is_record(file, is_named=path.is_file()):
                recordings.append(file)
    ignored = _describe_ignored(records, {*listings, *decks, *recordings})
    for path in records:
        # Without options every folder of the project is searched for both kinds.
        is_named = path not in datcom
        if is_named and path.is_dir() and not set(recordings).intersection(_files_of(path)):
            suffixes = " ".join(RECORD_SUFFIXES)
            ignored.append(f"no recording is in {path}; it needs files of {suffixes}")
    if not listings and not decks and not recordings:
        problem = "no listing, deck or recording was found; give them with --datcom and --records"
        raise SchemaError("init", [problem, *ignored])
    return Sources(tuple(listings), tuple(decks), tuple(recordings), tuple(ignored))


def check_record_names(records: Sequence[Path]) -> None:
    """Check that no two recordings have the same name, the file without its last extension.

    Raises
    ------
    SchemaError
        Two recordings have one name; one of them would replace the other.
    """
    problems = []
    first: dict[str, Path] = {}
    for file in records:
        other = first.setdefault(file.stem, file)
        if other.resolve() != file.resolve():
            problems.append(
                f"{other} and {file} are both record {file.stem!r}; rename one, or name the "
                f"recordings to take with --records"
            )
    if problems:
        raise SchemaError("init", problems)


def _describe_ignored(places: Sequence[Path], taken: set[Path]) -> list[str]:
    """Return a remark for each file of the folders that may hold a recording and is not taken."""
    remarks = []
    for place in places:
        if not place.is_dir():
            continue
        for file in _files_of(place):
            if file in taken:
                continue
            with open(file, "rb") as opened:
                packed = packed_kind(file, opened.read(_PACKED_HEAD))
            if packed:
                remarks.append(f"{file.name} is not read: {packed}")
            elif file.suffix.lower() in _NAMED_ONLY:
                remarks.append(
                    f"{file.name} is not read: texts in a folder may be notes; if it is a "
                    f"recording, name it with --records {file.name}"
                )
    return remarks


def source_folders(folder: Path) -> tuple[Path, ...]:
    """Return a folder and its subfolders that may have sources.

    Hidden folders, the folder of the cases, and output folders of a match are left out.
    """
    folders = [folder]
    for item in sorted(folder.iterdir()):
        is_excluded = item.name == "cases" or item.name.startswith(".")
        if item.is_dir() and not is_excluded and not (item / "report").is_dir():
            folders.append(item)
    return tuple(folders)


def _files_of(path: Path) -> list[Path]:
    if path.is_dir():
        return regular_files(sorted(path.iterdir()), "an input")
    return [path]


def _find_listings(path: Path) -> list[Path]:
    if path.is_dir():
        try:
            return listings_in(path)
        except FileNotFoundError:
            return []
    # A listing with the suffix of a deck has the error report of the program.
    if path.suffix.lower() not in DECK_SUFFIXES or b"CONERR" in path.read_bytes():
        return [path]
    return []


def _is_deck(file: Path, is_named: bool) -> bool:
    """Return whether a file is a deck. A file that the user names is a deck."""
    if is_named:
        return True
    if file.suffix.lower() not in DECK_SUFFIXES:
        return False
    return b"$FLTCON" in file.read_bytes()[:_DECK_HEAD].upper()


def _is_record(file: Path, is_named: bool) -> bool:
    """Return whether a file is a recording. A file that the user names is a recording."""
    if is_named:
        return True
    return file.suffix.lower() in RECORD_SUFFIXES and file.name not in FILES


def quote(item: str) -> str:
    """Return a text in the quotes of TOML."""
    return json.dumps(item, ensure_ascii=False)
