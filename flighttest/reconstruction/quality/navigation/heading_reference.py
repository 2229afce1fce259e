"""Reference of the heading: true north, and gyros.

Accelerometers turned by the heading must give the acceleration of the ground velocity.  A constant
error of the heading turns all accelerations by the same angle, in any wind.  Magnetic heading
differs from true heading by the declination.  Changes of the heading must be those of the gyros.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flightmech.support.arrays import true_runs
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.relation_sides import heading_rate
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding
from flighttest.reconstruction.quality.navigation.inertial_fit import integrate
from flighttest.reconstruction.quality.navigation.inertial_motion import MotionFits
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked, is_determined

_OFFSET, _SIGMAS = 2.0 * DEGREE, 3.0  # constant error that is reported, and standard errors on it
_KNOWN = 1.5 * DEGREE  # standard error up to which the constant error counts as checked
_LEAST_ERROR = 0.1 * DEGREE
# length of a stretch [s] and rms difference from the gyros [rad] that is a wandering compass. Gyros
# drift more over a long stretch.
_WANDER = ((60.0, 0.6 * DEGREE), (150.0, 1.0 * DEGREE), (400.0, 1.6 * DEGREE))
_SHORTEST = 15.0  # s
_TURN = 0.2  # rad of turning in a stretch, from which on a scale error of the gyro is removed too
_TITLE = "heading: true or magnetic north"
_ROW = ("heading_reference", _TITLE)


def heading_reference_findings(
    fits: MotionFits, signals: ResampledChannels
) -> tuple[list[Finding], Unchecked]:
    """Return the finding on a heading that is not true heading, and what was not checked.

    Parameters
    ----------
    fits : MotionFits
        Of ground velocity.
    signals : ResampledChannels
        Without mistakes.
    """
    if "psi" not in signals:
        return [], []
    missing = tuple(name for name in ("vn", "ve") if name not in signals)
    if missing:
        return [], [(*_ROW, missing, f"not recorded: {'; '.join(missing)}")]
    measured = _heading_error(fits)
    if measured is None or measured[1] > _KNOWN:
        reason = (
            "too little acceleration over ground: a turn, or a change of speed, shows a constant "
            "error of psi (magnetic heading)"
        )
        return [], [(*_ROW, (), reason)]
    error, stderr = measured
    if abs(error) < _OFFSET + _SIGMAS * stderr:
        return [], []
    text = (
        f"psi is {abs(error) / DEGREE:.1f} deg too {'large' if error > 0.0 else 'small'} "
        f"(standard error {stderr / DEGREE:.1f} deg) by the accelerations over ground: it is "
        f"magnetic heading or that of a grid, and psi is true heading"
    )
    remedy = (
        f"add {-error / DEGREE:+.1f} deg to psi in the name map (offset), or the declination of "
        "the "
        f"place, positive east"
    )
    evidence = {"error": error, "stderr": stderr}
    return [
        Finding("warning", "definition", ("psi", "vn", "ve"), text, remedy, evidence=evidence)
    ], []


def compass_findings(signals: ResampledChannels) -> tuple[list[Finding], Unchecked]:
    """Return the finding on a heading that wanders against the gyros, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes and delays.

    Notes
    -----
    psi - integral of (q sin(phi) + r cos(phi))/cos(theta), less a straight line (bias of the gyros)
    and, in turns, a share of the turn (scale error).
    """
    needs = ("psi", "phi", "theta", "q", "r")
    if not set(needs) <= set(signals.values):
        return [], []
    mask = signals.mask(needs)
    turned = integrate(heading_rate(signals)[1], signals.step)
    difference = signals["psi"] - turned
    for length, limit in _WANDER:
        wander = _rms_wander(difference, turned, mask, step=signals.step, length=length)
        if wander is not None and wander > limit:
            text = (
                f"psi wanders by {wander / DEGREE:.1f} deg rms against the gyros within "
                f"{length:.0f} s, beyond a drift and a scale error of the gyros: a compass that is "
                f"disturbed or sticks"
            )
            remedy = (
                "give psi a noise of this size, or leave it out; the reconstruction integrates the "
                "gyros"
            )
            evidence = {"rms": wander, "length": length}
            channels = ("psi", "q", "r")
            finding = Finding("warning", "inconsistent", channels, text, remedy, evidence=evidence)
            return [finding], []
    seconds = float(mask.sum()) * signals.step
    if seconds > _WANDER[0][0]:
        return [], []
    reason = f"{seconds:.0f} s of flight; a compass that wanders more slowly looks like a drift"
    return [], [("compass", "heading that wanders slowly", (), reason)]


def _heading_error(fits: MotionFits) -> tuple[float, float] | None:
    """Return psi less the true heading, and its standard error [rad]; None if not determined.

    With the true heading psi - d, vn_dot = cos(d) n + sin(d) e and ve_dot = cos(d) e - sin(d) n, n
    and e being the accelerations along north and east of psi.
    """
    tangents, errors = [], []
    for name, sign in (("vn", 1.0), ("ve", -1.0)):
        fit = fits.ground.get(name)
        if fit is None or not is_determined(fit):
            continue
        tangents.append(sign * fit.scales[1] / fit.scales[0])
        errors.append(max(fit.errors[1] / fit.scales[0], _LEAST_ERROR))
    if not tangents:
        return None
    weights = np.array(errors) ** -2.0
    mean = float(weights @ tangents / weights.sum())
    # scatter of the two channels beyond their errors (Birge ratio)
    chi = float(weights @ (np.array(tangents) - mean) ** 2)
    stderr = float(np.sqrt(max(1.0, chi) / weights.sum()))
    return float(np.arctan(mean)), stderr


def _rms_wander(
    difference: np.ndarray, turned: np.ndarray, mask: np.ndarray, *, step: float, length: float
) -> float | None:
    """Return the median of the rms differences of stretches; None for a shorter record."""
    found = []
    for start, stop in true_runs(mask):
        parts = max(1, round((stop - start) * step / length))
        limits = np.linspace(start, stop, parts + 1).astype(int)
        for first, last in pairwise(limits):
            if (last - first) * step < _SHORTEST:
                continue
            found.append(_rms_without_drift(difference[first:last], turned[first:last]))
    if not found:
        return None
    return float(np.median(found))


def _rms_without_drift(difference: np.ndarray, turned: np.ndarray) -> float:
    line = np.linspace(-1.0, 1.0, len(difference))
    columns = [np.ones_like(line), line]
    if np.ptp(turned) > _TURN:
        columns.append(turned)
    X = np.stack(columns, axis=1)
    coefficients = np.linalg.lstsq(X, difference, rcond=None)[0]
    return float(np.std(difference - X @ coefficients))
