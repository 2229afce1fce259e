"""Ranges of controls and devices that no aeroplane has: per cent for shares, mm for m, 1 for flaps.

The motion of an aeroplane does not give the unit of a lever, of a flap or of a force of the pilot:
the effect of a control takes the factor up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.names import lookup
from flightmech.units import DEGREE, INCH
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, map_entry

_SHARES = ("throttle", "n1", "n2", "gear", "speedbrake", "brake", "brake_left", "brake_right")
_LARGEST_SHARE = 1.3  # of full travel or rated speed: reheat and overspeed are below
_PER_CENT = (20.0, 130.0)  # largest values of a share in per cent
_HUNDREDTH = 0.02  # largest value of a share that was divided by 100 twice: up to twice full speed
_RUNNING = 0.004  # largest value of a speed that is not zero, noise included
_TURNING = ("n1", "n2")  # shares that are larger while an engine runs
_MOVED = ("throttle", "prop_command")
_FLAPS = "delta_f"
_ONE = 0.01  # rad about 1 rad of the largest flap that is a position of 0 to 1
# Positions at which flaps rest. As angles they are 14.3, 19.1, 28.6 and 38.2 deg: no flap has such
# settings. 0.75 is left out: 0.75 rad is 43 deg.
_POSITIONS = ((0.25, "1/4"), (1.0 / 3.0, "1/3"), (0.5, "1/2"), (2.0 / 3.0, "2/3"))
_RESTS, _AT_REST = 3.0, 0.0015  # s at a position, and rad about it
# largest excursion of a cockpit control from its middle: m, m and rad
_EXCURSIONS = {"column": 0.5, "pedal": 0.3, "wheel": 3.5}
# largest forces of a pilot: N, N m (wheel) and N, four times the limits of 14 CFR 23.143
_FORCES = {"F_column": 1340.0, "F_wheel": 300.0, "F_pedal": 2670.0}
_FLOW = 20.0  # kg/s of fuel of one engine
Unchecked = list[tuple[str, str, tuple[str, ...], str]]


@dataclass(frozen=True)
class _Mistake:
    """What a range shows: words, and factor of the correction (0 without a certain one)."""

    text: str
    factor: float = 0.0


def control_range_findings(
    signals: ResampledChannels, record: xr.DataTree
) -> tuple[list[Finding], Unchecked]:
    """Return the warnings on controls whose range fits another unit, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Controls and devices as the name map gives them. [SI]
    record : DataTree
        Its channels carry their entries of the name map.

    Returns
    -------
    list of Finding
        Of kind ``unit``.
    list of (str, str, tuple of str, str)
        Forces of the pilot within the usual range: lbf and N differ by 4.4 and both are usual.
    """
    findings = []
    forces: list[str] = []
    for name, values in signals.values.items():
        good = values[signals.good[name]]
        if not good.size:
            continue
        mistake = _mistake_of(name, good)
        if mistake is None and name == _FLAPS:
            mistake = _flap_position(good, signals.step)
        if mistake is None:
            if name in _FORCES and np.ptp(good) > 0.0:
                forces.append(name)
            continue
        remedy = f"check column and unit of {name} in the name map"
        if mistake.factor:
            remedy = map_entry(record, name, mistake.factor)
        evidence = {"least": float(good.min()), "largest": float(good.max())}
        text = f"{name} {mistake.text}"
        findings.append(Finding("warning", "unit", (name,), text, remedy, evidence=evidence))
    unchecked: Unchecked = []
    if forces:
        reason = (
            f"{', '.join(forces)}: lbf and N differ by 4.45, and a flight has both; compare with a "
            f"force balance on the ground"
        )
        unchecked.append(("forces", "unit of the forces of the pilot", tuple(forces), reason))
    return findings, unchecked


def _mistake_of(name: str, x: np.ndarray) -> _Mistake | None:
    """Return the mistake that the samples of a channel show; None without one."""
    kind = name.rpartition(".")[2]
    largest = float(np.max(np.abs(x)))
    reaches = f"reaches {largest:.3g} {lookup(name).units}"
    if kind in _SHARES:
        return _share_mistake(kind, largest, travel=float(np.ptp(x)))
    if name == _FLAPS and abs(largest - 1.0) < _ONE:
        return _Mistake(
            f"{reaches}, 57.3 deg, at most: a position of 0 to 1 that is taken for an angle; usual "
            f"are 10 to 60 deg; give it scale = the angle of full flaps"
        )
    if name in _EXCURSIONS and largest > _EXCURSIONS[name]:
        limit = f"usual are up to {_EXCURSIONS[name]:g} {lookup(name).units} from the middle"
        if name == "wheel":
            return _Mistake(f"{reaches}; {limit}; it fits deg taken for rad", DEGREE)
        factor, unit = (1e-3, "mm") if largest > _EXCURSIONS[name] / INCH else (INCH, "in or cm")
        return _Mistake(f"{reaches}; {limit}; it fits {unit} taken for m", factor)
    if name in _FORCES and largest > _FORCES[name]:
        return _Mistake(
            f"{reaches}; no pilot exerts more than {_FORCES[name]:g} {lookup(name).units}; N was "
            f"taken for lbf, or the raw signal for a force"
        )
    if kind == "fuel_flow" and largest > _FLOW:
        return _Mistake(
            f"{reaches}; an engine burns less than {_FLOW:g} kg/s; it fits kg/h or lb/h taken for "
            f"kg/s"
        )
    return None


def _flap_position(x: np.ndarray, step: float) -> _Mistake | None:
    """Return the mistake of flaps that rest at a share of their travel; None without one."""
    resting = []
    for position, share in _POSITIONS:
        at = np.abs(x - position) < _AT_REST
        # noise spreads evenly about a setting, and a moving flap passes it
        if at.sum() * step >= _RESTS and abs(float(np.mean(x[at])) - position) < 0.5 * _AT_REST:
            resting.append((position, share))
    if not resting:
        return None
    listed = " and ".join(f"{x:.3g} rad, {x / DEGREE:.3g} deg" for x, _ in resting)
    shares = " and ".join(share for _, share in resting)
    return _Mistake(
        f"rests at {listed}: flaps have round settings in degrees, and this is {shares} of a "
        f"position of 0 to 1 that is taken for an angle; give it scale = the angle of full flaps, "
        f"unless the setting is right"
    )


def _share_mistake(kind: str, largest: float, travel: float) -> _Mistake | None:
    if largest > _LARGEST_SHARE:
        fits = _PER_CENT[0] <= largest <= _PER_CENT[1]
        reason = "it fits per cent; state unit = '%'" if fits else "it fits no share"
        return _Mistake(
            f"reaches {largest:.3g}, and its full value is 1: {reason}", 0.01 if fits else 0.0
        )
    # a lever at idle rests, and one that is moved reaches more than a fiftieth
    is_moved = kind in _MOVED and travel > max(_RUNNING, 0.5 * largest)
    if (kind in _TURNING or is_moved) and _RUNNING < largest < _HUNDREDTH:
        return _Mistake(
            f"reaches {largest:.3g} only, and its full value is 1: a share that is taken for per "
            f"cent",
            100.0,
        )
    return None
