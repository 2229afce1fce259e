"""Place of the accelerometers, from the ground velocity.

Accelerometers at r from the c.g. measure the specific force of the c.g. plus
omega_dot x r + omega x (omega x r).  The measured force after the stated place, in Earth axes, less
the acceleration of the ground velocity is regressed on these terms.  A receiver delays the velocity
in Earth axes.  In body axes the same delay would look like another place: 0.15 s like 0.5 m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from flightmech.axes import matrix_from_euler
from flightmech.units import G0
from flighttest.reconstruction.quality.checks.relation_sides import rate_of
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked

_AXES = ("ax_imu", "ay_imu", "az_imu")
_VELOCITY = ("vn", "ve", "vd")
_NEEDS = ("phi", "theta", "psi", *_VELOCITY, "p", "q", "r", *_AXES)
_BAND = 1.0  # Hz
_SHORTEST = 10.0  # s of flight
_BLOCKS = 10  # of the jackknife
_STEPS = 5  # of Gauss and Newton for the delay of the velocity
_CONVERGED, _LONGEST = 0.01, 2.0  # s: last step, and delay
# m: error of a place that is reported, beyond 3 standard errors (the antenna of the receiver has
# its own place), and standard error up to which it counts as checked
_LARGE, _SIGMAS, _KNOWN = 0.8, 3.0, 0.5
# standard errors of the stated limit: an error of 0.8 m and 3 of them is reported in half of the
# cases, one of 0.8 m and 5 of them in 98 of 100
_CERTAIN_SIGMAS = 5.0
_INDEPENDENT = 1e-6  # share of a column that the others do not explain
_ROW = ("imu_position", "place of the accelerometers")


def lever_arm_findings(
    signals: ResampledChannels, positions: Mapping[str, np.ndarray]
) -> tuple[list[Finding], Unchecked]:
    """Return the finding on the place of the accelerometers, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, accelerometers moved to the c.g. from their stated place.
    positions : mapping of str to array (3,)
        Stated place of ``ax_imu``, from the c.g. [m]

    Returns
    -------
    findings : list of Finding
    not_checked : list of tuple
        Smaller errors of the place than those that this record shows, and axes that it does not
        show.
    """
    if "ax_imu" not in positions or not set(_AXES) <= set(signals.values):
        return [], []
    missing = tuple(name for name in _NEEDS if name not in signals)
    if missing:
        return [], [(*_ROW, missing, f"not recorded: {'; '.join(missing)}")]
    mask = signals.mask(_NEEDS)
    if mask.sum() * signals.step < _SHORTEST:
        return [], [(*_ROW, (), f"less than {_SHORTEST:g} s of flight")]
    fit = _fit_lever_arm(signals, mask)
    if fit is None:
        return [], [(*_ROW, (), "the delay of the ground velocity is not determined")]
    shift, stderr = fit
    large = (np.abs(shift) > _LARGE + _SIGMAS * stderr) & (stderr < _KNOWN)
    unchecked: Unchecked = [(*_ROW, (), reason) for reason in _unseen_errors(stderr, large)]
    if not large.any():
        return [], unchecked
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
    finding = Finding("warning", "geometry", _AXES, text, remedy, evidence=evidence)
    return [finding], unchecked


def _unseen_errors(stderr: np.ndarray, large: np.ndarray) -> list[str]:
    """Return, in words, the errors of the place that the record does not show."""
    limits, hidden = [], []
    for axis, error, is_large in zip("xyz", stderr.tolist(), large, strict=True):
        if not error < _KNOWN:
            hidden.append(axis)
        elif not is_large:
            # rounded upwards
            limit = math.ceil(10.0 * (_LARGE + _CERTAIN_SIGMAS * error)) / 10.0
            limits.append(f"{axis} {limit:.1f} m")
    reasons = []
    if limits:
        reasons.append(f"an error above {', '.join(limits)} is reported, a smaller one may not be")
    if hidden:
        reasons.append(
            f"the motion does not show {' and '.join(hidden)} to {_KNOWN:g} m (standard error): "
            f"doublets of all controls do"
        )
    return reasons


def _fit_lever_arm(
    signals: ResampledChannels, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the error of the stated place and its standard error (3,); None without a delay. [m]

    The delay of the velocity is iterated. Further columns are the constant errors of the
    accelerometers, the lag of the receiver, and a delay of the attitude.
    """
    to_body = matrix_from_euler(signals["phi"], signals["theta"], signals["psi"])
    force = np.stack([signals[name] for name in _AXES])
    rates = np.stack([signals[name] for name in "pqr"])
    gravity = np.array([[0.0], [0.0], [G0]])
    # columns in Earth axes: an error of the place along each axis, constant errors, late attitude
    unit = np.eye(3)[:, :, None] * np.ones(len(signals.time))
    body = [*_rotation_terms(signals).swapaxes(0, 1), *unit, np.cross(rates, force, axis=0)]
    columns = [_smooth_vector(_to_earth(to_body, vector), signals.step) for vector in body]
    measured = _smooth_vector(_to_earth(to_body, force) + gravity, signals.step)
    recorded = np.stack([rate_of(signals, name) for name in _VELOCITY])
    recorded = _smooth_vector(recorded, signals.step)
    delay, correction = 0.0, np.inf
    for _ in range(_STEPS):
        # the first derivative is the correction of the delay, the second one a lag
        late = _delay_vector(measured, signals.time, delay)
        jerk = np.gradient(late, signals.step, axis=1)
        shifted = [_delay_vector(column, signals.time, delay) for column in columns]
        X = np.stack([*shifted, jerk, np.gradient(jerk, signals.step, axis=1)], axis=-1)[:, mask]
        y = (late - recorded)[:, mask]
        solution = _solve_columns(X, y)
        correction = float(solution[len(columns)])
        delay += correction
    if not (abs(correction) < _CONVERGED and abs(delay) < _LONGEST):
        return None
    samples = np.arange(X.shape[1])
    left_out = []
    for block in np.array_split(samples, _BLOCKS):
        kept = np.delete(samples, block)
        left_out.append(_solve_columns(X[:, kept], y[:, kept])[:3])
    stderr = np.sqrt((_BLOCKS - 1) * np.var(left_out, axis=0))
    for i in range(3):
        if not _is_independent(X, i):
            stderr[i] = np.inf
    return solution[:3], stderr


