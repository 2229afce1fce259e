"""Trim of a model at the start of a replay: its biases, its remainders, and their limits.

A trim bias is the price of a start in the flight condition: the controls of the model differ from
the recorded ones by the bias. It is always reported and never subtracted from the compared traces.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from typing import NamedTuple

import numpy as np
import pandas as pd

from flightmech.units import DEGREE, POUND_FORCE, from_si
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.cases.resolve import BIASES, LIMIT_UNITS, REMAINDERS
from pom.fmu.models import FmuModel
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import fly_job
from pom.judging.signals import trace_of
from pom.result import PomResult
from pom.tolerances.bands import ALLOWED, RowRemark
from pom.tolerances.channels import quantity_words

STATE = (
    *("V", "V_cas", "alpha", "beta", "gamma", "phi", "theta", "psi", "p", "q", "r", "h"),
    *("delta_e", "delta_a", "delta_r"),
    *("column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal"),
)
CONTROLS = STATE[12:]
COCKPIT = (*STATE[15:], "trim.F_column", "trim.F_wheel", "trim.F_pedal")
FOUND = tuple(f"trim.{name}" for name in BIASES)
LEFT = tuple(f"trim.{name}" for name in REMAINDERS)
OBSERVED = (*STATE, *(f"applied.{name}" for name in CONTROLS), *FOUND, *LEFT, "out_of_range")
"""Outputs of a model from which the trim table and its remarks are made."""

DEFAULT_LIMITS = {
    # longitudinal trim, 2.c.5 of Table A2A: elevator 1 deg
    **dict.fromkeys(("delta_e", "delta_a", "delta_r"), 1.0 * DEGREE),
    # static force checks, 2.a.1.a and 2.a.3.a of Table A2A
    **dict.fromkeys(("F_column", "F_pedal"), 5.0 * POUND_FORCE),
    # of the travel: 2.c.5 allows 5 % of net thrust
    "throttle": 0.05,
    # not from a rule: a constant acceleration of this size changes the speed by 1 m/s in 20 s,
    # and an attitude by 1.5 deg in 5 s
    **dict.fromkeys(("u_dot", "v_dot", "w_dot"), 0.05),
    **dict.fromkeys(("p_dot", "q_dot", "r_dot"), 2.0e-3),
}
"""Size of a bias or of a remaining acceleration beyond which a run gets a remark. [SI]"""
# of the largest thrust of an engine in the window; 2.c.5 of Table A2A has 5 % of the largest in
# service
THRUST_SHARE = 0.05
_THRUST = re.compile(r"^engine\d+\.thrust$")
MOST_LIFTED = 3.0  # times a limit; our number: a larger bias is an error of model or record
# name, date, reason
_SIGNED = re.compile(r"^\s*[^\W\d].*?,\s*(?P<date>\d{4}-\d{2}-\d{2})\s*,(?P<text>.*)$", re.DOTALL)
_WORD = re.compile(r"[^\W\d_]{2,}")
SHOWN_UNITS = {"N": "lbf", "rad": "deg", "rad s-2": "deg/s2", "m s-2": "m/s2"}
# Accelerations with a limit for a start on the wheels.
_LIMITED_ON_GROUND = ("w_dot", "p_dot", "q_dot")


class TrimLimit(NamedTuple):
    """Limit of a trim quantity. [SI]

    Attributes
    ----------
    size : float
        Limit of the case file, else the default.
    demanded : bool
        Whether the case file has the limit. A run beyond it is invalid.
    usual : float
        The default, infinite if there is none. A pass beyond it has exceeded limits.
    allowed : str
        Rationale of the case file for ``trim.<name>``, which allows a bias beyond `usual`.
    """

    size: float
    demanded: bool
    usual: float
    allowed: str = ""


def trim_limits(case: PomCase, flight: Mapping[str, np.ndarray]) -> dict[str, TrimLimit]:
    """Return the limits of the trim of a case by quantity (``delta_e``, ``thrust``, ``u_dot`` ...).

    Parameters
    ----------
    case : PomCase
    flight : mapping of str to array (time,)
        Recorded channels. The limit of the thrust is a share of its largest value.
    """
    usual = dict(DEFAULT_LIMITS)
    largest: list[float] = []
    for name in flight:
        if _THRUST.match(name):
            largest.append(float(np.fmax.reduce(np.abs(flight[name]))))
    if largest:
        usual["thrust"] = THRUST_SHARE * max(largest)
    # A roll on the wheels is not steady, and the surfaces stay as recorded.
    if case.drive.trim == "ground":
        usual = {name: size for name, size in usual.items() if name in _LIMITED_ON_GROUND}
    limits: dict[str, TrimLimit] = {}
    for name, size in usual.items():
        allowed = case.rationale.get(f"trim.{name}", "")
        limits[name] = TrimLimit(size, demanded=False, usual=size, allowed=allowed)
    # Limits of the case file replace the defaults.
    for name, size in case.drive.limits.items():
        allowed = case.rationale.get(f"trim.{name}", "")
        limits[name] = TrimLimit(
            size, demanded=True, usual=usual.get(name, np.inf), allowed=allowed
        )
    return limits


def result_trim_limits(result: PomResult) -> dict[str, TrimLimit]:
    """Return the limits with which the trim of a result was compared."""
    thrusts = {}
    for name in map(str, result.signals.data_vars):
        if _THRUST.match(name):
            thrusts[name] = trace_of(result.signals, "flight", name)
    return trim_limits(result.case, thrusts)


def beyond_limits(
    limits: Mapping[str, TrimLimit], outputs: Mapping[str, np.ndarray], demanded: bool
) -> tuple[RowRemark, ...]:
    """Return a remark for every trim quantity of a model beyond its limit.

    A quantity that the model does not report has no remark.

    Parameters
    ----------
    limits : mapping of str to TrimLimit
    outputs : mapping of str to array (time,)
    demanded : bool
        Compare with the limits that the case file demands; else with the usual ones.

    Returns
    -------
    tuple of RowRemark
        Of kind ``trim``, or ``trim_allowed`` if the case file states who allows it, when and why,
        and the bias is at most `MOST_LIFTED` times the usual limit is allowed.
    """
    remarks = []
    for name, limit in limits.items():
        value = 0.0
        if f"trim.{name}" in outputs:
            value = float(outputs[f"trim.{name}"][0])
        size = _compared_size(limit, demanded)
        # NaN is beyond every finite limit.
        if math.isfinite(size) and not abs(value) <= size:
            reason = "" if demanded else limit.allowed
            remarks.append(_limit_remark(name, value, size, reason=reason))
    return tuple(remarks)


def _compared_size(limit: TrimLimit, demanded: bool) -> float:
    """Return the demanded or the usual size of a limit; infinite if there is none."""
    if not demanded:
        return limit.usual
    if limit.demanded:
        return limit.size
    return np.inf


def _limit_remark(name: str, value: float, size: float, *, reason: str) -> RowRemark:
    """Return the remark on a trim quantity beyond a limit; `reason` is the rationale."""
    unit = SHOWN_UNITS.get(LIMIT_UNITS[name], LIMIT_UNITS[name])
    suffix = "" if unit == "1" else f" {unit}"
    values = {"found": float(from_si(value, unit)), "limit": float(from_si(size, unit))}
    # the quoted word is the key of a rationale
    text = (
        f"trim: {quantity_words(name)} {values['found']:+.3g}{suffix} is beyond "
        f"{values['limit']:.3g}{suffix} ('trim.{name}')"
    )
    if not reason:
        return RowRemark("trim", text, name, values=values, unit=unit)
    refusal = rationale_problem(reason)
    # NaN is beyond every limit
    if not abs(value) <= MOST_LIFTED * size:
        refusal = f"a rationale allows at most {MOST_LIFTED:g} times the limit"
    if refusal:
        text = f"{text}; not allowed by its rationale: {refusal}"
        return RowRemark("trim", text, name, values=values, unit=unit)
    return RowRemark("trim_allowed", f"{text}{ALLOWED}{reason}", name, values=values, unit=unit)


def rationale_problem(reason: str) -> str:
    """Return what a rationale lacks; empty if it has a name, a date and a reason.

    Examples
    --------
    >>> rationale_problem("J. Smith, 2024-05-17, calibrated to 1.5 deg only")
    ''
    >>> rationale_problem("ok")
    "write who allows it, when and why: 'J. Smith, 2024-05-17, calibrated to 1.5 deg only'"
    """
    match = _SIGNED.match(reason)
    if match and _is_date(match["date"]) and len(_WORD.findall(match["text"])) > 1:
        return ""
    example = "J. Smith, 2024-05-17, calibrated to 1.5 deg only"
    return f"write who allows it, when and why: {example!r}"


def _is_date(text: str) -> bool:
    try:
        date.fromisoformat(text)
    except ValueError:
        return False
    return True


def trim_table(
    flight: Mapping[str, np.ndarray], outputs_by_run: Mapping[str, Mapping[str, np.ndarray]]
) -> pd.DataFrame:
    """Return the first sample of flight and models, index ``quantity``.

    A control of a model has its applied position, which includes the bias.

    Parameters
    ----------
    flight : mapping of str to array (time,)
    outputs_by_run : mapping of model to mapping of output to array (time,)
    """
    rows: list[str] = []
    for name in (*STATE, *FOUND, *LEFT):
        if name not in COCKPIT or _is_used(name, flight, outputs_by_run):
            rows.append(name)
    columns: dict[str, dict[str, float]] = {"flight": {}}
    for name in STATE:
        if name in flight:
            columns["flight"][name] = float(flight[name][0])
    for run, outputs in outputs_by_run.items():
        columns[run] = {}
        for name in rows:
            source = f"applied.{name}" if name in CONTROLS else name
            if source in outputs:
                columns[run][name] = float(outputs[source][0])
    table = np.full((len(rows), len(columns)), np.nan)
    for k, column in enumerate(columns.values()):
        table[:, k] = [column.get(name, np.nan) for name in rows]
    # Quantities that neither the flight nor any model has are left out.
    is_present = ~np.isnan(table).all(axis=1)
    present = [name for name, has_value in zip(rows, is_present, strict=True) if has_value]
    index = pd.Index(present, name="quantity")
    return pd.DataFrame(table[is_present], index, list(columns), dtype=float)


def _is_used(
    name: str,
    flight: Mapping[str, np.ndarray],
    outputs_by_run: Mapping[str, Mapping[str, np.ndarray]],
) -> bool:
    """Return whether a quantity of the cockpit belongs to the flight or to the trim.

    A model that the surfaces drive reports zero for it.
    """
    if name in flight:
        return True
    if name not in FOUND:
        return False
    values = [outputs[name][0] for outputs in outputs_by_run.values() if name in outputs]
    return any(float(value) != 0.0 for value in values)


FORCE_OF = {"delta_t": "trim.F_column", "delta_ta": "trim.F_wheel", "delta_tr": "trim.F_pedal"}
"""By trim surface: the force that the trim of a model adds to the recorded one."""
SAMPLES = 3  # samples of the record in a run that only starts
PROBE = 0.5 * DEGREE
WIDEST = 20.0 * DEGREE  # largest bias of a trim surface
# [N rad-1] a surface with less effect trims nothing
LEAST = 1.0 * POUND_FORCE / (10.0 * DEGREE)
SURFACES_LEFT = 0.01 * POUND_FORCE
ITERATIONS = 6


def solve_trim_surfaces(
    job: ReplayJob,
    names: Sequence[str],
    model: FmuModel,
    timeout: float,
    store: KeptFlights | None = None,
) -> tuple[ReplayJob, tuple[RowRemark, ...], str]:
    """Return a job whose trim surfaces balance the recorded forces, for one model.

    Parameters
    ----------
    job : Job
    names : sequence of str
        Trim surfaces: ``delta_t``, ``delta_ta``, ``delta_tr``.
    model : Model
    timeout, store
        As `pom.fmu.simulate.fly_job`.

    Returns
    -------
    job : Job
        The recorded deflections plus a constant each.
    remarks : tuple of RowRemark
        Of kind ``trim_surface``: the solution, and the remaining force.
    failure : str
        Why the model cannot be trimmed in this way; empty if it can.
    """
    if not names:
        return job, (), ""
    forces = [FORCE_OF[name] for name in names]
    missing = [f"input {name}" for name in names if name not in model.links.inputs]
    missing += [f"output {name}" for name in forces if name not in model.links.outputs]
    if missing:
        text = (
            f"drive.trim_surfaces: the model has no {', '.join(missing)}; leave the surface "
            f"out, or give a model that has them"
        )
        return job, (), text
    starts = _SurfaceStarts(job, names, forces, model=model, timeout=timeout, store=store)
    bias, forces_left, has_effect = starts.solve()
    remarks = []
    for k, name in enumerate(names):
        remarks.append(
            _surface_remark(
                name,
                forces[k],
                bias=bias[k],
                force_left=forces_left[k],
                has_effect=has_effect[k],
            )
        )
    return with_bias(job, names, bias), tuple(remarks), starts.failure


class _SurfaceStarts:
    """Starts of a job with different trim surfaces.

    Attributes
    ----------
    failure : str
        Why the first failed run failed; empty without a failure.
    """

    def __init__(
        self,
        job: ReplayJob,
        names: Sequence[str],
        forces: Sequence[str],
        *,
        model: FmuModel,
        timeout: float,
        store: KeptFlights | None,
    ):
        self.job, self.names, self.forces = job, names, forces
        self.model, self.timeout, self.store = model, timeout, store
        self.failure = ""

    def fly(self, bias: np.ndarray) -> np.ndarray:
        """Return the forces that the trim of the model adds with these biases. [N or N m]"""
        start = _start_of_job(with_bias(self.job, self.names, bias))
        outputs, failure = fly_job(
            self.model, start, self.forces, timeout=self.timeout, store=self.store
        )
        self.failure = self.failure or failure
        return np.array([outputs[name][0] for name in self.forces])

    def solve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return biases, remaining forces and which surfaces have an effect, each (surface,)."""
        # Newton iteration; the slopes (force, surface) are differences at the recorded surfaces.
        bias = np.zeros(len(self.names))
        forces_left = self.fly(bias)
        columns = []
        for probe in PROBE * np.eye(len(self.names)):
            columns.append((self.fly(bias + probe) - forces_left) / PROBE)
        slope = np.column_stack(columns)
        has_effect = np.abs(np.diag(slope)) > LEAST
        if not has_effect.any():
            return bias, forces_left, has_effect
        active_slope = slope[np.ix_(has_effect, has_effect)]
        for _ in range(ITERATIONS):
            if self.failure or np.abs(forces_left[has_effect]).max() < SURFACES_LEFT:
                break
            step = np.linalg.solve(active_slope, forces_left[has_effect])
            bias[has_effect] = np.clip(bias[has_effect] - step, -WIDEST, WIDEST)
            forces_left = self.fly(bias)
        return bias, forces_left, has_effect


