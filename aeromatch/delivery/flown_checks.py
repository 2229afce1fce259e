"""Check cases for any simulator: initial condition, inputs and expected outputs over time, with
tolerances, as CSV.

The aircraft is trimmed at conditions of the validation flights, then each control makes a doublet.
Inputs are surface positions and the thrust of every engine, so that a simulator needs no trim. The
first row of the outputs is the initial condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flightmech
from aerodb.exchange.tables.csv_text import column_numbers, read_csv, written_csv
from flightmech.air import P_SEA
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import ParseError, SchemaError, SimulationError
from flightmech.names import lookup
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.support.atomic_write import write_text
from flightmech.units import from_si
from pom.result import PomResult

FORMAT = "aeromatch flown check case, format 1"
OUTPUTS = (
    "u",
    "v",
    "w",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "h",
    "lat",
    "lon",
    "V",
    "alpha",
    "beta",
    "mach",
    "qbar",
    "ax",
    "ay",
    "az",
    "nz",
)
CONTROLS = ("delta_e", "delta_a", "delta_r")
HELD = ("delta_f", "gear", "speedbrake")
_INITIAL = ("V", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "h", "lat", "lon")
_MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b")
_AIR = ("delta_T", "qnh")
_DEFAULT = {"qnh": P_SEA}
_INERTIA = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
# Thrust as an input, no trim, WGS-84, surface positions as inputs.
_MODES = {
    "mode.engine": 2.0,
    "mode.trim": 0.0,
    "mode.earth": 1.0,
    "mode.controls": 0.0,
}
# Duration [s], samples per second, and deflection of the doublet [rad].
DURATION, RATE, SIZE = 12.0, 50.0, np.radians(2.0)
# Greatest residual acceleration of a trim. [m s-2, rad s-2]
TRIMMED = 1e-3
# Step of the integration. [s]
_STEP = 0.01
# The tolerance of an output is the greatest of three: this multiple of the effect of half the step,
# this fraction of the excursion, and a floor that no instrument resolves, by SI unit.
_MARGIN, _LEAST = 10.0, 1e-4
_FLOOR = {
    "rad": 1e-6,
    "rad s-1": 1e-6,
    "m s-1": 1e-4,
    "m": 1e-3,
    "m s-2": 1e-4,
    "Pa": 1e-2,
    "1": 1e-6,
}
# The same for latitude and longitude, 6 mm. [rad]
_POSITION_FLOOR = 1e-9
# A file states its tolerances with three digits; another processor computes the last ones anew.
_ROUNDED = 1.02
_LARGEST_ENGINE = 8


def flight_conditions_of(
    results: Sequence[PomResult], most: int = 4
) -> dict[str, dict[str, float]]:
    """Return conditions of validation flights in the air, by the name of the case.

    There is one condition for each setting of flaps and gear.

    Parameters
    ----------
    results : sequence of PomResult
    most : int
        Greatest number of settings.
    """
    by_setting: dict[tuple[float, float], tuple[str, dict[str, float]]] = {}
    for result in results:
        condition = dict(result.conditions)
        if result.case.drive.trim is not True or not {"V", "h", "mass"} <= condition.keys():
            continue
        setting = (round(condition.get("delta_f", 0.0), 1), round(condition.get("gear", 0.0)))
        by_setting.setdefault(setting, (result.case.name, condition))
    return dict(list(by_setting.values())[:most])


def configuration_text(condition: Mapping[str, float]) -> str:
    """Return flaps and gear of a condition in words; a gear that is fixed is not stated.

    Examples
    --------
    >>> configuration_text({"delta_f": 0.0})
    'flaps 0.0 deg; gear not stated'
    """
    flaps, gear = "flaps not stated", "gear not stated"
    if "delta_f" in condition:
        flaps = f"flaps {from_si(condition['delta_f'], 'deg'):.1f} deg"
    if "gear" in condition:
        gear = f"gear {'down' if condition['gear'] > 0.5 else 'up'}"
    return f"{flaps}; {gear}"


def write_flown_checks(
    db: xr.DataTree, aircraft: Aircraft, conditions: Mapping[str, Mapping[str, float]], folder: Path
) -> list[Path]:
    """Simulate and write the check cases of a model, as ``CASE_CONTROL.csv``.

    There is a doublet of each control at each condition. A condition without a trim is left out.

    Parameters
    ----------
    db : DataTree
    aircraft : Aircraft
    conditions : mapping of str to mapping
        From `flight_conditions_of`.
    folder : Path

    Returns
    -------
    list of Path
        The files.
    """
    sim = compile_with_envelope(aircraft, db)
    inertia = {key: float(getattr(aircraft, key)) for key in _INERTIA}
    files = []
    for name, condition in conditions.items():
        facts = _facts_of(condition) | inertia
        for control in CONTROLS:
            case = _simulate_doublet(sim, condition, control)
            if case is None:
                break
            file = folder / f"{name}_{control}.csv"
            title = f"{aircraft.name}: doublet of {control} at the condition of {name}"
            _write_case(file, title, case=case, sim=sim, facts=facts)
            files.append(file)
    return files


def _facts_of(condition: Mapping[str, float]) -> dict[str, float]:
    """Return mass, centre of gravity and air of a condition, with defaults."""
    facts = {}
    for name in (*_MASS, *_AIR):
        facts[name] = float(condition.get(name, _DEFAULT.get(name, 0.0)))
    return facts


def _simulate_doublet(sim: Any, condition: Mapping[str, float], control: str) -> xr.Dataset | None:
    """Return inputs and outputs of a doublet from a trimmed flight, or None without a trim."""
    time = np.round(np.arange(0.0, DURATION + 0.5 / RATE, 1.0 / RATE), 9)
    start = ("V", "h", "psi", "lat")
    parameters = {f"init.{name}": condition[name] for name in start if name in condition}
    parameters |= _to_parameters(_facts_of(condition)) | _MODES
    # One second of rest, then about one second to each side, with ramps of 0.1 and 0.2 s.
    pulse = SIZE * np.interp(
        time, [0.0, 1.0, 1.1, 2.0, 2.2, 3.1, 3.2], [0.0, 0.0, -1.0, -1.0, 1.0, 1.0, 0.0]
    )
    fixed = {name: condition.get(name, 0.0) for name in HELD}
    inputs = xr.Dataset({control: ("time", pulse), **fixed}, {"time": time})
    try:
        response = flightmech.simulate(
            sim, inputs, {**parameters, "mode.trim": 1.0}, hold="zero", step=_STEP
        )
    except SimulationError:
        return None
    accelerations = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
    residual = max(abs(float(response[f"trim.{name}"][0])) for name in accelerations)
    # `not <` is also true for NaN.
    if not residual < TRIMMED or response.attrs.get("out_of_range"):
        return None
    columns: dict[str, np.ndarray] = {}
    for name in CONTROLS:
        motion = pulse if name == control else np.zeros_like(time)
        columns[name] = float(response[f"applied.{name}"][0]) + motion
    for name, position in fixed.items():
        columns[name] = np.full_like(time, position)
    for i in _engine_numbers(sim):
        columns[f"engine{i}.thrust_drive"] = np.full_like(time, response[f"engine{i}.thrust"][0])
    for name in OUTPUTS:
        columns[name] = response[name].values
    return xr.Dataset({name: ("time", values) for name, values in columns.items()}, {"time": time})


def _engine_numbers(sim: Any) -> list[int]:
    """Return the numbers of the engines of a model, from 1."""
    numbers = range(1, _LARGEST_ENGINE + 1)
    return [i for i in numbers if f"engine{i}.thrust_drive" in sim.inputs]


def _to_parameters(facts: Mapping[str, float]) -> dict[str, float]:
    """Return mass, centre of gravity and air as parameters of a model."""
    parameters = {}
    for name, value in facts.items():
        group = "mass" if name in _MASS else "env"
        parameters[f"{group}.{name}"] = float(value)
    return parameters


def inputs_and_parameters(
    case: xr.Dataset, facts: Mapping[str, float]
) -> tuple[xr.Dataset, dict[str, float]]:
    """Return the inputs and parameters that repeat a case, from the content of its file."""
    inputs = case[[str(name) for name in case.data_vars if name not in OUTPUTS]]
    parameters = {f"init.{name}": float(case[name][0]) for name in _INITIAL}
    parameters |= _to_parameters({name: facts[name] for name in (*_MASS, *_AIR)})
    return inputs, parameters | _MODES


def compute_tolerances(
    outputs: Mapping[str, np.ndarray],
    sim: Any,
    inputs: xr.Dataset,
    parameters: Mapping[str, float],
) -> dict[str, float]:
    """Return the tolerance of each output of a flight from a repetition with half the step. [SI]"""
    fine = flightmech.simulate(
        sim, inputs, {**parameters, "mode.step": 0.5 * _STEP}, hold="zero", outputs=OUTPUTS
    )
    tolerances = {}
    for name in OUTPUTS:
        values = np.asarray(outputs[name])
        effect = np.abs(fine[name].values - values).max()
        excursion = np.abs(values - values[0]).max()
        floor = _FLOOR[lookup(name).units]
        if name in ("lat", "lon"):
            floor = _POSITION_FLOOR
        tolerances[name] = max(_MARGIN * effect, _LEAST * excursion, floor)
    return tolerances


def _write_case(
    file: Path, title: str, case: xr.Dataset, sim: Any, facts: Mapping[str, float]
) -> None:
    """Write a check case with the tolerances of its outputs, as CSV."""
    inputs, parameters = inputs_and_parameters(case, facts)
    outputs = {name: case[name].values for name in OUTPUTS}
    tolerances = compute_tolerances(outputs, sim, inputs, parameters)
    head: dict[str, str | float] = {
        "case": title,
        **facts,
        "axes": "body x forward, y right, z down; c.g. from the moment reference point; Earth "
        "WGS-84, rotating; no wind",
        "start": "the first row of the outputs; nothing is trimmed",
        "inputs": " ".join(str(name) for name in inputs.data_vars)
        + ", each held from its row to the next",
        "tolerance": " ".join(f"{name}={value:.3g}" for name, value in tolerances.items()),
        "tolerance_rule": f"{_MARGIN:g} times the effect of half the step of {_STEP:g} s, "
        f"{_LEAST:g} of the excursion, or what no "
        "instrument resolves, the greatest",
    }
    names = [str(name) for name in case.data_vars]
    header = ["time [s]", *(f"{name} [{_units(name)}]" for name in names)]
    columns = [case["time"].values, *(case[name].values for name in names)]
    rows = [list(map(repr, row)) for row in np.column_stack(columns).tolist()]
    write_text(file, written_csv(FORMAT, head, header, rows))


def _units(name: str) -> str:
    """Return the SI unit of a column."""
    # The thrust is an input of the check cases and not a canonical name.
    if name.endswith("thrust_drive"):
        return "N"
    return lookup(name).units


def compare_outputs(
    case: xr.Dataset, found: Mapping[str, np.ndarray], tolerance: Mapping[str, float]
) -> tuple[float, str]:
    """Return the largest ratio of a difference to its tolerance, and the output of this ratio.

    The ratio of an absent output is infinite.
    """
    ratios: dict[str, float] = {}
    # NaN counts as the largest ratio.
    ranks: dict[str, float] = {}
    for name, limit in tolerance.items():
        ratios[name] = np.inf
        if name in found:
            difference = np.abs(np.asarray(found[name]) - case[name].values).max()
            ratios[name] = float(difference / limit)
        ranks[name] = ratios[name] if np.isfinite(ratios[name]) else np.inf
    worst = max(ranks, key=lambda name: ranks[name])
    return ratios[worst], worst


def fly_by_kernel(sim: Any, case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the outputs of a check case, simulated by the kernel from the content of its file."""
    inputs, parameters = inputs_and_parameters(case, facts)
    response = flightmech.simulate(
        sim, inputs, parameters, hold="zero", step=_STEP, outputs=OUTPUTS
    )
    return {name: response[name].values for name in OUTPUTS}


