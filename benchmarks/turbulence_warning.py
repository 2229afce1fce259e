"""How often output error warns of turbulence or a missing term: on records with noise of
instruments alone, and on disturbed ones.

    python benchmarks/turbulence_warning.py [RECORDS]     of each kind, 40 unless given

Two models: a short period (two states, elevator multistep of 20 s at 25 Hz, four unknowns, vertical
Dryden gusts of a scale of 150 m at 100 m/s felt by vane and accelerometer too), and the
six-degree-of-freedom aeroplane of ``output_error.py`` under ``turbulence.*`` (12 s at 25 Hz, eight
unknowns).  Next to the rate stands that of records with an estimate off by more than three standard
errors.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import NamedTuple

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # the matrices are small: threads of BLAS only wait for each other

import numpy as np
import xarray as xr
from output_error import CHANNELS, ELEMENTS, HELD, LONGITUDINAL, OUTPUTS, A, B, C, aeroplane
from scipy.linalg import expm
from scipy.signal import bilinear, lfilter

import flightmech
import flighttest
from flightmech.errors import AeromatchWarning
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown

STEP, SPEED, SCALE = 0.04, 100.0, 150.0


class TurbulenceKind(NamedTuple):
    """A kind of record: noise of the instruments with a time constant [s] and a size, a gust [m/s],
    process noise, a missing term.
    """

    time: float = 0.0
    size: float = 1.0
    gust: float = 0.0
    process: float = 0.0
    lacking: float = 0.0


LINEAR = {
    "white noise": TurbulenceKind(),
    "noise of 0.3 s": TurbulenceKind(0.3),
    "noise of 1 s": TurbulenceKind(1.0),
    "noise of 1 s, 5 times": TurbulenceKind(1.0, 5.0),
    "noise of 3 s, 5 times": TurbulenceKind(3.0, 5.0),
    "noise of 1 s, 15 times": TurbulenceKind(1.0, 15.0),
    "gusts of 0.3 m/s": TurbulenceKind(gust=0.3),
    "gusts of 1 m/s": TurbulenceKind(gust=1.0),
    "gusts of 2 m/s": TurbulenceKind(gust=2.0),
    "process noise, a third": TurbulenceKind(process=0.3),
    "process noise": TurbulenceKind(process=1.0),
    "no moment of alpha > 0, -0.5 M_alpha": TurbulenceKind(lacking=3.0),
    "no moment of alpha > 0, -0.75 M_alpha": TurbulenceKind(lacking=4.5),
}
FLOWN = {
    "white noise": TurbulenceKind(),
    "noise of 1 s": TurbulenceKind(1.0),
    "noise of 1 s, 5 times": TurbulenceKind(1.0, 5.0),
    "gusts of 0.3 m/s": TurbulenceKind(gust=0.3),
    "gusts of 1 m/s": TurbulenceKind(gust=1.0),
    "gusts of 2 m/s": TurbulenceKind(gust=2.0),
    "no Cm_q": TurbulenceKind(lacking=1.0),
}


def noise(kind: TurbulenceKind, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Return noise of unit variance, independent between outputs, times the size of its kind."""
    pole = np.exp(-STEP / kind.time) if kind.time else 0.0
    white = rng.standard_normal((shape[0] + 500, shape[1]))
    return kind.size * lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white, axis=0)[500:]


def vertical_gust(sigma: float, rng: np.random.Generator, count: int, step: float) -> np.ndarray:
    """Return w over V of the Dryden spectrum of MIL-F-8785C."""
    T = SCALE / SPEED
    b, a = bilinear(
        [np.sqrt(3.0 * T / np.pi) * T, np.sqrt(T / np.pi)], [T * T, 2.0 * T, 1.0], 1.0 / step
    )
    white = np.sqrt(np.pi / step) * rng.standard_normal(count + 2000)
    return sigma / SPEED * lfilter(b, a, white)[2000:]


