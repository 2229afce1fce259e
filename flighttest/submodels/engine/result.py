"""An engine identified from its records: deck file and ``[[engine]]`` entry, with sources and
standard errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.engine_deck import CONSTANTS, EngineDeck, write_tables
from flightmech.errors import IdentificationError
from flightmech.support.atomic_write import written_atomically
from flighttest.submodels.engine.bench import fly_deck
from flighttest.submodels.engine.records import power_changes as cut_power_changes
from flighttest.submodels.engine.spools import Fan, SpoolFit, identify_spools
from flighttest.submodels.engine.starting import StartFit, identify_start
from flighttest.submodels.engine.static_thrust import DeckCorrection, Polar, correct_deck
from flighttest.submodels.engine.steady_tables import SteadyTable, steady_table

_LOWER = (
    0.9  # speed at light-off less a margin, as least speed to light; it burns down to half of that
)


@dataclass(frozen=True)
class EngineFit:
    """What the records of an engine show, part by part; None where there were no records of it.

    Attributes
    ----------
    prior : dict of str to Dataset
        Tables of the a-priori deck.
    spools : SpoolFit or None
    static : DeckCorrection or None
    start : StartFit or None
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

    def deck(self, pla: tuple[float, float] = (0.0, 1.0)) -> EngineDeck:
        """Return the deck: identified tables and constants in the place of the a-priori ones.

        Parameters
        ----------
        pla : (idle, full)
            Lever angles at throttle 0 and 1. [rad]

        Raises
        ------
        SchemaError
            Tables are missing: no a-priori deck and no records of them.
        """
        tables = dict(self.prior)
        if self.static:
            tables["corrected_thrust"] = self.static.leaf
        if self.spools:
            found = self.spools.leaves()
            spools = [n for n in ("n1", "n2") if f"{n}_command" in found]
            old = tuple(text for n in spools for text in (f"{n}_", f"corrected_{n}_command"))
            tables = {
                name: leaf for name, leaf in tables.items() if not name.startswith(old)
            } | found
        for name, table in self.steady.items():
            plain = name.removeprefix("corrected_")
            tables = {
                other: leaf
                for other, leaf in tables.items()
                if other not in (plain, f"corrected_{plain}")
            } | {name: table.leaf}
        if self.start:
            tables = self.start.joined(tables)
        constants: dict[str, Any] = {name: value for name, (value, _) in self._constants().items()}
        if self.start:
            constants |= {
                "light_speed": _LOWER * self.start.light_speed,
                "sustain_speed": 0.5 * _LOWER * self.start.light_speed,
            }
        return EngineDeck(tables, pla_idle=pla[0], pla_full=pla[1], **constants)

    def _constants(self) -> dict[str, tuple[float, float]]:
        found = {
            **(self.spools.constants if self.spools else {}),
            **(self.start.constants if self.start else {}),
        }
        return {name: pair for name, pair in found.items() if name in CONSTANTS}

    def write(
        self,
        path: str | Path,
        pla: tuple[float, float] = (0.0, 1.0),
        title: str = "engine deck from flight",
    ) -> str:
        """Write the tables to a netCDF file and return the ``[engine.deck]`` entry of the aircraft
        file that belongs to it.

        Parameters
        ----------
        path : str or Path
        pla : (idle, full)
            As for `deck`.
        title : str
            Of the file.
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
        parts = [part for part in (self.spools, self.start) if part]
        constants = {name: list(pair) for part in parts for name, pair in part.constants.items()}
        tables = {}
        for name, leaf in (
            (name, curve.leaf) for part in parts for name, curve in part.tables.items()
        ):
            axis = str(leaf["value"].dims[0])
            tables[name] = {
                axis: leaf[axis].values,
                "value": leaf["value"].values,
                "stderr": leaf["stderr"].values,
            }
        found = {"constants": constants, "tables": tables}
        if self.static:
            static = self.static
            found["correction"] = {
                "speed": static.speeds,
                "factor": static.factor,
                "stderr": static.stderr,
                "remarks": static.remarks,
            }
        found["steady"] = {
            name: {"rms": table.rms, "samples": table.samples, "lengths": table.lengths}
            for name, table in self.steady.items()
        }
        return found

    def compare(
        self, flights: Sequence[xr.Dataset], pla: tuple[float, float] = (0.0, 1.0)
    ) -> xr.Dataset:
        """Return how far the deck is from records when their lever drives it, whether they were
        used or not.

        Parameters
        ----------
        flights : sequence of Dataset (time,)
            As for `fly_deck`, with what is compared: ``n1``, ``n2``, ``fuel_flow``, ``itt``,
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
        for one in flights:
            flown = fly_deck(deck, one)
            differences = {
                str(name): flown[name].values - one[name].values
                for name in flown.data_vars
                if name in one
            }
            rows.append(
                {name: float(np.sqrt(np.nanmean(v**2))) for name, v in differences.items()}
                | {"samples": one.sizes["time"]}
            )
        names = [str(one.attrs.get("record", k + 1)) for k, one in enumerate(flights)]
        columns = {
            name: ("record", [row.get(name, np.nan) for row in rows])
            for row in rows
            for name in row
        }
        return xr.Dataset(columns, {"record": names})

    def report(self) -> str:
        """Return all parts as text."""
        steady = "\n".join(table.report(name) for name, table in self.steady.items())
        parts = [
            (title, part.report())
            for title, part in (
                ("Governor and spools", self.spools),
                ("Static thrust", self.static),
            )
            if part
        ]
        parts += [("Steady tables", steady)] if steady else []
        parts += [("Start and shut-down", self.start.report())] if self.start else []
        return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)


