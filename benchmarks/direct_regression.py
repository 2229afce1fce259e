"""Tables from samples at size: time and memory of `aerodb.update.regress_tables`.

    python benchmarks/direct_regression.py [--samples 120000] [--manoeuvres 40]

Two tables of lift over incidence, Mach number and flap, 2002 nodes in all, flown by manoeuvres of
coloured noise all over the envelope; peer: ordinary least squares of the same nodes by the sparse
solver of SciPy (LSQR), which has no prior and no standard errors.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np
import xarray as xr
from scipy.signal import lfilter
from scipy.sparse import hstack, vstack
from scipy.sparse.linalg import lsqr

from aerodb.store.schema import make_database
from aerodb.update.regression import regress_tables
from flightmech import terms
from flightmech.units import DEGREE
from flighttest.regression.combining.joined_fits import coloured_covariance

STEP = 0.02
NOISE = 0.004
ROOT = dict(
    title="size",
    aircraft="none",
    S=16.0,
    cbar=1.6,
    b=10.0,
    x_ref=0.0,
    y_ref=0.0,
    z_ref=0.0,
    force_axes="stability",
)


def prior() -> dict[str, xr.Dataset]:
    """Return two terms of 1001 nodes each."""
    alpha, mach, flap = (
        np.linspace(-8, 20, 13) * DEGREE,
        np.linspace(0.1, 0.7, 11),
        np.linspace(0, 40, 7) * DEGREE,
    )
    a, _, f = np.meshgrid(alpha, mach, flap, indexing="ij")
    axes = {"alpha": alpha, "mach": mach, "delta_f": flap}
    basic = terms.make_term(
        0.2 + 5.0 * a + 0.6 * f, axes, stderr=np.hypot(0.05, 0.4 * np.abs(a)), source="datcom"
    )
    return {
        "CL/basic": basic,
        "CL/qhat": terms.make_term(
            np.full(a.shape, 6.0), axes, ("qhat",), stderr=1.5, source="datcom"
        ),
    }


def manoeuvre(
    leaves: dict[str, xr.Dataset], samples: int, rng: np.random.Generator, name: str
) -> xr.Dataset:
    """Return samples about a random condition."""
    t, k = STEP * np.arange(samples), np.arange(1, 16)

    def multisine() -> np.ndarray:
        return np.cos(2 * np.pi * np.outer(t, k) / 30 + rng.uniform(0, 2 * np.pi, len(k))).sum(
            axis=1
        ) / np.sqrt(len(k))

    data = {
        "alpha": (rng.uniform(-4, 14) + 1.5 * multisine()) * DEGREE,
        "mach": rng.uniform(0.15, 0.65) + 0.02 * multisine(),
    }
    data |= {"delta_f": np.full(samples, rng.uniform(0, 40) * DEGREE), "qhat": 0.002 * multisine()}
    c = np.exp(-STEP / 0.3)
    error = NOISE * lfilter([np.sqrt(1 - c * c)], [1, -c], rng.normal(size=samples))
    data["CL"] = sum(terms.evaluate_term(leaf, data, "clamp") for leaf in leaves.values()) + error
    data |= {"time": t, "manoeuvre": np.zeros(samples, int)}
    return xr.Dataset(
        {x: ("sample", y) for x, y in data.items()},
        attrs={"coefficient": "CL", "name": name, "steps": [STEP]},
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=120_000)
    parser.add_argument("--manoeuvres", type=int, default=40)
    given = parser.parse_args()
    rng, leaves = np.random.default_rng(1), prior()
    truth = {
        name: leaf.assign(
            value=leaf["value"] + leaf["stderr"] * np.sin(8 * leaf["alpha"] + name.count("q"))
        )
        for name, leaf in leaves.items()
    }
    size = given.samples // given.manoeuvres
    samples = [manoeuvre(truth, size, rng, f"manoeuvre {k}") for k in range(given.manoeuvres)]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    found = regress_tables(samples, make_database(leaves, **ROOT), coloured_covariance)
    ours = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    rows = []
    for one in samples:
        conditions = {name: one[name].values for name in ("alpha", "mach", "delta_f", "qhat")}
        rows.append(hstack([terms.basis(leaf, conditions, "clamp") for leaf in leaves.values()]))
    lsqr(vstack(rows), np.concatenate([one["CL"].values for one in samples]))
    theirs = time.perf_counter() - start
    nodes = sum(leaf["value"].size for leaf in leaves.values())
    print(
        f"{size * given.manoeuvres} samples, {nodes} nodes, "
        f"{int(found.compatibility['count'].sum())} directions"
    )
    print(
        f"regress_tables {ours:.1f} s, peak {peak / 1024:.0f} MB ({before / 1024:.0f} MB "
        f"before); LSQR {theirs:.1f} s"
    )
    for name, leaf in found.items():
        flown = leaf["source"].values == terms.SOURCES.index("flight")
        error = (leaf["value"] - truth[name]["value"]).values[flown]
        inside = 100 * np.mean(np.abs(error / leaf["stderr"].values[flown]) < 2)
        rms = np.sqrt(np.mean(error**2))
        print(
            f"{name}: {flown.sum()} nodes from flight, {inside:.0f} % within two standard "
            f"errors, rms error {rms:.2g}"
        )


if __name__ == "__main__":
    main()
