"""Joint estimate of thrust, power and drag at points, and whether thrust and drag are separable.

Mixed estimation [Theil1961] by Gauss-Newton steps: residuals of all equations, and the a-priori
values with their standard errors.  Each equation has noise of its own size, from its residuals; a
correlation of successive residuals of a record enlarges it, because such points are not
independent.

Separability: with the a-priori knowledge of the level of thrust and of the drag polar taken away,
the correlation of the thrust (mean of the points) with the best combination of CD0 and K is

    rho^2 = 1 - var(thrust | drag known) / var(thrust)

At rho = 0.95 an error of the thrust is 3.2 times what it would be if the drag were known, and a
tenth of the information determines it: a variance inflation factor of ten.  A high correlation
alone does no harm if the remaining information is exact enough.  Thrust and drag are therefore not
separable if the correlation exceeds 0.95 and the points alone know the thrust less well than the
a-priori tables do: then most of the information on the thrust is a priori.

References
----------
.. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int. Econ.
   Rev. 2, 1961.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flighttest.reconstruction.dynamics.shaft_condition import table_at
from flighttest.remarks import Convergence
from flighttest.submodels.engine.propellers.corrections import coefficient_slopes
from flighttest.submodels.engine.propellers.equations import PropulsionEquations

# Correlation of thrust and drag up to which they are separable whatever the standard errors.
SEPARABLE = 0.95
# Largest number of steps, which are passes over the noise too. Where two equations disagree about
# an unknown by about their noise, the noise passes from one to the other in hundreds of small
# steps: a small step does not show that the end is near.
_STEPS = 600
# Steps after which one that reverses the last is halved, and after which a large one ends the
# search.
_FULL_STEPS, _LARGE_STEPS = 20, 40
# Step over the a-priori standard error, and relative change of the noise, at convergence.
_SAME, _SAME_NOISE = 1e-5, 1e-4
# Difference for a slope, in a-priori standard errors: wide, so that kinks of the tables at their
# nodes do not make the slopes jump from step to step.
_DIFFERENCE = 0.3
# Step over the a-priori standard errors after which the slopes are computed again.
_MOVED = 0.2
# Largest correlation of successive residuals that is used.
_MOST_CORRELATED = 0.9
# A-priori noise of the force [m/s2] and of the relative equations, which counts as much as two
# points (our judgement). The unknowns can fit an equation of few points exactly.
_FORCE_NOISE, _RELATIVE_NOISE, _NOISE_POINTS = 0.02, 0.01, 2.0
# Factor on an a-priori standard error that takes the knowledge away.
_NO_KNOWLEDGE = 1e3
# Points of a manoeuvre that is tried, and its speeds over the flown ones.
_TRIED_POINTS, _SLOWER = 12, 0.8


@dataclass(frozen=True)
class PointEstimate(ShortText):
    """Estimate of the unknowns of `PropulsionEquations`.

    Attributes
    ----------
    value : array (unknown,)
    covariance : array (unknown, unknown)
    noise : dict of str to float
        Standard deviation of the residuals by equation, in their units.
    inflation : dict of str to float
        Factor on the variance for correlated residuals.
    residuals : dict of str to array (point,)
    jacobian : dict of str to array (point, unknown)
    convergence : Convergence
    """

    value: np.ndarray
    covariance: np.ndarray
    noise: dict[str, float]
    inflation: dict[str, float]
    residuals: dict[str, np.ndarray]
    jacobian: dict[str, np.ndarray]
    convergence: Convergence

    def information(self) -> np.ndarray:
        """Return the information of the points, without a-priori values (unknown, unknown)."""
        total = np.zeros_like(self.covariance)
        for name, G in self.jacobian.items():
            total += G.T @ G / (self.noise[name] ** 2 * self.inflation[name])
        return total


def estimate_points(equations: PropulsionEquations) -> PointEstimate:
    """Estimate the unknowns.

    Raises
    ------
    IdentificationError
        No unknown has an a-priori standard error, or an equation is not finite.
    """
    first, sigma = equations.first(), equations.prior_errors()
    free = np.flatnonzero(sigma > 0.0)
    if not free.size:
        raise IdentificationError(
            "all standard errors are zero; give those of the prior or the polar"
        )
    u = first.copy()
    noise: dict[str, float] = {}
    inflation: dict[str, float] = {}
    runs = equations.runs()
    convergence, moved = Convergence(False, 0, np.inf), np.inf
    jacobian: dict[str, np.ndarray] = {}
    previous = np.zeros(free.size)
    for count in range(1, _STEPS + 1):
        residuals = equations.residuals(u)
        for name, v in residuals.items():
            if not np.isfinite(v).all():
                raise IdentificationError(
                    f"the equation of {name} has no number at {np.sum(~np.isfinite(v))} of "
                    f"{v.size} points; check the units of the records, of engineN.rpm first"
                )
        # The equations are nearly linear: slopes near the solution stay.
        if moved > _MOVED:
            jacobian = _jacobian(equations, u, sigma)
        if not noise:
            noise = {name: _pooled_noise(name, v, spent=0.0) for name, v in residuals.items()}
            inflation = dict.fromkeys(residuals, 1.0)
        # Normal equations [Theil1961]; the Jacobian is that of the residuals.
        M = np.diag(1.0 / sigma[free] ** 2)
        b = (first - u)[free] / sigma[free] ** 2
        for name, v in residuals.items():
            weight = 1.0 / (noise[name] ** 2 * inflation[name])
            G = jacobian[name][:, free]
            M += weight * G.T @ G
            b -= weight * G.T @ v
        D = np.linalg.inv(M)
        step = D @ b
        # Tables have kinks at their nodes; half steps end a cycle about one of them.
        is_reversed = float((step / sigma[free] ** 2) @ previous) < 0.0
        u[free] += 0.5 * step if count >= _FULL_STEPS and is_reversed else step
        previous = step
        new, inflation = _new_noise(
            equations, u, jacobian, D=D, free=free, old=(noise, inflation), runs=runs
        )
        change = max(abs(new[name] / noise[name] - 1.0) for name in new) / _SAME_NOISE
        moved = float(np.max(np.abs(step) / sigma[free]))
        change = max(change, moved / _SAME)
        noise = new
        convergence = Convergence(bool(change <= 1.0), count, float(change))
        if convergence.converged or (count >= _LARGE_STEPS and moved > _MOVED):
            break
    C = np.zeros((len(u), len(u)))
    C[np.ix_(free, free)] = D
    return PointEstimate(
        u,
        C,
        noise,
        inflation=inflation,
        residuals=equations.residuals(u),
        jacobian=jacobian,
        convergence=convergence,
    )


def _pooled_noise(name: str, v: np.ndarray, spent: float) -> float:
    """Return the noise of an equation from its residuals and the a-priori noise."""
    prior = _FORCE_NOISE if name == "force" else _RELATIVE_NOISE
    total = v @ v + _NOISE_POINTS * prior**2
    return float(np.sqrt(total / (max(len(v) - spent, 0.0) + _NOISE_POINTS)))


def _rms(v: np.ndarray) -> float:
    return float(np.sqrt(np.mean(v**2)))


def _jacobian(
    equations: PropulsionEquations, u: np.ndarray, sigma: np.ndarray, central: bool = True
) -> dict[str, np.ndarray]:
    """Return the slopes of the residuals by differences, central or forward (point, unknown)."""
    at_u = {} if central else equations.residuals(u)
    columns: dict[str, list[np.ndarray]] = {}
    for k, s in enumerate(sigma):
        step = np.zeros(len(u))
        step[k] = _DIFFERENCE * s if s > 0.0 else _DIFFERENCE * max(abs(u[k]), 1e-3)
        below, width = at_u, step[k]
        if central:
            below, width = equations.residuals(u - step), 2.0 * step[k]
        for name, v in equations.residuals(u + step).items():
            columns.setdefault(name, []).append((v - below[name]) / width)
    return {name: np.column_stack(parts) for name, parts in columns.items()}


def _new_noise(
    equations: PropulsionEquations,
    u: np.ndarray,
    jacobian: Mapping[str, np.ndarray],
    *,
    D: np.ndarray,
    free: np.ndarray,
    old: tuple[dict[str, float], dict[str, float]],
    runs: Mapping[str, np.ndarray],
) -> tuple[dict[str, float], dict[str, float]]:
    """Return noise and inflation by equation, less the degrees of freedom that it determines."""
    noise, inflation = {}, {}
    for name, v in equations.residuals(u).items():
        G = jacobian[name][:, free]
        weight = 1.0 / (old[0][name] ** 2 * old[1][name])
        spent = float(np.trace(D @ G.T @ G)) * weight
        noise[name] = _pooled_noise(name, v, spent)
        rho = _successive_correlation(v, runs[name])
        inflation[name] = (1.0 + rho) / (1.0 - rho)
    return noise, inflation


def _successive_correlation(v: np.ndarray, run: np.ndarray) -> float:
    """Return the correlation of successive residuals of a record, from 0 to 0.9."""
    together = run[1:] == run[:-1]
    if not together.any() or not (v @ v > 0.0):
        return 0.0
    product = float(np.mean((v[1:] * v[:-1])[together]))
    return float(np.clip(product / np.mean(v**2), 0.0, _MOST_CORRELATED))


@dataclass(frozen=True)
class Separability(ShortText):
    """Whether the points separate thrust and drag.

    Attributes
    ----------
    correlation, error : float
        Correlation of the thrust (mean of the points) with the drag, and relative standard error of
        the thrust (rms over the points), by the points alone: without a-priori values of either.
        [1]
    posterior, posterior_error : float
        The same with all a-priori values. [1]
    prior_error : float
        Standard error of the thrust of the a-priori tables. [1]
    manoeuvres : dict of str to float
        The standard error by the points alone after further manoeuvres, the best first. [1]
    """

    correlation: float
    error: float
    posterior: float
    posterior_error: float
    prior_error: float
    manoeuvres: dict[str, float]

    @property
    def separable(self) -> bool:
        """Whether the correlation is at most `SEPARABLE`, or the error at most the prior's."""
        return self.correlation <= SEPARABLE or self.error <= self.prior_error


