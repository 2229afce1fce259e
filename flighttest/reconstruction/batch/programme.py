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
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.problem import identifiability_remarks
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.reconstruction.smoother import ACCEPT, FlightPath, path_of_solution
from flighttest.records.sensors.instruments import instruments_of
from flighttest.records.sensors.measurements import order_windows
from flighttest.remarks import Convergence, Remark, remark_lines, warn_forbidden

Windows = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Batch:
    """A batch reconstruction.

    Attributes
    ----------
    paths : list of Path
        One per record; their constants are the common ones.
    estimates : Dataset (parameter,)
        ``estimate stderr stderr_white prior prior_stderr unit free``, ``correlation (parameter,
        parameter_)``.  ``stderr`` holds the colour of the residuals and the noise of the inertial
        unit, ``stderr_white`` is the Cramer-Rao bound.
    starts : Dataset (segment, state)
        ``estimate stderr stderr_white``, ``record`` and ``time`` of each start: angles, ground
        velocity, height, lagged vane angles.
    noise : DataFrame
        Per channel: noise of the specification and as estimated.
    visibility : Visibility
        What the readings could determine, before the fit.
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

    def report(self) -> str:
        """Return estimates, noise and what could not be seen as text."""
        names = ", ".join(path.states.attrs["record"] or "record" for path in self.paths)
        state = "converged" if self.convergence.converged else "NOT converged"
        lines = [
            f"Batch reconstruction: {names}",
            f"{self.starts.sizes['segment']} segments, {self.iterations} iterations, {state}",
            "",
        ]
        lines += [
            self.visibility.report(),
            "",
            f"{'constant':22s}{'estimate':>13s}{'std. error':>13s}{'Cramer-Rao':>13s}{'prior s.e.':>13s} "
            f" unit",
        ]
        for i, name in enumerate(self.estimates["parameter"].values):
            row = self.estimates.isel(parameter=i, parameter_=i)
            if not bool(row["free"]):
                lines.append(
                    f"{name:22s}{float(row['estimate']):13.5g}{'held':>13s}{'':26s}  "
                    f"{row['unit'].item()}"
                )
                continue
            numbers = "".join(
                f"{float(row[key]):13.5g}"
                for key in ("estimate", "stderr", "stderr_white", "prior_stderr")
            )
            lines.append(f"{name:22s}{numbers}  {row['unit'].item()}")
        lines += ["", f"{'channel':14s}{'noise given':>13s}{'estimated':>13s}"]
        for name, row in self.noise.iterrows():
            word = "  ! residual exceeds the noise" if row.estimated > ACCEPT * row.given else ""
            lines.append(f"{name:14s}{row.given:13.4g}{row.estimated:13.4g}{word}")
        free = self.estimates.isel(
            parameter=self.estimates["free"].values, parameter_=self.estimates["free"].values
        )
        words = identifiability_remarks(free)
        return "\n".join(
            [
                *lines,
                "",
                "After the fit:",
                *(f"  - {word}" for word in words or ["every constant is identifiable"]),
                *remark_lines(self.remarks),
            ]
        )


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
        For its instruments; the noise of the readings is a first value and estimated, that of the
        inertial unit is taken as given.
    windows : sequence, optional
        Per record the windows (start, stop), or None for all of it. [s]
    free : sequence of str, optional
        Constants to estimate from the readings alone; all others stay at their prior mean.  Without
        it all constants are estimated, with their prior.
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
        Constants of `free` that the readings do not show, by name; or the iteration does not
        settle.
    OutOfRange, SchemaError, UnknownName
        As `reconstruct`; a name of `free` that is not a constant.

    Warns
    -----
    AeromatchWarning
        The noise of a channel did not converge.

    Notes
    -----
    The path follows from its start and the recorded rates and accelerations.  Gusts are not part of it.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.3.
    """
    first = _start(records, aircraft, windows, free, prior, rate)
    seen = determine_observability(first)
    if free is not None:
        demand_sight(seen)
    try:
        fitted = fit_batch(first)
    except IdentificationError as error:
        raise IdentificationError("\n  - ".join([str(error), *seen.hidden()])) from error
    batch = _batch(records, aircraft, fitted, seen)
    warn_forbidden(batch.remarks, "batch reconstruction")
    return batch


def observable_constants(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    windows: Sequence[Windows | None] | None = None,
    free: Sequence[str] | None = None,
    rate: float = 50.0,
) -> Observability:
    """Return what the readings of records can determine of the instruments, without a fit;
    arguments as `reconstruct_batch`.
    """
    return determine_observability(_start(records, aircraft, windows, free, None, rate))


