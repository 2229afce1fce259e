"""Air data of one computer against each other, to a few thousandths.

True and calibrated airspeed and Mach number of an air-data computer follow from impact pressure,
static pressure and temperature without an error of measurement.  The scatter of their ratio shows
whether a record holds such channels.  A ratio that is constant and not one is then a mistake of one
of them: a temperature 10 K too high makes 1.7 %, a height 120 m too high 0.6 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding
from flighttest.reconstruction.quality.navigation.airspeed_scale import explaining_unit
from flighttest.reconstruction.quality.navigation.inertial_fit import fit_inertial
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked

_CLOSED = 0.001  # scatter of the ratio of channels that were computed from each other
_COMPUTED, _MEASURED = 0.004, 0.02  # deviation of a ratio from one, of computed and other channels
_FAST = 0.5  # of the largest value, below which ratios are not formed
# Relation -> the powers with which p_static and temperature enter the second side, for low speed
_RELATIONS = {
    "airspeed": (-0.5, 0.5),
    "mach": (0.0, -0.5),
    "mach_pressure": (-0.5, 0.0),
    "calibrated": (0.0, 0.0),
}
_SCALE_HEIGHT = 8400.0  # m in which the static pressure falls by a factor e, near the ground
_LATE, _SIGMAS = 0.15, 3.0  # s between two channels of one computer, and standard errors
_EXPLAINED = 0.98
_STRETCH, _LONGEST = 40.0, 5.0  # s
_LEVEL_ROW = ("h_baro_level", "level of h_baro: altimeter setting")


@dataclass(frozen=True)
class _SideRatio:
    """First over second side of a relation: median and scatter."""

    middle: float
    scatter: float


def closure_findings(
    comparisons: dict[str, RelationCheck],
    signals: ResampledChannels,
    late_channels: set[str],
) -> list[Finding]:
    """Return the findings on air data that do not follow from each other.

    Parameters
    ----------
    comparisons : dict of RelationCheck
        By name of the relation.
    signals : ResampledChannels
        Without mistakes.
    late_channels : set of str
        Channels whose delay is reported already.
    """
    findings: list[Finding] = []
    blamed: set[str] = set()
    for name, powers in _RELATIONS.items():
        check = comparisons.get(name)
        if check is None or not _is_recorded(check, signals):
            continue
        channels = check.relation.channels(signals)
        if not check.consistent:
            findings += _unit_findings(check, channels)
            continue
        # one mistake breaks several relations: the first one reports it
        if blamed & set(channels):
            continue
        if not late_channels.isdisjoint(channels):
            continue
        late = _delay_finding(check, channels, signals)
        ratio = _ratio(check)
        deviation = ratio.middle - 1.0
        limit = _COMPUTED if ratio.scatter < _CLOSED else _MEASURED
        if late is not None:
            findings.append(late)
        elif abs(deviation) > limit:
            findings.append(_ratio_finding(check, channels, ratio, powers, signals))
        else:
            continue
        blamed.update(channels)
    return findings


def level_not_checked(
    comparisons: dict[str, RelationCheck], signals: ResampledChannels
) -> Unchecked:
    """Return the row of a pressure height whose level nothing in the record shows."""
    if "h_baro" not in signals or "p_static" in signals:
        return []
    for name in ("airspeed", "mach_pressure"):
        check = comparisons.get(name)
        if check is None or not check.consistent or not _is_recorded(check, signals):
            continue
        if _ratio(check).scatter < _CLOSED:
            return []
    reason = (
        "not recorded: p_static, or V with V_cas and temperature of one computer; weather moves "
        "pressure height against h_gps by 300 m"
    )
    return [(*_LEVEL_ROW, ("p_static",), reason)]


def _is_recorded(check: RelationCheck, signals: ResampledChannels) -> bool:
    """Return whether no temperature of a standard day stands for a recorded one."""
    return "temperature" not in check.relation.needs or "temperature" in signals


def _ratio(check: RelationCheck) -> _SideRatio:
    first, second = check.first[check.mask], check.second[check.mask]
    fast = second > _FAST * np.percentile(second, 95.0)
    ratio = first[fast] / second[fast]
    middle = float(np.median(ratio))
    return _SideRatio(middle, float(1.4826 * np.median(np.abs(ratio - middle))))


def _unit_findings(check: RelationCheck, channels: tuple[str, ...]) -> list[Finding]:
    """Return the error of a speed in a unit near the right one, which breaks a relation."""
    ratio = _ratio(check)
    unit = explaining_unit(ratio.middle)
    if unit is None or ratio.scatter > _CLOSED or check.relation.units != "m s-1":
        return []
    text = (
        f"{check.relation.title}: the first is {ratio.middle:.3f} of the second (scatter "
        f"{ratio.scatter:.4f}): {channels[0]} is in {unit[0]} and was taken as {unit[1]}"
    )
    remedy = f'give {channels[0]} unit = "{unit[0]}" in the name map'
    evidence = {"relation": check.relation.name, "ratio": ratio.middle}
    return [Finding("error", "unit", channels, text, remedy, evidence=evidence)]


def _ratio_finding(
    check: RelationCheck,
    channels: tuple[str, ...],
    ratio: _SideRatio,
    powers: tuple[float, float],
    signals: ResampledChannels,
) -> Finding:
    """Return the finding on a ratio, with the size that each channel would be wrong by."""
    deviation = ratio.middle - 1.0
    candidates = [f"{channels[0]} is {deviation:+.1%} wrong"]
    # The speed is the root of the impact pressure, and of powers of temperature and pressure.
    if "q_c" in channels:
        candidates.append(f"q_c is {-2.0 * deviation:+.1%} wrong")
    for name in {"V", "V_cas"} & set(channels[1:]):
        candidates.append(f"{name} is {-deviation:+.1%} wrong")
    pressure, warmth = powers
    if warmth and "temperature" in channels:
        middle = float(np.median(signals["temperature"][check.mask]))
        error = -deviation / warmth * middle
        candidates.append(f"temperature is {error:+.0f} K wrong")
    if pressure and "p_static" in channels:
        candidates.append(f"p_static is {-deviation / pressure:+.1%} wrong")
    if pressure and "h_baro" in channels:
        error = deviation / pressure * _SCALE_HEIGHT
        candidates.append(f"h_baro is {error:+.0f} m wrong (altimeter setting)")
    computed = ratio.scatter < _CLOSED
    origin = "were computed from each other" if computed else "belong together"
    text = (
        f"{check.relation.title}: the first is {ratio.middle:.4f} of the second (scatter "
        f"{ratio.scatter:.4f}), and channels that {origin} agree better: {' or '.join(candidates)}"
    )
    remedy = f"check units, offsets and calibrations of {', '.join(channels)} in the name map"
    evidence = {"ratio": ratio.middle, "scatter": ratio.scatter}
    return Finding("warning", "inconsistent", channels, text, remedy, evidence=evidence)


def _delay_finding(
    check: RelationCheck, channels: tuple[str, ...], signals: ResampledChannels
) -> Finding | None:
    """Return the finding on a side that is later than the other one."""
    seconds = float(check.mask.sum()) * signals.step
    fit = fit_inertial(
        check.first,
        (check.second,),
        mask=check.mask,
        step=signals.step,
        stretch=min(_STRETCH, 0.7 * seconds),
        longest=_LONGEST,
        order=1,
    )
    if fit is None or fit.explained < _EXPLAINED or fit.bound:
        return None
    if abs(fit.delay) < _LATE + _SIGMAS * fit.stderr:
        return None
    direction = "later" if fit.delay > 0.0 else "earlier"
    text = (
        f"{channels[0]} is {1e3 * abs(fit.delay):.0f} ms {direction} than "
        f"{', '.join(channels[1:])} "
        f"(standard error {1e3 * fit.stderr:.0f} ms), and one computer gives both"
    )
    remedy = (
        "compare the clocks of the two columns, and put the time between them into the name map"
    )
    evidence = {"delay": fit.delay, "stderr": fit.stderr, "bound": False}
    return Finding("warning", "lag", channels, text, remedy, evidence=evidence)
