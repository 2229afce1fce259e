"""Faulty samples of the records in the windows that identify something, left out or stated."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import xarray as xr

from aeromatch.project.project import Project
from aeromatch.workflow.windows import (
    AERODYNAMIC,
    SHORTEST,
    IdentificationWindows,
    Spans,
    raise_problems,
)
from flightmech.quantities import time_text
from flighttest.records.sensors.instruments import IMU
from flighttest.records.signals.clock_gaps import BRIDGED
from pom.cases.case import PomCase
from pom.cases.reference_states import refusal_of
from pom.checking.case_check import SampleFault

_INFORMING = frozenset(
    {
        *("p", "q", "r", "ax_imu", "ay_imu", "az_imu", "alpha_vane", "beta_vane"),
        *("V", "V_cas", "mach", "q_c", "qbar", "p_static"),
        *("delta_e", "delta_a", "delta_a_left", "delta_a_right", "delta_r", "delta_f"),
    }
)
"""Channels whose faulty samples are cut out: motion, flow and surfaces."""
_ENTERING = (
    *("thrust", "gross_thrust", "ram_drag", "n1", "n2", "torque", "rpm"),
    *("mass", "I", "x_cg", "y_cg", "z_cg"),
    *("gear", "speedbrake", "delta_", "i_h", "h_radio"),
)
"""Beginnings of the names of further channels that enter coefficients or regressors.

