"""Driven stretches as pieces of a likelihood: travel in, force at the hand and stretch out.

The samples are those in which the control slides, behind the low-pass of `motion`.  The low-pass
leaves two independent samples per period of its cut-off; others are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flightmech.support.arrays import true_runs
from flighttest.submodels.control_loading.loading import FORCES, ControlLoading
from flighttest.submodels.control_loading.responses.free_response import HAND
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
    PRELOAD_TRAVEL,
    lower_slopes,
    raise_widths,
)
from flighttest.submodels.control_loading.windows import PreparedRecord

# Size of an output in parts of its range.
_PART = 1e-3
# Forces that develop over a width: signal, width, and number of outputs in which they are.
_SMOOTH = {
    "preload": ("travel", PRELOAD_TRAVEL, 1),
    "friction": ("rate", FRICTION_RATE, 1),
    "hinge_friction": ("rate", FRICTION_RATE, 2),
}
# Constants of the surface in the force at the hand: signal, and power of the gearing.
_OF_SURFACE = {
    "hinge_friction": ("aft_direction", 1),
    "hinge_damping": ("aft_rate", 2),
    "inertia": ("aft_acceleration", 2),
}
# Constant of the cable, whose force acts on the stretch alone.
_CABLE_DAMPING = "cable_damping"


@dataclass(frozen=True)
class DrivenRows:
    """Samples of one stretch in which the control slides.

    Attributes
    ----------
    measured : array (samples, 2)
        Force at the hand and stretch of the cable, over `scale`.
    scale : array (2,)
        Sizes of both. [N or N m; m or rad]
    force : dict of str to array (samples,)
        Regressors of the force by constant.
    surface : dict of str to array (samples,)
        Forces on the surface end that the spring of the cable carries, by constant.
    travel, rate : array (samples,)
        Travel, and its rate. [m or rad, and per second]
    slid : array (samples,)
        Travel since the last reversal, with the sign of the rate. [m or rad]
    step : float
        Sampling interval. [s]
    gearing : float
        d(delta)/ds.
    """

    measured: np.ndarray
    scale: np.ndarray
    force: dict[str, np.ndarray]
    surface: dict[str, np.ndarray]
    travel: np.ndarray
    rate: np.ndarray
    slid: np.ndarray
    step: float
    gearing: float


@dataclass(frozen=True)
class DrivenPiece:
    """Rows with the names of the common unknowns."""

    rows: DrivenRows
    names: tuple[str, ...]

    @property
    def measured(self) -> np.ndarray:
        """Force at the hand and stretch of the cable over `DrivenRows.scale`, (samples, 2)."""
        return self.rows.measured

    @property
    def step(self) -> float:
        """Sampling interval. [s]"""
        return self.rows.step

    @cached_property
    def _force(self) -> np.ndarray:
        """Regressors of the force, (samples, names), without friction and preload."""
        return self._columns(self.rows.force)

    @cached_property
    def _surface(self) -> np.ndarray:
        """Regressors of the force on the surface end, (samples, names), without friction."""
        return self._columns(self.rows.surface)

    def _columns(self, regressors: Mapping[str, np.ndarray]) -> np.ndarray:
        X = np.zeros((len(self.rows.measured), len(self.names)))
        for k, name in enumerate(self.names):
            if name in regressors and name not in _SMOOTH:
                X[:, k] = regressors[name]
        return X

    def _smooth_forces(self, at: Mapping[str, float]) -> list[_SmoothForce]:
        """Return friction of both ends and preload."""
        forces = []
        for name, (signal, width, outputs) in _SMOOTH.items():
            if name not in at:
                continue
            if width not in at:
                signal, width = "slid", BRISTLE_TRAVEL
            factor = abs(self.rows.gearing) if name == "hinge_friction" else 1.0
            x = getattr(self.rows, signal) / at[width]
            curve, slope = (_bristle if width == BRISTLE_TRAVEL else _tangent)(x)
            forces.append(
                _SmoothForce(
                    name, width, outputs, factor=factor, part=x, curve=curve, curve_slope=slope
                )
            )
        return forces

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return both outputs, (samples, 2)."""
        values = raise_widths(self.names, values)
        at = dict(zip(self.names, values))
        forces = np.column_stack([self._force @ values, self._surface @ values])
        for force in self._smooth_forces(at):
            forces[:, : force.outputs] += (at[force.name] * force.factor * force.curve)[:, None]
        # Without a cable only the rigging parts both ends.
        stretch = forces[:, 1] / at.get("cable_stiffness", 1.0) - at["rigging"] / self.rows.gearing
        return np.column_stack([forces[:, 0], stretch]) / self.rows.scale

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the derivatives (samples, 2, names), which are exact."""
        values = raise_widths(self.names, values)
        at, index = dict(zip(self.names, values)), self.names.index
        S = np.stack([self._force, self._surface], axis=1)
        pull = self._surface @ values
        for force in self._smooth_forces(at):
            own = slice(0, force.outputs)
            part = force.factor * force.curve
            S[:, own, index(force.name)] += part[:, None]
            by_width = -at[force.name] * force.factor * force.curve_slope * force.part
            S[:, own, index(force.width)] += (by_width / at[force.width])[:, None]
            if force.outputs > 1:
                pull = pull + at[force.name] * part
        if "cable_stiffness" in at:
            K = at["cable_stiffness"]
            S[:, 1] /= K
            S[:, 1, index("cable_stiffness")] -= pull / K**2
        S[:, 1, index("rigging")] -= 1.0 / self.rows.gearing
        return lower_slopes(self.names, values, S / self.rows.scale[:, None])


class _SmoothForce(NamedTuple):
    """A force F f(x / width): its name, that of the width, outputs, x / width, f and its slope."""

    name: str
    width: str
    outputs: int
    factor: float
    part: np.ndarray
    curve: np.ndarray
    curve_slope: np.ndarray


def _tangent(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return tanh and its slope."""
    t = np.tanh(x)
    return t, 1.0 - t**2


