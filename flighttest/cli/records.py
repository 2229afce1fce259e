"""``aeromatch flight info | convert | manoeuvres | mark | plot``: what a recording holds, as
netCDF, what was flown when, as a figure.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    print_json,
    print_table,
    show_progress,
)
from flighttest.cli.group import names_option

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@click.command()
@click.argument("record_file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--aircraft",
    "aircraft_file",
    type=InputFile(),
    help="Aircraft, TOML: places, noise and latency of its instruments to judge by; its geometry, "
    "mass and inertia are checked too.",
)
@click.option(
    "--database",
    "database_file",
    type=InputFile(),
    help="A-priori database, netCDF, of the aircraft given with --aircraft: the weight is "
    "compared with its lift.",
)
@click.option("-o", "--output", type=NewFile(), help="Write one self-contained HTML page.")
@json_option
@click.pass_context
def check(
    ctx: click.Context,
    record_file: str,
    names: str | None,
    aircraft_file: str | None,
    database_file: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Check signs, units, axes, clocks, sensors, delays and excitation of a record; exit code 1
    when errors are found.
    """
    from aerodb.store.files import open as open_database
    from flightmech.aircraft.aircraft import read_aircraft
    from flighttest.reconstruction.quality.assessment import assess
    from flighttest.reconstruction.quality.page import write_page
    from flighttest.records.record import read

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


_NAMED = 12  # names of one reason on the terminal; --json has all
_OF_HISTORIES = "goes with a record or a path; a fit is drawn with all its samples"


@click.command()
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@json_option
def info(file: str, names: str | None, as_json: bool) -> None:
    """Show what a recording of any format holds, before it is mapped: tables, clocks, columns and
    units.
    """
    found = _contents(file, names)
    if as_json:
        print_json(found)
        return
    click.echo(f"{found['file']}: {found['format']}")
    for key, text in found["facts"].items():
        click.echo(f"  {key}: {text}")
    if "channels" in found:
        rows = [
            (c["channel"], c["content"], c["packets"], c.get("labels", ""))
            for c in found["channels"]
        ]
        print_table(
            ["channel", "content", "packets", "ARINC 429 labels as stored"],
            rows,
            right=["channel", "packets"],
        )
    for part in found["tables"]:
        span = (
            part["clock_fault"]
            or f"{part['samples']} samples, {part['rate']:.6g} Hz, {part['start']:.6g} ... "
            f"{part['stop']:.6g} s"
        )
        click.echo()
        rows = [
            (c["column"], c["unit"], _number(c["min"]), _number(c["max"])) for c in part["columns"]
        ]
        print_table(
            ["column", "unit", "min", "max"], rows, f"{part['table']}: {span}", right=["min", "max"]
        )
        for slow in part["slower"]:
            text = (
                f"{slow['samples']} samples, {slow['rate']:.6g} Hz, in the rows of {part['table']}"
            )
            click.echo(
                f"a slower clock, with blank cells between its samples: "
                f"{', '.join(slow['columns'])}: {text}"
            )
    for text in found["notes"]:
        click.echo(f"! {text}")
    if found["left_out"]:
        click.echo(f"\nleft out: {len(found['left_out'])}")
        for text in _by_reason(found["left_out"]):
            click.echo(f"  {text}")


def _by_reason(left_out: list[dict[str, str]]) -> list[str]:
    """Return a line for each reason, with the names of the tables and columns that are left out."""
    names: dict[str, list[str]] = {}
    for one in left_out:
        names.setdefault(one["reason"], []).append(one["name"])
    return [
        f"{', '.join(places[:_NAMED])}{f' and {len(places) - _NAMED} more' * (len(places) > _NAMED)}: "
        f"{reason}"
        for reason, places in names.items()
    ]


def _contents(file: str, names: str | None) -> dict[str, Any]:
    """Return what a file holds, from the overview that a sealed one carries where it has one."""
    from flighttest.records.stored_overview import stored_overview

    stored = None if names else stored_overview(file, "contents")
    if stored is not None:
        return stored
    from flighttest.records.files import contents

    return contents(file, names)


@click.command()
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@click.option(
    "-o",
    "--output",
    required=True,
    type=NewFile(),
    help="NetCDF file to write; a record with canonical names.",
)
@json_option
def convert(file: str, names: str | None, output: str, as_json: bool) -> None:
    """Write a recording of any format as a netCDF record: one group per clock, canonical names, SI,
    faults flagged.
    """
    from flighttest.records.files import save_record
    from flighttest.records.record import faults, read

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


@click.command()
@click.argument("file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--table",
    "table_file",
    type=InputFile(),
    help="CSV or TOML with the columns record, kind, control, start, end; its rows of this record "
    "are shown.",
)
@click.option(
    "--find",
    is_flag=True,
    help="Search the movements of the controls even when the record carries marks.",
)
@click.option(
    "--modes", "of_modes", is_flag=True, help="The flight modes of the log of an autopilot."
)
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="CSV to write; correct it and name it as manoeuvres in a project file.",
)
@click.option(
    "--figure",
    type=NewFile(),
    help="Draw the manoeuvres over controls and motion: png, svg or pdf.",
)
@json_option
def manoeuvres(
    file: str,
    names: str | None,
    table_file: str | None,
    find: bool,
    of_modes: bool,
    output: str | None,
    figure: str | None,
    as_json: bool,
) -> None:
    """Show the manoeuvres of a record: of a table, as it marks them, as found in the movements of
    its controls, or its flight modes.
    """
    from flighttest.flight_programme.manoeuvre_finding.finding import draw_manoeuvres
    from flighttest.records.manoeuvre_table import write_manoeuvres
    from flighttest.records.record import read

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


