"""Tables of steady performance from whole flights: thrust, fuel flow, turbine temperature, speeds
over the lever.

The nodes d of a table, or of its difference from an a-priori one, are linear in the samples, z = B
d + v, and estimated with the prior that they are a Gaussian process over the axes:

    cov(d_i, d_j) = sigma_i sigma_j prod_a (1 + r_a) exp(-r_a),      r_a = sqrt(3) |x_ai - x_aj| / l_a

(Matern 3/2).  The lengths l_a, and the size of sigma where nothing is known of it, are those under
which the samples are most likely. So a node that was not flown continues its neighbours, and far
from them returns to the a-priori value.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 6.
.. [Rasmussen2006] Rasmussen, Williams, Gaussian processes for machine learning, MIT Press 2006, 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.aircraft.engine_deck import OWN, TARGETS
from flightmech.errors import IdentificationError, UnknownName
from flightmech.terms import SOURCES, basis, make_term
from flighttest.submodels.engine.schedule import (
    cover_settled_range,
    find_lever_rest,
    settled_speeds,
)
from flighttest.submodels.engine.steady_points import temperature_pressure_ratios

AXES = (*OWN, "mach", "h")
BLOCK, LONG = 1.0, 20.0  # means by which noise and slow disturbance are looked at [s]
LENGTHS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)  # that are tried, of the width of an axis
SPREADS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # that are tried, of a standard error that is not known
VAGUE = 0.1  # a-priori standard error without one, of the largest a-priori value
PASSES = 8  # over lengths and noise
JITTER = 1e-8  # on the diagonal of a correlation, for its inverse
EDGE = 0.02  # of the width of an axis beyond which a sample is outside
SETTLED = 10.0  # rest of the lever before a sample counts as settled [s]
LEFT = 0.9  # part of the a-priori standard error above which a node counts as not seen


@dataclass(frozen=True)
class SteadyTable:
    """A table from flight.

    Attributes
    ----------
    leaf : Dataset
        ``value``, ``stderr``, and ``source`` per node: flight, or that of the a-priori table where
        no sample holds more information.
    rms : float
        Of the residual, unit of the table.
    lengths : dict of str to float
        Over which values are correlated, along each axis.
    spread : float
        Factor on the a-priori standard error.
    samples : int
    """

    leaf: xr.Dataset
    rms: float
    lengths: dict[str, float]
    spread: float
    samples: int

    def report(self, name: str) -> str:
        """Return size, residual and lengths as text."""
        grid = {axis: (self.leaf[axis].values, length) for axis, length in self.lengths.items()}
        axes = ", ".join(
            f"{axis} {x[0]:.4g} to {x[-1]:.4g} ({len(x)}, smooth over {length:.4g})"
            for axis, (x, length) in grid.items()
        )
        seen = float((self.leaf["source"] == SOURCES.index("flight")).mean())
        fit = (
            f"{self.samples} samples, residual {self.rms:.4g} rms, {seen:.0%} of the nodes "
            f"from flight"
        )
        return f"{name} ({TARGETS[name]}) over {axes}: {fit}"


def steady_table(
    flights: Sequence[xr.Dataset],
    target: str,
    axes: Mapping[str, Sequence[float]],
    prior: xr.Dataset | None = None,
    scale: float = 0.0,
) -> SteadyTable:
    """Estimate a table of an engine deck from flights.

    Parameters
    ----------
    flights : sequence of Dataset (time,) or (point,)
        As `engine_channels` returns them: ``mach``, ``h`` [m], ``temperature`` [K] if not standard,
        and what target and axes need: ``throttle``, ``n1``, ``n2`` [1], ``thrust`` [N],
        ``fuel_flow`` [kg/s], ``itt`` [K].
    target : str
        ``corrected_thrust``, ``thrust``, ``fuel_flow``, ``corrected_fuel_flow``, ``itt``,
        ``corrected_itt``, ``n2_command``, ``corrected_n2_driven`` ...
    axes : mapping of str to sequence of float
        Breakpoints.  The outer ones of a speed are moved where they do not hold the speeds at rest
        with a margin of 0.5 %.
    prior : Dataset, optional
        The a-priori table, over some of the axes; ``stderr`` where it has one, else a tenth of its
        largest value.  Without one the nodes start from the mean of the samples.
    scale : float
        Standard error of a factor common to all readings, such as that of the in-flight thrust
        computation; in the standard errors.

    Returns
    -------
    SteadyTable

    Raises
    ------
    UnknownName
        Target, axis or a channel.
    IdentificationError
        No samples inside the axes.

    Notes
    -----
    Samples are averaged over a second.  The variance of these means is that of means over 20 s, scaled, where that is more: a
    disturbance that lasts counts as long as it does.
    """
    if target not in TARGETS:
        raise UnknownName(target, TARGETS, "table of an engine deck")
    for axis in axes:
        if axis not in AXES:
            raise UnknownName(axis, AXES, "axis of an engine table")
    grid = {
        name: cover_settled_range(np.asarray(points, float), _settled(flights, name))
        for name, points in axes.items()
    }
    blocks = [_samples(one, target, grid) for one in flights]
    blocks = [block for block in blocks if len(block[1])]
    if not blocks:
        raise IdentificationError(
            f"{target}: no sample inside {_range(grid)}; look at the units, or extend the axes"
        )
    z = np.concatenate([value for _, value, _ in blocks])
    first, sigma, source = _prior(prior, grid, z)
    rest = [(B, value - B @ first, step) for B, value, step in blocks]
    known = prior is not None and "stderr" in prior
    d, C, lengths, spread = _smooth(rest, sigma, list(grid.values()), (1.0,) if known else SPREADS)
    value = first + d
    residual = np.concatenate([y - B @ d for B, y, _ in rest])
    stderr = np.sqrt(np.diag(C) + (scale * value) ** 2)
    shape = [len(points) for points in grid.values()]
    seen = np.sqrt(np.diag(C)) < LEFT * spread * sigma
    leaf = make_term(
        value.reshape(shape),
        grid,
        stderr=stderr.reshape(shape),
        source="flight",
        comment=f"{target} from flight",
    )
    leaf["source"] = (
        leaf["source"].dims,
        np.where(seen, leaf["source"].values.ravel(), source).astype(np.uint8).reshape(shape),
        leaf["source"].attrs,
    )
    return SteadyTable(
        leaf, float(np.sqrt(np.mean(residual**2))), dict(zip(grid, lengths)), spread, len(z)
    )


def _settled(flights: Sequence[xr.Dataset], axis: str) -> np.ndarray:
    """Speeds at rest along an axis; empty when it is no speed."""
    name = axis.removeprefix("corrected_")
    if name not in ("n1", "n2"):
        return np.empty(0)
    timed = [one for one in flights if "time" in one.sizes and name in one]
    return settled_speeds(
        [
            one.assign(
                {
                    axis: one[name]
                    / (np.sqrt(temperature_pressure_ratios(one)[0]) if axis != name else 1.0)
                }
            )
            for one in timed
        ],
        axis,
    )


def _range(grid: Mapping[str, np.ndarray]) -> str:
    return ", ".join(f"{name} {points[0]:.4g} to {points[-1]:.4g}" for name, points in grid.items())


def _samples(
    one: xr.Dataset, target: str, grid: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Weights of the nodes (sample, node) and values of the samples of a flight inside the axes;
    their interval, 0 for points. [s]
    """
    theta, delta = temperature_pressure_ratios(one)
    at = {str(name): one[name].values for name in one.data_vars} | {
        "temperature_ratio": theta,
        "pressure_ratio": delta,
    }
    at |= {f"corrected_{name}": at[name] / np.sqrt(theta) for name in ("n1", "n2") if name in at}
    quantity = target.removeprefix("corrected_").removesuffix("_command").removesuffix("_driven")
    missing = [name for name in (quantity, *grid) if name not in at]
    if missing:
        raise UnknownName(missing[0], map(str, one.data_vars), f"channel, for {target}")
    corrections = {
        "thrust": delta,
        "fuel_flow": delta * np.sqrt(theta),
        "itt": theta,
        "n1": np.sqrt(theta),
        "n2": np.sqrt(theta),
    }
    value = (
        at[quantity] / corrections[quantity] if target.startswith("corrected_") else at[quantity]
    )
    timed = "time" in one.sizes
    used = np.isfinite(value)
    for name, points in grid.items():
        slack = EDGE * (points[-1] - points[0])
        used &= (at[name] >= points[0] - slack) & (at[name] <= points[-1] + slack)
    if timed and target.endswith(("_command", "_driven")):
        used &= find_lever_rest(one, SETTLED)
    if not used.any():
        return np.empty((0, 0)), np.empty(0), 0.0
    leaf = make_term(np.zeros([len(points) for points in grid.values()]), grid)
    B = basis(leaf, {name: at[name][used] for name in grid}, outside="clamp").toarray()
    return B, value[used], float(np.median(np.diff(one["time"].values))) if timed else 0.0


