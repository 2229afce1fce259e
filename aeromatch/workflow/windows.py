"""Records, files and time windows that a project requires for its fits, submodels and cases."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flighttest
from aeromatch.project.project import Project
from aeromatch.project.sections import RecordSelection
from flightmech.aircraft.aircraft_file import aircraft_files
from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import time_text
from flighttest.records.repeated_windows import repeated_windows
from flighttest.records.shared_samples import SharedSamples

Spans = dict[str, list[tuple[float, float]]]
"""Start and end of the selected parts of each record. [s]"""
SharedByRecord = dict[str, dict[str, SharedSamples]]
"""Samples of the record of a case in other records, by both names."""


AERODYNAMIC = ("ground_effect", "stall")
"""Sections that are identified from coefficients, as the fits are."""
EVERY_MANOEUVRE = "*"
"""In place of names of manoeuvres: all manoeuvres of a record."""
SHORTEST = 1.0
"""Shortest part of a window that a cut leaves; a shorter one holds no response. [s]"""


@dataclass(frozen=True)
class IdentificationWindows:
    """Start and end of the manoeuvres that identify something, by record. [s]

    Attributes
    ----------
    fits : list of dict
        One for every fit of the project.
    submodels : dict of str to dict
        By the position in the project file.
    """

    fits: list[Spans]
    submodels: dict[str, Spans]

    def aerodynamic_spans(self) -> list[Spans]:
        """Return the windows of all fits, then those of ground effect and stall."""
        sections = [self.submodels.get(f"{name}.flown", {}) for name in AERODYNAMIC]
        return [*self.fits, *sections]

    def aerodynamic_records(self) -> list[str]:
        """Return the records of a fit, the ground effect or the stall, each once, in order."""
        names: dict[str, None] = {}
        for spans in self.aerodynamic_spans():
            names |= dict.fromkeys(spans)
        return list(names)

    def fitted_records(self) -> list[str]:
        """Return the records of the fits, each once, in order."""
        names: dict[str, None] = {}
        for spans in self.fits:
            names |= dict.fromkeys(spans)
        return list(names)


def records_of(project: Project, cases: Sequence[Any] = ()) -> list[str]:
    """Return the records of the fits, the submodels and the given cases, in this order.

    Raises
    ------
    SchemaError
        With all problems: cases whose record is not among the flights of the project, and cases
        with the same name.
    """
    case_names = [case.name for case in cases]
    case_records = {case.name: Path(case.record).stem for case in cases}
    problems: list[str] = []
    for name, record in case_records.items():
        if record not in project.flights:
            problems.append(f"case {name}: {UnknownName(record, project.flights, 'record')}")
    for name in case_records:
        count = case_names.count(name)
        if count > 1:
            problems.append(f"{count} cases are named {name!r}; give each case a different name")
    raise_problems(project, problems)
    records: list[str] = []
    for fit in project.fit:
        records += fit.records
    for selections in project.submodels.values():
        for selection in selections:
            records += selection.records
    records += case_records.values()
    return list(dict.fromkeys(records))


def inputs_of(project: Project, names: Iterable[str], cases: Iterable[Any] = ()) -> list[Path]:
    """Return every file that the results depend on, with the named flight records.

    The files that a case names, such as its tolerance table, come with `cases`, the read cases.
    """
    files = [project.file, *aircraft_files(project.aircraft)]
    if project.apriori:
        files += aircraft_files(project.apriori)
    files += [project.names] if project.names else []
    # Several roles may use cases of one listing.
    files += dict.fromkeys(listing.file for listing in project.listings.places())
    for section in project.prior:
        files += section.all_files
    files += [project.flights[name] for name in names]
    files += [*project.cases, *project.tables.values()]
    files += [file for file in (project.manoeuvres, project.ice) if file]
    for device in project.devices.values():
        files += device.files
    for case in cases:
        files += [Path(name) for name in case.files()]
        if case.aircraft:
            files += aircraft_files(case.aircraft)
    return [*files, *project.points.values(), *project.published]


def marks_of(
    project: Project, records: Mapping[str, xr.DataTree], problems: list[str]
) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres and the flight modes of the records that identify something.

    The project's table of manoeuvres replaces the manoeuvres in a record.

    Parameters
    ----------
    project : Project
    records : mapping of str to DataTree
    problems : list of str
        Gets a line for every record of the table that is not among the flights.

    Returns
    -------
    dict of str to DataFrame
        By record. [s]
    """
    recorded = {
        name: flighttest.records.marked_manoeuvres(records[name]) for name in records_of(project)
    }
    listed: Mapping[str, pd.DataFrame] = {}
    if project.manoeuvres:
        listed = flighttest.records.read_manoeuvres(project.manoeuvres)
    for name in listed:
        if name not in project.flights:
            problems.append(f"manoeuvres: {UnknownName(name, project.flights, 'record')}")
    marks: dict[str, pd.DataFrame] = {}
    for name, manoeuvres in recorded.items():
        tables = [listed.get(name, manoeuvres), flighttest.records.flight_modes(records[name])]
        # An empty table would change the types of the columns, so it is left out if possible.
        filled = [table for table in tables if len(table)]
        marks[name] = pd.concat(filled or tables, ignore_index=True)
    return marks


