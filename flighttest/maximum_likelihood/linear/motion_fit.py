"""Fit of a linear motion to reconstructed paths, without a database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.maximum_likelihood.linear.filter_error import filter_error
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust
from flighttest.maximum_likelihood.linear.motions import (
    Motion,
    Steady,
    linear_motion,
    motion_of,
    start_values,
    steady_condition,
    trim_of,
)
from flighttest.maximum_likelihood.linear.output_error import linear_output_error
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.remarks import PrintedResult, Remark, remarks_to_json

DISTURBANCES = ("none", "process", "gusts", "both")
ANGLES = ("vane", "inertial")
_SCALE, _INTENSITY = 150.0, 1.0  # start of the gusts [m], [m/s]
_STIRRED = 0.1  # start of the process noise, of the rms of a state, per square root of second
STEADY = 0.1  # largest change of airspeed of a linear motion, of its mean
_SMALL = 0.15  # largest change of an angle of the airflow and of bank [rad]


@dataclass(frozen=True)
class MotionFit(PrintedResult):
    """Derivatives of a linear motion.

    Attributes
    ----------
    fit : OutputError
    motion : str
        ``short-period`` or ``lateral``.
    steady : Steady
        Mean condition of the records.
    held : tuple of str
        Controls that do not move, without derivatives.
    notes : tuple of Remark
        On the condition of the records.
    """

    fit: OutputError
    motion: str
    steady: Steady
    held: tuple[str, ...]
    notes: tuple[Remark, ...]

    @property
    def remarks(self) -> list[Remark]:
        """Remarks of the fit, and on the condition of the records."""
        return [*self.fit.remarks, *self.notes]

    def report_lines(self) -> list[str]:
        """Return condition, estimates and noise as lines."""
        V, alpha, theta = self.steady
        lines = [
            f"{self.motion}, mean V {V:.1f} m/s, alpha {np.degrees(alpha):.2f} deg, theta "
            f"{np.degrees(theta):.2f} deg; derivatives per second, angles in rad"
        ]
        if self.held:
            lines.append(f"do not move, and have no derivatives: {', '.join(self.held)}")
        return [*lines, *self.fit.report_lines()]

    def as_dict(self) -> dict[str, Any]:
        """Return condition, estimates, noise and remarks as JSON types."""
        return {
            "motion": self.motion,
            "steady": self.steady._asdict(),
            "held": list(self.held),
            **self.fit.as_dict(),
            "remarks": remarks_to_json(self.remarks),
        }


def fit_motion(
    records: Sequence[xr.Dataset],
    motion: str,
    disturbance: str = "none",
    angle: str = "",
    scale: float | None = None,
    constraints: Sequence[str] = (),
    span: float = 0.0,
) -> MotionFit:
    """Estimate the dimensional derivatives of a linear motion.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        Reconstructed manoeuvres about one condition, with ``V alpha theta`` and the states, the
        specific force and the controls of the motion on a uniform ``time``. [SI]
    motion : {"short-period", "lateral"}
    disturbance : {"none", "process", "gusts", "both"}
        Noise of instruments alone (output error), with white process noise, with Dryden gusts, or
        with both (filter error).
    angle : {"vane", "inertial"}
        Source of the angle of the airflow in the records; gusts need it.
    scale : float, optional
        Scale of the gusts; it is estimated without it. [m]
    constraints : sequence of str
        Linear constraints among the derivatives, as of `linear_output_error`.
    span : float
        Span of the wing, by which the air of the gusts rotates; 0: it does not. The factor on its
        rotation is then an unknown, ``turn.w`` or ``turn.v``. [m]

    Raises
    ------
    ValueError
        An unknown motion or disturbance, gusts without the source of the angle, or a span without
        gusts.
    UnknownName
        A signal that a record does not have.
    SchemaError, IdentificationError
        As `filter_error`; controls that do not move.
    """
    kind = motion_of(motion)
    if disturbance not in DISTURBANCES:
        raise ValueError(f"disturbance is {disturbance!r}; allowed: {', '.join(DISTURBANCES)}")
    has_gusts = disturbance in ("gusts", "both")
    if has_gusts and angle not in ANGLES:
        raise ValueError(
            f"the source of {kind.angle} is {angle!r}; gusts need it: {', '.join(ANGLES)}"
        )
    if span and not has_gusts:
        raise ValueError(
            f"span is {span:g} m, but disturbance is {disturbance!r}; only gusts rotate: give "
            f"disturbance 'gusts' or 'both', or no span"
        )
    demand_signals(records, ("V", "alpha", "theta", *kind.states, kind.force, *kind.controls))
    moving = []
    for name in kind.controls:
        if any(np.ptp(record[name].values) > 0.0 for record in records):
            moving.append(name)
    if not moving:
        raise IdentificationError(
            f"{', '.join(kind.controls)} do not move; choose a window with an input"
        )
    steady = steady_condition(records)
    model = linear_motion(kind, steady, moving, trim_of(kind, moving, records))
    wanted = start_values(model, kind, records)
    if disturbance in ("process", "both"):
        wanted |= _process_starts(records, kind)
    gusts = []
    if has_gusts:
        gust = _motion_gust(kind, steady, angle, _SCALE if scale is None else scale)
        gusts = [replace(gust, span=span)]
        wanted[f"gust.{gusts[0].name}"] = Unknown(_INTENSITY)
        if scale is None:
            wanted[f"scale.{gusts[0].name}"] = Unknown(_SCALE)
        if span:
            wanted[f"turn.{gusts[0].name}"] = Unknown(1.0)
    if disturbance == "none":
        fit = linear_output_error(model, records, wanted, constraints=constraints)
    else:
        fit = filter_error(model, records, wanted, gusts=gusts, constraints=constraints)
    # A prediction of another record needs the motion and its condition with the derivatives.
    about = {"motion": motion, "span": span, **steady._asdict()}
    fit = replace(fit, estimates=fit.estimates.assign_attrs(about))
    held = tuple(name for name in kind.controls if name not in moving)
    notes = tuple(_list_notes(records, steady, kind.angle))
    return MotionFit(fit, motion, steady, held, notes)


def _process_starts(records: Sequence[xr.Dataset], motion: Motion) -> dict[str, Unknown]:
    """Return the process noise of the states as unknowns."""
    starts = {}
    for name in motion.states:
        spread = float(np.concatenate([record[name].values for record in records]).std())
        starts[f"process.{name}"] = Unknown(_STIRRED * spread)
    return starts


def _motion_gust(motion: Motion, steady: Steady, angle: str, scale: float) -> DrydenGust:
    """Return the gust of a motion: the accelerometer feels it, and a vane measures it."""
    is_vane = angle == "vane"
    return DrydenGust(
        state=motion.angle,
        speed=steady.V,
        scale=scale,
        intensity=_INTENSITY,
        air_relative=(motion.angle, motion.force) if is_vane else (motion.force,),
        inertial=() if is_vane else (motion.angle,),
        name="w" if motion.angle == "alpha" else "v",
    )


def demand_signals(records: Sequence[xr.Dataset], names: Sequence[str]) -> None:
    """Raise for a signal that a record does not have, or that is not finite."""
    problems = []
    for number, record in enumerate(records, start=1):
        for name in dict.fromkeys(names):
            if name not in record:
                raise UnknownName(
                    name, map(str, record.data_vars), "signal", f"record {number} does not hold it"
                )
            if not np.isfinite(record[name].values).all():
                problems.append(f"{name} of record {number} is not finite; choose another window")
    if problems:
        raise SchemaError("records", problems)


def _list_notes(records: Sequence[xr.Dataset], steady: Steady, angle: str) -> list[Remark]:
    """Return remarks on records that leave the condition of a linear motion."""
    notes = []
    V = np.concatenate([record["V"].values for record in records])
    change = float(np.ptp(V) / steady.V)
    if change > STEADY:
        text = (
            f"V changes by {change:.0%} of its mean: dimensional derivatives change with it; "
            f"choose windows about one condition, or fit the simulation (flight fit)"
        )
        notes.append(Remark("range", text, "V", change, STEADY))
    for name in (angle, *(["phi"] if angle == "beta" else [])):
        x = np.concatenate([record[name].values for record in records])
        largest = float(np.abs(x - x.mean()).max())
        if largest > _SMALL:
            text = (
                f"{name} leaves its mean by {np.degrees(largest):.0f} deg: the linear motion holds "
                f"for small angles"
            )
            notes.append(Remark("range", text, name, largest, _SMALL))
    return notes
