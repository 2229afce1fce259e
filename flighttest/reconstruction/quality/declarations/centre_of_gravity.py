"""Centre of gravity of an aircraft file against the mean chord and against the recorded one.

A wrong unit, sign or origin moves the c.g. off the chord.  An error of a tenth of the chord stays
on it, and kinematics hold about any point of the body: only a second statement shows it.
"""

from __future__ import annotations

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.geometry import is_airship
from flighttest.reconstruction.quality.finding import Finding

# Place on the mean chord behind its leading edge: aeroplanes fly at 0.1 to 0.4, canards and
# tailless ones further off. [chords]
_CHORD, _CHORD_CERTAIN = (0.0, 0.6), (-0.5, 1.2)
_AGREE = 0.05  # chords along x by which file and record may differ: fuel and load
_AGREE_ACROSS = 0.15  # the same along y and z, which fuel and load move more
_RECORDED = ("x_cg_b", "y_cg_b", "z_cg_b")
_ROW = ("cg", "c.g. along x, to a tenth of the chord")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


def centre_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on the centre of gravity, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        x_cg_b, y_cg_b, z_cg_b from the moment reference point, forward, right, down. [m]
    aircraft : Aircraft
        cg and cbar [m], x_ref_mac [1].
    """
    if is_airship(aircraft):
        return [], []
    findings: list[Finding] = []
    recorded = _recorded_place(signals)
    findings += _chord_findings(aircraft, float(aircraft.cg[0]), "cg", "the aircraft file")
    if "x_cg_b" in recorded:
        findings += _chord_findings(aircraft, recorded["x_cg_b"], "x_cg_b", "the record")
    if not findings:
        findings += _difference_findings(aircraft, recorded)
    both = "x_cg_b" in recorded
    source = "aircraft file and record agree" if both else "not recorded: x_cg_b"
    reason = (
        f"{source}; kinematics hold about any point of the body, and the static margin shows the "
        f"c.g. only with a neutral point that is known: compare with the loading sheet"
    )
    return findings, [(*_ROW, () if both else ("x_cg_b",), reason)]


def _recorded_place(signals: ResampledChannels) -> dict[str, float]:
    """Return the medians in flight of the recorded coordinates. [m]"""
    place = {}
    for name in _RECORDED:
        if name in signals and signals.mask((name,)).any():
            place[name] = float(np.median(signals[name][signals.mask((name,))]))
    return place


def _chord_findings(aircraft: Aircraft, x: float, channel: str, source: str) -> list[Finding]:
    # x is positive forward, the place on the chord backward from its leading edge
    place = aircraft.x_ref_mac - x / aircraft.cbar
    if _CHORD[0] <= place <= _CHORD[1]:
        return []
    severity = "warning"
    if not _CHORD_CERTAIN[0] <= place <= _CHORD_CERTAIN[1]:
        severity = "error"
    text = (
        f"the c.g. of {source} is at {place:.0%} of the mean chord (x = {x:+.3g} m from the moment "
        f"reference point at {aircraft.x_ref_mac:.0%}; aeroplanes have {_CHORD[0]:.0%} to "
        f"{_CHORD[1]:.0%}): unit, sign or origin are wrong; x is positive forward"
    )
    remedy = "give the c.g. forward, right and down of the moment reference point, with its unit"
    evidence = {"place": place}
    return [Finding(severity, "geometry", (channel,), text, remedy, evidence=evidence)]


def _difference_findings(aircraft: Aircraft, recorded: dict[str, float]) -> list[Finding]:
    """Return the finding on a c.g. of the file that is not the recorded one."""
    apart = []
    for name, stated in zip(_RECORDED, aircraft.cg, strict=True):
        limit = _AGREE if name == "x_cg_b" else _AGREE_ACROSS
        if name in recorded and abs(recorded[name] - stated) > limit * aircraft.cbar:
            axis = name[0]
            apart.append(f"{axis} = {stated:.3f} m in the file and {recorded[name]:.3f} m recorded")
    if not apart:
        return []
    text = (
        f"the c.g. of the aircraft file is not the recorded one: {'; '.join(apart)} (mean chord "
        f"{aircraft.cbar:.3f} m); the recorded one has priority where it is used"
    )
    remedy = "correct cg in the aircraft file, or the columns of the c.g. in the name map"
    return [Finding("warning", "geometry", ("cg", *recorded), text, remedy)]
