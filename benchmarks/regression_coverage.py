"""Coverage and bias of the regression on simulated records with known truth, 200 seeds each, in
time and in frequency.

Two kinds of records: a lift that follows four terms, with disturbances of several colours (AR(1) of
0.3 and 1 s, AR(1) with white noise, low-passed noise, a lightly damped oscillation at 0.5 Hz); and
a flight of 30 s simulated by the compiled kernel with a linear model in all six coefficients, whose
accelerations carry coloured disturbances.  Runs go through joblib: all cores, or the workers of a
dask.distributed cluster.

python benchmarks/regression_coverage.py [--seeds 200] [--jobs 2] [--demanded]
"""

from __future__ import annotations

import argparse
import functools

import numpy as np
import xarray as xr
from scipy.signal import butter, lfilter, sosfiltfilt

import flightmech
import flighttest
from flightmech.terms import make_term

STEP = 0.02
LIFT = {"1": 0.3, "alpha": 5.0, "qhat": 8.0, "delta_e": 0.5}
MODEL = flighttest.RegressionModel("CL", list(LIFT))
BAND = (0.1, 1.0)


def red(rng: np.random.Generator, n: int, tau: float) -> np.ndarray:
    c = np.exp(-STEP / tau)
    return lfilter([np.sqrt(1 - c * c)], [1, -c], rng.normal(size=n + 500))[500:]


def low(rng: np.random.Generator, n: int, edge: float) -> np.ndarray:
    x = sosfiltfilt(butter(4, edge, fs=1 / STEP, output="sos"), rng.normal(size=n + 400))[200:-200]
    return x / np.sqrt(1.9 * edge * STEP)


def oscillating(rng: np.random.Generator, n: int) -> np.ndarray:
    pole = np.exp(2 * np.pi * 0.5 * STEP * (-0.2 + 1j * np.sqrt(0.96)))
    x = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.normal(size=n + 1000))[1000:]
    return x / 45.0


COLOURS = {
    "AR(1), 0.3 s": lambda rng, n: red(rng, n, 0.3),
    "AR(1), 1 s": lambda rng, n: red(rng, n, 1.0),
    "AR(1), 0.3 s, and white": lambda rng, n: 0.7 * red(rng, n, 0.3) + 0.7 * rng.normal(size=n),
    "low-passed at 3 Hz": lambda rng, n: low(rng, n, 3.0),
    "oscillating at 0.5 Hz": oscillating,
    "white": lambda rng, n: rng.normal(size=n),
}


def lift(
    rng: np.random.Generator, duration: float, colour: str, offset: float = 0.0, noise: float = 0.01
) -> xr.Dataset:
    """Three multisines up to 0.8 Hz, the elevator followed by alpha."""
    t = np.arange(0, duration, STEP)
    k = np.arange(2, 24)

    def multisine() -> np.ndarray:
        return np.cos(2 * np.pi * np.outer(t, k) / 30 + rng.uniform(0, 2 * np.pi, len(k))).sum(
            axis=1
        ) / np.sqrt(len(k))

    elevator = 0.03 * multisine()
    x = {
        "alpha": 0.02 * multisine() + 0.3 * lfilter([0.05], [1, -0.95], elevator),
        "qhat": 0.001 * multisine(),
        "delta_e": elevator,
    }
    CL = (
        LIFT["1"]
        + sum(LIFT[name] * values for name, values in x.items())
        + offset
        + noise * COLOURS[colour](rng, len(t))
    )
    return xr.Dataset(
        {name: ("time", values) for name, values in {**x, "CL": CL}.items()}, coords={"time": t}
    )


def spoilt(rng: np.random.Generator, data: xr.Dataset) -> xr.Dataset:
    """Two gaps of 0.4 to 2 s in the coefficient, and noise of 0.5 % of its rms on every regressor,
    which is CL noise of 0.001.
    """
    data = data.copy(deep=True)
    for first in rng.integers(100, data.sizes["time"] - 200, 2):
        data["CL"][first : first + rng.integers(20, 100)] = np.nan
    for name in ("alpha", "qhat", "delta_e"):
        data[name] = data[name] + 0.005 * float(data[name].std()) * rng.normal(
            size=data.sizes["time"]
        )
    return data


def identify_lift(
    seed: int,
    durations: tuple[float, ...],
    colour: str,
    spread: float,
    frequency: bool,
    spoil: bool = False,
):
    rng = np.random.default_rng(seed)
    parts = [lift(rng, duration, colour, spread * rng.normal()) for duration in durations]
    parts = [spoilt(rng, part) for part in parts] if spoil else parts
    return (
        flighttest.equation_error.regress_frequency(MODEL, parts, BAND)
        if frequency
        else flighttest.regress(MODEL, parts)
    )


TERMS = {
    "CL": {"1": 0.25, "alpha": 5.2, "qhat": 7.0, "delta_e": 0.45},
    "CY": {"beta": -0.6, "rhat": 0.4, "delta_r": 0.18},
    "Cl": {"beta": -0.08, "phat": -0.45, "rhat": 0.12, "delta_a": -0.16},
    "Cm": {"1": 0.03, "alpha": -0.7, "qhat": -16.0, "delta_e": -1.2},
    "Cn": {"beta": 0.09, "phat": -0.03, "rhat": -0.14, "delta_r": -0.075},
}


