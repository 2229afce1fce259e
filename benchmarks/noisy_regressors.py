"""Bias and coverage of equation error, instrumental variables and total least squares on flights
whose angle of attack, sideslip and rates carry noise; truth known, 200 seeds each.

A flight of 30 s, simulated by the compiled kernel with a linear model in all six coefficients, as
of `regression_coverage.py`. Accelerations carry a coloured disturbance. The noise of the regressors
is white, or an AR(1) of 0.1 s; it enters the coefficients too, through the axes.

python benchmarks/noisy_regressors.py [--seeds 200] [--coefficients CL Cm Cn] [--noise 0.1 0.5]
"""

from __future__ import annotations

import argparse

import numpy as np
import xarray as xr
from regression_coverage import TERMS, flown, red

import flightmech
import flighttest

RATE = 0.5  # noise of a rate over that of an angle [1/s]
METHODS = ("least squares", "iv", "tls")


def noisy_flight(
    seed: int, clean: xr.Dataset, angle: float, is_red: bool = False, disturbance: float = 0.05
) -> xr.Dataset:
    """Return a flight with noise of `angle` [rad] on angles, half of it per second on rates."""
    rng = np.random.default_rng(seed)
    count = clean.sizes["time"]
    noisy = clean.copy()
    for name in ("ax", "ay", "az", "p_dot", "q_dot", "r_dot"):
        noisy[name] = clean[name] + disturbance * float(clean[name].std()) * red(rng, count, 0.3)
    for name in ("alpha", "beta", "p", "q", "r"):
        noise = red(rng, count, 0.1) if is_red else rng.normal(size=count)
        size = angle if name in ("alpha", "beta") else RATE * angle
        noisy[name] = clean[name] + size * noise
    return noisy


def estimate(
    method: str, coefficient: str, data: xr.Dataset, angle: float, aircraft: flightmech.Aircraft
) -> xr.Dataset:
    """Return the estimates of one method."""
    model = flighttest.RegressionModel(coefficient, list(TERMS[coefficient]))
    if method == "least squares":
        return flighttest.regress(model, data).estimates
    if method == "iv":
        return flighttest.errors_in_variables.regress_instrumental(model, data).estimates
    # Reduced rates are rates times a length over two airspeeds.
    speed = 2.0 * float(data["V"].mean())
    lengths = {"phat": aircraft.b, "qhat": aircraft.cbar, "rhat": aircraft.b}
    noise = {}
    for name in model.variables:
        if name in ("alpha", "beta"):
            noise[name] = angle
        elif name in lengths:
            noise[name] = RATE * angle * lengths[name] / speed
    return flighttest.errors_in_variables.regress_total(model, data, noise).estimates


def study(
    coefficient: str, degrees: float, seeds: int, is_red: bool, flight: tuple
) -> dict[str, dict[str, np.ndarray]]:
    """Return bias, its standard error, scatter, and coverage of every method, (terms,)."""
    aircraft, clean = flight
    truth = np.array(list(TERMS[coefficient].values()))
    errors = {method: [] for method in METHODS}
    ratios = {method: [] for method in METHODS}
    for seed in range(seeds):
        noisy = noisy_flight(seed, clean, np.radians(degrees), is_red)
        data = flighttest.coefficients(noisy, aircraft)
        for method in METHODS:
            found = estimate(method, coefficient, data, np.radians(degrees), aircraft)
            error = found["estimate"].values - truth
            errors[method].append(error)
            ratios[method].append(error / found["stderr"].values)
    results = {}
    for method in METHODS:
        e, z = np.array(errors[method]), np.abs(ratios[method])
        results[method] = {
            "bias": e.mean(axis=0) / np.abs(truth),
            "bias_stderr": e.std(axis=0) / np.sqrt(len(e)) / np.abs(truth),
            "scatter": e.std(axis=0) / np.abs(truth),
            "coverage": (z < 2.0).mean(axis=0),
        }
    return results


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--coefficients", nargs="+", default=["CL", "Cm", "Cn"])
    parser.add_argument("--noise", nargs="+", type=float, default=[0.1, 0.5])
    parser.add_argument("--red", action="store_true", help="noise of the regressors is AR(1)")
    given = parser.parse_args()
    flight = flown()
    for coefficient in given.coefficients:
        for degrees in given.noise:
            found = study(coefficient, degrees, given.seeds, given.red, flight)
            print(f"{coefficient}, {degrees:g} deg: {' '.join(TERMS[coefficient])}")
            for method, figures in found.items():
                bias = " ".join(f"{100 * x:6.1f}" for x in figures["bias"])
                chance = " ".join(f"{100 * x:4.1f}" for x in figures["bias_stderr"])
                cover = " ".join(f"{100 * x:3.0f}" for x in figures["coverage"])
                total = 100 * figures["coverage"].mean()
                print(
                    f"  {method:14s} bias [%] {bias} (chance {chance})  covered {total:5.1f} % "
                    f"({cover})",
                    flush=True,
                )


if __name__ == "__main__":
    main()
