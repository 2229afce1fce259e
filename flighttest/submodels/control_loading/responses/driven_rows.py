"""Driven stretches as pieces of a likelihood: travel in, force at the hand and stretch out.

The samples are those in which the control slides, behind the low-pass of `motion`.  The low-pass
leaves two independent samples per period of its cut-off; others are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.support.arrays import true_runs
from flighttest.submodels.control_loading.loading import FORCES, ControlLoading
from flighttest.submodels.control_loading.responses.free_response import HAND
from flighttest.submodels.control_loading.windows import PreparedRecord

# Size of an output in parts of its range.
_PART = 1e-3
# Constants of the surface in the force at the hand: signal, and power of the gearing.
_OF_SURFACE = {
    "hinge_friction": ("aft_direction", 1),
    "hinge_damping": ("aft_rate", 2),
    "inertia": ("aft_acceleration", 2),
}


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
        Forces on the surface end by constant.
    step : float
        Sampling interval. [s]
    gearing : float
        d(delta)/ds.
    """

    measured: np.ndarray
    scale: np.ndarray
    force: dict[str, np.ndarray]
    surface: dict[str, np.ndarray]
    step: float
    gearing: float

    def predict(self, named: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return both outputs (samples, 2, runs) for values (runs,) of the constants."""
        runs = len(named["offset"])
        F = np.zeros((len(self.measured), runs))
        for name, x in self.force.items():
            F += x[:, None] * named[name]
        pull = np.zeros_like(F)
        for name, x in self.surface.items():
            pull += x[:, None] * named[name]
        # Without a cable only the rigging parts both ends.
        stretch = pull / named.get("cable_stiffness", 1.0) - named["rigging"] / self.gearing
        return np.stack([F, stretch], axis=1) / self.scale[:, None]


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
        every = max(1, round(0.5 / cutoff / record.step))
        for start, stop in true_runs(np.asarray(record.used)):
            rows = slice(start + (stop - start - 1) % every // 2, stop, every)
            stretches.append(
                DrivenRows(
                    measured=z[rows] / scale,
                    scale=scale,
                    force={name: x[rows] for name, x in force.items()},
                    surface={name: x[rows] for name, x in surface.items()},
                    step=every * record.step,
                    gearing=loading.gearing,
                )
            )
    return stretches


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
    return force | surface, hinge | surface
