"""One RK4 step of the kernel (four derivatives) against one frame of JSBSim's T37, in the same run.

    python benchmarks/kernel_step.py [out/t37]

Two models, two engines with thrust tables and lags each, WGS-84 Earth.  One has the size of a
Citation's: 6 tables of one axis, 28 of two, 7 of three, 2 of four in 36 terms.  The other has that
of the whole build-up of LR-743: 16, 72, 26 and 6 tables, 120 in 113 terms.  Seven terms of each
have a factor table.  With the folder of `./run demo` the identified T-37 flies with them: its
terms, two engine decks, landing gear and three control circuits.  Then the step of one of eight
runs, one after the other and side by side in the lanes of the processor, with masses, speeds and
heights 20 % apart (tables in different cells) and 1e-6 apart.  Needs the package ``jsbsim`` (``pip
install aeromatch[dev]``).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import xarray as xr

import flightmech
from flightmech.simulation.compiler import compile_files
from flightmech.simulation.kernel import PARAMETER, Simulation
from flightmech.terms import make_term

ALPHA, MACH = np.linspace(-0.15, 0.35, 14), np.linspace(0.1, 0.75, 8)
FLAP, BETA, HEIGHT = (
    np.array([0.0, 0.26, 0.7]),
    np.linspace(-0.35, 0.35, 9),
    np.array([0.0, 3.0, 8.0, 20.0]),
)
SEQUENCE = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
REGRESSORS = (
    ("qhat",),
    ("delta_e",),
    ("beta",),
    ("phat",),
    ("rhat",),
    ("delta_a",),
    ("delta_r",),
    ("alphadothat",),
    (),
)


RUNS = 8  # side by side
CLASS, WHOLE = (
    (0, 21, 7, 2),
    (10, 65, 26, 6),
)  # tables of one to four axes in addition to the six that make it fly


def citation_like(
    counts: tuple[int, ...] = CLASS,
    engines: tuple[flightmech.aircraft.Engine, ...] | None = None,
) -> flightmech.SimModel:
    """Tables of sine waves around the derivatives of a light jet: the numbers do not matter, the
    shapes do.  Without engines two with thrust tables.
    """
    one, two = {"alpha": ALPHA}, {"alpha": ALPHA, "mach": MACH}
    three, four = (
        {**two, "delta_f": FLAP},
        {"alpha": ALPHA, "beta": BETA, "delta_f": FLAP, "h_agl": HEIGHT},
    )
    leaves = {
        "/CL/basic": make_term(5.0 * ALPHA + 0.2, one),
        "/CD/basic": make_term(0.03 + 0.8 * ALPHA**2, one),
        "/Cm/basic": make_term(-0.7 * ALPHA, one),
    }
    steady = [("Cm", "qhat", -14.0), ("Cl", "phat", -0.45), ("Cn", "beta", 0.1)]
    leaves |= {
        f"/{c}/{name}": make_term(np.full(len(ALPHA), value), one, [name])
        for c, name, value in steady
    }
    grids = [
        grid
        for grid, count in zip((one, two, three, four), counts, strict=True)
        for _ in range(count)
    ]
    for i, grid in enumerate(grids):
        value = wave(grid, i)
        factor = (
            None
            if i >= 7
            else xr.DataArray(
                1.0 + wave({"beta": BETA, "delta_f": FLAP}, i),
                {"beta": BETA, "delta_f": FLAP},
                ("beta", "delta_f"),
            )
        )
        leaves[f"/{SEQUENCE[i % 6]}/t{i:03d}"] = make_term(
            value, grid, REGRESSORS[i % len(REGRESSORS)], K1=factor
        )
    thrust = make_term(
        np.outer([300.0, 4500.0, 9000.0], [1.0, 0.8, 0.7]),
        {"throttle": [0.0, 0.6, 1.0], "mach": [0.0, 0.4, 0.8]},
    )
    engines = engines or tuple(
        flightmech.aircraft.Engine((0.0, side, 0.0), thrust=thrust, time_constant=1.0)
        for side in (-1.0, 1.0)
    )
    craft = flightmech.Aircraft(
        "bench", 30.0, 2.0, 15.9, 5000.0, 15000.0, 22000.0, 34000.0, Ixz=1000.0, engines=engines
    )
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def wave(grid: dict[str, np.ndarray], phase: int) -> np.ndarray:
    shape = [len(points) for points in grid.values()]
    return 1e-3 * np.sin(0.1 * np.arange(np.prod(shape)) + phase).reshape(shape)


def started(sim: flightmech.SimModel) -> Simulation:
    """A trimmed flight at its start."""
    run = Simulation(sim.model)
    for name, value in {"init.V": 120.0, "init.h": 3000.0, "mode.trim": 2.0}.items():
        run.set_parameter(sim.parameters.index(name), value)
    run.initialize()
    return run


def flight(sim: flightmech.SimModel, seconds: float = 60.0) -> float:
    """CPU time of one RK4 step of 10 ms. [s]"""
    run, u = started(sim), np.zeros(len(sim.inputs))
    start = time.process_time()
    run.step(0.0, seconds, u, u)
    return (time.process_time() - start) / (seconds / 0.01)


def side_by_side(
    sim: flightmech.SimModel, spread: float, fdm, repeats: int, seconds: float = 10.0
) -> list[float]:
    """CPU time of one step of one of eight runs, their starts left out, in 1, 4 and 8 lanes, and of
    a frame of JSBSim. [s]
    """
    around = np.linspace(1.0 - spread, 1.0 + spread, RUNS)
    mass = next(row.value for row in sim.entries(PARAMETER) if row.name == "mass.mass")
    varied = {"mass.mass": mass * around, "init.V": 120.0 * around, "init.h": 3000.0 * around}

    def batch(lanes: int, end: float) -> float:
        record = xr.Dataset(coords={"time": np.arange(0.0, end + 0.5)})
        start = time.process_time()
        flightmech.simulate_batch(sim, record, varied, outputs=["V"], threads=1, lanes=lanes)
        return time.process_time() - start

    times = [
        [
            frame(fdm, 600),
            *(batch(lanes, end) for lanes in (1, 4, 8) for end in (1.0, 1.0 + seconds)),
        ]
        for _ in range(repeats)
    ]
    peer, *least = np.min(times, axis=0)
    return [*(np.diff(least)[::2] / (RUNS * seconds / 0.01)), peer]


def trimmed_t37():
    """JSBSim's T37 in level flight with its engines running."""
    import jsbsim

    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("T37")
    for name, value in {"ic/h-sl-ft": 10000.0, "ic/vc-kts": 180.0, "ic/gamma-deg": 0.0}.items():
        fdm[name] = value
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    fdm["simulation/do_simple_trim"] = 1
    return fdm


