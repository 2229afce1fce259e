"""Moments and products of inertia of an aircraft file against body, span and motion.

No body has a moment of inertia that exceeds the sum of the two others.  Aeroplanes have radii of
gyration within known limits.  Rolling and yawing pitch the aeroplane, which shows the sign of Ixz.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, degrees, radians, sqrt

import numpy as np

from flightmech.aircraft.aircraft import Aircraft, inertia_tensor
from flightmech.support.arrays import picked_runs
from flightmech.units import FOOT, POUND
from flighttest.reconstruction.quality.checks.control_response import SIGNIFICANT
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.signals.differentiation import derivative
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

_ROLL, _OTHERS = (0.08, 0.6), (0.09, 2.2)  # radii of gyration over half the span
# inclination of the principal axis from the body axis; aeroplanes have 0 to 6 deg, small ones up
# to 16 deg
_INCLINED = radians(25.0)
MAIN = ("Ixx", "Iyy", "Izz")
_INERTIA = (("lb ft2", "kg m2", POUND * FOOT**2), ("kg m2", "lb ft2", 1.0 / (POUND * FOOT**2)))
# share by which the largest moment may exceed the sum of the others: moments are estimates
_TRIANGLE, _TRIANGLE_DOUBTFUL, _TRIANGLE_CERTAIN = 0.01, 0.03, 0.1
_YAW = 0.85  # of the largest other moment that Izz must reach; long fuselages have Izz near Iyy

# Coupling of roll and yaw into pitch
_COUPLING_ERRORS = 3.0  # standard errors between the coefficient of p r and the aircraft file
_SHARP = 0.25  # largest standard error of that coefficient, and largest error, over itself
# the estimate is that of the file with the opposite sign: standard errors, and share of Ixz
_OTHER_SIGN, _INERTIA_RATIO = 3.0, 0.5
_TRIM, _BAND = 0.3, 1.5  # Hz, between which both sides of the equation are compared
_MEMORY = 2.0  # s over which residuals are correlated
_SHORTEST = 5.0  # s of usable samples
_MOST_CONDITION = 1e6  # condition number above which the regression is not determined
_COUPLING_CHANNELS = ("p", "q", "r", "alpha_vane", "delta_e")
_LATERAL = ("beta_vane", "delta_a", "delta_r")


@dataclass(frozen=True)
class _Coupling:
    """Estimates of Ixz [kg m2] and of the coefficient of p r [1], with standard errors."""

    Ixz: float
    stderr: float
    coefficient: float
    coefficient_stderr: float


def inertia_findings(aircraft: Aircraft) -> list[Finding]:
    """Return the findings on moments of inertia that no body of this mass and span has."""
    findings: list[Finding] = []
    moments = {name: float(getattr(aircraft, name)) for name in MAIN}
    listed = ", ".join(f"{name} = {moment:.4g}" for name, moment in moments.items())
    remedy = "correct the moments of inertia in the aircraft file; a number without a unit is kg m2"
    odd = list(_odd_radii(aircraft, moments))
    if odd:
        names = tuple(name for name, _ in odd)
        text = (
            f"{listed} kg m2 for {aircraft.mass:.4g} kg and a span of {aircraft.b:.4g} m: "
            f"{'; '.join(text for _, text in odd)}"
        )
        findings.append(Finding("warning", "inertia", names, text, remedy=remedy))
    principal = np.sort(np.linalg.eigvalsh(inertia_tensor(aircraft)))
    excess = float(principal[2] / (principal[0] + principal[1]) - 1.0)
    if excess > _TRIANGLE:
        names, text = _explain_excess(aircraft, moments, excess)
        severity = "note"
        if excess > _TRIANGLE_DOUBTFUL:
            severity = "error" if excess > _TRIANGLE_CERTAIN else "warning"
        text = f"{listed} kg m2: {text}"
        findings.append(Finding(severity, "inertia", names, text, remedy=remedy))
    elif moments["Izz"] < _YAW * max(moments["Ixx"], moments["Iyy"]):
        text = (
            f"{listed} kg m2: Izz is the largest moment of inertia of an aeroplane; two of "
            f"them may be exchanged"
        )
        findings.append(Finding("warning", "inertia", ("Izz",), text, remedy=remedy))
    # angle of the principal axes from tan(2 angle) = 2 Ixz/(Izz - Ixx)
    inclination = 0.5 * atan2(2.0 * aircraft.Ixz, moments["Izz"] - moments["Ixx"])
    if moments["Izz"] > moments["Ixx"] and abs(inclination) > _INCLINED:
        text = (
            f"Ixz = {aircraft.Ixz:.4g} kg m2 inclines the principal axis of inertia by "
            f"{degrees(inclination):.0f} deg from the body axis"
        )
        findings.append(Finding("warning", "inertia", ("Ixz",), text, remedy=remedy))
    return findings


def _explain_excess(
    aircraft: Aircraft, moments: dict[str, float], excess: float
) -> tuple[tuple[str, ...], str]:
    """Return the moments at fault, and the excess with the units that explain it."""
    largest, smallest = max(MAIN, key=moments.__getitem__), min(MAIN, key=moments.__getitem__)
    names: tuple[str, ...] = (largest, smallest)
    text = f"{largest} exceeds the sum of the two others by {excess:.1%}, which no body has"
    explained = False
    for name in MAIN:
        for wrong, right, factor in _INERTIA:
            if not is_aeroplane(aircraft, moments | {name: factor * moments[name]}):
                continue
            text += f"; as if {name} were in {wrong} and taken as {right}"
            # the first explanation names the moment at fault
            if not explained:
                names = (name,)
            explained = True
    return names, text


def is_aeroplane(aircraft: Aircraft, moments: dict[str, float]) -> bool:
    """Return whether moments of inertia are those of an aeroplane."""
    Ixx, Iyy, Izz = (moments[name] for name in MAIN)
    if not _YAW * max(Ixx, Iyy) <= Izz <= (1.0 + _TRIANGLE) * (Ixx + Iyy):
        return False
    return not list(_odd_radii(aircraft, moments))


def _odd_radii(aircraft: Aircraft, moments: dict[str, float]) -> Iterator[tuple[str, str]]:
    """Yield the moments whose radius of gyration is unusual, and the reason in words."""
    half = 0.5 * max(aircraft.b, aircraft.cbar)  # of an airship the length
    for name, moment in moments.items():
        low, high = _ROLL if name == "Ixx" else _OTHERS
        radius = sqrt(moment / aircraft.mass) / half
        if low <= radius <= high:
            continue
        text = (
            f"the radius of gyration of {name} is {radius:.2g} of half the span (aeroplanes "
            f"have {low:g} to {high:g})"
        )
        for wrong, right, factor in _INERTIA:
            if low <= radius * sqrt(factor) <= high:
                text += f", as if {name} were in {wrong} and taken as {right}"
        yield name, text


def product_findings(signals: ResampledChannels, aircraft: Aircraft) -> tuple[list[Finding], str]:
    """Return the error of an Ixz of the wrong sign, and the reason if it was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, sensors at the c.g.
    aircraft : Aircraft
        Ixx, Iyy, Izz, Ixz. [kg m2]
    """
    if aircraft.Ixz == 0.0:
        return [], ""
    missing = [name for name in _COUPLING_CHANNELS if name not in signals]
    if missing:
        return [], f"not recorded: {'; '.join(missing)}"
    fit = fit_coupling(signals, aircraft)
    if fit is None:
        return [], "too little motion"
    reason = _reason_not_checked(fit, aircraft)
    if reason:
        return [], reason
    Ixz, stderr = fit.Ixz, fit.stderr
    tolerance = max(_OTHER_SIGN * stderr, _INERTIA_RATIO * abs(aircraft.Ixz))
    opposite = Ixz * aircraft.Ixz <= 0.0 and abs(Ixz + aircraft.Ixz) < tolerance
    if not opposite or abs(Ixz) < SIGNIFICANT * stderr:
        return [], ""
    text = (
        f"Ixz has the wrong sign: the aircraft file has {aircraft.Ixz:.4g} kg m2, and "
        f"rolling pitches the aeroplane as "
        f"{Ixz:.4g} kg m2 does (standard error {stderr:.2g}); Ixz is the integral of x z dm"
    )
    remedy = f'Ixz = "{-aircraft.Ixz:.10g} kg m2" in the aircraft file'
    evidence = {"Ixz": Ixz, "stderr": stderr}
    return [Finding("error", "inertia", ("Ixz",), text, remedy=remedy, evidence=evidence)], ""


def _reason_not_checked(fit: _Coupling, aircraft: Aircraft) -> str:
    """Return the reason for which an estimate does not show the sign of Ixz; empty without one."""
    if abs(aircraft.Ixz) < SIGNIFICANT * fit.stderr:
        return (
            f"the motion shows Ixz to {fit.stderr:.2g} kg m2 only, the aircraft file has "
            f"{aircraft.Ixz:.3g} kg m2"
        )
    # Euler's equation of pitch: the coefficient of p r is (Izz - Ixx)/Iyy, which the aircraft file
    # has. An estimate that misses it is spoiled by other effects.
    true = (aircraft.Izz - aircraft.Ixx) / aircraft.Iyy
    error = abs(fit.coefficient - true)
    blurred = max(fit.coefficient_stderr, error) > _SHARP * abs(true)
    if blurred or error > _COUPLING_ERRORS * fit.coefficient_stderr:
        return (
            f"the coupling of roll and yaw into pitch, known to be {true:.2f}, is seen as "
            f"{fit.coefficient:.2f} (standard error {fit.coefficient_stderr:.2f})"
        )
    return ""


def fit_coupling(signals: ResampledChannels, aircraft: Aircraft) -> _Coupling | None:
    """Return the estimates of the pitch equation; None if they are not determined."""
    if not set(_COUPLING_CHANNELS) <= set(signals.values):
        return None
    signals = signals.completed(("V",))
    lateral = [name for name in _LATERAL if name in signals and np.ptp(signals[name]) > 0.0]
    mask = signals.mask((*_COUPLING_CHANNELS, *lateral))
    if mask.sum() * signals.step < _SHORTEST:
        return None
    speed = np.ones_like(signals.time)
    if "V" in signals:
        middle = float(np.median(signals["V"][mask]))
        speed = np.maximum(signals["V"], 0.3 * middle) / middle
    p, q, r = (signals[name] for name in "pqr")
    # Iyy q_dot = M + (Izz - Ixx) p r - Ixz (p^2 - r^2). Aerodynamic moments over dynamic pressure
    # are linear in angles, controls and dimensionless rates, and even in sideslip and its controls.
    sides = [signals[name] for name in lateral]
    aerodynamic = [
        signals["alpha_vane"],
        signals["delta_e"],
        q / speed,
        p / speed,
        r / speed,
        *sides,
        *(x**2 for x in sides),
    ]
    coupling = [p * r / speed**2, (p**2 - r**2) / speed**2]
    order = 4 if signals.step < 0.15 else 2
    acceleration = derivative(q, signals.step, 5, order=order) / speed**2
    y = _bandpass(acceleration, signals.step)[mask]
    columns = [_bandpass(x, signals.step)[mask] for x in (*aerodynamic, *coupling)]
    X = np.stack([x for x in columns if np.std(x) > 0.0], axis=1)
    still = min(np.std(x) for x in columns[-2:]) == 0.0
    if len(y) < 10 * X.shape[1] or still:
        return None
    return _regress_coupling(X, y, mask, step=signals.step, Iyy=aircraft.Iyy)


def _bandpass(x: np.ndarray, step: float) -> np.ndarray:
    """Return the part between trim and the band of the signals, the same for both sides."""
    return lowpass_if_possible(x, step, _BAND) - lowpass_if_possible(x, step, _TRIM)


def _regress_coupling(
    X: np.ndarray, y: np.ndarray, mask: np.ndarray, *, step: float, Iyy: float
) -> _Coupling | None:
    """Return the last two coefficients of a regression with coloured residuals."""
    # columns of unit size, so that the condition number does not depend on their units
    size = X.std(axis=0)
    scaled = X / size
    if np.linalg.cond(scaled) > _MOST_CONDITION:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    # residuals are not correlated over the samples that the mask leaves out
    pieces = picked_runs(mask)
    covariance = coloured_covariance_of(
        scaled, y - scaled @ theta, pieces, [step] * len(pieces), lag=_MEMORY
    ).covariance
    coefficient, product = theta[-2:] / size[-2:]
    coefficient_stderr, stderr = np.sqrt(np.diag(covariance)[-2:]) / size[-2:]
    return _Coupling(
        Ixz=float(-product * Iyy),
        stderr=float(stderr * Iyy),
        coefficient=float(coefficient),
        coefficient_stderr=float(coefficient_stderr),
    )
