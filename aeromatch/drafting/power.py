"""Power of the engines in a draft: records that give the thrust, and drives that a case can use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from aeromatch.drafting.gaps import channel_names
from flightmech.air import P_SEA, T_SEA
from flightmech.aircraft.aircraft_file import read_engines
from flightmech.aircraft.engine import Engine, engine_drives
from flightmech.errors import AeromatchError
from flighttest.reconstruction.dynamics.deck_thrust import deck_channels, has_spool_speed
from flighttest.reconstruction.dynamics.propeller_loads import propeller_channels
from flighttest.reconstruction.dynamics.shaft_condition import air_of
from pom.cases.drafting.drive_choice import POWERS
from pom.cases.job import ENGINE_DRIVES

# Any flight: only the names of the channels decide whether a thrust follows. [m/s, Pa, K, m]
_FLIGHT = {"V": 50.0, "p_static": P_SEA, "temperature": T_SEA, "h": 0.0}
_REMEDY = (
    "give each [[engine]] of aircraft.toml its propeller and what turns it (diameter, CT_prop, "
    "CP_prop, chart of the engine: how-to 'A propeller aircraft'), or map the column of the "
    "thrust in names.toml; a jet whose N1 is recorded: give each [[engine]] an [engine.deck] with "
    "corrected_thrust over corrected_n1 and mach (how-to 'Your own aircraft'), or map "
    "engine1.thrust to the column of N1, with its thrust at the flown altitude as the key table; "
    "then run init again"
)


@dataclass(frozen=True)
class RecordedPower:
    """What the records give of the engines of an aircraft file.

    Attributes
    ----------
    drives : frozenset of str or None
        Inputs that can drive the engines; None if the file has faults.
    no_thrust : tuple of str
        Records without the thrust of every engine, recorded or of its propeller. They have no
        coefficients.
    undriven : tuple of str
        Those of them that also have nothing that drives the engines of a model.
    """

    drives: frozenset[str] | None = None
    no_thrust: tuple[str, ...] = ()
    undriven: tuple[str, ...] = ()


def recorded_power(aircraft: Path, records: Mapping[str, xr.DataTree]) -> RecordedPower:
    """Return what records give of the engines of an aircraft file.

    Other values of the file may still be missing.
    """
    try:
        engines = read_engines(aircraft)
    except AeromatchError:
        # The check of the project names the fault.
        return RecordedPower()
    drives = engine_drives(engines)
    no_thrust, undriven = [], []
    for name, record in records.items():
        if is_thrust_known(record, engines):
            continue
        no_thrust.append(name)
        if not _is_driven(channel_names([record]), drives):
            undriven.append(name)
    return RecordedPower(drives, tuple(no_thrust), tuple(undriven))


def is_thrust_known(record: xr.DataTree, engines: Sequence[Engine]) -> bool:
    """Return whether the thrust of every engine is recorded, or follows from its propeller or
    from the speeds of its spools.
    """
    channels: dict[str, np.ndarray] = {}
    for node in record.children.values():
        for name, item in node.data_vars.items():
            values = np.asarray(item.values, float)
            if str(name).startswith("engine") and np.isfinite(values).any():
                channels[str(name)] = np.full(2, np.nanmedian(values))
    flight = {name: np.full(2, value) for name, value in _FLIGHT.items()}
    columns = {"time": np.arange(2.0), **flight, **air_of(flight), **channels}
    return all(_gives_thrust(columns, engine, number) for number, engine in enumerate(engines, 1))


def _gives_thrust(columns: Mapping[str, np.ndarray], engine: Engine, number: int) -> bool:
    if f"engine{number}.thrust" in columns:
        return True
    if engine.propeller is None:
        return _gives_deck_thrust(columns, engine, number)
    try:
        # without a rotation the position of the c.g. does not matter
        propeller_channels(dict(columns), engine, number, cg=engine.position)
    except AeromatchError:
        # Its speed, its power or a variable of its tables is not recorded.
        return False
    return True


def _gives_deck_thrust(columns: Mapping[str, np.ndarray], engine: Engine, number: int) -> bool:
    if not has_spool_speed(columns, engine, number):
        return False
    try:
        deck_channels(columns, engine, number)
    except AeromatchError:
        # A variable of its tables is not recorded.
        return False
    return True


def _is_driven(channels: set[str], drives: frozenset[str]) -> bool:
    """Return whether a channel is recorded that can drive the engines in a drafted case."""
    quantities = set()
    for name in POWERS:
        quantity, drive, _ = ENGINE_DRIVES[name]
        if drive in drives:
            quantities.add(quantity)
    return any(name.rpartition(".")[2] in quantities for name in channels)


def describe_power(power: RecordedPower) -> list[str]:
    """Return a remark on the records without thrust, with the remedy, or on an aircraft without
    engines.
    """
    if power.drives is not None and not power.drives:
        return [
            "aircraft.toml has no [[engine]], so the forces are those of a glider: with power, CD "
            "would be drag less thrust; add the engines and map their thrust"
        ]
    driven = [name for name in power.no_thrust if name not in power.undriven]
    remarks = []
    if power.undriven:
        remarks.append(
            f"no thrust and no propeller: no coefficient can be computed, and nothing drives the "
            f"engine of a model, so {_neither(power.undriven)}: {_REMEDY}"
        )
    if driven:
        verb = "identify" if len(driven) > 1 else "identifies"
        remarks.append(
            f"no thrust and no propeller: no coefficient can be computed, so {', '.join(driven)} "
            f"{verb} nothing: {_REMEDY}"
        )
    return remarks


def _neither(names: Sequence[str]) -> str:
    verb = "neither identify nor prove" if len(names) > 1 else "neither identifies nor proves"
    return f"{', '.join(names)} {verb}"
