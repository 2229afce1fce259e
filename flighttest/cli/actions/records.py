"""Functions that perform the commands of `flighttest.cli.records`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import h5py
import pandas as pd
import xarray as xr

from aerodb.store.files import open as open_database
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import time_text
from flightmech.support.console import (
    collect_options,
    print_json,
    print_table,
    print_text,
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
        database = open_database(database_file) if database_file else None
        quality = assess(read(record_file, names), aircraft, database)
    if output:
        write_page(quality, output)
    if as_json:
        print_json(quality.as_dict())
    else:
        click.echo(quality.report())
        if output:
            click.echo(f"\nwritten: {output}")
    ctx.exit(0 if quality.usable else 1)


def convert_record(file: str, names: str | None, output: str, as_json: bool) -> None:
    """Perform the command ``convert``."""
    record = read(file, names)
    save_record(record, output)
    leaves = {leaf: len(node.data_vars) for leaf, node in record.children.items()}
    record_faults = faults(record)
    absent = record.attrs["absent"]
    left_out = json.loads(record.attrs.get("left_out", "[]"))
    if as_json:
        print_json(
            {
                "file": output,
                "leaves": leaves,
                "faults": record_faults,
                "absent": absent.split(),
                "left_out": left_out,
            }
        )
        return
    for text in record_faults:
        print_text(f"! {text}")
    if absent:
        click.echo(f"not in the file: {absent}")
    if left_out:
        places = [place for place, _ in left_out[:_NAMED]]
        print_text(f"left out, see 'aeromatch flight info': {', '.join(places)}")
    click.echo(f"written: {output}, {sum(leaves.values())} channels in {len(leaves)} leaves")


# Manoeuvres of a record --------------------------------------------------------------------------


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
        source, manoeuvres = _choose_manoeuvres(record, name, table_file, find, of_modes)
    if output:
        write_manoeuvres({name: manoeuvres}, output)
    if figure:
        with show_progress("draw the figure"):
            draw_manoeuvres(record, manoeuvres, figure)
    if as_json:
        print_json({"record": name, "source": source, "manoeuvres": manoeuvres})
        return
    rows = []
    for number, row in enumerate(manoeuvres.to_dict("records"), start=1):
        confidence = _number(row.get("confidence"))
        rows.append((*_manoeuvre_cells(number, row), confidence, row["note"]))
    print_table(
        ["", "manoeuvre", "control", "start [s]", "end [s]", "confidence", "note"],
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
    # The marks of the record are the first rows of a new table.
    first_rows = marked_manoeuvres(read(start_from, names)) if start_from else None
    change: dict[str, Any] = {name: item for name, item in given.items() if item is not None}
    if span is not None:
        change |= {"start": span[0], "end": span[1]}
    rows = edit_manoeuvres(table_file, record, row, None if remove else change, first_rows)
    if as_json:
        print_json({"table": table_file, "record": record, "manoeuvres": rows})
        return
    cells = []
    for number, item in enumerate(rows.to_dict("records"), start=1):
        cells.append((*_manoeuvre_cells(number, item), item["note"]))
    print_table(
        ["", "manoeuvre", "control", "start [s]", "end [s]", "note"],
        cells,
        f"{record}: {len(rows)} manoeuvres in {table_file}",
    )


def _manoeuvre_cells(number: int, row: Mapping[Any, Any]) -> tuple[Any, ...]:
    """Return the cells that all tables of manoeuvres have."""
    return (
        number,
        row["manoeuvre"],
        row["control"],
        time_text(row["start"]),
        time_text(row["end"]),
    )


def _choose_manoeuvres(
    record: xr.DataTree, name: str, table_file: str | None, find: bool, of_modes: bool
) -> tuple[str, pd.DataFrame]:
    """Return the origin of the manoeuvres of a record, and the manoeuvres."""
    if bool(table_file) + find + of_modes > 1:
        raise SchemaError(
            "flight manoeuvres",
            ["--table, --find and --modes exclude each other; give one of them"],
        )
    if of_modes:
        modes = flight_modes(record)
        if modes.empty:
            raise SchemaError(
                "flight manoeuvres",
                ["the record has no flight modes; logs of PX4 and ArduPilot have them"],
            )
        return "flight modes of the log", modes
    if table_file:
        tables = read_manoeuvres(table_file)
        if name not in tables:
            raise UnknownName(name, tables, "record", f"{table_file} has no row for it")
        return f"from {table_file}", tables[name]
    marks = marked_manoeuvres(record)
    if len(marks) and not find:
        return "as the record marks them", marks
    return "found in the movements of the controls; to be confirmed", find_manoeuvres(record)


# Figures of a file -------------------------------------------------------------------------------


@dataclass(frozen=True)
class HistoryOptions:
    """Options of a figure of time histories.

    Attributes
    ----------
    names : str or None
        Name map of the record.
    channels : tuple of str
        Channels to draw; if empty, the default of the figure.
    window : (float, float) or None
        Start and end [s].
    table_file : str or None
        Table of manoeuvres to mark; None for those of the record.
    record : str or None
        Record of the table; None for the name of the file.
    """

    names: str | None
    channels: tuple[str, ...]
    window: tuple[float, float] | None
    table_file: str | None
    record: str | None

    def demand_none(self) -> None:
        """Raise SchemaError for options that a figure of a fit does not have."""
        values = {
            "--channel": self.channels,
            "--window": self.window,
            "--table": self.table_file,
            "--names": self.names,
        }
        problems = []
        for option, value in values.items():
            if value:
                problems.append(
                    f"{option} goes with a record or a path; a fit is drawn with all its samples"
                )
        if problems:
            raise SchemaError("flight plot", problems)


@collect_options(options=HistoryOptions)
def plot_record(file: str, options: HistoryOptions, output: str, as_json: bool) -> None:
    """Perform the command ``plot``."""
    demand_drawable(output)
    kind = _kind_of_file(file)
    marks = None
    if kind.endswith("fit"):
        options.demand_none()
        figure = _fit_figure(file, kind)
    else:
        figure, marks = _history_figure(file, kind, options)
    write_figure(figure, output)
    if as_json:
        print_json({"file": output, "of": kind, "manoeuvres": [] if marks is None else marks})
        return
    count = "" if marks is None else f", {len(marks)} manoeuvres"
    click.echo(f"written: {output}, {kind}{count}")


def _kind_of_file(file: str) -> str:
    """Return what a file holds: record, path, fit, or output-error fit."""
    if not h5py.is_hdf5(file):
        return "record"
    expected = "a record, a path or a fit"
    with decoding_errors(file, expected), h5py.File(file, "r") as content:
        stated = content.attrs.get("content", "")
        # h5py returns a text of fixed length as bytes.
        if isinstance(stated, bytes):
            stated = stated.decode("utf-8", "replace")
        has_states = "states" in content
    if str(stated) == "aeromatch fit":
        return "fit"
    if str(stated) == "output error":
        return "output-error fit"
    return "path" if has_states else "record"


def _fit_figure(file: str, kind: str) -> Figure:
    """Return the figure of a fit: of an output-error fit the residuals, a panel per output."""
    if kind == "fit":
        return open_fit(file).plot()
    residuals = open_output_error(file).residuals
    panels = []
    for name in map(str, residuals[0].data_vars):
        panels.append([residual[name] for residual in residuals])
    return signals_figure(f"Residuals of {Path(file).name}", panels)


def _history_figure(file: str, kind: str, options: HistoryOptions) -> tuple[Figure, pd.DataFrame]:
    """Return the figure of a record or path, and the manoeuvres that are marked in it."""
    marks: pd.DataFrame | None = None
    if options.table_file:
        marks = _read_marks(options.table_file, options.record or Path(file).stem)
    channels, window = options.channels, options.window
    if kind == "path":
        path = open_path(file)
        if marks is None:
            marks = marked_manoeuvres(path.states)
        return states_figure(path.states, channels, marks, window, path.errors), marks
    record = read(file, options.names)
    if marks is None:
        marks = marked_manoeuvres(record)
        # Logs of autopilots have flight modes in place of manoeuvres.
        if marks.empty and len(modes := flight_modes(record)):
            marks = modes
    return record_figure(record, channels, marks, window), marks


def _read_marks(table_file: str, name: str) -> pd.DataFrame:
    """Return the manoeuvres of a record in a table; the only record of a table needs no name."""
    tables = read_manoeuvres(table_file)
    if name in tables:
        return tables[name]
    if len(tables) > 1:
        raise UnknownName(
            name, tables, "record", f"{table_file} has no row for it; name one with --record"
        )
    return next(iter(tables.values()))
