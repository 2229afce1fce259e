"""A static thrust table and a time constant from recorded thrust: trim points, accelerations, chops
and slams.

Engine model of the simulation: the thrust follows a table over throttle, Mach number and height
with a first-order lag. The nodes of the table follow by non-negative least squares from samples
where the throttle has been still for some seconds; nodes that no such sample reaches are held by a
small penalty on the second differences of the table.  The time constant is the one that reproduces
the whole recordings best.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import lfilter

from flightmech.errors import AeromatchWarning, IdentificationError, UnknownName
from flightmech.terms import basis, make_term
from flighttest.reconstruction.problem.trajectory import lag_weights

_RATE = 5.0  # Hz: a thrust recording carries no more
_SMOOTH = 0.03  # weight of a second difference against one sample per node
_TAU = (0.2, 8.0)  # s
_END = 0.02  # of a time constant: this near to the end of the search it is not measured
_STILL = (
    6.0,
    0.03,
)  # s and throttle: settled when the throttle moved by less during the time before


@dataclass(frozen=True)
class ThrustFit:
    """A fitted thrust table.

    Attributes
    ----------
    leaf : Dataset
        Static thrust as a term leaf over the axes. [N]
    time_constant : float
        Of the first-order lag; between 0.2 and 8 s, see the warning of `fit_thrust` at these ends.
        [s]
    rms_settled, rms : float
        Residual of the settled samples against the table, and of all samples against table and lag.
        [N]
    span : float
        Largest minus smallest recorded thrust. [N]
    """

    leaf: xr.Dataset
    time_constant: float
    rms_settled: float
    rms: float
    span: float


def fit_thrust(
    data: Sequence[Any], axes: Mapping[str, Sequence[float]], engines: Sequence[int] = (1,)
) -> ThrustFit:
    """Fit one static thrust table and one time constant to recorded thrust.

    Parameters
    ----------
    data : sequence of Path or Dataset (time,)
        With ``mach``, ``h`` and, for each engine, ``engineN.throttle`` and ``engineN.thrust`` at a
        uniform rate.
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
        The throttle does not move, so table and lag cannot be found.
    UnknownName
        A needed channel is missing.

    Warns
    -----
    AeromatchWarning
        The time constant lies at an end of the search: it is at most 0.2 s, or at least 8 s, and
        not measured.

    Notes
    -----
    A turbojet spools up and down at different rates; one time constant is the compromise that fits both best.
    """
    runs = [_run(getattr(item, "states", item), tuple(axes), engines) for item in data]
    if not runs or max(np.ptp(run["throttle"]) for run, _, _ in runs) < 0.1:
        raise IdentificationError(
            "the throttle moves by less than 0.1 in all runs; add a run with a power change"
        )
    template = make_term(np.zeros([len(points) for points in axes.values()]), axes)
    designs = [basis(template, run, outside="clamp").toarray() for run, _, _ in runs]
    settled = np.concatenate([_settled(run["throttle"], step) for run, _, step in runs])
    target, design = np.concatenate([thrust for _, thrust, _ in runs]), np.concatenate(designs)
    penalty = (
        _SMOOTH
        * np.sqrt(settled.sum() / design.shape[1])
        * _penalty([len(points) for points in axes.values()])
    )
    nodes, _ = nnls(
        np.vstack([design[settled], penalty]), np.append(target[settled], np.zeros(len(penalty)))
    )

    def rms(log_tau: float) -> float:
        lagged = [
            _lag(design @ nodes, step, float(np.exp(log_tau)))
            for design, (_, _, step) in zip(designs, runs, strict=True)
        ]
        return float(np.sqrt(np.mean((target - np.concatenate(lagged)) ** 2)))

    best = minimize_scalar(rms, bounds=(np.log(_TAU[0]), np.log(_TAU[1])), method="bounded")
    for end, words in zip(_TAU, ("at most", "at least")):
        if abs(best.x - np.log(end)) < _END:
            text = (
                f"time constant of the thrust: {words} {end:g} s, the end of the search; "
                f"these runs do not determine it"
            )
            warnings.warn(text, AeromatchWarning, stacklevel=2)
    leaf = make_term(nodes.reshape(template["value"].shape), axes, source="flight")
    still = float(np.sqrt(np.mean((target - design @ nodes)[settled] ** 2)))
    return ThrustFit(leaf, float(np.exp(best.x)), still, float(best.fun), float(np.ptp(target)))


def _settled(throttle: np.ndarray, step: float) -> np.ndarray:
    """Return where the throttle has not moved for a while; the first sample counts as settled."""

    width = max(round(_STILL[0] / step), 1)
    padded = np.concatenate([np.full(width, throttle[0]), throttle])
    size, origin = width + 1, width // 2
    return (
        maximum_filter1d(padded, size, origin=origin)
        - minimum_filter1d(padded, size, origin=origin)
    )[width:] < _STILL[1]


def _run(
    states: xr.Dataset, axes: tuple[str, ...], engines: Sequence[int]
) -> tuple[dict[str, np.ndarray], np.ndarray, float]:
    """Return the conditions, the mean thrust and the step of a run, thinned to the rate that a
    thrust recording carries.
    """
    needed = [f"engine{i}.{part}" for i in engines for part in ("throttle", "thrust")]
    for name in (*needed, *(axis for axis in axes if axis != "throttle")):
        if name not in states:
            raise UnknownName(
                name, map(str, states.data_vars), "channel", "the fit of the thrust needs it"
            )
    time = states["time"].values
    step = float(np.median(np.diff(time)))
    every = max(round(1.0 / (_RATE * step)), 1)
    mean = {
        part: np.mean([states[f"engine{i}.{part}"].values for i in engines], axis=0)[::every]
        for part in ("throttle", "thrust")
    }
    conditions = {
        axis: mean["throttle"] if axis == "throttle" else states[axis].values[::every]
        for axis in axes
    }
    return conditions | {"throttle": mean["throttle"]}, mean["thrust"], step * every


def _lag(x: np.ndarray, step: float, tau: float) -> np.ndarray:
    """Return `x` behind a first-order lag, started in equilibrium, input linear between samples."""

    (E, c0, c1), _ = lag_weights(tau, step)
    return lfilter([c1, c0], [1.0, -E], x, zi=x[:1] * (1.0 - c1))[0]


def _penalty(shape: Sequence[int]) -> np.ndarray:
    """Return the second differences of a table along each axis, per unit of index."""
    rows = []
    for axis, count in enumerate(shape):
        others = [range(n) for i, n in enumerate(shape) if i != axis]
        for place in product(*others):
            for k in range(1, count - 1):
                row = np.zeros(shape)
                for shift, weight in ((-1, 1.0), (0, -2.0), (1, 1.0)):
                    row[(*place[:axis], k + shift, *place[axis:])] = weight
                rows.append(row.ravel())
    return np.array(rows) if rows else np.zeros((0, int(np.prod(shape))))
