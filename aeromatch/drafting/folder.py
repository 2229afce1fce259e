"""Draft of a project folder from listings, decks and recordings, with comments and a check."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import flightmech
import flighttest
from aeromatch.drafting.aircraft import StatedFacts, aircraft_text
from aeromatch.drafting.flown import (
    CaseDraft,
    fits_of,
    held_for_proof,
    without_unknown,
    written_cases,
)
from aeromatch.drafting.gaps import (
    channel_names,
    listed_columns,
    missing_channels,
    unknown_columns,
)
from aeromatch.drafting.geometry import Geometry, geometry_of
from aeromatch.drafting.name_map.name_repair import check_draft
from aeromatch.drafting.name_map.name_text import names_text
from aeromatch.drafting.name_map.names import NamesDraft, draft_names, own_names
from aeromatch.drafting.project_text import map_file, project_text
from aeromatch.drafting.sources import Sources, quote, source_folders, sources_of
from aeromatch.project.project import read_project
from flightmech.air import atmosphere
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.toml_quantities import UNFILLED
from flightmech.units import parse_quantity
from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres, named_by_response
from flighttest.records.manoeuvre_table import write_manoeuvres

_FACTS = {"temperature": "K", "latitude": "rad", "runway_elevation": "m"}


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
        Whether `aeromatch match` accepts the project as it is.
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


@dataclass
class _Flights:
    """Recordings as read with their name map, and their manoeuvres.

    Attributes
    ----------
    names : NamesDraft
    records : dict of str to DataTree
        By file name without extension.
    marks : dict of str to DataFrame
        Manoeuvres by record. [s]
    marked : set of str
        Records that mark their manoeuvres themselves.
    """

    names: NamesDraft
    records: dict[str, xr.DataTree] = field(default_factory=dict)
    marks: dict[str, pd.DataFrame] = field(default_factory=dict)
    marked: set[str] = field(default_factory=set)

    @property
    def has_table(self) -> bool:
        """Whether the manoeuvres of some record require a table."""
        return len(self.marked) < len(self.marks)

    @property
    def has_drafted_map(self) -> bool:
        """Whether the project requires a name map that is not the author's."""
        return not self.names.identity and self.names.own is None


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
        stay.
    datcom, records : sequence of Path
        Listings, decks and recordings, or folders of them. The default is `folder` and its
        subfolders.
    known : StatedFacts, optional
        Further facts.
    prove : sequence of str
        Records, by file name without extension, that prove the model and identify nothing. The
        default is the last of several manoeuvres of a test.
    force : bool
        Overwrite older files.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    own_map : str or Path, optional
        Name map of the recordings, a TOML file or a shipped map, which is used unchanged. Without
        it a name map is drafted.

    Returns
    -------
    Drafted

    Raises
    ------
    FileExistsError
        Files of these names exist and `force` is false; with all names.
    SchemaError
        No source was found, or the recordings cannot be mapped.
    """
    folder, known = Path(folder), known or StatedFacts()
    if not datcom and not records and folder.is_dir():
        datcom = records = source_folders(folder)
    sources = sources_of([Path(path) for path in datcom], [Path(path) for path in records])
    with step(f"read {len(sources.listings)} listings and {len(sources.decks)} decks"):
        geometry = geometry_of(sources.listings, sources.decks)
    remarks: list[str] = []
    if sources.records:
        with step(f"read {len(sources.records)} recordings, find names, units and signs"):
            flights = _read_flights(
                sources, geometry.flap, known=known, own_map=own_map, remarks=remarks
            )
    else:
        flights = _Flights(NamesDraft(identity=True))
        remarks.append(
            f"no recording was given: replace the {UNFILLED!r} of flights in aeromatch.toml"
        )
    with step("find manoeuvres"):
        _find_manoeuvres(flights, remarks)
    with_engine = [name for name, record in flights.records.items() if _has_engine_speed(record)]
    cases = held_for_proof(flights.marks, prove, with_engine)
    targets = _target_files(folder, flights, cases)
    existing = [str(file) for file in targets if file.exists()]
    if existing and not force:
        raise FileExistsError(
            f"{', '.join(existing)}: there already; give another folder, or --force to overwrite"
        )
    with step("write and check the project"), _all_or_none(folder, targets):
        text, gaps = aircraft_text(geometry, known, list(flights.records.values()))
        remarks += gaps
        write_text(folder / "aircraft.toml", text)
        _write_project(
            folder,
            geometry,
            sources,
            flights=flights,
            cases=cases,
            prove=prove,
            name=known.name,
            remarks=remarks,
        )
        complete = _check_project(folder)
    files = {file.stem: file for file in sources.records}
    summaries: dict[str, dict[str, Any]] = {}
    for name, record in flights.records.items():
        summaries[name] = _summarise_record(files[name], record, flights.marks[name])
    return Drafted(
        files=tuple(file for file in targets if file.exists()),
        remarks=tuple(remarks),
        roles=tuple(_role_rows(geometry)),
        records=summaries,
        complete=complete,
    )


def _read_flights(
    sources: Sources,
    flap: float | None,
    known: StatedFacts,
    own_map: str | Path | None,
    remarks: list[str],
) -> _Flights:
    """Return the recordings with the author's or a drafted name map."""
    if own_map is not None:
        draft = own_names(own_map)
    else:
        draft = draft_names(sources.records, flap)
    names, records, findings = check_draft(_add_facts(draft, known), sources.records)
    names, records = _add_temperature(names, records, sources.records, remarks)
    remarks += [*names.remarks, *missing_channels(records), *findings]
    if names.own is None:
        remarks += unknown_columns(names.left_out, has_map=False)
    else:
        unmapped: dict[str, None] = {}
        for record in records.values():
            unmapped |= dict.fromkeys(listed_columns(record))
        remarks += unknown_columns(list(unmapped), has_map=True)
    return _Flights(names, records)


