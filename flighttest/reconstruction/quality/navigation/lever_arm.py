"""Place of the accelerometers, from the ground velocity.

Accelerometers at r from the c.g. measure the specific force of the c.g. plus
omega_dot x r + omega x (omega x r).  The rest of the measured force after the stated place, less
the acceleration of the ground velocity, is regressed on these terms.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked
from flighttest.records.signals.differentiation import derivative

_AXES = ("ax_imu", "ay_imu", "az_imu")
_NEEDS = ("phi", "theta", "psi", "vn", "ve", "vd", "p", "q", "r", *_AXES)
_BAND = 1.0  # Hz
_SHORTEST = 10.0  # s of flight
_BLOCKS = 10  # of the jackknife
# m: error of a place that is reported, beyond 3 standard errors (the antenna of the receiver has
# its own place), and standard error up to which it counts as checked
_LARGE, _SIGMAS, _KNOWN = 0.8, 3.0, 0.5
_ROW = ("imu_position", "place of the accelerometers")


def lever_arm_findings(
    ground_force: np.ndarray | None,
    signals: ResampledChannels,
    positions: Mapping[str, np.ndarray],
) -> tuple[list[Finding], Unchecked]:
    """Return the finding on the place of the accelerometers, and what was not checked.

    Parameters
    ----------
    ground_force : array (3, time) or None
        Acceleration of the ground velocity less gravity, body axes; None if not recorded. [m s-2]
    signals : ResampledChannels
        Without mistakes, accelerometers moved to the c.g. from their stated place.
    positions : mapping of str to array (3,)
        Stated place of ``ax_imu``, from the c.g. [m]
    """
    if "ax_imu" not in positions or not set(_AXES) <= set(signals.values):
        return [], []
    missing = tuple(name for name in _NEEDS if name not in signals)
    if missing or ground_force is None:
        return [], [(*_ROW, missing, f"not recorded: {'; '.join(missing)}")]
    mask = signals.mask(_NEEDS)
    if mask.sum() * signals.step < _SHORTEST:
        return [], [(*_ROW, (), f"less than {_SHORTEST:g} s of flight")]
    shift, stderr = _fit_lever_arm(ground_force, signals, mask)
    large = (np.abs(shift) > _LARGE + _SIGMAS * stderr) & (stderr < _KNOWN)
    if not large.any():
        unknown = [axis for axis, error in zip("xyz", stderr, strict=True) if not error < _KNOWN]
        if not unknown:
            return [], []
        sizes = ", ".join(
            f"{axis} to {error:.2g} m" for axis, error in zip("xyz", stderr, strict=True)
        )
        reason = f"the motion shows {sizes} only (standard error): doublets of all controls show it"
        return [], [(*_ROW, (), reason)]
    stated = positions["ax_imu"]
    # the other axes keep their stated place
    found = stated + np.where(large, shift, 0.0)
    parts = []
    for axis, is_large, place, error, before in zip(
        "xyz", large, found, stderr, stated, strict=True
    ):
        if is_large:
            parts.append(
                f"{axis} = {place:.2f} m (standard error {error:.2f} m), stated {before:.2f} m"
            )
    text = (
        f"the accelerometers are not at their stated place; rotation and ground velocity give, "
        f"from the c.g.: {'; '.join(parts)}"
    )
    remedy = (
        "correct position of the inertial unit (from the moment reference point) or cg in the "
        "aircraft file; or the ground velocity is that of an antenna far from the c.g."
    )
    evidence = {"position": found.tolist(), "stderr": stderr.tolist(), "stated": stated.tolist()}
    return [Finding("warning", "geometry", _AXES, text, remedy, evidence=evidence)], []


def _fit_lever_arm(
    ground_force: np.ndarray, signals: ResampledChannels, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the error of the stated place and its standard error (3,). [m]

    Further columns are the constant errors of the accelerometers, and the first two derivatives of
    the measured force, for delay and lag of the receiver.
    """
    turning = _rotation_terms(signals)
    columns, differences = [], []
    for axis, name in enumerate(_AXES):
        force = lowpass_if_possible(signals[name], signals.step, _BAND)
        ground = lowpass_if_possible(ground_force[axis], signals.step, _BAND)
        jerk = np.gradient(force, signals.step)
        constant = np.zeros((3, len(force)))
        constant[axis] = 1.0
        terms = [lowpass_if_possible(term, signals.step, _BAND) for term in turning[axis]]
        X = np.stack([*terms, *constant, jerk, np.gradient(jerk, signals.step)], axis=1)
        columns.append(X[mask])
        differences.append((force - ground)[mask])
    X, y = np.stack(columns), np.stack(differences)
    samples = np.arange(X.shape[1])
    left_out = []
    for block in np.array_split(samples, _BLOCKS):
        kept = np.delete(samples, block)
        left_out.append(_solve_lever_arm(X[:, kept], y[:, kept]))
    stderr = np.sqrt((_BLOCKS - 1) * np.var(left_out, axis=0))
    return _solve_lever_arm(X, y), stderr


def _solve_lever_arm(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    A = X.reshape(-1, X.shape[-1])
    size = np.maximum(np.abs(A).max(axis=0), 1e-9)
    return (np.linalg.lstsq(A / size, y.ravel(), rcond=1e-10)[0] / size)[:3]


def _rotation_terms(signals: ResampledChannels) -> np.ndarray:
    """Return the acceleration of each body axis per metre of each coordinate (3, 3, time). [s-2]"""
    p, q, r = (signals[name] for name in "pqr")
    pd, qd, rd = (derivative(rate, signals.step, 5, 2) for rate in (p, q, r))
    return np.array(
        [
            [-(q**2) - r**2, p * q - rd, p * r + qd],
            [p * q + rd, -(p**2) - r**2, q * r - pd],
            [p * r - qd, q * r + pd, -(p**2) - q**2],
        ]
    )
