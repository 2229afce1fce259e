"""Control loading of one control from flight: force at the hand, stretch of the cable, and the
motion that both give.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.controls import Circuit
from flightmech.errors import IdentificationError
from flighttest.regression.equation_error import least_squares
from flighttest.submodels.control_loading.joint_fit import JointFit, RecordEquations
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import CUTOFF, loading_channels
from flighttest.submodels.control_loading.regression import (
    NAMES,
    CableFit,
    SlidingFit,
    cable_fit,
    sliding_fit,
)
from flighttest.submodels.control_loading.result import DRAWINGS_ERROR, SHARED, IdentifiedLoading
from flighttest.submodels.control_loading.windows import (
    PreparedRecord,
    driven_stretches,
    force_rows,
    free_stretches,
    with_error,
)

_PASSES = 2


def identify_control_loading(
    loading: ControlLoading,
    driven: Sequence[xr.Dataset],
    free: Sequence[xr.Dataset] = (),
    order: int = 4,
    cutoff: float = CUTOFF,
    errors: Mapping[str, tuple[float, float]] | None = None,
    drawings: Circuit | None = None,
    drawings_error: float = DRAWINGS_ERROR,
) -> IdentifiedLoading:
    """Identify friction, preload, unbalance, masses, cable and hinge moments of one control.

    Parameters
    ----------
    loading : ControlLoading
        What is known: geometry of the hinge, gearing, terms.
    driven : sequence of Dataset (time,)
        Manoeuvres in which the hand moves the control slowly, at several speeds and tab settings
        *together*: at one speed, spring, unbalance and hinge moment at zero merge.  Channels of
        `motion.control_signals`.
    free : sequence of Dataset (time,)
        Pulses and releases: what moves fast enough to show masses and cable.
    order : {2, 4}
        4: two masses on a cable; 2: one mass.
    cutoff : float
        Low-pass of the driven manoeuvres. [Hz]
    errors : mapping of str to (float, float), optional
        Standard errors of the constant bias and of the scale of a channel, such as ``{"F_column":
        (1.5, 0.01)}``: no record shows them, so they are carried on into the standard errors; see
        `instruments.pick_up_errors`. [unit of the channel, 1]
    drawings : Circuit, optional
        What is known of the circuit from its drawings; it is joined as by
        `IdentifiedLoading.with_prior` and holds the mass of both ends and the inertia of the
        surface within twice their errors where the motion is lost in the noise of the pick-ups.
    drawings_error : float
        Standard error of its constants over their values. [1]

    Returns
    -------
    IdentifiedLoading

    Raises
    ------
    IdentificationError
        The control does not slide, terms cannot be distinguished, or the cable does not stretch.
    UnknownName
        A channel that a record does not hold.

    Notes
    -----
    Both equations of motion are linear in their constants while the control slides, dry friction included: inverse dynamics.  Samples at
    rest, at reversals, near neutral and next to a release are left out, since there friction and preload have no known sign.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 3.4 and 4.5.3.
    """
    if order not in (2, 4):
        raise IdentificationError(
            f"order is {order}; allowed: 2, 4 (two ailerons on two cables move as one of order 4)"
        )
    slow, quick = driven_stretches(loading, driven, cutoff), free_stretches(loading, free)
    wide = 2.0 * drawings_error
    known = _mass(loading, drawings, wide) if drawings is not None else {}
    shares = _drawn_shares(loading, drawings) if order == 4 else {}
    for _ in range(
        1 if order == 2 else 1 + _PASSES
    ):  # force and stretch in turn, each corrected by the other
        slid, force = sliding_fit(loading, slow, quick, cutoff, shares, known)
        cable = (
            None
            if order == 2
            else cable_fit(slid, slow, quick, cutoff, _drawn_cable(loading, drawings, wide))
        )
        used, shares = shares, _shares(slid, cable) if cable is not None else {}
    fit = _Fit(slid, force, cable, used)
    found = IdentifiedLoading(
        loading, slid, None if cable is None else cable.estimates, fit.estimates()
    )
    sources = _sources(loading, [*driven, *free], errors or {})
    if sources:
        found = found.with_errors(fit.changes(slow, quick, sources))
    return found.with_prior(drawings, drawings_error) if drawings is not None else found


@dataclass(frozen=True)
class _Fit:
    """Both regressions, and with which shares of the surface in friction, damping and mass the
    first was made.
    """

    slid: SlidingFit
    force: JointFit
    cable: CableFit | None
    shares: dict[str, float]

    @property
    def names(self) -> list[str]:
        return [*self.slid.loading.names, *(NAMES if self.cable is not None else ())]

    def _division(self) -> np.ndarray:
        """From friction, damping and mass of both ends to those of the cockpit end alone, (names,
        names).
        """
        T = np.eye(len(self.names))
        for total, (aft, power) in SHARED.items():
            if total in self.names and aft in self.names:
                T[self.names.index(total), self.names.index(aft)] = -(
                    abs(self.slid.loading.gearing) ** power
                )
        return T

    def estimates(self) -> xr.Dataset:
        """All constants and terms with their covariance."""
        if self.cable is None:
            return self.slid.estimates
        T, both = self._division(), (self.slid.estimates, self.cable.estimates)
        C = scipy.linalg.block_diag(*(one["covariance"].values for one in both))
        theta = np.concatenate([one["estimate"].values for one in both])
        nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(theta), 0)))
        return least_squares.regression_estimates(
            self.names, T @ theta, T @ C @ T.T, np.full(len(theta), np.nan), nothing, {}
        )

    def changes(
        self,
        slow: Sequence[PreparedRecord],
        quick: Sequence[PreparedRecord],
        sources: Sequence[tuple[str, int, float]],
    ) -> np.ndarray:
        """Return the changes of the estimates by errors of channels, (sources, names), to first
        order: those of the residuals fitted.
        """
        loading, theta = self.slid.loading, self.slid.estimates["estimate"].values
        known = [loading.names.index(loading.term(term)) for term in loading.model.terms]

        def residuals(stretches: Sequence[PreparedRecord]) -> np.ndarray:
            return np.concatenate(
                [_residual(force_rows(loading, one, self.shares), theta) for one in stretches]
            )

        as_recorded = [*slow, *quick]
        before = residuals(as_recorded)
        stretch = None if self.cable is None else self.cable.residual(as_recorded, theta[known])
        found = []
        for source in sources:
            wrong = [with_error(loading, one, *source) for one in as_recorded]
            change = self.force.estimator[:, : len(before)] @ (residuals(wrong) - before)
            if self.cable is not None:
                of_stretch = self.cable.residual(wrong, (theta + change)[known]) - stretch
                change = self._division() @ np.concatenate([change, self.cable.slopes @ of_stretch])
            found.append(change)
        return np.array(found)


def _residual(rows: RecordEquations, theta: np.ndarray) -> np.ndarray:
    return rows.z - rows.X @ theta


def _mass(
    loading: ControlLoading, drawings: Circuit, error: float
) -> dict[str, tuple[float, float]]:
    """Mass of both ends by the drawings, and its standard error."""
    total = drawings.mass + drawings.inertia * loading.gearing**2
    return {"mass": (total, error * total)} if total > 0.0 else {}


def _drawn_shares(loading: ControlLoading, drawings: Circuit | None) -> dict[str, float]:
    """Share of the surface in friction, damping and mass of both ends by the drawings, to start
    with.
    """
    if drawings is None:
        return {}
    pairs = {
        total: (getattr(drawings, total), getattr(drawings, aft) * abs(loading.gearing) ** k)
        for total, (aft, k) in SHARED.items()
    }
    return {
        total: b / (a + b)
        for total, (a, b) in pairs.items()
        if a + b > 0.0 and total in loading.names
    }


def _drawn_cable(
    loading: ControlLoading, drawings: Circuit | None, error: float
) -> tuple[float, float, float] | None:
    """Inertia of the surface and stiffness of the cables by the drawings, reduced to the travel,
    and the error of the first.
    """
    if drawings is None or not (drawings.inertia > 0.0 and drawings.cable_stiffness > 0.0):
        return None
    return (
        drawings.inertia * loading.gearing**2,
        drawings.cable_stiffness * (2.0 if drawings.order == 6 else 1.0),
        error,
    )


def _sources(
    loading: ControlLoading,
    records: Sequence[xr.Dataset],
    errors: Mapping[str, tuple[float, float]],
) -> list[tuple[str, int, float]]:
    """Channel, 0 for a bias and 1 for a scale error, and its size, of every error of a channel that
    is used.
    """
    used = {name for name in loading_channels(loading) if all(name in one for one in records)}
    return [
        (name, kind, size)
        for name, pair in errors.items()
        if name in used
        for kind, size in enumerate(pair)
        if size > 0.0
    ]


def _shares(slid: SlidingFit, cable: CableFit) -> dict[str, float]:
    """Share of the surface in friction, damping and mass of both ends, between 0 and 1."""
    found = {}
    for total, (aft, power) in SHARED.items():
        if total in slid.loading.names:
            own = (
                float(cable.estimates["estimate"].sel(term=aft))
                * abs(slid.loading.gearing) ** power
            )
            found[total] = float(np.clip(own / slid.value(total)[0], 0.0, 1.0))
    return found