def _write_project(
    folder: Path,
    geometry: Geometry,
    sources: Sources,
    flights: _Flights,
    cases: Sequence[CaseDraft],
    prove: Sequence[str],
    name: str,
    remarks: list[str],
) -> None:
    """Write name map, table of manoeuvres, cases and project file."""
    if flights.has_drafted_map:
        write_text(folder / "names.toml", names_text(flights.names, sources.records))
    if flights.has_table:
        tables: dict[str, pd.DataFrame] = {}
        for record, table in flights.marks.items():
            if record not in flights.marked and len(table):
                tables[record] = table
        write_manoeuvres(tables, folder / "manoeuvres.csv")
    windows = written_cases(
        cases,
        {file.stem: file for file in sources.records},
        folder / "cases",
        names=map_file(folder, flights.names),
        aircraft=folder / "aircraft.toml",
        remarks=remarks,
    )
    # A case without a window could not be written.
    proving = [case for case in cases if case.file in windows]
    replayed: dict[str, list[tuple[float, float]]] = {}
    for case in proving:
        replayed.setdefault(case.record, []).append(windows[case.file])
    channels = channel_names(flights.records.values())
    fits = fits_of(flights.marks, replayed, channels, set(prove))
    if not fits:
        remarks.append(
            "no manoeuvre that identifies was found: add [[fit]] with windows to aeromatch.toml"
        )
    if not proving:
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
        cases=proving,
        name=name,
        has_table=flights.has_table,
    )
    write_text(folder / "aeromatch.toml", text)


def _has_engine_speed(record: xr.DataTree) -> bool:
    return any(name.endswith((".n1", ".n2")) for name in channel_names([record]))


def _add_facts(names: NamesDraft, known: StatedFacts) -> NamesDraft:
    """Return a map with the facts that the author states."""
    facts: dict[str, float] = {}
    for key, unit in _FACTS.items():
        if known.values.get(key):
            facts[key] = parse_quantity(_number_or_text(known.values[key]), unit)
    if names.own is not None and facts:
        problems = []
        for key in facts:
            problems.append(
                f"{key} stands in [record] of the name map {names.file}; write it there"
            )
        raise SchemaError("init", problems)
    return replace(names, facts={**names.facts, **facts})


