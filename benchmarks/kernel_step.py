"""One RK4 step of the kernel (four derivatives) against one frame of JSBSim's T37, in the same run.

    python benchmarks/kernel_step.py

The model has the size of a Citation's: 6 tables of one axis, 28 of two, 7 of three, 2 of four in 36 terms (seven terms have a
factor table), two engines with thrust tables and lags, WGS-84 Earth.  Needs the package ``jsbsim`` (``pip install aeromatch[dev]``).
"""

from __future__ import annotations

import time

import numpy as np
import xarray as xr

import flightmech
from flightmech.library import Simulation
from flightmech.terms import make

ALPHA, MACH = np.linspace(-0.15, 0.35, 14), np.linspace(0.1, 0.75, 8)
FLAP, BETA, HEIGHT = np.array([0.0, 0.26, 0.7]), np.linspace(-0.35, 0.35, 9), np.array([0.0, 3.0, 8.0, 20.0])
SEQUENCE = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
REGRESSORS = (("qhat",), ("delta_e",), ("beta",), ("phat",), ("rhat",), ("delta_a",), ("delta_r",), ("alphadothat",), ())


def citation_like() -> flightmech.SimModel:
    """Tables of sine waves around the derivatives of a light jet: the numbers do not matter, the shapes do."""
    one, two = {"alpha": ALPHA}, {"alpha": ALPHA, "mach": MACH}
    three, four = {**two, "delta_f": FLAP}, {"alpha": ALPHA, "beta": BETA, "delta_f": FLAP, "h_agl": HEIGHT}
    leaves = {
        "/CL/basic": make(5.0 * ALPHA + 0.2, one),
        "/CD/basic": make(0.03 + 0.8 * ALPHA**2, one),
        "/Cm/basic": make(-0.7 * ALPHA, one),
    }
    steady = [("Cm", "qhat", -14.0), ("Cl", "phat", -0.45), ("Cn", "beta", 0.1)]
    leaves |= {f"/{c}/{name}": make(np.full(len(ALPHA), value), one, [name]) for c, name, value in steady}
    for i, grid in enumerate([two] * 21 + [three] * 7 + [four] * 2):
        value = wave(grid, i)
        factor = (
            None
            if i >= 7
            else xr.DataArray(1.0 + wave({"beta": BETA, "delta_f": FLAP}, i), {"beta": BETA, "delta_f": FLAP}, ("beta", "delta_f"))
        )
        leaves[f"/{SEQUENCE[i % 6]}/t{i:02d}"] = make(value, grid, REGRESSORS[i % len(REGRESSORS)], K1=factor)
    thrust = make(np.outer([300.0, 4500.0, 9000.0], [1.0, 0.8, 0.7]), {"throttle": [0.0, 0.6, 1.0], "mach": [0.0, 0.4, 0.8]})
    engines = tuple(flightmech.Engine((0.0, side, 0.0), thrust=thrust, time_constant=1.0) for side in (-1.0, 1.0))
    craft = flightmech.Aircraft("bench", 30.0, 2.0, 15.9, 5000.0, 15000.0, 22000.0, 34000.0, Ixz=1000.0, engines=engines)
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def wave(grid: dict[str, np.ndarray], phase: int) -> np.ndarray:
    shape = [len(points) for points in grid.values()]
    return 1e-3 * np.sin(0.1 * np.arange(np.prod(shape)) + phase).reshape(shape)


def kernel_step(repeats: int = 7, seconds: float = 60.0) -> float:
    """CPU time of one RK4 step of 10 ms, best of `repeats` runs of a trimmed flight. [s]"""
    sim = citation_like()
    best = np.inf
    for _ in range(repeats):
        run, u = Simulation(sim.model), np.zeros(len(sim.inputs))
        for name, value in {"init.V": 120.0, "init.h": 3000.0, "mode.trim": 2.0}.items():
            run.set_parameter(sim.parameters.index(name), value)
        run.initialize()
        start = time.process_time()
        run.step(0.0, seconds, u, u)
        best = min(best, time.process_time() - start)
    return best / (seconds / 0.01)


def jsbsim_frame(repeats: int = 7, frames: int = 7200) -> float:
    """CPU time of one frame of the T37 in trimmed flight, best of `repeats`. [s]"""
    import jsbsim

    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("T37")
    for name, value in {"ic/h-sl-ft": 10000.0, "ic/vc-kts": 180.0, "ic/gamma-deg": 0.0}.items():
        fdm[name] = value
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    fdm["simulation/do_simple_trim"] = 1
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        for _ in range(frames):
            fdm.run()
        best = min(best, time.process_time() - start)
    return best / frames


def main() -> None:
    step, frame = kernel_step(), jsbsim_frame()
    print(f"kernel RK4 step, 43 tables  {1e6 * step:6.2f} us   ({0.01 / step:.0f} times real time)")
    print(f"JSBSim T37, one frame       {1e6 * frame:6.2f} us")
    print(f"ratio                       {frame / step:6.1f}    per derivative {4.0 * frame / step:.0f}")


if __name__ == "__main__":
    main()
