"""Gaps of the recorded channels that drive a case: an input may begin and end in one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flightmech.aircraft.controls import DEVICE
from flighttest.records.signals.clock_gaps import gaps_in
from pom.cases.case import PomCase, driven_quantities
from pom.cases.case_file import BRAKES, WIND

Spans = Sequence[tuple[float, float]]
_LEVER_ENDS = (".throttle", ".pla")


def drives(case: PomCase, channel: str) -> bool:
    """Return whether a channel of the record drives the models of a case.

    A value of the case file replaces the channel.  The math pilot adds to the recorded control, so
    that this one drives as well.
    """
    if channel in case.conditions:
        return False
    if channel.startswith(DEVICE):
        return True
    if channel in WIND:
        return case.wind == "measured"
    piloted = {loop.control for loop in case.drive.pilot}
    if "throttle" in piloted and channel.endswith(_LEVER_ENDS):
        return True
    names = driven_quantities(case) | piloted
    # one recorded brake drives both sides
    return channel in names or (channel == "brake" and not names.isdisjoint(BRAKES))


def drive_gaps(
    case: PomCase, window: tuple[float, float], gaps: Mapping[str, Spans]
) -> dict[tuple[float, float], list[str]]:
    """Return the gaps of driving channels in a window, in order, with their channels. [s]

    Parameters
    ----------
    case : PomCase
    window : (float, float)
        [s]
    gaps : mapping of str to sequence of (float, float)
        By channel of the record. [s]
    """
    channels: dict[tuple[float, float], list[str]] = {}
    for name, spans in gaps.items():
        if not drives(case, name):
            continue
        for start, stop in gaps_in(window, spans):
            channels.setdefault((start, stop), []).append(name)
    return dict(sorted(channels.items()))
