"""Control linkages side by side: cockpit end, cable, surface, with dry friction as an inclusion.

    m s'' in F - W s' - C s - offset - bob - R Sgn(s') - P Sgn(s) - K (s - a) - D (s' - a')
    J g^2 a'' in K (s - a) + D (s' - a') - w g^2 a' - r |g| Sgn(a') + g H,       delta = rigging + g a

Positions move half a step before and half a step after the velocities (Strang splitting); friction
and preload are implicit, so that a body at rest whose friction suffices stays where it is;
reversals are located inside a sub-step.  Without a cable (order 2) the one body has the mass of
both.  The kernel flies the same equations with an aircraft around them
(``kernel/src/controls/linkage.c``); here speed, angle of attack and tab are those of the record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.units import G0
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import REST, control_signals, free_motion_windows

LONGEST_STEP = 1e-3  # s
PHASE = 0.25  # of the cable mode in a sub-step [rad]: its frequency is right within PHASE^2 / 24


def sub_steps(constants: Mapping[str, np.ndarray], gearing: float, step: float) -> int:
    """Return how many sub-steps a step of the record needs."""
    longest = LONGEST_STEP
    if "cable_stiffness" in constants:
        aft = constants["inertia"] * gearing**2
        fastest = np.sqrt(
            np.max(constants["cable_stiffness"] * (1.0 / constants["mass"] + 1.0 / aft))
        )
        longest = min(longest, PHASE / float(fastest))
    return int(np.ceil(step / longest - 1e-9))


def simulate_linkages(
    constants: Mapping[str, np.ndarray],
    gearing: float,
    start: tuple[np.ndarray, np.ndarray],
    force: np.ndarray,
    moment: np.ndarray,
    step: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return travel and deflection of linkages that start at rest.

    Parameters
    ----------
    constants : mapping of str to array (linkages,)
        ``mass friction damping preload stiffness rigging``, and of two bodies ``inertia
        hinge_friction hinge_damping cable_stiffness cable_damping``; those of the surface about its
        hinge. [SI]
    gearing : float
        d(delta)/ds. [rad per unit of travel]
    start : array (linkages,), array (linkages,)
        Travel of cockpit end and of the surface's end of the cable.
    force : array (time, linkages)
        Force of the hand less all that depends on neither travel nor rate. [N or N m]
    moment : array (time, powers, linkages)
        Hinge moment as a polynomial of the deflection, from power 0. [N m]
    step : float
        Of the record; force and moment are linear in between. [s]

    Returns
    -------
    travel, deflection : array (time, linkages)
    """
    c = {name: np.asarray(value, float) for name, value in constants.items()}
    count = sub_steps(c, gearing, step)
    h = step / count
    two = "cable_stiffness" in c
    K, D = c.get("cable_stiffness", 0.0), c.get("cable_damping", 0.0)
    aft = c.get("inertia", 0.0) * gearing**2
    w = c.get("hinge_damping", 0.0) * gearing**2
    r = c.get("hinge_friction", 0.0) * abs(gearing)
    m, W, R, P, C, rigging = (
        c[name] for name in ("mass", "damping", "friction", "preload", "stiffness", "rigging")
    )
    if not two:
        m, W, R = m + aft, W + w, R + r
    plus, minus = m / h + 0.5 * (W + D), m / h - 0.5 * (W + D)
    plus_aft, minus_aft = aft / h + 0.5 * (w + D), aft / h - 0.5 * (w + D)
    has_preload = bool(np.any(P > 0.0))
    s, a = (np.array(x, float) for x in start)
    v, u = np.zeros_like(s), np.zeros_like(a)
    S, A = np.empty_like(force), np.empty_like(force)
    for k in range(len(force)):
        S[k], A[k] = s, a if two else s
        if k + 1 == len(force):
            break
        F, M = force[k], moment[k]
        dF, dM = (force[k + 1] - F) / count, (moment[k + 1] - M) / count
        for i in range(count):
            part = i + 0.5
            s = s + 0.5 * h * v
            a = a + 0.5 * h * u if two else s
            delta = rigging + gearing * a
            H = M[-1] + part * dM[-1]
            for j in range(len(M) - 2, -1, -1):
                H = H * delta + M[j] + part * dM[j]
            f = F + part * dF - C * s
            if two:
                tension = K * (s - a)
                old = v
                v, back = _next(plus, minus, f - tension + D * u, v, R, P, s, h, has_preload)
                u, back_aft = _next(
                    plus_aft,
                    minus_aft,
                    tension + 0.5 * D * (old + v) + gearing * H,
                    u,
                    r,
                    0.0,
                    a,
                    h,
                    False,
                )
                a = a + 0.5 * h * u - back_aft
            else:
                v, back = _next(plus, minus, f + gearing * H, v, R, P, s, h, has_preload)
            s = s + 0.5 * h * v - back
    return S, rigging + gearing * A


