"""Files that a project file names: their types in the model of a project, and their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from glob import has_magic
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationInfo
from pydantic_core import core_schema

from datcom_io.reading.reader import ListingCase, place_of
from flightmech.errors import ParseError, near_names
from flightmech.support.input_files import match_files
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import UNFILLED, InUnits

Paths = str | tuple[str, ...]


@dataclass
class ProjectFolder:
    """Folder of a project file, with the problems of the files that it names.

    It is the context of the validation of a project. A missing file is a line in `problems` and
    not an error of pydantic, so that a misspelt key is reported first and alone.

    Attributes
    ----------
    file : Path
        The project file, absolute.
    problems : list of str
    """

    file: Path
    problems: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """Folder that relative paths refer to."""
        return self.file.parent

    def existing(self, name: str, key: str) -> Path:
        """Return the path of a file; a missing file at `key` is a problem."""
        file = self.folder / name
        # The path is returned in any case, so that all missing files are reported at once.
        if not file.is_file():
            others = [item.name for item in self.folder.iterdir() if item.is_file()]
            near = near_names(Path(name).name, others, 3, cutoff=0.7)
            remedy = f"near it: {', '.join(near)}" if near else "give its path from there"
            self.problems.append(f"{key}: no file {name!r} in {self.folder}; {remedy}")
        return file

    def matching(self, pattern: str, key: str) -> list[Path]:
        """Return the files that match a pattern, sorted; a pattern without a file is a problem."""
        try:
            names = match_files(str(self.folder / pattern))
        except OSError as error:
            self.problems.append(f"{key}: {error}; name the folder of the files")
            return []
        except ParseError as error:
            self.problems.append(f"{key}: {error}")
            return []
        if not names:
            self.problems.append(f"{key}: {self._explain_no_match(pattern)}")
        return [Path(name) for name in names]

    def _explain_no_match(self, pattern: str) -> str:
        if pattern == UNFILLED:
            return (
                f"{UNFILLED!r} stands for files that are still to be given; write a file or a "
                f"pattern such as 'folder/*.csv'"
            )
        if pattern and (self.folder / pattern).is_dir():
            example = str(Path(pattern) / "*")
            return f"{pattern!r} is a folder; name its files, such as {example!r}"
        return (
            f"no file matches {pattern!r} in {self.folder}; give a file or a pattern such as "
            f"'folder/*.toml'"
        )

    def listings(self, text: str, key: str) -> list[ListingCase]:
        """Return the listings of a pattern, or one case of each; a missing file is a problem.

        A name that is a file is taken as it is, also with the letters of a pattern.
        """
        if text == UNFILLED or not has_magic(text) or self._is_place(text):
            return [self.listing(text, key)]
        # Names may hold colons, so the longest part that matches a file counts.
        colons = [k for k, letter in enumerate(text) if letter == ":"]
        for end in reversed(colons):
            if self._has_match(text[:end]) and not self._has_match(text):
                case = text[end + 1 :].strip()
                return [ListingCase(file, case) for file in self.matching(text[:end], key)]
        return [ListingCase(file) for file in self.matching(text, key)]

    def _has_match(self, pattern: str) -> bool:
        """Return whether a file matches; a pattern that is refused is reported by `matching`."""
        with suppress(OSError, ParseError):
            return bool(match_files(str(self.folder / pattern)))
        return False

    def _is_place(self, text: str) -> bool:
        try:
            place_of(text, self.folder)
        except FileNotFoundError:
            return False
        return True

    def listing(self, text: str, key: str) -> ListingCase:
        """Return a listing, or one case of it; a missing file is a problem."""
        if text == UNFILLED:
            self.problems.append(
                f"{key}: {UNFILLED!r} stands for a listing that is still to be given; "
                f"write FILE, or FILE:CASE"
            )
            return ListingCase(self.folder / text)
        try:
            return place_of(text, self.folder)
        except FileNotFoundError:
            self.problems.append(
                f"{key}: no file {text!r} in {self.folder}; write FILE, or FILE:CASE for one "
                f"case of it"
            )
            return ListingCase(self.folder / text)


@dataclass(frozen=True)
class ReadAs:
    """Annotation of a field whose value is made from the content of the file.

    The JSON schema of the field is the schema of the content.

    Attributes
    ----------
    content : type
        Type in the file.
    convert : callable
        Returns the value of the field from the content, the folder of the project, and the key.
    """

    content: Any
    convert: Callable[[Any, ProjectFolder, str], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the schema of pydantic: the content, then `convert`."""

        def convert(content: Any, info: ValidationInfo) -> Any:
            if not isinstance(info.context, ProjectFolder):
                raise TypeError("A project is validated with a ProjectFolder as context.")
            return self.convert(content, info.context, str(info.field_name))

        schema = handler.generate_schema(self.content)
        return core_schema.with_info_after_validator_function(convert, schema)


def _as_sequence(paths: Paths) -> tuple[str, ...]:
    if isinstance(paths, str):
        return (paths,)
    return paths


def _find_file(name: str, folder: ProjectFolder, key: str) -> Path:
    return folder.existing(name, key)


def _find_optional_file(name: str | None, folder: ProjectFolder, key: str) -> Path | None:
    # An empty text is a key without a file.
    if not name:
        return None
    return folder.existing(name, key)


# Largest number of names or patterns in a list. Each of them is searched for in the file system.
MOST_NAMES = 1000


def _few(names: tuple[str, ...], folder: ProjectFolder, key: str) -> tuple[str, ...]:
    """Return the names of a list; too many of them are a problem, and none is returned."""
    if len(names) <= MOST_NAMES:
        return names
    folder.problems.append(
        f"{key}: {len(names)} names or patterns; at most {MOST_NAMES}; join them in a pattern"
    )
    return ()


