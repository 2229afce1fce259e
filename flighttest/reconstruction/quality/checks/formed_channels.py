"""Air data that a record does not have, formed from its channels.

Most recorders store calibrated airspeed, but not true airspeed. The relations that need V or a
pressure then use the standard atmosphere and the equations of the air-data computer. A mistake in a
formed channel is a mistake of one of its sources, and the search for mistakes looks for it there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from flightmech.air import (
    GAMMA,
    R_AIR,
    RHO_SEA,
    atmosphere,
    impact_pressure_at,
    mach_number,
    pressure_altitude,
)
from flighttest.records.sensors.measurements import pressure

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class _Formula:
    """A formula for a channel, and the channels that it needs, recorded or formed in turn."""

    needs: tuple[str, ...]
    form: Callable[..., np.ndarray]


# The limits in the formulas below keep wrong channels finite, so that the checks can name them.


def _pressure_at(height: np.ndarray) -> np.ndarray:
    return pressure(np.clip(height, -2000.0, 30000.0))


def _standard_temperature(p_static: np.ndarray) -> np.ndarray:
    # geopotential height taken as geometric: 0.1 K at 11 km
    return atmosphere(pressure_altitude(np.clip(p_static, 1e3, 1.2e5))).temperature


def _impact(V_cas: np.ndarray) -> np.ndarray:
    return impact_pressure_at(np.clip(V_cas, 0.0, 1e3))


def _sound(temperature: np.ndarray) -> np.ndarray:
    return np.sqrt(GAMMA * R_AIR * np.clip(temperature, 1.0, 1e5))


def _of_impact(q_c: np.ndarray, p_static: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    return mach_number(np.clip(q_c, 0.0, 1e6), np.clip(p_static, 1e2, 1e9)) * _sound(temperature)


def _of_mach(mach: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    return mach * _sound(temperature)


def _of_equivalent(V_eas: np.ndarray, p_static: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    density = np.clip(p_static, 1e2, 1e9) / (R_AIR * np.clip(temperature, 1.0, 1e5))
    return V_eas * np.sqrt(RHO_SEA / density)


# Formulas in order of preference.
_FORMULAS: dict[str, tuple[_Formula, ...]] = {
    "p_static": (_Formula(("h_baro",), _pressure_at), _Formula(("h_gps",), _pressure_at)),
    "temperature": (_Formula(("p_static",), _standard_temperature),),
    "q_c": (_Formula(("V_cas",), _impact),),
    "V": (
        _Formula(("q_c", "p_static", "temperature"), _of_impact),
        _Formula(("mach", "temperature"), _of_mach),
        _Formula(("V_eas", "p_static", "temperature"), _of_equivalent),
    ),
}
# Channels that can replace a channel, for messages.
_ALTERNATIVES = {
    "p_static": "p_static or h_baro",
    "V": "V, or V_cas, q_c, mach or V_eas with p_static or h_baro",
}


def source_channels(name: str, recorded: Collection[str]) -> tuple[str, ...]:
    """Return the recorded channels that a channel depends on.

    A recorded channel depends on itself. The result is empty if a channel cannot be formed.
    """
    if name in recorded:
        return (name,)
    formula = _possible_formula(name, recorded)
    if formula is None:
        return ()
    sources: list[str] = []
    for need in formula.needs:
        sources += source_channels(need, recorded)
    return tuple(dict.fromkeys(sources))


def form_channel(name: str, recorded: Arrays) -> np.ndarray | None:
    """Return a channel as recorded, or formed from others [SI]; None if it cannot be formed."""
    if name in recorded:
        return recorded[name]
    formula = _possible_formula(name, recorded)
    if formula is None:
        return None
    inputs = [form_channel(need, recorded) for need in formula.needs]
    return formula.form(*inputs)


def describe_channel(name: str, formable: bool) -> str:
    """Return the channels that a record needs for a channel, as text."""
    if formable:
        return _ALTERNATIVES.get(name, name)
    return name


def _possible_formula(name: str, recorded: Collection[str]) -> _Formula | None:
    """Return the first formula for a channel with all its inputs."""
    for formula in _FORMULAS.get(name, ()):
        if all(source_channels(need, recorded) for need in formula.needs):
            return formula
    return None