def short_period(kind: TurbulenceKind, seed: int) -> tuple[OutputError, dict[str, float]]:
    """Return the fit of one record of the linear model, and the truth."""
    names = {
        "state": ["alpha", "q"],
        "state_": ["alpha", "q"],
        "input": ["delta_e"],
        "output": ["alpha", "q", "nz"],
    }
    dims = {
        "A": ("state", "state_"),
        "B": ("state", "input"),
        "C": ("output", "state_"),
        "D": ("output", "input"),
    }
    values = {"A": A, "B": B, "C": C, "D": np.zeros((3, 1))}
    model = flighttest.maximum_likelihood.linear_model(
        xr.Dataset({name: (dims[name], x) for name, x in values.items()}, names)
    )
    rng, fine = np.random.default_rng(seed), 5
    t = np.arange(0.0, 20.02, STEP)
    steps = np.interp(t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0])
    u = 0.03 * steps + 0.01 * np.sin(5.0 * t) * (t < 15)
    h = STEP / fine
    count = (len(t) - 1) * fine + 1
    drive = np.interp((np.arange(count) + 0.5) * h, t, u)
    gust = vertical_gust(kind.gust, rng, count, h)
    stirred = kind.process * np.sqrt(h) * np.array([0.02, 0.03]) * rng.standard_normal((count, 2))
    F = expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2))
    x, states = np.zeros(2), np.empty((count, 2))
    for k in range(count):
        states[k] = x
        rates = (
            B[:, 0] * drive[k] + A[:, 0] * gust[k] + np.array([0.0, kind.lacking * max(x[0], 0.0)])
        )
        x = F @ x + G @ rates + stirred[k]
    y = (
        states[::fine] @ C.T
        + np.outer(gust[::fine], C[:, 0])
        + noise(kind, rng, (len(t), 3)) * np.array([2e-3, 2e-3, 0.02])
    )
    record = xr.Dataset(
        {"delta_e": ("time", u)}
        | {name: ("time", y[:, k]) for k, name in enumerate(names["output"])},
        {"time": t},
    )
    start = {name: 0.85 * value for name, value in ELEMENTS.items()}
    return flighttest.maximum_likelihood.linear_output_error(model, record, start), ELEMENTS


def flown(kind: TurbulenceKind, seed: int) -> tuple[OutputError, dict[str, float]]:
    """Return the fit of one record of the six-degree-of-freedom model, and the truth."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, STEP)
    u = 0.02 * np.interp(t, [1.0, 1.2, 2.2, 2.4, 3.4, 3.6], [0, 1, 1, -1, -1, 0])
    record = xr.Dataset(
        {"delta_e": ("time", u), "engine1.thrust_drive": ("time", np.full(len(t), 2600.0))},
        {"time": t},
    )
    air = {"turbulence.mode": 1.0, "turbulence.seed": float(seed)} if kind.gust else {}
    air |= {f"turbulence.sigma_{axis}": kind.gust for axis in "uvw"} if kind.gust else {}
    air |= {f"turbulence.L_{axis}": SCALE for axis in "uvw"} if kind.gust else {}
    sim = aeroplane()
    y = flightmech.simulate(
        sim,
        record,
        {**HELD, **air, "init.V": 80.0, "init.alpha": 0.03, "init.theta": 0.03},
        outputs=list(CHANNELS),
        step=STEP,
    )
    e = noise(kind, rng, (len(t), len(CHANNELS)))
    record = record.assign(
        {
            name: ("time", y[name].values + OUTPUTS[name] * e[:, k])
            for k, name in enumerate(CHANNELS)
        }
    )
    truth = {
        name: value
        for name, value in LONGITUDINAL.items()
        if not (kind.lacking and name == "term.Cm.qhat")
    }
    lacking = {"term.Cm.qhat": 0.0} if kind.lacking else {}
    free = {name: Unknown(None) for name in ("init.V", "init.alpha", "init.theta")} | {
        "sensor.alpha": 0.0
    }
    unknowns = {name: 0.9 for name in truth} | free
    return flighttest.output_error(sim, record, unknowns, CHANNELS, HELD | lacking), truth


def main(records: int) -> None:
    warnings.simplefilter("ignore", AeromatchWarning)
    print(
        f"{records} records "
        f"each{'':24s}{'warned':>8s}{'off by 3 s.e.':>15s}{'coupling':>10s}{'effect':>9s}"
    )
    for what, kinds, fit in (
        ("short period", LINEAR, short_period),
        ("six degrees of freedom", FLOWN, flown),
    ):
        print(what)
        for name, kind in kinds.items():
            rows = []
            for seed in range(records):
                found, truth = fit(kind, seed)
                e = found.estimates.sel(parameter=list(truth))
                off = (
                    np.abs(e["estimate"].values - np.array(list(truth.values())))
                    / e["stderr"].values
                )
                rows.append(
                    (
                        bool(found.warnings),
                        off.max() > 3.0,
                        float(found.noise["coupling"].max()),
                        found.noise.attrs["effect"],
                    )
                )
            warned, bad, coupling, effect = np.array(rows, float).T
            print(
                f"  {name:38s}{warned.mean():8.0%}{bad.mean():15.0%}"
                f"{np.median(coupling):10.2f}{np.median(effect):9.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
