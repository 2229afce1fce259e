"""A project folder from listings, decks and recordings: the files of a project, commented and
checked before they are left.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import flightmech
import flighttest
from aeromatch.drafting.aircraft import Geometry, StatedFacts, aircraft_text, geometry_of
from aeromatch.drafting.flown import (
    CaseDraft,
    FitDraft,
    fits_of,
    held_for_proof,
    without_unknown,
    written_cases,
)
from aeromatch.drafting.gaps import listed_columns, missing_channels, unknown_columns
from aeromatch.drafting.names import NamesDraft, check_draft, draft_names, names_text, own_names
from aeromatch.project.editing import schema_lines
from aeromatch.project.project import read_project
from datcom_io.reading.reader import listings_in
from flightmech.air import atmosphere
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.toml_quantities import UNFILLED
from flightmech.units import parse_quantity
from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres, named_by_response
from flighttest.records.manoeuvre_table import write_manoeuvres

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
_FACTS = {"temperature": "K", "latitude": "rad", "runway_elevation": "m"}


@dataclass(frozen=True)
class Drafted:
    """What was written.

    Attributes
    ----------
    files : tuple of Path
    remarks : tuple of str
        What the author has to give or to confirm.
    roles : tuple of (str, str, str, str, str)
        File, number and name of each case of the listings, its roles and why.
    records : dict of str to dict
        By record: ``channels`` (number), ``manoeuvres`` (names), ``file``.
    complete : bool
        Whether nothing is left that `aeromatch match` refuses.
    """

    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    roles: tuple[tuple[str, str, str, str, str], ...]
    records: dict[str, dict[str, Any]]
    complete: bool

    def to_dict(self) -> dict[str, Any]:
        """Return all as plain data."""
        keys = ("file", "case", "name", "roles", "reason")
        return {
            "files": [str(file) for file in self.files],
            "complete": self.complete,
            "remarks": list(self.remarks),
            "listings": [dict(zip(keys, row, strict=True)) for row in self.roles],
            "records": self.records,
        }


@dataclass(frozen=True)
class Sources:
    """Listings, decks and recordings that a project is drafted from."""

    listings: tuple[Path, ...]
    decks: tuple[Path, ...]
    records: tuple[Path, ...]


def sources_of(datcom: Sequence[Path], records: Sequence[Path]) -> Sources:
    """Return the files that paths give; of a folder all its listings, decks and recordings.

    Raises
    ------
    SchemaError
        Nothing was found.
    """
    listings: list[Path] = []
    decks: list[Path] = []
    for path in datcom:
        found = _listings(path)
        listings += found
        decks += [
            file for file in _inside(path) if file not in found and _is_deck(file, path.is_file())
        ]
    flights = [
        file
        for path in records
        for file in _inside(path)
        if file not in listings + decks and _is_record(file, path)
    ]
    if not listings and not decks and not flights:
        raise SchemaError(
            "init",
            ["no listing, deck or recording was found; give them with --datcom and --records"],
        )
    return Sources(tuple(listings), tuple(decks), tuple(flights))


def _with_subfolders(folder: Path) -> tuple[Path, ...]:
    """Return a folder and those in it that may hold sources: neither hidden, nor cases, nor what
    `aeromatch match` left.
    """
    inside = (
        item
        for item in sorted(folder.iterdir())
        if item.is_dir() and item.name != "cases" and not item.name.startswith(".")
    )
    return (folder, *(item for item in inside if not (item / "report").is_dir()))


def _inside(path: Path) -> list[Path]:
    return sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]


def _listings(path: Path) -> list[Path]:
    if path.is_dir():
        try:
            return listings_in(path)
        except FileNotFoundError:
            return []
    return (
        [path] if path.suffix.lower() not in DECK_SUFFIXES or b"CONERR" in path.read_bytes() else []
    )


def _is_deck(file: Path, named: bool) -> bool:
    return named or (
        file.suffix.lower() in DECK_SUFFIXES and b"$FLTCON" in file.read_bytes()[:100_000].upper()
    )


def _is_record(file: Path, given: Path) -> bool:
    return given.is_file() or (file.suffix.lower() in RECORD_SUFFIXES and file.name not in FILES)


def draft_project(
    folder: str | Path,
    datcom: Sequence[Path] = (),
    records: Sequence[Path] = (),
    known: StatedFacts | None = None,
    prove: Sequence[str] = (),
    force: bool = False,
    step: Callable[[str], AbstractContextManager[Any]] = nullcontext,
    own_map: str | Path | None = None,
) -> Drafted:
    """Write the files of a project into a folder.

    Parameters
    ----------
    folder : path
        Gets ``aircraft.toml names.toml manoeuvres.csv aeromatch.toml cases/``; what it holds
        besides stays.
    datcom, records : sequence of Path
        Listings, decks and recordings, or folders of them; without both those in `folder` and in
        the folders inside it.
    known : Known, optional
        What the author knows besides.
    prove : sequence of str
        Records, by file name without extension, that prove the model and identify nothing; without
        them the last of several manoeuvres of a test does.
    force : bool
        Overwrite older files.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    own_map : str or Path, optional
        Name map of the recordings, a TOML file or a shipped map, which is used as it stands;
        without it one is drafted.

    Returns
    -------
    Drafted

    Raises
    ------
    FileExistsError
        Files of these names are there and `force` is not given; all of them.
    SchemaError
        Nothing was found, or the recordings cannot be mapped.
    """
    folder, known = Path(folder), known or StatedFacts()
    if not datcom and not records and folder.is_dir():
        datcom = records = _with_subfolders(folder)
    sources = sources_of([Path(path) for path in datcom], [Path(path) for path in records])
    with step(f"read {len(sources.listings)} listings and {len(sources.decks)} decks"):
        geometry = geometry_of(sources.listings, sources.decks)
    remarks: list[str] = []
    if sources.records:
        with step(f"read {len(sources.records)} recordings, find names, units and signs"):
            draft = (
                own_names(own_map)
                if own_map is not None
                else draft_names(sources.records, geometry.flap)
            )
            names, flights, left = check_draft(_with_facts(draft, known), sources.records)
            names, flights = _with_temperature(names, flights, sources.records, known, remarks)
        unmapped = dict.fromkeys(
            name for record in flights.values() for name in listed_columns(record)
        )
        remarks += [*names.remarks, *missing_channels(flights), *left]
        remarks += unknown_columns(
            list(unmapped) if names.own is not None else names.left_out, names.own is not None
        )
    else:
        names, flights = NamesDraft(identity=True), {}
        remarks.append(
            f"no recording was given: replace the {UNFILLED!r} of flights in aeromatch.toml"
        )
    with step("find manoeuvres"):
        marks, own = _manoeuvres(flights, remarks)
    chosen = held_for_proof(
        marks, prove, [name for name, record in flights.items() if _has_engine_speed(record)]
    )
    targets = _targets(folder, names, own, marks, chosen)
    if not force and (there := [str(file) for file in targets if file.exists()]):
        raise FileExistsError(
            f"{', '.join(there)}: there already; give another folder, or --force to overwrite"
        )
    with step("write and check the project"), _all_or_none(folder, targets) as write:
        text, missing = aircraft_text(geometry, known, list(flights.values()))
        remarks += missing
        write("aircraft.toml", text)
        if not names.identity and names.own is None:
            write("names.toml", names_text(names, sources.records))
        if len(own) < len(marks):
            table = {name: found for name, found in marks.items() if name not in own and len(found)}
            write_manoeuvres(table, folder / "manoeuvres.csv")
        files = {file.stem: file for file in sources.records}
        map_file = _map_file(folder, names)
        windows = written_cases(
            chosen, files, folder / "cases", map_file, folder / "aircraft.toml", remarks
        )
        proven = [case for case in chosen if case.file in windows]
        taken: dict[str, list[tuple[float, float]]] = {}
        for case in proven:
            taken.setdefault(case.record, []).append(windows[case.file])
        channels = {
            str(name)
            for record in flights.values()
            for node in record.children.values()
            for name in node.data_vars
        }
        fits = fits_of(marks, taken, channels, set(prove))
        if not fits:
            remarks.append(
                "no manoeuvre that identifies was found: add [[fit]] with windows to aeromatch.toml"
            )
        if not proven:
            remarks.append(
                "no case was drafted: write one with 'aeromatch pom init RECORD --test ...' "
                "into the folder cases"
            )
        write(
            "aeromatch.toml",
            project_text(
                folder, geometry, sources, names, fits, proven, known, len(own) < len(marks)
            ),
        )
        complete = _sound(folder)
    about = {name: _about(files[name], record, marks[name]) for name, record in flights.items()}
    return Drafted(
        tuple(file for file in targets if file.exists()),
        tuple(remarks),
        tuple(_roles(geometry)),
        about,
        complete,
    )


def _has_engine_speed(record: xr.DataTree) -> bool:
    return any(
        str(name).endswith((".n1", ".n2"))
        for node in record.children.values()
        for name in node.data_vars
    )


def _with_facts(names: NamesDraft, known: StatedFacts) -> NamesDraft:
    """Return a map with the facts that the author states."""
    stated = {
        key: parse_quantity(_number(known.values[key]), unit)
        for key, unit in _FACTS.items()
        if known.values.get(key)
    }
    if names.own is not None and stated:
        raise SchemaError(
            "init",
            [
                f"{key} stands in [record] of the name map {names.file}; write it there"
                for key in stated
            ],
        )
    return replace(names, facts={**names.facts, **stated})


def _number(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _with_temperature(
    names: NamesDraft,
    flights: dict[str, xr.DataTree],
    files: Sequence[Path],
    known: StatedFacts,
    remarks: list[str],
) -> tuple[NamesDraft, dict[str, xr.DataTree]]:
    """Return map and records with the temperature of the standard atmosphere where none is recorded
    or stated.
    """
    channels = {
        str(name)
        for record in flights.values()
        for node in record.children.values()
        for name in node.data_vars
    }
    if names.identity or "temperature" in channels or "temperature" in names.facts:
        return names, flights
    heights = [
        float(node[name].median())
        for record in flights.values()
        for node in record.children.values()
        for name in ("h_baro", "h_gps")
        if name in node.data_vars
    ]
    if not heights:
        return names, flights
    height = sorted(heights)[len(heights) // 2]
    kelvin = round(float(atmosphere(height).temperature), 1)
    if names.own is not None:
        remarks.append(
            f'no temperature is recorded: add temperature = "{kelvin:g} K" to [record] of '
            f"{names.file}, as in the standard atmosphere"
        )
        return names, flights
    remarks.append(
        f"no temperature is recorded: that of the standard atmosphere at {height:.0f} m, "
        f"{kelvin:g} K, stands in names.toml; "
        "confirm it, 3 K change the air density by 1 %"
    )
    names = replace(names, facts={**names.facts, "temperature": kelvin})
    return names, {file.stem: flighttest.read(file, names.mapping()) for file in files}


def _manoeuvres(
    flights: Mapping[str, xr.DataTree], remarks: list[str]
) -> tuple[dict[str, pd.DataFrame], set[str]]:
    """Return the manoeuvres of every record, and the records that carry marks of their own."""
    marks, own = {}, set()
    for name, record in flights.items():
        table = flighttest.manoeuvres(record)
        if len(table):
            own.add(name)
            table = named_by_response(record, table)
        else:
            try:
                table = without_unknown(find_manoeuvres(record))
            except SchemaError as error:
                remarks.append(f"{name}: no manoeuvre was looked for: {'; '.join(error.problems)}")
        marks[name] = table
    return marks, own


def _map_file(folder: Path, names: NamesDraft) -> Path | None:
    """Return the name map of the project: the author's, or the drafted one; None where none is
    needed.
    """
    if names.identity:
        return None
    return Path(names.file) if names.own is not None else folder / "names.toml"


def _targets(
    folder: Path,
    names: NamesDraft,
    own: set[str],
    marks: Mapping[str, pd.DataFrame],
    chosen: Sequence[CaseDraft],
) -> list[Path]:
    drafted = not names.identity and names.own is None
    files = [
        "aircraft.toml",
        *(["names.toml"] if drafted else []),
        *(["manoeuvres.csv"] if len(own) < len(marks) else []),
    ]
    return [folder / file for file in (*files, "aeromatch.toml")] + [
        folder / "cases" / case.file for case in chosen
    ]


@contextmanager
def _all_or_none(folder: Path, targets: Sequence[Path]) -> Iterator[Any]:
    """Yield a function that writes a text into the folder; an error takes all files back."""
    made = [place for place in (folder / "cases", folder, *folder.parents) if not place.exists()]
    before = {file: file.read_bytes() for file in targets if file.exists()}
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    try:
        yield lambda name, text: write_text(folder / name, text)
    except BaseException:
        for file in targets:
            if file in before:
                file.write_bytes(before[file])
            else:
                file.unlink(missing_ok=True)
        for place in made:
            place.rmdir()
        raise


def project_text(
    folder: Path,
    geometry: Geometry,
    sources: Sources,
    names: NamesDraft,
    fits: Sequence[FitDraft],
    cases: Sequence[CaseDraft],
    known: StatedFacts,
    table: bool,
) -> str:
    """Return the text of a project file."""
    title = known.name or geometry.title or folder.resolve().name
    lines = [
        *schema_lines("project"),
        "# Project, drafted by `aeromatch init`: aeromatch match aeromatch.toml -o out.  "
        "Keys: docs/reference/project-keys.md",
        f"title = {_text(title)}",
        'aircraft = "aircraft.toml"',
        *_names_line(folder, names),
        f"flights = {_patterns(folder, sources.records)}   # a record is named by its file "
        f"without extension",
        *(
            [
                'manoeuvres = "manoeuvres.csv"   # found in the movements of the controls: '
                "confirm kinds and times"
            ]
            if table
            else []
        ),
        'cases = ["cases/*.toml"]' if cases else "cases = []",
        '# cutoff = "4 Hz"             # low-pass before coefficients are formed, 2 to 3 '
        "times the fastest mode of motion",
        "",
        "[listings]   # by role; FILE:NUMBER is one case of a listing",
    ]
    for role, places in geometry.places.items():
        if role == "power" and geometry.powered:
            continue
        reasons = {item.reason for item in geometry.roles if role in item.roles}
        shown = [_text(_relative(place, folder)) for place in places]
        lines.append(
            f"{role} = {shown[0] if len(shown) == 1 else '[' + ', '.join(shown) + ']'}   # "
            f"{'; '.join(sorted(reasons))}"
        )
    if geometry.powered:
        lines.append(
            "powered = true   # all clean pages hold power effects: the thrust is taken off, "
            "standard errors are wider"
        )
    if "clean" not in geometry.places:
        lines.append(
            f"clean = {_text(UNFILLED)}   # listing of the whole aeroplane: run the deck "
            f"(aeromatch datcom run), then name it here"
        )
    for fit in fits:
        lines += ["", "[[fit]]", f"name = {_text(fit.name)}", f"records = {_list(fit.records)}"]
        if fit.manoeuvres:
            lines.append(f"manoeuvres = {_list(fit.manoeuvres)}")
        if fit.windows:
            spans = ", ".join(f"[{start:g}, {end:g}]" for start, end in fit.windows)
            lines.append(f"window = [{spans}]   # [s]; what a case replays is left out")
        lines += ["models = [", *(f"    {_text(model)}," for model in fit.models), "]"]
    return "\n".join(lines) + "\n"


def _names_line(folder: Path, names: NamesDraft) -> list[str]:
    """Return the line of a project file that names the map; a shipped map goes by its name."""
    file = _map_file(folder, names)
    if file is None:
        return []
    return [f"names = {_text(_relative(str(file), folder) if file.suffix else str(file))}"]


def _patterns(folder: Path, records: Sequence[Path]) -> str:
    """Return a pattern that gives these records and no others, or their list."""
    if not records:
        return _text(UNFILLED)
    homes, endings = {file.parent.resolve() for file in records}, {file.suffix for file in records}
    if len(homes) == 1 and len(endings) == 1:
        home, ending = homes.pop(), endings.pop()
        if {file.resolve() for file in home.glob(f"*{ending}")} == {
            file.resolve() for file in records
        } and home != folder.resolve():
            return _text(f"{_relative(str(home), folder)}/*{ending}")
    return _list([_relative(str(file), folder) for file in records])


def _relative(place: str, folder: Path) -> str:
    return Path(os.path.relpath(Path(place).resolve(), folder.resolve())).as_posix()


def _text(item: str) -> str:
    return json.dumps(item, ensure_ascii=False)


def _list(items: Sequence[str]) -> str:
    return f"[{', '.join(map(_text, items))}]"


def _sound(folder: Path) -> bool:
    """Read everything back as `aeromatch match` does; whether nothing but what is marked is
    missing.

    Raises
    ------
    AeromatchError
        A drafted file is faulty although all its numbers are given.
    """
    whole = True
    for read, file in (
        (flightmech.read_aircraft, "aircraft.toml"),
        (read_project, "aeromatch.toml"),
    ):
        text = (folder / file).read_text(encoding="utf-8")
        tomllib.loads(text)
        if _text(UNFILLED) in text or (file == "aeromatch.toml" and "[[fit]]" not in text):
            whole = False
        else:
            read(folder / file)
    return whole


def _about(file: Path, record: xr.DataTree, table: pd.DataFrame) -> dict[str, Any]:
    channels = sum(len(node.data_vars) for node in record.children.values())
    found = [f"{row['manoeuvre']} {row['control']}".strip() for row in table.to_dict("records")]
    return {"file": str(file), "channels": channels, "manoeuvres": found}


def _roles(geometry: Geometry) -> Iterator[tuple[str, str, str, str, str]]:
    for item in geometry.roles:
        yield (
            item.case.file,
            str(item.case.ordinal),
            item.case.name,
            ", ".join(item.roles) or "-",
            item.reason,
        )
