"""Batch reconstruction of 60 s at 100 Hz with 12 constants against the same fit as it is usually
written, in one run; and coverage.

The peer integrates the kinematics by Runge-Kutta steps and takes central differences, all perturbed
flights side by side in NumPy.  Same record, same constants, same Gauss-Newton iteration from the
same start.

python benchmarks/reconstruction.py              # speed
python benchmarks/reconstruction.py --coverage   # 200 flights: truths within two errors
"""

from __future__ import annotations

import argparse
import copy
import importlib.util
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import flighttest
from flighttest.reconstruction.batch.estimator import first_equations, fit_batch
from flighttest.reconstruction.batch.unknowns import layout_unknowns
from flighttest.reconstruction.problem.assembly import assemble_problem

FLIGHT = (
    Path(__file__).parents[1] / "tests" / "flighttest" / "conftest.py"
)  # the simulated flight of the tests
TRUE = {
    "lag.vanes": 1e-4,
    "static_error": 0.0,
    "delay.air_data": 0.0,
    "delay.gps": 0.0,
    "factor.alpha_vane": 1.07,
    "factor.beta_vane": 1.04,
}
OFFSETS = {
    "bias.alpha_vane": 0.008,
    "bias.beta_vane": -0.005,
    "bias.p": 3e-4,
    "bias.q": -2e-4,
    "bias.r": 1e-4,
}
OFFSETS |= {"bias.ax_imu": 0.03, "bias.ay_imu": -0.02, "bias.az_imu": 0.04}
FREE = [*OFFSETS, "factor.alpha_vane", "factor.beta_vane", "wind_n", "wind_e"]
G = 9.80665
PUBLISHED = 1.5  # s, identification.md: 60 s at 100 Hz, 15 + 6 unknowns, compiled inner loops


