"""Structures selected from simulated short-period records, 40 seeds for each truth and colour.

Truths: linear, with alpha**2, with alpha*qhat, with alpha*delta_e; each strong (clear in every
record) and weak (a fifth of it).  Nine candidates, all products of alpha, qhat and delta_e up to
second order.  Disturbances: white, AR(1) of 0.3 and 1 s, oscillating at 0.5 Hz.  Counted are
records whose structure is the truth, whose moment has lost its damping, and whose set of models
holds the truth; the size of the set, the weight of the truth in it, and the share of the estimates
of the true terms within two standard errors, with and without the spread of the models.  A truth
counts as missing an estimate that its best model lacks.

The last table has residuals that grow with the motion: coverage of a regression whose model is the
truth.

    python benchmarks/model_structure.py [--seeds 40] [--first 7000] [--growth 60]
                                         [--truths ...] [--sizes ...]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import xarray as xr
from flighttest.model_structure import monomials, select_by_prediction, select_orthogonal
from regression_coverage import COLOURS, LIFT, MODEL, lift  # next to this file
from scipy.linalg import expm

import flighttest

STEP = 0.02
NOISE = 0.003
LINEAR = {"1": -0.02, "alpha": -0.8, "qhat": -14.0, "delta_e": -1.2}
TRUTHS = {
    "linear": {},
    "alpha**2": {"alpha**2": -6.0},
    "alpha*qhat": {"alpha*qhat": -150.0},
    "alpha*delta_e": {"alpha*delta_e": -12.0},
}
WEAK = 0.2
FOUR = ("white", "AR(1), 0.3 s", "AR(1), 1 s", "oscillating at 0.5 Hz")
CANDIDATES = monomials(["alpha", "qhat", "delta_e"], 2)
A = np.array([[-1.1, 0.97], [-5.0, -2.2]])
B = np.array([[-0.08], [-9.0]])


def elevator(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """3-2-1-1 inputs of random size, width and sign."""
    u = np.zeros(len(t))
    begin = 1.0
    while begin < t[-1] - 5.0:
        width, size = rng.uniform(0.4, 0.7), rng.uniform(0.02, 0.05) * rng.choice([-1, 1])
        for count, sign in zip((3, 2, 1, 1), (1, -1, 1, -1)):
            u[(t >= begin) & (t < begin + count * width)] = sign * size
            begin += count * width
        begin += rng.uniform(3.0, 6.0)
    return u


def record(seed: int, truth: dict[str, float], colour: str, duration: float = 40.0) -> xr.Dataset:
    """A short period at 90 m/s under the elevator, and its pitching moment."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, STEP)
    u = elevator(rng, t)
    step = expm(np.block([[A, B], [np.zeros((1, 3))]]) * STEP)
    x = np.zeros((len(t), 2))
    for k in range(len(t) - 1):
        x[k + 1] = step[:2, :2] @ x[k] + step[:2, 2] * u[k]
    columns = {"alpha": x[:, 0] + 0.05, "qhat": x[:, 1] * 2.0 / 180.0, "delta_e": u}
    data = xr.Dataset({name: ("time", values) for name, values in columns.items()}, {"time": t})
    model = flighttest.RegressionModel("Cm", list(truth))
    moment = model.design(data) @ np.array(list(truth.values()))
    return data.assign(Cm=("time", moment + NOISE * COLOURS[colour](rng, len(t))))


def before(data: xr.Dataset) -> tuple[str, ...]:
    """The default of earlier versions: orthogonal functions without hierarchy."""
    return select_orthogonal("Cm", CANDIDATES, data, hierarchy=False).model.terms


