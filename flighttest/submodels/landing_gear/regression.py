"""Which constants of a gear the reconstructed wheel loads determine, and their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import Remark
from flighttest.submodels.landing_gear.explicit import (
    FRICTION,
    LOAD,
    ROLLING,
    GroundRun,
    explicit_fit,
)
from flighttest.submodels.landing_gear.reconstructed_loads import (
    CUTOFF,
    ERRORS,
    WIND_ERROR,
    wheel_loads,
)
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup, wheel_groups, wheels_of

LEG_TERMS = ("stiffness", "stiffness_square", "damping", "orifice", "damping_outwards")
# Standard errors from zero that the first damper and every further term must have.
_FIRST, _FURTHER = 3.0, 5.0


def select_leg_terms(runs: Sequence[GroundRun], group: WheelGroup) -> list[str]:
    """Return the terms of a leg, the most significant added first.

    Parameters
    ----------
    runs : sequence of GroundRun
        Records with their wheel loads.
    group : WheelGroup
        Wheels that share the leg.

    Returns
    -------
    list of str
        Names of `LEG_TERMS`. The spring is always a term.

    Notes
    -----
    Errors of lift and pitching moment are fitted together with the terms.  Otherwise a spring would
    represent effects that grow with speed.  A damper of either kind counts only if it is positive.
    """
    parts, steps = [], []
    for run in runs:
        parts += _leg_columns(run, group)
        steps += [run.interval] * len(group.names)
    columns = {}
    for term in (*LEG_TERMS, "lift", "pitching", "load"):
        columns[term] = np.concatenate([part[term] for part in parts])
    edges = np.cumsum([0, *(len(part["load"]) for part in parts)])
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    always = [name for name in ("lift", "pitching") if columns[name].any()]
    # Forward selection by t value.
    chosen = ["stiffness"]
    while True:
        damped = {"damping", "orifice"} & set(chosen)
        t = {}
        for term in LEG_TERMS:
            # Damping outwards is a difference from a damper, so it needs one.
            if term not in chosen and (term != "damping_outwards" or damped):
                names = [*always, *chosen, term]
                t[term] = _t_value(columns, names, pieces=pieces, steps=steps)
        best = max(t, key=lambda term: t[term], default="")
        threshold = _FIRST if best in ("damping", "orifice") and not damped else _FURTHER
        if not best or t[best] < threshold:
            return chosen
        chosen.append(best)


def _t_value(columns, names: list[str], pieces, steps) -> float:
    """Return the standard errors of the last column from zero; negative for a negative damper."""
    if not columns[names[-1]].any():
        return 0.0
    X = np.column_stack([columns[name] for name in names])
    size = np.linalg.norm(X, axis=0)
    p, *_ = np.linalg.lstsq(X / size, columns["load"], rcond=None)
    v = columns["load"] - X / size @ p
    covariance = coloured_covariance_of(X / size, v, pieces, steps).covariance
    t = float(p[-1] / np.sqrt(covariance[-1, -1]))
    return t if names[-1] in ("damping", "orifice") else abs(t)


def _leg_columns(run: GroundRun, group: WheelGroup) -> list[dict[str, np.ndarray]]:
    """Return the regressors and load of every leg of a group, at the samples with load."""
    legs = []
    for name in group.names:
        k = run.wheels.index(name)
        use = np.isfinite(run.measured[:, k]) & (run.measured[:, k] != 0.0)
        s, rate = run.fields["compression"][use, k], run.fields["rate"][use, k]
        # Spring and its curvature, damping, orifice, and additional damping of the rebound.
        terms = (s, s**2, rate, rate * np.abs(rate), np.minimum(rate, 0.0))
        columns = dict(zip(LEG_TERMS, terms))
        for source in ("lift", "pitching"):
            columns[source] = run.fields["change"][use, k, run.sources.index(source)]
        columns["load"] = run.measured[use, k]
        legs.append(columns)
    return legs


# Fixed friction over the largest used friction, if the aircraft file has less.
_MARGIN = 1.05
# Part of the friction that a wheel must have used. Below it, the value is an extrapolation.
_REACHED = 0.8
# Standard errors from zero of a constant that is determined.
T_NEEDED = 3.0
# Constants that become zero if the records do not need them.
_STRUCTURE = (
    "brake",
    "brake_friction",
    "bend",
    "stiffness_square",
    "orifice",
    "damping_outwards",
)
_NOT_NEGATIVE = ("stiffness", "damping", "orifice", "brake", "brake_friction")
_RANGES = {FRICTION: (0.02, 3.0), "bend": (0.0, 10.0), "cornering": (0.1, 100.0)}
# Typical sizes, for the steps of differences and for the information.
_SIZES = {
    "stiffness_square": 1e5,
    "orifice": 1e4,
    "damping_outwards": 5e3,
    "damping": 5e3,
    "bend": 0.3,
    "brake": 3e3,
    "brake_friction": 0.3,
}


@dataclass(frozen=True)
class LoadFit:
    """Constants of a gear by regression on reconstructed wheel loads.

    Attributes
    ----------
    fit : OutputError
        Constants under the names of `explicit`, and the errors of the inputs.
    held : dict of str to float
        Constants that are not estimated.
    undetermined : dict of str to str
        Constants that the records do not determine, and the reason.
    loads : tuple of Dataset
        Result of `wheel_loads` of each record.
    uncertain : tuple of str
        Constants that a fit removed before it converged.
    """

    fit: OutputError
    held: Mapping[str, float]
    undetermined: Mapping[str, str]
    loads: tuple[xr.Dataset, ...]
    uncertain: tuple[str, ...] = ()

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on fits that did not converge."""
        remarks = convergence_remarks(self.fit, "wheel loads")
        if self.uncertain:
            text = (
                f"wheel loads: {', '.join(self.uncertain)} left out by a fit that is not "
                "converged; "
                f"give more records, or constants of the aircraft nearer to the truth"
            )
            remarks.append(Remark("convergence", text))
        return remarks

    def inputs_of(self, k: int) -> dict[str, float]:
        """Return the errors of the inputs of record k, counted from 0.

        The wind is in addition to that of the states.
        """
        estimates = self.fit.of_manoeuvre(k + 1)
        errors = {name: value for name, value in estimates.items() if name in ERRORS}
        attrs = self.loads[k].attrs
        for name in ("wind_n", "wind_e"):
            errors[name] = estimates.get(name, 0.0) + float(attrs[name])
        return errors


