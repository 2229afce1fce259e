"""Check cases that any simulator can fly: initial condition, inputs and expected outputs over time,
with tolerances, as CSV.

The aircraft is trimmed at conditions of the validation flights, then each control makes a doublet.
Inputs are stated as they act (surface positions, thrust of every engine), so that nothing has to be
trimmed; the first row of the outputs is the initial condition.
"""

from __future__ import annotations

import contextlib
import io
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
from flightmech.support.atomic_write import write_text
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
_MODES = {
    "mode.engine": 2.0,
    "mode.trim": 0.0,
    "mode.earth": 1.0,
    "mode.controls": 0.0,
}  # thrust given, no trim, WGS-84, surfaces given
DURATION, RATE, SIZE = 12.0, 50.0, np.radians(2.0)
TRIMMED = 1e-3  # [m s-2, rad s-2] acceleration that a trim may leave
_STEP = 0.01  # [s]
_MARGIN, _LEAST = (
    10.0,
    1e-4,
)  # tolerance: that many times the effect of half the step, or that part of the excursion,
_FLOOR = {
    "rad": 1e-6,
    "rad s-1": 1e-6,
    "m s-1": 1e-4,
    "m": 1e-3,
    "m s-2": 1e-4,
    "Pa": 1e-2,
    "1": 1e-6,
}  # or this: what no instrument resolves
_PLACE = 1e-9  # [rad] of latitude and longitude, 6 mm


def conditions_of(results: Sequence[PomResult], most: int = 4) -> dict[str, dict[str, float]]:
    """Return the conditions of validation flights in the air, one for each setting of flaps and
    gear, by the name of the case.

    Parameters
    ----------
    results : sequence of PomResult
    most : int
        Settings that are taken.
    """
    found: dict[tuple[float, float], tuple[str, dict[str, float]]] = {}
    for result in results:
        have = dict(result.conditions)
        if result.case.drive.trim is not True or not {"V", "h", "mass"} <= have.keys():
            continue
        setting = (round(have.get("delta_f", 0.0), 1), round(have.get("gear", 0.0)))
        found.setdefault(setting, (result.case.name, have))
    return dict(list(found.values())[:most])


def write_flown_checks(
    db: xr.DataTree, aircraft: Aircraft, conditions: Mapping[str, Mapping[str, float]], folder: Path
) -> list[Path]:
    """Fly and write the check cases of a model: a doublet of each control at each condition, as
    ``CASE_CONTROL.csv``.

    A condition at which the model cannot be trimmed is left out.

    Returns
    -------
    list of Path
        The files.
    """
    sim = flightmech.compile(aircraft, db)
    files = []
    for name, at in conditions.items():
        for control in CONTROLS:
            case = _flown(sim, at, control)
            if case is None:
                break
            file = folder / f"{name}_{control}.csv"
            title = f"{aircraft.name}: doublet of {control} at the condition of {name}"
            inertia = {key: float(getattr(aircraft, key)) for key in _INERTIA}
            _write(
                file,
                title,
                case,
                sim,
                {
                    **{key: float(at.get(key, _DEFAULT.get(key, 0.0))) for key in (*_MASS, *_AIR)},
                    **inertia,
                },
            )
            files.append(file)
    return files


def _flown(sim: Any, at: Mapping[str, float], control: str) -> xr.Dataset | None:
    """Return inputs and outputs of a doublet from a trimmed flight, or nothing where there is no
    trim.
    """
    time = np.round(np.arange(0.0, DURATION + 0.5 / RATE, 1.0 / RATE), 9)
    given = {name: at.get(name, _DEFAULT.get(name, 0.0)) for name in (*_MASS, *_AIR)}
    parameters = (
        {f"init.{name}": at[name] for name in ("V", "h", "psi", "lat") if name in at}
        | _stated(given)
        | _MODES
    )
    pulse = SIZE * np.interp(
        time, [0.0, 1.0, 1.1, 2.0, 2.2, 3.1, 3.2], [0.0, 0.0, -1.0, -1.0, 1.0, 1.0, 0.0]
    )
    inputs = xr.Dataset(
        {control: ("time", pulse), **{name: at.get(name, 0.0) for name in HELD}}, {"time": time}
    )
    try:
        found = flightmech.simulate(
            sim, inputs, {**parameters, "mode.trim": 1.0}, hold="zero", step=_STEP
        )
    except SimulationError:
        return None
    left = max(
        abs(float(found[f"trim.{name}"][0]))
        for name in ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
    )
    if not left < TRIMMED or found.attrs.get("out_of_range"):
        return None
    acting = {
        name: float(found[f"applied.{name}"][0])
        + (pulse if name == control else np.zeros_like(time))
        for name in CONTROLS
    }
    acting |= {name: np.full_like(time, at.get(name, 0.0)) for name in HELD}
    acting |= {
        f"engine{i}.thrust_drive": np.full_like(time, found[f"engine{i}.thrust"][0])
        for i in _engines(sim)
    }
    return xr.Dataset(
        {
            name: ("time", values)
            for name, values in (acting | {one: found[one].values for one in OUTPUTS}).items()
        },
        {"time": time},
    )


def _engines(sim: Any) -> list[int]:
    return [i for i in range(1, 9) if f"engine{i}.thrust_drive" in sim.inputs]


def _stated(facts: Mapping[str, float]) -> dict[str, float]:
    return {
        f"{'mass' if name in _MASS else 'env'}.{name}": float(value)
        for name, value in facts.items()
    }


