"""An engine identified from its records: deck file and ``[[engine]]`` entry, with sources and standard errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech.aircraft.systems.engine_deck import CONSTANTS, Deck, write_tables
from flightmech.errors import IdentificationError
from flightmech.support.atomic_write import written_atomically

from .spools import SpoolFit, identify_spools
from .starting import StartFit, identify_start
from .steady.static import DeckCorrection, Polar, correct_deck

_LOWER = 0.9  # speed at light-off less a margin, as least speed to light; it burns down to half of that


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
    """

    prior: Mapping[str, xr.Dataset]
    spools: SpoolFit | None = None
    static: DeckCorrection | None = None
    start: StartFit | None = None

    def deck(self, pla: tuple[float, float] = (0.0, 1.0)) -> Deck:
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
            tables = {name: leaf for name, leaf in tables.items() if not name.startswith(("n2_", "corrected_n2_command"))}
            tables |= self.spools.leaves()
        if self.start:
            tables = self.start.joined(tables)
        constants: dict[str, Any] = {name: value for name, (value, _) in self._constants().items()}
        if self.start:
            constants |= {"light_speed": _LOWER * self.start.light_speed, "sustain_speed": 0.5 * _LOWER * self.start.light_speed}
        return Deck(tables, pla_idle=pla[0], pla_full=pla[1], **constants)

    def _constants(self) -> dict[str, tuple[float, float]]:
        found = {**(self.spools.constants if self.spools else {}), **(self.start.constants if self.start else {})}
        return {name: pair for name, pair in found.items() if name in CONSTANTS}

    def write(self, path: str | Path, pla: tuple[float, float] = (0.0, 1.0), title: str = "engine deck from flight") -> str:
        """Write the tables to a netCDF file and return the ``[engine.deck]`` entry of the aircraft file that belongs to it.

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
            write_tables(deck.tables, part, title=title, history="identified from flight by flighttest.identify_engine")
        lines = ["[engine.deck]", f'file = "{path.name}"', f"pla_idle = {pla[0]:.6g}", f"pla_full = {pla[1]:.6g}"]
        lines += [f"{name} = {value:.6g}  # flight, standard error {stderr:.2g}" for name, (value, stderr) in self._constants().items()]
        if self.start:
            lines.append(f"light_speed = {deck.light_speed:.6g}  # flight: lit at {self.start.light_speed:.4g}, an upper limit")
            lines.append(f"sustain_speed = {deck.sustain_speed:.6g}  # judgement: half of light_speed")
        return "\n".join(lines) + "\n"

    def as_dict(self) -> dict:
        """Return the numbers of all parts: constants and tables with standard errors."""
        parts = [part for part in (self.spools, self.start) if part]
        constants = {name: list(pair) for part in parts for name, pair in part.constants.items()}
        tables = {}
        for name, leaf in ((name, curve.leaf) for part in parts for name, curve in part.tables.items()):
            axis = str(leaf["value"].dims[0])
            tables[name] = {axis: leaf[axis].values, "value": leaf["value"].values, "stderr": leaf["stderr"].values}
        found = {"constants": constants, "tables": tables}
        if self.static:
            static = self.static
            found["correction"] = {"speed": static.speeds, "factor": static.factor, "stderr": static.stderr, "remarks": static.remarks}
        return found

    def report(self) -> str:
        """Return all parts as text."""
        parts = (("Governor and spools", self.spools), ("Static thrust", self.static), ("Start and shut-down", self.start))
        return "\n\n".join(f"{title}\n{'-' * len(title)}\n{part.report()}" for title, part in parts if part)


def identify_engine(
    power_changes: Sequence[xr.Dataset] = (),
    starts: Sequence[xr.Dataset] = (),
    recorded: xr.Dataset | None = None,
    equilibrium: xr.Dataset | None = None,
    prior: Mapping[str, xr.Dataset] | None = None,
    polar: Polar | None = None,
    S: float = 0.0,
    engines: int = 1,
) -> EngineFit:
    """Identify an engine from power changes, starts, and settled points.

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

    Returns
    -------
    EngineFit

    Raises
    ------
    IdentificationError
        No records at all, points without an a-priori thrust, or what the parts raise.
    """
    given = dict(prior or {})
    points = recorded is not None or equilibrium is not None
    if not (power_changes or starts or points):
        raise IdentificationError("no records; give power changes, starts, or settled points")
    if points and "corrected_thrust" not in given:
        raise IdentificationError(f"points correct the table corrected_thrust of an a-priori deck; it has {' '.join(given) or 'no tables'}")
    return EngineFit(
        given,
        identify_spools(power_changes) if power_changes else None,
        correct_deck(given["corrected_thrust"], recorded, equilibrium, polar, S, engines) if points else None,
        identify_start(starts) if starts else None,
    )