def study(truth: dict[str, float], colour: str, seeds: range) -> dict[str, float]:
    """Return the shares of one truth and one colour."""
    rows = []
    for seed in seeds:
        data = record(seed, truth, colour)
        greedy, fixed = (
            set(before(data)),
            set(select_orthogonal("Cm", CANDIDATES, data).model.terms),
        )
        start = time.process_time()
        found = select_by_prediction("Cm", CANDIDATES, data)
        seconds = time.process_time() - start
        e = found.estimates
        models = {
            frozenset(row.model.split(" + ")): row.weight for row in found.models.itertuples()
        }
        terms = [term for term in truth if term in e["term"].values]
        off = np.abs(e["estimate"].sel(term=terms) - [truth[term] for term in terms]).values
        stderr, spread = (e[name].sel(term=terms).values for name in ("stderr", "stderr_models"))
        lost = len(truth) - len(terms)
        rows.append(
            {
                "exact_before": greedy == set(truth),
                "lost_before": "qhat" not in greedy,
                "exact_orthogonal": fixed == set(truth),
                "exact": set(found.model.terms) == set(truth),
                "lost": "qhat" not in found.model.terms,
                "in_set": frozenset(truth) in models,
                "models": len(models),
                "weight": models.get(frozenset(truth), 0.0),
                "within": (off < 2.0 * stderr).sum() / (len(terms) + lost),
                "without": (off**2 < 4.0 * (stderr**2 - spread**2)).sum() / (len(terms) + lost),
                "seconds": seconds,
            }
        )
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def growths(data: xr.Dataset) -> dict[str, np.ndarray]:
    """Envelopes of a disturbance, from the motion."""
    scaled = {}
    for name in ("alpha", "qhat", "delta_e"):
        scaled[name] = (data[name] - data[name].mean()).values / float(data[name].std())
    return {
        "stationary": np.ones(data.sizes["time"]),
        "1 + 2 |alpha|": (1.0 + 2.0 * np.abs(scaled["alpha"])) / 2.0,
        "|qhat|": np.abs(scaled["qhat"]),
        "all three": np.sqrt(sum(values**2 for values in scaled.values()) / 3.0),
    }


def growth(colour: str, kind: str, seeds: range) -> tuple[float, float, float, float, float]:
    """Return coverage with and without growth, all terms and the worst, and the rate of remarks."""
    new, old, remarked = [], [], []
    truth = np.array(list(LIFT.values()))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        data = lift(rng, 20.0, "white", noise=0.0)
        noise = 0.01 * COLOURS[colour](rng, data.sizes["time"]) * growths(data)[kind]
        fit = flighttest.regress(MODEL, data.assign(CL=("time", data["CL"].values + noise)))
        e = fit.estimates
        off = np.abs(e["estimate"].values - truth)
        new.append(off < 2.0 * e["stderr"].values)
        stationary = e["stderr_stationary" if "stderr_stationary" in e else "stderr"].values
        old.append(off < 2.0 * stationary)
        remarked.append(any(remark.kind == "growth" for remark in fit.remarks))
    return (
        float(np.mean(old)),
        float(np.mean(old, axis=0).min()),
        float(np.mean(new)),
        float(np.mean(new, axis=0).min()),
        float(np.mean(remarked)),
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--growth", type=int, default=60)
    parser.add_argument("--truths", nargs="*", default=list(TRUTHS), choices=list(TRUTHS))
    parser.add_argument("--sizes", nargs="*", default=["strong", "weak"])
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    print(
        f"{'truth':15s}{'':8s}{'disturbance':24s}{'before: exact':>14s}{'no damping':>11s}"
        f"{'| orth. exact':>14s}{'| exact':>9s}{'no damping':>11s}{'in set':>8s}{'models':>8s}"
        f"{'weight':>8s}{'within 2':>9s}{'no spread':>10s}{'s':>6s}"
    )
    for size in asked.sizes:
        factor = {"strong": 1.0, "weak": WEAK}[size]
        for name in asked.truths:
            extra = TRUTHS[name]
            if size == "weak" and not extra:
                continue
            truth = {**LINEAR, **{term: factor * value for term, value in extra.items()}}
            for colour in FOUR:
                row = study(truth, colour, seeds)
                print(
                    f"{name:15s}{size:8s}{colour:24s}{row['exact_before']:14.0%}"
                    f"{row['lost_before']:11.0%}{row['exact_orthogonal']:14.0%}{row['exact']:9.0%}"
                    f"{row['lost']:11.0%}{row['in_set']:8.0%}{row['models']:8.1f}"
                    f"{row['weight']:8.2f}{row['within']:9.1%}{row['without']:10.1%}"
                    f"{row['seconds']:6.2f}",
                    flush=True,
                )
    if not asked.growth:
        return
    print(f"\n{'disturbance':24s}{'growth':16s}{'stationary':>11s}{'worst':>8s}{'growing':>9s}"
          f"{'worst':>8s}{'remarked':>10s}")  # fmt: skip
    for colour in FOUR:
        for kind in ("stationary", "1 + 2 |alpha|", "|qhat|", "all three"):
            row = growth(colour, kind, range(asked.growth))
            print(f"{colour:24s}{kind:16s}{row[0]:11.1%}{row[1]:8.1%}{row[2]:9.1%}{row[3]:8.1%}"
                  f"{row[4]:10.0%}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