def _job(case: xr.Dataset, facts: Mapping[str, float]) -> tuple[xr.Dataset, dict[str, float]]:
    """Return inputs and parameters with which a case is flown again, from what stands in its file."""
    inputs = case[[str(name) for name in case.data_vars if name not in OUTPUTS]]
    start = {f"init.{name}": float(case[name][0]) for name in _INITIAL}
    return inputs, start | _stated({name: facts[name] for name in (*_MASS, *_AIR)}) | _MODES


def _write(file: Path, title: str, case: xr.Dataset, sim: Any, facts: Mapping[str, float]) -> None:
    inputs, parameters = _job(case, facts)
    fine = flightmech.simulate(
        sim, inputs, {**parameters, "mode.step": 0.5 * _STEP}, hold="zero", outputs=OUTPUTS
    )
    tolerance = {}
    for name in OUTPUTS:
        values = case[name].values
        effect, excursion = (
            np.abs(fine[name].values - values).max(),
            np.abs(values - values[0]).max(),
        )
        tolerance[name] = max(
            _MARGIN * effect,
            _LEAST * excursion,
            _PLACE if name in ("lat", "lon") else _FLOOR[lookup(name).units],
        )
    head: dict[str, str | float] = {
        "case": title,
        **facts,
        "axes": "body x forward, y right, z down; c.g. from the moment reference point; Earth "
        "WGS-84, rotating; no wind",
        "start": "the first row of the outputs; nothing is trimmed",
        "inputs": " ".join(str(name) for name in inputs.data_vars)
        + ", each held from its row to the next",
        "tolerance": " ".join(f"{name}={value:.3g}" for name, value in tolerance.items()),
        "tolerance_rule": f"{_MARGIN:g} times the effect of half the step of {_STEP:g} s, "
        f"{_LEAST:g} of the excursion, or what no "
        "instrument resolves, the greatest",
    }
    names = [str(name) for name in case.data_vars]
    header = ["time [s]", *(f"{name} [{_units(name)}]" for name in names)]
    rows = [
        [repr(value) for value in row]
        for row in np.column_stack(
            [case["time"].values, *(case[name].values for name in names)]
        ).tolist()
    ]
    write_text(file, written_csv(FORMAT, head, header, rows))


def _units(name: str) -> str:
    return "N" if name.endswith("thrust_drive") else lookup(name).units


def compare_outputs(
    case: xr.Dataset, found: Mapping[str, np.ndarray], tolerance: Mapping[str, float]
) -> tuple[float, str]:
    """Return the largest difference over its tolerance, and the output where it is; infinite for an
    output that is not there.
    """
    ratios = {
        name: float(np.abs(np.asarray(found[name]) - case[name].values).max() / limit)
        if name in found
        else np.inf
        for name, limit in tolerance.items()
    }
    worst = max(ratios, key=lambda name: ratios[name] if np.isfinite(ratios[name]) else np.inf)
    return ratios[worst], worst


def fly_by_kernel(sim: Any, case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the outputs of a check case flown by the kernel, from what stands in its file."""
    inputs, parameters = _job(case, facts)
    found = flightmech.simulate(sim, inputs, parameters, hold="zero", step=_STEP, outputs=OUTPUTS)
    return {name: found[name].values for name in OUTPUTS}


def fly_by_fmu(fmu: Path, case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the outputs of a check case flown by an FMU through FMPy, an importer that knows
    nothing of this package.
    """
    import fmpy

    inputs, parameters = _job(case, facts)
    time = case["time"].values
    signals = np.zeros(
        time.size, [("time", float), *((str(name), float) for name in inputs.data_vars)]
    )
    signals["time"] = time
    for name, item in inputs.data_vars.items():
        signals[str(name)] = item.values
    with contextlib.redirect_stdout(io.StringIO()):  # a warning for every input that is not given
        found = fmpy.simulate_fmu(
            str(fmu),
            stop_time=float(time[-1]),
            output_interval=1.0 / RATE,
            start_values=parameters,
            input=signals,
            output=list(OUTPUTS),
        )
    return {name: np.asarray(found[name], float) for name in OUTPUTS}


def read_flown_check(path: str | Path) -> tuple[xr.Dataset, dict[str, float], dict[str, float]]:
    """Return a check case: inputs and outputs (time,), facts (mass, c.g., air), and tolerances by
    output. [SI]

    Raises
    ------
    ParseError
        Not such a file.
    SchemaError
        Columns, facts or cells that cannot be read.
    """
    path = Path(path)
    table, problems = read_csv(path)
    if table.title != FORMAT:
        raise ParseError(str(path), 1, repr(table.title), f"'# {FORMAT}'")
    columns = {name: column_numbers(table, name, problems) for name in table.columns}
    missing = [name for name in ("time", *OUTPUTS, *CONTROLS) if name not in columns]
    problems += [f"no column {name}" for name in missing]
    absent = [name for name in (*_MASS, *_AIR, "tolerance") if name not in table.facts]
    problems += [f"no fact {name!r}" for name in absent]
    if problems:
        raise SchemaError(str(path), problems)
    time = columns.pop("time")
    tolerance = {
        name: float(value)
        for name, _, value in (
            part.partition("=") for part in str(table.facts["tolerance"]).split()
        )
    }
    facts = {name: float(table.facts[name]) for name in (*_MASS, *_AIR)}
    return (
        xr.Dataset({name: ("time", values) for name, values in columns.items()}, {"time": time}),
        facts,
        tolerance,
    )
