"""Simulation of control linkages: cockpit end, cable and surface, with dry friction.

Dry friction is an inclusion:

    m s'' in F - W s' - C s - offset - bob - R Sgn(s') - P Sgn(s) - K (s - a) - D (s' - a')
    J g^2 a'' in K (s - a) + D (s' - a') - w g^2 a' - r |g| Sgn(a') + g H,  delta = rigging + g a

Positions move half a step before and half a step after the velocities (Strang splitting).  Friction
and preload are implicit: a body at rest whose friction suffices does not move.  Reversals are
located inside a sub-step.  Without a cable (order 2) a single body has the mass of both.  The
kernel integrates the same equations together with an aircraft (``kernel/src/controls/linkage.c``).
Here speed, angle of attack and tab are those of the record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.units import G0
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import REST, control_signals, free_motion_windows

# Longest sub-step. [s]
LONGEST_STEP = 1e-3
# Phase of the cable mode in a sub-step: its frequency is right within PHASE^2 / 24. [rad]
PHASE = 0.25
# Constants of the cable and of the surface.
_CABLE = ("inertia", "cable_stiffness", "cable_damping", "hinge_friction", "hinge_damping")


def sub_steps(constants: Mapping[str, np.ndarray], gearing: float, step: float) -> int:
    """Return the number of sub-steps of a step of the record."""
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
    edges: np.ndarray | None = None,
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
        Travel of the cockpit end and of the surface end of the cable.
    force : array (time, linkages)
        Force of the hand less all parts that depend on neither travel nor rate. [N or N m]
    moment : array (time, powers, linkages)
        Hinge moment as a polynomial of the deflection, from power 0. [N m]
    step : float
        Step of the record; force and moment are linear between its samples. [s]
    edges : array (time, linkages), optional
        Where the force jumps between a sample and the next one: the part of the step after the
        jump, 0 to 1; NaN elsewhere.

    Returns
    -------
    travel, deflection : array (time, linkages)
        Simulated motion at the samples of the record.
    """
    c = {name: np.asarray(value, float) for name, value in constants.items()}
    count = sub_steps(c, gearing, step)
    linkage = _Linkage.of_constants(c, gearing, step / count)
    s, a = (np.array(x, float) for x in start)
    state = _State(s, a, np.zeros_like(s), np.zeros_like(a))
    S, A = np.empty_like(force), np.empty_like(force)
    jumps = np.zeros(len(force), bool)
    if edges is not None:
        jumps = np.isfinite(edges).any(axis=1)
    for k in range(len(force)):
        S[k], A[k] = state.s, state.a if linkage.has_cable else state.s
        if k + 1 == len(force):
            break
        F, M = force[k], moment[k]
        dF, dM = (force[k + 1] - F) / count, (moment[k + 1] - M) / count
        for i in range(count):
            # Force and moment at the middle of the sub-step.
            part = i + 0.5
            f = F + part * dF
            if edges is not None and jumps[k]:
                # The sub-step with the jump has the mean force, so the motion is smooth in `edges`.
                after = np.clip(i + 1.0 - (1.0 - edges[k]) * count, 0.0, 1.0)
                f = np.where(np.isfinite(after), F + after * count * dF, f)
            state = linkage.advance(state, f, M, part=part, dM=dM)
    return S, linkage.rigging + gearing * A


class _State(NamedTuple):
    """Positions of cockpit end and surface end, and their velocities."""

    s: np.ndarray
    a: np.ndarray
    v: np.ndarray
    u: np.ndarray


