"""Control loading of one control from flight: force at the hand, stretch of the cable, and the motion that both give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from .cable import NAMES, cable_fit
from .loading import ControlLoading
from .motion import CUTOFF
from .regression import SlidingFit, sliding_fit
from .result import IdentifiedLoading

_PASSES = 2
_SHARED = {"friction": ("hinge_friction", 1), "damping": ("hinge_damping", 2), "mass": ("inertia", 2)}  # and power of the gearing


def identify_control_loading(
    loading: ControlLoading, driven: Sequence[xr.Dataset], free: Sequence[xr.Dataset] = (), order: int = 4, cutoff: float = CUTOFF
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
    slid = sliding_fit(loading, driven, free, cutoff)
    if order == 2:
        return IdentifiedLoading(loading, slid, None, slid.estimates)
    cable = cable_fit(slid, driven, free, cutoff)
    for _ in range(_PASSES):
        aft = [float(cable["estimate"].sel(term=name)) * loading.gearing**2 for name in ("inertia", "hinge_damping")]
        slid = sliding_fit(loading, driven, free, cutoff, (aft[0], aft[1]))
        cable = cable_fit(slid, driven, free, cutoff)
    return IdentifiedLoading(loading, slid, cable, _divided(slid, cable))


def _divided(slid: SlidingFit, cable: xr.Dataset) -> xr.Dataset:
    """Estimates with friction, damping and mass of the cockpit end alone."""
    names = [*slid.loading.names, *NAMES]
    count = len(slid.loading.names)
    T = np.eye(len(names))
    for total, (aft, power) in _SHARED.items():
        if total in names:
            T[names.index(total), names.index(aft)] = -(abs(slid.loading.gearing) ** power)
    C = np.zeros((len(names), len(names)))
    C[:count, :count], C[count:, count:] = slid.estimates["covariance"].values, cable["covariance"].values
    theta = np.concatenate([slid.estimates["estimate"].values, cable["estimate"].values])
    nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(names), 0)))
    return least_squares.estimates(names, T @ theta, T @ C @ T.T, np.full(len(names), np.nan), nothing, {})