def separate_thrust_and_drag(
    equations: PropulsionEquations, estimate: PointEstimate
) -> Separability | None:
    """Return whether the points separate thrust and drag; None if the polar is held.

    Manoeuvres that are tried have the noise of the flown points: full power and idle at the flown
    speeds, and the flown powers at a speed below the flown ones.
    """
    names, sigma = list(equations.unknowns), equations.prior_errors()
    drag = [names.index(name) for name in ("CD0", "K") if sigma[names.index(name)] > 0.0]
    if not drag:
        return None
    level = names.index("CT_prop scale")
    slopes = _thrust_slopes(equations, estimate)
    information = estimate.information()
    alone = _covariance_of_points(information, sigma, vague=[level, *drag])
    C = estimate.covariance
    tried = {}
    for name, columns in _manoeuvres(equations).items():
        more = information + _force_information(equations, estimate, columns)
        after = _covariance_of_points(more, sigma, vague=[level, *drag])
        tried[name] = _mean_error(slopes, after)
    return Separability(
        _correlation(slopes, alone, drag),
        _mean_error(slopes, alone),
        posterior=_correlation(slopes, C, drag),
        posterior_error=_mean_error(slopes, C),
        prior_error=_mean_error(slopes, np.diag(sigma**2)),
        manoeuvres=dict(sorted(tried.items(), key=lambda item: item[1])),
    )


