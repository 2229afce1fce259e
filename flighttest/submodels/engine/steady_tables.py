"""Tables of steady performance from whole flights.

The tables give thrust, fuel flow, turbine temperature, or speeds over the lever.  The nodes d of a
table, or of its difference from an a-priori table, are linear in the samples, z = B d + v.  They
are estimated with the prior that they are a Gaussian process over the axes (Matern 3/2):

    cov(d_i, d_j) = sigma_i sigma_j prod_a (1 + r_a) exp(-r_a),   r_a = sqrt(3) |x_ai - x_aj| / l_a

The lengths l_a maximise the likelihood of the samples.  If sigma has no a-priori value, its size
also does.  A node without samples therefore continues its neighbours.  Far from them it returns to
the a-priori value.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 6.
.. [Rasmussen2006] Rasmussen, Williams, Gaussian processes for machine learning, MIT Press 2006,
   5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import OWN, TARGETS
from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flightmech.terms import SOURCES, basis, make_term
from flighttest.remarks import Convergence, Remark, remark_lines
from flighttest.submodels.engine.node_smoothing import SAME_NOISE, TableSamples, smooth_nodes
from flighttest.submodels.engine.schedule import (
    cover_settled_range,
    find_lever_rest,
    settled_speeds,
)
from flighttest.submodels.engine.steady_points import temperature_pressure_ratios

AXES = (*OWN, "mach", "h")
# Candidates of the factor on an a-priori standard error that is not given.
SPREADS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
# Default of the a-priori standard error, as part of the largest a-priori value.
VAGUE = 0.1
# Change of the noise over its tolerance up to which alternating lengths are harmless: 5 % of it.
ALTERNATING = 0.05 / SAME_NOISE
# Distance beyond an axis, in widths of the axis, from which on a sample is outside.
EDGE = 0.02
# Time for which the lever must be at rest before a sample is steady. [s]
SETTLED = 10.0
# Part of the a-priori standard error above which a node has no information from flight.
LEFT = 0.9


@dataclass(frozen=True)
class SteadyTable(ShortText):
    """A table from flight.

    Attributes
    ----------
    leaf : Dataset
        ``value``, ``stderr``, and ``source`` per node: flight, or the source of the a-priori table
        if no sample contributes information.
    rms : float
        Root mean square of the residual, in the unit of the table.
    lengths : dict of str to float
        Correlation length along each axis.
    spread : float
        Factor on the a-priori standard error.
    samples : int
        Number of samples inside the axes.
    convergence : Convergence
        End of the search of lengths, spread and noise. Its change is that of the noise over its
        tolerance, or the number of grid points by which a length still moves if that is larger.
    """

    leaf: xr.Dataset
    rms: float
    lengths: dict[str, float]
    spread: float
    samples: int
    convergence: Convergence

    def remarks(self, name: str) -> list[Remark]:
        """Return a remark if the search did not converge.

        It is a warning if the lengths alternate between neighbours of their grid and the noise
        hardly changes, otherwise an error.
        """
        advice = (
            "values and standard errors of the nodes belong to a noise and to lengths that still "
            "change; give fewer breakpoints or more flights"
        )
        severity = "error" if self.convergence.change > ALTERNATING else "warning"
        subject = f"lengths and noise of {name}"
        return self.convergence.remarks(subject, advice, term=name, severity=severity)

    def report(self, name: str) -> str:
        """Return size, residual and lengths as text."""
        axes = []
        for axis, length in self.lengths.items():
            x = self.leaf[axis].values
            axes.append(f"{axis} {x[0]:.4g} to {x[-1]:.4g} ({len(x)}, smooth over {length:.4g})")
        seen = float((self.leaf["source"] == SOURCES.index("flight")).mean())
        fit = (
            f"{self.samples} samples, residual {self.rms:.4g} rms, {seen:.0%} of the nodes "
            f"from flight"
        )
        line = f"{name} ({TARGETS[name]}) over {', '.join(axes)}: {fit}"
        return "\n".join([line, *remark_lines(self.remarks(name))])


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
        and the channels of target and axes: ``throttle``, ``n1``, ``n2`` [1], ``thrust`` [N],
        ``fuel_flow`` [kg/s], ``itt`` [K].
    target : str
        ``corrected_thrust``, ``thrust``, ``fuel_flow``, ``corrected_fuel_flow``, ``itt``,
        ``corrected_itt``, ``n2_command``, ``corrected_n2_driven`` ...
    axes : mapping of str to sequence of float
        Breakpoints.  The outer breakpoints of a speed are moved if they do not contain the speeds
        at rest with a margin of 0.5 %.
    prior : Dataset, optional
        The a-priori table, over some of the axes. The default of its ``stderr`` is a tenth of its
        largest value.  Without a prior, the nodes start from the mean of the samples.
    scale : float
        Standard error of a factor common to all readings, such as that of the in-flight thrust
        computation. The standard errors of the nodes contain it.

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
    Samples are averaged over a second.  The variance of these means is the larger of two values:
    their own, and that of means over 20 s, scaled.  A lasting disturbance has its full weight.
    """
    grid = _cover_flights(flights, target, axes)
    blocks = _collect_samples(flights, target, grid)
    z = np.concatenate([block.values for block in blocks])
    first, sigma, source = _prior(prior, grid, z)
    # Estimate the difference d from the a-priori nodes.
    differences = [block._replace(values=block.values - block.weights @ first) for block in blocks]
    # An a-priori standard error that is not given has an unknown size.
    spreads: tuple[float, ...] = SPREADS
    if prior is not None and "stderr" in prior:
        spreads = (1.0,)
    fit = smooth_nodes(differences, sigma, grid=list(grid.values()), spreads=spreads)
    residual = np.concatenate([block.values - block.weights @ fit.nodes for block in differences])
    value, variance = first + fit.nodes, np.diag(fit.covariance)
    leaf = _make_leaf(value, np.sqrt(variance + (scale * value) ** 2), target=target, grid=grid)
    # The source of a node is flight only if the samples reduce its a-priori standard error.
    seen = np.sqrt(variance) < LEFT * fit.spread * sigma
    sources = np.where(seen, leaf["source"].values.ravel(), source).astype(np.uint8)
    shape = leaf["value"].shape
    leaf["source"] = leaf["source"].dims, sources.reshape(shape), leaf["source"].attrs
    return SteadyTable(
        leaf,
        rms=float(np.sqrt(np.mean(residual**2))),
        lengths=dict(zip(grid, fit.lengths)),
        spread=fit.spread,
        samples=len(z),
        convergence=fit.convergence,
    )


