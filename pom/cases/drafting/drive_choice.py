"""Drive of a drafted case: what the record has, and what the engines of the aircraft take."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from flightmech.aircraft.aircraft_file import read_engines
from flightmech.aircraft.engine import engine_drives
from flightmech.errors import AeromatchError, SchemaError
from pom.cases.case_inputs import PRIMARY
from pom.cases.drafting.event_detection import Recorded
from pom.cases.job import ENGINE_DRIVES
from pom.tolerances import rows as table

# Drives of the engines, the best one first.
POWERS: tuple[str, ...] = ("thrust", "torque", "map", "n1", "throttle")
_NO_CONTROLS = (
    "no complete set of controls: needs delta_e, delta_a, delta_r, or column, wheel, pedal, or "
    "their forces"
)


def offered_drives(aircraft: Path | None) -> Collection[str] | None:
    """Return the inputs that can drive the engines of an aircraft file; None if not known."""
    if aircraft is None:
        return None
    try:
        return engine_drives(read_engines(aircraft))
    except (AeromatchError, OSError):
        # The reader of the case names the fault.
        return None


def choose_drive(
    rows: Sequence[table.Row],
    recorded: Recorded,
    ground: bool,
    is_engine_test: bool,
    drives: Collection[str] | None,
) -> dict[str, object]:
    """Return the drive that the record has the channels for, if possible one that the engines take.

    Parameters
    ----------
    rows : sequence of Row
        Rows of the tolerance table.
    recorded : Recorded
    ground : bool
        Whether the replay starts on the wheels.
    is_engine_test : bool
        Whether the response of an engine is judged.
    drives : collection of str or None
        Inputs that can drive the engines of the aircraft file; None if not known.

    Raises
    ------
    SchemaError
        The record has no complete set of controls, or nothing that drives the engines.
    """
    levels = ["recorded", "cockpit", "force"]
    # Tests of the controls themselves prefer the forces of the pilot.
    if rows[0]["test_id"].startswith(("2.a", "2.b")):
        levels.reverse()
    level = next((name for name in levels if set(PRIMARY[name]) <= set(recorded.channels)), "")
    if not level:
        raise SchemaError("record", [_NO_CONTROLS])
    powers = POWERS
    # A test of the engine response must not drive the response itself.
    if is_engine_test:
        powers = ("throttle", "n1")
    power = _choose_power(recorded.channels, powers, drives)
    drive: dict[str, object] = {"surfaces": level, "engine": power}
    # without a recorded propeller lever the governor holds the recorded speed
    has_lever = "engine1.prop_command" in recorded.channels
    if power in ("torque", "map") and not has_lever and "engine1.rpm" in recorded.channels:
        drive["propeller"] = "rpm"
    return {**drive, "trim": "ground" if ground else True}


def _choose_power(
    channels: Collection[str], powers: Sequence[str], drives: Collection[str] | None
) -> str:
    """Return the first drive that is recorded and that the engines take, else the first recorded.

    The aircraft file need not be that of the model: an FMU from elsewhere has its own engines.
    It is ``none`` for an aircraft without engines, whose record has nothing that drives one.
    """
    recorded = [name for name in powers if f"engine1.{ENGINE_DRIVES[name][0]}" in channels]
    if not recorded and drives is not None and not drives:
        return "none"
    if not recorded:
        names = ", ".join(f"engine1.{ENGINE_DRIVES[name][0]}" for name in powers)
        raise SchemaError("record", [f"no {names}: one of them drives the engines; map it"])
    taken = [name for name in recorded if drives is not None and ENGINE_DRIVES[name][1] in drives]
    return (taken or recorded)[0]