def simulator(rate: float):
    spec = importlib.util.spec_from_file_location("simulated_flight", FLIGHT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.RATE = rate
    return module


def craft(instruments: dict) -> SimpleNamespace:
    return SimpleNamespace(
        name="bench",
        S=17.0,
        cbar=1.7,
        b=10.3,
        mass=2100.0,
        cg=(0.0, 0.0, 0.0),
        instruments=instruments,
    )


class Peer:
    """Output error with central differences; unknowns: 7 of the start, then FREE."""

    def __init__(self, flight, record):
        imu, vanes, gps = (record[leaf].to_dataset() for leaf in ("imu", "vanes", "gps"))
        self.dt = 0.01
        self.imu = imu[["p", "q", "r", "ax_imu", "ay_imu", "az_imu"]].to_array().values.T
        self.arm, self.boom = flight.IMU, flight.BOOM
        omega = self.imu[:, :3]
        self.omega_dot = np.gradient(omega, self.dt, axis=0)
        self.every = round(100 / 5)
        names = ("phi", "theta", "psi", "alpha_vane", "beta_vane")
        self.z = np.stack(
            [
                *(imu[n].values for n in names[:3]),
                vanes["alpha_vane"].values,
                vanes["beta_vane"].values,
            ],
            axis=1,
        )
        self.z_gps = gps[["vn", "ve", "vd", "h_gps"]].to_array().values.T
        self.w = 1.0 / np.array([flight.NOISE[n] for n in names])
        self.w_gps = 1.0 / np.array([flight.NOISE[n] for n in ("vn", "ve", "vd", "h_gps")])

    def slope(self, x, u, f):
        sf, cf, st, ct, sp, cp = (g(x[i]) for i in (0, 1, 2) for g in (np.sin, np.cos))
        p, q, r = u
        turn = q * sf + r * cf
        n = f[0] * ct * cp + f[1] * (sf * st * cp - cf * sp) + f[2] * (cf * st * cp + sf * sp)
        e = f[0] * ct * sp + f[1] * (sf * st * sp + cf * cp) + f[2] * (cf * st * sp - sf * cp)
        d = -f[0] * st + f[1] * sf * ct + f[2] * cf * ct + G * (1.0 - 2.0 * x[6] / 6371000.0)
        return np.stack([p + st / ct * turn, q * cf - r * sf, turn / ct, n, e, d, -x[5]])

    def outputs(self, unknowns):
        """Return whitened outputs (runs, all readings) of unknowns (runs, 19)."""
        x, c = unknowns[:, :7].T, dict(zip(FREE, unknowns[:, 7:].T, strict=True))
        bias = np.stack([c[f"bias.{n}"] for n in ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")])
        inputs = self.imu[:, :, None] - bias
        omega, dot = inputs[:, :3], self.omega_dot[:, :, None]
        arm = np.broadcast_to(self.arm[None, :, None], omega.shape)
        force = (
            inputs[:, 3:]
            - np.cross(dot, arm, axis=1)
            - np.cross(omega, np.cross(omega, arm, axis=1), axis=1)
        )
        path = np.empty((len(inputs), *x.shape))
        path[0] = x
        h = self.dt
        for k in range(len(inputs) - 1):
            u = omega[k], (omega[k] + omega[k + 1]) / 2.0, omega[k + 1]
            f = force[k], (force[k] + force[k + 1]) / 2.0, force[k + 1]
            k1 = self.slope(x, u[0], f[0])
            k2 = self.slope(x + h / 2 * k1, u[1], f[1])
            k3 = self.slope(x + h / 2 * k2, u[1], f[1])
            k4 = self.slope(x + h * k3, u[2], f[2])
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            path[k + 1] = x
        sf, cf, st, ct, sp, cp = (g(path[:, i]) for i in (0, 1, 2) for g in (np.sin, np.cos))
        n, e, d = path[:, 3] - c["wind_n"], path[:, 4] - c["wind_e"], path[:, 5]
        U = np.stack(
            [
                n * ct * cp + e * ct * sp - d * st,
                n * (sf * st * cp - cf * sp) + e * (sf * st * sp + cf * cp) + d * sf * ct,
                n * (cf * st * cp + sf * sp) + e * (cf * st * sp - sf * cp) + d * cf * ct,
            ],
            axis=1,
        ) + np.cross(omega, np.broadcast_to(self.boom[None, :, None], omega.shape), axis=1)
        alpha = c["factor.alpha_vane"] * np.arctan2(U[:, 2], U[:, 0]) + c["bias.alpha_vane"]
        beta = c["factor.beta_vane"] * np.arctan2(U[:, 1], U[:, 0]) + c["bias.beta_vane"]
        shown = (
            np.stack([path[:, 0], path[:, 1], path[:, 2], alpha, beta], axis=1) * self.w[:, None]
        )
        low = path[:: self.every, 3:7] * self.w_gps[:, None]
        return np.concatenate(
            [shown.reshape(-1, shown.shape[-1]), low.reshape(-1, low.shape[-1])]
        ).T

    def fit(self, start: np.ndarray) -> tuple[np.ndarray, int]:
        z = np.concatenate([(self.z * self.w).ravel(), (self.z_gps * self.w_gps).ravel()])
        h = np.array([1e-4] * 3 + [1e-2] * 3 + [0.1] + [1e-4] * 10 + [1e-2] * 2)
        theta = start.copy()
        for count in range(1, 20):
            runs = self.outputs(
                np.concatenate([theta[None], theta + np.diag(h), theta - np.diag(h)])
            )
            S = (runs[1 : len(h) + 1] - runs[len(h) + 1 :]) / (2.0 * h[:, None])
            gradient = S @ (runs[0] - z)
            step = -np.linalg.solve(S @ S.T, gradient)
            theta += step
            if -gradient @ step < 0.01:
                return theta, count
        raise SystemExit("the peer did not settle")


def best(work, repeats: int = 4):
    """Return the shortest CPU time of some calls [s] and what the last one returned."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        found = work()
        times.append(time.process_time() - begin)
    return min(times), found


def speed() -> None:
    flight = simulator(100.0)
    instruments = copy.deepcopy(flight.INSTRUMENTS)
    for table in ("air_data", "gps"):
        del instruments[table]["delay"]
    instruments["vanes"]["lag"] = [1e-4, 1e-6]
    record, _, _ = flight.fly(0, duration=60.0, inertial_noise=0.05, error=TRUE | OFFSETS)
    aircraft = craft(instruments)
    flighttest.reconstruct_batch([record], aircraft, windows=[[(0.0, 2.0)]], rate=100.0)  # imports
    ours, batch = best(
        lambda: flighttest.reconstruct_batch([record], aircraft, free=FREE, rate=100.0)
    )
    smooth, _ = best(lambda: flighttest.reconstruct(record, aircraft, rate=100.0))
    setup = assemble_problem(record, aircraft, [(0.0, 60.0)], rate=100.0)
    alone, _ = best(
        lambda: fit_batch(first_equations(layout_unknowns([setup], FREE)))
    )  # the peer has its readings ready, and no standard errors
    peer = Peer(flight, record)
    start = np.zeros(7 + len(FREE))
    start[:3], start[3:7] = peer.z[0, :3], peer.z_gps[0]
    start[7 + FREE.index("factor.alpha_vane")] = start[7 + FREE.index("factor.beta_vane")] = 1.05
    theirs, (theta, count) = best(lambda: peer.fit(start), 2)
    found = batch.estimates.sel(parameter=FREE)
    apart = np.abs(found["estimate"].values - theta[7:]) / found["stderr"].values
    print(f"60 s at 100 Hz, {len(FREE)} constants and the start, CPU time")
    print(
        f"central differences over Runge-Kutta, NumPy, fit alone: {theirs:.2f} s, {count} "
        f"iterations"
    )
    print(
        f"ours, fit alone with the noise of the channels: {alone:.2f} s, {batch.iterations} "
        f"iterations; ratio {theirs / alone:.1f}"
    )
    print(
        f"ours, from the record, with noise, standard errors, states and report tables: "
        f"{ours:.2f} s; ratio {theirs / ours:.1f}"
    )
    print(
        f"ours, smoother, all constants, with states, their errors and report tables: "
        f"{smooth:.2f} s; ratio {theirs / smooth:.1f}"
    )
    print(f"published figure, compiled, 21 unknowns: {PUBLISHED} s; ratio {PUBLISHED / ours:.1f}")
    print(
        f"largest difference of an estimate: {apart.max():.2f} standard errors (the peer "
        f"leaves the pressures out)"
    )


def coverage(seeds: int, level: float, method: str) -> None:
    """Print how often the truth lies within two standard errors, and the mean deviations, over
    flights with other errors and noise.
    """
    flight = simulator(50.0)
    instruments = copy.deepcopy(flight.INSTRUMENTS)
    for name in ("p", "q", "r", "ax_imu", "ay_imu", "az_imu"):
        instruments["imu"]["noise"][name] *= level
    z, white = [], []
    for seed in range(seeds):
        record, error, _ = flight.fly(seed, duration=30.0, inertial_noise=level)
        if method == "batch":
            estimates = flighttest.reconstruct_batch([record], craft(instruments)).estimates
        else:
            estimates = flighttest.reconstruct(record, craft(instruments)).biases
        names = [name for name in estimates["parameter"].values if name in error]
        chosen = estimates.sel(parameter=names)
        off = chosen["estimate"].values - [error[name] for name in names]
        z.append(off / chosen["stderr"].values)
        if "stderr_white" in chosen:
            white.append(off / chosen["stderr_white"].values)
    inside = np.abs(np.array(z)) < 2.0
    mean = np.abs(np.mean(z, axis=0)) * np.sqrt(seeds)
    each = inside.mean(axis=0)
    print(
        f"{method}, inertial noise x {level:g}, {seeds} flights, {len(names)} constants: "
        f"{inside.mean():.1%} within two standard errors"
    )
    bounds = (
        f"; Cramer-Rao bounds alone {(np.abs(np.array(white)) < 2.0).mean():.1%}" if white else ""
    )
    print(f"  by constant {each.min():.1%} to {each.max():.1%}{bounds}")
    worst = names[int(mean.argmax())]
    print(
        f"  mean deviation over its standard error: rms {np.sqrt(np.mean(mean**2)):.2f}, "
        f"largest {mean.max():.2f} ({worst})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--coverage", action="store_true")
    parser.add_argument("--seeds", type=int, default=200)
    chosen = parser.parse_args()
    if not chosen.coverage:
        return speed()
    for level, method in ((0.05, "batch"), (1.0, "batch"), (1.0, "smoother")):
        coverage(chosen.seeds, level, method)


if __name__ == "__main__":
    main()