def _prior(
    prior: xr.Dataset | None, grid: Mapping[str, np.ndarray], z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A-priori nodes with their standard errors and sources, on the axes of the table."""
    mesh = dict(zip(grid, (axis.ravel() for axis in np.meshgrid(*grid.values(), indexing="ij"))))
    count = int(np.prod([len(points) for points in grid.values()]))
    judged = np.full(count, SOURCES.index("judgement"))
    if prior is None:
        return np.full(count, z.mean()), np.full(count, max(float(np.ptp(z)), 1e-12)), judged
    strange = [str(dim) for dim in prior["value"].dims if dim not in grid]
    if strange:
        raise UnknownName(
            strange[0], grid, "axis", "the a-priori table has it; give its breakpoints too"
        )
    B = basis(prior, {str(name): mesh[str(name)] for name in prior["value"].dims}, outside="clamp")
    weights = np.broadcast_to(B.toarray(), (count, prior["value"].size))
    first = weights @ prior["value"].values.ravel()
    sigma = (
        weights @ prior["stderr"].values.ravel()
        if "stderr" in prior
        else np.full(count, VAGUE * np.abs(first).max())
    )
    if "source" in prior:
        judged = prior["source"].values.ravel()[weights.argmax(axis=1)].astype(int)
    return first, np.where(sigma > 0.0, sigma, 1e-9 * np.abs(first).max()), judged


def _averaged(x: np.ndarray, count: int) -> np.ndarray:
    """Means of `count` rows."""
    whole = len(x) // count * count
    return x[:whole].reshape(-1, count, *x.shape[1:]).mean(axis=1)


def _smooth(
    blocks: Sequence[tuple[np.ndarray, np.ndarray, float]],
    sigma: np.ndarray,
    grid: Sequence[np.ndarray],
    spreads: Sequence[float],
) -> tuple[np.ndarray, np.ndarray, list[float], float]:
    """Nodes, covariance, lengths along the axes and factor on sigma."""
    counts = [max(round(BLOCK / step), 1) if step else 1 for _, _, step in blocks]
    rows = [
        (_averaged(B, n), _averaged(y, n), bool(step))
        for (B, y, step), n in zip(blocks, counts)
        if len(y) >= n
    ]
    X, y = np.concatenate([B for B, _, _ in rows]), np.concatenate([y for _, y, _ in rows])
    XX, Xy, yy = X.T @ X, X.T @ y, float(y @ y)
    options = [*(LENGTHS for _ in grid), tuple(spreads)]
    choice = [len(values) // 2 for values in options]
    noise = float(np.var(y))

    def precision(chosen: Sequence[int]) -> np.ndarray:
        *lengths, spread = (values[k] for values, k in zip(options, chosen))
        inverse: np.ndarray = np.eye(1)
        for x, length in zip(grid, lengths):
            inverse = np.kron(inverse, np.linalg.inv(_correlation(x, length * np.ptp(x))))
        return inverse / np.outer(spread * sigma, spread * sigma)

    def unlikely(chosen: Sequence[int]) -> float:
        Q = precision(chosen)
        M, b = XX / noise + Q, Xy / noise
        return float(np.linalg.slogdet(M)[1] - np.linalg.slogdet(Q)[1] - b @ np.linalg.solve(M, b))

    for _ in range(PASSES):
        before = list(choice), noise
        for place, values in enumerate(options):
            choice = min(
                ([*choice[:place], k, *choice[place + 1 :]] for k in range(len(values))),
                key=unlikely,
            )
        C = np.linalg.inv(XX / noise + precision(choice))
        d = C @ Xy / noise
        noise = max(
            _long_run([(value - B @ d, timed) for B, value, timed in rows]), 1e-12 * yy / len(y)
        )
        if choice == before[0] and abs(noise - before[1]) < 1e-3 * noise:
            break
    *lengths, spread = (float(values[k]) for values, k in zip(options, choice))
    return d, C, [length * float(np.ptp(x)) for length, x in zip(lengths, grid)], spread


def _correlation(x: np.ndarray, length: float) -> np.ndarray:
    """Correlation of nodes along an axis."""
    r = np.sqrt(3.0) * np.abs(x[:, None] - x) / (length if length > 0.0 else 1.0)
    return (1.0 + r) * np.exp(-r) + JITTER * np.eye(len(x))


def _long_run(residuals: Sequence[tuple[np.ndarray, bool]]) -> float:
    """Variance of a row such that means over a long time scatter as they do."""
    together = np.concatenate([v for v, _ in residuals])
    count = round(LONG / BLOCK)
    means = [_averaged(v, count) for v, timed in residuals if timed and len(v) >= count]
    slow = count * float(np.mean(np.concatenate(means) ** 2)) if means else 0.0
    return max(float(np.mean(together**2)), slow)
