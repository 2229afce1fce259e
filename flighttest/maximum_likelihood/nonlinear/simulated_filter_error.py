"""Filter error of the compiled simulation: maximum likelihood in turbulence.

The likelihood is that of the innovations of an extended Kalman filter. The search begins at the
maximum of output error. There the flights are linearised, and a search of the linear problem begins
from several intensities of the disturbance. Its best end is the start of the search with the
simulation itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.simulation.compiler import SimModel
from flighttest.maximum_likelihood.linear.disturbance_choice import compare_disturbances
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust, gust_starts
from flighttest.maximum_likelihood.linear.innovation_likelihood import (
    InnovationLikelihood,
    filtered_datasets,
    intensity_starts,
    noise_starts,
    search_from_starts,
)
from flighttest.maximum_likelihood.linear.positive_unknowns import transform_positive
from flighttest.maximum_likelihood.nonlinear.filtered_flight import FilteredFlight, is_of_filter
from flighttest.maximum_likelihood.nonlinear.kernel_flights import COORDINATES
from flighttest.maximum_likelihood.nonlinear.linearised_flights import LinearisedPiece
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.search import Likelihood, maximise_likelihood
from flighttest.maximum_likelihood.time_domain import (
    SimulatedRecord,
    list_conditions,
    noise_groups,
)
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, Wanted, lay_out
from flighttest.regression.equation_error.samples import list_manoeuvres

# coordinates that a disturbance of one of them moves, with those that only their readings need
_GROUPS = (("V", "alpha", "theta", "q"), ("beta", "phi", "p", "r"))
_INTEGRALS = {"h": ("h", "h_agl", "h_baro", "p_static"), "psi": ("psi", "vn", "ve", "lat", "lon")}
_GUST_ANGLES = ("alpha", "beta")
_AIR_QUANTITIES = ("V", "alpha", "beta")  # outputs that may be air-relative or inertial
_LINEAR_ITERATIONS = 12  # of each search with linearised flights
_STEP, _SIZE = 1e-4, 1e-2  # step of the differences there, in sizes; least size without a prior


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
        The gust at the first sample of each manoeuvre, ``init.gust_w``, is an unknown. [SI]
    noise : {"common", "own"}
        One ``noise.*`` of all manoeuvres, or one for each.

    Returns
    -------
    OutputError
        ``residuals`` are the innovations.

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
    coordinates = _choose_coordinates([*parameters], outputs=outputs, gusts=gusts)
    noise_groups(noise, len(records))  # refuses an unknown word
    fixed = list_conditions(conditions, len(records))
    runs = []
    for record, values in zip(records, fixed):
        runs.append(SimulatedRecord(sim, record, fixed=values, outputs=outputs, step=step))
    sigma = noise_starts([run.measured for run in runs])
    unknowns: dict[str, Any] = {}
    for name, start in zip(outputs, sigma):
        unknowns[f"noise.{name}"] = Unknown(float(start), own=noise == "own")
    wanted = {**unknowns, **gust_starts(gusts), **parameters}
    natural = lay_out(wanted, [run.starts for run in runs])
    transformed = transform_positive(natural)
    layout = transformed.layout
    pieces = []
    for run, names, columns in zip(runs, layout.bases, layout.columns):
        starts = natural.start[columns]
        pieces.append(FilteredFlight(run, names, starts, coordinates=coordinates, gusts=gusts))
    start = _start_by_output_error(runs, layout, iterations=iterations)
    start, worse = _start_by_linear_model(pieces, layout, start=start)
    maximum = maximise_likelihood(InnovationLikelihood(pieces, layout), iterations, start=start)
    about: dict[str, str | float | int] = {
        "method": "filter error of the simulation",
        "title": sim.title,
        "worse_starts": worse,
    }
    estimates, scatter = filtered_datasets(maximum, transformed, pieces, outputs, about=about)
    residuals = []
    for run, e in zip(runs, maximum.residuals.parts):
        residuals.append(run.residual(e))
    shared = (conditions, noise, step, iterations)
    return compare_disturbances(
        OutputError(estimates, tuple(residuals), noise=scatter),
        parameters,
        gusts,
        lambda wanted, kept: simulated_filter_error(sim, records, wanted, outputs, kept, *shared),
    )


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


def _start_by_output_error(
    runs: Sequence[SimulatedRecord], layout: UnknownVector, iterations: int
) -> np.ndarray:
    """Return the start of the search, with the parameters of the simulation by output error.

    The start stays as given if output error fails, as of an unstable aircraft.
    """
    chosen = np.array([not is_of_filter(name) for name in layout.names])
    start = layout.start.copy()
    if not chosen.any():
        return start
    part = _pick_unknowns(layout, chosen)
    try:
        found = maximise_likelihood(
            Likelihood(runs, part, np.zeros(len(runs), int)), iterations, start=part.start
        )
    except IdentificationError:
        return start
    start[chosen] = found.theta
    return start


def _start_by_linear_model(
    pieces: Sequence[FilteredFlight], layout: UnknownVector, start: np.ndarray
) -> tuple[np.ndarray, int]:
    """Return the best end of searches with the flights linearised about a start.

    Also the number of searches that ended above it. Intensities start from several values.
    """
    steps = _STEP * np.where(np.isfinite(layout.sigma), layout.sigma, np.maximum(abs(start), _SIZE))
    linear = []
    for piece, columns in zip(pieces, layout.columns):
        linear.append(LinearisedPiece(piece, start[columns], steps[columns]))
    starts = []
    for given in intensity_starts(layout):
        # of the parameters of the simulation all starts are the same
        first = np.where([is_of_filter(name) for name in layout.names], given, start)
        starts.append(first)
    try:
        likelihood = InnovationLikelihood(linear, layout)
        best, worse = search_from_starts(likelihood, starts, iterations=_LINEAR_ITERATIONS)
    except (IdentificationError, np.linalg.LinAlgError):
        return start, 0
    return best.theta, worse


def _pick_unknowns(layout: UnknownVector, chosen: np.ndarray) -> UnknownVector:
    """Return the vector of some unknowns."""
    position = np.cumsum(chosen) - 1
    bases, columns = [], []
    for names, places in zip(layout.bases, layout.columns):
        kept = chosen[places]
        bases.append(tuple(np.array(names, object)[kept]))
        columns.append(position[places[kept]])
    return replace(
        layout,
        names=tuple(np.array(layout.names, object)[chosen]),
        bases=tuple(bases),
        columns=tuple(columns),
        start=layout.start[chosen],
        sigma=layout.sigma[chosen],
        low=layout.low[chosen],
        high=layout.high[chosen],
    )
