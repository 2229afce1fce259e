"""The figures and tables of LR-743 as a folder, from databases and what was flown."""

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
    """One figure or table of the set: its number in LR-743, title, file (None where it cannot be
    made) and why not.
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
    """Yield number, title and maker of every figure; a maker raises `NotDrawn` with what is
    missing.

    Figs. 1 and 2 set the databases over each other, Figs. 3 and 4 show the first (a priori), Figs.
    13 to 15 the last (final).
    """
    names = list(databases)
    first, last = names[0], names[-1]
    prior, final = {first: databases[first]}, {last: databases[last]}
    crafts = aircraft or {}
    yield (
        "Fig. 1",
        "lift coefficient at zero angle of attack",
        partial(lift_intercept_chart, databases, flown),
    )
    yield "Fig. 2", "lift slope", partial(lift_slope_chart, databases, flown)
    yield (
        "Fig. 3",
        "lift by the flaps, a priori",
        partial(flap_increment, prior, flown, "figure-03", "Fig. 3"),
    )
    yield (
        "Fig. 4",
        "lift by the elevator, a priori",
        partial(elevator_chart, prior, None, "figure-04", "Fig. 4"),
    )
    yield (
        "Fig. 9",
        "flight envelope and test points",
        partial(flight_envelope_chart, databases, crafts, flown, buffet),
    )
    yield "Fig. 10", "sweeps of angle of attack", partial(elevator_sweep_chart, databases, flown)
    yield "Fig. 11", "lift over drag", partial(polars_clean, databases, crafts, flown)
    yield "Fig. 12", "lift by Mach number", partial(lift_by_mach, databases, flown)
    yield (
        "Fig. 13",
        "lift by the flaps",
        partial(flap_increment, final, flown, "figure-13", "Fig. 13"),
    )
    yield (
        "Fig. 14",
        "lift by the elevator",
        partial(elevator_chart, final, flown, "figure-14", "Fig. 14"),
    )
    yield "Fig. 15", "lift by pitch rate", partial(pitch_rate, final, flown)
    yield "Fig. 16", "lift near the ground", partial(near_the_ground, final, flown)
    yield "Fig. 17", "rolling moment near the ground", partial(bank_near_the_ground, final, flown)
    yield "", "drag polars", partial(drag_polars, final, crafts, flown)


def write_lr743(
    databases: Mapping[str, xr.DataTree],
    folder: str | os.PathLike,
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
        One, or the a-priori one first and the final one last.
    folder : path
        A new or empty folder; it appears once all is in it.
    format : {"svg", "png", "pdf"}
    aircraft : mapping of str to Aircraft, optional
        By the name of the database; for trimmed polars and the stall.
    flown : Flown, optional
        From `read_flown`: test points, sweeps, local estimates, tables 1 and 2.
    buffet : DataFrame, optional
        ``mach CL`` of the buffet boundary of the clean aeroplane.
    sources : str
        Names of the files that the data come from, for the foot of every figure.

    Returns
    -------
    list of Written
        Every figure and table in the order of the report; ``missing`` is why one is not there.

    Raises
    ------
    SchemaError
        The folder holds something, no database, or another format.
    FileNotFoundError
        The folder above it is not there.

    References
    ----------
    .. [LR743] Report LR-743, 1993, Figs. 1 to 4 and 9 to 17, tables 1 and 2.
    """
    if not databases:
        raise SchemaError(
            "figures", ["no database came; give one, or the a-priori and the final one"]
        )
    if format not in FORMATS:
        raise SchemaError("figures", [f"the format is {format!r}; allowed: {', '.join(FORMATS)}"])
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SchemaError(
            str(folder),
            ["is there and not empty; name a new folder for the figures, or remove the old one"],
        )
    name = str(list(databases.values())[-1].attrs["aircraft"])
    notes = (*([f"Data: {sources}."] if sources else []), *reference_notes(databases))
    made = []
    with folder_written_atomically(folder) as part:
        for number, title, make in lr743_charts(databases, aircraft, flown, buffet):
            try:
                chart = make()
            except NotDrawn as lacking:
                made.append(WrittenSet(number, title, None, str(lacking)))
                continue
            file = f"{chart.stem}.{format}"
            save_figure(draw_chart(chart, name, notes), part / file)
            made.append(WrittenSet(number, chart.title, folder / file, ""))
        made += [
            *_table(
                part,
                folder,
                "Table 1",
                "table-1.csv",
                "technique by submodel",
                None if flown is None else flown.submodels,
            )
        ]
        made += [
            *_table(
                part,
                folder,
                "Table 2",
                "table-2.csv",
                "parameters of the ground effect",
                None if flown is None else flown.ground,
            )
        ]
    return made


def _table(
    part: Path, folder: Path, number: str, file: str, title: str, table: pd.DataFrame | None
) -> Iterator[WrittenSet]:
    if table is None:
        yield WrittenSet(number, title, None, _NO_FLIGHTS)
    elif table.empty:
        yield WrittenSet(number, title, None, "the project has no section [ground_effect]")
    else:
        table.to_csv(part / file, index=False, float_format="%.6g", lineterminator="\n")
        yield WrittenSet(number, title, folder / file, "")
