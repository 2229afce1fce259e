"""How fast recorded inputs go through the FMU, against the direct call of the kernel: ratios within
one run.

60 s at 100 Hz under elevator, aileron and rudder, 27 outputs, one internal step per sample; the
arrays of FMI 3.0 give every output, as they are.  Inputs are held between samples, those of the
arrays linear.  A synthetic model with 43 tables (6 of one axis, 28 of two, 7 of three, 2 of four),
the size of a business jet's database.  Run: ``python benchmarks/fmu_replay.py``.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
import xarray as xr
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.support.console import print_table
from flightmech.terms import make_term

START = {"init.V": 100.0, "init.h": 3000.0, "mode.trim": 1}
DURATION, STEP, REPEATS = 60.0, 0.01, 5
EXCITED = ("delta_e", "delta_a", "delta_r")
RECORDED = 27
AXES = {
    "alpha": np.linspace(-0.2, 0.3, 12),
    "mach": np.linspace(0.1, 0.8, 5),
    "delta_f": np.linspace(0.0, 0.7, 4),
    "h": np.linspace(0.0, 12000.0, 3),
}


def model() -> flightmech.SimModel:
    """Compile the synthetic aircraft; in addition to the terms that make it fly, tables of small
    random nodes.
    """
    random = np.random.default_rng(1)
    alpha = AXES["alpha"]
    leaves = {
        "/CL/basic": make_term(0.25 + 5.0 * alpha, {"alpha": alpha}),
        "/CD/basic": make_term(0.025 + 0.8 * alpha**2, {"alpha": alpha}),
        "/CY/beta": make_term(np.full(12, -0.6), {"alpha": alpha}, ["beta"]),
        "/Cl/beta": make_term(np.full(12, -0.08), {"alpha": alpha}, ["beta"]),
        "/Cm/basic": make_term(0.02 - 0.9 * alpha, {"alpha": alpha}),
        "/Cn/beta": make_term(np.full(12, 0.09), {"alpha": alpha}, ["beta"]),
    }
    for name, value, regressor in (
        ("Cl/phat", -0.45, "phat"),
        ("Cl/aileron", -0.12, "delta_a"),
        ("Cm/qhat", -14.0, "qhat"),
    ):
        leaves[f"/{name}"] = make_term(value, regressors=[regressor])
    for name, value, regressor in (
        ("Cm/delta_e", -1.1, "delta_e"),
        ("Cn/rhat", -0.14, "rhat"),
        ("Cn/rudder", -0.07, "delta_r"),
    ):
        leaves[f"/{name}"] = make_term(value, regressors=[regressor])
    coefficients = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    for number, axes in enumerate([2] * 28 + [3] * 7 + [4] * 2):
        grid = dict(list(AXES.items())[:axes])
        nodes = 1e-4 * random.standard_normal([len(points) for points in grid.values()])
        leaves[f"/{coefficients[number % 6]}/extra_{number}"] = make_term(
            nodes, grid, ["qhat" if number % 2 else "beta"]
        )
    engine = Engine(
        (0.0, 0.0, 0.0),
        thrust=make_term([200.0, 20000.0], {"throttle": [0.0, 1.0]}),
        time_constant=1.0,
    )
    aircraft = flightmech.Aircraft(
        "Benchmark",
        30.0,
        2.0,
        16.0,
        5500.0,
        12000.0,
        26000.0,
        36000.0,
        Ixz=1500.0,
        engines=(engine,),
    )
    return flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))


def recorded(sim: flightmech.SimModel) -> xr.Dataset:
    """Return all inputs over time: three doublets, the others at zero."""
    t = STEP * np.arange(round(DURATION / STEP) + 1)
    signals = {name: np.zeros_like(t) for name in sim.inputs}
    for i, name in enumerate(EXCITED):
        signals[name] = 0.02 * np.sin(np.clip((t - 5.0 - 15.0 * i) / 2.0, 0.0, 1.0) * 2.0 * np.pi)
    return xr.Dataset({name: ("time", signal) for name, signal in signals.items()}, {"time": t})


def fmpy_loop(folder: Path, inputs: xr.Dataset, outputs: list[str]) -> Callable[[], np.ndarray]:
    """Return a run by FMPy's `simulate_fmu` on the unpacked FMU with its description read
    beforehand.
    """
    description = fmpy.read_model_description(str(folder))
    names = ["time", *map(str, inputs.data_vars)]
    signals = np.zeros(inputs.sizes["time"], [(name, float) for name in names])
    for name in names:
        signals[name] = inputs[name].values

    def run() -> np.ndarray:
        found = fmpy.simulate_fmu(
            str(folder),
            model_description=description,
            stop_time=DURATION,
            output_interval=STEP,
            start_values=START,
            input=signals,
            output=outputs,
        )
        return np.stack([found[name] for name in outputs], axis=1)

    return run


def own_loop(folder: Path, inputs: xr.Dataset, outputs: list[str]) -> Callable[[], np.ndarray]:
    """Return a run by a plain loop over the functions of the standard, all buffers made once."""
    description = fmpy.read_model_description(str(folder))
    second = description.fmiVersion == "2.0"
    references = {v.name: v.valueReference for v in description.modelVariables}
    t, u = (
        inputs["time"].values,
        np.stack([item.values for item in inputs.data_vars.values()], axis=1),
    )
    given = [references[str(name)] for name in inputs.data_vars]
    wanted = [references[name] for name in outputs]

    def run() -> np.ndarray:
        kind = FMU2Slave if second else FMU3Slave
        fmu = kind(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        fmu.instantiate()
        if second:
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        _set_start(fmu, references, second)
        fmu.exitInitializationMode()
        y = _advance(fmu, second, t, u, given, wanted)
        fmu.freeInstance()
        return y

    return run


def _advance(
    fmu,
    second: bool,
    t: np.ndarray,
    u: np.ndarray,
    references_in: list[int],
    references_out: list[int],
) -> np.ndarray:
    library, instance = ctypes.CDLL(fmu.dll._name), ctypes.c_void_p(fmu.component)
    names = (
        ("fmi2SetReal", "fmi2GetReal", "fmi2DoStep")
        if second
        else ("fmi3SetFloat64", "fmi3GetFloat64", "fmi3DoStep")
    )
    put, get, step = (getattr(library, name) for name in names)
    given = (ctypes.c_uint * len(references_in))(*references_in)
    wanted = (ctypes.c_uint * len(references_out))(*references_out)
    n_in, n_out = ctypes.c_size_t(len(given)), ctypes.c_size_t(len(wanted))
    y = np.empty((len(t), len(wanted)))
    # one object for each argument that changes: only its value does
    row_in, row_out, point, size = (
        ctypes.c_void_p(),
        ctypes.c_void_p(y.ctypes.data),
        ctypes.c_double(),
        ctypes.c_double(),
    )
    at_in, at_out = (range(a.ctypes.data, a.ctypes.data + a.nbytes, a.strides[0]) for a in (u, y))
    flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
    tail = () if second else (*flags, ctypes.byref(ctypes.c_double()))
    prior = ctypes.c_int(1) if second else ctypes.c_bool(True)
    extra_in, extra_out = ((), ()) if second else ((n_in,), (n_out,))
    status = get(instance, wanted, n_out, row_out, *extra_out)
    for row_in.value, row_out.value, point.value, size.value in zip(
        at_in, at_out[1:], t.tolist(), np.diff(t).tolist(), strict=False
    ):
        status |= put(instance, given, n_in, row_in, *extra_in)
        status |= step(instance, point, size, prior, *tail)
        status |= get(instance, wanted, n_out, row_out, *extra_out)
    if status:
        raise RuntimeError(f"a call of the FMU returned {status}")
    return y


def array_replay(
    folder: Path, inputs: xr.Dataset, outputs: list[str], keep: bool
) -> Callable[[], np.ndarray]:
    """Return a run of the whole record in one step: instance, arrays in, step, array out.

    `keep`: each run makes an instance of a library that stays loaded, as a program with many runs
    does; otherwise FMPy loads it and declares its functions in Python for each run.
    """
    description = fmpy.read_model_description(str(folder))
    references = {v.name: v.valueReference for v in description.modelVariables}
    names = [
        v.name
        for v in description.modelVariables
        if v.causality == "output" and v.name != "replay.y"
    ]
    columns = [names.index(name) for name in outputs]
    t, u = (
        inputs["time"].values,
        np.stack([item.values for item in inputs.data_vars.values()], axis=1),
    )
    where, real = (ctypes.c_uint * 1)(references["replay.y"]), ctypes.POINTER(ctypes.c_double)

    def load() -> FMU3Slave:
        return FMU3Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
        )

    loaded = load() if keep else None

    def run() -> np.ndarray:
        fmu = loaded or load()
        fmu.instantiate()
        fmu.enterConfigurationMode()
        fmu.setUInt64([references["replay.n"]], [len(t)])
        fmu.exitConfigurationMode()
        for name, values in (("replay.t", t), ("replay.u", u)):
            fmu.fmi3SetFloat64(
                fmu.component,
                (ctypes.c_uint * 1)(references[name]),
                1,
                np.ascontiguousarray(values).ctypes.data_as(real),
                values.size,
            )
        fmu.enterInitializationMode()
        _set_start(fmu, references, second=False)
        fmu.exitInitializationMode()
        fmu.doStep(t[0], t[-1] - t[0])
        y = np.empty((len(t), len(names)))
        fmu.fmi3GetFloat64(fmu.component, where, 1, y.ctypes.data_as(real), y.size)
        if keep:
            fmu.fmi3FreeInstance(fmu.component)
        else:
            fmu.freeInstance()  # of FMPy: the library too
        return y[:, columns]

    return run


def _set_start(fmu, references: dict[str, int], second: bool) -> None:
    """Set the start values, each by the type that its standard gives it."""
    for name, value in START.items():
        whole = isinstance(value, int)
        put = (
            (fmu.setInteger if whole else fmu.setReal)
            if second
            else (fmu.setInt64 if whole else fmu.setFloat64)
        )
        put([references[name]], [value])


def main() -> None:
    """Time every driver, check that they agree, print."""
    sim = model()
    inputs = recorded(sim)
    outputs = list(sim.outputs[:RECORDED])
    with TemporaryDirectory() as folder:
        runs = {
            "kernel, one call": lambda: (
                flightmech.simulate(sim, inputs, START, hold="zero")[outputs].to_array().values.T
            )
        }
        for version in ("2.0", "3.0"):
            path = flightmech.write_fmu(sim, Path(folder) / f"{version}.fmu", version)
            unpacked = Path(fmpy.extract(str(path), str(Path(folder) / version)))
            runs[f"FMI {version}, own loop"] = own_loop(unpacked, inputs, outputs)
            runs[f"FMI {version}, FMPy simulate_fmu"] = fmpy_loop(unpacked, inputs, outputs)
        for title, keep in (("one step", False), ("library kept", True)):
            runs[f"FMI 3.0, arrays, {title}"] = array_replay(unpacked, inputs, outputs, keep)
        linear = flightmech.simulate(sim, inputs, START)[outputs].to_array().values.T
        found = {name: run() for name, run in runs.items()}
        best = dict.fromkeys(runs, np.inf)
        for _ in range(REPEATS):
            for name, run in runs.items():
                start = time.process_time()
                run()
                best[name] = min(best[name], time.process_time() - start)
    first = next(iter(runs))
    steps = inputs.sizes["time"] - 1
    rows = [
        (
            name,
            f"{1e3 * seconds:.1f}",
            f"{1e6 * seconds / steps:.2f}",
            f"{seconds / best[first]:.1f}",
            f"{DURATION / seconds:.0f}",
            f"{abs(found[name] - (linear if 'arrays' in name else found[first])).max():.1g}",
        )
        for name, seconds in best.items()
    ]
    columns = ("driver", "ms", "us/step", "x kernel", "x real time", "largest difference")
    print_table(
        columns,
        rows,
        f"{DURATION:.0f} s at {1 / STEP:.0f} Hz, {RECORDED} outputs, {len(sim.terms)} terms",
        right=columns[1:],
    )


if __name__ == "__main__":
    main()
