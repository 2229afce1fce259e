"""The trim of a model at the start of a replay: what it found, what it left, and what limits it.

A trim bias is the price of starting in the flight condition: the model flies with its controls that
far from the recorded ones.  It is never hidden and never taken off the compared traces.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from flightmech.units import DEGREE, POUND_FORCE, from_si
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.cases.resolve import BIASES, LIMIT_UNITS, REMAINDERS
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import FmuModel, fly_job
from pom.judging.signals import trace_of
from pom.result import PomResult
from pom.tolerances.bands import ALLOWED, RowRemark

STATE = (
    *(
        "V",
        "V_cas",
        "alpha",
        "beta",
        "gamma",
        "phi",
        "theta",
        "psi",
        "p",
        "q",
        "r",
        "h",
        "delta_e",
        "delta_a",
        "delta_r",
    ),
    *("column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal"),
)
CONTROLS = STATE[12:]
COCKPIT = (*STATE[15:], "trim.F_column", "trim.F_wheel", "trim.F_pedal")
FOUND = tuple(f"trim.{name}" for name in BIASES)
LEFT = tuple(f"trim.{name}" for name in REMAINDERS)
OBSERVED = (*STATE, *(f"applied.{name}" for name in CONTROLS), *FOUND, *LEFT, "out_of_range")
"""Outputs of a model that the trim table and its remarks are made of."""

DEFAULT_LIMITS = {
    **dict.fromkeys(
        ("delta_e", "delta_a", "delta_r"), 1.0 * DEGREE
    ),  # longitudinal trim, 2.c.5 of Table A2A: elevator 1 deg
    **dict.fromkeys(
        ("F_column", "F_pedal"), 5.0 * POUND_FORCE
    ),  # static force checks, 2.a.1.a and 2.a.3.a of Table A2A
    "throttle": 0.05,  # of the travel: 2.c.5 allows 5 % of net thrust
    # our number: an acceleration that goes on changes the speed by 1 m/s in 20 s, an attitude by
    # 1.5 deg in 5 s
    **dict.fromkeys(("u_dot", "v_dot", "w_dot"), 0.05),
    **dict.fromkeys(("p_dot", "q_dot", "r_dot"), 2.0e-3),
}
"""Size of a bias or of an acceleration left beyond which a run is remarked. [SI]"""
# of the largest thrust of an engine in the window; 2.c.5 of Table A2A has 5 % of the largest in
# service
THRUST_SHARE = 0.05
_THRUST = re.compile(r"^engine\d+\.thrust$")
SHOWN_UNITS = {"N": "lbf", "rad": "deg", "rad s-2": "deg/s2", "m s-2": "m/s2"}


class TrimLimit(NamedTuple):
    """Limit of a trim quantity.

    ``size`` is that of the case file where it has one (``demanded``: a run beyond it is invalid),
    else the default; ``usual`` the default, infinite where there is none: beyond it a pass is one
    with limits exceeded, unless ``allowed``, the rationale of the case file for ``trim.<name>``,
    states why. [SI]
    """

    size: float
    demanded: bool
    usual: float
    allowed: str = ""


def trim_limits(case: PomCase, flight: Mapping[str, np.ndarray]) -> dict[str, TrimLimit]:
    """Return the limits of the trim of a case by quantity (``delta_e``, ``thrust``, ``u_dot`` ...).

    Parameters
    ----------
    flight : mapping of str to array (time,)
        Recorded channels; the thrust is limited by a share of its largest value.
    """
    usual = dict(DEFAULT_LIMITS)
    largest = [
        float(np.fmax.reduce(np.abs(flight[name]))) for name in flight if _THRUST.match(name)
    ]
    if largest:
        usual["thrust"] = THRUST_SHARE * max(largest)
    if case.drive.trim == "ground":  # a roll is not steady, and the surfaces stay as recorded
        usual = {name: size for name, size in usual.items() if name in ("w_dot", "p_dot", "q_dot")}
    allowed = {
        name: case.rationale.get(f"trim.{name}", "") for name in (*usual, *case.drive.limits)
    }
    found = {name: TrimLimit(size, False, size, allowed[name]) for name, size in usual.items()}
    own = {
        name: TrimLimit(size, True, usual.get(name, np.inf), allowed[name])
        for name, size in case.drive.limits.items()
    }
    return found | own


def result_trim_limits(result: PomResult) -> dict[str, TrimLimit]:
    """Return the limits that the trim of a result was held against."""
    names = [name for name in map(str, result.signals.data_vars) if _THRUST.match(name)]
    return trim_limits(
        result.case, {name: trace_of(result.signals, "flight", name) for name in names}
    )


def beyond_limits(
    limits: Mapping[str, TrimLimit], outputs: Mapping[str, np.ndarray], demanded: bool
) -> tuple[RowRemark, ...]:
    """Return a remark for every trim quantity of a model beyond its limit; none for a model that
    does not report it.

    Parameters
    ----------
    limits : mapping of str to TrimLimit
    outputs : mapping of str to array (time,)
    demanded : bool
        Compare with the limits that the case file demands; else with the usual ones.

    Returns
    -------
    tuple of RowRemark
        Of kind ``trim``, or ``trim_allowed`` where the case file states why a bias beyond the usual
        limit is allowed.
    """
    found = []
    for name, limit in limits.items():
        value = float(outputs[f"trim.{name}"][0]) if f"trim.{name}" in outputs else 0.0
        size = (limit.size if limit.demanded else np.inf) if demanded else limit.usual
        if (
            math.isfinite(size) and not abs(value) <= size
        ):  # a value that is not a number is not within it
            unit = SHOWN_UNITS.get(LIMIT_UNITS[name], LIMIT_UNITS[name])
            shown = "" if unit == "1" else f" {unit}"
            values = {"found": float(from_si(value, unit)), "limit": float(from_si(size, unit))}
            text = (
                f"trim.{name} {values['found']:+.3g}{shown} is beyond {values['limit']:.3g}{shown}"
            )
            if limit.allowed and not demanded:
                found.append(
                    RowRemark("trim_allowed", f"{text}{ALLOWED}{limit.allowed}", name, values, unit)
                )
            else:
                found.append(RowRemark("trim", text, name, values, unit))
    return tuple(found)


def trim_table(
    flight: Mapping[str, np.ndarray], found: Mapping[str, Mapping[str, np.ndarray]]
) -> pd.DataFrame:
    """Return the first sample of flight and models, index ``quantity``; controls of a model are
    what it applied, bias included.

    Parameters
    ----------
    flight : mapping of str to array (time,)
    found : mapping of model to mapping of output to array (time,)
    """
    columns = {"flight": {name: float(flight[name][0]) for name in STATE if name in flight}}
    shown = [
        name
        for name in (*STATE, *FOUND, *LEFT)
        if name not in COCKPIT or _in_use(name, flight, found)
    ]
    for run, outputs in found.items():
        values = {}
        for name in shown:
            source = f"applied.{name}" if name in CONTROLS else name
            if source in outputs:
                values[name] = float(outputs[source][0])
        columns[run] = values
    table = np.array(
        [[values.get(name, np.nan) for values in columns.values()] for name in shown], float
    ).reshape(-1, len(columns))
    known = ~np.isnan(table).all(axis=1)
    index = pd.Index(
        [name for name, there in zip(shown, known, strict=True) if there], name="quantity"
    )
    return pd.DataFrame(table[known], index, list(columns), dtype=float)


def _in_use(
    name: str, flight: Mapping[str, np.ndarray], found: Mapping[str, Mapping[str, np.ndarray]]
) -> bool:
    """Whether a quantity of the cockpit belongs to the flight or to the trim; a model driven by its
    surfaces reports zero for it.
    """
    return name in flight or any(
        name in outputs and float(outputs[name][0]) != 0.0
        for outputs in found.values()
        if name in FOUND
    )


FORCE_OF = {"delta_t": "trim.F_column", "delta_ta": "trim.F_wheel", "delta_tr": "trim.F_pedal"}
"""By trim surface: the force that the trim of a model adds to the recorded one to hold the controls."""
SAMPLES = 3  # of the record that a start flies
PROBE = 0.5 * DEGREE
WIDEST = 20.0 * DEGREE  # of a bias: beyond it no trim surface goes
LEAST = (
    1.0 * POUND_FORCE / (10.0 * DEGREE)
)  # [N rad-1] a surface with less effect than this trims nothing
SURFACES_LEFT = 0.01 * POUND_FORCE
ITERATIONS = 6


def solve_trim_surfaces(
    job: ReplayJob,
    names: Sequence[str],
    model: FmuModel,
    timeout: float,
    store: KeptFlights | None = None,
) -> tuple[ReplayJob, tuple[RowRemark, ...], str]:
    """Return a job whose trim surfaces hold the recorded forces, for one model.

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
        Of kind ``trim_surface``: what was found, and what of the force is left.
    failure : str
        Why the model cannot be trimmed so; empty when it can.
    """
    if not names:
        return job, (), ""
    forces = [FORCE_OF[name] for name in names]
    lacking = [f"input {name}" for name in names if name not in model.links.inputs]
    lacking += [f"output {name}" for name in forces if name not in model.links.outputs]
    if lacking:
        return (
            job,
            (),
            f"drive.trim_surfaces: the model has no {', '.join(lacking)}; leave the surface "
            f"out, or give a model that has them",
        )
    failure = ""

    def forces_left(bias: np.ndarray) -> np.ndarray:
        nonlocal failure
        outputs, text = fly_job(model, _start(with_bias(job, names, bias)), forces, timeout, store)
        failure = failure or text
        return np.array([outputs[name][0] for name in forces])

    bias = np.zeros(len(names))
    left = forces_left(bias)
    slope = np.column_stack(
        [(forces_left(bias + step) - left) / PROBE for step in PROBE * np.eye(len(names))]
    )
    works = np.abs(np.diag(slope)) > LEAST
    for _ in range(ITERATIONS if works.any() else 0):
        if failure or np.abs(left[works]).max() < SURFACES_LEFT:
            break
        bias[works] = np.clip(
            bias[works] - np.linalg.solve(slope[np.ix_(works, works)], left[works]), -WIDEST, WIDEST
        )
        left = forces_left(bias)
    remarks = tuple(_remark(*item) for item in zip(names, forces, bias, left, works, strict=True))
    return with_bias(job, names, bias), remarks, failure


def with_bias(job: ReplayJob, names: Sequence[str], bias: np.ndarray) -> ReplayJob:
    """Return a job with a constant added to some inputs. [SI]"""
    return replace(
        job,
        inputs={
            **job.inputs,
            **{name: job.inputs[name] + size for name, size in zip(names, bias, strict=True)},
        },
    )


def _start(job: ReplayJob) -> ReplayJob:
    """Return the first samples of a job, without the math pilot."""
    inputs = {name: values[:SAMPLES] for name, values in job.inputs.items()}
    return replace(job, time=job.time[:SAMPLES], inputs=inputs, pilot=(), targets={})


def _remark(name: str, force: str, bias: float, left: float, works: bool) -> RowRemark:
    if not works:
        return RowRemark(
            "trim_surface",
            f"{name} has no effect on {force} of this model; it stays as recorded",
            name,
        )
    unit = "N m" if "wheel" in force else "N"
    shown = (
        f"{name} solved for: {from_si(bias, 'deg'):+.3g} deg from the recorded deflection; "
        f"{force} {left:+.2g} {unit} left"
    )
    return RowRemark("trim_surface", shown, name, {"bias": float(from_si(bias, "deg"))}, "deg")
