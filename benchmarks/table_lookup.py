"""Table look-up of the kernel against SciPy's RegularGridInterpolator: one 3-D table of 20 x 8 x 4,
linear, in the same run.

python benchmarks/table_lookup.py
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator
from timing import best  # next to this file

import flightmech
from flightmech.simulation.kernel import Simulation
from flightmech.terms import make_term

AXES = {
    "alpha": np.linspace(-0.2, 0.4, 20),
    "mach": np.linspace(0.1, 0.8, 8),
    "delta_f": np.array([0.0, 0.2, 0.4, 0.7]),
}


def model(value: np.ndarray, tables: int) -> flightmech.SimModel:
    craft = flightmech.Aircraft("bench", 30.0, 2.0, 15.9, 5000.0, 15000.0, 22000.0, 34000.0)
    return flightmech.compile(
        craft,
        xr.DataTree.from_dict({f"/CL/t{i:02d}": make_term(value + i, AXES) for i in range(tables)}),
    )


def points(n: int, along: bool) -> np.ndarray:
    """Random points, or points along a smooth flight."""
    lows, spans = (np.array([f(p) for p in AXES.values()]) for f in (np.min, np.ptp))
    if not along:
        return lows + spans * np.random.default_rng(0).random((n, 3))
    t = np.linspace(0.0, 60.0, n)
    return lows + spans * (
        0.5 + 0.4 * np.stack([np.sin(0.9 * t), np.sin(0.2 * t), np.sin(0.1 * t)], axis=1)
    )


def main() -> None:
    value = np.random.default_rng(1).normal(size=[len(p) for p in AXES.values()])
    one, sixteen = model(value, 1), model(value, 16)
    scipy_table = RegularGridInterpolator(tuple(AXES.values()), value)
    order = [list(AXES).index(name) for name in one.variables]
    for word, along in (("along a flight", True), ("random", False)):
        x = points(100_000, along)
        v = np.ascontiguousarray(x[:, order])
        run, bundle = Simulation(one.model), Simulation(sixteen.model)
        difference = np.abs(run.evaluate(v)[0][:, 0] - scipy_table(x)).max()
        ours, many, theirs = (
            best(lambda r=run, v=v: r.evaluate(v), 7),
            best(lambda r=bundle, v=v: r.evaluate(v), 7),
            best(lambda x=x: scipy_table(x), 7),
        )
        own, bundled, scipy_ns = (1e9 / len(x) * t for t in (ours, many / 16, theirs))
        print(
            f"{word:15s} kernel {own:6.1f} ns   per table of a bundle of 16 {bundled:5.1f} "
            f"ns   SciPy {scipy_ns:6.1f} ns"
        )
        print(
            f"{'':15s} ratio {theirs / ours:.1f}, in the bundle {theirs / many * 16:.0f}   "
            f"(largest difference {difference:.1e})"
        )


if __name__ == "__main__":
    main()