def find_wide_tolerances(
    sim: Any, case: xr.Dataset, facts: Mapping[str, float], stated: Mapping[str, float]
) -> list[str]:
    """Return the outputs of a check case without a tolerance, or with one beyond its rule.

    The rule is evaluated with the flight of the kernel: with the numbers of the file, a wrong
    number would widen its own tolerance.
    """
    inputs, parameters = inputs_and_parameters(case, facts)
    computed = compute_tolerances(fly_by_kernel(sim, case, facts), sim, inputs, parameters)
    return [name for name in OUTPUTS if not stated.get(name, np.inf) <= _ROUNDED * computed[name]]


def read_flown_check(path: str | Path) -> tuple[xr.Dataset, dict[str, float], dict[str, float]]:
    """Read a check case: inputs and outputs (time,), facts (mass, c.g., air), and tolerances. [SI]

    Raises
    ------
    ParseError
        The file is not a check case.
    SchemaError
        With all columns, facts and cells that cannot be read.
    """
    path = Path(path)
    table, problems = read_csv(path)
    if table.title != FORMAT:
        raise ParseError(str(path), 1, repr(table.title), f"'# {FORMAT}'")
    columns = {name: column_numbers(table, name, problems) for name in table.columns}
    for name in ("time", *OUTPUTS, *CONTROLS):
        if name not in columns:
            problems.append(f"no column {name}")
    for name in (*_MASS, *_AIR, "tolerance"):
        if name not in table.facts:
            problems.append(f"no fact {name!r}")
    if problems:
        raise SchemaError(str(path), problems)
    time = columns.pop("time")
    # NAME=VALUE NAME=VALUE ...
    tolerances = {}
    for part in str(table.facts["tolerance"]).split():
        name, _, value = part.partition("=")
        tolerances[name] = float(value)
    facts = {name: float(table.facts[name]) for name in (*_MASS, *_AIR)}
    variables = {name: ("time", values) for name, values in columns.items()}
    return xr.Dataset(variables, {"time": time}), facts, tolerances
