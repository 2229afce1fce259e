"""Gusts of Dryden form as states of a linear model.

Turbulence is not white: at flight speed V a gust of scale L persists for T = L / V. Cross-wind and
vertical gusts of [MIL8785]_ 3.7.1.2 have the one-sided spectrum over spatial frequency

    Phi(Omega) = sigma^2 (L / pi) (1 + 3 (L Omega)^2) / (1 + (L Omega)^2)^2

White noise n of unit intensity gives it through two equal lags:

    a' = -a / T + sigma / sqrt(T) n,   b' = (a - b) / T,   w = sqrt(3) a + (1 - sqrt(3)) b

A gust that is not the same at nose and tail rotates the air. The rotation has no noise of its own
[MIL8785]_: it is the derivative of the gust along the path behind a lag of the span b,

    c' = (w / V - c) / tau,   rate = (w / V - c) / tau,   tau = 4 b / (pi V) of w, 3 b / (pi V) of v

and adds to r, or subtracts from q, where the moments of damping act. The damping of a short period
is M_q + M_alphadot. The air turns against its own alphadot: its moment is (M_alphadot - M_q)
alphadot_g. The factor on the damping, ``turn.w``, is therefore an unknown,

    (M_q - M_alphadot) / (M_q + M_alphadot)

and 1 without M_alphadot. Rolling of the air has a noise of its own, and is not modelled.

The angle w / V adds to the angle of the inertial motion wherever the *air* acts: in the rates, in
the forces that accelerometers feel, and in the reading of a vane. The angle of an inertial platform
contains only the motion that follows.

References
----------
.. [MIL8785] MIL-F-8785C, Flying qualities of piloted airplanes, 1980, 3.7.1.2.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flighttest.maximum_likelihood.linear.state_space import LinearModel
from flighttest.maximum_likelihood.unknowns import Unknown

# output of the two lags
READ = np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
# rotation that follows from the gusts of an angle: rate, sign, and lag over span and speed
_ROTATIONS = {"alpha": ("q", -1.0, 4.0 / np.pi), "beta": ("r", 1.0, 3.0 / np.pi)}
_RATES = ("p", "q", "r")  # states whose equations are those of moments
# expected states of the two lags over the gust: their covariances with it over its variance,
# E a^2 = sigma^2 / 2 and E a b = E b^2 = sigma^2 / 4
_EXPECTED = np.array([[0.5, 0.25], [0.25, 0.25]]) @ READ


@dataclass(frozen=True)
class DrydenGust:
    """Gusts across the flight path, of Dryden form.

    Attributes
    ----------
    state : str
        State of the linear model with the angle of the *inertial* motion, ``alpha`` or ``beta``.
        [rad]
    speed : float
        True airspeed. [m/s]
    scale : float
        L, in the form of MIL-F-8785C; start value if ``scale.w`` is estimated. [m]
    intensity : float
        sigma; start value if ``gust.w`` is estimated. [m/s]
    air_relative : tuple of str
        Outputs that the air drives: vanes and accelerometers.
    inertial : tuple of str
        Outputs of the inertial motion alone, such as the angle of a platform.
    name : str
        Name of the gust in parameters: ``gust.w``, ``scale.w``, ``init.gust_w``, in intensities,
        and with a span ``turn.w``, the factor on the rotation.
    span : float
        Span of the wing, by which the air also rotates: q with gusts of alpha, r with those of
        beta. 0: it does not. [m]
    """

    state: str
    speed: float
    scale: float
    intensity: float
    air_relative: tuple[str, ...]
    inertial: tuple[str, ...] = ()
    name: str = "w"
    span: float = 0.0

    @property
    def states(self) -> tuple[str, str]:
        """Names of the two lags."""
        return f"gust_{self.name}_lead", f"gust_{self.name}_lag"

    @property
    def turn(self) -> str:
        """Name of the lag of the rotation."""
        return f"gust_{self.name}_turn"

    def time(self, values: Mapping[str, float]) -> float:
        """Return T. [s]"""
        return values.get(f"scale.{self.name}", self.scale) / self.speed

    @property
    def turning_time(self) -> float:
        """Return tau of the rotation. [s]"""
        return _ROTATIONS[self.state][2] * self.span / self.speed

    def filter_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return intensity and start of the lags, as ``process.*`` and ``init.*``."""
        lead, lag = self.states
        sigma, time = values.get(f"gust.{self.name}", self.intensity), self.time(values)
        # In intensities: where the air is calm, the first gust is none either. A free one would be
        # an unknown offset of the angle.
        first = values.get(f"init.gust_{self.name}", 0.0) * sigma / self.speed * _EXPECTED
        found = {
            f"process.{lead}": sigma / self.speed / np.sqrt(time),
            f"init.{lead}": float(first[0]),
            f"init.{lag}": float(first[1]),
        }
        if self.span:
            # E c w / E w^2 of the stationary gust: c is the mean of the earlier w by the weight
            # exp(-t / tau) / tau, and E w(0) w(t) / E w^2 is (1 - t / (2 T)) exp(-t / T).
            x = self.turning_time / time
            share = 1.0 / (1.0 + x) - x / (2.0 * (1.0 + x) ** 2)
            found[f"init.{self.turn}"] = float(share * READ @ first)
        return found


