"""Disturbances of a fit by kind: unknowns and gusts that records and outputs suggest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust
from flighttest.maximum_likelihood.unknowns import Unknown

DISTURBANCE_KINDS = ("none", "process", "gusts", "both")
ANGLE_SOURCES = ("vane", "inertial")
GUST_NAMES = {"alpha": "w", "beta": "v"}  # of the gusts of an angle
START_SCALE, START_INTENSITY = 150.0, 1.0  # [m], [m/s]
_STIRRED = 0.1  # start of the process noise, of the rms of a state, per square root of second
# states that white noise drives, and outputs that belong to the same motion
_MOTIONS = (
    (("alpha", "q"), {"alpha", "q", "theta", "az", "nz", "q_dot", "CL", "Cm"}),
    (("beta", "p", "r"), {"beta", "p", "r", "phi", "ay", "p_dot", "r_dot", "CY", "Cl", "Cn"}),
)
_AIR_QUANTITIES = ("V", "alpha", "beta")


class Disturbances(NamedTuple):
    """Unknowns of process noise and gusts, and the gusts."""

    unknowns: dict[str, Unknown]
    gusts: list[DrydenGust]


def choose_disturbances(
    kind: str,
    records: Sequence[xr.Dataset],
    outputs: Sequence[str],
    angle: str = "",
    scale: float | None = None,
) -> Disturbances:
    """Return the disturbances of the motions that the outputs show.

    Parameters
    ----------
    kind : {"none", "process", "gusts", "both"}
        White noise in the rates of alpha and q, or beta, p and r; Dryden gusts across the path; or
        both.
    records : sequence of Dataset (time,)
        With ``V`` for gusts, and the disturbed states for process noise. [SI]
    outputs : sequence of str
    angle : {"vane", "inertial"}
        Source of V, alpha and beta in the records; gusts need it.
    scale : float, optional
        Scale of the gusts; it is estimated without it. [m]

    Raises
    ------
    ValueError
        An unknown kind, gusts without the source of the angle, or a scale that is not positive.
    UnknownName
        A signal that a record does not have.
    SchemaError
        Outputs that show neither the longitudinal nor the lateral motion.
    """
    if kind not in DISTURBANCE_KINDS:
        raise ValueError(f"process noise is {kind!r}; allowed: {', '.join(DISTURBANCE_KINDS)}")
    if kind == "none":
        return Disturbances({}, [])
    if scale is not None and not (np.isfinite(scale) and scale > 0.0):
        raise ValueError(f"the scale of the gusts is {scale:g}; give a positive length in metres")
    disturbed = [states for states, shown in _MOTIONS if shown & set(outputs)]
    if not disturbed:
        text = (
            f"outputs {', '.join(outputs)} show neither the longitudinal nor the lateral motion; "
            f"add alpha, q, az or beta, p, r, ay"
        )
        raise SchemaError("process noise", [text])
    unknowns: dict[str, Unknown] = {}
    gusts = []
    if kind in ("process", "both"):
        for name in chain.from_iterable(disturbed):
            spread = float(np.nanstd(_join_signal(records, name)))
            unknowns[f"process.{name}"] = Unknown(_STIRRED * spread)
    if kind in ("gusts", "both"):
        if angle not in ANGLE_SOURCES:
            raise ValueError(
                f"the source of the angles is {angle!r}; gusts need it: {', '.join(ANGLE_SOURCES)}"
            )
        inertial = _AIR_QUANTITIES if angle == "inertial" else ()
        speed = float(np.nanmean(_join_signal(records, "V")))
        for state in (states[0] for states in disturbed):
            gust = DrydenGust(
                state=state,
                speed=speed,
                scale=START_SCALE if scale is None else scale,
                intensity=START_INTENSITY,
                air_relative=(),
                inertial=inertial,
                name=GUST_NAMES[state],
            )
            gusts.append(gust)
            unknowns[f"gust.{gust.name}"] = Unknown(gust.intensity)
            if scale is None:
                unknowns[f"scale.{gust.name}"] = Unknown(gust.scale)
    return Disturbances(unknowns, gusts)


def _join_signal(records: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """Return a signal of all records, one after the other."""
    parts = []
    for number, record in enumerate(records, start=1):
        if name not in record:
            raise UnknownName(
                name, map(str, record.data_vars), "signal", f"record {number} does not hold it"
            )
        parts.append(np.ravel(record[name].values.astype(float)))
    return np.concatenate(parts)
