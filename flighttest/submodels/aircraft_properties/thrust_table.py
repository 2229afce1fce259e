"""Static thrust table and time constant from recorded thrust.

The records are trim points, accelerations, chops and slams.  The engine model is that of the
simulation: the thrust follows a table over throttle, Mach number and height with a first-order lag.
The nodes of the table follow by non-negative least squares from samples with a settled throttle.  A
small penalty on the second differences of the table determines nodes without such samples.  The
time constant is the one with the smallest residual over the whole records.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import lfilter

from flightmech.errors import AeromatchWarning, IdentificationError, UnknownName
from flightmech.terms import SOURCES, basis, make_term
from flighttest.records.signals.delays import lag_weights

# Rate to which records are reduced; thrust contains no higher frequencies. [Hz]
_RATE = 5.0
# Weight of a second difference against one sample per node.
_SMOOTH = 0.03
# Range of the time constant. [s]
_TAU = (0.2, 8.0)
# Distance of the logarithm of a time constant from an end of the search that counts as the end.
_END = 0.02
# Smallest range of the throttle in one of the runs.
_LEAST_MOVE = 0.1
# Settled samples about a node from which on it is one of the flights.
_SEEN = 1.0
# Distance beyond the breakpoints, as a share of their range, that is not remarked, and the share of
# samples farther out that is.
_BEYOND, _MOST_BEYOND = 0.05, 0.01
# Largest number of evaluations of the search of the time constant.
_EVALUATIONS = 500
# The throttle is settled if it moved by less than this range during this time. [s, 1]
_STILL = (6.0, 0.03)


@dataclass(frozen=True)
class ThrustFit:
    """A fitted thrust table.

    Attributes
    ----------
    leaf : Dataset
        Static thrust as a term leaf over the axes. [N]
    time_constant : float
        Time constant of the first-order lag, 0.2 to 8 s. `fit_thrust` warns at these ends. [s]
    rms_settled, rms : float
        Residual of the settled samples against the table, and of all samples against table and lag.
        [N]
    span : float
        Largest minus smallest recorded thrust. [N]
    converged : bool
        Whether the search of the time constant converged.
    """

    leaf: xr.Dataset
    time_constant: float
    rms_settled: float
    rms: float
    span: float
    converged: bool


def fit_thrust(
    data: Sequence[Any], axes: Mapping[str, Sequence[float]], engines: Sequence[int] = (1,)
) -> ThrustFit:
    """Fit one static thrust table and one time constant to recorded thrust.

    Parameters
    ----------
    data : sequence of Path or Dataset (time,)
        Channels ``mach``, ``h`` and, for each engine, ``engineN.throttle`` and ``engineN.thrust``
        at a uniform rate.
    axes : mapping of str to sequence
        Breakpoints over some of ``throttle``, ``mach``, ``h``. [1], [1], [m]
    engines : sequence of int
        Engines that share the table; their thrust and throttle are averaged.

    Returns
    -------
    ThrustFit

    Raises
    ------
    IdentificationError
        The throttle does not move, so table and lag are not determined; or the non-negative least
        squares of the table do not converge.
    UnknownName
        A required channel is missing.

    Warns
    -----
    AeromatchWarning
        Samples lie beyond the breakpoints of an axis, where the end of the table holds.
    AeromatchWarning
        The time constant lies at an end of the search: it is at most 0.2 s, or at least 8 s, and
        not measured. Or its search did not converge.

    Notes
    -----
    A turbojet accelerates and decelerates at different rates. One time constant is the compromise
    with the smallest residual.
    """
    runs = [_read_run(getattr(item, "states", item), tuple(axes), engines) for item in data]
    throttles = [run.conditions["throttle"] for run in runs]
    if not runs or max(np.ptp(throttle) for throttle in throttles) < _LEAST_MOVE:
        raise IdentificationError(
            f"the throttle moves by less than {_LEAST_MOVE:g} in all runs; add a run with a power "
            f"change"
        )
    for text in _axis_warnings(runs, axes):
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    template = make_term(np.zeros([len(points) for points in axes.values()]), axes)
    designs = [basis(template, run.conditions, outside="clamp").toarray() for run in runs]
    is_settled = [_is_settled(run.conditions["throttle"], run.step) for run in runs]
    settled, design = np.concatenate(is_settled), np.concatenate(designs)
    target = np.concatenate([run.thrust for run in runs])
    nodes = _table_nodes(design[settled], target[settled], shape=template["value"].shape)

    # Thrust of the table with settled throttle, which the lag follows.
    settled_thrust = [(matrix @ nodes, run.step) for matrix, run in zip(designs, runs)]

    def rms(log_tau: float) -> float:
        lagged = []
        for thrust, step in settled_thrust:
            lagged.append(_lag(thrust, step, float(np.exp(log_tau))))
        return float(np.sqrt(np.mean((target - np.concatenate(lagged)) ** 2)))

    best = minimize_scalar(
        rms,
        bounds=(np.log(_TAU[0]), np.log(_TAU[1])),
        method="bounded",
        options={"maxiter": _EVALUATIONS},
    )
    for text in _search_warnings(best):
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    return ThrustFit(
        leaf=_with_sources(template, nodes, seen=design[settled].sum(axis=0)),
        time_constant=float(np.exp(best.x)),
        rms_settled=float(np.sqrt(np.mean((target - design @ nodes)[settled] ** 2))),
        rms=float(best.fun),
        span=float(np.ptp(target)),
        converged=bool(best.success),
    )


def _with_sources(template: xr.Dataset, nodes: np.ndarray, seen: np.ndarray) -> xr.Dataset:
    """Return the table; nodes without the weight of a settled sample are extrapolated, not flown.

    `nodes` [N] and `seen`, the sum of the weights of the settled samples, are (node,).
    """
    shape, dims = template["value"].shape, template["value"].dims
    axes = {str(dim): template[dim].values for dim in dims}
    leaf = make_term(nodes.reshape(shape), axes, source="flight")
    words = np.where(seen.reshape(shape) >= _SEEN, "flight", "judgement")
    source = np.vectorize(SOURCES.index, otypes=[np.uint8])(words)
    return leaf.assign(source=(dims, source, leaf["source"].attrs))


def _axis_warnings(runs: Sequence[_Run], axes: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """Yield warnings on samples beyond the breakpoints of the axes."""
    for name, points in axes.items():
        values = np.concatenate([run.conditions[name] for run in runs])
        low, high = min(points), max(points)
        margin = _BEYOND * (high - low)
        share = float(np.mean((values < low - margin) | (values > high + margin)))
        if share > _MOST_BEYOND:
            yield (
                f"thrust table: {name} of the records is {values.min():.4g} ... "
                f"{values.max():.4g}, its breakpoints are {low:.4g} ... {high:.4g}: "
                f"{100.0 * share:.3g} % of the samples count at the ends; extend the breakpoints, or leave the runs out"
            )


class _Run(NamedTuple):
    """Conditions by axis, mean thrust of the engines [N] and step [s] of one run."""

    conditions: dict[str, np.ndarray]
    thrust: np.ndarray
    step: float


def _search_warnings(best: Any) -> Iterator[str]:
    """Yield warnings on a search of the time constant, from the result of SciPy."""
    if not best.success:
        yield (
            f"time constant of the thrust: not converged after {best.nfev} evaluations, "
            f"{float(np.exp(best.x)):.3g} s; check the records for a thrust that does not follow "
            f"the throttle"
        )
    for end, bound in zip(_TAU, ("at most", "at least")):
        if abs(best.x - np.log(end)) < _END:
            yield (
                f"time constant of the thrust: {bound} {end:g} s, the end of the search; "
                f"these runs do not determine it"
            )


def _table_nodes(design: np.ndarray, target: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the nodes of the table from settled samples, with penalty on second differences."""
    # The penalty has the weight of a part of the average number of samples per node.
    weight = _SMOOTH * np.sqrt(len(target) / design.shape[1])
    penalty = weight * _second_differences(shape)
    equations = np.vstack([design, penalty])
    try:
        nodes, _ = nnls(equations, np.append(target, np.zeros(len(penalty))))
    except RuntimeError as error:
        # SciPy raises it at the limit of iterations, three times the number of nodes.
        raise IdentificationError(
            f"non-negative least squares of the thrust table do not converge for "
            f"{design.shape[1]} nodes and {len(target)} samples; give fewer breakpoints, or "
            f"records without negative thrust"
        ) from error
    return nodes


