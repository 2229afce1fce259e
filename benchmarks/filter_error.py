"""How often the estimates of filter error lie within two standard errors, and their rms against
output error, in seven kinds of air.

    python benchmarks/filter_error.py [RECORDS] [KIND ...] [--right] [--results FILE]

40 records of each kind unless given. With ``--right`` only the filter of the right disturbance is
compared with output error. With ``--results`` every record is appended to a file of JSON lines, and
records of that file are not fitted again.

A short period (two states, elevator multistep and sine of 20 s at 25 Hz, four unknown elements),
its angle of attack by a vane or by an inertial platform:

- calm: noise of the instruments alone;
- process: white noise in the rates of both states;
- vane, inertial: vertical Dryden gusts of 1 m/s, MIL-F-8785C, scale 150 m at 100 m/s;
- rotation: as vane, and the air rotates by the q gust of MIL-F-8785C for a span of 10 m;
- share: as rotation, with 30 % of the damping from M_alphadot, which acts on the rotation with the
  other sign;
- still: as vane, estimated with a rotation that the air does not have.

Rows are output error, and filter error with white process noise, with Dryden gusts whose intensity
and scale are estimated, and with both.
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads of BLAS only wait

import numpy as np
import xarray as xr
from output_error import ELEMENTS, A, B, C
from scipy.linalg import expm
from scipy.signal import bilinear, lfilter
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
KINDS = ("calm", "process", "vane", "inertial", "rotation", "share", "still")
GUSTS = ("vane", "inertial", "rotation", "share", "still")
# factor on the damping, (M_q - M_alphadot) / (M_q + M_alphadot), of the rotation in the record
TURNS = {"rotation": 1.0, "share": 0.4}
SPAN = 10.0  # of the rotating air [m]
WHITE = {"process.alpha": 0.01, "process.q": 0.01}
OPEN_LOOP, STIRRED, GUSTY, BOTH = "output error", "white process noise", "Dryden gusts", "both"
TURNING = "gusts that rotate"
METHODS = (OPEN_LOOP, STIRRED, GUSTY, BOTH)
RIGHT = {kind: (OPEN_LOOP, GUSTY) for kind in KINDS} | {"process": (OPEN_LOOP, STIRRED)}
RIGHT |= {kind: (OPEN_LOOP, GUSTY, TURNING) for kind in ("rotation", "share", "still")}


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
    gust = vertical_gust(float(kind in GUSTS), rng, count, h)
    stirred = np.sqrt(h) * np.array([0.02, 0.03]) * rng.standard_normal((count, 2))
    stirred *= kind == "process"
    # The q gust is the derivative of the gust along the path behind a lag [MIL-F-8785C, 3.7.1.2].
    lag = bilinear([1.0, 0.0], [4.0 * SPAN / (np.pi * SPEED), 1.0], 1.0 / h)
    turn = -lfilter(*lag, gust) * TURNS.get(kind, 0.0)
    F = expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2))
    damping = np.array([0.0, A[1, 1]])
    x, states = np.zeros(2), np.empty((count, 2))
    for k in range(count):
        states[k] = x
        x = F @ x + G @ (B[:, 0] * drive[k] + A[:, 0] * gust[k] + damping * turn[k]) + stirred[k]
    # The accelerometer feels the force of the gust; only a vane measures its angle.
    felt = C[:, 0] * np.array([float(kind != "inertial"), 1.0, 1.0])
    y = states[::FINE] @ C.T + np.outer(gust[::FINE], felt)
    y += NOISE * rng.standard_normal(y.shape)
    columns = {name: ("time", y[:, k]) for k, name in enumerate(OUTPUTS)}
    return xr.Dataset({"delta_e": ("time", u), **columns}, {"time": t})


def fit(kind: str, data: xr.Dataset, method: str) -> OutputError:
    """Return the fit of one record by one method."""
    model, start = short_period(), {name: 0.85 * value for name, value in ELEMENTS.items()}
    if method == OPEN_LOOP:
        return linear_output_error(model, data, start)
    if method == STIRRED:
        return filter_error(model, data, start | WHITE)
    other = ("alpha",) if kind == "inertial" else ()
    seen = tuple(name for name in ("alpha", "nz") if name not in other)
    # Intensity and scale start a factor of two off.
    span = SPAN if method == TURNING else 0.0
    gust = DrydenGust(
        "alpha", SPEED, 2.0 * SCALE, 0.5, air_relative=seen, inertial=other, span=span
    )
    wanted = start | {"gust.w": 0.5, "scale.w": 2.0 * SCALE}
    if method == TURNING:
        wanted["turn.w"] = 1.0
    if method == BOTH:
        wanted |= WHITE
    return filter_error(model, data, wanted, gusts=[gust])


def fits(kind: str, seed: int, methods: tuple[str, ...]) -> dict[str, dict]:
    """Return errors, standard errors and remarks of the fits of one record by method."""
    data, truth, found = record(kind, seed), np.array(list(ELEMENTS.values())), {}
    for method in methods:
        done = fit(kind, data, method)
        e = done.estimates.sel(parameter=list(ELEMENTS))
        found[method] = {
            "error": (e["estimate"].values - truth).tolist(),
            "stderr": e["stderr"].values.tolist(),
            "remarks": [remark.kind for remark in done.remarks],
            "calm": str(done.estimates.attrs.get("calm", "")),
        }
    return found


def print_kind(kind: str, rows: list[dict], methods: tuple[str, ...]) -> None:
    """Print coverage, rms of the errors over their value in output error, and remarks."""
    reference = np.sqrt(np.mean([np.square(row[OPEN_LOOP]["error"]) for row in rows], axis=0))
    for method in methods:
        errors = np.array([row[method]["error"] for row in rows])
        z = errors / np.array([row[method]["stderr"] for row in rows])
        ratio = np.sqrt(np.mean(errors**2, axis=0)) / reference
        numbers = " ".join(f"{value:5.2f}" for value in ratio)
        by_element = " ".join(f"{value:4.0%}" for value in (np.abs(z) < 2.0).mean(axis=0))
        coloured = sum("coloured" in row[method]["remarks"] for row in rows)
        failed = sum("convergence" in row[method]["remarks"] for row in rows)
        calm = sum(bool(row[method]["calm"]) for row in rows)
        print(
            f"{kind:10s}{method:20s}{(np.abs(z) < 2.0).mean():6.1%} ({by_element}) {numbers}"
            f"{np.abs(z.mean(axis=0)).max():6.2f}{z.std(axis=0).max():6.2f}"
            f"{coloured:5d}{failed:4d}{calm:4d}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("records", nargs="?", type=int, default=40)
    parser.add_argument("kinds", nargs="*", default=KINDS)
    parser.add_argument("--right", action="store_true")
    parser.add_argument("--results", type=Path)
    options = parser.parse_args()
    known: dict[tuple[str, int], dict] = {}
    if options.results and options.results.exists():
        for line in options.results.read_text().splitlines():
            row = json.loads(line)
            known[row["kind"], row["seed"]] = row
    print(
        f"{options.records} records of each kind: within two standard errors (each element), rms "
        f"over that of output error, largest mean and scatter of the errors in standard errors, "
        f"records remarked coloured, not converged, without a disturbance"
    )
    for seed in range(options.records):
        for kind in options.kinds:
            methods = RIGHT[kind] if options.right else METHODS
            if (kind, seed) in known:
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                row = {"kind": kind, "seed": seed, **fits(kind, seed, methods)}
            known[kind, seed] = row
            if options.results:
                with options.results.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    for kind in options.kinds:
        methods = RIGHT[kind] if options.right else METHODS
        print_kind(kind, [known[kind, seed] for seed in range(options.records)], methods)


if __name__ == "__main__":
    main()
