"""Inertial unit that is bolted on at an angle to the body axes.

Gyros of a turned unit show a part of each rate on another axis: with 12 deg of yaw a fifth of the
rate of roll on q.  The rates of the attitude are those of the body, so that both give the rotation
between them.  The accelerometers of the same unit are turned by the same angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.relation_sides import rate_of
from flighttest.reconstruction.quality.checks.relations import compare_all
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding

_GYROS, _ACCELEROMETERS = ("p", "q", "r"), ("ax_imu", "ay_imu", "az_imu")
_ATTITUDE = ("phi", "theta", "psi")
_BAND = 1.0  # Hz
_LEAST = 3.0 * DEGREE  # angle that is reported
_MOST = 60.0 * DEGREE  # a larger one is an exchange of axes, which the search for mistakes names
_PRIOR = 30.0 * DEGREE  # pulls an angle about which nothing moves to zero
_SIGMAS = 4.0
_REMAINS = 0.5  # largest share of the squared difference that the rotation leaves
_WORST = 0.1  # T-37 and C182: below 0.01 with a turned unit, above 0.35 with other mistakes
_STILL = 0.2 * DEGREE  # rms of an axis that does not move [rad s-1]
_SHORTEST = 8.0  # s of usable samples
_MOVES = 0.3 * DEGREE  # rms of the rates [rad s-1]
_BLOCKS, _STEPS = 8, 8
_FORCES = ("force_x", "force_y", "force_z")
_WORSE = 1.1  # quotient of the variances of the forces with and without the rotation


@dataclass(frozen=True)
class Mounting:
    """Rotation from body axes to the axes of the unit.

    Attributes
    ----------
    angles, errors : array (3,)
        Yaw, pitch and roll of the unit in the aircraft, in this order of turns, and their standard
        errors. Positive with the nose of the unit right, its nose up, and its right side down.
        [rad]
    matrix : array (3, 3)
        Body axes to axes of the unit.
    remains : float
        Share of the squared difference of the rates that the rotation leaves. [1]
    worst : float
        Largest share of the squared rate of an axis that the rotation does not explain. [1]
    """

    angles: np.ndarray
    errors: np.ndarray
    matrix: np.ndarray
    remains: float
    worst: float

    @property
    def is_turned(self) -> bool:
        """Whether the unit is certainly turned."""
        clear = np.abs(self.angles) > _LEAST + _SIGMAS * self.errors
        inside = np.abs(self.angles).max() < _MOST
        # a wrong sign, unit or axis leaves most of a rate on one axis
        explained = self.remains < _REMAINS and self.worst < _WORST
        return bool(clear.any() and inside and explained)


def unit_mounting(signals: ResampledChannels) -> Mounting | None:
    """Return how the gyros are turned against the attitude; None if the record does not show it.

    Parameters
    ----------
    signals : ResampledChannels
        ``phi theta psi`` [rad] and ``p q r`` [rad s-1].
    """
    needs = (*_ATTITUDE, *_GYROS)
    if not set(needs) <= set(signals.values):
        return None
    mask = signals.mask(needs)
    if mask.sum() * signals.step < _SHORTEST:
        return None
    true, read = _body_rates(signals, mask), _recorded_rates(signals, mask)
    if not np.sqrt(np.mean(true**2)) > _MOVES:
        return None
    vector = _fit(true, read)
    left_out = []
    for block in np.array_split(np.arange(len(true)), _BLOCKS):
        kept = np.delete(true, block, axis=0), np.delete(read, block, axis=0)
        left_out.append(_angles_of(_matrix_of(_fit(*kept))))
    errors = np.sqrt((_BLOCKS - 1) * np.var(left_out, axis=0))
    matrix = _matrix_of(vector)
    turned = true @ matrix.T
    left, size = np.mean((read - turned) ** 2, axis=0), np.mean(turned**2, axis=0)
    before = float(np.mean((read - true) ** 2, axis=0).sum())
    return Mounting(
        _angles_of(matrix),
        errors,
        matrix,
        remains=float(left.sum()) / max(before, 1e-300),
        worst=float(np.max(left / (size + _STILL**2))),
    )


def mounting_findings(
    mounting: Mounting | None, signals: ResampledChannels
) -> tuple[list[Finding], ResampledChannels]:
    """Return the error of a turned inertial unit, and the signals in body axes.

    Parameters
    ----------
    mounting : Mounting or None
        Result of `unit_mounting`.
    signals : ResampledChannels
    """
    if mounting is None or not mounting.is_turned:
        return [], signals
    gyros = _turned_back(signals, _GYROS, mounting.matrix)
    turned, unit, check = gyros, "the gyros are", ""
    channels: tuple[str, ...] = _GYROS
    if set(_ACCELEROMETERS) <= set(signals.values):
        both = _turned_back(gyros, _ACCELEROMETERS, mounting.matrix)
        alone, together = _force_scatter(gyros), _force_scatter(both)
        if together > _WORSE * alone:
            check = "; the accelerometers are not turned with them"
        else:
            turned, channels = both, (*_GYROS, *_ACCELEROMETERS)
            unit = "the inertial unit is"
            if not together < alone / _WORSE:
                check = "; the forces do not show whether the accelerometers are turned with them"
    shown = []
    for name, angle, error in zip(
        ("yaw", "pitch", "roll"), mounting.angles, mounting.errors, strict=True
    ):
        shown.append(f"{name} {angle / DEGREE:+.1f} deg ({error / DEGREE:.1f})")
    text = (
        f"{unit} turned against the body axes, by the rates of the attitude: {', '.join(shown)}, "
        f"with standard errors; nose right, nose up and right side down are positive. The rotation "
        f"leaves {mounting.remains:.0%} of the squared difference of the rates{check}"
    )
    rows = []
    for row in mounting.matrix.T:
        rows.append(", ".join(f"{x:.4f}" for x in row))
    remedy = (
        f"align the unit with the body axes, or turn its columns before they are read: (x, y, z) "
        f"of the body is the matrix [{'; '.join(rows)}] times (x, y, z) of the unit, for rates and "
        f"for forces"
    )
    evidence = {
        "angles": mounting.angles.tolist(),
        "errors": mounting.errors.tolist(),
    }
    finding = Finding("error", "mounting", channels, text, remedy, evidence=evidence)
    return [finding], turned


def _body_rates(signals: ResampledChannels, mask: np.ndarray) -> np.ndarray:
    """Return the rates p, q, r of the recorded attitude without their means (sample, 3)."""
    phi, theta = signals["phi"], signals["theta"]
    phi_rate, theta_rate, psi_rate = (rate_of(signals, name) for name in _ATTITUDE)
    p = phi_rate - psi_rate * np.sin(theta)
    q = theta_rate * np.cos(phi) + psi_rate * np.sin(phi) * np.cos(theta)
    r = psi_rate * np.cos(phi) * np.cos(theta) - theta_rate * np.sin(phi)
    return _slow_parts([p, q, r], signals.step, mask)


def _recorded_rates(signals: ResampledChannels, mask: np.ndarray) -> np.ndarray:
    return _slow_parts([signals[name] for name in _GYROS], signals.step, mask)


def _slow_parts(channels: list[np.ndarray], step: float, mask: np.ndarray) -> np.ndarray:
    """Return low-passed channels without their means (sample, channel)."""
    rates = np.stack([lowpass_if_possible(x, step, _BAND)[mask] for x in channels], axis=1)
    return rates - rates.mean(axis=0)


def _fit(true: np.ndarray, read: np.ndarray) -> np.ndarray:
    """Return the rotation vector that turns the true rates into the recorded ones. [rad]"""
    vector = np.zeros(3)
    for _ in range(_STEPS):
        turned = true @ _matrix_of(vector).T
        # a further small turn d of the axes changes a vector x by -d x x = x x d
        x, y, z = turned.T
        zero = np.zeros_like(x)
        slopes = np.stack(
            [
                np.stack([zero, -z, y], axis=1),
                np.stack([z, zero, -x], axis=1),
                np.stack([-y, x, zero], axis=1),
            ],
            axis=1,
        )
        difference = read - turned
        scatter = max(float(np.mean(difference**2)), 1e-12)
        normal = np.einsum("nij,nik->jk", slopes, slopes) / scatter
        right = np.einsum("nij,ni->j", slopes, difference) / scatter
        normal += np.eye(3) / _PRIOR**2
        right -= vector / _PRIOR**2
        vector = vector + np.linalg.solve(normal, right)
    return vector


def _matrix_of(vector: np.ndarray) -> np.ndarray:
    """Return the matrix of a turn of the axes by a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    a, b, c = vector / angle
    cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    return np.eye(3) - np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _angles_of(matrix: np.ndarray) -> np.ndarray:
    """Return yaw, pitch and roll of a matrix from body axes to axes of the unit. [rad]"""
    yaw = np.arctan2(matrix[0, 1], matrix[0, 0])
    pitch = -np.arcsin(np.clip(matrix[0, 2], -1.0, 1.0))
    roll = np.arctan2(matrix[1, 2], matrix[2, 2])
    return np.array([yaw, pitch, roll])


def _turned_back(
    signals: ResampledChannels, names: tuple[str, ...], matrix: np.ndarray
) -> ResampledChannels:
    """Return signals with three channels of the unit in body axes."""
    body = np.stack([signals[name] for name in names], axis=1) @ matrix
    turned = signals.with_values(dict(zip(names, body.T, strict=True)))
    good = np.logical_and.reduce([signals.good[name] for name in names])
    return replace(turned, good={**turned.good, **{name: good for name in names}})


def _force_scatter(signals: ResampledChannels) -> float:
    """Return the variance of the forces about those of the ground velocity. [m2 s-4]"""
    checks = compare_all(signals)
    scatter = 0.0
    for name in _FORCES:
        check = checks.get(name)
        if check is not None:
            scatter += float(np.var(check.first - check.second))
    return scatter
