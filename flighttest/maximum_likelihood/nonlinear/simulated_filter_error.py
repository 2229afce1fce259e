"""Filter error of the compiled simulation: maximum likelihood in turbulence.

The likelihood is that of the innovations of an extended Kalman filter. The search begins at the
best end of a search with flights linearised at the maximum of output error (`filter_starts`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.compiler import SimModel
from flighttest.maximum_likelihood.constrained_unknowns import constrain_unknowns
from flighttest.maximum_likelihood.linear.disturbance_choice import (
    compare_disturbances,
    prefer_calm,
)
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust, gust_starts
from flighttest.maximum_likelihood.linear.innovation_likelihood import (
    ConstrainedFilter,
    InnovationLikelihood,
    filtered_datasets,
    noise_starts,
    whiten_innovations,
)
from flighttest.maximum_likelihood.linear.positive_unknowns import (
    refuse_positive_constraints,
    transform_positive,
)
from flighttest.maximum_likelihood.nonlinear.filter_starts import (
    start_by_linear_model,
    start_by_output_error,
)
from flighttest.maximum_likelihood.nonlinear.filtered_flight import FilteredFlight, is_of_filter
from flighttest.maximum_likelihood.nonlinear.kernel_flights import COORDINATES
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.time_domain import (
    SimulatedRecord,
    list_conditions,
    noise_groups,
    output_error,
)
from flighttest.maximum_likelihood.unknowns import Unknown, Wanted, lay_out
from flighttest.regression.equation_error.samples import list_manoeuvres

# coordinates that a disturbance of one of them moves, with those that only their readings need
_GROUPS = (("V", "alpha", "theta", "q"), ("beta", "phi", "p", "r"))
_INTEGRALS = {"h": ("h", "h_agl", "h_baro", "p_static"), "psi": ("psi", "vn", "ve", "lat", "lon")}
_GUST_ANGLES = ("alpha", "beta")
_AIR_QUANTITIES = ("V", "alpha", "beta")  # outputs that may be air-relative or inertial


def simulated_filter_error(
    sim: SimModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    outputs: Sequence[str],
    gusts: Sequence[DrydenGust] = (),
    conditions: Mapping[str, float] | Sequence[Mapping[str, float]] = (),
    noise: str = "common",
    step: float | None = None,
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a compiled model from records in turbulence.

    Parameters
    ----------
    sim, manoeuvres, outputs, conditions, step, iterations
        As in `output_error`.
    parameters : mapping of str to Unknown, tuple or float
        As in `output_error`. Also ``process.alpha``, intensity of white noise in the rate of V,
        alpha, beta, phi, theta, psi, p, q, r or h [its unit per square root of second];
        ``noise.alpha``, standard deviation of the noise of an output, with a start from the record
        by default; ``gust.w`` and ``scale.w``, intensity and scale of a gust, which are as given
        otherwise. [SI]
    gusts : sequence of DrydenGust
        Vertical gusts (``state`` alpha) and lateral gusts (beta). Of ``inertial`` only V, alpha and
        beta are allowed. ``air_relative`` has no effect: the simulation computes what the air does.
        The gust at the first sample of each manoeuvre, ``init.gust_w``, is an unknown in units of
        the intensity.
    noise : {"common", "own"}
        One ``noise.*`` of all manoeuvres, or one for each.
    constraints : sequence of str
        As of `output_error`, among parameters of the simulation. [SI]

    Returns
    -------
    OutputError
        ``residuals`` are the innovations. It is that of `output_error`, with a remark, if the
        records do not need the disturbance: see `prefer_calm`.

    Raises
    ------
    UnknownName
        A parameter or output that the model or the record does not have.
    SchemaError
        Neither ``process.*`` nor gusts; ``process.*``, ``noise.*``, ``gust.*`` or ``scale.*`` that
        does not start above zero; a gust of another state or with another inertial output; as
        `output_error`.
    IdentificationError
        As `output_error`.

    Notes
    -----
    The filter corrects V, alpha, theta and q if a disturbance acts on one of them, beta, phi, p and
    r likewise, and h and psi if an output depends on them. Other states follow the simulation.
    Standard errors are those of coloured innovations.
    """
    records = list_manoeuvres(manoeuvres)
    outputs = list(outputs)
    _check_gusts(gusts)
    _demand_filter_names([*parameters], outputs=outputs, gusts=gusts)
    groups = noise_groups(noise, len(records))
    fixed = list_conditions(conditions, len(records))
    shared = (outputs, fixed, noise, step, iterations, constraints)

    def filter_records(wanted: Wanted, kept: Sequence[DrydenGust]) -> OutputError:
        runs = []
        for record, values in zip(records, fixed):
            runs.append(SimulatedRecord(sim, record, fixed=values, outputs=outputs, step=step))
        return _filter_records(
            runs, wanted, kept, groups=groups, iterations=iterations, constraints=constraints
        )

    fit = filter_records(parameters, gusts)
    fit = prefer_calm(
        fit,
        parameters,
        gusts,
        lambda calm: output_error(sim, records, calm, *shared),
        readings=sum(
            int(np.isfinite(record[name]).sum()) for record, name in product(records, outputs)
        ),
    )
    return compare_disturbances(fit, parameters, gusts, filter_records)


