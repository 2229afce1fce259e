"""Temperature of the air against that of the standard atmosphere at the pressure of the flight.

Days are up to 35 K warmer and, over land in winter, up to 70 K colder than standard.  Fahrenheit
taken as Celsius is warmer than that below 2000 m or so, and so is the total temperature of a fast
jet.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.air import atmosphere, pressure_altitude
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, map_entry

_POSSIBLE = (-75.0, 38.0)  # K
_RESTORED = 25.0  # K within which a change of unit must bring it
_ENOUGH = 5.0  # s
_ZERO, _RATIO = 273.15, 1.8


def temperature_findings(signals: ResampledChannels, record: xr.DataTree) -> list[Finding]:
    """Return whether the recorded temperature is one of the air at this height.

    Parameters
    ----------
    signals : Signals
        Mistakes undone.
    record : DataTree
    """
    full = signals.completed(("p_static",))
    if not {"temperature", "p_static"} <= set(full.values):
        return []
    mask = full.mask(("temperature", "p_static"))
    if mask.sum() * full.step < _ENOUGH:
        return []
    p_static = np.clip(full["p_static"][mask], 1e3, 1.2e5)
    standard = atmosphere(pressure_altitude(p_static)).temperature
    temperature = full["temperature"][mask]
    apart = float(np.median(temperature - standard))
    if _POSSIBLE[0] <= apart <= _POSSIBLE[1]:
        return []
    middle = float(np.median(temperature))
    text = (
        f"temperature is {middle - _ZERO:.0f} degC and {apart:+.0f} K off the standard "
        f"atmosphere at the pressure of the flight "
        f"(days differ by {_POSSIBLE[0]:g} to {_POSSIBLE[1]:g} K)"
    )
    slope, shift = 1.0 / _RATIO, _ZERO - (_ZERO + 32.0) / _RATIO
    if abs(float(np.median(slope * temperature + shift - standard))) < _RESTORED:
        text += (
            ": it is in degF and was taken as degC; or it is the total temperature, or the "
            "height is wrong"
        )
        remedy = map_entry(record, "temperature", slope, shift)
    else:
        text += ": unit or column are wrong, or the height is"
        remedy = "check the columns of temperature and height in the name map"
    evidence = {"difference": apart}
    return [Finding("warning", "unit", ("temperature",), text, remedy, evidence=evidence)]
