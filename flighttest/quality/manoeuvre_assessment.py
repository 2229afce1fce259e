"""Findings about manoeuvres that are about to be fitted: states and controls at the c.g. instead of a recorder's channels."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

from ..records.record import manoeuvres
from ..signals.conditioning import GAP
from .checks.control_response import answer_findings, answers, hands
from .checks.excitation import correlations, excitation, excitation_findings
from .checks.kinematic_findings import kinematic_findings
from .checks.mistake_search import explain
from .checks.signals import signals_of
from .finding import Finding, without_consequences

_SEEN = {"alpha": "alpha_vane", "beta": "beta_vane", "ax": "ax_imu", "ay": "ay_imu", "az": "az_imu", "h": "h_baro"}
_PRESSURE = ("p_static", "q_c")  # they belong to pressure height, and h is geometric
_LEAST = 50  # samples of a stretch that is informative
_JOINT = ("excitation", "collinear")
_LEAF = "manoeuvre"
_CERTAIN_GAIN = 0.5  # disagreement that a mistake must explain in a manoeuvre, twice that of a whole flight
_MOVED = 1.0 * DEGREE  # of a surface, below which a manoeuvre does not determine its sign


def findings_of(states: xr.Dataset) -> list[Finding]:
    """Return what is wrong with the states and controls of a manoeuvre.

    Parameters
    ----------
    states : Dataset (time,)
        Canonical names, SI, at the c.g.; stretches between gaps are looked at one by one, and what one excites is excited.

    Returns
    -------
    list of Finding
        Signs, units and axes of what kinematics tie together; signs of the surfaces by the answer of the aeroplane; no excitation;
        inputs that move together.
    """
    time = states["time"].values
    edges = [0, *(np.flatnonzero(np.diff(time) > GAP * np.median(np.diff(time))) + 1).tolist(), len(time)]
    stretches = [states.isel(time=slice(a, b)) for a, b in pairwise(edges) if b - a > _LEAST]
    found = [_of_stretch(stretch) for stretch in stretches]
    return [finding for findings in found for finding in findings if finding.kind not in _JOINT or finding.name in _in_all(found)]


def _in_all(found: Sequence[Sequence[Finding]]) -> set[str]:
    """Return the names of the findings that every one of several lists holds."""
    return set.intersection(*({finding.name for finding in findings} for findings in found)) if found else set()


def _of_stretch(states: xr.Dataset) -> list[Finding]:
    """Return the findings of a stretch without gaps."""
    record = _as_record(states)
    signals = signals_of(record, pd.DataFrame(columns=["leaf", "channel", "kind", "start", "stop"]))
    explanations, corrected, comparisons = explain(signals)
    if any(sum(e.before) - sum(e.after) < _CERTAIN_GAIN for e in explanations):  # seconds of small motion explain themselves by anything
        explanations, corrected, comparisons = [], signals, {}
    answered = answers(corrected)
    found = kinematic_findings(explanations, comparisons, corrected, record)
    found += answer_findings(answered[answered["movement"] > _MOVED], hands(corrected), corrected, record)
    found += excitation_findings(excitation(corrected), correlations(corrected), corrected, manoeuvres(record), "")
    return without_consequences(found)


def _as_record(states: xr.Dataset) -> xr.DataTree:
    """Return the states as a record whose sensors sit at the c.g., under the names of the channels that show them."""
    whole = [str(name) for name, x in states.data_vars.items() if x.dims == ("time",) and x.dtype.kind == "f" and x.notnull().any()]
    leaf = states[[name for name in whole if name not in (*_SEEN.values(), *_PRESSURE)]]
    leaf = leaf.rename({name: seen for name, seen in _SEEN.items() if name in leaf})
    time = states["time"].values.astype(float)
    return xr.DataTree.from_dict({f"/{_LEAF}": leaf.assign_attrs(rate=(len(time) - 1) / (time[-1] - time[0]))})


def report_faults(flown: Sequence[xr.Dataset], names: Sequence[str], known: Sequence[str] = ()) -> None:
    """Refuse manoeuvres whose signs, units or axes are wrong; warn of missing excitation and of inputs that move together.

    What no manoeuvre excites, and inputs that move together in all of them, are reported once.

    Parameters
    ----------
    flown : sequence of Dataset (time,)
    names : sequence of str
        What to call them.
    known : sequence of str
        Kinds of findings that are not reported: ``excitation`` where the fit itself refuses what does not move.

    Raises
    ------
    SchemaError
        With every error found, by name.

    Warns
    -----
    AeromatchWarning
        Each warning by name.
    """
    found = [findings_of(states) for states in flown]
    problems = [
        f"{name}: {finding.name}: {finding.text}; correct the name map and reconstruct again"
        for name, findings in zip(names, found)
        for finding in findings
        if finding.severity == "error"
    ]
    everywhere = _in_all(found)
    reported: set[str] = set()
    for name, finding in ((name, finding) for name, findings in zip(names, found) for finding in findings):
        alone = finding.kind not in _JOINT or finding.name in everywhere  # what one manoeuvre lacks another may have
        if finding.severity == "warning" and finding.kind not in known and alone and finding.name not in reported:
            reported.add(finding.name)
            warnings.warn(f"{name}: {finding.name}: {finding.text}; {finding.remedy}", AeromatchWarning, stacklevel=2)
    if problems:
        raise SchemaError("records", problems)
