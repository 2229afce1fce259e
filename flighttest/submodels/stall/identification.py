"""Stall model from quasi-steady and accelerated stalls of several configurations.

The parameters of the separation are nonlinear, the coefficients of the terms linear: separable
least squares of all coefficients together (`regress_separable`). Terms of the separated flow are
selected by Schwarz's criterion with the number of independent samples, as in the ground effect.
Those of the attached flow stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from aerodb.store.evaluation import contributions
from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.separable.fit import SeparableFit, regress_separable
from flighttest.regression.separable.search import SeparableProblem, WeightedMinimum
from flighttest.regression.separable_model import ShapeParameter
from flighttest.regression.uncertainty import collinearity
from flighttest.submodels.ground_effect.evidence import independent_samples, schwarz_criterion
from flighttest.submodels.ground_effect.identification import AT_REST
from flighttest.submodels.stall.break_of_lift import (
    NodeFit,
    database_slope,
    demand_stall_records,
    describe_missing_break,
    describe_soft_break,
    reach_of_halves,
    steady_design,
    weigh_break,
)
from flighttest.submodels.stall.candidates import ATTACHED, SEPARATED
from flighttest.submodels.stall.channels import (
    configuration_nodes,
    demand_channels,
    record_labels,
)
from flighttest.submodels.stall.flow import PER_NODE, SHARED, SeparationFlow, with_half_flow
from flighttest.submodels.stall.left_out import left_out_shares
from flighttest.submodels.stall.model import SeparatedModel, SeparatedTerm, term_label
from flighttest.submodels.stall.result import StallIdentification

BOUNDS = {
    "a1": (4.0, 80.0),
    "tau1": (0.5, 40.0),
    "tau2": (0.0, 40.0),
    "asymmetry": (-0.12, 0.12),
}
"""Bounds of the search. [1, 1, 1, rad]"""
# Range of alpha* beyond the flown angles of attack, and its lower end as a share of their range:
# records that reach 10 to 15 deg beyond the stall have it in the lower half.
_BEYOND, _LOWEST = 0.06, 0.15
# Values of a parameter that the data do not determine: no delay, a lag of one chord.
_WITHOUT = {"tau2": 0.0, "tau1": 1.0, "asymmetry": 0.0}
# Values from which the search starts: shares of the range of alpha*, a1, and tau1 = tau2.
_STARTS_STAR = (0.35, 0.5, 0.65, 0.8)
_STARTS_A1 = (12.0, 30.0)
_START_TAU = (4.0, 12.0)
_LATERAL = ("Cl", "Cn")
_NO_SIDE = (
    "neither Cl nor Cn is among the coefficients, and lift, drag and pitching moment of both "
    "halves together hardly show it; fixed at 0"
)
_PASSES = 2  # of selection and search


@dataclass(frozen=True)
class _Task:
    """Records, coefficients and the parameters of the separation that are estimated."""

    records: tuple[xr.Dataset, ...]
    flow: SeparationFlow
    shape: Mapping[str, ShapeParameter]
    terms: Mapping[str, tuple[str, ...]]

    def models(self) -> list[SeparatedModel]:
        """Return the model of every coefficient."""
        estimated = {k: v for k, v in self.shape.items() if k not in self.flow.fixed}
        models = []
        for name, terms in self.terms.items():
            models.append(SeparatedModel(name, terms, estimated, flow=self.flow))
        return models

    def fit(self) -> SeparableFit:
        """Return the fit from the start values of the parameters."""
        return regress_separable(self.models(), list(self.records), "stall")


def identify_stall(
    data: Sequence[xr.Dataset],
    station: float,
    cbar: float,
    database: xr.DataTree | None = None,
    axis: str = "",
    coefficients: Sequence[str] = ("CL", "CD", "Cm", "Cl", "Cn"),
    attached: Mapping[str, Sequence[str]] | None = None,
    names: Sequence[str] = (),
) -> StallIdentification:
    """Identify a stall model.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        Stalls and their entries, as from `coefficients`: the coefficients, ``alpha beta p q r V``,
        reduced rates and deflections. [SI]
    station : float
        Distance of the stations of the wing halves from the plane of symmetry. [m]
    cbar : float
        Reference chord. [m]
    database : DataTree, optional
        Attached flow, whose coefficients are subtracted. The terms `attached` are estimated in any
        case: on top of a database they are its error.
    axis : str
        Variable of the configuration, such as ``delta_f``, over which ``a1`` and ``alpha_star`` are
        tables, with a node for each value that the records hold. Default: one configuration.
    coefficients : sequence of str
        Coefficients of `ATTACHED` to fit; CL is needed.
    attached : mapping of str to sequence of str, optional
        Terms of the attached flow in place of `ATTACHED`.
    names : sequence of str, optional
        Names of the records, for messages.

    Returns
    -------
    StallIdentification

    Raises
    ------
    IdentificationError
        No record, a record without a quantity that a term needs, no record that reaches
        `LEAST_ALPHA` or has a break of the lift, a coefficient without a model, or data that do not
        determine the terms.

    Notes
    -----
    tau2, tau1 and asymmetry that the records do not determine are fixed at zero, one and zero, and
    the rest is fitted again; asymmetry in any case without Cl and Cn. The criteria are those of
    `separable.identifiability`. a1 and alpha_star of a configuration are also not identified if no
    sample is beyond alpha_star, or if the lift has no break, or one that a curved lift
    describes as well (`break_of_lift`).
    """
    wanted = {**ATTACHED, **(attached or {})}
    unknown = [name for name in coefficients if name not in SEPARATED]
    if not data or unknown or "CL" not in coefficients:
        raise IdentificationError(
            f"{len(data)} records, coefficients {' '.join(coefficients)}; give at least one record "
            f"and CL among {' '.join(SEPARATED)}"
        )
    # Lift shows the size of the asymmetry only as a longer break, and alpha_star and a1 give way.
    lopsided = set(_LATERAL) & set(coefficients)
    hidden = {} if lopsided else {"asymmetry": _WITHOUT["asymmetry"]}
    terms: dict[str, tuple[str, ...]] = {}
    for name in coefficients:
        candidates = (term.text for term in SEPARATED[name] if lopsided or not term.is_difference)
        terms[name] = (*wanted[name], *candidates)
    labels = record_labels(names, len(data))
    demand_stall_records(data)
    demand_channels(data, terms, labels)
    records = flown = tuple(with_half_flow(record, station, cbar) for record in data)
    if database is not None:
        records = tuple(_without_database(record, database, coefficients) for record in records)
    flow = SeparationFlow(axis, configuration_nodes(records, axis, labels), hidden)
    task = _Task(records, flow, _shape_parameters(records, flow), terms)
    task = replace(task, shape=_start_values(task))
    # Terms and shape parameters depend on each other.
    for _ in range(_PASSES):
        task = _select_terms(task)
    fit, task, reasons = _fit_determined(task)
    reasons |= _list_unseen(fit, task, flown) | dict.fromkeys(hidden, _NO_SIDE)
    problem = _problem(task)
    s = np.array([fit.value(name)[0] for name in problem.names])
    return StallIdentification(
        fit=fit,
        station=station,
        cbar=cbar,
        flow=task.flow,
        attached={name: tuple(wanted[name]) for name in coefficients},
        separated=_separated_terms(task.terms),
        not_identified=reasons,
        records=records,
        with_database=database is not None,
        left_out=left_out_shares(problem, s),
    )


def _without_database(
    record: xr.Dataset, database: xr.DataTree, coefficients: Sequence[str]
) -> xr.Dataset:
    """Return a record with its coefficients less those of the database."""
    missing = {name: 0.0 for name in AT_REST if name not in record}
    full = record.assign(missing)
    conditions = {str(name): values for name, values in full.data_vars.items()}
    less = {}
    for name in coefficients:
        total = np.zeros(record[name].shape)
        for part in contributions(database, name, conditions, outside="clamp").values():
            total += part
        less[name] = record[name] - total
    return record.assign(less)


def _shape_parameters(
    records: Sequence[xr.Dataset], flow: SeparationFlow
) -> dict[str, ShapeParameter]:
    """Return the nonlinear parameters with their bounds."""
    shape = {}
    for k, name in enumerate(flow.names("alpha_star")):
        alpha = np.concatenate([record["alpha"].values for record in _at_node(records, flow, k)])
        low, high = float(np.quantile(alpha, 0.01)), float(alpha.max())
        shape[name] = ShapeParameter(low + _LOWEST * (high - low), high + _BEYOND)
    for name in flow.names("a1"):
        shape[name] = ShapeParameter(*BOUNDS["a1"])
    for name in SHARED:
        shape[name] = ShapeParameter(*BOUNDS[name])
    return {name: shape[name] for name in flow.parameters if name not in flow.fixed}


def _at_node(records: Sequence[xr.Dataset], flow: SeparationFlow, k: int) -> list[xr.Dataset]:
    """Return the records whose configuration is nearest to a node."""
    if not flow.axis:
        return list(records)
    nodes = np.array(flow.nodes)
    chosen = []
    for record in records:
        if int(np.argmin(np.abs(nodes - float(record[flow.axis].median())))) == k:
            chosen.append(record)
    return chosen


def _problem(task: _Task) -> SeparableProblem:
    """Return the least-squares problem with the weight of one over the size of a coefficient."""
    models = task.models()
    samples = []
    for model in models:
        samples.append(stack_samples(model.target, model.variables, task.records, model))
    problem = SeparableProblem(models, samples)
    problem.weights = np.array([1.0 / max(float(np.std(z)), 1e-12) for z in problem.z])
    return problem


def _start_values(task: _Task) -> dict[str, ShapeParameter]:
    """Return the parameters with the best of a grid of start values."""
    problem = _problem(task)
    best, start = np.inf, np.zeros(0)
    for share in _STARTS_STAR:
        for a1 in _STARTS_A1:
            for tau in _START_TAU:
                trial = _trial_values(task.shape, share, a1, tau)
                found = problem.project(trial, np.zeros(len(trial)))
                if found is not None and found.cost < best:
                    best, start = found.cost, trial
    if not len(start):
        for design, terms in zip(problem.designs(trial), problem.terms, strict=True):
            collinearity.demand_rank(design.A, terms)
        raise IdentificationError(
            "the records do not determine the terms at any start; add stalls, or leave terms out"
        )
    pairs = zip(task.shape.items(), start, strict=True)
    return {name: item._replace(start=float(value)) for (name, item), value in pairs}


def _trial_values(
    shape: Mapping[str, ShapeParameter], share: float, a1: float, tau: float
) -> np.ndarray:
    """Return the values of all parameters of one start."""
    values = []
    for name, item in shape.items():
        if name.startswith("alpha_star"):
            values.append(item.low + share * (item.high - item.low))
        elif name.startswith("a1"):
            values.append(a1)
        elif name == "asymmetry":
            values.append(0.0)
        else:
            values.append(tau)
    return np.array(values)


def _select_terms(task: _Task) -> _Task:
    """Return the task with the terms of least criterion, and the parameters of its minimum."""
    problem = _problem(task)
    s = WeightedMinimum(problem).search(np.zeros(len(problem.names)))
    kept: dict[str, tuple[str, ...]] = {}
    for model, samples, z, design in zip(
        problem.models, problem.samples, problem.z, problem.designs(s), strict=True
    ):
        # A term of the attached flow stays. Without CL: qhat, which is too small for the criterion,
        # tau2 takes its lift, as q and d(alpha)/dt are almost proportional in a stall.
        candidates = {term.text: term.contribution for term in SEPARATED[model.target]}
        names, A = list(model.terms), design.A
        v = _residual(A, z)
        n = independent_samples(v, samples)
        criterion = schwarz_criterion(v, len(names), n)
        while True:
            # One regressor over X and over X_lift are two forms of one term: the better one stays.
            parts = [candidates[name] for name in names if name in candidates]
            double = {part for part in parts if parts.count(part) > 1}
            trials = {}
            for j, name in enumerate(names):
                if name not in candidates or _is_main_lift(model.target, name, names):
                    continue
                if double and candidates[name] not in double:
                    continue
                rest = np.delete(A, j, axis=1)
                trials[j] = schwarz_criterion(_residual(rest, z), len(names) - 1, n)
            if not trials or (min(trials.values()) > criterion and not double):
                break
            worst = min(trials, key=lambda j: trials[j])
            criterion = trials[worst]
            A = np.delete(A, worst, axis=1)
            del names[worst]
        kept[model.target] = tuple(names)
    shape = dict(task.shape)
    for name, value in zip(problem.names, s, strict=True):
        item = shape[name]
        shape[name] = item._replace(start=float(np.clip(value, item.low, item.high)))
    return replace(task, terms=kept, shape=shape)


def _is_main_lift(target: str, name: str, names: Sequence[str]) -> bool:
    """Return whether a term is the last one of CL over the separation, without which X is idle."""
    separated = {term.text for term in SEPARATED["CL"]}
    return target == "CL" and name in separated and len(separated & set(names)) == 1


def _residual(A: np.ndarray, z: np.ndarray) -> np.ndarray:
    return z - A @ np.linalg.lstsq(A, z, rcond=None)[0]


def _fit_determined(task: _Task) -> tuple[SeparableFit, _Task, dict[str, str]]:
    """Return the fit without what the records do not determine, and why it is left out."""
    reasons: dict[str, str] = {}
    while True:
        fit = task.fit()
        estimates = fit.estimates
        why = dict(zip(estimates["term"].values.astype(str), estimates["why"].values.astype(str)))
        fixed = next((name for name in _WITHOUT if why.get(name)), "")
        term = _weakest_term(fit, task)
        if fixed:
            reasons[fixed] = f"{why[fixed]}; fixed at {_WITHOUT[fixed]:g}"
            flow = SeparationFlow(
                task.flow.axis, task.flow.nodes, {**task.flow.fixed, fixed: _WITHOUT[fixed]}
            )
            task = replace(task, flow=flow)
        elif term:
            coefficient, text = term
            reasons[f"{coefficient}: {text}"] = why[term_label(coefficient, text, len(task.terms))]
            rest = tuple(name for name in task.terms[coefficient] if name != text)
            task = replace(task, terms={**task.terms, coefficient: rest})
        else:
            break
    for name in task.shape:
        if name.startswith(PER_NODE) and why.get(name):
            reasons[name] = why[name]
    return fit, task, reasons


def _weakest_term(fit: SeparableFit, task: _Task) -> tuple[str, str] | None:
    """Return coefficient and text of the separated term with the least t that is too small."""
    weakest, least = None, np.inf
    table = fit.estimates
    for coefficient, terms in task.terms.items():
        for text in terms:
            row = table.sel(term=term_label(coefficient, text, len(task.terms)))
            if not str(row["why"].values) or not float(row["t"]) < least:
                continue
            if not _is_main_lift(coefficient, text, terms):
                weakest, least = (coefficient, text), float(row["t"])
    return weakest


def _list_unseen(fit: SeparableFit, task: _Task, flown: Sequence[xr.Dataset]) -> dict[str, str]:
    """Return the parameters of the nodes whose records do not show them, with a reason.

    `flown` are the records with their total lift.

    Raises
    ------
    IdentificationError
        The records of no node show a break of the lift.
    """
    reasons: dict[str, str] = {}
    missing = []
    for k, (a1, star) in enumerate(
        zip(task.flow.names("a1"), task.flow.names("alpha_star"), strict=True)
    ):
        records = _at_node(task.records, task.flow, k)
        value, stderr = fit.value(star)
        place = f"{np.rad2deg(value):.1f} deg" + ", its bound" * int(np.isnan(stderr))
        highest = reach_of_halves(records)
        lift, *others = _fits_of_node(fit, task, records)
        slope = database_slope(_at_node(flown, task.flow, k), records)
        signs = weigh_break(lift, others, slope)
        if not signs.is_shown:
            missing.append(describe_missing_break(signs, highest))
            reasons |= {a1: missing[-1], star: missing[-1]}
        elif signs.is_soft:
            reasons |= {a1: describe_soft_break(signs), star: describe_soft_break(signs)}
        elif highest < value:
            reasons[a1] = reasons[star] = (
                f"the records reach {np.rad2deg(highest):.1f} deg, alpha_star is {place}: the "
                "shape beyond half a chord is an assumption"
            )
        elif np.isnan(fit.value(a1)[1]):
            reasons[star] = f"its standard error holds only for {a1} at its bound"
    if len(missing) == len(task.flow.nodes):
        raise IdentificationError(f"alpha_star is not identified: {missing[-1]}")
    return reasons


def _fits_of_node(fit: SeparableFit, task: _Task, records: Sequence[xr.Dataset]) -> list[NodeFit]:
    """Return CL, then CD and Cm, of some records with their designs at the minimum of the fit."""
    terms = {name: task.terms[name] for name in ("CL", "CD", "Cm") if name in task.terms}
    problem = _problem(replace(task, records=tuple(records), terms=terms))
    s = np.array([fit.value(name)[0] for name in problem.names])
    fits = []
    for k, design in enumerate(problem.designs(s)):
        model = problem.models[k]
        candidates = {term.text for term in SEPARATED[model.target]}
        separated = tuple(name in candidates for name in model.terms)
        # The lift comes first, and only its slope is compared.
        steady = steady_design(problem, s, records) if not k else np.empty((0, 0))
        fits.append(
            NodeFit(
                z=problem.z[k],
                A=design.A,
                terms=tuple(model.terms),
                separated=separated,
                shapes=len(problem.names),
                samples=problem.samples[k],
                steady=steady,
            )
        )
    return fits


def _separated_terms(
    terms: Mapping[str, Sequence[str]],
) -> dict[str, tuple[SeparatedTerm, ...]]:
    """Return the separated terms that are left, by coefficient."""
    found = {}
    for name, texts in terms.items():
        found[name] = tuple(term for term in SEPARATED[name] if term.text in texts)
    return found