def _filter_records(
    runs: Sequence[SimulatedRecord],
    parameters: Wanted,
    gusts: Sequence[DrydenGust],
    groups: np.ndarray,
    iterations: int,
    constraints: Sequence[str],
) -> OutputError:
    """Return the fit with the given disturbances, whether the records need them or not."""
    outputs = runs[0].output_names
    coordinates = _choose_coordinates([*parameters], outputs=outputs, gusts=gusts)
    own = bool(groups.any())
    unknowns: dict[str, Any] = {}
    for name, start in zip(outputs, noise_starts([run.measured for run in runs])):
        unknowns[f"noise.{name}"] = Unknown(float(start), own=own)
    wanted = {**unknowns, **gust_starts(gusts), **parameters}
    natural = lay_out(wanted, [run.starts for run in runs])
    refuse_positive_constraints(natural.names, constraints)
    constrained = constrain_unknowns(natural, constraints)
    transformed = transform_positive(constrained.layout)
    everything = replace(constrained, full=transform_positive(constrained.full).layout)
    layout = transformed.layout
    pieces = []
    for run, names, columns in zip(runs, natural.bases, natural.columns):
        starts = natural.start[columns]
        pieces.append(FilteredFlight(run, names, starts, coordinates=coordinates, gusts=gusts))
    start = start_by_output_error(
        runs, natural, layout, groups=groups, iterations=iterations, constraints=constraints
    )
    start, worse = start_by_linear_model(pieces, everything, layout, start=start)
    likelihood = InnovationLikelihood(constrained.wrap(pieces, ConstrainedFilter), layout)
    maximum = maximise_likelihood(likelihood, iterations, start=start)
    about: dict[str, str | float | int] = {
        "method": "filter error of the simulation",
        "title": runs[0].sim.title,
        "worse_starts": worse,
    }
    estimates, scatter = filtered_datasets(maximum, transformed, pieces, outputs, about=about)
    steps = [piece.step for piece in pieces]
    estimates = everything.rate(
        constrained.expand(estimates),
        InnovationLikelihood(pieces, everything.full),
        maximum.theta,
        lambda end, full: coloured_likelihood_covariance(
            whiten_innovations(end), full.columns, steps
        )[0],
    )
    residuals = tuple(run.residual(e) for run, e in zip(runs, maximum.residuals.parts))
    return OutputError(estimates, residuals, noise=scatter)


def _check_gusts(gusts: Sequence[DrydenGust]) -> None:
    """Raise SchemaError for gusts that the simulation does not have."""
    problems = []
    for gust in gusts:
        if gust.state not in _GUST_ANGLES:
            problems.append(
                f"gust {gust.name} acts on {gust.state}; allowed: {', '.join(_GUST_ANGLES)}"
            )
        for quantity in ("speed", "scale", "intensity"):
            value = getattr(gust, quantity)
            if not (np.isfinite(value) and value > 0.0):
                problems.append(
                    f"{quantity} of gust {gust.name} is {value:g}; give a positive value"
                )
        if gust.span:
            problems.append(
                f"gust {gust.name} has a span; the air of the simulation does not rotate: leave it "
                f"out"
            )
        wrong = [name for name in gust.inertial if name not in _AIR_QUANTITIES]
        if wrong:
            problems.append(
                f"{', '.join(wrong)} of gust {gust.name} cannot be inertial: the simulation "
                f"computes whether the gust reaches it; allowed: {', '.join(_AIR_QUANTITIES)}"
            )
    names, states = [gust.name for gust in gusts], [gust.state for gust in gusts]
    if len(set(names)) < len(names) or len(set(states)) < len(states):
        problems.append(
            f"gusts are named {', '.join(names)} on {', '.join(states)}; give each its own name "
            f"and angle"
        )
    if problems:
        raise SchemaError("gusts", problems)


def _demand_filter_names(
    names: Sequence[str], outputs: Sequence[str], gusts: Sequence[DrydenGust]
) -> None:
    """Raise for unknowns of the filter that do not exist, and without any disturbance."""
    own = [gust.name for gust in gusts]
    allowed = [f"process.{name}" for name in COORDINATES]
    allowed += [f"noise.{name}" for name in outputs]
    for name in own:
        allowed += [f"gust.{name}", f"scale.{name}", f"init.gust_{name}"]
    for name in names:
        if is_of_filter(name) and name not in allowed:
            raise UnknownName(name, allowed, "parameter of the filter")
    if not gusts and not any(name.startswith("process.") for name in names):
        text = (
            "no disturbance; give process.* among the parameters or gusts, or use output_error, "
            "which is the same fit in calm air"
        )
        raise SchemaError("filter error", [text])


def _choose_coordinates(
    names: Sequence[str], outputs: Sequence[str], gusts: Sequence[DrydenGust]
) -> list[str]:
    """Return the coordinates that the filter corrects."""
    disturbed = {gust.state for gust in gusts}
    disturbed |= {name.partition(".")[2] for name in names if name.startswith("process.")}
    chosen: list[str] = []
    for group, integral in zip(_GROUPS, _INTEGRALS):
        if disturbed & {*group, integral}:
            chosen += group
            if integral in disturbed or set(_INTEGRALS[integral]) & set(outputs):
                chosen.append(integral)
    return [name for name in COORDINATES if name in chosen]