def convergence_remarks(fit: OutputError, source: str) -> list[Remark]:
    """Return the error that a fit did not converge, with the source of its estimates."""
    remarks = []
    for remark in fit.remarks:
        if remark.kind == "convergence":
            remarks.append(replace(remark, text=f"{source}: {remark.text}"))
    return remarks


def known_constants(aircraft: Aircraft) -> dict[str, float]:
    """Return the constants of the aircraft file under the names of `explicit`."""
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    assert aircraft.gear is not None
    constants = {
        FRICTION: aircraft.gear.mu_dry,
        ROLLING: float(np.mean([wheel.rolling for wheel in wheels.values()])),
    }
    for group in wheel_groups(aircraft):
        wheel = wheels[group.names[0]]
        for name in ("stiffness", "damping", "orifice", "brake", "brake_friction"):
            constants[group.parameter(name)] = float(getattr(wheel, name))
        constants[group.parameter("damping_outwards")] = wheel.damping_ext - wheel.damping
        # Inverse of C_max = g N_max / 2 and N_max = 10 kN / sqrt(b), see `explicit`.
        constants[group.parameter("bend")] = (LOAD / wheel.cornering_load) ** 2
        constants[group.parameter("cornering")] = (
            2.0 * wheel.cornering_stiffness / wheel.cornering_load
        )
    return constants