def _number_or_text(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _add_temperature(
    names: NamesDraft,
    records: dict[str, xr.DataTree],
    files: Sequence[Path],
    remarks: list[str],
) -> tuple[NamesDraft, dict[str, xr.DataTree]]:
    """Return map and records with the temperature of the standard atmosphere.

    They are unchanged if a temperature is recorded or stated, and if no height is recorded.
    """
    channels = channel_names(records.values())
    if names.identity or "temperature" in channels or "temperature" in names.facts:
        return names, records
    height = _median_height(records.values())
    if height is None:
        return names, records
    kelvin = round(float(atmosphere(height).temperature), 1)
    if names.own is not None:
        remarks.append(
            f'no temperature is recorded: add temperature = "{kelvin:g} K" to [record] of '
            f"{names.file}, as in the standard atmosphere"
        )
        return names, records
    remarks.append(
        f"no temperature is recorded: that of the standard atmosphere at {height:.0f} m, "
        f"{kelvin:g} K, stands in names.toml; "
        "confirm it, 3 K change the air density by 1 %"
    )
    names = replace(names, facts={**names.facts, "temperature": kelvin})
    return names, {file.stem: flighttest.read(file, names.mapping()) for file in files}


def _median_height(records: Iterable[xr.DataTree]) -> float | None:
    """Return the median of the recorded heights, or None without a height. [m]"""
    heights: list[float] = []
    for record in records:
        for node in record.children.values():
            for name in ("h_baro", "h_gps"):
                if name in node.data_vars:
                    heights.append(float(node[name].median()))
    if not heights:
        return None
    return sorted(heights)[len(heights) // 2]


def _find_manoeuvres(flights: _Flights, remarks: list[str]) -> None:
    """Add the manoeuvres of every record, as marked or as found in the movements."""
    for name, record in flights.records.items():
        table = flighttest.manoeuvres(record)
        if len(table):
            flights.marked.add(name)
            table = named_by_response(record, table)
        else:
            try:
                table = without_unknown(find_manoeuvres(record))
            except SchemaError as error:
                remarks.append(f"{name}: no manoeuvre was looked for: {'; '.join(error.problems)}")
        flights.marks[name] = table


def _target_files(folder: Path, flights: _Flights, cases: Sequence[CaseDraft]) -> list[Path]:
    """Return the files that the draft will write."""
    files = ["aircraft.toml"]
    if flights.has_drafted_map:
        files.append("names.toml")
    if flights.has_table:
        files.append("manoeuvres.csv")
    files.append("aeromatch.toml")
    targets = [folder / file for file in files]
    return targets + [folder / "cases" / case.file for case in cases]


@contextmanager
def _all_or_none(folder: Path, targets: Sequence[Path]) -> Iterator[None]:
    """Make the folder, and restore its files and remove new folders after an error."""
    new = [place for place in (folder / "cases", folder, *folder.parents) if not place.exists()]
    before = {file: file.read_bytes() for file in targets if file.exists()}
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for file in targets:
            if file in before:
                file.write_bytes(before[file])
            else:
                file.unlink(missing_ok=True)
        for place in new:
            place.rmdir()
        raise


def _check_project(folder: Path) -> bool:
    """Read all files as `aeromatch match` does, and return whether the project is complete.

    A file with a placeholder is not read. An error of another file is raised.
    """
    complete = True
    readers: Mapping[str, Callable[[Path], Any]] = {
        "aircraft.toml": flightmech.read_aircraft,
        "aeromatch.toml": read_project,
    }
    for file, read in readers.items():
        text = (folder / file).read_text(encoding="utf-8")
        tomllib.loads(text)
        has_no_fit = file == "aeromatch.toml" and "[[fit]]" not in text
        if quote(UNFILLED) in text or has_no_fit:
            complete = False
        else:
            read(folder / file)
    return complete


def _summarise_record(file: Path, record: xr.DataTree, table: pd.DataFrame) -> dict[str, Any]:
    manoeuvres = []
    for row in table.to_dict("records"):
        manoeuvres.append(f"{row['manoeuvre']} {row['control']}".strip())
    channels = sum(len(node.data_vars) for node in record.children.values())
    return {"file": str(file), "channels": channels, "manoeuvres": manoeuvres}


def _role_rows(geometry: Geometry) -> Iterator[tuple[str, str, str, str, str]]:
    for item in geometry.roles:
        yield (
            item.case.file,
            str(item.case.ordinal),
            item.case.name,
            ", ".join(item.roles) or "-",
            item.reason,
        )
