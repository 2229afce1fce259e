"""Local models of CL over alpha and Mach number joined into tables: how large is the remaining
error?

    python benchmarks/local_model_join.py [--seeds 20]

Sets of 36 local models `CL = 1 + alpha`, whose true values are known, on tables of several spacings
and against handbooks that are wrong in several ways; each set twice, the second time with one model
that is wrong by six standard errors.  For each kind of set: rms error before and after, the share
of nodes within two standard errors, rms of error over standard error, and the median standard error
of the nodes in and next to the flown region; and how often the wrong model is listed, and a good
one.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd

import aerodb
from aerodb.store.schema import make_database
from flightmech import terms
from flightmech.units import DEGREE
from flighttest.regression.combining.published import published_fit
from flighttest.regression.equation_error.model import RegressionModel

ROOT = dict(title="prior", aircraft="x", S=20.0, cbar=2.0, b=12.0, x_ref=0.0, y_ref=0.0, z_ref=0.0)
PRIOR_STDERR = 0.05
STDERR = {"1": 0.004, "alpha": 0.002 / DEGREE}  # of a good model
WRONG = 6.0  # standard errors by which the value of a wrong model is off
MODELS = 36
HALF_RANGE = 1.2  # of the incidence of a local model [deg]

# Breakpoints of the tables: alpha [deg], Mach number.
GRIDS = {
    "even": (np.arange(-4.0, 15.0, 2.0), np.array([0.2, 0.35, 0.5, 0.65])),
    "wide Mach": (np.arange(-4.0, 15.0, 2.0), np.array([0.1, 0.2, 0.4, 0.6, 0.8])),
    "coarse": (np.arange(-8.0, 17.0, 4.0), np.array([0.2, 0.5, 0.8])),
    "fine": (np.arange(-4.0, 13.0, 1.0), np.arange(0.2, 0.66, 0.1)),
}


@dataclass(frozen=True)
class FlightConditions:
    """Conditions of the local models, alpha [deg] and Mach number."""

    alpha: np.ndarray
    mach: np.ndarray


def scattered_flights(random: np.random.Generator) -> FlightConditions:
    """Return conditions anywhere in the flown region."""
    return FlightConditions(random.uniform(-3, 8, MODELS), random.uniform(0.22, 0.6, MODELS))


def lattice_flights(random: np.random.Generator) -> FlightConditions:
    """Return six incidences at each of six Mach numbers, on breakpoints where there are any."""
    alpha, mach = np.meshgrid(np.arange(-2.0, 9.0, 2.0), [0.2, 0.275, 0.35, 0.425, 0.5, 0.575])
    return FlightConditions(alpha.ravel(), mach.ravel())


def flights_at_speeds(random: np.random.Generator) -> FlightConditions:
    """Return conditions at three Mach numbers, as trims of three altitudes have them."""
    mach = np.repeat([0.25, 0.38, 0.5], MODELS // 3) + random.uniform(-0.01, 0.01, MODELS)
    return FlightConditions(random.uniform(0, 6, MODELS), mach)


FLIGHTS = {
    "scattered": scattered_flights,
    "lattice": lattice_flights,
    "three speeds": flights_at_speeds,
}


def true_lift(alpha: np.ndarray, mach: np.ndarray) -> np.ndarray:
    """Return CL of the aeroplane."""
    stall = 0.0016 * np.maximum(alpha - 6, 0) ** 2
    return 0.25 + 0.085 * alpha / np.sqrt(1 - mach * mach) - stall


def smooth_error(alpha, mach, random):
    """Return an error of the handbook that is a wave over the table."""
    phase = random.uniform(0, 2 * np.pi)
    return 0.05 * np.sin(0.25 * alpha + 4 * mach + phase) + random.normal(0, 0.03)


def slope_error(alpha, mach, random):
    """Return an error of lift slope and zero lift."""
    return random.normal(0, 0.006) * alpha * (1 + mach) + random.normal(0, 0.04)


def stall_error(alpha, mach, random):
    """Return a constant error, and an error of the stall from an incidence in the region on."""
    begin, curve = random.uniform(5, 9), random.normal(0, 0.001)
    return random.normal(0, 0.04) + curve * np.maximum(alpha - begin, 0) ** 2 * (1 + 0 * mach)


def drawn_error(alpha, mach, random):
    """Return a draw of the a-priori correlation of the database."""
    leaf = terms.make_term(
        0 * alpha, {"alpha": alpha[:, 0] * DEGREE, "mach": mach[0]}, stderr=PRIOR_STDERR
    )
    P = aerodb.update.correlation.prior_covariance(leaf)
    root = np.linalg.cholesky(P + 1e-10 * np.diag(np.diag(P)))
    return (root @ random.standard_normal(len(P))).reshape(alpha.shape)


ERRORS = {
    "wave": smooth_error,
    "slope": slope_error,
    "stall": stall_error,
    "drawn": drawn_error,
}


def make_set(grid: str, flights: str, error: str, seed: int, is_wrong: bool):
    """Return prior, fits, truth by node and the name of the wrong model of one set."""
    random = np.random.default_rng([seed, *f"{grid} {flights} {error}".encode()])
    alpha, mach = np.meshgrid(*GRIDS[grid], indexing="ij")
    truth = true_lift(alpha, mach)
    leaf = terms.make_term(
        truth + ERRORS[error](alpha, mach, random),
        {"alpha": alpha[:, 0] * DEGREE, "mach": mach[0]},
        stderr=np.full(alpha.shape, PRIOR_STDERR),
        source="datcom",
    )
    prior = make_database({"CL/basic": leaf}, force_axes="stability", **ROOT)
    flown = FLIGHTS[flights](random)
    off, sign = random.integers(MODELS), random.choice([-1.0, 1.0])
    wrong = f"point {off}" if is_wrong else ""
    # The truth is the table: local models have the scatter of their standard errors alone.
    table = leaf.assign(value=leaf["value"].copy(data=truth))
    fits = []
    for k, (a, m) in enumerate(zip(flown.alpha, flown.mach)):
        ends = np.clip([a - HALF_RANGE, a + HALF_RANGE], *GRIDS[grid][0][[0, -1]])
        along = np.linspace(*ends, 33)
        at = {"alpha": along * DEGREE, "mach": np.full(33, m)}
        design = np.stack([np.ones(33), (along - a) * DEGREE], axis=1)
        value = np.linalg.lstsq(design, terms.evaluate_term(table, at, "clamp"), rcond=None)[0]
        value = value + [s * random.standard_normal() for s in STDERR.values()]
        name = f"point {k}"
        if name == wrong:
            value[0] += WRONG * STDERR["1"] * sign
        model = local_model(a)
        fits.append(
            published_fit(
                model,
                dict(zip(STDERR, value)),
                STDERR,
                {"alpha": tuple(ends * DEGREE), "mach": m},
                name=name,
            )
        )
    return prior, fits, truth, wrong


def local_model(alpha: float) -> RegressionModel:
    """Return the local model about an incidence [deg]."""
    return RegressionModel("CL", ("1", "alpha"), reference={"alpha": alpha * DEGREE})


def examine_set(grid: str, flights: str, error: str, seed: int, is_wrong: bool) -> dict:
    """Return the figures of one set."""
    prior, fits, truth, wrong = make_set(grid, flights, error, seed, is_wrong)
    found = aerodb.tabulate(fits, prior)
    leaf = found["CL/basic"]
    value, stderr = leaf["value"].values, leaf["stderr"].values
    z = (value - truth) / stderr
    distance = leaf["flown_distance"].values  # in correlation lengths
    inside, near, far = distance == 0, (distance > 0) & (distance <= 1), distance > 1
    suspects = found.points.index[found.points["suspect"]].get_level_values("fit")
    return {
        "grid": grid,
        "flights": flights,
        "error": error,
        "wrong": is_wrong,
        "rms before": np.mean((prior["CL/basic"]["value"].values - truth) ** 2),
        "rms after": np.mean((value - truth) ** 2),
        "rms flown": np.mean((value - truth)[inside] ** 2),
        "rms near": np.mean((value - truth)[near] ** 2) if near.any() else np.nan,
        "within 2": np.mean(abs(z) < 2),
        "flown": np.mean(abs(z[inside]) < 2),
        "near": share_within_two(z[near]),
        "far": share_within_two(z[far]),
        "rms z": np.mean(z**2),
        "se flown": np.median(stderr[inside]),
        "se near": np.median(stderr[near]) if near.any() else np.nan,
        "listed": float(wrong in suspects) if wrong else np.nan,
        "false": float(len(set(suspects) - {wrong})),
    }


def share_within_two(z: np.ndarray) -> float:
    """Return the share of errors within two standard errors, NaN without nodes."""
    return float(np.mean(abs(z) < 2)) if z.size else np.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--grids", default=",".join(GRIDS))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for grid in given.grids.split(","):
        for flights in FLIGHTS:
            for error in ERRORS:
                for seed in range(given.seeds):
                    rows.append(examine_set(grid, flights, error, seed, is_wrong=False))
                    rows.append(examine_set(grid, flights, error, seed, is_wrong=True))
    table = pd.DataFrame(rows)
    with pd.option_context("display.width", 220, "display.max_columns", None):
        for by in (["error", "wrong"], ["grid", "flights"], ["error", "flights"]):
            print(summarise(table, by).round(4), end="\n\n")
        print(summarise(table.assign(all="all"), ["all"]).round(4))


def summarise(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Return means by group; squares become rms."""
    means = table.groupby(by).mean(numeric_only=True)
    for name in means:
        if name.startswith("rms"):
            means[name] = np.sqrt(means[name])
    return means


if __name__ == "__main__":
    main()