def gust_starts(gusts: Sequence[DrydenGust]) -> dict[str, Unknown]:
    """Return the gusts at the first sample as unknowns, each with its own value per manoeuvre.

    They are in intensities, and one intensity is their prior standard error. Without them the
    filter takes the air at the first sample for calm.
    """
    unknowns = {}
    for gust in gusts:
        unknowns[f"init.gust_{gust.name}"] = Unknown(0.0, sigma=1.0, own=True)
    return unknowns


def add_gusts(model: LinearModel, gusts: Sequence[DrydenGust]) -> LinearModel:
    """Return the model with the states of gusts.

    Parameters
    ----------
    model : LinearModel
    gusts : sequence of DrydenGust

    Raises
    ------
    UnknownName
        A gust on a state, or on an output, that the model does not have.
    SchemaError
        Values that are not positive, two gusts of one name, or an output that responds to the angle
        and that is named neither air-relative nor inertial, or both.
    """
    if not gusts:
        return model
    C = model.at({}).C
    problems = []
    for gust in gusts:
        if gust.state not in model.states:
            raise UnknownName(gust.state, model.states, "state")
        problems += _list_problems(gust, model.outputs, C[:, model.states.index(gust.state)])
        problems += _list_rotation_problems(gust, model.states)
    names = [gust.name for gust in gusts]
    if len(set(names)) < len(names):
        problems.append(f"gusts are named {', '.join(names)}; give each its own name")
    if problems:
        raise SchemaError("gusts", problems)
    for gust in gusts:
        model = _add_gust(model, gust)
    return model


def _list_problems(gust: DrydenGust, outputs: Sequence[str], column: np.ndarray) -> list[str]:
    """Return what is wrong with a gust; `column` has the slopes of the outputs by its angle."""
    problems = []
    for quantity in ("speed", "scale", "intensity"):
        value = getattr(gust, quantity)
        if not (np.isfinite(value) and value > 0.0):
            problems.append(f"{quantity} of gust {gust.name} is {value:g}; give a positive value")
    for name in (*gust.air_relative, *gust.inertial):
        if name not in outputs:
            raise UnknownName(name, outputs, "output")
    for name, slope in zip(outputs, column):
        is_air, is_inertial = name in gust.air_relative, name in gust.inertial
        if is_air and is_inertial:
            problems.append(f"{name} is both air-relative and inertial; name it once")
        if slope != 0.0 and not (is_air or is_inertial):
            problems.append(
                f"{name} responds to {gust.state}; name it in air_relative (a vane, an "
                f"accelerometer) or in inertial (an angle of a platform)"
            )
    return problems


def _list_rotation_problems(gust: DrydenGust, states: Sequence[str]) -> list[str]:
    """Return what is wrong with the rotation of the air."""
    if gust.span == 0.0:
        return []
    if not (np.isfinite(gust.span) and gust.span > 0.0):
        return [f"span of gust {gust.name} is {gust.span:g}; give a positive value, or 0"]
    rate = _ROTATIONS[gust.state][0] if gust.state in _ROTATIONS else ""
    if rate not in states:
        return [
            f"gust {gust.name} has a span, but acts on {gust.state} of a model with the states "
            f"{', '.join(states)}; the air rotates with alpha and q, or beta and r"
        ]
    return []


def _add_gust(model: LinearModel, gust: DrydenGust) -> LinearModel:
    """Return the model with the two lags of one gust, and that of its rotation, as last states."""
    position, n = model.states.index(gust.state), len(model.states)
    felt = np.array([float(name in gust.air_relative) for name in model.outputs])
    names = (*gust.states, gust.turn) if gust.span else gust.states
    moments = np.array([float(name in _RATES) for name in model.states])

    def matrices(values: Mapping[str, float]) -> list[np.ndarray]:
        A, B, C, D = model.at(values)
        T, size = gust.time(values), n + len(names)
        whole, seen = np.zeros((size, size)), np.zeros((len(C), size))
        whole[:n, :n], seen[:, :n] = A, C
        # The air acts through the angle of motion and gust.
        whole[:n, n : n + 2] = np.outer(A[:, position], READ)
        whole[n : n + 2, n : n + 2] = np.array([[-1.0, 0.0], [1.0, -1.0]]) / T
        seen[:, n : n + 2] = np.outer(felt * C[:, position], READ)
        if gust.span:
            rate, sign, _ = _ROTATIONS[gust.state]
            turned = np.append(READ, -1.0) / gust.turning_time
            damping = moments * A[:, model.states.index(rate)]
            factor = sign * values.get(f"turn.{gust.name}", 1.0)
            whole[:n, n:] += factor * np.outer(damping, turned)
            whole[-1, n:] = turned
        return [whole, np.vstack([B, np.zeros((len(names), B.shape[1]))]), seen, D]

    return replace(model, states=(*model.states, *names), matrices=matrices)