def regress_gear(
    records: Sequence,
    aircraft: Aircraft,
    database: xr.DataTree | None,
    errors: Mapping[str, float],
    cutoff: float = CUTOFF,
) -> LoadFit:
    """Fit the balances of all records together, without the constants they do not determine.

    Such constants are removed one after the other.

    Parameters
    ----------
    records : sequence of Path or Dataset
        As for `wheel_loads`.
    aircraft, database, cutoff
        As for `wheel_loads`.
    errors : mapping of str to float
        Standard errors of the inputs, by the names of `reconstructed_loads.ERRORS`, and ``wind``,
        the largest of a record.

    Raises
    ------
    IdentificationError
        No wheel touches in a record.
    """
    fixed = known_constants(aircraft)
    calm = [(0.0, 0.0)] * len(records)
    loads, runs = _make_runs(records, aircraft, database=database, winds=calm, cutoff=cutoff)
    candidates = _candidates(aircraft, fixed, runs)
    undetermined = _unresponsive(runs, candidates, fixed)
    unknowns = {name: item for name, item in candidates.items() if name not in undetermined}
    inputs = _input_errors(records, database, errors=errors, winds=calm)
    uncertain: list[str] = []
    while True:
        fit = _fit(runs, unknowns, inputs=inputs, fixed=fixed)
        name, reason = _weakest(fit, unknowns)
        if not name and FRICTION in unknowns:
            name, reason, used = _unreached_friction(fit, runs)
            if name:
                fixed[FRICTION] = max(fixed[FRICTION], _MARGIN * used)
        unknowns = _continue_from(fit, unknowns)
        if not name:
            break
        if not fit.estimates.attrs["converged"]:
            uncertain.append(name)
        if name.rpartition(".")[2] in _STRUCTURE:
            fixed[name] = 0.0
        else:
            undetermined[name] = reason
        del unknowns[name]
    # Air forces grow with the square of the wind: fit once more about the estimated wind.
    if any(name.startswith("wind") for name in inputs):
        winds = _estimated_winds(fit, len(records))
        loads, runs = _make_runs(records, aircraft, database=database, winds=winds, cutoff=cutoff)
        inputs = _input_errors(records, database, errors=errors, winds=winds)
        fit = _fit(runs, unknowns, inputs=inputs, fixed=fixed)
    return LoadFit(
        fit,
        held={name: value for name, value in fixed.items() if name not in unknowns},
        undetermined=undetermined,
        loads=loads,
        uncertain=tuple(uncertain),
    )


def _continue_from(fit: OutputError, unknowns: Mapping[str, Unknown]) -> dict[str, Unknown]:
    """Return the unknowns with the estimates of a fit as start values."""
    continued = {}
    for name, unknown in unknowns.items():
        start = float(np.clip(_value(fit, name), unknown.low, unknown.high))
        continued[name] = unknown._replace(start=start)
    return continued


def _estimated_winds(fit: OutputError, count: int) -> list[tuple[float, float]]:
    """Return the estimated wind (north, east) of each record. [m s-1]"""
    winds = []
    for number in range(1, count + 1):
        winds.append((_value(fit, f"wind_n@{number}"), _value(fit, f"wind_e@{number}")))
    return winds


def _make_runs(
    records: Sequence,
    aircraft: Aircraft,
    database,
    winds: Sequence[tuple[float, float]],
    cutoff: float,
):
    """Return the wheel loads of all records, and the runs that predict them."""
    loads = []
    for record, wind in zip(records, winds):
        loads.append(wheel_loads(record, aircraft, database=database, wind=wind, cutoff=cutoff))
    return tuple(loads), [GroundRun(record, aircraft, cutoff) for record in loads]


def _fit(
    runs: Sequence[GroundRun],
    unknowns: Mapping[str, Unknown],
    inputs: Mapping[str, Unknown],
    fixed: Mapping[str, float],
) -> OutputError:
    """Return the fit of constants and errors of the inputs."""
    for run in runs:
        run.fixed = {name: value for name, value in fixed.items() if name not in unknowns}
    return explicit_fit(runs, {**unknowns, **inputs})


def _value(fit: OutputError, name: str) -> float:
    return float(fit.estimates["estimate"].sel(parameter=name))


def _candidates(
    aircraft: Aircraft, known: dict[str, float], runs: Sequence[GroundRun]
) -> dict[str, Unknown]:
    """Return all constants that may be estimated.

    Terms of the legs that the loads do not need become zero in `known`.
    """
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    names = [FRICTION, ROLLING]
    for group in wheel_groups(aircraft):
        wheel = wheels[group.names[0]]
        terms = select_leg_terms(runs, group)
        for term in LEG_TERMS:
            if term not in terms:
                known[group.parameter(term)] = 0.0
        constants = [*terms, "cornering", "bend"]
        if wheel.brake > 0.0 or wheel.brake_friction > 0.0:
            constants += ["brake", "brake_friction"]
        names += [group.parameter(constant) for constant in constants]
    candidates = {}
    for name in names:
        constant = name if name == FRICTION else name.rpartition(".")[2]
        low, high = _RANGES.get(constant, (-np.inf, np.inf))
        start = float(np.clip(known.get(name, 0.0), low, high))
        candidates[name] = Unknown(start, low=low, high=high)
    return candidates


