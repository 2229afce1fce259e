"""Folder of the figures and tables of LR-743, from databases and flight data."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import xarray as xr

from aerodb.figures.drawing import FORMATS, reference_notes, save_figure
from aerodb.figures.lr743_set.build_up import (
    elevator_chart,
    flap_increment,
    lift_by_mach,
    lift_intercept_chart,
    lift_slope_chart,
    pitch_rate,
)
from aerodb.figures.lr743_set.chart import Chart, NotDrawn
from aerodb.figures.lr743_set.envelope import (
    drag_polars,
    elevator_sweep_chart,
    flight_envelope_chart,
    polars_clean,
)
from aerodb.figures.lr743_set.flown import FlightData
from aerodb.figures.lr743_set.ground_effect import bank_near_the_ground, near_the_ground
from aerodb.figures.lr743_set.sheet import draw_chart
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import folder_written_atomically

_NO_FLIGHTS = "it needs what was flown: flown.nc of the folder that `aeromatch match` wrote"


class WrittenSet(NamedTuple):
    """One figure or table of the set.

    Attributes
    ----------
    number : str
        Number in LR-743.
    title : str
        Title.
    file : Path or None
        Its file; None if it cannot be made.
    missing : str
        Reason why it cannot be made; empty if it was made.
    """

    number: str
    title: str
    file: Path | None
    missing: str


def lr743_charts(
    databases: Mapping[str, xr.DataTree],
    aircraft: Mapping[str, Aircraft] | None = None,
    flown: FlightData | None = None,
    buffet: pd.DataFrame | None = None,
) -> Iterator[tuple[str, str, Callable[[], Chart]]]:
    """Yield number, title and maker of every figure.

    A maker raises `NotDrawn` with the missing data.  Figs. 1 and 2 show the databases over each
    other, Figs. 3 and 4 the first (a priori), Figs. 13 to 15 the last (final).
    """
    # A single database is both the a-priori and the final one.
    names = list(databases)
    prior = {names[0]: databases[names[0]]}
    final = {names[-1]: databases[names[-1]]}
    aircraft_by_name = aircraft or {}
    yield (
        "Fig. 1",
        "lift coefficient at zero angle of attack",
        partial(lift_intercept_chart, databases, flown),
    )
    yield "Fig. 2", "lift slope", partial(lift_slope_chart, databases, flown)
    yield (
        "Fig. 3",
        "lift by the flaps, a priori",
        partial(flap_increment, prior, flown, stem="figure-03", figure="Fig. 3"),
    )
    # The estimates of flight belong to the final database only.
    yield (
        "Fig. 4",
        "lift by the elevator, a priori",
        partial(elevator_chart, prior, None, stem="figure-04", figure="Fig. 4"),
    )
    yield (
        "Fig. 9",
        "flight envelope and test points",
        partial(flight_envelope_chart, databases, aircraft_by_name, flown, buffet),
    )
    yield "Fig. 10", "sweeps of angle of attack", partial(elevator_sweep_chart, databases, flown)
    yield "Fig. 11", "lift over drag", partial(polars_clean, databases, aircraft_by_name, flown)
    yield "Fig. 12", "lift by Mach number", partial(lift_by_mach, databases, flown)
    yield (
        "Fig. 13",
        "lift by the flaps",
        partial(flap_increment, final, flown, stem="figure-13", figure="Fig. 13"),
    )
    yield (
        "Fig. 14",
        "lift by the elevator",
        partial(elevator_chart, final, flown, stem="figure-14", figure="Fig. 14"),
    )
    yield "Fig. 15", "lift by pitch rate", partial(pitch_rate, final, flown)
    yield "Fig. 16", "lift near the ground", partial(near_the_ground, final, flown)
    yield "Fig. 17", "rolling moment near the ground", partial(bank_near_the_ground, final, flown)
    yield "", "drag polars", partial(drag_polars, final, aircraft_by_name, flown)


def write_lr743(
    databases: Mapping[str, xr.DataTree],
    folder: str | os.PathLike[str],
    format: str = "svg",
    *,
    aircraft: Mapping[str, Aircraft] | None = None,
    flown: FlightData | None = None,
    buffet: pd.DataFrame | None = None,
    sources: str = "",
) -> list[WrittenSet]:
    """Write the figures and tables of LR-743 that the data allow into a folder.

    Parameters
    ----------
    databases : mapping of str to DataTree
        One database, or the a-priori one first and the final one last.
    folder : path
        A new or empty folder.  It appears after all files are complete.
    format : {"svg", "png", "pdf"}
        File format of the figures.
    aircraft : mapping of str to Aircraft, optional
        Aircraft by the name of the database, for trimmed polars and the stall.
    flown : FlightData, optional
        From `read_flown`: test points, sweeps, local estimates, tables 1 and 2.
    buffet : DataFrame, optional
        ``mach CL`` of the buffet boundary of the clean aeroplane.
    sources : str
        Names of the data files, for the foot of every figure.

    Returns
    -------
    list of WrittenSet
        Every figure and table in the order of the report.  ``missing`` is the reason why one cannot
        be made.

    Raises
    ------
    SchemaError
        The folder is not empty, no database came, or the format is not allowed.
    FileNotFoundError
        The parent folder does not exist.

    References
    ----------
    .. [LR743] Report LR-743, 1993, Figs. 1 to 4 and 9 to 17, tables 1 and 2.
    """
    folder = Path(folder)
    _check_arguments(databases, folder, format)
    name = str(list(databases.values())[-1].attrs["aircraft"])
    notes = reference_notes(databases)
    if sources:
        notes = [f"Data: {sources}.", *notes]
    # A figure that cannot be drawn is reported, and the others are written.
    written = []
    with folder_written_atomically(folder) as part:
        for number, title, make in lr743_charts(databases, aircraft, flown, buffet):
            try:
                chart = make()
            except NotDrawn as reason:
                written.append(WrittenSet(number, title, None, str(reason)))
                continue
            file = f"{chart.stem}.{format}"
            save_figure(draw_chart(chart, name, notes), part / file)
            written.append(WrittenSet(number, chart.title, folder / file, ""))
        for number, title in (
            ("1", "technique by submodel"),
            ("2", "parameters of the ground effect"),
        ):
            file = f"table-{number}.csv"
            missing = _write_table(part / file, number, flown)
            path = None if missing else folder / file
            written.append(WrittenSet(f"Table {number}", title, path, missing))
    return written


def _check_arguments(databases: Mapping[str, xr.DataTree], folder: Path, format: str) -> None:
    if not databases:
        raise SchemaError(
            "figures", ["no database came; give one, or the a-priori and the final one"]
        )
    if format not in FORMATS:
        raise SchemaError("figures", [f"the format is {format!r}; allowed: {', '.join(FORMATS)}"])
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SchemaError(
            str(folder),
            ["is there and not empty; name a new folder for the figures, or remove the old one"],
        )


def _write_table(path: Path, number: str, flown: FlightData | None) -> str:
    """Write table 1 or 2 as CSV; return the reason if it cannot be made, else ``""``."""
    if flown is None:
        return _NO_FLIGHTS
    table = flown.submodels if number == "1" else flown.ground
    # Only the table of the ground effect may be empty.
    if table.empty:
        return "the project has no section [ground_effect]"
    table.to_csv(path, index=False, float_format="%.6g", lineterminator="\n")
    return ""
