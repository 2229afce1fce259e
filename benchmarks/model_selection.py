"""Choice of a model among 364 candidates: 30 s at 50 Hz (1501 samples), all products of eleven
variables to third order.

Peers, in the same run on the same record:
  - greedy orthogonal least squares as it is written down (identification reference 8.2): after each
    choice all remaining candidates are made orthogonal to it, twice; 0.04 to 0.05 s is the figure
    to beat;
  - multivariate orthogonal functions in the order of generation (Morelli, J. Aircraft 1995), ranked
    afterwards;
  - forward stepwise regression with a QR factorisation of the model per step; the figure to beat is
    0.3 s;
  - the same with a regression of its own for every candidate at every step, as textbooks define the
    partial F.
All start from the same matrix of candidates, which each makes for itself.

python benchmarks/model_selection.py
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from timing import best  # next to this file

from flighttest.regression.equation_error.model import term_regressors
from flighttest.regression.model_structure.candidates import candidate_equations, monomials
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.rating import Rating
from flighttest.regression.model_structure.search import GAIN, select_orthogonal, select_stepwise

VARIABLES = [
    "alpha",
    "beta",
    "phat",
    "qhat",
    "rhat",
    "delta_e",
    "delta_a",
    "delta_r",
    "mach",
    "alphadothat",
    "betadothat",
]
TRUTH = {
    "1",
    "alpha",
    "delta_e",
    "qhat",
    "alpha**2",
    "beta**2",
    "alpha*mach",
    "alpha**3",
    "alpha*beta*delta_r",
}
CANDIDATES = monomials(VARIABLES, 3)
STOP = 1e-3  # rise of R2: the weakest term of this truth brings 0.4 %


def record(seed: int = 0, noise: float = 0.05, size: int = 1501) -> xr.Dataset:
    """Eleven band-limited variables correlated by up to 0.7, eight terms and a constant, and white
    noise.
    """
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(size)
    waves = np.cos(
        2 * np.pi * np.outer(np.arange(1, 20) / 30, t)[None]
        + rng.uniform(0, 2 * np.pi, (11, 19, 1))
    )
    x = (np.eye(11) + 0.35 * rng.normal(size=(11, 11))) @ (
        rng.normal(size=(11, 19, 1)) * waves
    ).sum(axis=1)
    x /= np.abs(x).max(axis=1, keepdims=True)
    data = xr.Dataset(dict(zip(VARIABLES, (("time", row) for row in x))), coords={"time": t})
    d = {name: data[name].values for name in VARIABLES}
    CL = (
        0.3
        + d["alpha"]
        - 0.4 * d["delta_e"]
        + 0.3 * d["qhat"]
        - 0.8 * d["alpha"] ** 2
        + 0.5 * d["beta"] ** 2
    )
    CL = (
        CL
        + 0.4 * d["alpha"] * d["mach"]
        - 0.6 * d["alpha"] ** 3
        + 0.5 * d["alpha"] * d["beta"] * d["delta_r"]
    )
    return data.assign(CL=("time", CL + noise * rng.normal(size=size)))


def forward(data: xr.Dataset) -> list[str]:
    """Ours, only what the greedy peer does too: candidates, choice, parameters of the ordinary
    polynomial.
    """
    problem = candidate_equations("CL", CANDIDATES, data, None)
    work = OrthogonalBasis(problem.X, problem.z)
    work.add(0)
    rate = Rating(problem)
    while True:
        gains = work.gains()
        j = work.best_candidate(gains)
        if gains[j] <= rate.least(STOP, work.rss - gains[j]):
            break
        work.add(j)
    work.estimates()
    return [problem.terms[j] for j in work.chosen]


def greedy(data: xr.Dataset) -> list[str]:
    """All remaining candidates made orthogonal to every choice, twice."""
    z = data["CL"].values
    P = term_regressors(CANDIDATES, data).T.copy()
    first = (P**2).sum(axis=0)
    total = float(((z - z.mean()) ** 2).sum())
    taken, r = [], z.copy()
    j = 0
    while True:
        q = P[:, j] / np.linalg.norm(P[:, j])
        r = r - (q @ r) * q
        taken.append(j)
        for _ in range(2):
            P -= np.outer(q, q @ P)
        size = (P**2).sum(axis=0)
        gain = np.where(size > 1e-8 * first, (P.T @ r) ** 2 / np.maximum(size, 1e-300), 0.0)
        gain[taken] = 0.0
        j = int(np.argmax(gain))
        if gain[j] <= max(STOP, 1 / len(z)) * total:
            return [CANDIDATES[k] for k in taken]


def generation_order(data: xr.Dataset) -> list[str]:
    """Functions made one after the other as they are written down, then ranked and kept while the
    PSE falls.
    """
    z = data["CL"].values
    X = term_regressors(CANDIDATES, data).T
    Q = np.empty_like(X)
    count, names = 0, []
    for name, x in zip(CANDIDATES, X.T):
        q = x - Q[:, :count] @ (Q[:, :count].T @ x)
        q -= Q[:, :count] @ (Q[:, :count].T @ q)
        size = np.linalg.norm(q)
        if size > 1e-4 * np.linalg.norm(x):
            Q[:, count] = q / size
            count += 1
            names.append(name)
    gains = np.sort((Q[:, 1:count].T @ z) ** 2)[::-1]
    total = float(((z - z.mean()) ** 2).sum())
    return names[: 1 + int((gains > total / len(z)).sum())]


def naive_stepwise(data: xr.Dataset) -> list[str]:
    """A QR factorisation of the model for every step, residuals of all candidates by products with
    it.
    """
    z = data["CL"].values
    X = term_regressors(CANDIDATES, data).T
    taken = [0]
    total = float(((z - z.mean()) ** 2).sum())
    while True:
        Q, _ = np.linalg.qr(X[:, taken])
        r = z - Q @ (Q.T @ z)
        left = X - Q @ (Q.T @ X)
        size = (left**2).sum(axis=0)
        gain = np.where(
            size > 1e-8 * (X**2).sum(axis=0), (left.T @ r) ** 2 / np.maximum(size, 1e-300), 0.0
        )
        gain[taken] = 0.0
        j = int(np.argmax(gain))
        if gain[j] <= max(STOP, 1 / len(z)) * total:
            return [CANDIDATES[k] for k in taken]
        taken.append(j)


def one_regression_each(data: xr.Dataset) -> list[str]:
    """The partial F of every candidate by a regression with it."""
    z = data["CL"].values
    X = term_regressors(CANDIDATES, data).T
    taken, rss = [0], float(((z - z.mean()) ** 2).sum())
    total = rss
    while True:
        found = [
            (np.inf if j in taken else _rss(X[:, [*taken, j]], z), j) for j in range(X.shape[1])
        ]
        least, j = min(found)
        if rss - least <= max(STOP, 1 / len(z)) * total:
            return [CANDIDATES[k] for k in taken]
        taken.append(j)
        rss = least


def _rss(X: np.ndarray, z: np.ndarray) -> float:
    Q, _ = np.linalg.qr(X)
    r = z - Q @ (Q.T @ z)
    return float(r @ r)


def main() -> None:
    data = record()
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "ours, forward choice": (lambda: forward(data), len(forward(data))),
        "greedy, all candidates made orthogonal": (lambda: greedy(data), len(greedy(data))),
        "orthogonal functions in order of generation": (
            lambda: generation_order(data),
            len(generation_order(data)),
        ),
        "stepwise, QR and all candidates per step": (
            lambda: naive_stepwise(data),
            len(naive_stepwise(data)),
        ),
        "stepwise, one regression per candidate": (
            lambda: one_regression_each(data),
            len(one_regression_each(data)),
        ),
    }
    times = {
        name: best(work, 2 if "per candidate" in name else 9) for name, (work, _) in ways.items()
    }
    ours = times["ours, forward choice"]
    print(
        f"{len(CANDIDATES)} candidates, {data.sizes['time']} samples; the truth has "
        f"{len(TRUTH)} terms, stop at a rise of R2 of {STOP}"
    )
    for name, (_, size) in ways.items():
        print(
            f"{name:46s} {1e3 * times[name]:7.1f} ms  {size:3d} terms  ratio "
            f"{times[name] / ours:5.1f}"
        )
    assert forward(data) == greedy(data), "not the same choice"
    for choose in (select_orthogonal, select_stepwise):
        found = choose("CL", CANDIDATES, data, gain=STOP)
        right = "the truth" if set(found.model.terms) == TRUTH else "not the truth"
        seconds = best(lambda choose=choose: choose("CL", CANDIDATES, data, gain=STOP), 5)
        name = f"{choose.__name__}, fit and coloured errors"
        print(f"{name:46s} {1e3 * seconds:7.1f} ms  {len(found.model.terms):3d} terms, {right}")
    print(f"default rise of R2 {GAIN}: {select_orthogonal('CL', CANDIDATES, data).model}")


if __name__ == "__main__":
    main()