def _is_settled(throttle: np.ndarray, step: float) -> np.ndarray:
    """Return where the throttle has not moved for a while; the first sample is settled."""
    width = max(round(_STILL[0] / step), 1)
    padded = np.concatenate([np.full(width, throttle[0]), throttle])
    size, origin = width + 1, width // 2
    # Range of the throttle over the last `width` samples.
    high = maximum_filter1d(padded, size, origin=origin)
    low = minimum_filter1d(padded, size, origin=origin)
    return (high - low)[width:] < _STILL[1]


def _read_run(states: xr.Dataset, axes: tuple[str, ...], engines: Sequence[int]) -> _Run:
    """Return a run at the reduced rate."""
    names = []
    for engine in engines:
        names += [f"engine{engine}.throttle", f"engine{engine}.thrust"]
    names += [axis for axis in axes if axis != "throttle"]
    for name in names:
        if name not in states:
            raise UnknownName(
                name, map(str, states.data_vars), "channel", "the fit of the thrust needs it"
            )
    time = states["time"].values
    step = float(np.median(np.diff(time)))
    # The thrust changes slowly, so that a lower rate loses nothing.
    every = max(round(1.0 / (_RATE * step)), 1)
    mean = {}
    for quantity in ("throttle", "thrust"):
        values = [states[f"engine{engine}.{quantity}"].values for engine in engines]
        mean[quantity] = np.mean(values, axis=0)[::every]
    conditions = {"throttle": mean["throttle"]}
    for axis in axes:
        if axis != "throttle":
            conditions[axis] = states[axis].values[::every]
    return _Run(conditions, mean["thrust"], step * every)


def _lag(x: np.ndarray, step: float, tau: float) -> np.ndarray:
    """Return `x` after a first-order lag, from equilibrium, with x linear between samples."""
    (E, c0, c1), _ = lag_weights(tau, step)
    return lfilter([c1, c0], [1.0, -E], x, zi=x[:1] * (1.0 - c1))[0]


def _second_differences(shape: Sequence[int]) -> np.ndarray:
    """Return the second differences of a table along each axis, per unit of index."""
    rows = []
    for axis, count in enumerate(shape):
        # All lines of nodes along the axis.
        across = [range(n) for i, n in enumerate(shape) if i != axis]
        for index in product(*across):
            # Weights 1, -2, 1 on three neighbouring nodes of the line.
            for k in range(1, count - 1):
                row = np.zeros(shape)
                for shift, weight in ((-1, 1.0), (0, -2.0), (1, 1.0)):
                    row[(*index[:axis], k + shift, *index[axis:])] = weight
                rows.append(row.ravel())
    if not rows:
        return np.zeros((0, int(np.prod(shape))))
    return np.array(rows)
