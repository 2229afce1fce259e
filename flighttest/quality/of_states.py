"""Findings about manoeuvres that are about to be fitted: states and controls at the c.g. instead of a recorder's channels."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

from ..record import manoeuvres
from .answers import answer_findings, answers, hands
from .excitation import correlations, excitation, excitation_findings
from .finding import Finding, without_consequences
from .kinematics import kinematic_findings
from .repairs import explain
from .signals import signals_of

_SEEN = {"alpha": "alpha_vane", "beta": "beta_vane", "ax": "ax_imu", "ay": "ay_imu", "az": "az_imu", "h": "h_baro"}
_LEAF = "manoeuvre"
_SURE_GAIN = 0.5  # disagreement that a mistake must explain in a manoeuvre, twice that of a whole flight
_MOVED = 1.0 * DEGREE  # of a surface, below which a manoeuvre does not tell its sign


def findings_of(states: xr.Dataset) -> list[Finding]:
    """Return what is wrong with the states and controls of a manoeuvre.

    Parameters
    ----------
    states : Dataset (time,)
        House names, SI, at the c.g., on a uniform clock.

    Returns
    -------
    list of Finding
        Signs, units and axes of what kinematics tie together; signs of the surfaces by the answer of the aeroplane; no excitation;
        inputs that move together.
    """
    record = _as_record(states)
    signals = signals_of(record, pd.DataFrame(columns=["leaf", "channel", "kind", "start", "stop"]))
    explanations, mended, comparisons = explain(signals)
    if any(sum(e.before) - sum(e.after) < _SURE_GAIN for e in explanations):  # seconds of small motion explain themselves by anything
        explanations, mended, comparisons = [], signals, {}
    answered = answers(mended)
    found = kinematic_findings(explanations, comparisons, mended, record)
    found += answer_findings(answered[answered["movement"] > _MOVED], hands(mended), mended, record)
    found += excitation_findings(excitation(mended), correlations(mended), mended, manoeuvres(record), "")
    return without_consequences(found)


def _as_record(states: xr.Dataset) -> xr.DataTree:
    """Return the states as a record whose sensors sit at the c.g., under the names of the channels that show them."""
    whole = [str(name) for name, x in states.data_vars.items() if x.dims == ("time",) and x.dtype.kind == "f" and x.notnull().any()]
    leaf = states[[name for name in whole if name not in _SEEN.values()]].rename({name: seen for name, seen in _SEEN.items() if name in whole})
    time = states["time"].values.astype(float)
    return xr.DataTree.from_dict({f"/{_LEAF}": leaf.assign_attrs(rate=(len(time) - 1) / (time[-1] - time[0]))})


def demand_sound(flown: Sequence[xr.Dataset], names: Sequence[str]) -> None:
    """Refuse manoeuvres whose signs, units or axes are wrong; warn of missing excitation and of inputs that move together.

    Parameters
    ----------
    flown : sequence of Dataset (time,)
    names : sequence of str
        What to call them.

    Raises
    ------
    SchemaError
        With every error found, by name.

    Warns
    -----
    AeromatchWarning
        Each warning by name.
    """
    problems = []
    for states, name in zip(flown, names):
        for finding in findings_of(states):
            remedy = f"; {finding.remedy}" if finding.remedy and finding.severity != "error" else ""
            text = f"{name}: {finding.name}: {finding.text}{remedy}"
            if finding.severity == "error":
                problems.append(text)
            elif finding.severity == "warning":
                warnings.warn(text, AeromatchWarning, stacklevel=2)
    if problems:
        raise SchemaError("records", [f"{text}; mend the name map and reconstruct again" for text in problems])