def with_bias(job: ReplayJob, names: Sequence[str], bias: np.ndarray) -> ReplayJob:
    """Return a job with a constant added to some inputs. [SI]"""
    inputs = dict(job.inputs)
    for name, size in zip(names, bias, strict=True):
        inputs[name] = job.inputs[name] + size
    return replace(job, inputs=inputs)


def _start_of_job(job: ReplayJob) -> ReplayJob:
    """Return the first samples of a job, without the math pilot."""
    inputs = {name: values[:SAMPLES] for name, values in job.inputs.items()}
    return replace(job, time=job.time[:SAMPLES], inputs=inputs, pilot=(), targets={})


def _surface_remark(
    name: str, force: str, *, bias: float, force_left: float, has_effect: bool
) -> RowRemark:
    """Return the remark on the solution of one trim surface."""
    if not has_effect:
        text = f"{name} has no effect on {force} of this model; it stays as recorded"
        return RowRemark("trim_surface", text, name)
    unit = "N m" if "wheel" in force else "N"
    text = (
        f"{name} solved for: {from_si(bias, 'deg'):+.3g} deg from the recorded deflection; "
        f"{force} {force_left:+.2g} {unit} left"
    )
    values = {"bias": float(from_si(bias, "deg"))}
    return RowRemark("trim_surface", text, name, values=values, unit="deg")
