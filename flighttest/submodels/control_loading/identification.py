"""Identification of the control loading of one control from flight.

The steps are the force at the hand, the stretch of the cable, and the output error that starts from
both.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.controls import Circuit
from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.regression.equation_error import least_squares
from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.cable import NAMES, CableFit, cable_fit
from flighttest.submodels.control_loading.drawn_values import DrawnValues, drawn_constants
from flighttest.submodels.control_loading.joint_fit import JointFit, estimates_convergence
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import CUTOFF, loading_channels
from flighttest.submodels.control_loading.regression import SlidingFit, sliding_fit
from flighttest.submodels.control_loading.responses.driven_rows import DrivenRows, driven_rows
from flighttest.submodels.control_loading.responses.free_response import (
    HAND,
    FreeWindow,
    find_windows,
)
from flighttest.submodels.control_loading.responses.friction_models import fit_friction_models
from flighttest.submodels.control_loading.responses.response_fit import ResponseFit
from flighttest.submodels.control_loading.responses.window_response import WIDTHS
from flighttest.submodels.control_loading.result import DRAWINGS_ERROR, SHARED, IdentifiedLoading
from flighttest.submodels.control_loading.table_coverage import hinge_table_samples
from flighttest.submodels.control_loading.windows import (
    PreparedRecord,
    driven_stretches,
    force_rows,
    free_stretches,
    with_error,
)

BEST, REGRESSION, OUTPUT_ERROR = METHODS = ("best", "regression", "output error")
# Repetitions of both regressions, each with the shares from the other.
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
    method: str = BEST,
) -> IdentifiedLoading:
    """Identify friction, preload, unbalance, masses, cable and hinge moments of one control.

    Parameters
    ----------
    loading : ControlLoading
        Geometry of the hinge, gearing, and terms of the force.
    driven : sequence of Dataset (time,)
        Manoeuvres in which the hand moves the control slowly, at several speeds and tab settings
        *together*: at one speed, spring, unbalance and hinge moment at zero merge.  Channels of
        `motion.control_signals`.
    free : sequence of Dataset (time,)
        Pulses and releases, whose motion is fast enough to determine masses and cable.
    order : {2, 4}
        4: two masses on a cable; 2: one mass.
    cutoff : float
        Cut-off frequency of the low-pass of the driven manoeuvres. [Hz]
    errors : mapping of str to (float, float), optional
        Standard errors of the constant bias and of the scale of a channel, such as ``{"F_column":
        (1.5, 0.01)}``. No record shows them. The standard errors of the estimates contain them; see
        `instruments.pick_up_errors`. [unit of the channel, 1]
    drawings : Circuit, optional
        Circuit by its drawings. It is joined as by `IdentifiedLoading.with_prior`. It fixes the
        mass of both ends and the inertia of the surface within twice their errors, if the motion
        does not exceed the noise of the pick-ups.
    drawings_error : float
        Standard error of its constants over their values. [1]
    method : {"best", "regression", "output error"}
        The regressions alone; or the likelihood of the simulated free motion and of the driven
        stretches, started from the regressions. Without free motion both are the same. ``"best"``
        is the output error if its search converged or ended stationary, otherwise the regressions,
        whose standard errors then contain the differences between both.

    Returns
    -------
    IdentifiedLoading

    Raises
    ------
    IdentificationError
        The control does not slide, terms cannot be distinguished, or the cable does not stretch.
    UnknownName
        A record lacks a channel.

    Warns
    -----
    AeromatchWarning
        The free motion cannot be simulated; the result is that of the regressions.

    Notes
    -----
    The regressions are biased by the windows between two reversals and by derivatives of noise;
    the output error has neither, see `output_error`.

    Both equations of motion are linear in their constants while the control slides, dry friction
    included: inverse dynamics.  Samples at rest, at reversals, near neutral and next to a release
    are excluded, since friction and preload have no certain sign there.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 3.4 and 4.5.3.
    """
    if method not in METHODS:
        raise IdentificationError(f"method is {method!r}; allowed: {', '.join(METHODS)}")
    if order not in (2, 4):
        raise IdentificationError(
            f"order is {order}; allowed: 2, 4 (two ailerons on two cables move as one of order 4)"
        )
    slow, quick = driven_stretches(loading, driven, cutoff), free_stretches(loading, free)
    drawn = DrawnValues.of_circuit(loading, drawings, 2.0 * drawings_error)
    if order == 2:
        slid, force = sliding_fit(loading, slow, quick, cutoff=cutoff, aft={}, known=drawn.mass)
        fit = _Regressions(slid, force, cable=None, shares={})
        iterations = {"weights of the force": force.convergence}
    else:
        fit, iterations = _fit_with_cable(loading, slow, quick, cutoff=cutoff, drawn=drawn)
    stretch = None if fit.cable is None else fit.cable.estimates
    identified = IdentifiedLoading(
        loading,
        fit.slid,
        cable=stretch,
        estimates=fit.estimates(),
        iterations=iterations,
        sampled=hinge_table_samples(loading, [*slow, *quick]),
    )
    sources = _error_sources(loading, [*driven, *free], errors or {})
    stops = None if drawings is None else drawings.stops
    windows = [] if method == REGRESSION else find_windows(loading, free, stops)
    response: IdentifiedLoading | None = None
    if windows:
        try:
            response = _fit_responses(
                identified,
                _Records(slow, list(free), cutoff, stops),
                sources=sources,
                drawings=drawings,
                error=drawings_error,
            )
        except IdentificationError as error:
            text = f"{loading.item}: the result is that of the regressions, because {error}"
            warnings.warn(text, AeromatchWarning, stacklevel=2)
    if response is not None and (method == OUTPUT_ERROR or response.is_maximum):
        return response
    if sources:
        identified = identified.with_errors(fit.changes(slow, quick, sources))
    if drawings is not None:
        identified = identified.with_prior(drawings, drawings_error)
    return identified if response is None else identified.instead_of(response)


class _Records(NamedTuple):
    """Records of an output error: driven ones prepared, free ones as recorded."""

    driven: list[PreparedRecord]
    free: list[xr.Dataset]
    cutoff: float
    stops: tuple[float, float] | None

    def pieces(
        self, loading: ControlLoading, has_cable: bool, source: tuple[str, int, float] | None
    ) -> tuple[list[FreeWindow], list[DrivenRows]]:
        """Return windows and rows, with an error of a channel if a source is given."""
        driven, free = self.driven, self.free
        if source is not None:
            driven = [with_error(loading, record, *source) for record in driven]
        # The windows are those of the records without the error.
        windows = find_windows(loading, free, self.stops, source)
        return windows, driven_rows(loading, driven, self.cutoff, has_cable)


def _fit_responses(
    started: IdentifiedLoading,
    records: _Records,
    sources: Sequence[tuple[str, int, float]],
    drawings: Circuit | None,
    error: float,
) -> IdentifiedLoading:
    """Return the output error that starts from regressions."""
    loading, has_cable = started.loading, started.cable is not None
    names = [str(name) for name in started.estimates["term"].values]
    # Constants of the drawings move a start that the regressions leave open.
    joined = started if drawings is None else started.with_prior(drawings, error)
    start = {name: joined.value(name)[0] for name in names}
    # Nuisances that are not part of the result.
    start = {**start, HAND: 0.0} if has_cable else {**start, "rigging": 0.0, HAND: 0.0}
    prior = drawn_constants(started, drawings, error)
    windows, rows = records.pieces(loading, has_cable, None)
    friction = fit_friction_models(loading, windows, rows, start, prior)
    fit, covariance = friction.fit, friction.fit.covariance
    changes = []
    for source in sources:
        changes.append(fit.change(*records.pieces(loading, has_cable, source)))
    if changes:
        covariance = covariance + np.transpose(changes) @ np.array(changes)
    k = [fit.names.index(name) for name in names]
    no_errors: tuple[list[str], np.ndarray] = ([], np.zeros((len(k), 0)))
    estimates = least_squares.regression_estimates(
        names,
        fit.theta[k],
        covariance[np.ix_(k, k)],
        white=np.full(len(k), np.nan),
        systematic=no_errors,
        extra={},
    )
    iterations: dict[str, Convergence] = {}
    return replace(
        started,
        estimates=estimates,
        iterations=iterations,
        response=ResponseFit(
            convergence=fit.convergence,
            windows=len(windows),
            rms=fit.rms,
            hand_damping=fit.value(HAND),
            widths={name: fit.value(name) for name in WIDTHS if name in fit.names},
            friction_models=friction.weights,
            widened=friction.widened,
            maxima=friction.maxima,
            widened_by_maxima=friction.widened_by_maxima,
            stationary_within=fit.stationary_within,
            unfinished=friction.unfinished,
        ),
    )


def _fit_with_cable(
    loading: ControlLoading,
    slow: Sequence[PreparedRecord],
    quick: Sequence[PreparedRecord],
    cutoff: float,
    drawn: DrawnValues,
) -> tuple[_Regressions, dict[str, Convergence]]:
    """Fit force and stretch in turn, each corrected by the other; return the ends of all passes."""
    shares = drawn.shares
    passes: list[xr.Dataset] = []
    for _ in range(1 + _PASSES):
        slid, force = sliding_fit(loading, slow, quick, cutoff=cutoff, aft=shares, known=drawn.mass)
        cable = cable_fit(slid, slow, quick, cutoff=cutoff, drawn=drawn.cable)
        fit = _Regressions(slid, force, cable=cable, shares=shares)
        shares = _shares(slid, cable)
        passes.append(fit.estimates())
    iterations = {
        "weights of the force": force.convergence,
        **cable.iterations,
        "shares of the surface": _passes_convergence(passes),
    }
    return fit, iterations


@dataclass(frozen=True)
class _Regressions:
    """Both regressions, and the shares of the surface in the constants of the first."""

    slid: SlidingFit
    force: JointFit
    cable: CableFit | None
    shares: dict[str, float]

    @property
    def names(self) -> list[str]:
        return [*self.slid.loading.names, *(NAMES if self.cable is not None else ())]

    def _division(self) -> np.ndarray:
        """Return the matrix (names, names) that divides friction, damping and mass.

        It leads from the values of both ends to those of the cockpit end.
        """
        T = np.eye(len(self.names))
        for total, (aft, power) in SHARED.items():
            if total in self.names and aft in self.names:
                T[self.names.index(total), self.names.index(aft)] = -(
                    abs(self.slid.loading.gearing) ** power
                )
        return T

    def estimates(self) -> xr.Dataset:
        """Return all constants and terms with their covariance."""
        if self.cable is None:
            return self.slid.estimates
        T, both = self._division(), (self.slid.estimates, self.cable.estimates)
        C = scipy.linalg.block_diag(*(part["covariance"].values for part in both))
        theta = np.concatenate([part["estimate"].values for part in both])
        no_errors: tuple[list[str], np.ndarray] = ([], np.zeros((len(theta), 0)))
        return least_squares.regression_estimates(
            self.names,
            T @ theta,
            T @ C @ T.T,
            white=np.full(len(theta), np.nan),
            systematic=no_errors,
            extra={},
        )

    def changes(
        self,
        slow: Sequence[PreparedRecord],
        quick: Sequence[PreparedRecord],
        sources: Sequence[tuple[str, int, float]],
    ) -> np.ndarray:
        """Return the changes of the estimates by errors of channels, (sources, names).

        They are of first order: the changes of the residuals, fitted.
        """
        loading, theta = self.slid.loading, self.slid.estimates["estimate"].values
        hinge = [loading.names.index(loading.term(term)) for term in loading.model.terms]

        def residuals(records: Sequence[PreparedRecord]) -> np.ndarray:
            rows = [force_rows(loading, record, self.shares) for record in records]
            return np.concatenate([part.z - part.X @ theta for part in rows])

        as_recorded = [*slow, *quick]
        before = residuals(as_recorded)
        stretch = None if self.cable is None else self.cable.residual(as_recorded, theta[hinge])
        changes = []
        for source in sources:
            wrong = [with_error(loading, record, *source) for record in as_recorded]
            change = self.force.estimator[:, : len(before)] @ (residuals(wrong) - before)
            if self.cable is not None:
                # The stretch changes by the error itself and by the changed hinge moments.
                of_stretch = self.cable.residual(wrong, (theta + change)[hinge]) - stretch
                change = self._division() @ np.concatenate([change, self.cable.slopes @ of_stretch])
            changes.append(change)
        return np.array(changes)


def _passes_convergence(passes: Sequence[xr.Dataset]) -> Convergence:
    """Return the end of the passes over both regressions from the estimates of each pass."""
    last = passes[-1]
    # A single pass shows no change, so it has not converged.
    change = np.full(last.sizes["term"], np.inf)
    if len(passes) > 1:
        change = last["estimate"].values - passes[-2]["estimate"].values
    return estimates_convergence(
        change, last["estimate"].values, stderr=last["stderr"].values, iterations=len(passes)
    )


def _error_sources(
    loading: ControlLoading,
    records: Sequence[xr.Dataset],
    errors: Mapping[str, tuple[float, float]],
) -> list[tuple[str, int, float]]:
    """Return channel, kind (0 bias, 1 scale error) and size of every error of a used channel."""
    used = set()
    for name in loading_channels(loading):
        if all(name in record for record in records):
            used.add(name)
    sources = []
    for name, pair in errors.items():
        for kind, size in enumerate(pair):
            if name in used and size > 0.0:
                sources.append((name, kind, size))
    return sources


def _shares(slid: SlidingFit, cable: CableFit) -> dict[str, float]:
    """Return the share of the surface in friction, damping and mass of both ends, 0 to 1."""
    shares = {}
    for total, (aft, power) in SHARED.items():
        if total in slid.loading.names:
            surface = float(cable.estimates["estimate"].sel(term=aft))
            surface *= abs(slid.loading.gearing) ** power
            shares[total] = float(np.clip(surface / slid.value(total)[0], 0.0, 1.0))
    return shares