def _next(
    plus, minus, force, v, friction, preload, s, h, has_preload: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity after a step, and the way that a reversal inside the step takes back.

    ``plus v+ + friction Sgn + preload Sgn = minus v + force``.  A body that reverses comes to rest
    after the part x of the step and starts anew; the way is v x h/2 + v+ (1 - x) h/2 in place of (v
    + v+) h/2.  Without this the motion would jump by the way of a sub-step wherever a parameter
    moves a reversal from one sub-step to the next, and differences of the motion would show nothing
    else.
    """
    sliding = _preloaded(
        plus, minus * v + force - friction * np.sign(v), preload, s, h, has_preload
    )
    from_rest = (
        _balance(plus, force, friction, preload, s, h)
        if has_preload
        else _shrunk(force, friction) / plus
    )
    stops = v * sliding <= 0.0
    x = np.where(stops & (v != 0.0), v / np.where(v == sliding, 1.0, v - sliding), 0.0)
    after = np.where(stops, (1.0 - x) * from_rest, sliding)
    back = np.where(stops, 0.5 * h * ((1.0 - x) * v + x * after), 0.0)
    return after, back


def _shrunk(b, friction):
    """Solution x of x + friction Sgn(x) = b."""
    return b - np.clip(b, -friction, friction)


def _preloaded(a, b, preload, s, h, has_preload: bool):
    """Solution v of a v + preload Sgn(s + h v / 2) = b."""
    if not has_preload:
        return b / a
    way = 2.0 * s / h
    return _shrunk(b + a * way, preload) / a - way


def _balance(a, b, friction, preload, s, h):
    """Solution v of a v + friction Sgn(v) + preload Sgn(s + h v / 2) = b."""
    neutral = -2.0 * s / h
    first = neutral < 0.0
    p1, p2 = np.minimum(neutral, 0.0), np.maximum(neutral, 0.0)
    j1, j2 = np.where(first, preload, friction), np.where(first, friction, preload)
    v = np.minimum(p1, (b + j1 + j2) / a)
    v = np.maximum((b - j1 + j2) / a, v)
    v = np.minimum(p2, v)
    return np.maximum((b - j1 - j2) / a, v)


_CABLE = ("inertia", "cable_stiffness", "cable_damping", "hinge_friction", "hinge_damping")


@dataclass(frozen=True)
class SimulatedWindow:
    """One window of free motion.

    Attributes
    ----------
    time : array (time,)
        [s]
    travel, deflection : array (time, 2)
        Measured and simulated. [m or rad; rad]
    """

    time: np.ndarray
    travel: np.ndarray
    deflection: np.ndarray

    def misfit(self) -> tuple[float, float]:
        """Return the rms of measured minus simulated travel and deflection, over the range of the
        measured one.
        """
        pairs = (self.travel, self.deflection)
        found = [float(np.sqrt(np.mean((x[:, 0] - x[:, 1]) ** 2)) / np.ptp(x[:, 0])) for x in pairs]
        return found[0], found[1]


def fly_windows(
    loading: ControlLoading, estimates: Mapping[str, float], free: Sequence[xr.Dataset]
) -> list[SimulatedWindow]:
    """Return every window of free motion of the records, simulated with the recorded forces and
    air.

    Parameters
    ----------
    loading : ControlLoading
    estimates : mapping of str to float
        Names of `IdentifiedLoading.estimates`; a negative damping counts as none.
    free : sequence of Dataset (time,)
        Pulses and releases.

    Returns
    -------
    list of Flown

    Raises
    ------
    IdentificationError
        A mass or a stiffness that is not positive.
    """
    return [
        _flown(loading, estimates, window)
        for one in free
        for window in free_motion_windows(loading, one)
    ]


def _flown(loading: ControlLoading, p: Mapping[str, float], window: xr.Dataset) -> SimulatedWindow:
    wrong = [
        f"{name} is {p[name]:.3g}"
        for name in ("mass", "inertia", "cable_stiffness")
        if name in p and not p[name] > 0.0
    ]
    if wrong:
        raise IdentificationError(
            f"{loading.item}: {', '.join(wrong)}; join it with the drawings by `with_prior`, "
            f"or take order 2"
        )
    moved = control_signals(loading, window, None)
    time, g = moved["time"].values, loading.gearing
    step = float(np.median(np.diff(time)))
    load = loading.load(moved) / -g  # qbar S_hinge c_hinge
    factors = loading.by_power(moved)
    moment = np.zeros((len(time), 1 + max(power for power, _ in factors), 1))
    for (power, factor), term in zip(factors, loading.model.terms):
        moment[:, power, 0] += load * factor * p[loading.term(term)]
    force = moved[f"F_{loading.item}"].values - p["offset"]
    if "bob_weight" in loading.constants:
        force = force - p["bob_weight"] * G0 * (moved["nz"].values - 1.0)
    rest = max(1, round(REST / step))
    s, delta = moved["travel"].values, moved[loading.deflection].values
    rigging = p.get("rigging", 0.0)
    spring = p.get("stiffness", 0.0) + p.get("nose_spring", 0.0) * float(
        moved["on_ground"].values.mean()
    )
    constants = {
        name: np.array([max(0.0, p[name])])
        for name in ("mass", "damping", "friction", *_CABLE)
        if name in p
    }
    constants |= {
        "damping": constants.get("damping", np.zeros(1)),
        "preload": np.array([max(0.0, p.get("preload", 0.0))]),
    }
    constants |= {"stiffness": np.array([spring]), "rigging": np.array([rigging])}
    start = np.array([s[:rest].mean()]), np.array([(delta[:rest].mean() - rigging) / g])
    S, D = simulate_linkages(constants, g, start, force[:, None], moment, step)
    return SimulatedWindow(time, np.column_stack([s, S[:, 0]]), np.column_stack([delta, D[:, 0]]))
