"""Draft of a project folder from listings, decks and recordings, with comments and a check."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from aeromatch.drafting.aircraft import MASS, StatedFacts, aircraft_text
from aeromatch.drafting.flown import (
    CaseDraft,
    describe_unused,
    fits_of,
    held_for_proof,
    replayed_windows,
    write_cases,
)
from aeromatch.drafting.gaps import (
    channel_names,
    compare_mass,
    describe_unable,
    open_gaps,
    unable_to_identify,
)
from aeromatch.drafting.geometry import Geometry, geometry_of
from aeromatch.drafting.merging import edited_records
from aeromatch.drafting.name_map.author_map import AuthorMap, read_author_map
from aeromatch.drafting.name_map.column_table import ColumnRow
from aeromatch.drafting.name_map.name_text import names_text
from aeromatch.drafting.name_map.names import NamesDraft
from aeromatch.drafting.power import describe_power, recorded_power
from aeromatch.drafting.previous import (
    ANSWERS,
    DRAFT_FOLDER,
    DraftAnswers,
    read_answers,
    read_draft,
)
from aeromatch.drafting.project_files import ProjectFiles
from aeromatch.drafting.project_text import map_file, project_text
from aeromatch.drafting.recordings import (
    FACTS,
    RecordedFlights,
    add_manoeuvres,
    has_engine_speed,
    read_flights,
)
from aeromatch.drafting.sources import (
    Sources,
    check_record_names,
    quote,
    source_folders,
    sources_of,
)
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import number_or_text, parse_quantity
from flightmech.support.toml_quantities import UNFILLED
from flighttest.records.manoeuvre_table import read_manoeuvres, write_manoeuvres
from flighttest.records.readers.name_map import latitude_problem

_PROJECT, _TABLE, _NAMES = "aeromatch.toml", "manoeuvres.csv", "names.toml"


@dataclass(frozen=True)
class Drafted:
    """Result of a draft.

    Attributes
    ----------
    files : tuple of Path
        Written files.
    remarks : tuple of str
        Values that the author has to give or to confirm.
    roles : tuple of (str, str, str, str, str)
        File, number and name of each case of the listings, its roles, and the reason.
    records : dict of str to dict
        By record: ``channels`` (number), ``manoeuvres`` (names), ``file``.
    complete : bool
        Whether no value waits for its author. The plan of a match checks the rest.
    columns : tuple of ColumnRow
        What each column of the recordings is taken for.
    """

    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    roles: tuple[tuple[str, str, str, str, str], ...]
    records: dict[str, dict[str, Any]]
    complete: bool
    columns: tuple[ColumnRow, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return all as plain data."""
        keys = ("file", "case", "name", "roles", "reason")
        return {
            "files": [str(file) for file in self.files],
            "complete": self.complete,
            "remarks": list(self.remarks),
            "columns": [row.to_dict() for row in self.columns],
            "listings": [dict(zip(keys, row, strict=True)) for row in self.roles],
            "records": self.records,
        }


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
        Gets ``aircraft.toml names.toml manoeuvres.csv aeromatch.toml cases/``. Its other files
        stay. In a drafted folder, what its author has changed stays, and the rest is drafted anew.
    datcom, records : sequence of Path
        Listings, decks and recordings, or folders of them. The default is that of the last draft,
        else `folder` and its subfolders.
    known : StatedFacts, optional
        Further facts, in addition to those of the last draft.
    prove : sequence of str
        Records, by file name without extension, that prove the model and identify nothing. The
        default is the last of several manoeuvres of a test.
    force : bool
        Draft all files anew. The edits of the author stay in copies only.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    own_map : str or Path, optional
        Name map outside of the project, a TOML file or a shipped map, which is used unchanged.
        Without it a name map is drafted; that of the project keeps the lines of its author.

    Returns
    -------
    Drafted

    Raises
    ------
    ParseError
        A file of the author is not TOML.
    SchemaError
        No source was found, or the recordings cannot be mapped.
    """
    folder = Path(folder)
    given = DraftAnswers(
        known or StatedFacts(),
        tuple(datcom),
        tuple(records),
        prove=tuple(prove),
        own_map=_name_outside(own_map),
    )
    answers = read_answers(folder).extended(given)
    _check_units(answers.facts)
    prove = answers.prove
    datcom, records = _source_paths(folder, answers)
    sources = sources_of([Path(path) for path in datcom], [Path(path) for path in records])
    check_record_names(sources.records)
    with step(f"read {len(sources.listings)} listings and {len(sources.decks)} decks"):
        geometry = geometry_of(sources.listings, sources.decks)
    remarks = list(sources.ignored)
    remarks += _check_proving(prove, sources.records, is_given=bool(given.prove))
    outside, author = _find_own_map(folder, answers.own_map, force)
    if sources.records:
        with step(f"read {len(sources.records)} recordings, find names, units and signs"):
            flights = read_flights(
                sources,
                geometry.flap,
                known=answers.facts,
                own_map=outside,
                remarks=remarks,
                author=author,
            )
    else:
        flights = RecordedFlights(NamesDraft(identity=True))
        remarks.append(
            f"no recording was given: replace the {UNFILLED!r} of flights in aeromatch.toml"
        )
    with step("find manoeuvres"):
        add_manoeuvres(flights, {} if force else _own_manoeuvres(folder), remarks)
    with step("write the project"), ProjectFiles(folder, is_anew=force) as files:
        text, gaps = aircraft_text(geometry, answers.facts, list(flights.records.values()))
        files.write("aircraft.toml", text)
        own = (folder / "aircraft.toml").read_text(encoding="utf-8")
        remarks += open_gaps(gaps, text, own)
        remarks += compare_mass(own, flights.records)
        _write_project(files, geometry, sources, flights, answers=answers, remarks=remarks)
        files.replace(folder / DRAFT_FOLDER / ANSWERS, answers.to_json(folder))
        is_filled = _read_files(folder)
    return Drafted(
        files=tuple(file for file in files.written if file.exists()),
        remarks=(*remarks, *files.remarks),
        roles=tuple(_role_rows(geometry)),
        records=_summarise_records(sources, flights),
        complete=is_filled,
        columns=tuple(flights.columns),
    )


def _check_units(facts: StatedFacts) -> None:
    """Raise for stated masses, inertias, places and conditions that are not a number, have another
    unit, or are a mass or moment of inertia that no body has, or a latitude beyond a pole.
    """
    problems = []
    masses = {key: lookup(key).units for key in (*MASS, "Ixz")}
    stated = [(key, unit, facts.values.get(key)) for key, unit in {**masses, **FACTS}.items()]
    for key, place in (("--cg", facts.cg), ("--imu", facts.imu)):
        stated += [(key, "m", text) for text in place or ()]
    for key, unit, text in stated:
        if not text:
            continue
        try:
            number = parse_quantity(number_or_text(text), unit)
        except UnitError as error:
            problems.append(f"{key} = {text!r}: {error}")
            continue
        if key == "latitude" and latitude_problem(number):
            problems.append(f"--latitude: {latitude_problem(number)}")
        if key in MASS and not number > 0.0:
            problems.append(f"--{key}: found {text!r}; give a positive number, such as {MASS[key]}")
    if problems:
        raise SchemaError("init", problems)


def _check_proving(prove: Sequence[str], records: Sequence[Path], is_given: bool) -> list[str]:
    """Return a remark for each proving record of the last draft that is absent now.

    Raises
    ------
    SchemaError
        A proving record of this call is absent.
    """
    known = [file.stem for file in records]
    hint = "" if known else "no recording was found or given; give them with --records"
    absent = [name for name in prove if name not in known]
    problems = [str(UnknownName(name, known, "record", hint)) for name in absent]
    if problems and is_given:
        raise SchemaError("init --prove", problems)
    return [f"{problem}; the last draft kept it for the proof" for problem in problems]


def _source_paths(folder: Path, answers: DraftAnswers) -> tuple[Sequence[Path], Sequence[Path]]:
    """Return the places of listings and decks, and those of recordings.

    Places that are not stated are the folder and its subfolders, if both or if the last draft was
    made from the folder.
    """
    datcom, records = answers.datcom, answers.records
    is_from_folder = not datcom and not records
    if (folder / DRAFT_FOLDER / ANSWERS).exists():
        before = read_answers(folder)
        is_from_folder = not before.datcom and not before.records
    if not is_from_folder or not folder.is_dir():
        return datcom, records
    places = source_folders(folder)
    return datcom or places, records or places


def _name_outside(own_map: str | Path | None) -> str:
    """Return the full path of a name map or the name of a shipped one; empty without a map."""
    if own_map is None:
        return ""
    file = Path(own_map)
    # A shipped map has no file.
    return str(file.resolve()) if file.exists() else str(own_map)


def _find_own_map(folder: Path, outside: str, force: bool) -> tuple[str | None, AuthorMap | None]:
    """Return a map outside of the project, or the lines of the author in that of the project."""
    if outside and Path(outside).resolve() != (folder / _NAMES).resolve():
        return outside, None
    if force:
        return None, None
    return None, read_author_map(folder / _NAMES, folder / DRAFT_FOLDER / _NAMES)


def _own_manoeuvres(folder: Path) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres of the records whose rows the author has edited."""
    file, drafted = folder / _TABLE, folder / DRAFT_FOLDER / _TABLE
    if not file.exists():
        return {}
    # The reader names the problems of a faulty table.
    tables = read_manoeuvres(file)
    edited = edited_records(read_draft(drafted), file.read_text(encoding="utf-8-sig"))
    return {name: table for name, table in tables.items() if name in edited}


