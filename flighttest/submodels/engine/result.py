"""Result of the identification of an engine: deck file and ``[[engine]]`` entry.

Tables and constants carry sources and standard errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import CONSTANTS, EngineDeck, write_tables
from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flightmech.support.atomic_write import written_atomically
from flighttest.maximum_likelihood.result import OutputError
from flighttest.remarks import Remark, remarks_to_json, warn_forbidden
from flighttest.submodels.engine.bench import fly_deck
from flighttest.submodels.engine.records import power_changes as cut_power_changes
from flighttest.submodels.engine.spools import SpoolFit, identify_spools
from flighttest.submodels.engine.starting import StartFit, identify_start
from flighttest.submodels.engine.static_thrust import DeckCorrection, Polar, correct_deck
from flighttest.submodels.engine.steady_tables import SteadyTable, steady_table
from flighttest.submodels.engine.tables import EngineStructure

# Margin of the least speed to light below the speed at light-off. The engine burns down to half.
_LOWER = 0.9


@dataclass(frozen=True)
class EngineFit(ShortText):
    """Identified parts of an engine; None if there were no records of a part.

    Attributes
    ----------
    prior : dict of str to Dataset
        Tables of the a-priori deck.
    spools : SpoolFit or None
        Governor and spools.
    static : DeckCorrection or None
        Correction of the static thrust.
    start : StartFit or None
        Start and shut-down.
    steady : dict of str to SteadyTable
        Tables from whole flights.
    records : tuple of str
        Names of the records that were used.
    """

    prior: Mapping[str, xr.Dataset]
    spools: SpoolFit | None = None
    static: DeckCorrection | None = None
    start: StartFit | None = None
    steady: Mapping[str, SteadyTable] = field(default_factory=dict)
    records: tuple[str, ...] = ()

    @property
    def remarks(self) -> list[Remark]:
        """Errors: parts whose search did not converge."""
        remarks: list[Remark] = []
        for search in self._searches():
            remarks += [remark for remark in search.remarks if remark.kind == "convergence"]
        if self.static:
            remarks += self.static.convergence_remarks()
        for name, table in self.steady.items():
            remarks += table.remarks(name)
        return remarks

    def _searches(self) -> Iterator[OutputError]:
        """Yield the searches by output error."""
        searches: list[OutputError | None] = []
        if self.spools:
            searches += [self.spools.core, self.spools.fan]
        if self.start:
            searches += [self.start.speeds, self.start.flows]
        yield from filter(None, searches)

    def deck(self, pla: tuple[float, float] = (0.0, 1.0)) -> EngineDeck:
        """Return the deck with identified tables and constants in place of the a-priori ones.

        Parameters
        ----------
        pla : (idle, full)
            Lever angles at throttle 0 and 1. [rad]

        Raises
        ------
        SchemaError
            Tables are missing: no a-priori deck and no records of them.

        Warns
        -----
        AeromatchWarning
            The search of a part did not converge.
        """
        warn_forbidden(self.remarks, "engine deck")
        tables = dict(self.prior)
        if self.static:
            tables["corrected_thrust"] = self.static.leaf
        if self.spools:
            tables = self._replace_spools(tables, self.spools.leaves())
        for name, table in self.steady.items():
            # A table replaces both its corrected and its uncorrected form.
            plain = name.removeprefix("corrected_")
            tables.pop(plain, None)
            tables.pop(f"corrected_{plain}", None)
            tables[name] = table.leaf
        if self.start:
            tables = self.start.joined(tables)
        constants: dict[str, Any] = {name: value for name, (value, _) in self._constants().items()}
        if self.start:
            constants |= {
                "light_speed": _LOWER * self.start.light_speed,
                "sustain_speed": 0.5 * _LOWER * self.start.light_speed,
            }
        return EngineDeck(tables, pla_idle=pla[0], pla_full=pla[1], **constants)

    def _replace_spools(
        self, tables: Mapping[str, xr.Dataset], identified: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """Return the tables with those of each identified spool in place of the a-priori ones."""
        prefixes: tuple[str, ...] = ()
        for spool in ("n1", "n2"):
            if f"{spool}_command" in identified:
                prefixes += (f"{spool}_", f"corrected_{spool}_command")
        others = {name: leaf for name, leaf in tables.items() if not name.startswith(prefixes)}
        return {**others, **identified}

    def _constants(self) -> dict[str, tuple[float, float]]:
        """Return the identified constants of the deck with their standard errors."""
        constants: dict[str, tuple[float, float]] = {}
        for part in (self.spools, self.start):
            if part:
                constants |= part.constants
        return {name: pair for name, pair in constants.items() if name in CONSTANTS}

    def write(
        self,
        path: str | Path,
        pla: tuple[float, float] = (0.0, 1.0),
        title: str = "engine deck from flight",
    ) -> str:
        """Write the tables to a netCDF file and return its ``[engine.deck]`` entry.

        The entry belongs into the aircraft file.

        Parameters
        ----------
        path : str or Path
            File to write, atomically.
        pla : (idle, full)
            As for `deck`.
        title : str
            Title of the file.
        """
        path, deck = Path(path), self.deck(pla)
        with written_atomically(path) as part:
            history = "identified from flight by flighttest.identify_engine"
            write_tables(
                deck.tables, part, title=title, history=history, references=" ".join(self.records)
            )
        lines = [
            "[engine.deck]",
            f'file = "{path.name}"',
            f"pla_idle = {pla[0]:.6g}",
            f"pla_full = {pla[1]:.6g}",
        ]
        lines += [
            f"{name} = {value:.6g}  # flight, standard error {stderr:.2g}"
            for name, (value, stderr) in self._constants().items()
        ]
        if self.start:
            lines.append(
                f"light_speed = {deck.light_speed:.6g}  # flight: lit at "
                f"{self.start.light_speed:.4g}, an upper limit"
            )
            lines.append(
                f"sustain_speed = {deck.sustain_speed:.6g}  # judgement: half of light_speed"
            )
        return "\n".join(lines) + "\n"

    def as_dict(self) -> dict:
        """Return the numbers of all parts: constants and tables with standard errors."""
        constants, tables = {}, {}
        for part in (self.spools, self.start):
            if not part:
                continue
            for name, pair in part.constants.items():
                constants[name] = list(pair)
            for name, curve in part.tables.items():
                axis = str(curve.leaf["value"].dims[0])
                tables[name] = {
                    axis: curve.leaf[axis].values,
                    "value": curve.leaf["value"].values,
                    "stderr": curve.leaf["stderr"].values,
                }
        numbers: dict[str, Any] = {"constants": constants, "tables": tables}
        if self.static:
            numbers["correction"] = {
                "speed": self.static.speeds,
                "factor": self.static.factor,
                "stderr": self.static.stderr,
                "remarks": self.static.remarks,
                "convergence": self.static.convergence.as_dict(),
            }
        numbers["steady"] = {
            name: {
                "rms": table.rms,
                "samples": table.samples,
                "lengths": table.lengths,
                "convergence": table.convergence.as_dict(),
            }
            for name, table in self.steady.items()
        }
        numbers["remarks"] = remarks_to_json(self.remarks)
        return numbers

    def compare(
        self, flights: Sequence[xr.Dataset], pla: tuple[float, float] = (0.0, 1.0)
    ) -> xr.Dataset:
        """Return the difference of the deck from records when their lever drives it.

        The records may be those of the identification, or others.

        Parameters
        ----------
        flights : sequence of Dataset (time,)
            As for `fly_deck`, with the compared channels: ``n1``, ``n2``, ``fuel_flow``, ``itt``,
            ``thrust``.
        pla : (idle, full)
            As for `deck`.

        Returns
        -------
        Dataset (record,)
            Root mean squares of deck less record, and ``samples``.
        """
        deck = self.deck(pla)
        rows = []
        for record in flights:
            response = fly_deck(deck, record)
            row: dict[str, float] = {}
            for name in map(str, response.data_vars):
                if name in record:
                    difference = response[name].values - record[name].values
                    row[name] = float(np.sqrt(np.nanmean(difference**2)))
            rows.append(row | {"samples": record.sizes["time"]})
        names = [str(record.attrs.get("record", k + 1)) for k, record in enumerate(flights)]
        # A record that lacks a channel has NaN in its column.
        columns = {}
        for name in dict.fromkeys(chain.from_iterable(rows)):
            columns[name] = "record", [row.get(name, np.nan) for row in rows]
        return xr.Dataset(columns, {"record": names})

    def report(self) -> str:
        """Return all parts as text."""
        parts = []
        if self.spools:
            parts.append(("Governor and spools", self.spools.report()))
        if self.static:
            parts.append(("Static thrust", self.static.report()))
        if self.steady:
            steady = [table.report(name) for name, table in self.steady.items()]
            parts.append(("Steady tables", "\n".join(steady)))
        if self.start:
            parts.append(("Start and shut-down", self.start.report()))
        return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)


def comparison_text(comparison: xr.Dataset) -> str:
    """Return a result of `EngineFit.compare` as lines, with all records together last."""
    names = [str(name) for name in comparison.data_vars if name != "samples"]
    records = [str(name) for name in comparison["record"].values]
    width = max(len("all records"), *(len(name) for name in records))
    lines = [f"{'deck less record, rms':<{width}}" + "".join(f"{name:>12}" for name in names)]
    for k, record in enumerate(records):
        cells = "".join(f"{float(comparison[name][k]):>12.4g}" for name in names)
        lines.append(f"{record:<{width}}{cells}")
    # Mean squares of the records have the weight of their samples.
    weight = comparison["samples"]
    cells = ""
    for name in names:
        together = float(np.sqrt((comparison[name] ** 2).weighted(weight).mean()))
        cells += f"{together:>12.4g}"
    return "\n".join([*lines, f"{'all records':<{width}}{cells}"])


def identify_engine(
    power_changes: Sequence[xr.Dataset] = (),
    starts: Sequence[xr.Dataset] = (),
    recorded: xr.Dataset | None = None,
    equilibrium: xr.Dataset | None = None,
    prior: Mapping[str, xr.Dataset] | None = None,
    polar: Polar | None = None,
    S: float = 0.0,
    engines: int = 1,
    *,
    flights: Sequence[xr.Dataset] = (),
    structure: EngineStructure | None = None,
) -> EngineFit:
    """Identify an engine from power changes, starts, settled points, and whole flights.

    Parameters
    ----------
    power_changes : sequence of Dataset (time,)
        Chops, slams and steps of the lever, as for `identify_spools`.
    starts : sequence of Dataset (time,)
        As for `identify_start`.
    recorded, equilibrium : Dataset (point,), optional
        Points with recorded thrust, and partial climbs and level accelerations, as for
        `correct_deck`.
    prior : mapping of str to Dataset, optional
        Tables of the a-priori deck; ``corrected_thrust`` is required if there are points.
    polar, S, engines
        As for `correct_deck`.
    flights : sequence of Dataset (time,)
        Whole flights, as `engine_channels` returns them. Power changes are cut out of them
        (`power_changes`), and tables are estimated.
    structure : EngineStructure, optional
        What the tables depend on. The priors of its ``tables`` are those of the a-priori deck.

    Returns
    -------
    EngineFit

    Raises
    ------
    IdentificationError
        No records at all, points without an a-priori thrust, tables without flights, or an error of
        one of the parts.
    """
    deck = dict(prior or {})
    structure = structure or EngineStructure()
    points = recorded is not None or equilibrium is not None
    if not (power_changes or starts or points or flights):
        raise IdentificationError(
            "no records; give power changes, starts, settled points, or flights"
        )
    _demand_sources(deck, points=points, tables=structure.tables, has_flights=bool(flights))
    changes = [*power_changes]
    for flight in flights:
        changes += cut_power_changes(flight)
    spools = static = start = None
    if changes:
        spools = identify_spools(
            changes,
            structure.throttle,
            structure.n2,
            over=structure.over,
            limits=structure.limits,
            fan=structure.fan,
        )
    if points:
        static = correct_deck(
            deck["corrected_thrust"],
            recorded,
            equilibrium=equilibrium,
            polar=polar,
            S=S,
            engines=engines,
        )
    if starts:
        start = identify_start(starts)
    names = []
    for record in (*power_changes, *flights, *starts):
        if "record" in record.attrs:
            names.append(str(record.attrs["record"]))
    return EngineFit(
        deck,
        spools=spools,
        static=static,
        start=start,
        steady=dict(_steady_tables(flights, structure, deck)),
        records=tuple(names),
    )


def _demand_sources(
    deck: Mapping[str, xr.Dataset],
    points: bool,
    tables: Mapping[str, Any],
    has_flights: bool,
) -> None:
    """Raise an error for points without an a-priori thrust, or tables without flights."""
    if points and "corrected_thrust" not in deck:
        raise IdentificationError(
            f"points correct the table corrected_thrust of an a-priori deck; it has "
            f"{' '.join(deck) or 'no tables'}"
        )
    if tables and not has_flights:
        raise IdentificationError(
            f"tables of {' '.join(tables)} come from whole flights; give flights"
        )


def _steady_tables(
    flights: Sequence[xr.Dataset], structure: EngineStructure, deck: Mapping[str, xr.Dataset]
) -> Iterator[tuple[str, SteadyTable]]:
    """Yield the tables of whole flights by name."""
    for name, axes in structure.tables.items():
        # An a-priori table over other axes is not a prior.
        prior = deck.get(name)
        if prior is not None and not set(map(str, prior["value"].dims)) <= set(axes):
            prior = None
        scale = structure.thrust_scale if name.endswith("thrust") else 0.0
        yield name, steady_table(flights, name, axes=axes, prior=prior, scale=scale)
