"""Long record of a business jet in turbulence, whose truth is known: which disturbance leaves white
innovations, and how far the estimates are off.

    python benchmarks/turbulent_flight.py [RECORDS]     2 unless given; the seed is their number

A jet of the size of the HFB 320 (7.5 t, 30 m2; derivatives of our own choice) glides at
105 m/s and 5000 m for 40 s at 10 Hz, with a 3-2-1-1 of the elevator and a pulse. Airspeed and angle
of attack of a boom, pitch rate, pitch attitude and both specific forces of the plane of symmetry
are measured. The air has gusts along and across the path, of Dryden form (MIL-F-8785C): 1.5 m/s
each, scales of 533 m, along and across the body as a wind in steps of 10 ms. The filter has no
gusts along the path: white noise in the rate of V stands for them.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads of BLAS only wait

import numpy as np
import xarray as xr
from scipy.signal import bilinear, lfilter

import flightmech
import flighttest
from flightmech.simulation import SimModel
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.terms import make_term
from flighttest.maximum_likelihood import (
    DrydenGust,
    OutputError,
    Unknown,
    simulated_filter_error,
)

STEP, FINE, DURATION = 0.1, 10, 40.0
SPEED, SCALE, SIGMA = 105.0, 533.0, 1.5  # [m/s], [m], [m/s]
NOISE = {"V": 0.3, "alpha": 2e-3, "q": 1e-3, "theta": 1e-3, "ax": 0.05, "az": 0.1}
TERMS = ("term.CL.basic", "term.CD.basic", "term.Cm.basic", "term.Cm.qhat", "term.Cm.delta_e")
TRIM, GLIDE = 0.128, 0.06  # angle of attack and of the descent [rad]
HELD = {"mode.earth": 0.0, "init.h": 5000.0}
START = {"init.V": SPEED, "init.alpha": TRIM, "init.theta": TRIM - GLIDE, "init.q": 0.0}
BURN = 4000  # steps of the gusts before the record
METHODS = ("output error", "process.alpha, q", "gusts", "gusts, process.V")


def business_jet() -> SimModel:
    """Return the aeroplane, in trim at `TRIM` without elevator."""
    alpha = np.linspace(-0.2, 0.4, 13)
    CL = 0.05 + 4.3 * alpha
    leaves = {
        "/CL/basic": make_term(CL, {"alpha": alpha}),
        "/CD/basic": make_term(0.02 + 0.045 * CL**2, {"alpha": alpha}),
        "/CY/beta": make_term(-0.7, regressors=["beta"]),
        "/Cl/beta": make_term(-0.1, regressors=["beta"]),
        "/Cl/phat": make_term(-0.5, regressors=["phat"]),
        "/Cm/basic": make_term(0.97 * (TRIM - alpha), {"alpha": alpha}),
        "/Cm/qhat": make_term(-20.0, regressors=["qhat"]),
        "/Cm/delta_e": make_term(-1.5, regressors=["delta_e"]),
        "/Cn/beta": make_term(0.1, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.15, regressors=["rhat"]),
    }
    craft = flightmech.Aircraft("business jet", 30.1, 2.43, 14.5, 7470.0, 2.5e4, 1.1e5, 1.3e5)
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def gusts(rng: np.random.Generator, count: int, h: float) -> np.ndarray:
    """Return gusts along and across the path (2, count). [m/s]"""
    T = SCALE / SPEED
    white = rng.standard_normal((2, count + BURN)) / np.sqrt(h)
    # MIL-F-8785C 3.7.1.2: one lag along the path, two with a lead across it
    along = bilinear([np.sqrt(2.0 * T)], [T, 1.0], 1.0 / h)
    across = bilinear([np.sqrt(3.0 * T) * T, np.sqrt(T)], [T * T, 2.0 * T, 1.0], 1.0 / h)
    return SIGMA * np.array([lfilter(*along, white[0]), lfilter(*across, white[1])])[:, BURN:]


def record(sim: SimModel, seed: int) -> xr.Dataset:
    """Return one record; an elevator linear between samples, as the simulation of a fit has it."""
    rng, h = np.random.default_rng(seed), STEP / FINE
    count = round(DURATION / h) + 1
    t = np.arange(count) * h
    edges = [2, 2.2, 5, 5.2, 7, 7.2, 8, 8.2, 9, 9.2, 20, 20.2, 22, 22.2]
    levels = [0, 1, 1, -1, -1, 1, 1, -1, -1, 0, 0, 1, 1, 0]
    elevator = np.interp(t, t[::FINE], 0.02 * np.interp(t[::FINE], edges, levels))
    along, across = gusts(rng, count, h)
    u = np.tile(constant_inputs(sim, {}), (count, 1))
    place = sim.inputs.index("delta_e")
    u[:, place] = elevator
    winds = [sim.inputs.index(name) for name in ("wind_n", "wind_e", "wind_d")]
    # A gust adds to the velocity relative to the air: it blows against its axis.
    run = initialise_run(sim, HELD | START | {"mode.step": h}, u[0])
    theta = sim.outputs.index("theta")
    places = [sim.outputs.index(name) for name in NOISE]
    rows = []
    for k in range(count):
        run.set_inputs(u[k])
        pitch = run.outputs()[theta]
        turn = np.array([[np.cos(pitch), np.sin(pitch)], [-np.sin(pitch), np.cos(pitch)]])
        for row in (k, k + 1)[: count - k]:
            north, down = -turn @ [along[row], across[row]]
            u[row, winds] = north, 0.0, down
        if k % FINE == 0:
            run.set_inputs(u[k])
            rows.append(run.outputs()[places])
        if k + 1 < count:
            run.step(t[k], h, u[k], u[k + 1])
    columns = {"delta_e": ("time", u[::FINE, place])}
    for name, y in zip(NOISE, np.array(rows).T):
        columns[name] = "time", y + NOISE[name] * rng.standard_normal(len(y))
    return xr.Dataset(columns, {"time": t[::FINE]})


def fit(sim: SimModel, data: xr.Dataset, method: str) -> OutputError:
    """Return the fit of one record by one method."""
    wanted: dict[str, Unknown | float] = {name: Unknown(0.9) for name in TERMS}
    wanted |= {name: Unknown(value) for name, value in START.items()}
    if method == "output error":
        return flighttest.output_error(sim, data, wanted, list(NOISE), HELD, step=STEP)
    gust = []
    if method.startswith("gusts"):
        gust = [DrydenGust("alpha", SPEED, 300.0, 1.0, air_relative=())]
        wanted |= {"gust.w": 1.0, "scale.w": 300.0}
    else:
        wanted |= {"process.alpha": 0.005, "process.q": 0.005}
    if method.endswith("process.V"):
        wanted["process.V"] = 0.5
    return simulated_filter_error(sim, data, wanted, list(NOISE), gust, HELD, step=STEP)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("records", nargs="?", type=int, default=2)
    sim = business_jet()
    print(
        "seed, method; errors over the truth (standard error); largest autocorrelation of the "
        "innovations of each output and those named as coloured; processor time"
    )
    for seed in range(parser.parse_args().records):
        data = record(sim, seed)
        for method in METHODS:
            began = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                done = fit(sim, data, method)
            e = done.estimates.sel(parameter=list(TERMS))
            errors = []
            for value, stderr in zip(e["estimate"].values, e["stderr"].values):
                errors.append(f"{100.0 * (value - 1.0):6.2f} ({100.0 * stderr:.2f})")
            coloured = [remark.term for remark in done.remarks if remark.kind == "coloured"]
            largest = ""
            if "correlation" in done.noise:
                r = np.abs(done.noise["correlation"].values).max(axis=1)
                largest = " ".join(f"{value:.2f}" for value in r)
            print(
                f"{seed} {method:18s}{' '.join(errors)} %; {largest} [{' '.join(coloured)}] "
                f"{'' if done.estimates.attrs['converged'] else 'NOT converged '}"
                f"{time.process_time() - began:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