def _write_project(
    files: ProjectFiles,
    geometry: Geometry,
    sources: Sources,
    flights: RecordedFlights,
    answers: DraftAnswers,
    remarks: list[str],
) -> None:
    """Write name map, table of manoeuvres, cases and project file."""
    folder = files.folder
    if flights.has_drafted_map:
        files.write(_NAMES, names_text(flights.names, sources.records))
    if flights.has_table:
        files.write(_TABLE, _manoeuvre_text(files, flights))
    unable = unable_to_identify(flights.records)
    remarks += describe_unable(unable)
    power = recorded_power(folder / "aircraft.toml", flights.records)
    if flights.records:
        remarks += describe_power(power)
    without_use = {*unable, *power.undriven}
    able = {name: table for name, table in flights.marks.items() if name not in without_use}
    with_engine = [name for name, record in flights.records.items() if has_engine_speed(record)]
    held = held_for_proof(able, answers.prove, with_engine)
    proving = write_cases(
        held,
        {file.stem: file for file in sources.records},
        files,
        names=map_file(folder, flights.names),
        aircraft=folder / "aircraft.toml",
        drives=power.drives,
        remarks=remarks,
    )
    _remove_old_cases(files, proving)
    case_files = sorted((folder / "cases").glob("*.toml"))
    taken = replayed_windows(case_files)
    # a remark of its own states why a manoeuvre of a test has no case
    explained = {name: list(windows) for name, windows in taken.items()}
    for case in held:
        if case not in proving:
            explained.setdefault(case.record, []).append(case.window)
    remarks += describe_unused(able, explained)
    for name in answers.prove:
        if name in able and name not in explained:
            remarks.append(
                f"{name} of --prove has no case: no manoeuvre of a test was found in it; write one "
                f"with 'aeromatch pom init' and its --test into the folder cases"
            )
    fits = fits_of(
        {name: table for name, table in able.items() if name not in power.no_thrust},
        taken,
        channel_names(flights.records.values()),
        answers.prove,
    )
    if not fits and not power.no_thrust:
        remarks.append(
            "no manoeuvre that identifies was found, so the match proves the a-priori model: add "
            "[[fit]] with windows to aeromatch.toml"
        )
    if not case_files and not power.undriven:
        remarks.append(
            "no case was drafted: write one with 'aeromatch pom init RECORD --test ...' "
            "into the folder cases"
        )
    text = project_text(
        folder,
        geometry,
        sources,
        names=flights.names,
        fits=fits,
        has_cases=bool(case_files),
        name=answers.facts.name,
        has_table=flights.has_table,
        has_thrust=not power.no_thrust,
    )
    files.write(_PROJECT, text)