def _cover_flights(
    flights: Sequence[xr.Dataset], target: str, axes: Mapping[str, Sequence[float]]
) -> dict[str, np.ndarray]:
    """Return the breakpoints of the axes, which cover the speeds of the flights at rest."""
    if target not in TARGETS:
        raise UnknownName(target, TARGETS, "table of an engine deck")
    for axis in axes:
        if axis not in AXES:
            raise UnknownName(axis, AXES, "axis of an engine table")
    grid = {}
    for name, points in axes.items():
        speeds = _speeds_at_rest(flights, name)
        grid[name] = cover_settled_range(np.asarray(points, float), speeds)
    return grid


def _collect_samples(
    flights: Sequence[xr.Dataset], target: str, grid: Mapping[str, np.ndarray]
) -> list[TableSamples]:
    """Return the samples of each flight that has some inside the axes."""
    blocks = []
    for flight in flights:
        block = _samples(flight, target, grid)
        if len(block.values):
            blocks.append(block)
    if not blocks:
        raise IdentificationError(
            f"{target}: no sample inside {_range(grid)}; look at the units, or extend the axes"
        )
    return blocks


def _make_leaf(
    value: np.ndarray, stderr: np.ndarray, target: str, grid: Mapping[str, np.ndarray]
) -> xr.Dataset:
    """Return the leaf of a table from its nodes (node,) and their standard errors."""
    shape = [len(points) for points in grid.values()]
    return make_term(
        value.reshape(shape),
        grid,
        stderr=stderr.reshape(shape),
        source="flight",
        comment=f"{target} from flight",
    )