def _thrust_slopes(equations: PropulsionEquations, estimate: PointEstimate) -> np.ndarray:
    """Return the slopes of CT of the turning propellers over its rms (point, unknown)."""
    names = list(equations.unknowns)
    value = dict(zip(names, map(float, estimate.value)))
    rows, thrust = [], []
    columns = equations.measured(value)
    priors = equations.uncorrected_states(value, columns)
    pairs = zip(equations.states(value, columns), priors, equations.turning)
    for state, prior, on in pairs:
        slopes = coefficient_slopes("CT_prop", prior.CT, prior.at, equations.shapes, names)
        rows.append(slopes[on])
        thrust.append(state.CT[on])
    return np.concatenate(rows) / _rms(np.concatenate(thrust))


def _mean_error(slopes: np.ndarray, C: np.ndarray) -> float:
    """Return the rms over the points of the standard error."""
    return float(np.sqrt(np.mean(np.einsum("ij,jk,ik->i", slopes, C, slopes))))


def _covariance_of_points(
    information: np.ndarray, sigma: np.ndarray, vague: list[int]
) -> np.ndarray:
    """Return the covariance without a-priori values of some unknowns (unknown, unknown)."""
    wide = sigma.copy()
    wide[vague] *= _NO_KNOWLEDGE
    free = np.flatnonzero(wide > 0.0)
    C = np.zeros_like(information)
    C[np.ix_(free, free)] = np.linalg.inv(
        information[np.ix_(free, free)] + np.diag(1.0 / wide[free] ** 2)
    )
    return C


