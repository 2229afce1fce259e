"""How often the estimates of filter error lie within two standard errors, and their rms against
output error, in four kinds of air.

    python benchmarks/filter_error.py [RECORDS] [KIND ...]     of each kind, 40 unless given

A short period (two states, elevator multistep and sine of 20 s at 25 Hz, four unknown elements),
its angle of attack by a vane or by an inertial platform:

- calm: noise of the instruments alone;
- process: white noise in the rates of both states;
- vane, inertial: vertical Dryden gusts of 1 m/s, MIL-F-8785C, scale 150 m at 100 m/s.

Rows are output error, and filter error with white process noise, with Dryden gusts whose intensity
and scale are estimated, and with both.
"""

from __future__ import annotations

import os
import sys
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads of BLAS only wait

import numpy as np
import xarray as xr
from output_error import ELEMENTS, A, B, C
from scipy.linalg import expm
from turbulence_warning import SCALE, SPEED, STEP, vertical_gust

from flighttest.maximum_likelihood import (
    DrydenGust,
    LinearModel,
    OutputError,
    filter_error,
    linear_model,
    linear_output_error,
)

OUTPUTS, NOISE = ("alpha", "q", "nz"), np.array([2e-3, 2e-3, 0.02])
FINE = 5  # steps of the simulation in one of the record
KINDS = ("calm", "process", "vane", "inertial")
WHITE = {"process.alpha": 0.01, "process.q": 0.01}


def short_period() -> LinearModel:
    """Return the model with all elements as parameters."""
    names = {
        "state": ["alpha", "q"],
        "state_": ["alpha", "q"],
        "input": ["delta_e"],
        "output": list(OUTPUTS),
    }
    blocks = {
        "A": (("state", "state_"), A),
        "B": (("state", "input"), B),
        "C": (("output", "state_"), C),
        "D": (("output", "input"), np.zeros((3, 1))),
    }
    return linear_model(xr.Dataset(blocks, names))


def record(kind: str, seed: int) -> xr.Dataset:
    """Return one record: exact transitions between samples, gusts held over a fine step."""
    rng, h = np.random.default_rng(seed), STEP / FINE
    t = np.arange(0.0, 20.02, STEP)
    steps = np.interp(t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0])
    u = 0.03 * steps + 0.01 * np.sin(5.0 * t) * (t < 15)
    count = (len(t) - 1) * FINE + 1
    drive = np.interp((np.arange(count) + 0.5) * h, t, u)
    gust = vertical_gust(float(kind in ("vane", "inertial")), rng, count, h)
    stirred = np.sqrt(h) * np.array([0.02, 0.03]) * rng.standard_normal((count, 2))
    stirred *= kind == "process"
    F = expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2))
    x, states = np.zeros(2), np.empty((count, 2))
    for k in range(count):
        states[k] = x
        x = F @ x + G @ (B[:, 0] * drive[k] + A[:, 0] * gust[k]) + stirred[k]
    # The accelerometer feels the force of the gust; only a vane measures its angle.
    felt = C[:, 0] * np.array([float(kind == "vane"), 1.0, 1.0])
    y = states[::FINE] @ C.T + np.outer(gust[::FINE], felt)
    y += NOISE * rng.standard_normal(y.shape)
    columns = {name: ("time", y[:, k]) for k, name in enumerate(OUTPUTS)}
    return xr.Dataset({"delta_e": ("time", u), **columns}, {"time": t})


def fits(kind: str, seed: int) -> dict[str, OutputError]:
    """Return the fits of one record by method."""
    model, data = short_period(), record(kind, seed)
    start = {name: 0.85 * value for name, value in ELEMENTS.items()}
    found = {
        "output error": linear_output_error(model, data, start),
        "white process noise": filter_error(model, data, start | WHITE),
    }
    other = ("alpha",) if kind == "inertial" else ()
    seen = tuple(name for name in ("alpha", "nz") if name not in other)
    # Intensity and scale start a factor of two off.
    gust = DrydenGust("alpha", SPEED, 2.0 * SCALE, 0.5, air_relative=seen, inertial=other)
    wanted = start | {"gust.w": 0.5, "scale.w": 2.0 * SCALE}
    found["Dryden gusts"] = filter_error(model, data, wanted, gusts=[gust])
    found["both"] = filter_error(model, data, wanted | WHITE, gusts=[gust])
    return found


def study(kind: str, seeds: range) -> None:
    """Print coverage, rms of the errors over their value in output error, and remarks."""
    errors: dict[str, list[np.ndarray]] = {}
    scaled: dict[str, list[np.ndarray]] = {}
    coloured: dict[str, int] = {}
    failed: dict[str, int] = {}
    truth = np.array(list(ELEMENTS.values()))
    for seed in seeds:
        for method, fit in fits(kind, seed).items():
            e = fit.estimates.sel(parameter=list(ELEMENTS))
            off = e["estimate"].values - truth
            errors.setdefault(method, []).append(off)
            scaled.setdefault(method, []).append(off / e["stderr"].values)
            kinds = {remark.kind for remark in fit.remarks}
            coloured[method] = coloured.get(method, 0) + ("coloured" in kinds)
            failed[method] = failed.get(method, 0) + ("convergence" in kinds)
    reference = np.sqrt(np.mean(np.square(errors["output error"]), axis=0))
    for method, ratios in scaled.items():
        z = np.array(ratios)
        inside = (np.abs(z) < 2.0).mean()
        ratio = np.sqrt(np.mean(np.square(errors[method]), axis=0)) / reference
        numbers = " ".join(f"{value:5.2f}" for value in ratio)
        by_element = " ".join(f"{value:4.0%}" for value in (np.abs(z) < 2.0).mean(axis=0))
        print(
            f"{kind:10s}{method:20s}{inside:6.1%} ({by_element}) {numbers}"
            f"{np.abs(z.mean(axis=0)).max():6.2f}{z.std(axis=0).max():6.2f}"
            f"{coloured[method]:5d}{failed[method]:4d}",
            flush=True,
        )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    print(
        f"{count} records of each kind: within two standard errors (each element), rms over that "
        f"of output error, largest mean and scatter of the errors in standard errors, records "
        f"remarked coloured, not converged"
    )
    for kind in sys.argv[2:] or KINDS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            study(kind, range(count))


if __name__ == "__main__":
    main()
