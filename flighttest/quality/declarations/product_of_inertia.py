"""The sign of Ixz against the motion.

A rolling aeroplane with a product of inertia pitches: Iyy q_dot = (Izz - Ixx) p r - Ixz (p2 - r2) + M.  No linear aerodynamic moment
does that, so fast rolls show Ixz.  In roll and yaw Ixz cannot be distinguished from the derivatives of the aeroplane.  The coefficient
of p r is known from the three moments; only where the same fit gives it back is the other one believed.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...signals.differentiation import derivative
from ...uncertainty.coloured_residuals import coloured
from ..checks.control_response import SIGNIFICANT
from ..checks.signals import Signals, smooth
from ..finding import Finding

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

_KNOWN = 3.0  # standard errors within which the coefficient of p r must be that of the aircraft file
_SHARP = 0.25  # its standard error, and its difference from that, over itself
_OTHER_SIGN = 3.0  # standard errors within which the estimate is that of the file with the other sign
_INERTIA_RATIO = 0.5  # and part of it
_TRIM, _BAND, _MEMORY = 0.3, 1.5, 2.0  # Hz between which it is compared; s over which residuals are correlated
_COUPLING_CHANNELS = ("p", "q", "r", "alpha_vane", "delta_e")
_LATERAL = ("beta_vane", "delta_a", "delta_r")


def product_findings(signals: Signals, aircraft: Aircraft) -> tuple[list[Finding], str]:
    """Return whether Ixz of the aircraft file has the wrong sign, and why it was not checked.

    Parameters
    ----------
    signals : Signals
        Mistakes undone, sensors at the c.g.
    aircraft : Aircraft
        Ixx, Iyy, Izz, Ixz. [kg m2]
    """
    if aircraft.Ixz == 0.0:
        return [], ""
    missing = [name for name in _COUPLING_CHANNELS if name not in signals]
    if missing:
        return [], f"not recorded: {'; '.join(missing)}"
    fit = _coupling(signals, aircraft)
    if fit is None:
        return [], "too little motion"
    Ixz, stderr, known, known_stderr = fit
    if abs(aircraft.Ixz) < SIGNIFICANT * stderr:
        return [], f"the motion shows Ixz to {stderr:.2g} kg m2 only, the aircraft file has {aircraft.Ixz:.3g} kg m2"
    true = (aircraft.Izz - aircraft.Ixx) / aircraft.Iyy
    off = abs(known - true)
    if max(known_stderr, off) > _SHARP * abs(true) or off > _KNOWN * known_stderr:
        return (
            [],
            f"the coupling of roll and yaw into pitch, known to be {true:.2f}, is seen as {known:.2f} (standard error {known_stderr:.2f})",
        )
    opposite = abs(Ixz + aircraft.Ixz) < max(_OTHER_SIGN * stderr, _INERTIA_RATIO * abs(aircraft.Ixz))
    if Ixz * aircraft.Ixz > 0.0 or abs(Ixz) < SIGNIFICANT * stderr or not opposite:
        return [], ""
    text = (
        f"Ixz has the wrong sign: the aircraft file has {aircraft.Ixz:.4g} kg m2, and rolling pitches the aeroplane as "
        f"{Ixz:.4g} kg m2 does (standard error {stderr:.2g}); Ixz is the integral of x z dm"
    )
    remedy = f'Ixz = "{-aircraft.Ixz:.10g} kg m2" in the aircraft file'
    return [Finding("error", "inertia", ("Ixz",), text, remedy, evidence={"Ixz": Ixz, "stderr": stderr})], ""


def _coupling(signals: Signals, aircraft: Aircraft) -> tuple[float, float, float, float] | None:
    """Return Ixz and the coefficient of p r, each with its standard error."""
    signals = signals.completed(("V",))
    lateral = [name for name in _LATERAL if name in signals and np.ptp(signals[name]) > 0.0]
    mask = signals.mask((*_COUPLING_CHANNELS, *lateral))
    if mask.sum() * signals.step < 5.0:
        return None
    speed = np.ones_like(signals.time)
    if "V" in signals:
        middle = float(np.median(signals["V"][mask]))
        speed = np.maximum(signals["V"], 0.3 * middle) / middle
    p, q, r = (signals[name] for name in "pqr")
    # aerodynamic moments over dynamic pressure: linear in angles, controls and dimensionless rates, even in sideslip and its controls
    sides = [signals[name] for name in lateral]
    aerodynamic = [signals["alpha_vane"], signals["delta_e"], q / speed, p / speed, r / speed, *sides, *(x**2 for x in sides)]
    columns = [*aerodynamic, p * r / speed**2, (p**2 - r**2) / speed**2]
    y = derivative(q, signals.step, 5, 4 if signals.step < 0.15 else 2) / speed**2
    y, *columns = (_quick(x, signals.step)[mask] for x in (y, *columns))
    X = np.stack([x for x in columns if np.std(x) > 0.0], axis=1)
    if len(y) < 10 * X.shape[1] or min(np.std(x) for x in columns[-2:]) == 0.0:
        return None
    return _last_two(X, y, mask, signals.step, aircraft.Iyy)


def _quick(x: np.ndarray, step: float) -> np.ndarray:
    """Return what lies between trim and the band of the signals, of both sides of the equation alike."""
    return smooth(x, step, _BAND) - smooth(x, step, _TRIM)


def _last_two(X: np.ndarray, y: np.ndarray, mask: np.ndarray, step: float, Iyy: float) -> tuple[float, float, float, float] | None:
    """Return the last two coefficients of a regression with coloured residuals, as Ixz and the coefficient of p r."""
    size = X.std(axis=0)
    scaled = X / size
    if np.linalg.cond(scaled) > 1e6:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    edges = [0, *(np.flatnonzero(np.diff(np.flatnonzero(mask)) > 1) + 1).tolist(), len(y)]
    pieces = [slice(a, b) for a, b in pairwise(edges)]
    covariance = coloured(scaled, y - scaled @ theta, pieces, [step] * len(pieces), lag=_MEMORY).covariance
    (known, product), (known_stderr, stderr) = theta[-2:] / size[-2:], np.sqrt(np.diag(covariance)[-2:]) / size[-2:]
    return float(-product * Iyy), float(stderr * Iyy), float(known), float(known_stderr)
