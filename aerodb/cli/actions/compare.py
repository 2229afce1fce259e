"""Functions that perform the commands of `aerodb.cli.compare`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from aerodb.comparison.comparison import compare as compared
from aerodb.comparison.comparison import has_hidden_difference
from aerodb.comparison.record_conditions import read_conditions
from aerodb.figures.lr743_set.flown import FLOWN, read_flown
from aerodb.store.files import open as open_database
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import option_quantity
from flightmech.support.console import print_json, print_remark, print_table, show_progress


def run_compare(
    first: str,
    second: str,
    along: str | None,
    wanted: tuple[str, ...],
    figures: str | None,
    kind: str,
    as_json: bool,
) -> None:
    """Perform the command ``compare``."""
    databases = {label: open_database(path) for label, path in _labels(first, second).items()}
    a, b = databases.values()
    conditions, notes = None, list[str]()
    if along is not None:
        conditions, notes = read_conditions(along, a, b)
    with show_progress("compare the databases"):
        frame = compared(a, b, conditions)
    coefficients = list(dict.fromkeys(name.split("/")[0] for name in frame.index))
    for name in wanted:
        if name not in coefficients:
            raise UnknownName(name, coefficients, "coefficient")
    if wanted:
        grid = {name: text for name, text in frame.attrs["grid"].items() if name in wanted}
        frame = frame[[name.split("/")[0] in wanted for name in frame.index]]
        frame.attrs["grid"] = grid
    written: list[str] = []
    if figures is not None:
        # needs the optional package matplotlib
        from aerodb.figures.figure_folder import write_comparison

        with show_progress("draw the figures of shared terms and coefficients"):
            written = [
                str(path)
                for path in write_comparison(
                    databases, figures, kind, coefficients=wanted, support=conditions
                )
            ]
    for text in notes:
        print_remark(text)
    if as_json:
        print_json(
            {
                "a": first,
                "b": second,
                "along": along,
                "grid": frame.attrs["grid"],
                "rows": frame,
                "figures": written,
            }
        )
        return
    click.echo(f"a = {first}, b = {second}; differences are b - a")
    _print(frame)
    if written:
        click.echo(f"\nwritten: {len(written)} figures in {figures}")


def run_plot_term(
    file: str,
    term: str,
    family: str | None,
    over: str | None,
    held: tuple[str, ...],
    along: str | None,
    output: str,
) -> None:
    """Perform the command ``plot``."""
    # needs the optional package matplotlib
    from aerodb.figures.drawing import save_figure
    from aerodb.figures.figures import plot_comparison

    tree = open_database(file)
    support = None if along is None else read_conditions(along, tree)[0]
    (label,) = _labels(file)
    with show_progress("draw the figure"):
        figure = plot_comparison(
            {label: tree},
            term,
            family,
            over=over,
            at=dict(_read_fixed(text) for text in held),
            support=support,
        )
        save_figure(figure, output)
    click.echo(f"written: {output}")


def _labels(*paths: str) -> dict[str, str]:
    """Return short names of files, with as much of their folders as distinguishes them."""
    parts = {path: Path(path).resolve().with_suffix("").parts for path in paths}
    for count in range(1, max(map(len, parts.values()))):
        labels = {"/".join(parts[path][-count:]): path for path in paths}
        if len(labels) == len(paths):
            return labels
    return dict(zip("ab", paths))


def _read_fixed(text: str) -> tuple[str, float]:
    """Return name and value of ``NAME=VALUE``. [SI]"""
    name, sign, value = (part.strip() for part in text.partition("="))
    if not (name and sign and value):
        raise SchemaError("--at", [f"found {text!r}; give NAME=VALUE, such as delta_f='40 deg'"])
    return name, option_quantity(f"--at {name}", value, lookup(name).units)


def _print(frame: pd.DataFrame) -> None:
    """Print coefficients, terms that differ, and a line each on equal and one-sided terms."""
    along = "share" in frame
    is_term = frame.index.str.contains("/")
    same = is_term & (frame["max_difference"] == 0.0) & (frame["found_in"] == "both")
    same &= ~frame["note"].map(has_hidden_difference)
    for part, head in ((frame[~is_term], "coefficient"), (frame[is_term & ~same], "term")):
        columns = [head, "in", "largest", "a", "b", "rms", "/ s.e. a", "/ s.e. b", "/ s.e. b-a"]
        shares = ["share", "rms left"] if along and head == "term" else []
        rows = [_cells(name, row, bool(shares)) for name, row in part.iterrows()]
        click.echo()
        print_table([*columns, *shares, "where", "note"], rows, right=[*columns[2:], *shares])
    for label, names in (
        ("only in a", frame.index[is_term & (frame["found_in"] == "a")]),
        ("only in b", frame.index[is_term & (frame["found_in"] == "b")]),
        ("no difference", frame.index[same]),
    ):
        if len(names):
            click.echo(f"\n{label}: {' '.join(names)}")
    grid = frame.attrs["grid"]
    if along:
        # All coefficients along a flight have the same conditions: one line states them.
        for text in dict.fromkeys(grid.values()):
            click.echo(f"\ncompared over {text}")
    else:
        for name, text in grid.items():
            click.echo(f"\ngrid of {name}: {text}")


def _cells(name: Any, row: pd.Series, shares: bool) -> list[str]:
    numbers = ("max_difference", "value_a", "value_b", "rms_difference")
    ratios = ("max_in_stderr", "max_in_stderr_b", "max_in_stderr_difference")
    cells = [
        name,
        row["found_in"],
        *(_number(row[key], 4) for key in numbers),
        *(_number(row[key], 3) for key in ratios),
    ]
    if shares:
        share = ""
        if not math.isnan(row["share"]):
            # adding 0.0 removes the sign of a rounded zero
            share = f"{round(100 * row['share'], 1) + 0.0:.1f} %"
        cells += [share, _number(row["rms_left"], 4)]
    return [*cells, row["location"], row["note"]]


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}g}"


_OWN = ("datcom", "final")  # databases of the folder that `aeromatch match` writes


def run_figures(
    places: tuple[Path, ...],
    set_of_it: bool,
    aircraft: Path | None,
    flown_file: Path | None,
    buffet: Path | None,
    kind: str,
    output: Path,
    as_json: bool,
) -> None:
    """Perform the command ``figures``."""
    if not set_of_it:
        raise click.UsageError("no set of figures; give --lr743")
    # needs the optional package matplotlib
    from aerodb.figures.lr743_set.report_set import write_lr743

    files, crafts, flown_file = _inputs(places, aircraft, flown_file)
    databases = {name: open_database(file) for name, file in files.items()}
    sources = list(files.values())
    flown, boundary = None, None
    if flown_file:
        sources.append(flown_file)
        flown = read_flown(flown_file)
    if buffet is not None:
        boundary = _read_boundary(buffet)
    with show_progress("draw the figures"):
        figures = write_lr743(
            databases,
            output,
            kind,
            aircraft={name: read_aircraft(file) for name, file in crafts.items()},
            flown=flown,
            buffet=boundary,
            sources=", ".join(map(str, sources)),
        )
    if as_json:
        rows = [{**item._asdict(), "file": item.file and str(item.file)} for item in figures]
        print_json({"folder": str(output), "figures": rows})
        return
    cells = [(item.number, item.title, item.file.name if item.file else "-") for item in figures]
    print_table(["", "shows", "file"], cells)
    for item in figures:
        if item.missing:
            click.echo(f"{item.number or item.title} cannot be drawn: {item.missing}")
    count = sum(item.file is not None for item in figures)
    click.echo(f"written: {count} of {len(figures)} in {output}")


def _inputs(
    places: tuple[Path, ...], aircraft: Path | None, flown: Path | None
) -> tuple[dict[str, Path], dict[str, Path], Path | None]:
    """Return databases and aircraft by name, and the file of what was flown."""
    if len(places) == 1 and places[0].is_dir():
        folder = places[0]
        files = {name: folder / f"{name}.nc" for name in _OWN}
        lacking = [file.name for file in files.values() if not file.is_file()]
        if lacking:
            raise click.UsageError(
                f"{folder} holds no {' and no '.join(lacking)}; name a folder that "
                f"`aeromatch match` wrote, or databases"
            )
        crafts = {name: aircraft or folder / f"{name}.toml" for name in _OWN}
        if flown is None and (folder / FLOWN).is_file():
            flown = folder / FLOWN
        return files, crafts, flown
    if len(places) > 2 or any(place.is_dir() for place in places):
        raise click.UsageError(
            "give one folder that `aeromatch match` wrote, one database, or the a-priori and "
            "the final database"
        )
    names = [place.stem for place in places]
    if len(set(names)) < len(names):
        names = [str(place.with_suffix("")) for place in places]
    files = dict(zip(names, places))
    return files, dict.fromkeys(files, aircraft) if aircraft else {}, flown


def _read_boundary(path: Path) -> pd.DataFrame:
    """Return Mach number and lift coefficient of the buffet boundary."""
    try:
        table = pd.read_csv(path, comment="#")
        table = table.rename(columns=lambda name: str(name).strip())[["mach", "CL"]].astype(float)
    except (KeyError, ValueError) as error:
        raise ParseError(
            str(path),
            1,
            str(error),
            "a table with the columns mach and CL, numbers separated by commas",
        ) from None
    if not np.isfinite(table).all(axis=None) or len(table) < 2:
        raise ParseError(
            str(path),
            1,
            "missing or infinite numbers, or fewer than two points",
            "two or more rows with a number for mach and for CL",
        )
    return table.sort_values("mach", ignore_index=True)
