"""Air data that a record does not hold, formed from channels that it holds.

Most recorders store calibrated and no true airspeed.  The relations that need V, or a pressure,
then use what the standard atmosphere and the equations of the air-data computer give.  A formed
channel rests on its sources: a mistake in one of them is a mistake of that source, and the search
looks for it there.
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
class _Way:
    """One way to form a channel: what it needs, each recorded or formed in turn, and how."""

    needs: tuple[str, ...]
    form: Callable[..., np.ndarray]


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


_WAYS: dict[str, tuple[_Way, ...]] = {
    "p_static": (_Way(("h_baro",), _pressure_at), _Way(("h_gps",), _pressure_at)),
    "temperature": (_Way(("p_static",), _standard_temperature),),
    "q_c": (_Way(("V_cas",), _impact),),
    "V": (
        _Way(("q_c", "p_static", "temperature"), _of_impact),
        _Way(("mach", "temperature"), _of_mach),
        _Way(("V_eas", "p_static", "temperature"), _of_equivalent),
    ),
}
_IN_WORDS = {
    "p_static": "p_static or h_baro",
    "V": "V, or V_cas, q_c, mach or V_eas with p_static or h_baro",
}


def source_channels(name: str, recorded: Collection[str]) -> tuple[str, ...]:
    """Return the recorded channels on which a channel rests: itself where it is recorded, none
    where it cannot be formed.
    """
    if name in recorded:
        return (name,)
    way = _way(name, recorded)
    if way is None:
        return ()
    found = [source for need in way.needs for source in source_channels(need, recorded)]
    return tuple(dict.fromkeys(found))


def form_channel(name: str, recorded: Arrays) -> np.ndarray | None:
    """Return a channel as recorded or formed from others [SI]; None where it cannot be formed."""
    if name in recorded:
        return recorded[name]
    way = _way(name, recorded)
    if way is None:
        return None
    parts = [form_channel(need, recorded) for need in way.needs]
    return way.form(*parts)


def describe_channel(name: str, formable: bool) -> str:
    """Return what must be recorded for a channel, in words."""
    return _IN_WORDS.get(name, name) if formable else name


def _way(name: str, recorded: Collection[str]) -> _Way | None:
    ways = _WAYS.get(name, ())
    return next(
        (way for way in ways if all(source_channels(need, recorded) for need in way.needs)), None
    )