def frame(fdm, frames: int = 7200) -> float:
    """CPU time of one frame. [s]"""
    start = time.process_time()
    for _ in range(frames):
        fdm.run()
    return (time.process_time() - start) / frames


def main(demo: Path | None = None, repeats: int = 20) -> None:
    models, fdm = [citation_like(), citation_like(WHOLE)], trimmed_t37()
    if demo:
        models.append(compile_files(str(demo / "final.toml"), str(demo / "final.nc")))
    # in turn, so that what else the machine does meets all alike
    step, large, *t37, peer = np.min(
        [[*map(flight, models), frame(fdm)] for _ in range(repeats)], axis=0
    )
    print(f"kernel RK4 step, 43 tables  {1e6 * step:6.2f} us   ({0.01 / step:.0f} times real time)")
    print(
        f"kernel RK4 step, 120 tables {1e6 * large:6.2f} us   ({large / step:.2f} times 43 tables)"
    )
    print(f"JSBSim T37, one frame       {1e6 * peer:6.2f} us")
    for whole in t37:
        print(
            f"kernel RK4 step, T-37 complete {1e6 * whole:6.2f} us   (JSBSim's frame is "
            f"{peer / whole:.1f} times as long)"
        )
    print(
        f"ratio                       {peer / step:6.1f}    per derivative {4.0 * peer / step:.0f}"
    )
    names = ["43 tables", "120 tables", "T-37"]
    for name, model in zip(names, models, strict=False):
        for spread in (0.2, 1e-6):
            alone, four, eight, peer = side_by_side(model, spread, fdm, repeats)
            lanes = (
                f"{1e6 * four:.2f} in four lanes ({alone / four:.1f}), {1e6 * eight:.2f} in "
                f"up to eight ({alone / eight:.1f})"
            )
            print(
                f"{name}, runs {spread:g} apart: step of a run {1e6 * alone:.2f} us alone, {lanes}"
            )
            print(f"    JSBSim's frame is {peer / four:.1f} and {peer / eight:.1f} times as long")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
