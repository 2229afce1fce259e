"""Control loading of one control from flight: force at the hand, stretch of the cable, and the motion that both give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.aircraft.systems.control_circuits import Circuit
from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from .cable import NAMES, cable_fit
from .loading import ControlLoading
from .motion import CUTOFF, channels
from .regression import SlidingFit, sliding_fit
from .result import DRAWINGS_ERROR, SHARED, IdentifiedLoading

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
        Manoeuvres in which the hand moves the control slowly, at several speeds and tab settings *together*: at one speed, spring,
        unbalance and hinge moment at zero merge.  Channels of `motion.signals`.
    free : sequence of Dataset (time,)
        Pulses and releases: what moves fast enough to show masses and cable.
    order : {2, 4}
        4: two masses on a cable; 2: one mass.
    cutoff : float
        Low-pass of the driven manoeuvres. [Hz]
    errors : mapping of str to (float, float), optional
        Standard errors of the constant bias and of the scale of a channel, such as ``{"F_column": (1.5, 0.01)}``: no record shows them,
        so they are carried on into the standard errors; see `instruments.pick_up_errors`. [unit of the channel, 1]
    drawings : Circuit, optional
        What is known of the circuit from its drawings; it is joined as by `IdentifiedLoading.with_prior` and holds the mass of both ends
        within twice its error where the motion is lost in the noise of the pick-ups.
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
        raise IdentificationError(f"order is {order}; allowed: 2, 4 (two ailerons on two cables move as one of order 4)")
    known = _mass(loading, drawings, 2.0 * drawings_error) if drawings is not None else {}
    found = _fitted(loading, driven, free, order, cutoff, known, _drawn_shares(loading, drawings) if order == 4 else None)
    shares = None if found.cable is None else _shares(found.slid, found.cable)
    changes = []
    for channel, kind, size in _sources(loading, [*driven, *free], errors or {}):
        moved, moved_free = ([_changed(one, channel, kind, size) for one in group] for group in (driven, free))
        other = _once(loading, moved, moved_free, order, cutoff, shares, known)
        changes.append(other.estimates["estimate"].values - found.estimates["estimate"].values)
    found = found.with_errors(np.array(changes)) if changes else found
    return found.with_prior(drawings, drawings_error) if drawings is not None else found


def _mass(loading: ControlLoading, drawings: Circuit, error: float) -> dict[str, tuple[float, float]]:
    """Mass of both ends by the drawings, and its standard error."""
    total = drawings.mass + drawings.inertia * loading.gearing**2
    return {"mass": (total, error * total)} if total > 0.0 else {}


def _drawn_shares(loading: ControlLoading, drawings: Circuit | None) -> dict[str, float] | None:
    """Share of the surface in friction, damping and mass of both ends by the drawings, to start with."""
    if drawings is None:
        return None
    pairs = {total: (getattr(drawings, total), getattr(drawings, aft) * abs(loading.gearing) ** k) for total, (aft, k) in SHARED.items()}
    return {total: b / (a + b) for total, (a, b) in pairs.items() if a + b > 0.0 and total in loading.names}


def _fitted(loading, driven, free, order: int, cutoff: float, known, shares: Mapping[str, float] | None) -> IdentifiedLoading:
    """Fit force and stretch in turn, each corrected by the other."""
    found = _once(loading, driven, free, order, cutoff, shares, known)
    for _ in range(_PASSES if found.cable is not None else 0):
        assert found.cable is not None
        found = _once(loading, driven, free, order, cutoff, _shares(found.slid, found.cable), known)
    return found


def _once(loading, driven, free, order: int, cutoff: float, shares: Mapping[str, float] | None, known) -> IdentifiedLoading:
    slid = sliding_fit(loading, driven, free, cutoff, shares, known)
    if order == 2:
        return IdentifiedLoading(loading, slid, None, slid.estimates)
    cable = cable_fit(slid, driven, free, cutoff)
    return IdentifiedLoading(loading, slid, cable, _divided(slid, cable))


def _sources(
    loading: ControlLoading, records: Sequence[xr.Dataset], errors: Mapping[str, tuple[float, float]]
) -> list[tuple[str, int, float]]:
    """Channel, 0 for a bias and 1 for a scale error, and its size, of every error of a channel that is used."""
    used = {name for name in channels(loading) if all(name in one for one in records)}
    return [(name, kind, size) for name, pair in errors.items() if name in used for kind, size in enumerate(pair) if size > 0.0]


def _changed(one: xr.Dataset, channel: str, kind: int, size: float) -> xr.Dataset:
    return one.assign({channel: one[channel] * (1.0 + size) if kind else one[channel] + size})


def _shares(slid: SlidingFit, cable: xr.Dataset) -> dict[str, float]:
    """Share of the surface in friction, damping and mass of both ends, between 0 and 1."""
    found = {}
    for total, (aft, power) in SHARED.items():
        if total in slid.loading.names:
            own = float(cable["estimate"].sel(term=aft)) * abs(slid.loading.gearing) ** power
            found[total] = float(np.clip(own / slid.value(total)[0], 0.0, 1.0))
    return found


def _divided(slid: SlidingFit, cable: xr.Dataset) -> xr.Dataset:
    """Estimates with friction, damping and mass of the cockpit end alone."""
    names = [*slid.loading.names, *NAMES]
    count = len(slid.loading.names)
    T = np.eye(len(names))
    for total, (aft, power) in SHARED.items():
        if total in names:
            T[names.index(total), names.index(aft)] = -(abs(slid.loading.gearing) ** power)
    C = np.zeros((len(names), len(names)))
    C[:count, :count], C[count:, count:] = slid.estimates["covariance"].values, cable["covariance"].values
    theta = np.concatenate([slid.estimates["estimate"].values, cable["estimate"].values])
    nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(names), 0)))
    return least_squares.estimates(names, T @ theta, T @ C @ T.T, np.full(len(names), np.nan), nothing, {})
