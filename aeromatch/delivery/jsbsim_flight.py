"""Simulation of a flown check case by JSBSim, an independent program.

JSBSim has different equations of motion, Earth and atmosphere. Some differences from the kernel are
not faults of the model. JSBSim computes the damping from rates against the Earth and not against
inertial space (7e-5 rad/s). Inputs act one frame later, and load factor and lift are those of the
previous step. The tolerance is therefore a twentieth of the bands of 14 CFR Part 60, Table A2A. No
proof of match depends on a smaller difference.

JSBSim ends the whole process if it cannot read a file, and its files can write to any place, so it
runs in a child process (`aeromatch.delivery.foreign_flight`). Of the file of a package only the
elements are kept that our exporter writes.
"""

from __future__ import annotations

import contextlib
import importlib.util
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.properties import AXIS, PSF, thrust_property
from aerodb.exchange.jsbsim.written_elements import keep_written_elements
from aeromatch.delivery.foreign_flight import Case, Job, answer_jobs, demand_flight, fly_in_child
from flightmech.axes import matrix_from_euler
from flightmech.errors import SimulationError
from flightmech.units import DEGREE, FOOT, INCH, POUND, POUND_FORCE

KNOT = 1852.0 / 3600.0
BANDS = {
    "V": 3.0 * KNOT,
    "h": 100.0 * FOOT,
    "theta": 1.5 * DEGREE,
    "alpha": 1.5 * DEGREE,
    "phi": 2.0 * DEGREE,
    "psi": 2.0 * DEGREE,
    "beta": 1.0 * DEGREE,
    "p": 2.0 * DEGREE,
    "q": 2.0 * DEGREE,
    "r": 2.0 * DEGREE,
    "nz": 0.1,
}
"""Bands of Table A2A: tests 2.c.1 (V, h, theta), 2.c.10 (q, nz), 2.d.2 (p), 2.d.6 (r), 2.d.8 (phi,
beta); psi as phi, alpha as theta.
"""
PART = 0.05
"""Tolerance as a fraction of the bands."""
# Frames of JSBSim in an interval of the case.
_FRAMES = 40
# Rotation of the Earth, WGS-84. [rad/s]
_EARTH_RATE = 7.292115e-5
# Property of JSBSim of each output, and its unit in SI.
_OUTPUTS = {
    "V": ("velocities/vt-fps", FOOT),
    "h": ("position/geod-alt-ft", FOOT),
    "theta": ("attitude/theta-rad", 1.0),
    "alpha": ("aero/alpha-rad", 1.0),
    "phi": ("attitude/phi-rad", 1.0),
    "psi": ("attitude/psi-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "p": ("velocities/pi-rad_sec", 1.0),
    "q": ("velocities/qi-rad_sec", 1.0),
    "r": ("velocities/ri-rad_sec", 1.0),
    "nz": ("accelerations/Nz", 1.0),
}


def jsbsim_installed() -> bool:
    """Return whether the Python package of JSBSim is installed."""
    return importlib.util.find_spec("jsbsim") is not None


def fly_by_jsbsim(
    model: Path, case: xr.Dataset, facts: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return the outputs of `BANDS` of a check case, simulated by JSBSim. [SI]

    Parameters
    ----------
    model : Path
        File of `aerodb.exchange.export_jsbsim`.
    case, facts
        From `read_flown_check`.

    Raises
    ------
    SimulationError
        JSBSim does not load the file, or its run ends early; with its message.
    """
    (flight,) = fly_cases_by_jsbsim(model, [(case, facts)])
    return jsbsim_outputs(flight, case, model.name)


def foreign_elements(model: Path) -> list[str]:
    """Return the elements of a file that our exporter does not write, as ``parent/element``.

    Raises
    ------
    SimulationError
        The file is not XML.
    """
    return keep_written_elements(_read_model(model))


def _read_model(model: Path) -> ET.Element:
    try:
        return ET.parse(model).getroot()
    except (ET.ParseError, ValueError) as error:
        raise SimulationError(f"{model.name} is not XML: {error}") from None


def fly_cases_by_jsbsim(model: Path, cases: Sequence[Case]) -> list[np.ndarray | str]:
    """Return the outputs of check cases (time, output) in the units of JSBSim, or a failure.

    Raises
    ------
    SimulationError
        The file is not a model that aeromatch exported.
    """
    jobs, shapes = [], []
    for case, facts in cases:
        root = _read_model(model)
        keep_written_elements(root)
        _set_mass_and_thrust(root, facts)
        time = case["time"].values
        start = _initial_condition(case, facts)
        signals = dict(_commands(root, case))
        jobs.append(
            {
                "model": np.frombuffer(ET.tostring(root), np.uint8),
                "dt": np.array((time[1] - time[0]) / _FRAMES),
                "start_names": np.array([*start]),
                "start": np.array([*start.values()]),
                "names": np.array([*signals]),
                "signals": np.column_stack([*signals.values()]),
                "outputs": np.array([name for name, _ in _OUTPUTS.values()]),
            }
        )
        shapes.append((len(time), len(_OUTPUTS)))
    return fly_in_child(__name__, jobs, shapes, [])


def jsbsim_outputs(flight: np.ndarray | str, case: xr.Dataset, model: str) -> dict[str, np.ndarray]:
    """Return the outputs of a flight by name. [SI]

    Raises
    ------
    SimulationError
        The flight failed.
    """
    if isinstance(flight, str):
        flight = (
            f"no check case is simulated with {model}: {flight}. Export the model again, and check "
            f"it with JSBSim alone."
        )
    rows = demand_flight(flight, "JSBSim")
    outputs = {}
    for column, (name, (_, factor)) in enumerate(_OUTPUTS.items()):
        outputs[name] = rows[:, column] * factor
    # JSBSim has headings from 0 to 2 pi. The nearest angle to that of the case is compared.
    for angle in ("phi", "psi"):
        expected = case[angle].values
        outputs[angle] = expected + (outputs[angle] - expected + np.pi) % (2.0 * np.pi) - np.pi
    return outputs


def _set_mass_and_thrust(root: ET.Element, facts: Mapping[str, float]) -> None:
    """Set mass and centre of gravity of the case, and make the thrust of each engine an input."""
    balance = _only(root, "mass_balance")
    _only(balance, "emptywt").text = repr(facts["mass"] / POUND)
    # Structural axes of JSBSim point aft, right and up, in inches.
    for axis, sign in zip("xyz", (-1.0, 1.0, -1.0)):
        origin = float(_only(root, f"metrics/location[@name='AERORP']/{axis}").text or "nan")
        _only(balance, f"location/{axis}").text = repr(origin + sign * facts[f"{axis}_cg_b"] / INCH)
    control = _only(root, "flight_control")
    for channel in control.findall("channel"):
        name = channel.get("name", "")
        if name.startswith("engine"):
            control.remove(channel)
            ET.SubElement(control, "property", value="0").text = thrust_property(
                int(name.removeprefix("engine"))
            )


def _only(parent: ET.Element, path: str) -> ET.Element:
    element = parent.find(path)
    if element is None:
        raise SimulationError(
            f"the JSBSim model has no {path}; give a model that aeromatch exported"
        )
    return element


def _initial_condition(case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, float]:
    """Return the initial condition in the properties of JSBSim."""
    at = {str(name): float(item.values[0]) for name, item in case.data_vars.items()}
    # Rates of JSBSim are against the Earth, whose rotation in north, east, down is subtracted.
    earth = _EARTH_RATE * np.array([np.cos(at["lat"]), 0.0, -np.sin(at["lat"])])
    rates = (
        np.array([at["p"], at["q"], at["r"]])
        - matrix_from_euler(at["phi"], at["theta"], at["psi"]) @ earth
    )
    return {
        "atmosphere/delta-T": facts["delta_T"] * 1.8,
        "atmosphere/P-sl-psf": facts["qnh"] / PSF,
        "ic/lat-geod-rad": at["lat"],
        "ic/long-gc-rad": at["lon"],
        "ic/h-sl-ft": at["h"] / FOOT,
        "ic/phi-rad": at["phi"],
        "ic/theta-rad": at["theta"],
        "ic/psi-true-rad": at["psi"],
        **{f"ic/{name}-fps": at[name] / FOOT for name in "uvw"},
        **{f"ic/{name}-rad_sec": float(rate) for name, rate in zip("pqr", rates)},
    }


def _commands(root: ET.Element, case: xr.Dataset) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the commands and thrusts that give the positions of the case.

    The file states the scaling from commands to positions.
    """
    variables = {name: variable for variable, name in AXIS.items()}
    variables["fcs/right-aileron-pos-rad"] = "delta_a"
    for scale in root.iter("aerosurface_scale"):
        variable = variables.get(_only(scale, "output").text or "")
        if variable not in case:
            continue
        command = _only(scale, "input").text or ""
        low, high = (float(_only(scale, f"range/{end}").text or "nan") for end in ("min", "max"))
        position = case[variable].values
        if scale.find("zero_centered") is not None:
            fraction = (position - low) / (high - low)
        else:
            fraction = np.where(position > 0.0, position / high, -position / low)
        if command.startswith("-"):
            fraction = -fraction
        yield command.removeprefix("-"), fraction
    for name in case.data_vars:
        engine, _, kind = str(name).partition(".")
        if kind == "thrust_drive":
            number = int(engine.removeprefix("engine"))
            yield thrust_property(number), case[name].values / POUND_FORCE


def _fly_job(job: Job) -> np.ndarray:
    """Simulate a job in this process, and return the outputs (time, output)."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        return _fly_model(job, Path(folder))


def _fly_model(job: Job, folder: Path) -> np.ndarray:
    import jsbsim

    (folder / "model").mkdir()
    (folder / "model" / "model.xml").write_bytes(job["model"].tobytes())
    program = jsbsim.FGFDMExec(None)
    program.set_debug_level(0)
    if not program.load_model_with_paths("model", str(folder), str(folder), str(folder), True):
        raise SimulationError("it does not load the file")
    program.set_dt(float(job["dt"]))
    names, signals, outputs = job["names"].tolist(), job["signals"], job["outputs"].tolist()

    def command(row: int) -> None:
        for name, value in zip(names, signals[row]):
            program[name] = float(value)

    for name, value in zip(job["start_names"].tolist(), job["start"]):
        program[name] = float(value)
    command(0)
    program.run_ic()
    rows = np.empty((len(signals), len(outputs)))
    load_factor = outputs.index(_OUTPUTS["nz"][0])
    for row in range(len(signals)):
        states = [program[name] for name in outputs]
        command(row)
        program.run()
        rows[row] = states
        # The states move before the commands of the row act, so the load factor of these commands
        # is that of this frame.
        rows[row, load_factor] = program[_OUTPUTS["nz"][0]]
        for _ in range(_FRAMES - 1):
            program.run()
    return rows


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):
        answer_jobs(_fly_job)