def _bristle(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the deflection of a bristle after a reversal from full deflection, and its slope."""
    left = 2.0 * np.exp(-np.abs(x))
    return np.sign(x) * (1.0 - left), left


def driven_rows(
    loading: ControlLoading,
    records: Sequence[PreparedRecord],
    cutoff: float,
    has_cable: bool,
) -> list[DrivenRows]:
    """Return every stretch of the driven records in which the control slides.

    Parameters
    ----------
    loading : ControlLoading
    records : sequence of PreparedRecord
        As from `driven_stretches`.
    cutoff : float
        Cut-off frequency of their low-pass. [Hz]
    has_cable : bool
        Whether the circuit has a cable (order 4).
    """
    outputs = [_outputs(loading, record) for record in records]
    span = np.ptp(np.concatenate(outputs), axis=0)
    scale = _PART * np.where(span > 0.0, span, 1.0)
    stretches = []
    for record, z in zip(records, outputs):
        force, surface = _regressors(loading, record, has_cable)
        slid = _travel_since_reversal(record.moved["travel"].values, -force[HAND])
        every = max(1, round(0.5 / cutoff / record.step))
        for start, stop in true_runs(np.asarray(record.used)):
            rows = slice(start + (stop - start - 1) % every // 2, stop, every)
            stretches.append(
                DrivenRows(
                    measured=z[rows] / scale,
                    scale=scale,
                    force={name: x[rows] for name, x in force.items()},
                    surface={name: x[rows] for name, x in surface.items()},
                    travel=record.moved["travel"].values[rows],
                    rate=-force[HAND][rows],
                    slid=slid[rows],
                    step=every * record.step,
                    gearing=loading.gearing,
                )
            )
    return stretches


def _travel_since_reversal(travel: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the travel since the last change of sign of the rate, with its sign, (samples,)."""
    signs = np.sign(rate)
    starts = np.maximum.accumulate(
        np.where(np.append(True, signs[1:] != signs[:-1]), np.arange(len(rate)), 0)
    )
    return signs * np.abs(travel - travel[starts])


def _outputs(loading: ControlLoading, record: PreparedRecord) -> np.ndarray:
    """Return force and stretch of a record, (time, 2)."""
    moved = record.moved
    aft = moved[loading.deflection].values / loading.gearing
    return np.column_stack([moved[f"F_{loading.item}"].values, moved["travel"].values - aft])


def _regressors(
    loading: ControlLoading, record: PreparedRecord, has_cable: bool
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the regressors of the force at the hand, and of the force on the surface end."""
    moved = {str(name): x.values for name, x in record.moved.data_vars.items()}
    # Both ends move alike in slow motion.  With a noisy derivative of each, least squares would
    # take what their noises have in common, which is nothing, for the mass.
    stretching = moved["rate"] - moved["aft_rate"]
    fore, aft = record.white
    share = fore / (fore + aft) if fore + aft > 0.0 else 0.5
    for name in ("rate", "acceleration"):
        mean = (1.0 - share) * moved[name] + share * moved[f"aft_{name}"]
        moved[name] = moved[f"aft_{name}"] = mean
    force = {name: FORCES[name](moved) for name in loading.constants}
    by_term = loading.load(record.moved)[:, None] * loading.model.design(record.moved)
    hinge = {}
    for name, x in zip(loading.model.terms, by_term.T):
        hinge[loading.term(name)] = x
    # A driving hand leaves a part of the force proportional to the rate out of the record.
    force |= hinge | {HAND: -moved["rate"]}
    if not has_cable:
        return force, {}
    surface = {}
    for name, (signal, power) in _OF_SURFACE.items():
        surface[name] = abs(loading.gearing) ** power * moved[signal]
    # The damper of the cable carries a part of the load while the load rises.
    damper = {_CABLE_DAMPING: -stretching}
    return force | surface, hinge | surface | damper
