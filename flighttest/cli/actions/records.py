"""Functions that perform the commands of `flighttest.cli.records`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import h5py
import pandas as pd
import xarray as xr

from aerodb.store.files import open as open_database
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.console import (
    print_json,
    print_table,
    show_progress,
)
from flightmech.support.figures import demand_drawable, write_figure
from flightmech.support.hdf5_seal import decoding_errors
from flighttest.cli.actions.contents import _NAMED, _number
from flighttest.flight_programme.manoeuvre_finding.finding import draw_manoeuvres, find_manoeuvres
from flighttest.maximum_likelihood.result import open_output_error
from flighttest.reconstruction.dynamics.saved_paths import open_path
from flighttest.reconstruction.quality.assessment import assess
from flighttest.reconstruction.quality.page import write_page
from flighttest.records import record as records
from flighttest.records.files import save_record
from flighttest.records.manoeuvre_table import edit_manoeuvres, read_manoeuvres, write_manoeuvres
from flighttest.records.record import faults, flight_modes, marked_manoeuvres, read
from flighttest.records.time_histories import record_figure, signals_figure, states_figure
from flighttest.regression.equation_error.fit_file import open_fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_record(
    ctx: click.Context,
    record_file: str,
    names: str | None,
    aircraft_file: str | None,
    database_file: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``check``."""
    with show_progress("read and check the record"):
        aircraft = read_aircraft(aircraft_file) if aircraft_file else None
        quality = assess(
            read(record_file, names),
            aircraft,
            open_database(database_file) if database_file else None,
        )
    if output:
        write_page(quality, output)
    if as_json:
        print_json(quality.as_dict())
    else:
        click.echo(quality.report())
        if output:
            click.echo(f"\nwritten: {output}")
    ctx.exit(0 if quality.usable else 1)


_OF_HISTORIES = "goes with a record or a path; a fit is drawn with all its samples"


def convert_record(file: str, names: str | None, output: str, as_json: bool) -> None:
    """Perform the command ``convert``."""
    record = read(file, names)
    save_record(record, output)
    about = {
        "file": output,
        "leaves": {leaf: len(node.data_vars) for leaf, node in record.children.items()},
        "faults": faults(record),
        "absent": record.attrs["absent"].split(),
        "left_out": json.loads(record.attrs.get("left_out", "[]")),
    }
    if as_json:
        print_json(about)
        return
    channels = sum(len(node.data_vars) for node in record.children.values())
    for text in faults(record):
        click.echo(f"! {text}")
    if record.attrs["absent"]:
        click.echo(f"not in the file: {record.attrs['absent']}")
    if about["left_out"]:
        click.echo(
            f"left out, see 'aeromatch flight info': "
            f"{', '.join(place for place, _ in about['left_out'][:_NAMED])}"
        )
    click.echo(f"written: {output}, {channels} channels in {len(record.children)} leaves")


