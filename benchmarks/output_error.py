"""Output error over the kernel: speed on ten manoeuvres, and whether two standard errors cover 95
%.

    python benchmarks/output_error.py            all
    python benchmarks/output_error.py speed      30 parameters of a 6-DOF model, 10 manoeuvres
    python benchmarks/output_error.py linear     8 parameters of a linear model of 3 states
    python benchmarks/output_error.py coverage   200 simulated records each

The manoeuvres last 20 s at 50 Hz with 11 outputs, the record of the linear model 30 s with four.
The records of the coverage have white and coloured noise of the instruments, or turbulence.

The first is set against JSBSim's T37 flying as many frames as the fit flies steps (package
``jsbsim``), the second against the output error of aeroid on the same record, model and start
(``pip install aeroid``), each in turn with its peer in the same run. Records of the coverage are
spread over the cores by joblib; under ``joblib.parallel_config("dask")`` the same call runs on a
cluster.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from typing import Any

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # the matrices are small: threads of BLAS only wait for each other

import numpy as np
import xarray as xr
from joblib import Parallel, delayed
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.signal import lfilter, lsim

import flightmech
import flighttest
from flightmech.errors import AeromatchWarning
from flightmech.terms import make_term

ALPHA, STEP = np.linspace(-0.15, 0.35, 11), 0.02
OUTPUTS = {
    "V": 0.2, "alpha": 2e-3, "beta": 2e-3, "p": 2e-3, "q": 1e-3, "r": 1e-3, "phi": 1e-3,
    "theta": 1e-3, "ax": 0.05, "ay": 0.05, "az": 0.1,
}  # fmt: skip
DERIVATIVES = {
    "CL": {"qhat": 7.0, "delta_e": 0.4, "delta_f": 1.2},
    "CD": {"delta_e": 0.02, "delta_f": 0.08},
    "CY": {"beta": -0.6, "phat": -0.05, "rhat": 0.25, "delta_r": 0.15},
    "Cl": {"beta": -0.08, "phat": -0.45, "rhat": 0.12, "delta_a": -0.12, "delta_r": 0.01},
    "Cm": {"qhat": -14.0, "delta_e": -1.1, "delta_f": -0.1},
    "Cn": {"beta": 0.09, "phat": -0.04, "rhat": -0.14, "delta_a": 0.005, "delta_r": -0.07},
}
REPEATS = 5
HELD = {"mode.earth": 0.0, "init.h": 2000.0, "init.q": 0.0, "mode.engine": 2.0}


def aeroplane() -> flightmech.SimModel:
    """Basic tables of lift, drag and pitching moment over alpha and 22 derivatives."""
    basic = {"CL": 0.25 + 5.0 * ALPHA, "CD": 0.025 + 0.9 * ALPHA**2, "Cm": 0.02 - 0.7 * ALPHA}
    leaves = {f"/{c}/basic": make_term(value, {"alpha": ALPHA}) for c, value in basic.items()}
    leaves |= {
        f"/{c}/{x}": make_term(value, regressors=[x])
        for c, terms in DERIVATIVES.items()
        for x, value in terms.items()
    }
    engine = flightmech.aircraft.Engine(
        (0.0, 0.0, 0.0),
        thrust=make_term([0.0, 9000.0], {"throttle": [0.0, 1.0]}),
        time_constant=0.5,
    )
    craft = flightmech.Aircraft(
        "trainer", 17.0, 1.67, 10.3, 2500.0, 10000.0, 8100.0, 15000.0, Ixz=500.0, engines=(engine,)
    )
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def unknowns() -> dict[str, float]:
    """Scales of 23 terms, six nodes of the tables and a yawing moment: 30 parameters and their
    truth.
    """
    scales = {f"term.{c}.{x}": 1.0 for c, terms in DERIVATIVES.items() for x in terms} | {
        "term.CD.basic": 1.0,
        "bias.Cn": 0.0,
    }
    values = {"CL": 0.25 + 5.0 * ALPHA, "Cm": 0.02 - 0.7 * ALPHA}
    chosen = [("CL", 3), ("CL", 4), ("CL", 5), ("Cm", 3), ("Cm", 4), ("Cm", 5)]
    return scales | {f"node.{c}.basic[{k}]": float(values[c][k]) for c, k in chosen}


def manoeuvre(number: int) -> xr.Dataset:
    """Elevator, aileron, rudder and flap steps of 20 s at 50 Hz, flown and measured."""
    rng = np.random.default_rng(number)
    t = np.arange(0.0, 20.0, STEP)
    inputs = {}
    for name, size, first in (
        ("delta_e", 0.02, 1.0),
        ("delta_a", 0.03, 4.0),
        ("delta_r", 0.03, 7.0),
        ("delta_f", 0.1, 12.0),
    ):
        edges = first + np.cumsum([0.0, 1.5, 1.0, 0.6, 0.6]) * (0.8 + 0.04 * number)
        inputs[name] = (
            "time",
            size * np.interp(t, edges, [0, 1, -1, 1, 0]) * (1 if number % 2 else -1),
        )
    record = xr.Dataset(inputs, {"time": t}).assign(
        {"engine1.thrust_drive": ("time", np.full(len(t), 2600.0))}
    )
    start = {"init.V": 75.0 + 2.0 * number, "init.alpha": 0.03, "init.theta": 0.03}
    y = flightmech.simulate(aeroplane(), record, HELD | start, outputs=list(OUTPUTS), step=STEP)
    measured = {
        name: ("time", y[name].values + sigma * rng.standard_normal(len(t)))
        for name, sigma in OUTPUTS.items()
    }
    return record.assign(measured)


def speed() -> None:
    truth = unknowns()
    records = [manoeuvre(k) for k in range(10)]
    starts = [
        {**HELD, "init.V": 75.0 + 2.0 * k, "init.alpha": 0.03, "init.beta": 0.0, "init.theta": 0.03}
        for k in range(10)
    ]
    starts = [item | {f"init.{name}": 0.0 for name in ("phi", "p", "r")} for item in starts]
    far = {name: 1.15 * value for name, value in truth.items()}
    sim = aeroplane()

    def fly() -> flighttest.maximum_likelihood.OutputError:
        return flighttest.output_error(sim, records, far, list(OUTPUTS), starts)

    peer = jsbsim_frame()
    spent, cost, fit = in_turn(fly, peer)
    e = fit.estimates
    z = (e["estimate"].values - np.array(list(truth.values()))) / e["stderr"].values
    # the response of each iteration and the first with one-sided differences, central ones with the
    # last; no step was discarded
    n, unknowns_ = e.attrs["iterations"], len(truth)
    runs = ((n + 1) * (1 + unknowns_) + unknowns_) * len(records)
    frames = runs * records[0].sizes["time"]
    print(
        f"{len(truth)} parameters, {len(records)} manoeuvres of 20 s at 50 Hz, "
        f"{len(OUTPUTS)} outputs: {spent:.2f} s of CPU"
    )
    print(f"{n} iterations, {runs} runs, {1e9 * spent / frames:.0f} ns of CPU per simulated sample")
    print(
        f"errors in standard errors: rms {np.sqrt(np.mean(z**2)):.2f}, largest "
        f"{np.abs(z).max():.2f}"
    )
    if peer:
        print(
            f"JSBSim T37 needs {cost * frames:.1f} s of CPU for as many frames: "
            f"{cost * frames / spent:.1f} times as long"
        )


def jsbsim_frame() -> Callable[[], float] | None:
    """Return what measures the CPU time of a frame of JSBSim [s], None without the package."""
    try:
        import jsbsim  # noqa: F401
        from kernel_step import frame, trimmed_t37
    except ImportError:
        print("no jsbsim, no peer")
        return None
    fdm = trimmed_t37()
    return lambda: frame(fdm)


def in_turn(fit: Callable, peer: Callable[[], float] | None) -> tuple[float, float, Any]:
    """Return the least CPU time of a fit and the least that `peer` measures [s], one after the
    other, and what was found.
    """
    least = [np.inf, np.inf]
    for _ in range(REPEATS):
        start = time.process_time()
        found = fit()
        least = [
            min(least[0], time.process_time() - start),
            min(least[1], peer() if peer else np.inf),
        ]
    return least[0], least[1], found


YAW_A = np.array([[-0.15, 0.03, -0.99], [-12.0, -2.5, 0.8], [4.5, -0.1, -0.4]])  # beta, p, r
YAW_B = np.array([[0.0, 0.03], [-15.0, 2.0], [0.4, -3.0]])  # delta_a, delta_r
SPEED = 80.0  # the fourth output is SPEED times A[beta,beta] beta + B[beta,delta_r] delta_r [m/s]
YAW = {
    "A[beta,beta]": -0.15, "A[p,beta]": -12.0, "A[p,p]": -2.5, "A[p,r]": 0.8, "A[r,beta]": 4.5,
    "A[r,r]": -0.4,
    "B[p,delta_a]": -15.0, "B[r,delta_r]": -3.0,
}  # fmt: skip
YAW_NOISE = {"beta": 2e-3, "p": 5e-3, "r": 2e-3, "ay": 0.1}


def lateral() -> tuple[xr.Dataset, xr.Dataset]:
    """Return a lateral model, and a record of an aileron and a rudder doublet, 30 s at 50 Hz."""
    names = {
        "state": ["beta", "p", "r"],
        "state_": ["beta", "p", "r"],
        "input": ["delta_a", "delta_r"],
        "output": list(YAW_NOISE),
    }
    C, D = (
        np.vstack([np.eye(3), [SPEED * YAW_A[0, 0], 0.0, 0.0]]),
        np.vstack([np.zeros((3, 2)), [0.0, SPEED * YAW_B[0, 1]]]),
    )
    blocks = {
        "A": (("state", "state_"), YAW_A),
        "B": (("state", "input"), YAW_B),
        "C": (("output", "state_"), C),
    }
    linear = xr.Dataset(blocks | {"D": (("output", "input"), D)}, names)
    t = np.arange(1500) * STEP
    doublet = [0.0, 1.0, 1.0, -1.0, -1.0, 0.0]
    u = np.stack(
        [
            0.03 * np.interp(t, [1, 1.2, 2, 2.2, 3, 3.2], doublet),
            0.05 * np.interp(t, [6, 6.2, 7, 7.2, 8, 8.2], doublet),
        ],
        axis=1,
    )
    _, y, _ = lsim((YAW_A, YAW_B, C, D), u, t)
    z = y + np.array(list(YAW_NOISE.values())) * np.random.default_rng(1).standard_normal(y.shape)
    columns = {
        name: ("time", column)
        for name, column in zip([*names["input"], *YAW_NOISE], np.column_stack([u, z]).T)
    }
    return linear, xr.Dataset(columns, {"time": t})


def linear() -> None:
    given, record = lateral()
    model = flighttest.maximum_likelihood.linear_model(
        given, {"A[beta,beta]": {"C[ay,beta]": SPEED}}
    )
    start = {name: 0.8 * value for name, value in YAW.items()}
    found: list = []
    spent, cost, fit = in_turn(
        lambda: flighttest.maximum_likelihood.linear_output_error(model, record, start),
        aeroid_fit(record, start, found),
    )
    e = fit.estimates
    print(
        f"3 states, {len(YAW)} parameters, 4 outputs, {record.sizes['time']} samples: "
        f"{1e3 * spent:.0f} ms of CPU"
    )
    print(f"{e.attrs['iterations']} iterations, standard errors of coloured residuals")
    if found:
        theirs = np.array(list(found[-1].parameters.values()))
        apart = np.abs(theirs - e["estimate"].values) / e["stderr"].values
        work = (
            f"{found[-1].n_evaluations} runs, the noise given, white standard errors: {cost:.2f} s"
        )
        print(
            f"aeroid, {work}, {cost / spent:.0f} times as long; estimates within "
            f"{apart.max():.3f} standard errors of ours"
        )


def aeroid_fit(
    record: xr.Dataset, start: dict[str, float], found: list
) -> Callable[[], float] | None:
    """Return what measures the CPU time of the fit by aeroid [s] and appends its result, None
    without the package.
    """
    try:
        import aeroid
    except ImportError:
        print("no aeroid, no peer")
        return None
    names = [name.translate(str.maketrans("[,]", "___")) for name in start]

    def rates(_: float, x: np.ndarray, u: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        Yb, Lb, Lp, Lr, Nb, Nr, La, Nd = (p[name] for name in names)
        (_, Yp, Yr), (_, Np, _) = YAW_A[0], YAW_A[2]
        return np.array(
            [
                Yb * x[0] + Yp * x[1] + Yr * x[2] + YAW_B[0, 1] * u[1],
                Lb * x[0] + Lp * x[1] + Lr * x[2] + La * u[0] + YAW_B[1, 1] * u[1],
                Nb * x[0] + Np * x[1] + Nr * x[2] + YAW_B[2, 0] * u[0] + Nd * u[1],
            ]
        )

    def seen(_: float, x: np.ndarray, u: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        return np.array([x[0], x[1], x[2], SPEED * (p[names[0]] * x[0] + YAW_B[0, 1] * u[1])])

    first = dict(zip(names, start.values()))
    model = aeroid.Model(
        ("x_beta", "x_p", "x_r"), ("delta_a", "delta_r"), first, rates, tuple(YAW_NOISE), seen
    )
    data = aeroid.FlightData(
        record["time"].values,
        {str(name): column.values for name, column in record.data_vars.items()},
    )
    weights = {name: 1.0 / sigma for name, sigma in YAW_NOISE.items()}

    def fit() -> float:
        begin = time.process_time()
        found.append(aeroid.identify(model, data, names, weights=weights, x0=np.zeros(3)))
        return time.process_time() - begin

    return fit


LONGITUDINAL = {
    "term.CL.basic": 1.0,
    "term.Cm.basic": 1.0,
    "term.Cm.qhat": 1.0,
    "term.Cm.delta_e": 1.0,
}
CHANNELS = ("V", "alpha", "q", "theta", "az")


def errors(seed: int, pole: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of one record of 12 s at 25 Hz in corrected and in Cramer-Rao standard errors; noise
    with a pole per sample.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 0.04)
    u = 0.02 * np.interp(t, [1.0, 1.2, 2.2, 2.4, 3.4, 3.6], [0, 1, 1, -1, -1, 0])
    record = xr.Dataset(
        {"delta_e": ("time", u), "engine1.thrust_drive": ("time", np.full(len(t), 2600.0))},
        {"time": t},
    )
    start = {"init.V": 80.0, "init.alpha": 0.03, "init.theta": 0.03}
    sim = aeroplane()
    y = flightmech.simulate(sim, record, HELD | start, outputs=list(CHANNELS), step=0.04)
    white = rng.standard_normal((len(t) + 200, len(CHANNELS)))
    noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white, axis=0)[200:]
    record = record.assign(
        {
            name: ("time", y[name].values + OUTPUTS[name] * noise[:, k])
            for k, name in enumerate(CHANNELS)
        }
    )
    free = {
        name: flighttest.maximum_likelihood.Unknown(None)
        for name in ("init.V", "init.alpha", "init.theta")
    } | {"sensor.alpha": 0.0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)  # coverage is measured, warned of or not
        fit = flighttest.output_error(
            sim, record, {name: 0.9 for name in LONGITUDINAL} | free, CHANNELS, HELD
        )
    e = fit.estimates.sel(parameter=[*LONGITUDINAL, "sensor.alpha"])
    off = e["estimate"].values - np.array([*LONGITUDINAL.values(), 0.0])
    return off / e["stderr"].values, off / e["stderr_white"].values


A, B, C = (
    np.array([[-1.2, 0.98], [-6.0, -1.8]]),
    np.array([[-0.1], [-9.0]]),
    np.array([[1.0, 0.0], [0.0, 1.0], [7.3, 0.0]]),
)
ELEMENTS = {"A[alpha,alpha]": -1.2, "A[q,alpha]": -6.0, "A[q,q]": -1.8, "B[q,delta_e]": -9.0}


def linear_errors(seed: int, gust: float, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The same for a short period of 20 s, exact transitions between samples, `gust` as white noise
    of both rates.
    """
    names = {
        "state": ["alpha", "q"],
        "state_": ["alpha", "q"],
        "input": ["delta_e"],
        "output": ["alpha", "q", "nz"],
    }
    blocks = {
        "A": ("state", "state_"),
        "B": ("state", "input"),
        "C": ("output", "state_"),
        "D": ("output", "input"),
    }
    values = {"A": A, "B": B, "C": C, "D": np.zeros((3, 1))}
    model = flighttest.maximum_likelihood.linear_model(
        xr.Dataset({name: (blocks[name], x) for name, x in values.items()}, names)
    )
    rng, fine = np.random.default_rng(seed), 10
    t = np.arange(0.0, 20.02, 0.04)
    u = 0.03 * np.interp(
        t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0]
    ) + 0.01 * np.sin(5.0 * t) * (t < 15)
    h = 0.04 / fine
    F = expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2)) @ B[:, 0]
    middle = (np.arange((len(t) - 1) * fine) + 0.5) * h
    # the Fourier transform takes an input for smooth between samples, the filter for linear
    drive = CubicSpline(t, u)(middle) if kind == "frequency" else np.interp(middle, t, u)
    x, states = np.zeros(2), [np.zeros(2)]
    for value in drive:
        x = F @ x + G * value + gust * np.sqrt(h) * np.array([0.02, 0.03]) * rng.standard_normal(2)
        states.append(x)
    y = np.array(states)[::fine] @ C.T + np.array([2e-3, 2e-3, 0.02]) * rng.standard_normal(
        (len(t), 3)
    )
    record = xr.Dataset(
        {"delta_e": ("time", u)}
        | {name: ("time", y[:, k]) for k, name in enumerate(names["output"])},
        {"time": t},
    )
    start = {name: 0.85 * value for name, value in ELEMENTS.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        if kind == "frequency":
            fit = flighttest.maximum_likelihood.frequency_output_error(
                model, record, start, band=(0.05, 3.0)
            )
        else:
            calm = {"process.alpha": 0.01, "process.q": 0.01} if kind == "filter" else {}
            fit = flighttest.maximum_likelihood.filter_error(model, record, start | calm)
    e = fit.estimates.sel(parameter=list(ELEMENTS))
    off = e["estimate"].values - np.array(list(ELEMENTS.values()))
    return off / e["stderr"].values, off / e["stderr_white"].values


STUDIES = {
    "kernel, white noise": (errors, (0.0,)),
    "kernel, noise with 0.1 s": (errors, (0.67,)),
    "kernel, noise with 0.3 s": (errors, (0.875,)),
    "frequency, calm air": (linear_errors, (0.0, "frequency")),
    "filter error, turbulence": (linear_errors, (1.0, "filter")),
    "open loop, turbulence": (linear_errors, (1.0, "open loop")),
    "frequency, turbulence": (linear_errors, (1.0, "frequency")),
}


def covered(study: str, seeds: int = 200) -> tuple[float, float, float]:
    """Return parts of the estimates within two corrected and two Cramer-Rao standard errors, and
    the largest mean error.
    """
    function, arguments = STUDIES[study]
    found = np.array(
        Parallel(n_jobs=-1)(delayed(function)(seed, *arguments) for seed in range(seeds))
    )
    inside = (np.abs(found) < 2.0).mean(axis=(0, 2))
    return float(inside[0]), float(inside[1]), float(np.abs(found[:, 0].mean(axis=0)).max())


def coverage() -> None:
    print(f"{'200 records':28s}{'corrected':>12s}{'Cramer-Rao':>12s}{'bias / s.e.':>12s}")
    for study in STUDIES:
        reported, white, bias = covered(study)
        print(f"{study:28s}{reported:12.1%}{white:12.1%}{bias:12.2f}", flush=True)


if __name__ == "__main__":
    studies = {"speed": speed, "linear": linear, "coverage": coverage}
    for name in sys.argv[1:] or studies:
        studies[name]()