def _start(records, aircraft, windows, free, prior, rate) -> BatchEquations:
    if not records:
        raise SchemaError("batch reconstruction", ["no record; give one at least"])
    chosen = windows if windows is not None else [None] * len(records)
    if len(chosen) != len(records):
        raise SchemaError(
            "batch reconstruction",
            [f"{len(chosen)} sets of windows for {len(records)} records; give one per record"],
        )
    specification = instruments_of(aircraft, records[0].attrs)
    setups = [
        assemble_problem(record, aircraft, specification, order_windows(record, own), rate, prior)
        for record, own in zip(records, chosen)
    ]
    return first_equations(layout_unknowns(setups, free))


def _batch(records, aircraft, fitted: BatchSolution, seen: Observability) -> Batch:

    equations = fitted.equations
    plan = equations.layout
    covariance, white = batch_covariances(equations)
    paths = [_path(record, aircraft, i, fitted, covariance) for i, record in enumerate(records)]
    given: dict[str, float] = {}
    for setup in plan.setups:
        for sensor in setup.problem.sensors:
            given.update(zip(sensor.names, map(float, sensor.sigma)))
    rms = equations.rms()
    rows = [
        {"channel": name, "given": given[name], "estimated": value, "readings": n}
        for name, (value, n) in rms.items()
    ]
    return Batch(
        paths=paths,
        estimates=_estimates(plan, equations.at.c, covariance, white),
        starts=_starts(equations, covariance, white),
        noise=pd.DataFrame(rows).set_index("channel"),
        visibility=seen,
        iterations=fitted.iterations,
        convergence=fitted.convergence,
    )


def _path(record, aircraft, i: int, fitted: BatchSolution, covariance: np.ndarray) -> FlightPath:
    """Return the path of one record with the common constants; those held keep the covariance of
    their prior.
    """
    equations = fitted.equations
    plan, setup = equations.layout, equations.layout.setups[i]
    at = plan.places[i]
    own = np.where(np.outer(plan.free[at], plan.free[at]), covariance[np.ix_(at, at)], 0.0)
    held = ~plan.free[at]
    own[np.ix_(held, held)] = setup.problem.constants.covariance[np.ix_(held, held)]
    solution = Solution(
        equations.paths[i],
        equations.at.c[at],
        own,
        equations.cost,
        fitted.iterations,
        settled=fitted.convergence.converged,
    )
    names = tuple(name for name, stays in zip(setup.problem.constants.names, held) if stays)
    return path_of_solution(record, aircraft, replace(setup, held=names), solution)


def _estimates(
    plan: BatchUnknowns, c: np.ndarray, covariance: np.ndarray, white: np.ndarray
) -> xr.Dataset:
    nc, names = len(plan.names), list(plan.names)
    variance = np.diag(covariance)[:nc]
    se = np.sqrt(np.where(plan.free, variance, np.diag(plan.covariance)))
    both = np.outer(plan.free, plan.free)
    correlation = np.where(both, covariance[:nc, :nc] / np.outer(se, se), np.eye(nc))
    return xr.Dataset(
        {
            "estimate": ("parameter", c),
            "stderr": ("parameter", se),
            "stderr_white": ("parameter", np.where(plan.free, np.sqrt(np.diag(white)[:nc]), se)),
            "prior": ("parameter", plan.mean),
            "prior_stderr": ("parameter", np.sqrt(np.diag(plan.covariance))),
            "unit": ("parameter", list(plan.units)),
            "free": ("parameter", plan.free),
            "correlation": (("parameter", "parameter_"), correlation),
        },
        coords={"parameter": names, "parameter_": names},
    )


def _starts(equations: BatchEquations, covariance: np.ndarray, white: np.ndarray) -> xr.Dataset:
    plan = equations.layout
    rows, states = [], ["phi", "theta", "psi", "vn", "ve", "vd", "h", "alpha_vane", "beta_vane"]
    for i, setup in enumerate(plan.setups):
        problem = setup.problem
        names = [*states[:7], *problem.vanes]
        for start, places, k in zip(equations.at.starts[i], plan.start_places(i), problem.starts):
            columns = {
                "estimate": start,
                "stderr": np.sqrt(np.diag(covariance)[places]),
                "stderr_white": np.sqrt(np.diag(white)[places]),
            }
            row = xr.Dataset(
                {key: ("state", value) for key, value in columns.items()}, coords={"state": names}
            )
            rows.append(row.assign(record=i, time=float(problem.time[k])).reindex(state=states))
    return xr.concat(rows, dim="segment")