def run_manoeuvres(
    file: str,
    names: str | None,
    table_file: str | None,
    find: bool,
    of_modes: bool,
    output: str | None,
    figure: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``manoeuvres``."""
    with show_progress("read the record, find manoeuvres"):
        record, name = read(file, names), Path(file).stem
        source, found = _manoeuvres(record, name, table_file, find, of_modes)
    if output:
        write_manoeuvres({name: found}, output)
    if figure:
        with show_progress("draw the figure"):
            draw_manoeuvres(record, found, figure)
    if as_json:
        print_json({"record": name, "source": source, "manoeuvres": found})
        return
    rows = [
        (
            number,
            m["manoeuvre"],
            m["control"],
            f"{m['start']:g}",
            f"{m['end']:g}",
            _number(m.get("confidence")),
            m["note"],
        )
        for number, m in enumerate(found.to_dict("records"), start=1)
    ]
    columns = ["", "manoeuvre", "control", "start [s]", "end [s]", "confidence", "note"]
    print_table(
        columns,
        rows,
        f"{name}: {len(rows)} manoeuvres, {source}",
        right=["", "start [s]", "end [s]", "confidence"],
    )
    for target in filter(None, (output, figure)):
        click.echo(f"written: {target}")


def run_mark(
    table_file: str,
    record: str,
    row: int | None,
    remove: bool,
    start_from: str | None,
    names: str | None,
    as_json: bool,
    span: tuple[float, float] | None,
    **given: str | None,
) -> None:
    """Perform the command ``mark``."""
    own = marked_manoeuvres(read(start_from, names)) if start_from else None
    change: dict[str, Any] = {name: item for name, item in given.items() if item is not None}
    if span is not None:
        change |= {"start": span[0], "end": span[1]}
    rows = edit_manoeuvres(table_file, record, row, None if remove else change, own)
    if as_json:
        print_json({"table": table_file, "record": record, "manoeuvres": rows})
        return
    print_table(
        ["", "manoeuvre", "control", "start [s]", "end [s]", "note"],
        _numbered(rows),
        f"{record}: {len(rows)} manoeuvres in {table_file}",
    )


def _numbered(rows: pd.DataFrame) -> list[tuple[Any, ...]]:
    return [
        (number, m["manoeuvre"], m["control"], f"{m['start']:g}", f"{m['end']:g}", m["note"])
        for number, m in enumerate(rows.to_dict("records"), start=1)
    ]


def _manoeuvres(
    record: xr.DataTree, name: str, table_file: str | None, find: bool, of_modes: bool
) -> tuple[str, pd.DataFrame]:
    """Return where the manoeuvres of a record come from, and the manoeuvres."""

    if bool(table_file) + find + of_modes > 1:
        raise SchemaError(
            "flight manoeuvres",
            ["--table, --find and --modes exclude each other; give one of them"],
        )
    if of_modes:
        if not len(flown := records.flight_modes(record)):
            raise SchemaError(
                "flight manoeuvres",
                ["the record has no flight modes; logs of PX4 and ArduPilot have them"],
            )
        return "flight modes of the log", flown
    if table_file:
        given = read_manoeuvres(table_file)
        if name not in given:
            raise UnknownName(name, given, "record", f"{table_file} has no row for it")
        return f"from {table_file}", given[name]
    marks = records.marked_manoeuvres(record)
    if len(marks) and not find:
        return "as the record marks them", marks
    return "found in the movements of the controls; to be confirmed", find_manoeuvres(record)


def plot_record(
    file: str,
    names: str | None,
    channels: tuple[str, ...],
    window: tuple[float, float] | None,
    table_file: str | None,
    record: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``plot``."""
    demand_drawable(output)
    kind = _kind(file)
    if kind.endswith("fit"):
        given = {"--channel": channels, "--window": window, "--table": table_file, "--names": names}
        if wrong := [f"{option} {_OF_HISTORIES}" for option, item in given.items() if item]:
            raise SchemaError("flight plot", wrong)
        figure, marks = _fit(file, kind), None
    else:
        figure, marks = _histories(
            file,
            kind,
            names,
            channels=channels,
            window=window,
            table_file=table_file,
            name=record or Path(file).stem,
        )
    write_figure(figure, output)
    if as_json:
        print_json({"file": output, "of": kind, "manoeuvres": [] if marks is None else marks})
    else:
        click.echo(
            f"written: {output}, {kind}{'' if marks is None else f', {len(marks)} manoeuvres'}"
        )


def _kind(file: str) -> str:
    """Return what a file holds: record, path, fit, or output-error fit."""

    if not h5py.is_hdf5(file):
        return "record"
    expected = "a record, a path or a fit"
    with decoding_errors(file, expected), h5py.File(file, "r") as content:
        stated = content.attrs.get("content", "")
        stated = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)
        return {"aeromatch fit": "fit", "output error": "output-error fit"}.get(
            stated, "path" if "states" in content else "record"
        )


def _fit(file: str, kind: str) -> Figure:

    if kind == "fit":
        return open_fit(file).plot()
    residuals = open_output_error(file).residuals
    outputs = [str(name) for name in residuals[0].data_vars]
    panels = []
    for name in outputs:
        panels.append([residual[name] for residual in residuals])
    return signals_figure(f"Residuals of {Path(file).name}", panels)


def _histories(
    file: str,
    kind: str,
    names: str | None,
    channels: tuple[str, ...],
    window: tuple[float, float] | None,
    table_file: str | None,
    name: str,
) -> tuple[Figure, pd.DataFrame]:

    given: Any = _of_table(table_file, name) if table_file else None
    if kind == "path":
        path = open_path(file)
        marks = marked_manoeuvres(path.states) if given is None else given
        return states_figure(path.states, channels, marks, window, path.errors), marks
    record = read(file, names)
    marks = (
        next(
            filter(len, (marked_manoeuvres(record), flight_modes(record))),
            marked_manoeuvres(record),
        )
        if given is None
        else given
    )
    return record_figure(record, channels, marks, window), marks


def _of_table(table_file: str, name: str) -> pd.DataFrame:
    """Return the manoeuvres of a record in a table; of a table of one record those of that one."""

    tables = read_manoeuvres(table_file)
    if name not in tables and len(tables) > 1:
        raise UnknownName(
            name, tables, "record", f"{table_file} has no row for it; name one with --record"
        )
    return tables[name] if name in tables else next(iter(tables.values()))
