"""The glide and spin models of a small aeroplane, flown, recorded and identified again.

    python benchmarks/spin_study.py                       # 8 glides, 18 spins: Tables 2 to 5
    python benchmarks/spin_study.py --runs 200            # bias and coverage over campaigns

Source of models, conditions and table layouts: Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic
Modeling for a Fixed-Wing Aircraft Using Flight Data; transcribed in ``data/cz150``.  Documentation:
``docs/evidence/submodels.md``.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from spin_campaign import (
    EDGE,
    Recovery,
    fit_run,
    fly_and_record,
    joined,
    measured_variables,
    predictions,
)
from spin_recording import draw_errors

import flightmech
from flighttest.flight_programme.input_design.multisines import InputAxis, multisine
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.uncertainty.prediction_errors import validation_report, validation_table
from flighttest.special_tests.spin.polynomial_models import (
    Polynomial,
    polynomial_database,
    read_polynomials,
)
from flighttest.special_tests.spin.rotation_rates import nominal_variables

DATA = Path(__file__).parents[1] / "data" / "cz150"
DEG, FOOT = np.pi / 180.0, 0.3048
NOMINAL = {  # eq. (23)
    "V": 66.9 * FOOT, "alpha": 12.4 * DEG, "beta": 5.74 * DEG, "p": -385.0 * DEG, "q": 36.2 * DEG,
    "r": -97.2 * DEG,
    "delta_e": -18.5 * DEG, "delta_a": 15.5 * DEG, "delta_r": 24.6 * DEG,
}  # fmt: skip
SURFACES = ("delta_a", "delta_e", "delta_r")
FIRST, SECOND = (
    {},
    {0.2: 4.0, 2.0: 1.0},
)  # spectra of the identification and of the validation input
GLIDE_RUNS, SPIN_RUNS = 8, 18  # section III.B
# mass and inertia are exact here; the reconstruction states its own errors
KNOWN = {"mass": 0.0, "inertia": 0.0}


@dataclass(frozen=True)
class Condition:
    """A flight condition with the model that flies in it and the one to be identified."""

    name: str
    steep: bool
    sim: flightmech.SimModel
    published: dict[str, Polynomial]
    flown: dict[str, Polynomial]
    surfaces: dict[str, float]
    start: dict[str, float]
    inputs: tuple[xr.Dataset, xr.Dataset]  # identification, validation

    @property
    def models(self) -> dict[str, RegressionModel]:
        return {coefficient: polynomial.model for coefficient, polynomial in self.published.items()}


def glide(aircraft: flightmech.Aircraft) -> Condition:
    """Wings level at 50 ft/s, power off; 1 s of trimmed flight, 30 s of multisine."""
    published = without(
        read_polynomials(DATA / "glide.csv"), "Cm", "qhat**3"
    )  # its contribution is below 1e-5
    sim = compiled(aircraft, published, "glide")
    steady = flightmech.trim(
        sim,
        {"init.V": 50.0 * FOOT, "init.h": 365.0, "mode.earth": 0.0},
        kind="climb",
        unknowns=["alpha", "gamma", "phi", *SURFACES],
        fixed={"beta": 0.0},
    )
    surfaces = {name: float(steady[f"applied.{name}"]) for name in SURFACES}
    start = {
        name: value
        for name, value in flightmech.start_of(steady).items()
        if name.startswith("init.")
    }
    return Condition(
        "glide",
        False,
        sim,
        published,
        published,
        surfaces,
        start,
        two_inputs(aircraft, 5.0, 30.0, 1.0),
    )


def spin(aircraft: flightmech.Aircraft) -> Condition:
    """From the state of eq. (23), four rotations without excitation, then 10 s of multisine."""
    nominal = nominal_variables(NOMINAL, aircraft)
    published = read_polynomials(DATA / "spin.csv", nominal)
    flown = read_polynomials(DATA / "spin.csv", nominal, "flown")
    start = {f"init.{name}": NOMINAL[name] for name in ("V", "alpha", "beta", "p", "q", "r")}
    start |= {"init.phi": -24.0 * DEG, "init.theta": -74.0 * DEG, "init.h": 600.0}
    surfaces = {name: NOMINAL[name] for name in SURFACES}
    sim = compiled(aircraft, flown, "spin")
    return Condition(
        "spin", True, sim, published, flown, surfaces, start, two_inputs(aircraft, 4.0, 10.0, 4.0)
    )


def two_inputs(
    aircraft: flightmech.Aircraft, degrees: float, period: float, quiet: float
) -> tuple[xr.Dataset, xr.Dataset]:
    """Two multisines on three axes, of different spectrum and phases."""

    def one(spectrum: dict[float, float], seed: int) -> xr.Dataset:
        return multisine(
            {name: InputAxis(degrees * DEG, (0.2, 2.0), spectrum=spectrum) for name in SURFACES},
            period,
            lead_in=quiet,
            seed=seed,
        )

    return one(FIRST, 0), one(SECOND, 7)


def without(
    polynomials: dict[str, Polynomial], coefficient: str, term: str
) -> dict[str, Polynomial]:
    model, estimates, sigma = polynomials[coefficient]
    kept = [k for k, name in enumerate(model.terms) if name != term]
    shorter = Polynomial(
        RegressionModel(coefficient, [model.terms[k] for k in kept], model.reference),
        estimates[kept],
        sigma[kept],
    )
    return {**polynomials, coefficient: shorter}


def compiled(
    aircraft: flightmech.Aircraft, polynomials: dict[str, Polynomial], title: str
) -> flightmech.SimModel:
    return flightmech.compile(
        aircraft,
        polynomial_database(
            {c: (p.model, p.estimates) for c, p in polynomials.items()}, aircraft, title=title
        ),
    )


def run_data(
    condition: Condition,
    aircraft: flightmech.Aircraft,
    errors: dict[str, float],
    seed: list[int],
    which: int = 0,
) -> xr.Dataset:
    """Fly one run, record it, and return what a regression needs of it."""
    rng, signal = np.random.default_rng(seed), condition.inputs[which]
    # no two runs start alike: a few degrees and degrees per second
    start = {**condition.start, "init.psi": rng.uniform(-np.pi, np.pi)}
    for name, sigma in (
        ("alpha", 1.0),
        ("beta", 1.0),
        ("phi", 2.0),
        ("p", 5.0),
        ("q", 2.0),
        ("r", 2.0),
    ):
        start[f"init.{name}"] = start.get(f"init.{name}", 0.0) + rng.normal(0.0, sigma * DEG)
    record = fly_and_record(condition.sim, aircraft, signal, condition.surfaces, start, errors, rng)
    window = (
        signal.attrs["active_start"],
        signal.attrs["active_stop"] - EDGE * (signal.attrs["lead_in"] < EDGE),
    )
    return measured_variables(record, aircraft, window, condition.steep, errors=KNOWN)


def campaign(
    condition: Condition, aircraft: flightmech.Aircraft, runs: int, seed: int, jobs: int
) -> tuple[Recovery, xr.Dataset]:
    """Fly a whole campaign with one set of instruments; return what was found, and the errors of
    all runs.
    """
    from joblib import Parallel, delayed

    errors = draw_errors(aircraft, np.random.default_rng([seed, 0]))

    def one(number: int):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return fit_run(run_data(condition, aircraft, errors, [seed, number]), condition.models)

    fits = Parallel(n_jobs=jobs, prefer="threads")(
        delayed(one)(number) for number in range(1, runs + 1)
    )
    return joined(fits, condition.published, condition.flown), errors_of(condition, fits)


def errors_of(condition: Condition, fits: list) -> xr.Dataset:
    """Return the error of every estimate of single runs over its standard error, (run, term):
    random alone, and with the systematic one.
    """
    random, total, terms = [], [], []
    for coefficient, polynomial in condition.flown.items():
        for term, truth in zip(polynomial.model.terms, polynomial.estimates, strict=True):
            e = [one[coefficient].estimates.sel(term=term) for one in fits]
            error = np.array([float(x["estimate"]) - truth for x in e])
            own, common = (
                np.array([float(x[name]) for x in e]) for name in ("stderr", "stderr_systematic")
            )
            random.append(error / own)
            total.append(error / np.hypot(own, common))
            terms.append(f"{coefficient}/{term}")
    return xr.Dataset(
        {"random": (("term", "run"), random), "total": (("term", "run"), total)}, {"term": terms}
    )


def tables(aircraft: flightmech.Aircraft, jobs: int, seed: int = 1) -> None:
    """Print what Tables 2 to 5 hold, as found."""
    conditions = {"glide": glide(aircraft), "spin": spin(aircraft)}
    found = {}
    for name, runs in (("glide", GLIDE_RUNS), ("spin", SPIN_RUNS)):
        recovery, _ = campaign(conditions[name], aircraft, runs, seed, jobs)
        found[name] = recovery.models(conditions[name].models)
        print(f"\n{name} model\n{recovery.report()}")
    errors = draw_errors(aircraft, np.random.default_rng([seed, 0]))
    for name, models in (("glide", ("glide",)), ("spin", ("glide", "spin"))):
        data = run_data(conditions[name], aircraft, errors, [seed, 1000], which=1)
        print(f"\n{name} run with a multisine of another spectrum")
        print(
            validation_report(
                validation_table(data, {model: predictions(data, found[model]) for model in models})
            )
        )


def statistics(aircraft: flightmech.Aircraft, runs: int, jobs: int) -> None:
    """Print bias and coverage over campaigns with other instruments and other noise, of at least so
    many runs.
    """
    for condition, size in ((glide(aircraft), GLIDE_RUNS), (spin(aircraft), SPIN_RUNS)):
        found = [
            campaign(condition, aircraft, size, 100 + seed, jobs)
            for seed in range(-(-runs // size))
        ]
        every = xr.concat([errors for _, errors in found], "run")
        medians = np.stack([recovery.table["median"].values for recovery, _ in found])
        flown, sigma = (found[0][0].table[name].values for name in ("flown", "sigma"))
        error = medians.mean(axis=0) - flown
        z = error / (medians.std(axis=0, ddof=1) / np.sqrt(len(found)))
        largest = every["term"].values[np.argsort(-np.abs(error) / sigma)[:4]]
        print(f"\n{condition.name}: {len(found)} campaigns of {size} runs")
        print(
            f"terms within two published sigma, of {len(flown)}: "
            f"{min(recovery.inside for recovery, _ in found)} at least"
        )
        print(
            f"mean error of the medians, in published sigma: "
            f"{np.max(np.abs(error) / sigma):.2f} at most ({', '.join(largest)})"
        )
        print(
            f"mean error of the medians over its own standard error: rms "
            f"{np.sqrt(np.mean(z**2)):.2f}, median {np.median(np.abs(z)):.2f}"
        )
        slopes = np.array([not term.endswith("/1") for term in every["term"].values])
        for kind, chosen in (("slopes", slopes), ("constants", ~slopes)):
            for which in ("random", "total"):
                z = every[which].values[chosen]
                share, rms = 100.0 * np.mean(np.abs(z) <= 2.0), np.sqrt(np.mean(z**2))
                print(
                    f"single runs, {kind}, {which} error: {share:.1f} % within two standard "
                    f"errors, rms {rms:.2f}"
                )
        inside = (np.abs(every["total"]) <= 2.0).mean("run")[slopes]
        lowest = inside.sortby(inside)[:5]
        print(
            "lowest: "
            + ", ".join(
                f"{term} {100 * part:.0f} %"
                for term, part in zip(lowest["term"].values, lowest.values)
            ),
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=0,
        help="runs for bias and coverage; without it the tables are printed",
    )
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    if given.runs:
        statistics(aircraft, given.runs, given.jobs)
    else:
        tables(aircraft, given.jobs)


if __name__ == "__main__":
    main()
