"""Faults of the states and controls of manoeuvres, before a fit uses them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_findings import answer_findings
from flighttest.reconstruction.quality.checks.control_response import (
    control_responses,
    pilot_to_surface,
)
from flighttest.reconstruction.quality.checks.excitation import (
    axis_excitation,
    excitation_findings,
    input_correlations,
)
from flighttest.reconstruction.quality.checks.kinematic_consistency import kinematic_findings
from flighttest.reconstruction.quality.checks.mistake_search import find_mistakes
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.finding import Finding, without_consequences
from flighttest.records.record import marked_manoeuvres
from flighttest.records.signals.resampling import GAP

# Channels that show a state, for sensors at the c.g.
_SENSORS = {
    "alpha": "alpha_vane",
    "beta": "beta_vane",
    "ax": "ax_imu",
    "ay": "ay_imu",
    "az": "az_imu",
    "h": "h_baro",
}
# Pressures belong to pressure height, and the height of the states is geometric.
_PRESSURES = ("p_static", "q_c")
_LEAST = 50  # samples of an informative stretch
# Kinds of findings that matter only if all manoeuvres have them.
_JOINT = ("excitation", "collinear")
_LEAF = "manoeuvre"
# Disagreement that a mistake must explain in a manoeuvre: twice the value for a complete flight.
_CERTAIN_GAIN = 0.5
_LEAST_MOVEMENT = 1.0 * DEGREE  # of a surface, below which a manoeuvre does not determine its sign
_SAMPLE_FAULTS = ["leaf", "channel", "kind", "start", "stop"]


def findings_of(states: xr.Dataset) -> list[Finding]:
    """Return the findings on states and controls of a manoeuvre.

    Parameters
    ----------
    states : Dataset (time,)
        Canonical names, SI, at the c.g. Stretches between gaps are checked one by one. An axis is
        excited if one stretch excites it.

    Returns
    -------
    list of Finding
        Signs, units and axes that contradict kinematics, signs of surfaces that contradict the
        response of the aeroplane, axes without excitation, and inputs that move together.
    """
    by_stretch = [_stretch_findings(stretch) for stretch in _split_at_gaps(states)]
    common = _common_names(by_stretch)
    findings = []
    for stretch_findings in by_stretch:
        for finding in stretch_findings:
            if finding.kind not in _JOINT or finding.name in common:
                findings.append(finding)
    return findings


def _split_at_gaps(states: xr.Dataset) -> list[xr.Dataset]:
    """Return the informative stretches between gaps in time."""
    time = states["time"].values
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    stretches = []
    for start, stop in pairwise([0, *gaps.tolist(), len(time)]):
        if stop - start > _LEAST:
            stretches.append(states.isel(time=slice(start, stop)))
    return stretches


def _common_names(lists: Sequence[Sequence[Finding]]) -> set[str]:
    """Return the names of the findings that are in every list."""
    if not lists:
        return set()
    common = {finding.name for finding in lists[0]}
    for findings in lists[1:]:
        common &= {finding.name for finding in findings}
    return common


def _stretch_findings(states: xr.Dataset) -> list[Finding]:
    """Return the findings of a stretch without gaps."""
    record = _as_record(states)
    signals = resample_channels(record, pd.DataFrame(columns=_SAMPLE_FAULTS))
    explanations, corrected, comparisons = find_mistakes(signals)
    # Almost any mistake explains a few seconds of small motion.
    gains = [sum(mistake.before) - sum(mistake.after) for mistake in explanations]
    if any(gain < _CERTAIN_GAIN for gain in gains):
        explanations, corrected, comparisons = [], signals, {}
    responses = control_responses(corrected)
    responses = responses[responses["movement"] > _LEAST_MOVEMENT]
    findings = kinematic_findings(explanations, comparisons, signals=corrected, record=record)
    findings += answer_findings(responses, pilot_to_surface(corrected), corrected, record)
    findings += excitation_findings(
        axis_excitation(corrected),
        input_correlations(corrected),
        corrected,
        marked_manoeuvres(record),
        "",
    )
    return without_consequences(findings)


def _as_record(states: xr.Dataset) -> xr.DataTree:
    """Return the states as a record with sensors at the c.g."""
    names = []
    for name, item in states.data_vars.items():
        is_signal = item.dims == ("time",) and item.dtype.kind == "f"
        # A sensor or a pressure in the states would be in contradiction with its state.
        is_replaced = name in _PRESSURES or name in _SENSORS.values()
        if is_signal and not is_replaced and item.notnull().any():
            names.append(str(name))
    leaf = states[names]
    leaf = leaf.rename({name: sensor for name, sensor in _SENSORS.items() if name in leaf})
    time = states["time"].values.astype(float)
    rate = (len(time) - 1) / (time[-1] - time[0])
    return xr.DataTree.from_dict({f"/{_LEAF}": leaf.assign_attrs(rate=rate)})


def report_faults(
    flown: Sequence[xr.Dataset], names: Sequence[str], known: Sequence[str] = ()
) -> None:
    """Refuse manoeuvres with wrong signs, units or axes, and warn of poor inputs.

    A missing excitation of an axis and inputs that move together are reported once, and only if all
    manoeuvres have them.

    Parameters
    ----------
    flown : sequence of Dataset (time,)
        States and controls of the manoeuvres.
    names : sequence of str
        Names of the manoeuvres in messages.
    known : sequence of str
        Kinds of findings that are not reported, for example ``excitation`` if the fit itself
        refuses inputs that do not move.

    Raises
    ------
    SchemaError
        A manoeuvre has an error. The message names all errors.
    ValueError
        The numbers of manoeuvres and names differ.

    Warns
    -----
    AeromatchWarning
        Each warning by name.
    """
    if len(names) != len(flown):
        raise ValueError(f"{len(names)} names for {len(flown)} manoeuvres; give one name for each")
    by_manoeuvre = [findings_of(states) for states in flown]
    common = _common_names(by_manoeuvre)
    problems = []
    reported = set()
    for name, findings in zip(names, by_manoeuvre, strict=True):
        for finding in findings:
            if finding.severity == "error":
                problems.append(
                    f"{name}: {finding.name}: {finding.text}; correct the name map and "
                    f"reconstruct again"
                )
            if finding.severity != "warning" or finding.kind in known:
                continue
            # Another manoeuvre may have the input that this one lacks.
            is_relevant = finding.kind not in _JOINT or finding.name in common
            if not is_relevant or finding.name in reported:
                continue
            reported.add(finding.name)
            warnings.warn(
                f"{name}: {finding.name}: {finding.text}; {finding.remedy}",
                AeromatchWarning,
                stacklevel=2,
            )
    if problems:
        raise SchemaError("records", problems)
