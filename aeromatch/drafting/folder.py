"""Draft of a project folder from listings, decks and recordings, with comments and a check."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

import flightmech
from aeromatch.drafting.aircraft import StatedFacts, aircraft_text
from aeromatch.drafting.flown import (
    CaseDraft,
    fits_of,
    held_for_proof,
    written_cases,
)
from aeromatch.drafting.gaps import (
    channel_names,
)
from aeromatch.drafting.geometry import Geometry, geometry_of
from aeromatch.drafting.name_map.name_text import names_text
from aeromatch.drafting.name_map.names import NamesDraft
from aeromatch.drafting.project_text import map_file, project_text
from aeromatch.drafting.recordings import (
    RecordedFlights,
    add_manoeuvres,
    has_engine_speed,
    read_flights,
)
from aeromatch.drafting.sources import Sources, quote, source_folders, sources_of
from aeromatch.project.project import read_project
from flightmech.support.atomic_write import write_text, written_atomically
from flightmech.support.toml_quantities import UNFILLED
from flighttest.records.manoeuvre_table import write_manoeuvres


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
    folder, facts = Path(folder), known or StatedFacts()
    if not datcom and not records and folder.is_dir():
        datcom = records = source_folders(folder)
    sources = sources_of([Path(path) for path in datcom], [Path(path) for path in records])
    with step(f"read {len(sources.listings)} listings and {len(sources.decks)} decks"):
        geometry = geometry_of(sources.listings, sources.decks)
    remarks: list[str] = []
    if sources.records:
        with step(f"read {len(sources.records)} recordings, find names, units and signs"):
            flights = read_flights(
                sources, geometry.flap, known=facts, own_map=own_map, remarks=remarks
            )
    else:
        flights = RecordedFlights(NamesDraft(identity=True))
        remarks.append(
            f"no recording was given: replace the {UNFILLED!r} of flights in aeromatch.toml"
        )
    with step("find manoeuvres"):
        add_manoeuvres(flights, remarks)
    with_engine = [name for name, record in flights.records.items() if has_engine_speed(record)]
    cases = held_for_proof(flights.marks, prove, with_engine)
    targets = _target_files(folder, flights, cases)
    # No file is written before it is certain that all may be written.
    _check_targets(targets, force)
    with step("write and check the project"), _all_or_none(folder, targets):
        text, gaps = aircraft_text(geometry, facts, list(flights.records.values()))
        remarks += gaps
        write_text(folder / "aircraft.toml", text)
        _write_project(
            folder,
            geometry,
            sources,
            flights=flights,
            cases=cases,
            prove=prove,
            name=facts.name,
            remarks=remarks,
        )
        complete = _check_project(folder)
    return Drafted(
        files=tuple(file for file in targets if file.exists()),
        remarks=tuple(remarks),
        roles=tuple(_role_rows(geometry)),
        records=_summarise_records(sources, flights),
        complete=complete,
    )


def _check_targets(targets: Sequence[Path], force: bool) -> None:
    """Raise if a file exists and may not be overwritten."""
    existing = [str(file) for file in targets if file.exists()]
    if existing and not force:
        raise FileExistsError(
            f"{', '.join(existing)}: there already; give another folder, or --force to overwrite"
        )


def _write_project(
    folder: Path,
    geometry: Geometry,
    sources: Sources,
    flights: RecordedFlights,
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


def _target_files(folder: Path, flights: RecordedFlights, cases: Sequence[CaseDraft]) -> list[Path]:
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
    # From the innermost folder outward, so that each is empty when it is removed.
    chain = (folder / "cases", folder, *folder.parents)
    new_folders = [item for item in chain if not item.exists()]
    before = {file: file.read_bytes() for file in targets if file.exists()}
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        # On a defective disk a file may stay that is complete and new. No older file is emptied, and
        # the first error is raised.
        for file in targets:
            with suppress(OSError):
                if file in before:
                    with written_atomically(file) as part:
                        part.write_bytes(before[file])
                else:
                    file.unlink(missing_ok=True)
        for new_folder in new_folders:
            with suppress(OSError):
                new_folder.rmdir()
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
        # A file with placeholders must be correct TOML too.
        tomllib.loads(text)
        has_no_fit = file == "aeromatch.toml" and "[[fit]]" not in text
        if quote(UNFILLED) in text or has_no_fit:
            complete = False
        else:
            read(folder / file)
    return complete


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
