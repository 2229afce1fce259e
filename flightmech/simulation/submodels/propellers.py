"""Catalogue rows of the propellers, and of the piston engines and motors that turn them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from flightmech.aircraft.engine import MOST
from flightmech.errors import SchemaError
from flightmech.simulation.catalogue_row import make_row, make_vocabulary_row
from flightmech.simulation.kernel import INPUT, OUTPUT, STATE, VARIABLE, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

# Constants by group: units, display units, description, least value.
_PROPELLER: dict[str, tuple[str, str, str, float]] = {
    "diameter": ("m", "ft", "diameter of the propeller", 0.0),
    "inertia": ("kg m2", "kg m2", "moment of inertia of the propeller and what turns with it", 0.0),
    "gear_ratio": ("1", "1", "speed of the engine over that of the propeller", 0.0),
    "rotation": ("1", "1", "1 right-handed about the thrust, -1 left-handed", -1.0),
    "low_pitch": ("rad", "deg", "lower stop of the blade angle", -MOST),
    "high_pitch": ("rad", "deg", "upper stop of the blade angle", -MOST),
    "feather_pitch": ("rad", "deg", "blade angle of the feathered propeller", -MOST),
    "pitch_rate": ("rad s-1", "deg/s", "largest rate of the blade angle", 0.0),
    "feather_rate": ("rad s-1", "deg/s", "rate of the blade angle to feather", 0.0),
    "rpm_low": ("rad s-1", "rpm", "speed of the propeller with the lever at 0", 0.0),
    "rpm_high": ("rad s-1", "rpm", "speed of the propeller with the lever at 1", 0.0),
    "governor_gain": ("1", "1", "rate of the blade angle per error of the speed", 0.0),
    "governor_time": ("s", "s", "lag of the governor", 0.0),
    "governed": ("1", "1", "1 a governor turns the blades, 0 the lever", 0.0),
    "J_end": ("1", "1", "last advance ratio of the tables", 0.0),
    "power_limit": ("W", "kW", "limit of the shaft power of the tables", 0.0),
    "torque_limit": ("N m", "N m", "limit of the torque of the tables at the propeller", 0.0),
    "power_time": ("s", "s", "lag of the shaft power of the tables", 0.0),
    "coupled": ("1", "1", "1 the gas generator turns with the propeller", 0.0),
}
_PISTON: dict[str, tuple[str, str, str, float]] = {
    "displacement": ("m3", "m3", "swept volume of all cylinders", 0.0),
    "volumetric_efficiency": ("1", "1", "air in the manifold over the swept volume", 0.0),
    "compression_ratio": ("1", "1", "compression ratio", 1.0),
    "pumping": ("1", "1", "part of the swept volume that pumps", 0.0),
    "ram_recovery": ("1", "1", "part of the impact pressure at the intake", 0.0),
    "intake_impedance": ("s", "s", "fall of the manifold pressure with the speed", 0.0),
    "throttle_impedance": ("s", "s", "the same of the closed throttle", 0.0),
    "map_time": ("s", "s", "lag of the manifold pressure", 0.0),
    "boost_ratio": ("1", "1", "pressure ratio of the compressor", 1.0),
    "boost_rpm": ("rad s-1", "rpm", "engine speed of this ratio; 0 at any speed", 0.0),
    "boost_limit": ("Pa", "hPa", "manifold pressure that the wastegate holds", 0.0),
    "full_rich": ("1", "1", "fuel over air with the mixture lever at 1, at sea level", 0.0),
    "enrichment": ("1", "1", "growth of fuel over air as a power of the pressure ratio", 0.0),
    "crank_torque": ("N m", "N m", "torque of the starter at rest", 0.0),
    "crank_rpm": ("rad s-1", "rpm", "engine speed at which the starter has no torque", 0.0),
    "fire_rpm": ("rad s-1", "rpm", "engine speed above which the engine fires", 0.0),
    "flame_time": ("s", "s", "time constant of firing", 0.0),
}
_MOTOR: dict[str, tuple[str, str, str, float]] = {
    "charge_start": ("1", "%", "charge of the battery at the start", 0.0),
    "speed_constant": ("rad s-1 V-1", "rad s-1 V-1", "unloaded speed over the voltage", 0.0),
    "motor_resistance": ("V A-1", "V A-1", "resistance of the motor", 0.0),
    "idle_current": ("A", "A", "current of the motor without a load", 0.0),
    "battery_resistance": ("V A-1", "V A-1", "resistance of the battery", 0.0),
    "capacity": ("A s", "A s", "charge of the full battery", 0.0),
}
_CONSTANTS = {"propeller": _PROPELLER, "piston": _PISTON, "motor": _MOTOR}
# Inputs whose start value is not zero: a propeller flies at its highest speed, an engine rich.
_STARTS = {"prop_command": 1.0, "mixture": 1.0}
# Inputs that drive: quantity of the vocabulary, description, least value.
_DRIVES = {
    "torque_drive": ("torque", "torque of the engine that drives when mode.engine is 3", -MOST),
    "rpm_drive": (
        "rpm",
        "speed that the governor holds when mode.engine is 3 to 5, 0 for that of the lever; speed "
        "of the shaft without a governor when it is 4",
        0.0,
    ),
    "manifold_pressure_drive": (
        "manifold_pressure",
        "manifold pressure that drives when mode.engine is 5",
        0.0,
    ),
}
_OUTPUT_NOTES = {
    "torque": "torque of the engine at the propeller shaft",
    "air_flow": "air flow through the engine",
}
_STATE_NOTES = {
    "manifold_pressure": "pressure in the manifold in front of the compressor",
    "shaft_power": "shaft power of the tables behind its lag",
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: numbers of the engines from 1.

    Raises
    ------
    SchemaError
        Some engines have a propeller, a piston engine or a motor, and others do not.
    """
    groups: dict[str, tuple[str, ...]] = {}
    every = range(1, len(aircraft.engines) + 1)
    for group in _CONSTANTS:
        having = [n for n in every if getattr(aircraft.engines[n - 1], group) is not None]
        if having and len(having) < len(aircraft.engines):
            without = [str(n) for n in every if n not in having]
            raise SchemaError(
                aircraft.name,
                [
                    f"engine {', '.join(without)} has no {group} and others have one; give every "
                    f"engine one or none"
                ],
            )
        groups[group] = tuple(map(str, having))
    return groups


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of a propeller, piston engine or motor."""
    word = name.rsplit(".", 1)[-1]
    engine = aircraft.engines[int(item) - 1]
    if word in _DRIVES:
        quantity, text, least = _DRIVES[word]
        return make_vocabulary_row(name, quantity, text, low=least)
    if kind == INPUT:
        low, high = aircraft.limits.get(word, (0.0, 1.0))
        return make_vocabulary_row(name, word, value=_STARTS.get(word, 0.0), low=low, high=high)
    if kind == STATE and word == "governor":
        return make_row(name, "rad s-1", "rate of the blade angle behind the lag of the governor")
    if kind == STATE:
        return make_vocabulary_row(name, word, _STATE_NOTES.get(word, ""))
    if kind == OUTPUT:
        return make_vocabulary_row(name, word, _OUTPUT_NOTES.get(word, ""))
    if kind == VARIABLE:
        return make_vocabulary_row(name, word)
    units, display_units, text, low = _CONSTANTS[group][word]
    part: Any = getattr(engine, group)
    if word == "coupled":
        part = engine.deck
    value = 0.0 if part is None else float(getattr(part, word))
    return make_row(name, units, text, display_units=display_units, value=value, low=low)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables: those of all parts of an engine are in the module `engine`."""
    return iter(())