def flown() -> tuple[flightmech.Aircraft, xr.Dataset]:
    """A light jet at 100 m/s under multisines on all three surfaces, simulated by the kernel."""
    aircraft = flightmech.Aircraft(
        "jet", 17.0, 1.67, 10.3, 2500.0, 10000.0, 8100.0, 15000.0, Ixz=500.0
    )
    leaves = {"/CD/zero": make_term(0.03), "/CD/alpha": make_term(0.25, regressors=["alpha"])}
    for coefficient, terms in TERMS.items():
        for k, (term, value) in enumerate(terms.items()):
            leaves[f"/{coefficient}/t{k}"] = make_term(
                value, regressors=[] if term == "1" else [term]
            )
    sim = flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))
    t = np.arange(0, 30.0, STEP)
    rng = np.random.default_rng(1)
    inputs = {}
    for k, (name, size) in enumerate({"delta_e": 0.02, "delta_a": 0.02, "delta_r": 0.03}.items()):
        lines = np.arange(3 + k, 54, 3)
        waves = np.cos(2 * np.pi * np.outer(t, lines) / 30 + rng.uniform(0, 2 * np.pi, len(lines)))
        inputs[name] = "time", size * waves.sum(axis=1) / np.sqrt(len(lines))
    start = {"init.V": 100.0, "init.h": 3000.0, "mode.trim": 1}
    history = flightmech.simulate(sim, xr.Dataset(inputs, coords={"time": t}), parameters=start)
    states = history[
        [
            "V",
            "alpha",
            "beta",
            "p",
            "q",
            "r",
            "p_dot",
            "q_dot",
            "r_dot",
            "ax",
            "ay",
            "az",
            "qbar",
            "phi",
            "theta",
        ]
    ]
    return aircraft, states.assign({name: history[f"applied.{name}"] for name in inputs})


def identify_flight(
    seed: int, flight: tuple[flightmech.Aircraft, xr.Dataset], coefficient: str, frequency: bool
):
    aircraft, clean = flight
    rng = np.random.default_rng(seed)
    noisy = clean.copy()
    for name in ("ax", "ay", "az", "p_dot", "q_dot", "r_dot"):
        noisy[name] = clean[name] + 0.05 * float(clean[name].std()) * red(
            rng, clean.sizes["time"], 0.3
        )
    model = flighttest.RegressionModel(coefficient, list(TERMS[coefficient]))
    data = flighttest.coefficients(noisy, aircraft)
    return (
        flighttest.equation_error.regress_frequency(model, data, (0.09, 1.8))
        if frequency
        else flighttest.regress(model, data)
    )


def show(name: str, study: flighttest.equation_error.MonteCarlo) -> None:
    e = study.estimates
    white = float(e["coverage_white"].mean())
    worst = float(np.abs(e["bias"] / e["bias_stderr"]).max())
    each = " ".join(f"{100 * float(share):.0f}" for share in e["coverage"])
    print(
        f"{name:52s} {100 * study.coverage:5.1f} %  ({each})  white {100 * white:3.0f} %  "
        f"largest bias {worst:.1f} se",
        flush=True,
    )


DEMANDED = {
    "one of 10 s": ((10.0,), "AR(1), 0.3 s", 0.0, False),
    "one of 25 s": ((25.0,), "AR(1), 0.3 s", 0.0, False),
    "five of 12 s with offsets": ((12.0,) * 5, "AR(1), 0.3 s", 0.02, False),
    "25 s with gaps and noise of the regressors": ((25.0,), "AR(1), 0.3 s", 0.0, True),
    "25 s, white": ((25.0,), "white", 0.0, False),
    "25 s, AR(1) of 1 s": ((25.0,), "AR(1), 1 s", 0.0, False),
    "25 s, oscillating at 0.5 Hz": ((25.0,), "oscillating at 0.5 Hz", 0.0, False),
    "25 s, low-passed at 3 Hz": ((25.0,), "low-passed at 3 Hz", 0.0, False),
}
"""Records on which two standard errors must cover 92 to 98 %; all terms of a model together."""


def demanded(case: str, seeds: int, jobs: int) -> flighttest.equation_error.MonteCarlo:
    """Return the study of one case of `DEMANDED`."""
    durations, colour, spread, spoil = DEMANDED[case]
    work = functools.partial(
        identify_lift,
        durations=durations,
        colour=colour,
        spread=spread,
        frequency=False,
        spoil=spoil,
    )
    return flighttest.equation_error.monte_carlo(work, LIFT, range(seeds), jobs)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument(
        "--demanded", action="store_true", help="only the records with a demanded coverage"
    )
    given = parser.parse_args()
    if given.demanded:
        for case in DEMANDED:
            show(case, demanded(case, given.seeds, given.jobs))
        return
    seeds, flight = range(given.seeds), flown()
    records = [((30.0,), colour, 0.0) for colour in COLOURS]
    records += [
        ((10.0,), "AR(1), 0.3 s", 0.0),
        ((10.0,) * 5, "AR(1), 0.3 s", 0.0),
        ((8.0,) * 3, "AR(1), 1 s", 0.0),
        ((10.0,) * 6, "AR(1), 0.3 s", 0.02),
    ]
    for frequency in (False, True):
        for durations, colour, spread in records:
            if frequency and min(durations) < 1 / BAND[0]:
                continue
            work = functools.partial(
                identify_lift,
                durations=durations,
                colour=colour,
                spread=spread,
                frequency=frequency,
            )
            what = f"{len(durations)} x {durations[0]:g} s, {colour}{', offsets' if spread else ''}"
            show(
                f"{'frequency' if frequency else 'time'}: {what}",
                flighttest.equation_error.monte_carlo(work, LIFT, seeds, given.jobs),
            )
        for coefficient, truth in TERMS.items():
            work = functools.partial(
                identify_flight, flight=flight, coefficient=coefficient, frequency=frequency
            )
            show(
                f"{'frequency' if frequency else 'time'}: kernel, {coefficient}",
                flighttest.equation_error.monte_carlo(work, truth, seeds, given.jobs),
            )


if __name__ == "__main__":
    main()