def _find_files(names: tuple[str, ...], folder: ProjectFolder, key: str) -> tuple[Path, ...]:
    return tuple(folder.existing(name, key) for name in _few(names, folder, key))


def _match_patterns(patterns: tuple[str, ...], folder: ProjectFolder, key: str) -> tuple[Path, ...]:
    files: list[Path] = []
    for pattern in _few(patterns, folder, key):
        files += folder.matching(pattern, key)
    return tuple(files)


def _demand_patterns(patterns: Paths, folder: ProjectFolder, key: str, example: str) -> None:
    if not patterns and not isinstance(patterns, str):
        folder.problems.append(
            f"{key}: an empty list; give a file or a pattern such as {example!r}"
        )


def _match_paths(patterns: Paths, folder: ProjectFolder, key: str) -> tuple[Path, ...]:
    _demand_patterns(patterns, folder, key, "folder/*")
    return _match_patterns(_as_sequence(patterns), folder, key)


def _match_flights(patterns: Paths, folder: ProjectFolder, key: str) -> dict[str, Path]:
    _demand_patterns(patterns, folder, key, "flight/*.csv")
    # A record is named after its file.
    flights: dict[str, Path] = {}
    for file in _match_patterns(_as_sequence(patterns), folder, key):
        other = flights.setdefault(file.stem, file)
        # Several patterns may match one file.
        if other.resolve() != file.resolve():
            folder.problems.append(
                f"{key}: {other} and {file} are both record {file.stem!r}; rename one, or leave it "
                f"out of {key}"
            )
    return flights


def _find_listings(paths: Paths, folder: ProjectFolder, key: str) -> tuple[ListingCase, ...]:
    if not paths:
        return ()
    places: list[ListingCase] = []
    for text in _few(_as_sequence(paths), folder, f"listings.{key}"):
        places += folder.listings(text, f"listings.{key}")
    # A file that two patterns name is one listing.
    return tuple(dict.fromkeys(places))


InputFile = Annotated[Path, ReadAs(str, _find_file)]
OptionalFile = Annotated[Path | None, ReadAs(str | None, _find_optional_file)]
InputFiles = Annotated[tuple[Path, ...], ReadAs(tuple[str, ...], _find_files)]
MatchedFiles = Annotated[tuple[Path, ...], ReadAs(tuple[str, ...], _match_patterns)]
PathPatterns = Annotated[tuple[Path, ...], ReadAs(Paths, _match_paths)]
FlightFiles = Annotated[Mapping[str, Path], ReadAs(Paths, _match_flights)]
ListingCases = Annotated[tuple[ListingCase, ...], ReadAs(Paths, _find_listings)]


class Listings(Strict):
    """Digital DATCOM listings by their role in `aerodb.from_datcom`, one or several each;
    ``FILE:CASE`` takes one case of a file, a pattern such as ``datcom/flaps_*.out`` all its files.
    """

    clean: ListingCases = Field(
        default=(),
        description="The whole aeroplane without deflections; required with any other role.",
    )
    flaps: ListingCases = Field(default=(), description="Increments of the flaps.")
    elevator: ListingCases = Field(
        default=(), description="Increments of the elevator or stabiliser."
    )
    aileron: ListingCases = Field(default=(), description="Increments of the ailerons.")
    ground: ListingCases = Field(default=(), description="The whole aeroplane in ground effect.")
    ground_flap: ListingCases = Field(default=(), description="The same with flaps.")
    ground_elevator: ListingCases = Field(
        default=(), examples=["datcom/ground_elevator.out"], description="The same with elevator."
    )
    power: ListingCases = Field(
        default=(),
        examples=["datcom/power.out"],
        description="The whole aeroplane with power effects.",
    )
    spoilers: ListingCases = Field(
        default=(), examples=["datcom/spoilers.out"], description="Increments of the spoilers."
    )
    differential_tail: ListingCases = Field(
        default=(),
        examples=["datcom/differential_tail.out"],
        description="Increments of a differential tail.",
    )
    tabs: ListingCases = Field(
        default=(), examples=["datcom/tabs.out"], description="Increments of trim tabs."
    )
    aileron_hinge: ListingCases = Field(
        default=(),
        examples=["datcom/aileron_hinge.out"],
        description="Hinge moments of the ailerons.",
    )
    altitude: Annotated[float, InUnits("m")] | None = Field(
        default=None, examples=["5000 ft"], description="Reference altitude of the a-priori tables."
    )
    powered: bool = Field(
        default=False,
        description="Whether clean pages hold power effects: thrust terms are taken off and "
        "standard errors are wider.",
    )
    tailless: bool = Field(
        default=False, description="Whether the aeroplane has no horizontal tail."
    )
    move_reference: bool = Field(
        default=False,
        description="Whether the listing's reference point is moved to that of the aircraft file.",
    )

    @property
    def statements(self) -> dict[str, bool]:
        """Statements about the listings, keywords of `aerodb.from_datcom`."""
        return {
            "powered": self.powered,
            "tailless": self.tailless,
            "move_reference": self.move_reference,
        }

    @property
    def by_role(self) -> dict[str, tuple[ListingCase, ...]]:
        """The listings, or single cases of them, by their role in `aerodb.from_datcom`."""
        # The other fields of the model are statements about the listings.
        excluded = ("altitude", *self.statements)
        return {role: cases for role, cases in self if role not in excluded and cases}

    def places(self) -> list[ListingCase]:
        """Return the listings of all roles."""
        places: list[ListingCase] = []
        for cases in self.by_role.values():
            places += cases
        return places
