"""Thrust, power and drag of propeller aircraft, identified from programmes with a known truth.

    python benchmarks/propeller_identification.py [--programmes 20] [--kind piston turboprop]

The flights are those of `tests/flighttest/propeller_flights.py`: blade-element propellers
and engines of their own, instruments with noise and constant errors.  Printed are the shares of
estimates within two standard errors of the truth: CT and CP over the flown advance ratios (a
governed propeller: thrust at power and airspeed), power over manifold pressure or lever, CD0 and K.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from flightmech.air import atmosphere
from flighttest.reconstruction.dynamics.shaft_condition import blade_setting, table_at
from flighttest.submodels.engine.propellers.identification import identify_propeller
from flighttest.submodels.engine.propellers.result import PropellerFit
from flighttest.submodels.engine.static_thrust import Polar

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "flighttest"))
import propeller_flights as flights

POINTS = 5


def score(craft: flights.Craft, fit: PropellerFit) -> dict[str, np.ndarray]:
    """Return errors over standard errors by quantity."""
    scores = {
        "CD0": (fit.polar.CD0 - craft.CD0) / fit.polar.CD0_stderr,
        "K": (fit.polar.K - craft.K) / fit.polar.K_stderr,
    }
    thrust = _thrust_scores if craft.governed else _coefficient_scores
    scores |= thrust(craft, fit) | {"power": _power_scores(craft, fit)}
    return {name: np.atleast_1d(x) for name, x in scores.items()}


def _coefficient_scores(craft: flights.Craft, fit: PropellerFit) -> dict[str, np.ndarray]:
    """Return the scores of CT and CP over the flown advance ratios."""
    flown = fit.equations.shapes["CT_prop"]
    J = np.linspace(flown.low, flown.high, POINTS)
    truth = craft.blades.coefficients(J, craft.blades.design)
    scores = {}
    for name, true in zip(("CT_prop", "CP_prop"), truth, strict=True):
        value, stderr = fit.coefficient(name, J)
        scores[name] = (value - true) / stderr
    return scores


def _thrust_scores(craft: flights.Craft, fit: PropellerFit) -> dict[str, np.ndarray]:
    """Return the scores of CT at advance ratios and powers of the programme."""
    propeller = fit.equations.propeller
    n, D = craft.rpm_rated / (2.0 * np.pi), craft.blades.diameter
    rho = float(atmosphere(2000.0).rho)
    V, power = (x.ravel() for x in np.meshgrid([62.0, 80.0, 105.0], [0.5, 1.0]))
    J, CP = V / (n * D), power * craft.power_rated / (rho * n**3 * D**5)
    true = [flights.governed_thrust(craft, float(j), float(p)) for j, p in zip(J, CP, strict=True)]
    ones = np.ones_like(J)
    at = {"J": J, "rpm": craft.rpm_rated * ones, "turns": n * ones, "rho": rho * ones}
    scale = 1.0 + fit.value.get("CP_prop scale", 0.0)
    angle = blade_setting(propeller, at, power * craft.power_rated / scale).angle
    prior = table_at(propeller.tables["CT_prop"], at | {"blade_angle": angle})
    value, stderr = fit.with_error("CT_prop", prior, {"J": J, "blade_angle": angle})
    return {"CT_prop": (value - true) / stderr}


def _power_scores(craft: flights.Craft, fit: PropellerFit) -> np.ndarray:
    """Return the scores of the power of the engine."""
    if craft.governed:
        lever, mach = np.array([0.55, 1.0]), 0.25
        air = atmosphere(2000.0)
        true = craft.turbine_power(lever, mach, float(air.rho))
        leaf = fit.equations.propeller.tables["shaft_power"]
        prior = table_at(leaf, {"throttle": lever, "mach": mach + 0.0 * lever, "rpm": lever})
        x = [None, None]
    else:
        pressure, rpm = np.array([30e3, 55e3, 80e3]), np.array([180.0, 230.0, 265.0])
        true = craft.piston_power(pressure, rpm, 288.15, 101325.0)
        leaf = fit.equations.engine.piston.tables["corrected_power"]
        prior = table_at(leaf, {"manifold_pressure": pressure, "engine_rpm": rpm, "rpm": rpm})
        x = list(pressure)
    factors = np.array([fit.power_factor(place) for place in x])
    return (factors[:, 0] - true / prior) / factors[:, 1]


def main() -> None:
    """Print the shares within two standard errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--programmes", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--kind", nargs="+", default=["piston", "turboprop"])
    args = parser.parse_args()
    for kind in args.kind:
        collected: dict[str, list[np.ndarray]] = {}
        for seed in range(args.first, args.first + args.programmes):
            craft, records = flights.make_flights(seed, kind == "turboprop")
            prior = flights.prior_aircraft(craft, seed)
            fit = identify_propeller(records, prior, Polar(*flights.prior_polar(craft, seed)))
            scores = score(craft, fit)
            for name, values in scores.items():
                collected.setdefault(name, []).append(values)
            words = " ".join(f"{name} {np.round(x, 1)}" for name, x in scores.items())
            rho = fit.separability.correlation if fit.separability else np.nan
            ends = fit.estimate.convergence
            print(
                f"{kind} {seed}: {words} rho {rho:.3f} {ends.converged} {ends.iterations}",
                flush=True,
            )
        for name, parts in collected.items():
            z = np.concatenate(parts)
            inside, rms = np.mean(np.abs(z) < 2.0), np.sqrt(np.mean(z**2))
            print(f"{kind} {name}: {inside:.1%} of {len(z)} within two, rms {rms:.2f}", flush=True)


if __name__ == "__main__":
    main()