def comparison_text(found: xr.Dataset) -> str:
    """Return what `EngineFit.compare` found as lines, all records together last."""
    names = [str(name) for name in found.data_vars if name != "samples"]
    width = max(len("all records"), *(len(str(name)) for name in found["record"].values))
    lines = [f"{'deck less record, rms':<{width}}" + "".join(f"{name:>12}" for name in names)]
    for k, record in enumerate(found["record"].values):
        lines.append(
            f"{record!s:<{width}}" + "".join(f"{float(found[name][k]):>12.4g}" for name in names)
        )
    weight = found["samples"]
    together = [float(np.sqrt((found[name] ** 2).weighted(weight).mean())) for name in names]
    return "\n".join(
        [*lines, f"{'all records':<{width}}" + "".join(f"{value:>12.4g}" for value in together)]
    )


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
    throttle: Sequence[float] | None = None,
    n2: Sequence[float] | None = None,
    over: Mapping[str, Sequence[float]] | None = None,
    limits: bool = False,
    fan: Fan = "n2",
    tables: Mapping[str, Mapping[str, Sequence[float]]] | None = None,
    thrust_scale: float = 0.0,
) -> EngineFit:
    """Identify an engine from power changes, starts, settled points, and whole flights.

    Parameters
    ----------
    power_changes : sequence of Dataset (time,)
        Chops, slams, steps, as for `identify_spools`.
    starts : sequence of Dataset (time,)
        As for `identify_start`.
    recorded, equilibrium : Dataset (point,), optional
        Points with recorded thrust; partial climbs and level accelerations; as for `correct_deck`.
    prior : mapping of str to Dataset, optional
        Tables of the a-priori deck; ``corrected_thrust`` where there are points.
    polar, S, engines
        As for `correct_deck`.
    flights : sequence of Dataset (time,)
        Whole flights, as `engine_channels` returns them: power changes are cut out of them
        (`power_changes`) and tables estimated.
    throttle, n2, over, limits, fan
        As for `identify_spools`.
    tables : mapping of str to mapping of str to sequence of float, optional
        Tables of steady performance that `flights` give, with their axes and breakpoints, as for
        `steady_table`; those of the a-priori deck are the prior.
    thrust_scale : float
        Standard error of the factor of the recorded thrust, common to all records.

    Returns
    -------
    EngineFit

    Raises
    ------
    IdentificationError
        No records at all, points without an a-priori thrust, tables without flights, or what the
        parts raise.
    """
    given = dict(prior or {})
    points = recorded is not None or equilibrium is not None
    if not (power_changes or starts or points or flights):
        raise IdentificationError(
            "no records; give power changes, starts, settled points, or flights"
        )
    if points and "corrected_thrust" not in given:
        raise IdentificationError(
            f"points correct the table corrected_thrust of an a-priori deck; it has "
            f"{' '.join(given) or 'no tables'}"
        )
    if tables and not flights:
        raise IdentificationError(
            f"tables of {' '.join(tables)} come from whole flights; give flights"
        )
    changes = [*power_changes, *(change for one in flights for change in cut_power_changes(one))]
    return EngineFit(
        given,
        identify_spools(changes, throttle, n2, over=over, limits=limits, fan=fan)
        if changes
        else None,
        correct_deck(given["corrected_thrust"], recorded, equilibrium, polar, S, engines)
        if points
        else None,
        identify_start(starts) if starts else None,
        dict(_steady(flights, tables or {}, given, thrust_scale)),
        tuple(
            str(one.attrs["record"])
            for one in (*power_changes, *flights, *starts)
            if "record" in one.attrs
        ),
    )


def _steady(
    flights: Sequence[xr.Dataset],
    tables: Mapping[str, Mapping[str, Sequence[float]]],
    given: Mapping[str, xr.Dataset],
    thrust_scale: float,
) -> Iterator[tuple[str, SteadyTable]]:
    for name, axes in tables.items():
        prior = given.get(name)
        fits = prior is not None and set(map(str, prior["value"].dims)) <= set(axes)
        yield (
            name,
            steady_table(
                flights,
                name,
                axes,
                prior if fits else None,
                thrust_scale if name.endswith("thrust") else 0.0,
            ),
        )