def select_windows(
    project: Project,
    records: Mapping[str, xr.DataTree],
    cases: Sequence[Any] = (),
    marks: tuple[Mapping[str, pd.DataFrame], Sequence[str]] | None = None,
    copies: SharedByRecord | None = None,
) -> IdentificationWindows:
    """Return the time windows of every fit and submodel of a project, by record.

    Parameters
    ----------
    project : Project
    records : mapping of str to DataTree
    cases : sequence of PomCase
    marks : tuple, optional
        Tables of `marks_of` with the problems it listed, if they are available.
    copies : dict, optional
        Result of `samples_of_copies`, if it is available.

    Raises
    ------
    SchemaError
        With all problems: manoeuvres that a record does not have, faults of the table of
        manoeuvres, and windows that overlap with a case. Data that prove the model must not
        identify it.
    """
    problems: list[str] = []
    if marks is None:
        tables: Mapping[str, pd.DataFrame] = marks_of(project, records, problems)
    else:
        tables, listed_problems = marks
        problems += listed_problems
    fits: list[Spans] = []
    submodels: dict[str, Spans] = {}
    overlaps: list[str] = []
    for fit in project.fit:
        position = f"fit {fit.name!r}"
        fits.append(spans_of(position, [fit], tables, problems))
        overlaps += find_case_overlaps(position, fits[-1], cases)
    for position, selections in project.submodels.items():
        submodels[position] = spans_of(position, selections, tables, problems)
        overlaps += find_case_overlaps(position, submodels[position], cases)
    windows = IdentificationWindows(fits, submodels)
    positions = [f"fit {fit.name!r}" for fit in project.fit]
    named = [*zip(positions, fits, strict=True), *submodels.items()]
    # The same samples may have come under another name.
    if copies is None:
        copies = samples_of_copies(proving_records(cases), records_of(project), records)
    overlaps += find_copied_records(named, copies, cases)
    raise_problems(project, [*problems, *overlaps])
    return windows


def rests_on(
    project: Project, windows: IdentificationWindows, cases: Sequence[Any]
) -> dict[str, str]:
    """Return, in words, the records that each part of the model and each case depends on.

    The report prints them. A record that identifies in one window and proves in another is marked,
    because its instrument constants come from the whole record.
    """
    identifying = records_of(project)
    proving = [Path(case.record).stem for case in cases]
    # Without identification, the records of the cases give the instrument constants.
    sources = {"constants of the instruments": ", ".join(identifying or dict.fromkeys(proving))}
    for fit, spans in zip(project.fit, windows.fits, strict=True):
        sources[f"fit {fit.name}"] = ", ".join(spans)
    for position, spans in windows.submodels.items():
        sources[position] = ", ".join(spans)
    for case, record in zip(cases, proving, strict=True):
        text = record
        if record in identifying:
            text = f"{record}, which identifies too, at other times"
        sources[f"case {case.name}"] = text
    return sources


def spans_of(
    position: str,
    selections: Iterable[RecordSelection],
    tables: Mapping[str, pd.DataFrame],
    problems: list[str],
    faulty: Collection[str] = (),
) -> Spans:
    """Return start and end of manoeuvres and windows by record.

    A selection without manoeuvres and windows selects the whole record.

    Parameters
    ----------
    position : str
        Position in the project file.
    selections : iterable of RecordSelection
    tables : mapping of str to DataFrame
        `flighttest.records.marked_manoeuvres` by record.
    problems : list of str
        Gets a line for every manoeuvre that a record does not have, and for every part of a record
        that is selected twice.
    faulty : collection of str
        Manoeuvres whose rows are faulty, which is another problem; `EVERY_MANOEUVRE` for a table
        that cannot be read.
    """
    spans: Spans = {}
    for selection in selections:
        for record in selection.records:
            parts = _manoeuvre_spans(
                position,
                record,
                manoeuvres=selection.manoeuvres,
                table=tables[record],
                problems=problems,
                faulty=faulty,
            )
            parts += selection.window
            # A selection of neither selects the whole record.
            if not selection.manoeuvres and not selection.window:
                parts = [(-np.inf, np.inf)]
            spans.setdefault(record, []).extend(parts)
    for record, parts in spans.items():
        problems += [f"{position}, record {record}: {text}" for text in repeated_windows(parts)]
    return spans