They change slowly or in steps, so that a fault of them is stated and stays.
"""
_FAULT_WORDS = {
    "held": "held values of",
    "missing": "missing values of",
    "outside": "values outside the calibration of",
    "lost": "samples lost in",
}
_INERTIAL = frozenset((*IMU, "phi", "theta"))
_MARGIN = 0.5  # [s] reach of the filters and derivatives behind the coefficients


def without_faults(
    project: Project,
    windows: IdentificationWindows,
    faults: Mapping[str, Sequence[SampleFault]],
) -> tuple[IdentificationWindows, list[str]]:
    """Return windows without faulty samples, and a line for each fault in a window.

    A held value, a missing one, or a line through a gap informs a fit as a measured value does.
    The windows of the fits, of the ground effect and of the stall are cut.  Engine, controls and
    landing gear follow a transient from its start, which a cut would take away.  Their faults are
    stated and stay, as do those of thrust, mass and devices.

    Parameters
    ----------
    project : Project
    windows : IdentificationWindows
    faults : mapping of str to sequence of SampleFault
        By record.

    Returns
    -------
    windows : IdentificationWindows
        A stalled part behind a cut starts with steady separation, which takes about the time
        constant of the separation to be right.
    texts : list of str

    Raises
    ------
    SchemaError
        A fit, the ground effect or the stall has no time left in a record.
    """
    texts: dict[str, None] = {}
    problems: list[str] = []

    def cut(position: str, spans_by_record: Spans) -> Spans:
        kept: Spans = {}
        for record, spans in spans_by_record.items():
            place = f"{position}, record {record}"
            kept[record], lines = _cut_faults(place, spans, faults.get(record, ()))
            texts.update(dict.fromkeys(lines))
            if spans and not kept[record]:
                problems.append(
                    f"{place}: its windows hold faulty samples throughout; choose other windows"
                )
        return kept

    fits = []
    for fit, spans_by_record in zip(project.fit, windows.fits, strict=True):
        fits.append(cut(f"fit {fit.name!r}", spans_by_record))
    submodels: dict[str, Spans] = {}
    for position, spans_by_record in windows.submodels.items():
        submodels[position] = spans_by_record
        if position.startswith(AERODYNAMIC):
            submodels[position] = cut(position, spans_by_record)
            continue
        for record, spans in spans_by_record.items():
            lines = _kept_faults(f"{position}, record {record}", spans, faults.get(record, ()))
            texts.update(dict.fromkeys(lines))
    raise_problems(project, problems)
    return replace(windows, fits=fits, submodels=submodels), list(texts)


def _cut_faults(
    place: str, spans: Sequence[tuple[float, float]], faults: Sequence[SampleFault]
) -> tuple[list[tuple[float, float]], list[str]]:
    """Return the parts of windows without faulty samples, and a line for each fault in them."""
    parts, texts = list(spans), []
    others = []
    for fault in faults:
        words = _fault_words(fault)
        if not words:
            others.append(fault)
            continue
        cut = _cut_out(parts, fault.start - _MARGIN, fault.stop + _MARGIN)
        if cut != parts:
            parts = cut
            text = f"{place}: {words} left out, with {_MARGIN:g} s on both sides"
            # a gap ends the stretch that is reconstructed
            if not _ends_states(fault):
                text += "; the reconstruction of the states still uses them"
            texts.append(text)
    entering = []
    for fault in others:
        channels = [name for name in fault.channels if _enters(name)]
        if channels:
            entering.append(fault._replace(channels=tuple(channels)))
    return parts, [*texts, *_kept_faults(place, parts, entering)]


def _ends_states(fault: SampleFault) -> bool:
    """Return whether the states are reconstructed on both sides of a fault by themselves."""
    is_long = fault.stop - fault.start > BRIDGED
    # Blank cells end a stretch as lost rows do.  The reconstruction refuses a record in which some
    # inertial channels alone are blank.
    is_blank = fault.kind == "missing" and _INERTIAL.issuperset(fault.channels)
    return is_long and (is_blank or (fault.kind == "gap" and "p" in fault.channels))


def unflown_cases(
    cases: Iterable[PomCase],
    faults: Mapping[str, Sequence[SampleFault]],
    states_of: Callable[[str], xr.Dataset],
) -> dict[str, str]:
    """Return the cases that no model can fly, with the reason.

    Parameters
    ----------
    cases : iterable of PomCase
    faults : mapping of str to sequence of SampleFault
        By record. Only a record with a gap or blank cells can refuse a case.
    states_of : callable
        From the name of a record to the states of its path (time,).

    Returns
    -------
    dict of str to str
        By name of the case: what `pom.cases.reference_states.refusal_of` states of it.
    """
    texts = {}
    for case in cases:
        record = Path(case.record).stem
        has_gap = any(fault.kind in ("gap", "missing") for fault in faults.get(record, ()))
        reason = refusal_of(case, states_of(record)) if has_gap else ""
        if reason:
            texts[case.name] = f"case {case.name}: not diagnosed, and {reason}"
    return texts


def _enters(channel: str) -> bool:
    """Return whether a channel outside `_INFORMING` enters coefficients or regressors."""
    return channel.rpartition(".")[2].startswith(_ENTERING)


def _kept_faults(
    place: str, spans: Sequence[tuple[float, float]], faults: Sequence[SampleFault]
) -> list[str]:
    """Return a line for each fault that stays in windows."""
    texts = []
    for fault in faults:
        if any(start <= fault.stop and fault.start <= stop for start, stop in spans):
            words = _fault_text(fault, fault.channels)
            texts.append(
                f"{place}: {words} not left out; choose windows without them if they count"
            )
    return texts


def list_faults(faults: Mapping[str, Sequence[SampleFault]]) -> list[str]:
    """Return a line for each record with faulty samples; the parameter is as `without_faults`."""
    lines = []
    for record, items in faults.items():
        words = dict.fromkeys(map(_fault_words, items))
        listed = ", ".join(filter(None, words))
        if listed:
            lines.append(f"{record}: {listed}")
    return lines


def _fault_words(fault: SampleFault) -> str:
    """Return a fault in words; empty for channels that inform no fit."""
    channels = _INFORMING.intersection(fault.channels)
    return _fault_text(fault, channels) if channels else ""


def _fault_text(fault: SampleFault, channels: Iterable[str]) -> str:
    """Return kind, channels and time of a fault in words."""
    place = f"from {time_text(fault.start)} to {time_text(fault.stop)} s"
    # a gap concerns all groups of channels of a recorder
    if fault.kind == "gap":
        return f"gap in the clock {place}"
    return f"{_FAULT_WORDS[fault.kind]} {', '.join(sorted(channels))} {place}"


def _cut_out(
    spans: Sequence[tuple[float, float]], start: float, stop: float
) -> list[tuple[float, float]]:
    """Return the parts of windows outside an interval, as far as they are long enough. [s]"""
    parts: list[tuple[float, float]] = []
    for first, last in spans:
        if stop <= first or last <= start:
            parts.append((first, last))
            continue
        sides = (first, start), (stop, last)
        parts += [side for side in sides if side[1] - side[0] >= SHORTEST]
    return parts
