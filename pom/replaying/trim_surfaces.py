"""Trim surfaces that the trim solves for: deflections at which the recorded pilot forces hold the flight at its start.

The trim of a model solves for the surfaces of the stick; what the recorded force lacks to hold them is reported as
``trim.F_column``.  A trim surface is to make that zero: Newton's method on short starts of the model, so that any FMU can be
asked that takes the trim surface as an input and reports the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flightmech.units import DEGREE, POUND_FORCE, from_si

from ..cases.job import Job
from ..fmu.run_cache import Store
from ..fmu.simulate import Model, fly
from ..tolerances.remarks import RowRemark

FORCE_OF = {"delta_t": "trim.F_column", "delta_ta": "trim.F_wheel", "delta_tr": "trim.F_pedal"}
"""By trim surface: the force that the trim of a model adds to the recorded one to hold the controls."""
SAMPLES = 3  # of the record that a start flies
PROBE = 0.5 * DEGREE
WIDEST = 20.0 * DEGREE  # of a bias: beyond it no trim surface goes
LEAST = 1.0 * POUND_FORCE / (10.0 * DEGREE)  # [N rad-1] a surface with less effect than this trims nothing
SURFACES_LEFT = 0.01 * POUND_FORCE
ITERATIONS = 6


def solved(
    job: Job, names: Sequence[str], model: Model, timeout: float, store: Store | None = None
) -> tuple[Job, tuple[RowRemark, ...], str]:
    """Return a job whose trim surfaces hold the recorded forces, for one model.

    Parameters
    ----------
    job : Job
    names : sequence of str
        Trim surfaces: ``delta_t``, ``delta_ta``, ``delta_tr``.
    model : Model
    timeout, store
        As `pom.fmu.simulate.fly`.

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
        return job, (), f"drive.trim_surfaces: the model has no {', '.join(lacking)}; leave the surface out, or give a model that has them"
    failure = ""

    def forces_left(bias: np.ndarray) -> np.ndarray:
        nonlocal failure
        outputs, text = fly(model, _start(moved(job, names, bias)), forces, timeout, store)
        failure = failure or text
        return np.array([outputs[name][0] for name in forces])

    bias = np.zeros(len(names))
    left = forces_left(bias)
    slope = np.column_stack([(forces_left(bias + step) - left) / PROBE for step in PROBE * np.eye(len(names))])
    works = np.abs(np.diag(slope)) > LEAST
    for _ in range(ITERATIONS if works.any() else 0):
        if failure or np.abs(left[works]).max() < SURFACES_LEFT:
            break
        bias[works] = np.clip(bias[works] - np.linalg.solve(slope[np.ix_(works, works)], left[works]), -WIDEST, WIDEST)
        left = forces_left(bias)
    remarks = tuple(_remark(*item) for item in zip(names, forces, bias, left, works, strict=True))
    return moved(job, names, bias), remarks, failure


def moved(job: Job, names: Sequence[str], bias: np.ndarray) -> Job:
    """Return a job with a constant added to some inputs. [SI]"""
    return replace(job, inputs={**job.inputs, **{name: job.inputs[name] + size for name, size in zip(names, bias, strict=True)}})


def _start(job: Job) -> Job:
    """Return the first samples of a job, without the math pilot."""
    inputs = {name: values[:SAMPLES] for name, values in job.inputs.items()}
    return replace(job, time=job.time[:SAMPLES], inputs=inputs, pilot=(), targets={})


def _remark(name: str, force: str, bias: float, left: float, works: bool) -> RowRemark:
    if not works:
        return RowRemark("trim_surface", f"{name} has no effect on {force} of this model; it stays as recorded", name)
    unit = "N m" if "wheel" in force else "N"
    shown = f"{name} solved for: {from_si(bias, 'deg'):+.3g} deg from the recorded deflection; {force} {left:+.2g} {unit} left"
    return RowRemark("trim_surface", shown, name, {"bias": float(from_si(bias, "deg"))}, "deg")
