"""How often the estimates of filter error of the simulation lie within two standard errors, and
their rms against output error, in four kinds of air.

    python benchmarks/simulated_filter_error.py [RECORDS] [KIND ...] [--results FILE]

20 records of each kind unless given. With ``--results`` every record is appended to a file of JSON
lines, and records of that file are not fitted again. ``--aircraft trainer`` has fewer tables.

The T-37 of the tutorial (``./run demo`` makes its database) flies an elevator multistep of 12 s at
25 Hz with six degrees of freedom. True airspeed, angle of attack, pitch rate, pitch attitude and
specific force are measured. Four scales of terms are estimated with four states at the first
sample:

- calm: noise of the instruments alone;
- process: white noise in the rates of angle of attack and pitch rate;
- vane, inertial: vertical Dryden gusts of 1 m/s, MIL-F-8785C, scale 150 m, as a wind of the
  simulation in steps of 8 ms; the angle of attack is that of a vane, or of an inertial platform;
- weak: gusts of 0.1 m/s with a vane, near the noise of the instruments;
- pair: two records as of vane in one fit, with first states and first gusts of their own;
- lateral: an aileron multistep in lateral gusts of 1 m/s with a vane; angle of sideslip, roll and
  yaw rate, bank and side force are measured, four lateral terms and first states estimated;
- roll: as lateral, in all six components of the turbulence of the kernel (MIL-F-8785C: u, v, w, and
  rotation about each axis); the filter has lateral gusts, and white noise in the rate of p.

The generator of the records shares no code with the filter: gusts are a wind input, white
noise changes velocity and rate between short steps, the inertial angle is that of attitude and
velocity over the ground.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads of BLAS only wait

import numpy as np
import xarray as xr
from output_error import LONGITUDINAL, aeroplane
from turbulence_warning import vertical_gust

import flighttest
from flightmech.simulation import SimModel, compile_files
from flightmech.simulation.run import constant_inputs, initialise_run
from flighttest.maximum_likelihood import (
    DrydenGust,
    OutputError,
    Unknown,
    simulated_filter_error,
)

ROOT = Path(__file__).parents[1]
STEP, FINE, DURATION = 0.04, 5, 12.0
SPEED, SCALE = 100.0, 150.0  # [m/s], [m]
NOISE = {"V": 0.2, "alpha": 2e-3, "q": 1e-3, "theta": 1e-3, "az": 0.1}
TERMS = {
    "t37": ("term.CL.basic", "term.Cm.basic", "term.Cm.qhat", "term.Cm.elevator"),
    "trainer": tuple(LONGITUDINAL),
}
LATERAL_NOISE = {"beta": 2e-3, "p": 2e-3, "r": 1e-3, "phi": 1e-3, "ay": 0.05}
LATERAL_TERMS = ("term.Cl.beta", "term.Cl.phat", "term.Cl.aileron", "term.Cn.beta")
KINDS = ("calm", "process", "vane", "inertial", "weak", "pair", "lateral", "roll")
ACROSS = ("lateral", "roll")  # kinds of the lateral motion
INTENSITY = {"calm": 0.0, "process": 0.0, "weak": 0.1, "roll": 0.0}  # of gusts, otherwise 1 [m/s]
WHITE = {"process.alpha": 0.01, "process.q": 0.02}  # truth of the kind process
HELD = {"mode.earth": 0.0, "mode.step": STEP / FINE, "init.h": 2000.0}
# of the kernel, in points as dense as the steps
TURBULENCE = {"turbulence.mode": 1.0, "turbulence.step": STEP / FINE, "turbulence.V": SPEED}
TURBULENCE |= {f"turbulence.sigma_{axis}": 1.0 for axis in "uvw"}
TURBULENCE |= {f"turbulence.L_{axis}": SCALE for axis in "uvw"}
METHODS = {kind: "Dryden gusts" for kind in KINDS}
METHODS |= {"process": "white process noise", "roll": "gusts and process.p"}


def trimmed(sim: SimModel) -> tuple[dict[str, float], np.ndarray]:
    """Return start values and constant inputs of level flight."""
    u = constant_inputs(sim, {})
    run = initialise_run(sim, HELD | {"init.V": SPEED, "mode.trim": 2.0}, u)
    y = dict(zip(sim.outputs, run.outputs()))
    start = {f"init.{name}": y[name] for name in ("V", "alpha", "theta", "q")}
    start |= {f"init.{name}": 0.0 for name in ("beta", "phi", "p", "r")}
    held = {
        f"bias.{name}": run.parameter(sim.parameters.index(f"bias.{name}"))
        for name in ("delta_e", "throttle", "delta_a", "delta_r")
    }
    return start | held, u


def record(sim: SimModel, kind: str, seed: int) -> tuple[xr.Dataset, dict[str, float]]:
    """Return one record, and the true states at its start with the settings of the trim."""
    rng, h = np.random.default_rng(seed), STEP / FINE
    start, u = trimmed(sim)
    count = round(DURATION / h) + 1
    t = np.arange(count) * h
    multistep = [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2]
    control = 0.03 * np.interp(t, multistep, [0, 1, 1, -1, -1, 1, 1, 0])
    control += 0.01 * np.sin(5.0 * t) * (t < 10.0)
    # The simulation of a fit has inputs that are linear between samples, so has this one: a sine
    # that it passes through would be 0.3 % smaller in the fit.
    control = np.interp(t, t[::FINE], control[::FINE])
    # Gusts upwards or to the right, as an angle; at the first sample the air is already in motion.
    gust = SPEED * vertical_gust(INTENSITY.get(kind, 1.0), rng, count, h)
    inputs = np.tile(u, (count, 1))
    surface = "delta_a" if kind in ACROSS else "delta_e"
    inputs[:, sim.inputs.index(surface)] += control
    winds = [sim.inputs.index(name) for name in ("wind_n", "wind_e", "wind_d")]
    # The start is that relative to the air: without the gust it is the trim.
    air = TURBULENCE | {"turbulence.seed": float(seed)} if kind == "roll" else {}
    run = initialise_run(sim, HELD | start | air, u)
    stirred = np.sqrt(h) * rng.standard_normal((count, 2)) * (kind == "process")
    noise = LATERAL_NOISE if kind in ACROSS else NOISE
    names = [*noise, "vd", "vn"]
    places = [sim.outputs.index(name) for name in names]
    rows = []
    for k in range(count):
        x = run.state
        # An upward gust blows against the z axis of the body, one to the right along the y axis.
        axis = _body_axis(x[6:10], 1) if kind in ACROSS else -_body_axis(x[6:10], 2)
        inputs[k, winds] = gust[k] * axis
        if k % FINE == 0:
            run.set_inputs(inputs[k])
            rows.append(run.outputs()[places])
        if k + 1 == count:
            break
        inputs[k + 1, winds] = gust[k + 1] * axis
        # A change of the angle of attack alone is one across the velocity.
        across = -axis + (axis @ x[3:6]) / (x[3:6] @ x[3:6]) * x[3:6]
        x[3:6] += SPEED * WHITE["process.alpha"] * stirred[k, 0] * across
        x[11] += WHITE["process.q"] * stirred[k, 1]
        if kind == "process":
            run.state = x
        run.step(t[k], h, inputs[k], inputs[k + 1])
    y = dict(zip(names, np.array(rows).T))
    if kind == "inertial":
        y["alpha"] = y["theta"] - np.arctan2(-y["vd"], y["vn"])
    columns = {surface: ("time", inputs[::FINE, sim.inputs.index(surface)])}
    for name, sigma in noise.items():
        columns[name] = "time", y[name] + sigma * rng.standard_normal(len(y[name]))
    return xr.Dataset(columns, {"time": t[::FINE]}), start


def _body_axis(q: np.ndarray, number: int) -> np.ndarray:
    """Return the y (1) or z axis (2) of the body in Earth axes, from the quaternion."""
    a, b, c, d = q
    if number == 1:
        return np.array([2 * (b * c - a * d), a * a - b * b + c * c - d * d, 2 * (c * d + a * b)])
    return np.array([2 * (b * d + a * c), 2 * (c * d - a * b), a * a - b * b - c * c + d * d])


def terms_of(sim: SimModel, kind: str) -> tuple[str, ...]:
    """Return the estimated scales of an aircraft."""
    if kind in ACROSS:
        return LATERAL_TERMS
    return TERMS["trainer" if sim.title == "trainer" else "t37"]


def fit(
    sim: SimModel, data: list[xr.Dataset], start: dict[str, float], method: str, kind: str
) -> OutputError:
    """Return the fit of records of one kind by one method."""
    noise = LATERAL_NOISE if kind in ACROSS else NOISE
    states = ("beta", "phi", "p", "r") if kind in ACROSS else ("V", "alpha", "theta", "q")
    wanted = {name: Unknown(0.85) for name in terms_of(sim, kind)}
    for name in states:
        wanted[f"init.{name}"] = Unknown(start[f"init.{name}"], own=True)
    fixed = HELD | {name: value for name, value in start.items() if name not in wanted}
    fixed |= {"mode.step": STEP}
    if method == "output error":
        return flighttest.output_error(sim, data, wanted, list(noise), fixed, step=STEP)
    gusts = []
    if method == "white process noise":
        wanted |= {name: 0.5 * value for name, value in WHITE.items()}
    else:
        # Intensity and scale start a factor of two off.
        angle, name = ("beta", "v") if kind in ACROSS else ("alpha", "w")
        inertial = ("alpha",) if kind == "inertial" else ()
        gusts = [DrydenGust(angle, SPEED, 2.0 * SCALE, 0.5, (), inertial=inertial, name=name)]
        wanted |= {f"gust.{name}": 0.5, f"scale.{name}": 2.0 * SCALE}
        if method == "gusts and process.p":
            wanted["process.p"] = 0.02
    return simulated_filter_error(sim, data, wanted, list(noise), gusts, fixed, step=STEP)


def fits(sim: SimModel, kind: str, seed: int) -> dict[str, dict]:
    """Return errors, standard errors and remarks of the fits of one record by method."""
    if kind == "pair":
        made = [record(sim, "vane", 2 * seed), record(sim, "vane", 2 * seed + 1)]
    else:
        made = [record(sim, kind, seed)]
    data, start = [item for item, _ in made], made[0][1]
    found = {}
    for method in ("output error", METHODS[kind]):
        began = time.process_time()
        done = fit(sim, data, start, method=method, kind=kind)
        e = done.estimates.sel(parameter=list(terms_of(sim, kind)))
        all_of = zip(
            map(str, done.estimates["parameter"].values), done.estimates["estimate"].values
        )
        found[method] = {
            "error": (e["estimate"].values - 1.0).tolist(),
            "stderr": e["stderr"].values.tolist(),
            "remarks": [remark.kind for remark in done.remarks],
            "estimates": {name: float(value) for name, value in all_of},
            "iterations": int(done.estimates.attrs["iterations"]),
            "calm": str(done.estimates.attrs.get("calm", "")),
            "seconds": time.process_time() - began,
        }
    return found


def print_kind(kind: str, rows: list[dict]) -> None:
    """Print coverage, rms over that of output error, and remarks of one kind."""
    reference = np.sqrt(np.mean([np.square(row["output error"]["error"]) for row in rows], axis=0))
    for method in ("output error", METHODS[kind]):
        errors = np.array([row[method]["error"] for row in rows])
        z = errors / np.array([row[method]["stderr"] for row in rows])
        ratio = np.sqrt(np.mean(errors**2, axis=0)) / reference
        numbers = " ".join(f"{value:5.2f}" for value in ratio)
        by_term = " ".join(f"{value:4.0%}" for value in (np.abs(z) < 2.0).mean(axis=0))
        coloured = sum("coloured" in row[method]["remarks"] for row in rows)
        failed = sum("convergence" in row[method]["remarks"] for row in rows)
        calm = sum(bool(row[method]["calm"]) for row in rows)
        seconds = np.median([row[method]["seconds"] for row in rows])
        print(
            f"{kind:10s}{method:22s}{(np.abs(z) < 2.0).mean():6.1%} ({by_term}) {numbers}"
            f"{np.abs(z.mean(axis=0)).max():6.2f}{z.std(axis=0).max():6.2f}"
            f"{coloured:5d}{failed:4d}{calm:4d}{seconds:8.1f} s",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("records", nargs="?", type=int, default=20)
    parser.add_argument("kinds", nargs="*", default=KINDS)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--aircraft", choices=sorted(TERMS), default="t37")
    parser.add_argument("--database", type=Path, default=ROOT / "out/t37/datcom.nc")
    options = parser.parse_args()
    if options.aircraft == "trainer":
        sim = aeroplane()
    else:
        sim = compile_files(str(ROOT / "data/t37/aircraft.toml"), str(options.database))
    known: dict[tuple[str, int], dict] = {}
    if options.results and options.results.exists():
        for line in options.results.read_text().splitlines():
            row = json.loads(line)
            known[row["kind"], row["seed"]] = row
    print(
        f"{options.records} records of each kind: within two standard errors (each term), rms over "
        f"that of output error, largest mean and scatter of the errors in standard errors, records "
        f"remarked coloured, not converged, without a disturbance, median of the processor time"
    )
    for seed in range(options.records):
        for kind in options.kinds:
            if (kind, seed) in known:
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                row = {"kind": kind, "seed": seed, **fits(sim, kind, seed)}
            known[kind, seed] = row
            if options.results:
                with options.results.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    for kind in options.kinds:
        print_kind(kind, [known[kind, seed] for seed in range(options.records)])


if __name__ == "__main__":
    main()