def _manoeuvre_spans(
    position: str,
    record: str,
    manoeuvres: Iterable[str],
    table: pd.DataFrame,
    problems: list[str],
    faulty: Collection[str],
) -> list[tuple[float, float]]:
    """Return the windows of manoeuvres in one record: ``"3211 elevator"``, or a kind:
    ``"trim"``.
    """
    # A manoeuvre without a control, such as a trim, is named by its kind alone.
    kinds = table["manoeuvre"].tolist()
    labels = []
    for kind, control in zip(kinds, table["control"].fillna("").tolist(), strict=True):
        labels.append(f"{kind} {control}".strip())
    times = list(zip(table["start"].tolist(), table["end"].tolist(), strict=True))
    spans: list[tuple[float, float]] = []
    for name in manoeuvres:
        selected = [i for i, kind in enumerate(kinds) if name in (kind, labels[i])]
        if not selected and name not in faulty and EVERY_MANOEUVRE not in faulty:
            problems.append(
                f"{position}, record {record}: {UnknownName(name, set(labels), 'manoeuvre')}"
            )
        for i in selected:
            start, end = times[i]
            spans.append((float(start), float(end)))
    return spans


def find_case_overlaps(position: str, spans: Spans, cases: Iterable[Any]) -> list[str]:
    """Return a line for every window that overlaps with the replayed time of a case."""
    problems = []
    for case in cases:
        record = Path(case.record).stem
        start, end = case.window
        # Windows that share only an instant do not overlap.
        if any(span[0] < end and start < span[1] for span in spans.get(record, [])):
            problems.append(
                f"{position}: record {record} proves case {case.name} from {time_text(start)} to "
                f"{time_text(end)} s; "
                f"it cannot identify too"
            )
    return problems


def proving_records(cases: Iterable[Any]) -> list[str]:
    """Return the records of the cases, each once, in order."""
    return list(dict.fromkeys(Path(case.record).stem for case in cases))


def samples_of_copies(
    proving: Iterable[str], identifying: Iterable[str], records: Mapping[str, xr.DataTree]
) -> SharedByRecord:
    """Return the samples that records of cases share with other records that identify.

    Parameters
    ----------
    proving, identifying : iterable of str
        Names of records.
    records : mapping of str to DataTree

    Returns
    -------
    dict of str to dict of str to SharedSamples
        By proving and by identifying record. Records without shared samples are absent.
    """
    others = {}
    for name in identifying:
        if name in records:
            others[name] = flighttest.records.inertial_channels(records[name])
    copies: SharedByRecord = {}
    for name in proving:
        copies[name] = {}
        if name not in records:
            continue
        channels = flighttest.records.inertial_channels(records[name])
        for other, other_channels in others.items():
            shared = None
            if other != name:
                shared = flighttest.records.find_shared_samples(channels, other_channels)
            if shared is not None:
                copies[name][other] = shared
    return copies


def find_copied_records(
    named: Sequence[tuple[str, Spans]], copies: SharedByRecord, cases: Iterable[Any]
) -> list[str]:
    """Return a line for every window whose samples are those of a case under another name.

    Parameters
    ----------
    named : sequence of (str, Spans)
        Position in the project file and windows of every fit and submodel.
    copies : dict
        Result of `samples_of_copies`.
    cases : iterable of PomCase
    """
    problems = []
    for case in cases:
        proving = Path(case.record).stem
        for name, samples in copies[proving].items():
            # the replayed part of the shared samples, on the clock of the identifying record
            start = max(case.window[0], samples.start) + samples.shift
            stop = min(case.window[1], samples.stop) + samples.shift
            for position, spans in named:
                if any(span[0] < stop and start < span[1] for span in spans.get(name, [])):
                    problems.append(
                        f"{position}: record {name} holds samples of record {proving} "
                        f"({samples.how}), which proves case {case.name}; it cannot identify too"
                    )
    return problems


def select_spans(data: xr.Dataset, spans: Iterable[tuple[float, float]]) -> list[xr.Dataset]:
    """Return the parts of a record between the start and the end of each window."""
    return [data.sel(time=slice(start, end)) for start, end in spans]


def parts_in_spans(
    data: Mapping[str, xr.Dataset], spans_by_record: Spans
) -> tuple[list[xr.Dataset], list[str]]:
    """Return the parts of all records inside their spans, and the record of each."""
    parts: list[xr.Dataset] = []
    names: list[str] = []
    for record, spans in spans_by_record.items():
        pieces = select_spans(data[record], spans)
        for span, piece in zip(spans, pieces, strict=True):
            # What a cut leaves at an end of a whole record may be empty.
            if np.isinf(span).sum() == 1 and _duration(piece) < SHORTEST:
                continue
            parts.append(piece)
            names.append(record)
    return parts, names


def _duration(data: xr.Dataset) -> float:
    """Return the time from the first to the last sample. [s]"""
    time = data["time"].values
    return float(time[-1] - time[0]) if len(time) else 0.0


def raise_problems(project: Project, problems: Sequence[str]) -> None:
    """Raise `SchemaError` with all problems of a project, if there are any."""
    if problems:
        raise SchemaError(str(project.file), list(problems))