def _manoeuvre_text(files: ProjectFiles, flights: RecordedFlights) -> str:
    """Return the table of the manoeuvres of all records that do not mark their own."""
    tables: dict[str, pd.DataFrame] = {}
    for record, table in flights.marks.items():
        if record not in flights.marked and len(table):
            tables[record] = table
    place = files.drafted(f"new_{_TABLE}")
    try:
        write_manoeuvres(tables, place)
        return place.read_text(encoding="utf-8")
    finally:
        place.unlink(missing_ok=True)


def _remove_old_cases(files: ProjectFiles, cases: Sequence[CaseDraft]) -> None:
    """Remove the drafted cases that the new draft does not have and nobody has edited."""
    names = {case.file for case in cases}
    for file in sorted((files.folder / "cases").glob("*.toml")):
        if file.name not in names:
            files.remove_unedited(f"cases/{file.name}")


def _read_files(folder: Path) -> bool:
    """Return whether no value of the project waits for its author.

    Raises
    ------
    SchemaError, ParseError
        A file of the author has problems.
    """
    is_filled = True
    for name in ("aircraft.toml", _PROJECT):
        text = (folder / name).read_text(encoding="utf-8")
        # A file with placeholders must be correct TOML too.
        tomllib.loads(text)
        if quote(UNFILLED) in text:
            is_filled = False
    return is_filled


def _summarise_records(sources: Sources, flights: RecordedFlights) -> dict[str, dict[str, Any]]:
    """Return file, number of channels and manoeuvres of every record."""
    files = {file.stem: file for file in sources.records}
    summaries: dict[str, dict[str, Any]] = {}
    for name, record in flights.records.items():
        manoeuvres = []
        for row in flights.marks[name].to_dict("records"):
            manoeuvres.append(f"{row['manoeuvre']} {row['control']}".strip())
        channels = sum(len(node.data_vars) for node in record.children.values())
        summaries[name] = {
            "file": str(files[name]),
            "channels": channels,
            "manoeuvres": manoeuvres,
        }
    return summaries


def _role_rows(geometry: Geometry) -> Iterator[tuple[str, str, str, str, str]]:
    for item in geometry.roles:
        yield (
            item.case.file,
            str(item.case.ordinal),
            item.case.name,
            ", ".join(item.roles) or "-",
            item.reason,
        )