@click.command()
@click.argument("table_file", metavar="TABLE", type=NewFile())
@click.argument("record", metavar="RECORD")
@click.option(
    "--row",
    type=click.IntRange(1),
    help="Row of the record in order of time, from 1, that is changed; without it one is added.",
)
@click.option("--kind", help="Kind of the manoeuvre, such as doublet, 3-2-1-1 or sweep.")
@click.option("--control", help="Control that is moved, such as elevator.")
@click.option("--span", nargs=2, type=float, help="Start and end. [s]")
@click.option("--note", help="Remark.")
@click.option("--remove", is_flag=True, help="Take the row out.")
@click.option(
    "--start-from",
    type=InputFile(),
    help="Record, whose own marks are taken first where the table has none of it.",
)
@names_option
@json_option
def mark(
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
    """Add, change or remove one manoeuvre of RECORD in a TABLE (CSV), which is made when it is not
    there.

    A project that names the table as manoeuvres takes its rows in place of the marks that a record
    carries; a record without a row has its own.
    """
    from flighttest.records.manoeuvre_table import edit_manoeuvres
    from flighttest.records.record import manoeuvres, read

    own = manoeuvres(read(start_from, names)) if start_from else None
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
    from flightmech.errors import SchemaError, UnknownName
    from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres
    from flighttest.records import record as records
    from flighttest.records.manoeuvre_table import read_manoeuvres

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
    marks = records.manoeuvres(record)
    if len(marks) and not find:
        return "as the record marks them", marks
    return "found in the movements of the controls; to be confirmed", find_manoeuvres(record)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


@click.command()
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME",
    help="Channel to draw, may be repeated.  [default: a page of them]",
)
@click.option("--window", type=(float, float), help="Start and end of what is drawn [s].")
@click.option(
    "--table",
    "table_file",
    type=InputFile(),
    help="CSV or TOML with manoeuvres, in place of those that FILE carries.",
)
@click.option(
    "--record",
    metavar="NAME",
    help="Record whose rows of --table are drawn.  [default: FILE without its extension]",
)
@click.option(
    "-o", "--output", required=True, type=NewFile(), help="Figure to write: png, svg or pdf."
)
@json_option
def plot(
    file: str,
    names: str | None,
    channels: tuple[str, ...],
    window: tuple[float, float] | None,
    table_file: str | None,
    record: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Draw FILE over time: a record of any format, a path of flight reconstruct, or a fit of
    identify, select or fit.

    Manoeuvres are shaded and named. Without --channel the page shows motion, controls and engines.
    """
    from flightmech.errors import SchemaError
    from flightmech.support.figures import demand_drawable, write_figure

    demand_drawable(output)
    kind = _kind(file)
    if kind.endswith("fit"):
        given = {"--channel": channels, "--window": window, "--table": table_file, "--names": names}
        if wrong := [f"{option} {_OF_HISTORIES}" for option, item in given.items() if item]:
            raise SchemaError("flight plot", wrong)
        figure, marks = _fit(file, kind), None
    else:
        figure, marks = _histories(
            file, kind, names, channels, window, table_file, record or Path(file).stem
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
    import h5py

    if not h5py.is_hdf5(file):
        return "record"
    with h5py.File(file) as content:
        stated = content.attrs.get("content", "")
        stated = stated.decode() if isinstance(stated, bytes) else str(stated)
        return {"aeromatch fit": "fit", "output error": "output-error fit"}.get(
            stated, "path" if "states" in content else "record"
        )


def _fit(file: str, kind: str) -> Figure:
    from flighttest.maximum_likelihood.result import open_output_error
    from flighttest.records.time_histories import signals_figure
    from flighttest.regression.equation_error.fit import open_fit

    if kind == "fit":
        return open_fit(file).plot()
    residuals = open_output_error(file).residuals
    outputs = [str(name) for name in residuals[0].data_vars]
    return signals_figure(
        f"Residuals of {Path(file).name}", [[rest[name] for rest in residuals] for name in outputs]
    )


def _histories(
    file: str,
    kind: str,
    names: str | None,
    channels: tuple[str, ...],
    window: tuple[float, float] | None,
    table_file: str | None,
    name: str,
) -> tuple[Figure, pd.DataFrame]:
    from flighttest.reconstruction.dynamics.saved_paths import open_path
    from flighttest.records.record import flight_modes, manoeuvres, read
    from flighttest.records.time_histories import record_figure, states_figure

    given: Any = _of_table(table_file, name) if table_file else None
    if kind == "path":
        path = open_path(file)
        marks = manoeuvres(path.states) if given is None else given
        return states_figure(path.states, channels, marks, window, path.errors), marks
    record = read(file, names)
    marks = (
        next(filter(len, (manoeuvres(record), flight_modes(record))), manoeuvres(record))
        if given is None
        else given
    )
    return record_figure(record, channels, marks, window), marks


def _of_table(table_file: str, name: str) -> pd.DataFrame:
    """Return the manoeuvres of a record in a table; of a table of one record those of that one."""
    from flightmech.errors import UnknownName
    from flighttest.records.manoeuvre_table import read_manoeuvres

    tables = read_manoeuvres(table_file)
    if name not in tables and len(tables) > 1:
        raise UnknownName(
            name, tables, "record", f"{table_file} has no row for it; name one with --record"
        )
    return tables[name] if name in tables else next(iter(tables.values()))
