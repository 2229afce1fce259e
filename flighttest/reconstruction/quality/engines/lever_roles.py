"""Power lever and propeller lever of one engine that were exchanged.

Manifold pressure, gas generator and torque follow the power lever.  The propeller lever sets the
speed of the propeller: at a fixed power lever the manifold pressure falls as the speed rises.
"""

from __future__ import annotations

import re

import numpy as np

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.engine_sides import lever_correlation
from flighttest.reconstruction.quality.finding import Finding

_PROPELLER = re.compile(r"(engine\d+)\.prop_command")
# A propeller that turns faster raises neither of the first two.
_OUTPUTS = ("manifold_pressure", "n1", "torque", "fuel_flow", "thrust")
_CERTAIN = _OUTPUTS[:2]
_LEVER_MOVES = 0.03  # standard deviation of a lever that moves [1]
_OUTPUT_MOVES = 0.05  # that of an output, over its largest value
_FOLLOWS, _RATHER = 0.8, 0.3  # correlation with a lever, and its excess over the other lever
_SPEED = 0.5  # correlation of speed and propeller lever, above which the lever sets the speed


def role_findings(signals: ResampledChannels) -> list[Finding]:
    """Return the errors of engines whose power follows the propeller lever.

    Parameters
    ----------
    signals : ResampledChannels
        ``engine1.throttle``, ``engine1.prop_command`` and outputs of the same engine, such as
        ``engine1.manifold_pressure``. [SI]

    Returns
    -------
    list of Finding
        One for an engine whose outputs follow the propeller lever (correlation above 0.8) and not
        the power lever (0.3 less). Levers that move together show nothing.
    """
    findings = []
    for match in filter(None, map(_PROPELLER.fullmatch, signals.values)):
        engine = match[1]
        power, propeller = f"{engine}.throttle", f"{engine}.prop_command"
        if power not in signals or float(np.std(signals[propeller])) < _LEVER_MOVES:
            continue
        followers = []
        for output in _OUTPUTS:
            name = f"{engine}.{output}"
            if name not in signals or not _is_moving(signals[name]):
                continue
            own = lever_correlation(signals[power], signals[name], signals.step)
            other = lever_correlation(signals[propeller], signals[name], signals.step)
            own = max(own, 0.0)
            certain = output in _CERTAIN or not _sets_speed(signals, engine)
            if certain and other > _FOLLOWS and other > own + _RATHER:
                followers.append((name, other, own))
        if followers:
            findings.append(_role_finding(power, propeller, followers))
    return findings


def _is_moving(output: np.ndarray) -> bool:
    """Return whether an output changes by more than noise."""
    return float(np.std(output)) > _OUTPUT_MOVES * float(np.max(np.abs(output)))


def _sets_speed(signals: ResampledChannels, engine: str) -> bool:
    """Return whether the speed of the propeller follows the propeller lever, or is not recorded."""
    speed = f"{engine}.rpm"
    if speed not in signals:
        return True
    lever = signals[f"{engine}.prop_command"]
    return lever_correlation(lever, signals[speed], signals.step) > _SPEED


def _role_finding(power: str, propeller: str, followers: list[tuple[str, float, float]]) -> Finding:
    shown = []
    for name, other, own in followers:
        shown.append(f"{name} follows {propeller} (correlation {other:.2f}, {power} {own:.2f})")
    text = (
        f"{power} and {propeller} look exchanged: {'; '.join(shown)}; the power lever sets it, the "
        f"propeller lever sets the speed"
    )
    remedy = f"exchange the columns of {power} and {propeller} in the name map"
    evidence = {"correlation": followers[0][1]}
    return Finding("error", "column", (power, propeller), text, remedy, evidence=evidence)