def _speeds_at_rest(flights: Sequence[xr.Dataset], axis: str) -> np.ndarray:
    """Return the speeds at rest along an axis; empty if the axis is not a speed."""
    name = axis.removeprefix("corrected_")
    if name not in ("n1", "n2"):
        return np.empty(0)
    records = []
    for flight in flights:
        if "time" not in flight.sizes or name not in flight:
            continue
        factor = 1.0
        if axis != name:
            factor = np.sqrt(temperature_pressure_ratios(flight)[0])
        records.append(flight.assign({axis: flight[name] / factor}))
    return settled_speeds(records, axis)


def _range(grid: Mapping[str, np.ndarray]) -> str:
    return ", ".join(f"{name} {points[0]:.4g} to {points[-1]:.4g}" for name, points in grid.items())


def _samples(flight: xr.Dataset, target: str, grid: Mapping[str, np.ndarray]) -> TableSamples:
    """Return the samples of a flight inside the axes."""
    theta, delta = temperature_pressure_ratios(flight)
    channels = {str(name): flight[name].values for name in flight.data_vars}
    channels |= {"temperature_ratio": theta, "pressure_ratio": delta}
    for name in ("n1", "n2"):
        if name in channels:
            channels[f"corrected_{name}"] = channels[name] / np.sqrt(theta)
    quantity = target.removeprefix("corrected_").removesuffix("_command").removesuffix("_driven")
    missing = [name for name in (quantity, *grid) if name not in channels]
    if missing:
        raise UnknownName(missing[0], map(str, flight.data_vars), f"channel, for {target}")
    corrections = {
        "thrust": delta,
        "fuel_flow": delta * np.sqrt(theta),
        "itt": theta,
        "n1": np.sqrt(theta),
        "n2": np.sqrt(theta),
    }
    value = channels[quantity]
    if target.startswith("corrected_"):
        value = value / corrections[quantity]
    timed = "time" in flight.sizes
    used = np.isfinite(value)
    for name, points in grid.items():
        slack = EDGE * (points[-1] - points[0])
        used &= (channels[name] >= points[0] - slack) & (channels[name] <= points[-1] + slack)
    # A schedule is a steady value: only samples with the lever at rest show it.
    if timed and target.endswith(("_command", "_driven")):
        used &= find_lever_rest(flight, SETTLED)
    if not used.any():
        return TableSamples(np.empty((0, 0)), np.empty(0), 0.0)
    leaf = make_term(np.zeros([len(points) for points in grid.values()]), grid)
    B = basis(leaf, {name: channels[name][used] for name in grid}, outside="clamp").toarray()
    step = float(np.median(np.diff(flight["time"].values))) if timed else 0.0
    return TableSamples(B, value[used], step)


def _prior(
    prior: xr.Dataset | None, grid: Mapping[str, np.ndarray], z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a-priori nodes, standard errors and sources (node,) on the axes of the table."""
    mesh = {}
    for name, points in zip(grid, np.meshgrid(*grid.values(), indexing="ij")):
        mesh[name] = points.ravel()
    count = int(np.prod([len(points) for points in grid.values()]))
    source = np.full(count, SOURCES.index("judgement"))
    if prior is None:
        return np.full(count, z.mean()), np.full(count, max(float(np.ptp(z)), 1e-12)), source
    dims = [str(dim) for dim in prior["value"].dims]
    unknown = [dim for dim in dims if dim not in grid]
    if unknown:
        raise UnknownName(
            unknown[0], grid, "axis", "the a-priori table has it; give its breakpoints too"
        )
    B = basis(prior, {dim: mesh[dim] for dim in dims}, outside="clamp")
    weights = np.broadcast_to(B.toarray(), (count, prior["value"].size))
    first = weights @ prior["value"].values.ravel()
    if "stderr" in prior:
        sigma = weights @ prior["stderr"].values.ravel()
    else:
        sigma = np.full(count, VAGUE * np.abs(first).max())
    if "source" in prior:
        # The source of a node is that of the a-priori node with the largest weight.
        source = prior["source"].values.ravel()[weights.argmax(axis=1)].astype(int)
    # A standard error of zero would make the prior singular.
    return first, np.where(sigma > 0.0, sigma, 1e-9 * np.abs(first).max()), source