class _Resistance(NamedTuple):
    """Implicit equation of one body: ``plus v+ + friction Sgn + preload Sgn = minus v + force``."""

    plus: np.ndarray | float
    minus: np.ndarray | float
    friction: np.ndarray | float
    preload: np.ndarray | float
    has_preload: bool
    h: float

    def next_velocity(
        self, force: np.ndarray, v: np.ndarray, s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the velocity after a step, and the distance that a reversal inside it takes back.

        A body that reverses comes to rest after the part x of the step and starts anew.  Its way is
        v x h/2 + v+ (1 - x) h/2 in place of (v + v+) h/2.  Without this correction the motion would
        jump by the way of a sub-step wherever a parameter moves a reversal from one sub-step to the
        next, and differences of the motion would show nothing else.
        """
        pushed = self.minus * v + force - self.friction * np.sign(v)
        sliding = self._solve_preloaded(pushed, s)
        if self.has_preload:
            sliding = self._slide_through_neutral(pushed, v, s, sliding)
            from_rest = self._solve_from_rest(force, s)
        else:
            from_rest = _shrink(force, self.friction) / self.plus
        stops = v * sliding <= 0.0
        x = np.where(stops & (v != 0.0), v / np.where(v == sliding, 1.0, v - sliding), 0.0)
        after = np.where(stops, (1.0 - x) * from_rest, sliding)
        correction = np.where(stops, 0.5 * self.h * ((1.0 - x) * v + x * after), 0.0)
        return after, correction

    def _solve_preloaded(self, b: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Return v of plus v + preload Sgn(s + h v / 2) = b."""
        if not self.has_preload:
            return b / self.plus
        neutral = 2.0 * s / self.h
        return _shrink(b + self.plus * neutral, self.preload) / self.plus - neutral

    def _slide_through_neutral(
        self, b: np.ndarray, v: np.ndarray, s: np.ndarray, otherwise: np.ndarray
    ) -> np.ndarray:
        """Return the velocity of a body that slides through its neutral inside a step.

        The implicit equation takes the sign of the end of the step for the whole step. Here the
        preload changes its sign where the body passes neutral; `otherwise` is for other bodies.
        """
        first = s - 0.5 * self.h * v
        side = np.sign(first)
        before = (b - self.preload * side) / self.plus
        last = s + 0.5 * self.h * before
        part = first / np.where(first == last, 1.0, first - last)
        through = before + 2.0 * self.preload * side * (1.0 - part) / self.plus
        crosses = (first * last < 0.0) & (v * before > 0.0) & (v * through > 0.0)
        return np.where(crosses, through, otherwise)

    def _solve_from_rest(self, b: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Return v of plus v + friction Sgn(v) + preload Sgn(s + h v / 2) = b.

        Both steps are at v = 0 and at the velocity that reaches neutral. The solution is a median
        over the branches between them.
        """
        neutral = -2.0 * s / self.h
        is_first = neutral < 0.0
        low, high = np.minimum(neutral, 0.0), np.maximum(neutral, 0.0)
        # Sizes of the steps at `low` and at `high`.
        at_low = np.where(is_first, self.preload, self.friction)
        at_high = np.where(is_first, self.friction, self.preload)
        v = np.minimum(low, (b + at_low + at_high) / self.plus)
        v = np.maximum((b - at_low + at_high) / self.plus, v)
        v = np.minimum(high, v)
        return np.maximum((b - at_low - at_high) / self.plus, v)


def _shrink(b: np.ndarray, friction: np.ndarray | float) -> np.ndarray:
    """Return x of x + friction Sgn(x) = b."""
    return b - np.clip(b, -friction, friction)


class _Linkage(NamedTuple):
    """Constants of linkages for sub-steps of the length h."""

    cockpit: _Resistance
    surface: _Resistance
    stiffness: np.ndarray
    cable_stiffness: np.ndarray | float
    cable_damping: np.ndarray | float
    rigging: np.ndarray
    gearing: float
    has_cable: bool
    h: float

    @classmethod
    def of_constants(cls, c: Mapping[str, np.ndarray], gearing: float, h: float) -> _Linkage:
        """Return linkages with the constants of the surface reduced to the travel."""
        has_cable = "cable_stiffness" in c
        D = c.get("cable_damping", 0.0)
        aft = c.get("inertia", 0.0) * gearing**2
        w = c.get("hinge_damping", 0.0) * gearing**2
        r = c.get("hinge_friction", 0.0) * abs(gearing)
        m, W, R, P = (c[name] for name in ("mass", "damping", "friction", "preload"))
        # Without a cable one body has mass, damping and friction of both.
        if not has_cable:
            m, W, R = m + aft, W + w, R + r
        cockpit = _Resistance(
            plus=m / h + 0.5 * (W + D),
            minus=m / h - 0.5 * (W + D),
            friction=R,
            preload=P,
            has_preload=bool(np.any(P > 0.0)),
            h=h,
        )
        surface = _Resistance(
            plus=aft / h + 0.5 * (w + D),
            minus=aft / h - 0.5 * (w + D),
            friction=r,
            preload=0.0,
            has_preload=False,
            h=h,
        )
        return cls(
            cockpit,
            surface,
            stiffness=c["stiffness"],
            cable_stiffness=c.get("cable_stiffness", 0.0),
            cable_damping=D,
            rigging=c["rigging"],
            gearing=gearing,
            has_cable=has_cable,
            h=h,
        )

    def advance(
        self, state: _State, F: np.ndarray, M: np.ndarray, part: float, dM: np.ndarray
    ) -> _State:
        """Return the state after a sub-step with the force F and the moments M + part dM."""
        s, a, v, u = state
        h, g = self.h, self.gearing
        s = s + 0.5 * h * v
        a = a + 0.5 * h * u if self.has_cable else s
        # Horner's scheme for the hinge moment over the deflection.
        delta = self.rigging + g * a
        H = M[-1] + part * dM[-1]
        for j in range(len(M) - 2, -1, -1):
            H = H * delta + M[j] + part * dM[j]
        f = F - self.stiffness * s
        if not self.has_cable:
            v, correction = self.cockpit.next_velocity(f + g * H, v, s)
            return _State(s + 0.5 * h * v - correction, a, v, u)
        D = self.cable_damping
        tension = self.cable_stiffness * (s - a)
        pull = tension + g * H
        # The cable damps each end with the mean velocity of the other one over the sub-step.  That
        # of the surface is predicted: its old velocity would act as a mass of D h / 2.
        before, (likely, _) = v, self.surface.next_velocity(pull + D * v, u, a)
        v, correction = self.cockpit.next_velocity(f - tension + 0.5 * D * (u + likely), v, s)
        u, aft_correction = self.surface.next_velocity(pull + 0.5 * D * (before + v), u, a)
        return _State(s + 0.5 * h * v - correction, a + 0.5 * h * u - aft_correction, v, u)


@dataclass(frozen=True)
class SimulatedWindow:
    """One window of free motion.

    Attributes
    ----------
    time : array (time,)
        Time. [s]
    travel, deflection : array (time, 2)
        Measured and simulated. [m or rad; rad]
    """

    time: np.ndarray
    travel: np.ndarray
    deflection: np.ndarray

    def misfit(self) -> tuple[float, float]:
        """Return the rms of measured minus simulated travel and deflection.

        They are divided by the range of the measured one.
        """
        return _relative_misfit(self.travel), _relative_misfit(self.deflection)


def _relative_misfit(x: np.ndarray) -> float:
    """Return the rms difference of two columns over the range of the first one."""
    return float(np.sqrt(np.mean((x[:, 0] - x[:, 1]) ** 2)) / np.ptp(x[:, 0]))


def fly_windows(
    loading: ControlLoading, estimates: Mapping[str, float], free: Sequence[xr.Dataset]
) -> list[SimulatedWindow]:
    """Return every window of free motion, simulated with the recorded forces and air.

    Parameters
    ----------
    loading : ControlLoading
        Control circuit.
    estimates : mapping of str to float
        Names of `IdentifiedLoading.estimates`. A negative damping is replaced by zero.
    free : sequence of Dataset (time,)
        Pulses and releases.

    Returns
    -------
    list of SimulatedWindow

    Raises
    ------
    IdentificationError
        A mass or a stiffness that is not positive.
    """
    windows = []
    for record in free:
        for window in free_motion_windows(loading, record):
            windows.append(_simulate_window(loading, estimates, window))
    return windows


def _simulate_window(
    loading: ControlLoading, p: Mapping[str, float], window: xr.Dataset
) -> SimulatedWindow:
    """Return one window, simulated from its mean position at rest."""
    _demand_positive(loading, p)
    moved = control_signals(loading, window, None)
    time, g = moved["time"].values, loading.gearing
    step = float(np.median(np.diff(time)))
    # Hinge moment for Ch = 1, qbar S_hinge c_hinge.
    load = loading.load(moved) / -g
    factors = loading.by_power(moved)
    highest = max(power for power, _ in factors)
    moment = np.zeros((len(time), 1 + highest, 1))
    for (power, factor), term in zip(factors, loading.model.terms):
        moment[:, power, 0] += load * factor * p[loading.term(term)]
    force = moved[f"F_{loading.item}"].values - p["offset"]
    if "bob_weight" in loading.constants:
        force = force - p["bob_weight"] * G0 * (moved["nz"].values - 1.0)
    s, delta = moved["travel"].values, moved[loading.deflection].values
    # The nose-wheel spring acts on the ground only.
    on_ground = float(moved["on_ground"].values.mean())
    constants = _not_negative(p)
    constants["stiffness"] = np.array(
        [p.get("stiffness", 0.0) + p.get("nose_spring", 0.0) * on_ground]
    )
    rigging = p.get("rigging", 0.0)
    constants["rigging"] = np.array([rigging])
    rest = slice(0, max(1, round(REST / step)))
    start = np.array([s[rest].mean()]), np.array([(delta[rest].mean() - rigging) / g])
    S, D = simulate_linkages(
        constants, g, start=start, force=force[:, None], moment=moment, step=step
    )
    return SimulatedWindow(time, np.column_stack([s, S[:, 0]]), np.column_stack([delta, D[:, 0]]))


def _demand_positive(loading: ControlLoading, p: Mapping[str, float]) -> None:
    """Raise an error for a mass or a stiffness that is not positive."""
    wrong = []
    for name in ("mass", "inertia", "cable_stiffness"):
        if name in p and not p[name] > 0.0:
            wrong.append(f"{name} is {p[name]:.3g}")
    if wrong:
        raise IdentificationError(
            f"{loading.item}: {', '.join(wrong)}; join it with the drawings by `with_prior`, "
            f"or take order 2"
        )


def _not_negative(p: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return mass, damping, friction, preload and the constants of the cable, zero if negative."""
    constants = {}
    for name in ("mass", "damping", "friction", *_CABLE):
        if name in p:
            constants[name] = np.array([max(0.0, p[name])])
    constants.setdefault("damping", np.zeros(1))
    constants["preload"] = np.array([max(0.0, p.get("preload", 0.0))])
    return constants