def _to_earth(to_body: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return a vector of body axes (3, time) in north-east-down axes."""
    return np.einsum("tij,it->jt", to_body, vector)


def _smooth_vector(vector: np.ndarray, step: float) -> np.ndarray:
    return np.stack([lowpass_if_possible(x, step, _BAND) for x in vector])


def _delay_vector(vector: np.ndarray, time: np.ndarray, delay: float) -> np.ndarray:
    return np.stack([np.interp(time - delay, time, x) for x in vector])


def _solve_columns(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the least-squares factors of the columns of all axes (3, time, column)."""
    A = X.reshape(-1, X.shape[-1])
    size = np.maximum(np.abs(A).max(axis=0), 1e-9)
    return np.linalg.lstsq(A / size, y.ravel(), rcond=1e-10)[0] / size


def _is_independent(X: np.ndarray, i: int) -> bool:
    """Return whether a column (3, time, column) is not a sum of the others, and not zero."""
    A = X.reshape(-1, X.shape[-1])
    others = np.delete(A, i, axis=1)
    rest = A[:, i] - others @ np.linalg.lstsq(others, A[:, i], rcond=1e-10)[0]
    return bool(np.linalg.norm(rest) > _INDEPENDENT * np.linalg.norm(A[:, i]))


def _rotation_terms(signals: ResampledChannels) -> np.ndarray:
    """Return the acceleration of each body axis per metre of each coordinate (3, 3, time). [s-2]"""
    p, q, r = (signals[name] for name in "pqr")
    pd, qd, rd = (rate_of(signals, name) for name in "pqr")
    return np.array(
        [
            [-(q**2) - r**2, p * q - rd, p * r + qd],
            [p * q + rd, -(p**2) - r**2, q * r - pd],
            [p * r - qd, q * r + pd, -(p**2) - q**2],
        ]
    )
