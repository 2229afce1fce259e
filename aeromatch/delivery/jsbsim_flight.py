"""A flown check case flown by JSBSim: another program, with its own equations of motion, Earth and
atmosphere.

JSBSim differs from the kernel in what is no fault of the model: it takes the damping from rates
against the Earth and not against inertial space (7e-5 rad/s), inputs act one frame later, and load
factor and lift of the step before.  So the two are compared by a twentieth of the bands of 14 CFR
Part 60, Table A2A, below which no proof of match depends on the program.

JSBSim ends the whole process when it does not like a file; it is run in one of its own.
"""

from __future__ import annotations

import contextlib
import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.properties import AXIS, PSF, thrust_property
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
"""Bands of Table A2A: tests 2.c.1 (V, h, theta), 2.c.10 (q, nz), 2.d.2 (p), 2.d.6 (r), 2.d.8 (phi, beta); psi as phi, alpha as theta."""
PART = 0.05  # of the bands
_FRAMES = 40  # of JSBSim in an interval of the case
_EARTH_RATE = 7.292115e-5  # [rad/s] WGS-84
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
    """Return whether the Python package of JSBSim is there."""
    return importlib.util.find_spec("jsbsim") is not None


def fly_by_jsbsim(
    model: Path, case: xr.Dataset, facts: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return outputs of a check case flown by JSBSim, those of `BANDS`. [SI]

    Parameters
    ----------
    model : Path
        What `aerodb.exchange.export_jsbsim` wrote.
    case, facts
        Of `read_flown_check`.

    Raises
    ------
    SimulationError
        JSBSim does not load the file, or its run ends early, with its words.
    """
    tree = ET.parse(model)
    root = tree.getroot()
    _load(root, facts)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "model").mkdir()
        tree.write(folder / "model" / "model.xml")
        time = case["time"].values
        signals = dict(_commands(root, case))
        np.savez(
            folder / "job.npz",
            dt=(time[1] - time[0]) / _FRAMES,
            start_names=np.array([*(start := _start(case, facts))]),
            start=np.array([*start.values()]),
            names=np.array([*signals]),
            signals=np.column_stack([*signals.values()]),
            outputs=np.array([name for name, _ in _OUTPUTS.values()]),
        )
        ended = subprocess.run(
            [sys.executable, "-m", __name__, str(folder)],
            capture_output=True,
            text=True,
            errors="replace",
        )
        if ended.returncode:
            words = " ".join((ended.stderr.strip() or ended.stdout.strip()).splitlines()[-3:])
            raise SimulationError(
                f"JSBSim flies no check case with {model.name}: "
                f"{words or f'it ended with code {ended.returncode}'}"
            )
        rows = np.load(folder / "flown.npy")
    found = {
        name: rows[:, column] * factor
        for column, (name, (_, factor)) in enumerate(_OUTPUTS.items())
    }
    for angle in ("phi", "psi"):  # JSBSim gives the heading from 0 to 2 pi
        found[angle] = (
            case[angle].values + (found[angle] - case[angle].values + np.pi) % (2.0 * np.pi) - np.pi
        )
    return found


def _load(root: ET.Element, facts: Mapping[str, float]) -> None:
    """Give the model mass and centre of gravity of the case, and its thrusts to whoever flies."""
    balance = _only(root, "mass_balance")
    _only(balance, "emptywt").text = repr(facts["mass"] / POUND)
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
    found = parent.find(path)
    if found is None:
        raise SimulationError(f"the JSBSim model has no {path}; it is none that aeromatch exports")
    return found


def _start(case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, float]:
    """Return the initial condition in the properties of JSBSim, whose rates are against the Earth."""
    at = {str(name): float(item.values[0]) for name, item in case.data_vars.items()}
    turn = _EARTH_RATE * np.array([np.cos(at["lat"]), 0.0, -np.sin(at["lat"])])
    rates = (
        np.array([at["p"], at["q"], at["r"]])
        - matrix_from_euler(at["phi"], at["theta"], at["psi"]) @ turn
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
    """Yield the commands and thrusts that make the positions of the case, from the scaling that the
    file states.
    """
    variables = {name: variable for variable, name in AXIS.items()} | {
        "fcs/right-aileron-pos-rad": "delta_a"
    }
    for scale in root.iter("aerosurface_scale"):
        variable = variables.get(_only(scale, "output").text or "")
        if variable not in case:
            continue
        command = _only(scale, "input").text or ""
        low, high = (float(_only(scale, f"range/{end}").text or "nan") for end in ("min", "max"))
        position = case[variable].values
        if scale.find("zero_centered") is not None:
            part = (position - low) / (high - low)
        else:
            part = np.where(position > 0.0, position / high, -position / low)
        yield command.removeprefix("-"), -part if command.startswith("-") else part
    for name in case.data_vars:
        engine, _, kind = str(name).partition(".")
        if kind == "thrust_drive":
            yield (
                thrust_property(int(engine.removeprefix("engine"))),
                case[name].values / POUND_FORCE,
            )


def _fly(folder: Path) -> None:
    """Fly the job of a folder, in a process of its own."""
    import jsbsim

    job = np.load(folder / "job.npz")
    program = jsbsim.FGFDMExec(None)
    program.set_debug_level(0)
    if not program.load_model_with_paths("model", str(folder), str(folder), str(folder), True):
        sys.exit("it does not load the file")
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
    for row in range(len(signals)):
        states = [program[name] for name in outputs]
        command(row)
        # the state moves before the commands of the row act: their load factor is that of this
        # frame
        program.run()
        rows[row] = [
            program[name] if name == _OUTPUTS["nz"][0] else state
            for name, state in zip(outputs, states)
        ]
        for _ in range(_FRAMES - 1):
            program.run()
    np.save(folder / "flown.npy", rows)


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):
        _fly(Path(sys.argv[1]))
