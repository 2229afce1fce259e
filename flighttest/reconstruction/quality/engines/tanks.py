"""Contents of tanks: against their capacity, and their sum against the fuel on board."""

from __future__ import annotations

import numpy as np

from flightmech.aircraft.aircraft import Aircraft, tanks_of
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.fuel import Unchecked
from flighttest.reconstruction.quality.finding import Finding

_POUNDS = 2.2046226  # lb in a kilogram
_NEAR = 0.05  # of a ratio: gauges agree within a few parts in a hundred
_FEWEST = 50  # samples


def tank_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on the contents of tanks, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        ``tank.NAME.fuel`` of tanks, and ``fuel``, if recorded. [kg]
    aircraft : Aircraft
        Its tanks have a capacity each. [kg]

    Returns
    -------
    findings : list of Finding
        A content beyond the capacity of its tank; a sum that is not the fuel on board.
    unchecked : list
        Empty: a record without contents has nothing to check.
    """
    findings = []
    names = {f"tank.{tank.name}.fuel": tank.capacity for tank in tanks_of(aircraft)}
    for name, capacity in names.items():
        if name not in signals or not signals.good[name].any():
            continue
        most = float(np.max(signals[name][signals.good[name]]))
        ratio = most / capacity
        if ratio > 1.0 + _NEAR:
            text = f"{name} reaches {most:.4g} kg, and the tank holds {capacity:.4g} kg"
            text += _unit_text(ratio, at_least=True)
            remedy = f"correct the unit of {name} in the name map, or the capacity of the tank"
            findings.append(
                Finding("warning", "unit", (name,), text, remedy, evidence={"ratio": ratio})
            )
    return findings + _sum_findings(signals, tuple(names)), []


def _sum_findings(signals: ResampledChannels, names: tuple[str, ...]) -> list[Finding]:
    """Return the finding on contents whose sum is not the recorded fuel on board."""
    if not names or any(name not in signals for name in (*names, "fuel")):
        return []
    good = np.logical_and.reduce([signals.good[name] for name in (*names, "fuel")])
    good &= signals["fuel"] > 0.0
    if good.sum() < _FEWEST:
        return []
    total = np.sum([signals[name] for name in names], axis=0)[good]
    ratio = float(np.median(total / signals["fuel"][good]))
    if abs(ratio - 1.0) < _NEAR:
        return []
    text = f"the sum of {', '.join(names)} is {ratio:.3g} times fuel" + _unit_text(ratio)
    remedy = f"compare {', '.join((*names, 'fuel'))} with the gauges; correct unit or column"
    return [Finding("warning", "scale", (*names, "fuel"), text, remedy, evidence={"ratio": ratio})]


def _unit_text(ratio: float, at_least: bool = False) -> str:
    """Return that pounds explain a ratio; nothing if they do not.

    With `at_least` the ratio is that of a tank that may not have been full.
    """
    low = 0.5 * _POUNDS if at_least else (1.0 - _NEAR) * _POUNDS
    if low < ratio < (1.0 + _NEAR) * _POUNDS:
        return ", as if the contents were in lb and taken as kg"
    if not at_least and abs(ratio * _POUNDS - 1.0) < _NEAR:
        return ", as if fuel were in lb and taken as kg"
    return ""
