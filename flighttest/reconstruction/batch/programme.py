"""Batch reconstruction of one or many records with common instrument constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, SchemaError
from flighttest.reconstruction.batch.estimator import (
    BatchEquations,
    BatchSolution,
    first_equations,
    fit_batch,
)
from flighttest.reconstruction.batch.standard_errors import (
    Observability,
    batch_covariances,
    demand_sight,
    determine_observability,
)
from flighttest.reconstruction.batch.unknowns import BatchUnknowns, layout_unknowns
from flighttest.reconstruction.flight_path import ACCEPT, FlightPath
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.problem import identifiability_remarks
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.reconstruction.smoother import path_of_solution
from flighttest.remarks import Convergence, PrintedResult, Remark, warn_forbidden

Windows = Sequence[tuple[float, float]]
# State variables of a start; a record without a vane does not have its angle.
_RIGID_STATES = ("phi", "theta", "psi", "vn", "ve", "vd", "h")
_START_STATES = (*_RIGID_STATES, "alpha_vane", "beta_vane")


@dataclass(frozen=True)
class Batch(PrintedResult):
    """A batch reconstruction.

    Attributes
    ----------
    paths : list of FlightPath
        One per record, with the common constants.
    estimates : Dataset (parameter,)
        ``estimate stderr stderr_white prior prior_stderr unit free``, ``correlation (parameter,
        parameter_)``. ``stderr`` includes the colour of the residuals and the noise of the inertial
        unit. ``stderr_white`` is the Cramer-Rao bound.
    starts : Dataset (segment, state)
        ``estimate stderr stderr_white``, ``record`` and ``time`` of each start: angles, ground
        velocity, height, lagged vane angles.
    noise : DataFrame
        Per channel: noise of the specification and estimated noise.
    visibility : Observability
        Information of the readings on the constants, before the fit.
    iterations : int
    convergence : Convergence
        End of the rounds of noise. Its change is the largest of a noise over its tolerance.
    """

    paths: list[FlightPath]
    estimates: xr.Dataset
    starts: xr.Dataset
    noise: Any
    visibility: Observability
    iterations: int
    convergence: Convergence

    @property
    def remarks(self) -> list[Remark]:
        """An error if the noise of a channel did not converge."""
        advice = (
            "estimates and standard errors belong to a noise that still changes; give a noise of "
            "the instruments nearer to the residuals, or leave out the channel that contradicts"
        )
        return self.convergence.remarks("noise of the channels", advice)

    def report_lines(self) -> list[str]:
        """Return estimates, noise and constants that the readings do not determine, as lines."""
        names = ", ".join(path.states.attrs["record"] or "record" for path in self.paths)
        is_free = self.estimates["free"].values
        remarks = identifiability_remarks(
            self.estimates.isel(parameter=is_free, parameter_=is_free)
        )
        state = "converged" if self.convergence.converged else "NOT converged"
        lines = [
            f"Batch reconstruction: {names}",
            f"{self.starts.sizes['segment']} segments, {self.iterations} iterations, {state}",
            "",
            self.visibility.report(),
            "",
            *_estimate_lines(self.estimates),
            "",
            *_noise_lines(self.noise),
            "",
            "After the fit:",
        ]
        for remark in remarks or ["every constant is identifiable"]:
            lines.append(f"  - {remark}")
        return lines


def _estimate_lines(estimates: xr.Dataset) -> list[str]:
    """Return the table of the constants of a report."""
    keys = ("estimate", "stderr", "stderr_white", "prior_stderr")
    titles = ("estimate", "std. error", "Cramer-Rao", "prior s.e.")
    lines = [f"{'constant':22s}" + "".join(f"{title:>13s}" for title in titles) + "  unit"]
    for i, name in enumerate(estimates["parameter"].values):
        row = estimates.isel(parameter=i, parameter_=i)
        unit = row["unit"].item()
        if not bool(row["free"]):
            value = f"{float(row['estimate']):13.5g}"
            lines.append(f"{name:22s}{value}{'held':>13s}{'':26s}  {unit}")
            continue
        numbers = "".join(f"{float(row[key]):13.5g}" for key in keys)
        lines.append(f"{name:22s}{numbers}  {unit}")
    return lines


def _noise_lines(noise: Any) -> list[str]:
    """Return the table of the noise of a report."""
    lines = [f"{'channel':14s}{'noise given':>13s}{'estimated':>13s}"]
    for name, row in noise.iterrows():
        line = f"{name:14s}{row.given:13.4g}{row.estimated:13.4g}"
        if row.estimated > ACCEPT * row.given:
            line += "  ! residual exceeds the noise"
        lines.append(line)
    return lines


def reconstruct_batch(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    windows: Sequence[Windows | None] | None = None,
    free: Sequence[str] | None = None,
    prior: xr.Dataset | None = None,
    rate: float = 50.0,
) -> Batch:
    """Reconstruct paths by batch output error, with instrument constants common to all records
    ([LR743] 4.3, type 1).

    Parameters
    ----------
    records : sequence of DataTree
        Flight records, see `reconstruct`.
    aircraft : Aircraft
        For its instruments. The noise of the readings is a first value and is estimated. The noise
        of the inertial unit is not estimated.
    windows : sequence, optional
        Per record the windows (start, stop), or None for the complete record. [s]
    free : sequence of str, optional
        Constants to estimate from the readings alone. All others stay at their prior mean. By
        default all constants are estimated, with their prior.
    prior : Dataset, optional
        `biases` of other runs (`combine_biases`).
    rate : float
        Samples per second of the path. [Hz]

    Returns
    -------
    Batch

    Raises
    ------
    IdentificationError
        The readings do not determine constants of `free`, or the iteration does not converge.
    OutOfRange, SchemaError, UnknownName
        As `reconstruct`; a name of `free` is not a constant; the instruments of two records give
        different priors of a common constant.

    Warns
    -----
    AeromatchWarning
        The noise of a channel did not converge.

    Notes
    -----
    The path follows from its start and the recorded rates and accelerations. It has no gusts.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.3.
    """
    first = _start_equations(records, aircraft, windows=windows, free=free, prior=prior, rate=rate)
    observability = determine_observability(first)
    if free is not None:
        demand_sight(observability)
    try:
        solution = fit_batch(first)
    except IdentificationError as error:
        raise IdentificationError("\n  - ".join([str(error), *observability.hidden()])) from error
    batch = _make_batch(records, aircraft, solution=solution, observability=observability)
    warn_forbidden(batch.remarks, "batch reconstruction")
    return batch


def observable_constants(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    windows: Sequence[Windows | None] | None = None,
    free: Sequence[str] | None = None,
    rate: float = 50.0,
) -> Observability:
    """Return the observability of the constants from records, without a fit.

    The arguments are as in `reconstruct_batch`.
    """
    first = _start_equations(records, aircraft, windows=windows, free=free, prior=None, rate=rate)
    return determine_observability(first)


def _start_equations(records, aircraft, windows, free, prior, rate) -> BatchEquations:
    """Return the equations of all records at the start."""
    if not records:
        raise SchemaError("batch reconstruction", ["no record; give one at least"])
    if windows is None:
        windows = [None] * len(records)
    if len(windows) != len(records):
        raise SchemaError(
            "batch reconstruction",
            [f"{len(windows)} sets of windows for {len(records)} records; give one per record"],
        )
    setups = []
    for record, record_windows in zip(records, windows, strict=True):
        setups.append(assemble_problem(record, aircraft, record_windows, prior=prior, rate=rate))
    return first_equations(layout_unknowns(setups, free))


def _make_batch(records, aircraft, solution: BatchSolution, observability: Observability) -> Batch:
    equations = solution.equations
    covariance, white = batch_covariances(equations)
    paths = []
    for run, record in enumerate(records):
        path = _make_path(record, aircraft, run=run, solution=solution, covariance=covariance)
        paths.append(path)
    return Batch(
        paths=paths,
        estimates=_estimates(equations.layout, equations.at.c, covariance=covariance, white=white),
        starts=_starts(equations, covariance, white),
        noise=_noise_table(equations),
        visibility=observability,
        iterations=solution.iterations,
        convergence=solution.convergence,
    )


def _noise_table(equations: BatchEquations) -> pd.DataFrame:
    """Return specified and estimated noise per channel."""
    specified: dict[str, float] = {}
    for setup in equations.layout.setups:
        for sensor in setup.problem.sensors:
            specified.update(zip(sensor.names, map(float, sensor.sigma), strict=True))
    rows = []
    for name, (value, count) in equations.rms().items():
        rows.append(
            {"channel": name, "given": specified[name], "estimated": value, "readings": count}
        )
    return pd.DataFrame(rows).set_index("channel")


def _make_path(
    record, aircraft, run: int, solution: BatchSolution, covariance: np.ndarray
) -> FlightPath:
    """Return the path of one record with the common constants."""
    equations = solution.equations
    layout, setup = equations.layout, equations.layout.setups[run]
    constants = setup.problem.constants
    places = layout.places[run]
    free = layout.free[places]
    # Fixed constants keep the covariance of their prior.
    fixed = ~free
    constants_covariance = np.where(np.outer(free, free), covariance[np.ix_(places, places)], 0.0)
    constants_covariance[np.ix_(fixed, fixed)] = constants.covariance[np.ix_(fixed, fixed)]
    trajectory = Solution(
        equations.paths[run],
        equations.at.c[places],
        covariance=constants_covariance,
        cost=equations.cost,
        iterations=solution.iterations,
        settled=solution.convergence.converged,
    )
    names = tuple(np.array(constants.names)[fixed].tolist())
    return path_of_solution(record, aircraft, setup=replace(setup, held=names), solution=trajectory)


def _estimates(
    layout: BatchUnknowns, c: np.ndarray, covariance: np.ndarray, white: np.ndarray
) -> xr.Dataset:
    """Return the estimates of the constants. Fixed constants have their prior standard error."""
    nc, names = len(layout.names), list(layout.names)
    prior_variance = np.diag(layout.covariance)
    stderr = np.sqrt(np.where(layout.free, np.diag(covariance)[:nc], prior_variance))
    stderr_white = np.where(layout.free, np.sqrt(np.diag(white)[:nc]), stderr)
    both_free = np.outer(layout.free, layout.free)
    correlation = covariance[:nc, :nc] / np.outer(stderr, stderr)
    correlation = np.where(both_free, correlation, np.eye(nc))
    return xr.Dataset(
        {
            "estimate": ("parameter", c),
            "stderr": ("parameter", stderr),
            "stderr_white": ("parameter", stderr_white),
            "prior": ("parameter", layout.mean),
            "prior_stderr": ("parameter", np.sqrt(prior_variance)),
            "unit": ("parameter", list(layout.units)),
            "free": ("parameter", layout.free),
            "correlation": (("parameter", "parameter_"), correlation),
        },
        coords={"parameter": names, "parameter_": names},
    )


def _starts(equations: BatchEquations, covariance: np.ndarray, white: np.ndarray) -> xr.Dataset:
    """Return the starts of all segments with their standard errors."""
    layout = equations.layout
    stderr, stderr_white = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(white))
    rows = []
    for run, setup in enumerate(layout.setups):
        problem = setup.problem
        starts = zip(
            equations.at.starts[run], layout.start_places(run), problem.starts, strict=True
        )
        for start, places, k in starts:
            row = xr.Dataset(
                {
                    "estimate": ("state", start),
                    "stderr": ("state", stderr[places]),
                    "stderr_white": ("state", stderr_white[places]),
                },
                coords={"state": [*_RIGID_STATES, *problem.vanes]},
            )
            row = row.assign(record=run, time=float(problem.time[k]))
            # A record without a vane has NaN for its angle.
            rows.append(row.reindex(state=list(_START_STATES)))
    return xr.concat(rows, dim="segment")