def _unreached_friction(fit: OutputError, runs: Sequence[GroundRun]) -> tuple[str, str, float]:
    """Return name and reason if no wheel came near the friction, and the largest used friction."""
    used = max(run.used_friction(fit.of_manoeuvre(k + 1)) for k, run in enumerate(runs))
    friction = _value(fit, FRICTION)
    if used > _REACHED * friction:
        return "", "", used
    reason = (
        f"no wheel came near it: at most {used:.2f} of a load was used along the runway; the "
        f"curve of the side force leads to {friction:.2f}"
    )
    return FRICTION, reason, used


def _input_errors(
    records: Sequence,
    database: xr.DataTree | None,
    errors: Mapping[str, float],
    winds: Sequence[tuple[float, float]],
) -> dict[str, Unknown]:
    """Return the errors of the inputs as unknowns with a-priori standard errors.

    The wind of a record is in addition to `winds`.  Its standard error is that of the
    reconstruction.
    """
    unknowns = {name: Unknown(0.0, errors[name]) for name in ERRORS if errors[name] > 0.0}
    if database is None or errors["wind"] == 0.0:
        return unknowns
    for k, (record, wind) in enumerate(zip(records, winds), 1):
        for name, included in zip(("wind_n", "wind_e"), wind):
            stderr = min(_wind_error(record, name), errors["wind"])
            unknowns[f"{name}@{k}"] = Unknown(-included, stderr)
    return unknowns


def _wind_error(record, name: str) -> float:
    biases = getattr(record, "biases", None)
    if biases is None or name not in biases["parameter"].values:
        return WIND_ERROR
    return max(float(biases["stderr"].sel(parameter=name)), 1e-3)


def _unresponsive(
    runs: Sequence[GroundRun], unknown: Mapping[str, Unknown], known: Mapping[str, float]
) -> dict[str, str]:
    """Return constants that change the outputs by less than their scatter, with the reason."""
    names = list(unknown)
    for run in runs:
        run.names = tuple(names)
        run.fixed = {key: value for key, value in known.items() if key not in unknown}
    values = np.array([unknown[name].start for name in names], float)
    sizes = np.empty(len(names))
    for k, name in enumerate(names):
        sizes[k] = max(abs(values[k]), _SIZES.get(name.rpartition(".")[2], 0.0), 1e-3)
    residuals = np.concatenate([run.measured - run.predict(values) for run in runs])
    scatter = np.nanmean(residuals**2, axis=0)
    # Fisher information of each constant alone, from all outputs and samples.
    information = np.zeros(len(names))
    for run in runs:
        slopes = run.slopes(values, 1e-3 * sizes, central=True)
        S = np.where(np.isfinite(run.measured)[:, :, None], slopes, 0.0)
        information += (S**2 / scatter[None, :, None]).sum(axis=(0, 1))
    weak = information * sizes**2 < T_NEEDED**2
    reason = "nothing that was measured responds to it"
    return {name: reason for name, is_weak in zip(names, weak) if is_weak}


def _weakest(fit: OutputError, unknown: Mapping[str, Unknown]) -> tuple[str, str]:
    """Return the least determined constant and the reason; empty if all are determined."""
    smallest, weakest, reason = T_NEEDED, "", ""
    e = fit.estimates.sel(parameter=list(unknown))
    columns = (e[key].values for key in ("parameter", "estimate", "stderr", "active"))
    for name, value, stderr, active in zip(*columns):
        # A negative value of a constant that cannot be negative is the least determined.
        signed = value if name.rpartition(".")[2] in _NOT_NEGATIVE else abs(value)
        t = 0.0 if active else signed / stderr
        if t < smallest:
            smallest, weakest = t, str(name)
            reason = (
                f"{value:.3g} +- {stderr:.2g}, {T_NEEDED:g} standard errors from zero are needed"
            )
            if active:
                reason = f"at its bound {value:g}"
    return weakest, reason