def _correlation(slopes: np.ndarray, C: np.ndarray, drag: list[int]) -> float:
    """Return the correlation of the mean of the points with the drag."""
    mean = slopes.mean(axis=0)
    across = C[drag] @ mean
    explained = across @ np.linalg.solve(C[np.ix_(drag, drag)], across)
    return float(np.sqrt(np.clip(explained / (mean @ C @ mean), 0.0, 1.0)))


def _manoeuvres(equations: PropulsionEquations) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of manoeuvres that are tried, by their description."""
    columns = equations.columns
    V = columns["V"]
    low, high = float(V.min()), float(V.max())
    flown = np.linspace(low, high, _TRIED_POINTS)
    mean = {name: np.full(_TRIED_POINTS, float(np.median(x))) for name, x in columns.items()}
    mean |= {"hdot": np.zeros(_TRIED_POINTS), "f": np.zeros(_TRIED_POINTS)}
    speeds = f"at {low:.0f} to {high:.0f} m/s"
    slow = _SLOWER * low
    # some of the flown points, from the lowest to the highest power
    power = columns.get("engine1.torque", columns.get("engine1.manifold_pressure", V))
    chosen = np.argsort(power)[np.linspace(0, len(V) - 1, _TRIED_POINTS).astype(int)]
    same = {name: x[chosen] for name, x in columns.items()}
    return {
        f"climbs or level accelerations with full power {speeds}": {
            **mean,
            "V": flown,
            **_powered(equations, flown, full=True),
        },
        f"glides or level decelerations with idle power {speeds}": {
            **mean,
            "V": flown,
            **_powered(equations, flown, full=False),
        },
        f"the same powers at {slow:.0f} m/s": same | {"V": np.full(_TRIED_POINTS, slow)},
    }


def _powered(equations: PropulsionEquations, V: np.ndarray, full: bool) -> dict[str, np.ndarray]:
    """Return the channels of all engines at full or at idle power."""
    propeller, more = equations.propeller, {}
    for number in equations.numbers:
        prefix = f"engine{number}."
        own = {name: x for name, x in equations.columns.items() if name.startswith(prefix)}
        # the largest or the smallest recorded value of what makes power
        for name, x in own.items():
            most = float(np.max(x)) if full else float(np.min(x))
            more[name] = np.full(len(V), most)
        rpm = f"{prefix}rpm" if f"{prefix}rpm" in own else f"{prefix}engine_rpm"
        gear = 1.0 if rpm.endswith(".rpm") else propeller.gear_ratio
        more[rpm] = np.full(len(V), float(np.max(own[rpm])))
        if not full:
            # An idling propeller turns at the advance ratio at which it takes no power.
            turns = V / (_windmill_ratio(equations) * propeller.diameter)
            windmill = 2.0 * np.pi * turns * gear
            more[rpm] = np.minimum(windmill, more[rpm]) if propeller.turns_blades else windmill
        for name in (f"{prefix}feather", f"{prefix}rpm_dot"):
            more[name] = np.zeros(len(V))
        if f"{prefix}torque" in own and not full:
            more[f"{prefix}torque"] = np.zeros(len(V))
    return more


def _windmill_ratio(equations: PropulsionEquations) -> float:
    """Return the advance ratio at which the blades at their lower stop take no power."""
    leaf = equations.propeller.tables["CP_prop"]
    J = np.linspace(0.05, equations.propeller.J_end, 200)
    at = {str(dim): np.full(len(J), float(leaf[dim][0])) for dim in leaf["value"].dims}
    at |= {"J": J, "blade_angle": np.full(len(J), equations.propeller.low_pitch), "rpm": J}
    free = np.flatnonzero(table_at(leaf, at) <= 0.0)
    return float(J[free[0]]) if free.size else equations.propeller.J_end


def _force_information(
    equations: PropulsionEquations, estimate: PointEstimate, columns: dict[str, np.ndarray]
) -> np.ndarray:
    """Return the information of the force at further points (unknown, unknown)."""
    other = equations.at_points(columns)
    G = _jacobian(other, estimate.value, equations.prior_errors(), central=False)["force"]
    return G.T @ G / (estimate.noise["force"] ** 2 * estimate.inflation["force"])
